"""Stability of steady motions of stiff beams with smooth laws, beside the whole map over a period
by products of exponentials."""

import numpy as np
import pytest
import scipy.linalg
from local_scene import run

LENGTH, EI, MASS, ALPHA, BETA = 2, 100, 1.5, 0.5, 1e-6
STEPS = 2048


def scene(elements, force, omega, *laws):
    return {"structure": {"type": "beam", "length": LENGTH, "elements": elements,
                          "supports": ["clamped", "free"], "EI": EI, "mass_per_length": MASS},
            "effects": [{"type": "rayleigh_damping", "alpha": ALPHA, "beta": BETA}, *laws],
            "excitation": [{"type": "harmonic", "dof": f"w{elements}", "cos": force, "k": 1}],
            "omega": omega}


def cubic(element, coefficient):
    return {"type": "cubic_spring", "dof": f"w{element}", "coefficient": coefficient}


def beam(elements):
    """M and K of Euler and Bernoulli's, its first node clamped."""
    h, n = LENGTH / elements, 2 * (elements + 1)
    M, K = np.zeros((n, n)), np.zeros((n, n))
    m = [[156, 22 * h, 54, -13 * h], [22 * h, 4 * h * h, 13 * h, -3 * h * h],
         [54, 13 * h, 156, -22 * h], [-13 * h, -3 * h * h, -22 * h, 4 * h * h]]
    k = [[12, 6 * h, -12, 6 * h], [6 * h, 4 * h * h, -6 * h, 2 * h * h], [-12, -6 * h, 12, -6 * h],
         [6 * h, 2 * h * h, -6 * h, 4 * h * h]]
    for i in range(0, n - 2, 2):
        M[i:i + 4, i:i + 4] += MASS * h / 420 * np.array(m)
        K[i:i + 4, i:i + 4] += EI / h**3 * np.array(k)
    return M[2:, 2:], K[2:, 2:]


def multipliers(of, answer):
    """All, by Magnus' series of the fourth order, the laws' slopes along the harmonics given."""
    square, V = scipy.linalg.eigh(*reversed(beam(of["structure"]["elements"])))
    n, omega, rows = len(square), of["omega"], {row["dof"]: row for row in answer["harmonics"]}
    orbits = []
    for law in of["effects"][1:]:
        row = rows[law["dof"]]
        orbits.append((law, V[2 * int(law["dof"][1:]) - 2],
                       np.array(row["re"]) + 1j * np.array(row["im"]), 1j * np.array(row["k"])))

    def matrix(theta):
        K, C = np.diag(square), np.diag(ALPHA + BETA * square)
        for law, shape, X, ik in orbits:
            wave = X * np.exp(ik * theta)
            d, v, outer = wave.real.sum(), (ik * omega * wave).real.sum(), np.outer(shape, shape)
            if law["type"] == "cubic_spring":
                K = K + 3 * law["coefficient"] * d * d * outer
            else:
                c = np.polynomial.Polynomial(law["coefficients"])
                K, C = K + c.deriv()(d) * v * outer, C + c(d) * outer
        return np.block([[np.zeros((n, n)), np.eye(n)], [-K, -C]])

    h, gauss, Y = 2 * np.pi / omega / STEPS, np.sqrt(3) / 6, np.eye(2 * n)
    for step in range(STEPS):
        a, b = (matrix(omega * h * (step + 0.5 + side * gauss)) for side in (-1, 1))
        Y = scipy.linalg.expm(h / 2 * (a + b) + np.sqrt(3) / 12 * h * h * (b @ a - a @ b)) @ Y
    return np.array(sorted(np.linalg.eigvals(Y), key=abs, reverse=True))


def check(of, answer, stable):
    """The verdict, and that each multiplier is one of the map, the largest the largest."""
    told, expected = answer["stability"], multipliers(of, answer)
    assert told["stable"] is stable and len(told["multipliers"]) >= 4
    assert abs(told["max_multiplier"] - abs(expected[0])) < 1e-8
    for re, im in told["multipliers"]:
        assert np.abs(expected - complex(re, im)).min() < 1e-8


@pytest.mark.parametrize("of", [
    scene(12, 1, 20, cubic(12, 1e5)),
    scene(12, 2, 20, cubic(12, 1e4), {"type": "polynomial_damper", "dof": "w5",
                                      "coefficients": [0.1, 0, 50]})],
                         ids=["a spring", "and a damper"])
def test_the_leading_multipliers_of_a_stiff_beam_with_smooth_laws_are_those_of_its_whole_map(
        tmp_path, of):
    check(of, run(tmp_path, "steady", of), True)


def test_the_middle_one_of_three_motions_of_a_stiff_beam_is_unstable(tmp_path):
    of = scene(12, 1, 9, cubic(12, 1e3))
    motions = run(tmp_path, "steady", of, "-o", "solutions=all")["solutions"]
    assert [motion["stability"]["stable"] for motion in motions] == [True, False, True]
    check(of, motions[1], False)


def test_an_undamped_stiff_beam_is_neither_stable_nor_unstable(tmp_path):
    of = scene(12, 1, 20, cubic(12, 1e5))
    of["effects"].pop(0)
    told = run(tmp_path, "steady", of)["stability"]
    assert told["stable"] is None and abs(told["max_multiplier"] - 1) < 1e-8


def test_a_finer_mesh_does_not_take_the_verdict_away(tmp_path):
    coarse, fine = (run(tmp_path, "steady", scene(n, 1, 20, cubic(n, 1e5)))["stability"]
                    for n in (12, 100))
    assert fine["stable"] is True
    # the first mode's frequency changes by less than (pi / 2 / 12)^4 / 720 of itself: the modulus
    # by far less
    assert abs(fine["max_multiplier"] - coarse["max_multiplier"]) < 1e-6
