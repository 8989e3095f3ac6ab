"""identify -o response=ambient with a period: systems of periodic stiffness under noise that nobody
measured, simulated exactly, against the bound of their lifted spectrum (both by
tests/bench/bench_ambient_periodic.py, in numpy).
"""
import json
import pathlib
import sys

import numpy as np
import pytest

from conftest import write_batch

scipy = pytest.importorskip("scipy")
pytest.importorskip("scipy.signal")
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "bench"))
import bench_ambient_periodic as bench

AMBIENT = ("-o", "response=ambient")


def mathieu(stiffness=0.35, hertz=0.37, zeta=0.02, noise=0.05, phases=bench.PHASES):
    """x'' + 2 zeta w x' + w^2 (1 + stiffness cos 2 pi t) x = white noise; x."""
    w = 2 * np.pi * hertz

    def A(t):
        return np.array([[0, 1], [-w ** 2 * (1 + stiffness * np.cos(2 * np.pi * t)),
                                  -2 * zeta * w]])

    return bench.Periodic(A, np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]]), noise, phases)


def identify(ctl, path, Y, *options, phases=bench.PHASES, period=1.0):
    return ctl("identify",
               write_batch(path, Y, dt=1 / phases, **({"period": period} if period else {})),
               *AMBIENT, *options)


def codes(document):
    return [d["code"] for d in document["diagnostics"]]


def nearest(modes, multiplier):
    return min(modes, key=lambda m: abs(complex(*m["multiplier"]) - multiplier))


def test_multipliers_are_at_the_bound_with_errors_that_cover(ctl, tmp_path):
    """Of 10 oscillators and 10 systems of two degrees of freedom, 500 to 3,000 periods: some 30
    modes, 60 components, of whose mean square over the bound the standard deviation is 0.18 and of
    what 1.96 standard errors cover 0.03."""
    rows = []
    for seed in range(500, 520):
        rng = np.random.default_rng(seed)
        system, periods = bench.random_periodic(rng, 1 + seed % 2, 1, 8)
        said = identify(ctl, tmp_path / "a.h5", system.samples(periods, rng), phases=8).document
        assert said["response"] == "ambient" and said["stability"]["stable"] is not False, seed
        rows += bench.compare(system, periods, said)
    rows = np.array(rows)
    assert len(rows) >= 28
    assert np.mean(rows[:, 1:3] ** 2) < 1.6 and np.mean(np.abs(rows[:, 3:5]) < 1.96) > 0.86
    assert 0.9 < np.mean(rows[:, 5:7]) < 1.25


@pytest.mark.parametrize("seed", [104, 141, 161])
def test_two_modes_that_overlap_are_found_at_the_higher_summit_of_the_likelihood(
        ctl, tmp_path, monkeypatch, seed):
    """Two pairs nearer each other than their widths, one channel: near a double pole lies a second
    summit, lower by some 10, with bars of 4 to 7 times the bound.  Of 70 draws these led there."""
    monkeypatch.setattr(bench, "root", lambda P: np.linalg.cholesky(
        P + 1e-15 * np.trace(P) * np.eye(len(P))))         # whose signs no library chooses
    system, periods = bench.random_periodic(np.random.default_rng(13), 2)
    said = identify(ctl, tmp_path / "a.h5",
                    system.samples(periods, np.random.default_rng(seed))).document
    rows = np.array(bench.compare(system, periods, said))
    assert len(rows) == 2 and np.all(rows[:, 5:7] < 1.6)
    assert np.all(np.abs(rows[:, 3:5]) < 4)


def test_mathieus_oscillator_is_found_where_it_moves(ctl, tmp_path):
    """Its multipliers are -0.6681 +- 0.6818i, by an integration of its own (the exponential of 192
    steps)."""
    s = mathieu()
    assert s.mu[0] == pytest.approx(-0.6681 + 0.6818j, abs=1e-3)
    mode, = identify(ctl, tmp_path / "a.h5", s.samples(2000, np.random.default_rng(1)), "-o",
                     "shapes=true").document["modes"]
    error = np.log(complex(*mode["multiplier"]) / s.mu[0])
    assert np.all(np.abs([error.real, error.imag]) < 3.5 * np.array(mode["std"]["exponent"]))
    assert mode["resolved_k"] == 0 and mode["frequency_hz"] == pytest.approx(0.374, abs=0.01)
    assert mode["amplitude"] == pytest.approx(1, abs=0.05) and mode["shape"] == [[1, 0]]
    assert mode["cycles"] == pytest.approx(mode["frequency_hz"] * 2000)


