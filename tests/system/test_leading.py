"""Leading multipliers of large and of stiff periodic scenes, beside whole maps by Taylor's series
in numpy and roots of a determinant."""

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
from local_scene import run

OMEGA = 1.3


def chain(dampers, alpha=0.0, pulsating=10):
    n = len(dampers) - 1
    effects = [{"type": "parametric_stiffness", "dof": f"x{1 + i * n // pulsating}",
                "stiffness": 0.2, "k": 1} for i in range(pulsating)]
    if alpha:
        effects.append({"type": "rayleigh_damping", "alpha": alpha, "beta": 0.0})
    return {"structure": {"type": "chain", "masses": [1] * n, "springs": [1] * (n + 1),
                          "dampers": dampers},
            "omega": OMEGA, "effects": effects}


def neighbours(k):
    k = np.array(k, dtype=float)
    return sp.diags([k[:-1] + k[1:], -k[1:-1], -k[1:-1]], [0, 1, -1]).tocsr()


def multipliers(scene, steps=6, terms=45):
    """All of a chain's of unit masses, descending: X'' = -C X' - (K + g cos) X, power by power of
    the time in a step, all columns at once; a step turns the fastest motion by 1.6 radians, and
    1.6^45 / 45! is 1e-47."""
    n, h = len(scene["structure"]["masses"]), 2 * np.pi / OMEGA / steps
    K, C, g = (neighbours(scene["structure"]["springs"]), neighbours(scene["structure"]["dampers"]),
               np.zeros((n, 1)))
    for effect in scene["effects"]:
        if effect["type"] == "rayleigh_damping":
            C = C + effect["alpha"] * sp.eye(n)
        else:
            g[int(effect["dof"][1:]) - 1] += effect["stiffness"]
    rows = np.flatnonzero(g)
    Y = np.eye(2 * n)
    for step in range(steps):
        power = np.concatenate([[1], np.cumprod(OMEGA * h / np.arange(1, terms))])
        cosine = power * np.cos(OMEGA * step * h + np.arange(terms) * np.pi / 2)
        X = [Y[:n], h * Y[n:]]
        for k in range(terms - 2):
            force = K @ X[k] + (k + 1) / h * (C @ X[k + 1])
            force[rows] += g[rows] * sum(cosine[i] * X[k - i][rows] for i in range(k + 1))
            X.append(-h * h / ((k + 2) * (k + 1)) * force)
        Y = np.vstack([sum(X), sum(k / h * X[k] for k in range(1, terms))])
    w = np.linalg.eigvals(Y)
    return w[np.argsort(-np.abs(w))]


# one damper leaves slow motions and the fastest alone: both have leading multipliers
@pytest.mark.parametrize("dampers, alpha, pulsating",
                         [([0.0] * 301, 0.0, 10), ([0.0] * 301, 0.05, 10),
                          ([0.5] + [0.0] * 300, 0.0, 1)],
                         ids=["nothing", "masses", "one_damper"])
def test_the_ten_leading_multipliers_of_300_dofs_are_those_of_the_whole_map_whatever_damps(
        tmp_path, dampers, alpha, pulsating):
    scene = chain(dampers, alpha, pulsating)
    answer = run(tmp_path, "floquet", scene)
    ours = np.array([complex(*m) for m in answer["multipliers"]])
    theirs = multipliers(scene)
    assert (10 <= len(ours) <= 11 and "diagnostics" not in answer and answer["plan"]["integrator"]
            == "hill")
    for i in range(10):
        assert np.abs(ours - theirs[i]).min() < 1e-9, (i, theirs[i])
    for m, bar in zip(ours, answer["errors"]):
        assert np.abs(theirs - m).min() < max(1e-9, bar)


def beam(n, beta, **more):
    return {"structure": {"type": "beam", "length": 1, "elements": n, "EI": 6570,
                          "mass_per_length": 3.24, "supports": ["clamped", "free"]},
            "omega": 300, "effects": ([{"type": "rayleigh_damping", "alpha": 0.0, "beta": beta}]
                                      if beta else [])
            + [{"type": "parametric_stiffness", "dof": f"w{n}", "stiffness": 5000, "k": 1}], **more}


