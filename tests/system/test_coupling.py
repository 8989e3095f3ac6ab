"""polynomial_coupling beside sums of the same terms made here, by numpy, and beside what is known
of two modes at one to two."""

import h5py
import numpy as np
import pytest
from local_scene import call, harmonics, run


def diagonal(frequencies, damping, **more):
    n = len(frequencies)
    return {"structure": {"type": "matrices", "M": np.eye(n).tolist(),
                          "K": np.diag(np.square(frequencies)).tolist(),
                          "C": np.diag(2 * np.array(damping)).tolist()}, **more}


def potential(n, seed):
    """Quadratic and cubic terms of one quartic potential in n dofs, as a reduced model has them:
    (coefficient, {dof: power}, on)."""
    rng = np.random.default_rng(seed)
    terms = []
    for order, size in ((3, 0.3), (4, 1.0)):
        for _ in range(3 * n):
            powers = {}
            for dof in rng.integers(0, n, order):
                powers[int(dof)] = powers.get(int(dof), 0) + 1
            c = size * rng.standard_normal()
            terms += [(c * m, {j: p - (j == i) for j, p in powers.items() if p > (j == i)}, i)
                      for i, m in powers.items()]
    terms += [(2.0, {i: 3}, i) for i in range(n)]                        # bounded
    return terms


def effect(terms):
    return {"type": "polynomial_coupling",
            "terms": [{"coefficient": c, "powers": {f"x{j + 1}": p for j, p in powers.items()},
                       "on": f"x{on + 1}"}
                      for c, powers, on in terms]}


def force(terms, x):
    f = np.zeros_like(x)
    for c, powers, on in terms:
        f[on] += c * np.prod([x[j]**p for j, p in powers.items()], axis=0)
    return f


def model(n=8):
    w = 1 + 0.37 * np.arange(n)
    terms = potential(n, 4)
    return (w, terms, diagonal(w, [0.05] * n, omega=1.1, effects=[effect(terms)],
                               excitation=[{"dof": "x1", "k": 1, "cos": 0.12},
                                           {"dof": "x3", "k": 1, "sin": 0.1}]))


def test_a_reduced_model_of_eight_modes_balances_the_terms_summed_by_numpy(tmp_path):
    w, terms, scene = model()
    answer = run(tmp_path, "steady", scene, "-o", "harmonics=7")
    X, k, N = harmonics(answer), np.arange(8), 256
    F = (np.fft.rfft(force(terms,
                           (X @ np.exp(2j * np.pi * np.outer(k, np.arange(N)) / N)).real))[:, :8]
         * 2 / N)
    F[:, 0] /= 2
    residual = F + X * (w[:, None]**2 + 0.1j * 1.1 * k - (1.1 * k)**2)
    residual[0, 1] -= 0.12
    residual[2, 1] += 0.1j                                               # sin is -i of e^{i theta}
    assert answer["converged"] and np.abs(F).max() > 0.01
    assert np.abs(residual).max() < 1e-9 * np.abs(F).max()
    # with another derivative Newton's steps are many
    assert answer["plan"]["iterations"] <= 12


def test_its_motion_is_that_of_runge_kutta_in_numpy(tmp_path):
    w, terms, scene = model(4)
    scene = {**scene, "excitation": [], "initial": {"x": {"x1": 0.5, "x2": -0.3}},
             "time": {"dt": 0.1, "duration": 10}}
    run(tmp_path, "simulate", scene, "-O", tmp_path / "x.h5")
    with h5py.File(tmp_path / "x.h5") as file:
        record = file["signals"][:]
    n, h = len(w), 0.1 / 16

    def rate(y):
        return np.concatenate([y[n:], -w**2 * y[:n] - 0.1 * y[n:] - force(terms, y[:n])])
    y = np.zeros(2 * n)
    y[:2] = 0.5, -0.3
    want = [y[:n]]
    for _ in range(100):
        for _ in range(16):
            a = rate(y)
            b = rate(y + h / 2 * a)
            c = rate(y + h / 2 * b)
            y = y + h / 6 * (a + 2 * b + 2 * c + rate(y + h * c))
        want.append(y[:n])
    assert np.abs(record - want).max() < 1e-7 * np.abs(want).max()


def saturated(tmp_path, load):
    """u1'' + 0.002 u1' + u1 = u1 u2 and u2'' + 0.004 u2' + 4 u2 = u1^2 / 2 + load cos 2t, looked
    for with half of the load's frequency."""
    scene = diagonal([1.0, 2.0], [0.001, 0.002], omega=1.0,
                     excitation=[{"dof": "x2", "k": 2, "cos": load}],
                     effects=[effect([(-1.0, {0: 1, 1: 1}, 0), (-0.5, {0: 2}, 1)])],
                     steady={"start": {"x1": {"k": [1], "re": [0.02], "im": [0.02]},
                                       "x2": {"k": [2], "re": [0.0], "im": [-0.004]}}})
    answer = run(tmp_path, "steady", scene, "-o", "stability=true")
    assert answer["converged"] and answer["stability"]["stable"]
    return np.abs(harmonics(answer))