def test_frequencies_beyond_half_of_the_period_s_are_resolved(ctl, tmp_path):
    """1.23 and -1.23 Hz are 0.23 and -0.23 by multipliers alone; with little stiffness that varies
    the mode moves at 1.23."""
    s = mathieu(stiffness=0.05, hertz=1.23, zeta=0.01)
    mode, = identify(ctl, tmp_path / "a.h5",
                     s.samples(1500, np.random.default_rng(2))).document["modes"]
    assert mode["resolved_k"] == 1 and mode["frequency_hz"] == pytest.approx(1.23, abs=0.005)
    assert mode["damping_ratio"] == pytest.approx(0.01, abs=4 * mode["std"]["damping_ratio"])
    assert abs(mode["exponent"][1]) < np.pi


def test_what_turns_with_the_period_changes_nothing(ctl, tmp_path):
    Y = mathieu().samples(1000, np.random.default_rng(3))
    t = np.arange(len(Y))[:, None] / bench.PHASES
    turning = 5 + 20 * np.sin(2 * np.pi * t + 1) + 7 * np.cos(6 * np.pi * t)
    plain, other = (identify(ctl, tmp_path / "a.h5", y).document for y in (Y, Y + turning))
    assert codes(other) == codes(plain) and other["stability"]["stable"] is True
    a, b = plain["modes"][0], other["modes"][0]
    assert np.allclose(a["multiplier"], b["multiplier"], atol=1e-6)


def test_a_line_that_does_not_turn_with_the_period_is_told(ctl, tmp_path):
    Y = mathieu().samples(1000, np.random.default_rng(4))
    t = np.arange(len(Y))[:, None] / bench.PHASES
    said = identify(ctl, tmp_path / "a.h5",
                    Y + 3 * Y.std() * np.sin(2 * np.pi * 2.3137 * t)).document
    line, = [d["message"] for d in said["diagnostics"] if d["code"] == "narrow_line"]
    assert "2.3137 Hz" in line and len(said["modes"]) == 1


def test_an_orbit_alone_is_refused(ctl, tmp_path):
    t = np.arange(6000)[:, None] / bench.PHASES
    said = identify(ctl, tmp_path / "a.h5", np.sin(2 * np.pi * t) + 0.2)
    assert said.status == 2 and said.document["error"]["field"] == "signals"


def test_a_free_response_of_a_periodic_system_is_told(ctl, tmp_path):
    s = mathieu(zeta=0.005, noise=0.0)
    x, rows = np.array([1.0, 0.3]), []
    for _ in range(600):
        rows.append(s.O @ x)
        x = s.F @ x
    Y = np.concatenate(rows)[:, None]
    said = identify(ctl, tmp_path / "a.h5",
                    Y + 1e-3 * np.random.default_rng(5).standard_normal(Y.shape)).document
    assert "not_ambient" in codes(said) and said["stability"]["stable"] is None
    assert all(m["std"]["multiplier"] is None for m in said["modes"])


@pytest.mark.parametrize("options, field, words", [
    (["band=0,0.3"], "band", "one of them"),
    (["window=0,200"], "signals", "needs at least 256"),
    (["period=-1"], "period", "period"),
])
def test_what_cannot_be_asked_is_refused_with_what_can(ctl, tmp_path, options, field, words):
    Y = mathieu().samples(300, np.random.default_rng(6))
    said = identify(ctl, tmp_path / "a.h5", Y,
                    *(word for option in options for word in ("-o", option)))
    assert (said.status == 2 and said.document["error"]["field"] == field
            and words in said.document["error"]["message"])


def test_period_0_takes_it_for_constant_whatever_the_file_says(ctl, tmp_path):
    said = identify(ctl, tmp_path / "a.h5", mathieu().samples(300, np.random.default_rng(7)), "-o",
                    "period=0").document
    assert "resolved_k" not in said["modes"][0]