def modes_of_beam(n):
    """Frequencies, and the tip's place in each mode of unit mass: Hermite's cubics, clamped at the
    left."""
    h, K, M = 1 / n, np.zeros((2 * n + 2,) * 2), np.zeros((2 * n + 2,) * 2)
    k = 6570 / h**3 * np.array([[12, 6 * h, -12, 6 * h], [6 * h, 4 * h * h, -6 * h, 2 * h * h],
                                [-12, -6 * h, 12, -6 * h], [6 * h, 2 * h * h, -6 * h, 4 * h * h]])
    m = 3.24 * h / 420 * np.array([[156, 22 * h, 54, -13 * h],
                                   [22 * h, 4 * h * h, 13 * h, -3 * h * h],
                                   [54, 13 * h, 156, -22 * h],
                                   [-13 * h, -3 * h * h, -22 * h, 4 * h * h]])
    for e in range(n):
        at = np.ix_(range(2 * e, 2 * e + 4), range(2 * e, 2 * e + 4))
        K[at] += k
        M[at] += m
    K, M = K[2:, 2:].astype(np.longdouble), M[2:, 2:].astype(np.longdouble)
    Phi = scipy.linalg.eigh(K.astype(float), M.astype(float))[1]
    # Rayleigh's: without the rounding of the stiffest
    w2 = np.einsum("ij,ij->j", Phi, K @ Phi) / np.einsum("ij,ij->j", Phi, M @ Phi)
    return np.sqrt(w2).astype(float), Phi[2 * n - 2]


def refined(exponent, w, phi, beta, harmonics=14):
    """The root next to EXPONENT of Hill's determinant, of the forces at the tip alone: a harmonic's
    force moves the tip by the sum of all modes' receptances, and gives forces of the harmonics
    beside it."""
    def determinant(z):
        s = z + 300j * np.arange(-harmonics, harmonics + 1)
        R = ((phi**2)[:, None] / (s**2 + beta * w[:, None]**2 * s + w[:, None]**2)).sum(axis=0)
        return np.linalg.det(np.eye(len(s)) + 2500 * (np.eye(len(s), k=1) + np.eye(len(s), k=-1))
                             * R[None, :])
    # Newton's, its slope by a difference that rounding leaves enough of
    for _ in range(12):
        step = 1e-5 * abs(exponent)
        slope = (determinant(exponent + step) - determinant(exponent - step)) / (2 * step)
        exponent -= determinant(exponent) / slope
    return exponent


def few_modes(w, phi, beta, steps=4000):
    """Exponents of the first modes, roughly: classical Runge-Kutta."""
    n, h = len(w), 2 * np.pi / 300 / steps
    Y = np.eye(2 * n)

    def slope(t, Y):
        return np.vstack([Y[n:], -(w**2)[:, None] * (Y[:n] + beta * Y[n:]) - 5000 * np.cos(300 * t)
                          * np.outer(phi, phi @ Y[:n])])
    for i in range(steps):
        k1 = slope(i * h, Y)
        k2 = slope((i + 0.5) * h, Y + h / 2 * k1)
        k3 = slope((i + 0.5) * h, Y + h / 2 * k2)
        Y = Y + h / 6 * (k1 + 2 * k2 + 2 * k3 + slope((i + 1) * h, Y + h * k3))
    return np.log(np.linalg.eigvals(Y).astype(complex)) * 300 / (2 * np.pi)


SIX = ["-o", "multipliers=6"]


@pytest.mark.parametrize("n, words, most", [(12, SIX, 1e-9), (40, SIX, 1e-9), (60, [], 1e-7)])
@pytest.mark.parametrize("ratio", [0.02, 0.001])
def test_the_multipliers_of_a_stiff_beam_are_roots_of_hills_determinant_of_its_tip(tmp_path, ratio,
                                                                                   n, words, most):
    beta = 2 * ratio / 158
    answer = run(tmp_path, "floquet", beam(n, beta), *words)
    ours = np.array([complex(*m) for m in answer["multipliers"] if m])      # null: vanished
    w, phi = modes_of_beam(n)
    theirs = np.exp(np.array([refined(z, w, phi, beta) for z in few_modes(w[:4], phi[:4], beta)
                              if z.real > -10]) * 2 * np.pi / 300)
    assert answer["stability"]["stable"] is False and answer["plan"]["integrator"] == "hill"
    assert "multipliers_unsettled" not in [d["code"] for d in answer.get("diagnostics", [])]
    assert len(theirs) >= 2
    for m in theirs:
        assert np.abs(ours - m).min() < most, m
    assert abs(np.abs(theirs).max() - answer["stability"]["max_multiplier"]) < most


def test_a_beam_that_nothing_damps_has_others_alike_and_says_so(tmp_path):
    answer = run(tmp_path, "floquet", beam(60, 0))
    assert "multipliers_alike" in [d["code"] for d in answer["diagnostics"]]
    sizes = np.abs([complex(*m) for m in answer["multipliers"]])
    assert (sizes[0] > 1.1 and np.all(np.abs(sizes[1:] - 1) <= answer["errors"][1:])
            and answer["stability"]["stable"] is False)