def test_a_mode_saturates_at_one_to_two_and_more_load_goes_to_the_other(tmp_path):
    """Multiple scales [Nayfeh and Mook, Nonlinear Oscillations, 6.5]: with everything tuned a2 = 4
    mu1 omega1 / alpha1 whatever the load.

    Of the load 2 omega2 mu2 a2 is what the directly driven mode takes itself; the rest feeds mode
    1: alpha2 a1^2 / 2 at right phases."""
    a2 = 4 * 0.001
    amplitude = {}
    for load in (0.0004, 0.0008):
        a = saturated(tmp_path, load)
        amplitude[load] = a[0, 1]
        assert a[1, 2] == pytest.approx(a2, rel=0.005)
        assert a[0, 1]**2 / 4 == pytest.approx(load - 2 * 2 * 0.002 * a2, rel=0.005)
        # the linear answer is far beyond
        assert load / (2 * 2 * 0.002) > 4 * a2
    assert amplitude[0.0008] > 1.3 * amplitude[0.0004]


def test_in_one_dof_it_is_the_polynomial_spring_stability_included(tmp_path):
    answers = []
    for e in ({"type": "polynomial_spring", "dof": "x1", "coefficients": [0.2, 0.1, 0.8]},
              effect([(0.2, {0: 1}, 0), (0.1, {0: 2}, 0), (0.8, {0: 3}, 0)])):
        scene = diagonal([1.0, 1.7], [0.03, 0.03], omega=1.4, effects=[e],
                         excitation=[{"dof": "x1", "k": 1, "cos": 0.5}])
        answers.append(run(tmp_path, "steady", scene, "-o", "stability=true", "-o", "harmonics=9"))
    a, b = answers
    assert np.abs(harmonics(a) - harmonics(b)).max() < 1e-11
    assert a["stability"]["max_multiplier"] == pytest.approx(b["stability"]["max_multiplier"],
                                                             rel=1e-9)


def test_a_term_of_the_first_degree_is_an_entry_of_the_stiffness(tmp_path):
    plain = diagonal([1.0, 2.0], [0.1, 0.1])
    entry = diagonal([1.0, 2.0], [0.1, 0.1])
    entry["structure"]["K"][0][1] = 0.7
    got = run(tmp_path, "floquet", {**plain, "effects": [effect([(0.7, {1: 1}, 0)])]})
    assert got["plan"]["effects"][0]["active"]
    assert sorted(got["exponents"]) == sorted(run(tmp_path, "floquet", entry)["exponents"])


TERM = {"coefficient": 1, "powers": {"x1": 2}, "on": "x1"}


@pytest.mark.parametrize("terms, field, says", [
    ([], "terms", "a list of 1 to 4096 objects"),
    ({"x1": 1}, "terms", "a list of 1 to 4096 objects"),
    ([3], "terms", "a list of 1 to 4096 objects"),
    ([TERM] * 4097, "terms", "at most 4096"),
    ([TERM, {**TERM, "powers": {"x1": 1.5}}], "terms[1].powers", "whole numbers from 1 to 64"),
    ([{**TERM, "powers": {"x1": -1}}], "terms[0].powers", "whole numbers from 1 to 64"),
    ([{**TERM, "powers": {"x1": 40, "x2": 25}}], "terms[0].powers", "degree 65"),
    ([{**TERM, "powers": {f"x{i}": 1 for i in range(2, 6)}}], "terms[0].powers", "in 5 dofs"),
    ([{**TERM, "powers": {"x9": 1}}], "terms[0].powers.x9", "no dof \"x9\""),
    ([{**TERM, "powers": {}}], "terms[0].powers", "an object of 1 to 64"),
    ([{**TERM, "on": "ground"}], "terms[0].on", "is the ground"),
    ([{**TERM, "off": 1}], "terms[0].off", "coefficient, on, powers"),
    ([{"coefficient": 1, "on": "x1"}], "terms[0].powers", "is missing"),
])
def test_what_is_no_term_is_refused_by_its_place(terms, field, says, tmp_path):
    scene = diagonal([1.0] * 6, [0.1] * 6, omega=1.0,
                     effects=[{"type": "polynomial_coupling", "terms": terms}])
    code, answer = call(tmp_path, "steady", scene)
    assert code == 2
    assert answer["error"]["field"] == f"effects[0].{field}"
    assert says in answer["error"]["message"]