def test_a_simulated_rotor_under_noise_has_the_multipliers_that_floquet_has(ctl, tmp_path):
    """Two coordinates whose stiffness turns, 2,000 periods of 16 samples; floquet integrates the
    same scene without noise."""
    scene = {
        "structure": {"type": "matrices", "M": [[1, 0], [0, 1]], "K": [[1.3, -0.2], [-0.2, 6]],
                      "C": [[0.03, 0], [0, 0.06]],
                      "dofs": ["flap", "lag"]},
        "omega": 2, "effects": [{"type": "parametric_stiffness", "dof": "flap", "stiffness": 0.4},
                                {"type": "parametric_stiffness", "dof": "lag", "stiffness": 1.5}],
        "excitation": [{"dof": "flap", "type": "noise", "psd": 1, "seed": 1},
                       {"dof": "lag", "type": "noise", "psd": 1, "seed": 2}],
        "time": {"dt": np.pi / 16, "duration": 2005 * np.pi},
    }
    (tmp_path / "rotor.json").write_text(json.dumps(scene))
    truth = [complex(*m) for m in ctl("floquet", tmp_path / "rotor.json").document["multipliers"]]
    ctl("simulate", tmp_path / "rotor.json", "-O", tmp_path / "rotor.h5")
    said = ctl("identify", tmp_path / "rotor.h5", *AMBIENT).document
    assert len(said["modes"]) == 2 and said["stability"]["stable"] is True
    for true in (m for m in truth if m.imag > 0):
        mode = nearest(said["modes"], true)
        error = np.log(complex(*mode["multiplier"]) / true) / np.pi
        assert np.all(np.abs([error.real, error.imag]) < 3 * np.array(mode["std"]["exponent"]))
    assert said["stability"]["margin"] == pytest.approx(-np.log(max(map(abs, truth))) / np.pi,
                                                        abs=3 * said["stability"]["margin_std"])


def wandering(seed, periods=800, phases=bench.PHASES, fine=8, stiffness=0.35, hertz=0.37,
              zeta=0.02):
    """The oscillator of mathieu() whose cosine turns at a speed of 1 that wanders by 1 % within 5
    turns: x with 5 % of noise, the angle in turns, and the multiplier at the mean speed."""
    rng, w, h, n = (np.random.default_rng(seed), 2 * np.pi * hertz, 1 / (phases * fine),
                    periods * phases * fine)
    keep = np.exp(-h / 5)
    speed = 1 + scipy.signal.lfilter([0.01 * np.sqrt(1 - keep ** 2)], [1, -keep],
                                     rng.standard_normal(n))
    angle = np.cumsum(speed) * h - speed[0] * h

    def steps(angle, h):
        A = np.zeros((len(angle), 2, 2))
        A[:, 0, 1], A[:, 1, 1] = 1, -2 * zeta * w
        A[:, 1, 0] = -w ** 2 * (1 + stiffness * np.cos(2 * np.pi * angle))
        return (np.eye(2) + A * h + A @ A * h ** 2 / 2 + A @ A @ A * h ** 3 / 6 + A @ A @ A
                @ A * h ** 4 / 24)

    F, kick = steps(angle + h / 2, h), rng.standard_normal(n) * np.sqrt(h)
    x, Y = np.zeros(2), np.empty(n // fine)
    for k in range(n):
        if k % fine == 0:
            Y[k // fine] = x[0]
        x = F[k] @ x + [0, kick[k]]
    turn, M = (n - 1) * h / (angle[-1] - angle[0]), np.eye(2)
    for step in steps((np.arange(400) + 0.5) / 400, turn / 400):
        M = step @ M
    return (Y + 0.05 * Y.std() * rng.standard_normal(len(Y)), angle[::fine],
            max(np.linalg.eigvals(M), key=np.imag))


@pytest.mark.parametrize("unit, least", [(360, 0), (2 * np.pi, -0.5), (-1, 0)])
def test_an_azimuth_says_what_a_period_is_where_the_speed_wanders(ctl, tmp_path, unit, least):
    """In degrees, in radians about 0, and in turns that fall."""
    Y, angle, truth = wandering(8)
    azimuth = unit * (np.mod(angle - least, 1) + least)
    path = write_batch(tmp_path / "a.h5", np.column_stack([Y, azimuth]), dt=1 / bench.PHASES)
    said = ctl("identify", path, *AMBIENT, "-o", "azimuth=1").document
    mode, = said["modes"]
    assert "turns_lock" not in [d["code"] for d in said["diagnostics"]]
    span = -np.log(abs(complex(*mode["multiplier"]))) / -mode["exponent"][0]
    error = np.log(complex(*mode["multiplier"]) / truth) / span
    assert span == pytest.approx(1, abs=0.01) and mode["resolved_k"] == 0
    assert np.all(np.abs([error.real, error.imag]) < 4 * np.array(mode["std"]["exponent"]))
    assert ([s["name"] for s in said["reconstruction"]["signals"]] == ["ch0"]
            and said["provenance"]["options"]["azimuth"] == 1)


def test_where_a_wandering_speed_makes_multipliers_meet_those_alone_have_no_errors(ctl, tmp_path):
    """Turns 2 % longer hold half a cycle, where one locks to half the speed: they wander by 1 %.
    What the second one does has nothing to do with the angle."""
    Y, angle, _ = wandering(8, hertz=0.49, stiffness=0.05)
    pole, kick = -0.05 + 2j * np.pi * 0.3, np.random.default_rng(9).standard_normal((2, len(Y)))
    other = scipy.signal.lfilter([1], [1, -np.exp(pole / bench.PHASES)], kick[0])
    other = other.imag + 0.05 * other.imag.std() * kick[1]
    path = write_batch(tmp_path / "a.h5", np.column_stack([Y, other, np.mod(angle, 1)]),
                       dt=1 / bench.PHASES)
    said = ctl("identify", path, *AMBIENT, "-o", "azimuth=2").document
    turn = len(angle) / angle[-1] / bench.PHASES
    free, = [m for m in said["modes"] if None not in m["std"]["exponent"]]
    locked, = [m for m in said["modes"] if m is not free]
    assert ("turns_lock" in [d["code"] for d in said["diagnostics"]]
            and said["stability"]["stable"] is None and locked["std"]["exponent"] == [None, None]
            and abs(abs(np.angle(complex(*locked["multiplier"]))) - np.pi) < 0.2)
    error = np.log(complex(*free["multiplier"])) / turn - pole
    assert np.all(np.abs([error.real, error.imag]) < 4 * np.array(free["std"]["exponent"]))


def test_a_period_of_no_whole_number_of_samples_is_taken(ctl, tmp_path):
    """Every second one of 25 samples a period: 12.5."""
    s = mathieu(phases=25)
    Y = s.samples(1000, np.random.default_rng(9))[::2]
    mode, = identify(ctl, tmp_path / "a.h5", Y, phases=12.5).document["modes"]
    error = np.log(complex(*mode["multiplier"]) / s.mu[0])
    assert np.all(np.abs([error.real, error.imag]) < 3.5 * np.array(mode["std"]["exponent"]))


@pytest.mark.parametrize("options, field, words", [
    (["response=ambient", "azimuth=1", "period=1"], "azimuth", "one of the two"),
    (["response=ambient", "azimuth=0"], "azimuth", "begins anew each turn"),
    (["response=ambient", "azimuth=7"], "azimuth", "accepted: channels by name or index below 2"),
    (["response=ambient", "azimuth=[0,1]"], "azimuth", "accepted: one"),
    (["response=ambient", "azimuth=1", "signals=1"], "azimuth", "at least one beside it"),
    (["azimuth=1"], "azimuth", "accepted with response=ambient"),
    (["response=ambient", "azimuth=1", "band=0,2"], "band", "one of them"),
])
def test_an_azimuth_that_is_none_is_refused(ctl, tmp_path, options, field, words):
    Y = mathieu().samples(300, np.random.default_rng(10))
    Y = np.column_stack([Y, np.mod(np.arange(len(Y)) / bench.PHASES, 1) * 360])
    path = write_batch(tmp_path / "a.h5", Y, dt=1 / bench.PHASES)
    said = ctl("identify", path, *(word for option in options for word in ("-o", option)))
    assert (said.status == 2 and said.document["error"]["field"] == field
            and words in said.document["error"]["message"])
