"""identify -o response=ambient: systems under noise that nobody measured, simulated exactly,
against the bound of the Whittle likelihood (both by tests/bench/bench_ambient.py, in numpy); what
it says of records that are none; what it refuses.
"""
# Tests as well: ambient_drift.c ambient_free.c ambient_steady.c ambient_tones.c response.c
import pathlib
import subprocess
import sys

import numpy as np
import pytest

import sanitized
from conftest import BUILD, decay, environment, write_batch

pytest.importorskip("scipy.signal")
import scipy.linalg
import scipy.signal
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "bench"))
import bench_ambient

DT = 0.02
AMBIENT = ("-o", "response=ambient")


def system(seed, hertz=(2.0, 2.06, 5.5), zeta=(0.012, 0.015, 0.02), channels=3, noise=0.05):
    rng, w, zeta = np.random.default_rng(seed), 2 * np.pi * np.array(hertz), np.array(zeta)
    drive = rng.standard_normal((len(w), len(w))) / 1j
    return bench_ambient.System(w * (-zeta + 1j * np.sqrt(1 - zeta ** 2)),
                                rng.standard_normal((channels, len(w))), drive, DT, noise)


def record(seed, samples=20000, **more):
    return system(seed, **more).samples(samples, np.random.default_rng(seed + 1000))


def identify(ctl, path, Y, *options):
    return ctl("identify", write_batch(path, Y, dt=DT), *AMBIENT, *options)


def codes(document):
    return [d["code"] for d in document["diagnostics"]]


def test_frequency_and_damping_are_at_the_bound_with_errors_that_cover_and_the_order_is_found(
        ctl, tmp_path):
    """Of 24 records with 6 values each the mean square over the bound has a standard deviation of
    0.12, what 1.96 standard errors cover one of 0.02.
    """
    rows = []
    for seed in range(24):
        s = system(seed)
        said = identify(ctl, tmp_path / "a.h5",
                        s.samples(20000, np.random.default_rng(seed + 1000))).document
        assert said["response"] == "ambient" and len(said["modes"]) == 3, seed
        assert said["stability"]["stable"] is not False
        rows += bench_ambient.compare(s, 20000, said)
    rows = np.array(rows)
    assert 0.6 < np.mean(rows[:, 1:3] ** 2) < 1.45 and np.mean(np.abs(rows[:, 3:5]) < 1.96) > 0.88
    assert 0.9 < np.mean(rows[:, 5:7]) < 1.2


@pytest.mark.parametrize("quantity", ["displacement", "velocity", "acceleration"])
@pytest.mark.parametrize("noise", [0, 0.001, 0.1])
def test_one_force_and_channels_without_noise_of_their_own_are_no_more_modes_than_there_are(
        ctl, tmp_path, quantity, noise):
    """Two masses, a white force held over each sample on the first of them: its acceleration has
    the force itself in it.  A damping's error over its own std is 1, of 12 numbers; spectra of one
    force are singular, and what the record's ends add is not.
    """
    K, hertz, errors = np.array([[3000., -1000], [-1000, 1000]]), [], []
    w2, V = np.linalg.eigh(K)
    C = V @ np.diag(0.02 * np.sqrt(w2)) @ V.T
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-K, -C]])
    both = scipy.linalg.expm(np.c_[np.r_[A, np.zeros((1, 4))], [0, 0, 1, 0, 0]] * 0.01)
    row = {"displacement": np.eye(4)[:2], "velocity": np.eye(4)[2:],
           "acceleration": A[2:]}[quantity]
    direct = np.array([[quantity == "acceleration"], [0]])
    for seed in range(3):
        rng = np.random.default_rng(seed)
        _, Y, _ = scipy.signal.dlsim((both[:4, :4], both[:4, 4:], row, direct, 0.01),
                                     rng.standard_normal(21000))
        Y = Y[1000:] + noise * Y.std(0) * rng.standard_normal((20000, 2))
        said = ctl("identify", write_batch(tmp_path / "a.h5", Y, dt=0.01), *AMBIENT).document
        hertz.append([m["frequency_hz"] for m in said["modes"]])
        errors += [(m["damping_ratio"] - 0.01) / m["std"]["damping_ratio"] for m in said["modes"]]
    assert [len(h) for h in hertz] == [2, 2, 2], hertz
    assert np.allclose(np.sort(hertz), np.sqrt(w2) / (2 * np.pi), rtol=0.01)
    assert np.mean(np.square(errors)) < 3


def test_amplitudes_are_the_rms_of_each_part_and_shapes_its_own(ctl, tmp_path):
    """A mode alone: all of the motion but 1 % is its own, and of that the rms over channels of unit
    rms is 1."""
    s = system(5, hertz=(3.0,), zeta=(0.02,), noise=0.01)
    mode, = identify(ctl, tmp_path / "a.h5", s.samples(20000, np.random.default_rng(6)), "-o",
                     "shapes=true").document["modes"]
    shape = np.array(mode["shape"]) @ [1, 1j]
    assert mode["amplitude"] == pytest.approx(1, abs=0.02)
    assert mode["cycles"] == pytest.approx(mode["frequency_hz"] * 20000 * DT)
    assert np.allclose(shape / shape[0], s.Phi[:, 0] / s.Phi[0, 0], rtol=0.02)
    for key in ("frequency_hz", "damping_ratio"):
        assert mode["bound_at_2x"][key] == pytest.approx(mode["std"][key] / np.sqrt(2))


@pytest.mark.parametrize("factor", [1e-8, 1e8, (1e-8, 1, 1e8)])
def test_units_change_nothing(ctl, tmp_path, factor):
    Y = record(7)
    plain, other = (identify(ctl, tmp_path / "a.h5", y).document["modes"] for y in (Y, Y * factor))
    assert len(plain) == len(other) == 3
    for a in plain:
        b = min(other, key=lambda m: abs(m["frequency_hz"] - a["frequency_hz"]))
        assert abs(a["frequency_hz"] - b["frequency_hz"]) < a["std"]["frequency_hz"]
        assert abs(a["damping_ratio"] - b["damping_ratio"]) < a["std"]["damping_ratio"]


def test_channels_that_say_nothing_new_change_nothing(ctl, tmp_path):
    Y = record(8)
    plain = [m["frequency_hz"] for m in identify(ctl, tmp_path / "a.h5", Y).document["modes"]]
    more = np.column_stack([Y, Y[:, 0], Y[:, 1] + Y[:, 2], np.full(len(Y), 5.0)])
    said = identify(ctl, tmp_path / "a.h5", more).document
    assert np.allclose(sorted(plain), sorted(m["frequency_hz"] for m in said["modes"]), rtol=1e-3)
    assert [(d["code"], d["channel"]) for d in said["diagnostics"] if d["channel"]
            is not None] == [("zero_channel", 5)]


def test_a_band_leaves_the_others_out(ctl, tmp_path):
    Y = record(9, hertz=(1.0, 4.0, 9.0))
    mode, = identify(ctl, tmp_path / "a.h5", Y, "-o", "band=2.5,6.5").document["modes"]
    assert abs(mode["frequency_hz"] - 4.0) < 4 * mode["std"]["frequency_hz"]
    assert abs(mode["damping_ratio"] - 0.015) < 4 * mode["std"]["damping_ratio"]


def test_white_noise_has_no_modes(ctl, tmp_path):
    for channels in (1, 4, 12):
        said = identify(ctl, tmp_path / "a.h5",
                        np.random.default_rng(channels).standard_normal((8000, channels))).document
        assert (said["modes"] == [] and said["stability"]["stable"] is None and codes(said)
                == ["no_modes"])


def test_coloured_excitation_is_said_and_is_no_mode(ctl, tmp_path):
    """Beside the modes a motion that never swings, as turbulence has it: three exponents of -2
    rad/s."""
    rng, Y = np.random.default_rng(11), record(10, hertz=(2.0, 5.5), zeta=(0.015, 0.02))
    slow = np.zeros_like(Y)
    for k in range(1, len(Y)):
        slow[k] = slow[k - 1] * np.exp(-2 * DT) + rng.standard_normal(Y.shape[1])
    said = identify(ctl, tmp_path / "a.h5", Y + slow / slow.std(0) * Y.std(0)).document
    assert "coloured_excitation" in codes(said)
    hertz = sorted(m["frequency_hz"] for m in said["modes"])
    assert len(hertz) == 2 and np.allclose(hertz, [2.0, 5.5], rtol=0.01)


def test_the_edge_of_a_high_pass_filter_is_no_mode(ctl, tmp_path):
    """A coupling of the fourth order at 0.5 Hz leaves a gap in the spectrum of each channel."""
    for seed in range(2):
        Y = scipy.signal.sosfilt(scipy.signal.butter(4, 0.5, "high", fs=50, output="sos"),
                                 record(seed, channels=2), axis=0)
        said = identify(ctl, tmp_path / "a.h5", Y).document
        assert all(m["amplitude"] > 0 for m in said["modes"]), seed
        hertz = sorted(m["frequency_hz"] for m in said["modes"])
        assert len(hertz) == 3 and np.allclose(hertz, [2, 2.06, 5.5], rtol=0.01), (seed, hertz)


@pytest.mark.parametrize("how", ["stays", "weaker"])
def test_a_channel_that_fails_within_the_record_is_named(ctl, tmp_path, how):
    """All signals together are as steady as chance has it."""
    Y = record(3, hertz=(2.0, 3.1, 5.5), channels=5)
    Y[8000:, 2] = 0.01 if how == "stays" else Y[8000:, 2] / 10
    said = identify(ctl, tmp_path / "a.h5", Y).document
    which = [d for d in said["diagnostics"] if d["code"] == "not_stationary"]
    assert len(which) == 1 and "channel 2" in which[0]["message"], codes(said)
    assert "not_stationary" not in codes(identify(ctl, tmp_path / "b.h5", record(3, channels=5))
                                         .document)


def test_lines_of_constant_amplitude_are_told_from_modes_and_do_not_disturb_them(ctl, tmp_path):
    Y, t = record(14), np.arange(20000)[:, None] * DT
    plain = identify(ctl, tmp_path / "a.h5", Y).document
    lines = 3 * np.sin(2 * np.pi * 3.3137 * t
                       + 0.3) * [1, -0.5, 0.8] + 2 * np.sin(4 * np.pi * 3.3137 * t) * [0.2, 1, 0.4]
    said = identify(ctl, tmp_path / "a.h5", Y + lines).document
    assert codes(said).count("narrow_line") == 2 and "not_ambient" not in codes(said)
    assert said["stability"]["stable"] is None
    assert len(said["modes"]) == len(plain["modes"]) == 3
    for a in plain["modes"]:
        b = min(said["modes"], key=lambda m: abs(complex(*m["exponent"]) - complex(*a["exponent"])))
        assert abs(a["frequency_hz"] - b["frequency_hz"]) < 0.2 * a["std"]["frequency_hz"]
        assert abs(a["damping_ratio"] - b["damping_ratio"]) < 0.2 * a["std"]["damping_ratio"]


@pytest.mark.parametrize("beside, size", [(0.3, 1.5), (-1.1, 1.5), (0.6, 5)])
def test_a_line_within_a_modes_peak_is_told_and_does_not_bend_its_damping(ctl, tmp_path, beside,
                                                                          size):
    """In the mode's own shape, so many of its decay rates beside it: as a part of the mode it made
    that of a third of its damping, by six of its standard errors, and the verdict stable."""
    s = system(6, hertz=(1.815, 5.5, 6.8), zeta=(0.0074, 0.015, 0.009), channels=6)
    Y, lam = s.samples(20000, np.random.default_rng(7)), s.lam[0]
    hertz = (lam.imag - beside * lam.real) / (2 * np.pi)
    Y += np.outer(size * Y.std() * np.cos(2 * np.pi * hertz * np.arange(20000) * DT),
                  s.Phi[:, 0] / np.abs(s.Phi[:, 0]).max())
    said = identify(ctl, tmp_path / "a.h5", Y).document
    lines = [d["message"] for d in said["diagnostics"] if d["code"] == "narrow_line"]
    assert [float(line.split()[3]) for line in lines] == [pytest.approx(hertz, abs=5e-4)]
    assert len(said["modes"]) == 3 and said["stability"]["stable"] is None
    assert np.abs(np.array(bench_ambient.compare(s, 20000, said))[:, 3:5]).max() < 3.5


@pytest.mark.parametrize("seed", [2, 6, 29])
def test_a_mode_as_narrow_as_a_line_of_the_record_is_no_line_of_constant_amplitude(ctl, tmp_path,
                                                                                   seed):
    """A third of one line wide: what the record's ends add to its peak has a sinusoid's course."""
    s = system(seed, hertz=(3.08, 14.9), zeta=(0.0005, 0.0015))
    said = identify(ctl, tmp_path / "a.h5", s.samples(10000, np.random.default_rng(seed))).document
    assert not any("constant amplitude" in d["message"] for d in said["diagnostics"])
    assert len(said["modes"]) == 2


def test_harmonics_of_a_rotor_however_strong_leave_no_mode_behind(ctl, tmp_path):
    """Seven, of 0.1 to 2 times the motion, some among the modes and some in directions in which
    there is no noise but the sensors': there frequencies are known best."""
    s = system(4, hertz=(4.76, 5.14), zeta=(0.0177, 0.0075), channels=4)
    rng, t = np.random.default_rng(5), np.arange(20000) * DT
    Y = s.samples(20000, rng)
    size = Y.std()
    for h in range(1, 8):
        Y += size * 2 / h ** 1.5 * np.outer(np.cos(2 * np.pi * 1.31321 * h * t + h),
                                            rng.standard_normal(4))
    said = identify(ctl, tmp_path / "a.h5", Y).document
    assert codes(said).count("narrow_line") == 7 and len(said["modes"]) == 2
    assert np.abs(np.array(bench_ambient.compare(s, 20000, said))[:, 3:5]).max() < 3.5


def test_the_mains_are_told_and_the_verdict_stands(ctl, tmp_path):
    s = bench_ambient.System(np.array([-0.8 + 30j, -1.2 + 90j]), np.array([[1, 0.5], [0.4, -1.0]]),
                             np.eye(2) * 1.0, 1 / 130, 0.03)
    Y = (s.samples(30000, np.random.default_rng(3))
         + 2 * np.sin(2 * np.pi * 50 / 130 * np.arange(30000))[:, None])
    said = ctl("identify", write_batch(tmp_path / "a.h5", Y, dt=1 / 130), *AMBIENT).document
    assert ("mains_line" in codes(said) and said["stability"]["stable"] is True
            and len(said["modes"]) == 2)


def test_mains_too_weak_to_be_taken_off_first_are_no_mode(ctl, tmp_path):
    """3 % and 1 % of the rms, at a phase at which a narrow pair draws them."""
    s = bench_ambient.System(np.array([-0.8 + 30j, -1.2 + 90j]), np.array([[1, 0.5], [0.4, -1.0]]),
                             np.eye(2) * 1.0, 1 / 130, 0.03)
    for share in (0.03, 0.01):
        Y = s.samples(30000, np.random.default_rng(4))
        Y += share * Y.std() * np.sin(2 * np.pi * 50 / 130 * np.arange(30000))[:, None]
        said = ctl("identify", write_batch(tmp_path / "a.h5", Y, dt=1 / 130), *AMBIENT).document
        assert (codes(said) == ["mains_line"] and said["stability"]["stable"] is True
                and len(said["modes"]) == 2)


def test_a_record_of_nothing_but_a_line_is_refused(ctl, tmp_path):
    said = identify(ctl, tmp_path / "a.h5", np.sin(0.3 * np.arange(4000))[:, None] * [1, 2])
    assert said.status == 2 and said.document["error"]["field"] == "signals"
    assert "lines of constant amplitude" in said.document["error"]["message"]


def test_a_free_decay_is_told_from_an_ambient_record(ctl, tmp_path):
    said = ctl("identify", write_batch(tmp_path / "a.h5", decay(2000, modes=((2.3, 0.02, 1.0),))),
               *AMBIENT).document
    assert "not_ambient" in codes(said) and said["stability"]["stable"] is None
    assert all(m["std"]["frequency_hz"] is None for m in said["modes"])


@pytest.mark.parametrize("channels, modes", [
    (1, ((2.3, 1e-4),)), (3, ((2.3, 1e-4), (5.1, 1e-4), (9.7, 1e-4))), (1, ((2.3, 1e-3),)),
    (3, ((2.3, 3e-3), (5.1, 3e-3), (9.7, 3e-3))),
    (1, ((2.3, -3e-3),)), (2, ((2.3, -3e-4),)), (6, ((2.3, -1e-3), (6.0, 1e-3), (8.0, 4e-3))),
])
def test_slow_decays_and_growth_are_told_from_an_ambient_record(ctl, tmp_path, channels, modes):
    """What is left of lines, and modes no wider than the record, is where only free responses are:
    1 / 1000 is noise."""
    rng, t, Y = np.random.default_rng(5), np.arange(5000) * 0.01, np.zeros((5000, channels))
    for hertz, zeta in modes:
        w = 2 * np.pi * hertz
        Y += (np.exp(-zeta * w * t)[:, None] * np.cos(w * t[:, None] + rng.uniform(0, 6, channels))
              * rng.uniform(0.5, 2, channels))
    Y += 1e-3 * np.abs(Y).max() * rng.standard_normal(Y.shape)
    said = ctl("identify", write_batch(tmp_path / "a.h5", Y, dt=0.01), *AMBIENT).document
    assert "not_ambient" in codes(said) and said["stability"]["stable"] is None
    assert all(m["std"]["damping_ratio"] is None for m in said["modes"])


def decays(rng, most, close):
    """Up to so many modes in up to so many channels, 0.1 to 10 % noise."""
    p, channels = rng.integers(1, most), rng.integers(1, most)
    f = np.sort(rng.uniform(1, 8, p))
    zeta = np.exp(rng.uniform(np.log(0.002), np.log(0.05), p))
    if close and p > 1:
        j = rng.integers(1, p)
        f[j] = f[j - 1] * rng.choice([1.01, 1.02, 1.05])
        f = np.sort(f)
    w = 2 * np.pi * f
    rate = f.max() * rng.uniform(2.5, 8)
    t = np.arange(int(rng.uniform(2, 12) / (zeta * w).min() * rate)) / rate
    shapes = rng.standard_normal((p, channels)) + 1j * rng.standard_normal((p, channels))
    Y = (np.exp(np.outer(t, -zeta * w + 1j * w * np.sqrt(1 - zeta ** 2))) @ shapes).real
    wide, noise = rng.uniform(-3, -1, 3)[2], rng.uniform(-5, -1)
    noise = 10 ** (noise if close else wide)
    return Y + noise * Y.std() * rng.standard_normal(Y.shape), 1 / rate


@pytest.mark.parametrize("seed, most, close", [(81022, 9, False), (81359, 6, True)])
def test_decays_of_which_spectra_show_one_mode_less_are_told_from_an_ambient_record(
        ctl, tmp_path, seed, most, close):
    """Six of which five show, and a close pair, at whose noise a pencil puts a pole."""
    Y, dt = decays(np.random.default_rng(seed), most, close)
    said = ctl("identify", write_batch(tmp_path / "a.h5", Y, dt=dt), *AMBIENT).document
    assert "not_ambient" in codes(said) and said["stability"]["stable"] is None
    assert all(m["std"]["damping_ratio"] is None for m in said["modes"])


@pytest.mark.parametrize("seed", [0, 1])
def test_a_dozen_decays_in_a_short_record_are_told_from_an_ambient_record(ctl, tmp_path, seed):
    """Without four of them they are no likelier than noise, and some are narrow as lines."""
    rng, t = np.random.default_rng(seed), np.arange(600) * 0.05
    w, zeta = 2 * np.pi * np.linspace(1, 8, 12), np.exp(rng.uniform(*np.log([0.002, 0.03]), 12))
    Y = (np.exp(np.outer(t, -zeta * w + 1j * w))
         @ (rng.standard_normal((12, 4)) + 1j * rng.standard_normal((12, 4)))).real
    Y += 0.03 * Y.std(0) * rng.standard_normal(Y.shape)
    said = ctl("identify", write_batch(tmp_path / "a.h5", Y, dt=0.05), *AMBIENT).document
    assert "not_ambient" in codes(said) and said["stability"]["stable"] is None
    assert all(m["std"]["damping_ratio"] is None for m in said["modes"])


@pytest.mark.parametrize("seed", [3])
def test_lines_whose_amplitudes_swing_are_told_for_lines_and_nothing_of_them_has_errors(
        ctl, tmp_path, seed):
    """Seven, each at its own pace: three sinusoids each, some nearer than two lines of the record.
    They are no modes, which fit ever better."""
    rng, t = np.random.default_rng(seed), np.arange(2000) * 0.02
    hertz = np.sort(rng.uniform(1, 20, 7))
    Y = sum(np.outer((1 + 0.3 * np.cos(0.3 * t * (i + 1))) * np.cos(2 * np.pi * f * t),
                     rng.normal(size=4)) for i, f in enumerate(hertz))
    said = ctl("identify", write_batch(tmp_path / "a.h5", Y + 1e-3 * rng.normal(size=Y.shape),
                                       dt=0.02), *AMBIENT).document
    assert codes(said).count("narrow_line") >= 15 and said["stability"]["stable"] is None
    assert all(m["std"]["damping_ratio"] is None for m in said["modes"])


@pytest.mark.parametrize("turns, noise", [(100, 0.01), (400, 0.01), (1600, 0.01), (100, 0.03),
                                          (400, 0.03)])
def test_a_decay_that_is_over_early_is_told_from_an_ambient_record(ctl, tmp_path, turns, noise):
    """Beside what it leaves of the record, the noise of 60,000 samples, its energy is little."""
    rng, t = np.random.default_rng(turns), np.arange(60000) * turns / 60000
    Y = sum((np.exp(-0.02 * 2 * np.pi * f * t) * np.cos(2 * np.pi * f * t))[:, None]
            * rng.uniform(0.5, 2, 3) for f in (1.0, 2.7))
    Y += noise * np.abs(Y).max(0) * rng.standard_normal(Y.shape)
    said = ctl("identify", write_batch(tmp_path / "a.h5", Y, dt=t[1]), *AMBIENT).document
    assert "not_ambient" in codes(said) and said["stability"]["stable"] is None


def test_a_decay_in_one_direction_of_three_is_told_from_an_ambient_record(ctl, tmp_path):
    """One mode of 1.9 Hz over 29 decay times, 6 % noise in three channels: of their orthogonal
    signals one is nothing but noise, and as large as the others where each has unit variance."""
    rng = np.random.default_rng(87149)
    rng.integers(1, 6, 2)
    hertz, zeta = rng.uniform(1, 8), np.exp(rng.uniform(*np.log([0.002, 0.05])))
    w, dt = 2 * np.pi * hertz, 1 / (hertz * rng.uniform(2.5, 8))
    rng.uniform(2, 12)
    lam = -zeta * w + 1j * w * np.sqrt(1 - zeta ** 2)
    shape = rng.standard_normal((1, 3)) + 1j * rng.standard_normal((1, 3))
    Y = (np.exp(lam * np.arange(600) * dt)[:, None] @ shape).real
    noise = 10 ** rng.uniform(-3, -1, 2)[1]
    rng.uniform(size=2)
    Y += noise * Y.std() * rng.standard_normal(Y.shape)
    said = ctl("identify", write_batch(tmp_path / "a.h5", Y, dt=dt), *AMBIENT).document
    assert "not_ambient" in codes(said) and said["stability"]["stable"] is None
    assert all(m["std"]["damping_ratio"] is None for m in said["modes"])


@pytest.mark.parametrize("seed", [2, 5])
def test_what_noise_drives_for_two_decay_times_is_not_taken_for_free(ctl, tmp_path, seed):
    """As many decaying motions as modes leave a third of it."""
    rng = np.random.default_rng(seed)
    p = rng.integers(3, 7)
    w, zeta = 2 * np.pi * np.sort(rng.uniform(1, 8, p)), rng.uniform(0.003, 0.03, p)
    s = bench_ambient.System(w * (-zeta + 1j * np.sqrt(1 - zeta ** 2)), rng.standard_normal((2, p)),
                             rng.standard_normal((p, p)) / 1j, 0.025, 1e-3)
    Y = s.samples(int(1.3 / (zeta * w).min() / 0.025) + 300, rng)
    said = ctl("identify", write_batch(tmp_path / "a.h5", Y, dt=s.dt), *AMBIENT).document
    assert "not_ambient" not in codes(said)
    assert any(m["std"]["frequency_hz"] is not None for m in said["modes"])


def test_a_gust_of_ten_times_the_energy_is_no_free_decay(ctl, tmp_path):
    for seed in range(8):
        Y = record(seed)
        first = 2500 * (seed % 7)
        Y[first:first + 5000 - 400 * seed] *= np.sqrt(10)
        found = codes(identify(ctl, tmp_path / "a.h5", Y).document)
        assert "not_ambient" not in found and "not_stationary" in found, seed


def test_short_ambient_records_are_not_taken_for_free(ctl, tmp_path):
    for seed in range(6):
        said = identify(ctl, tmp_path / "a.h5", record(seed, 1500, channels=1 + seed % 3)).document
        assert "not_ambient" not in codes(said), seed


def test_a_dead_channel_does_not_make_a_decay_in_coloured_noise_a_driven_response(ctl, tmp_path):
    rng, t = np.random.default_rng(5), np.arange(2000) * 0.01
    noise = scipy.signal.lfilter([1], [1, -0.9], rng.standard_normal((2000, 3)), axis=0)
    Y = 0.01 * noise
    for hertz, zeta in ((3.0, 0.01), (7.1, 0.008)):
        Y += np.real(np.outer(np.exp((1j - zeta) * 2 * np.pi * hertz * t),
                              rng.uniform(0.5, 1, 3) * np.exp(1j * rng.uniform(0, 6, 3))))
    Y[:, 2] = 0
    said = ctl("identify", write_batch(tmp_path / "a.h5", Y, dt=0.01)).document
    assert {"zero_channel", "coloured_residual"} <= set(codes(said))
    assert "not_free_decay" not in codes(said)


def test_an_ambient_record_taken_for_free_is_flagged_and_says_what_to_give(ctl, tmp_path):
    said = ctl("identify", write_batch(tmp_path / "a.h5", record(0, 3000), dt=DT)).document
    advice, = [d["message"] for d in said["diagnostics"] if d["code"] == "not_free_decay"]
    assert "response=ambient" in advice and said["stability"]["stable"] is None
    assert all(m["std"]["damping_ratio"] is None for m in said["modes"])


# Started from a small process: what runs a program counts among its memory.
PEAK = ("import resource, subprocess, sys; subprocess.run(sys.argv[1:], check=True, stdout=-3); "
        "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)")


@pytest.mark.skipif(sanitized.SANITIZED, reason="the sanitizers' own memory is counted, too")
def test_an_ambient_record_taken_for_free_takes_little_more_memory_than_a_short_one(tmp_path):
    """Searched as if it had modes without end it takes ten times as much."""
    peak = []
    for samples in 1000, 8000:
        path = write_batch(tmp_path / "a.h5", record(0, samples, noise=0.01), dt=DT)
        said = subprocess.run([sys.executable, "-c", PEAK, BUILD / "bin" / "modalctl", "--local",
                               "identify", path], env=environment(), check=True,
                              stdout=subprocess.PIPE)
        peak.append(int(said.stdout))
    assert peak[1] < 3 * peak[0], peak


@pytest.mark.parametrize("seed, samples, hertz, zeta, channels", [
    (1, 2000, (2.0, 5.5), (0.005, 0.01), 1),
    (2, 1500, (2.0, 5.5, 6.5), (0.003, 0.004, 0.02), 2),
    (4, 2500, (2.0, 2.06, 5.5), (0.003, 0.004, 0.004), 3),
])
def test_a_short_ambient_record_that_many_modes_can_draw_is_not_taken_for_free(
        ctl, tmp_path, seed, samples, hertz, zeta, channels):
    """They leave 20 to 26 % of it; its energy rises and falls, as no free response's does."""
    Y = record(seed, samples, hertz=hertz, zeta=zeta, channels=channels)
    said = ctl("identify", write_batch(tmp_path / "a.h5", Y, dt=DT)).document
    advice, = [d["message"] for d in said["diagnostics"] if d["code"] == "not_free_decay"]
    assert "response=ambient" in advice and said["stability"]["stable"] is None
    assert said["modes"] and all(m["std"]["damping_ratio"] is None for m in said["modes"])


def test_a_crowd_about_one_frequency_that_draws_a_driven_mode_is_not_taken_for_free(ctl, tmp_path):
    """One mode of 1.17 Hz, damping 0.0035, over seven decay times: five modes within 2 % draw it,
    and its energy neither rises nor falls as plainly as noise's does elsewhere."""
    rng = np.random.default_rng(71060)
    w, zeta = 2 * np.pi * rng.uniform(1, 8, 1), np.exp(rng.uniform(*np.log([0.002, 0.05]), 1))
    s = bench_ambient.System(w * (-zeta + 1j * np.sqrt(1 - zeta ** 2)), rng.standard_normal((1, 1)),
                             rng.standard_normal((1, 2)) / 1j,
                             2 * np.pi / (w[0] * rng.uniform(2.5, 8)), 10 ** rng.uniform(-2, -1))
    said = ctl("identify", write_batch(tmp_path / "a.h5", s.samples(2000, rng), dt=s.dt)).document
    advice, = [d["message"] for d in said["diagnostics"] if d["code"] == "not_free_decay"]
    assert "response=ambient" in advice and said["stability"]["stable"] is None
    assert said["modes"] and all(m["std"]["damping_ratio"] is None for m in said["modes"])


def unseen(seed, modes, channels, samples, cycles):
    """The answer of modes of 1 to 8 Hz, damping 0.2 to 5 %, over so few cycles of the slowest."""
    rng = np.random.default_rng(seed)
    w = 2 * np.pi * np.sort(rng.uniform(1, 8, modes))
    zeta = np.exp(rng.uniform(*np.log([0.002, 0.05]), modes))
    dt = cycles * 2 * np.pi / w[0] / samples
    s = bench_ambient.System(w * (-zeta + 1j * np.sqrt(1 - zeta ** 2)),
                             rng.standard_normal((channels, modes)),
                             rng.standard_normal((modes, max(modes, 2))) / 1j, dt, 0.01)
    return s.samples(samples, rng), dt


def test_eleven_modes_that_draw_a_driven_one_are_not_taken_for_free(ctl, tmp_path):
    """One mode of 7.27 Hz, damping 0.0023, over two decay times, noise 1 %: it was unstable.  Noise
    through a filter of three coefficients is likelier."""
    rng = np.random.default_rng(80139)
    rng.integers(1, 7), rng.integers(1, 4)
    w, zeta = 2 * np.pi * rng.uniform(1, 8, 1), np.exp(rng.uniform(*np.log([0.002, 0.05]), 1))
    rng.uniform(), rng.uniform(), rng.uniform()
    dt = 2 * np.pi / (w[0] * rng.uniform(2.5, 8))
    samples = int(rng.choice([40, 100, 300]) / w[0] * 2 * np.pi / dt)
    noise = rng.choice([0, 1e-4, 0.01, 0.1])
    s = bench_ambient.System(w * (-zeta + 1j * np.sqrt(1 - zeta ** 2)), rng.standard_normal((1, 1)),
                             rng.standard_normal((1, 2)) / 1j, dt, noise)
    said = ctl("identify", write_batch(tmp_path / "a.h5", s.samples(samples, rng), dt=dt)).document
    advice, = [d["message"] for d in said["diagnostics"] if d["code"] == "not_free_decay"]
    assert "response=ambient" in advice and said["stability"]["stable"] is None
    assert all(m["std"]["damping_ratio"] is None for m in said["modes"])


@pytest.mark.parametrize("seed, modes, channels, samples, cycles",
                         [(0, 3, 2, 600, 40), (6, 1, 1, 400, 60)])
def test_what_halves_of_an_ambient_record_contradict_has_no_errors_where_its_verdict_is_open(
        ctl, tmp_path, seed, modes, channels, samples, cycles):
    """Of an exact model with white noise they do in one record of 10^6 (parts.c)."""
    Y, dt = unseen(seed, modes, channels, samples, cycles)
    said = ctl("identify", write_batch(tmp_path / "a.h5", Y, dt=dt)).document
    advice = [d["message"] for d in said["diagnostics"] if "response=ambient" in d["message"]]
    assert advice and said["stability"]["stable"] is None
    assert said["modes"] and all(m["std"]["damping_ratio"] is None for m in said["modes"])


def test_few_cycles_are_said_with_how_many_are_enough(ctl, tmp_path):
    said = identify(ctl, tmp_path / "a.h5",
                    record(12, 3000, hertz=(2.0, 5.5), zeta=(0.01, 0.02))).document
    assert "too_few_cycles" in codes(said)


@pytest.mark.skipif(sanitized.SANITIZED, reason="a minute under sanitizers")
def test_twenty_modes_in_twenty_channels_converge_to_errors_that_hold(ctl, tmp_path):
    """Of 40 errors over their std the mean square has a standard deviation of 0.22."""
    rng = np.random.default_rng(21)
    hertz = np.arange(1, 21) * 0.45 * rng.uniform(0.93, 1.07, 20)
    s = system(21, tuple(hertz), tuple(rng.uniform(0.01, 0.02, 20)), channels=20, noise=0.03)
    said = identify(ctl, tmp_path / "a.h5", s.samples(40000, rng)).document
    found = sorted(said["modes"], key=lambda m: m["frequency_hz"])
    truth = np.sort(np.abs(s.lam)) / (2 * np.pi)
    assert len(found) == 20 and "not_converged" not in codes(said)
    z = [(m["frequency_hz"] - f) / m["std"]["frequency_hz"] for m, f in zip(found, truth)]
    zeta = (-s.lam.real / np.abs(s.lam))[np.argsort(np.abs(s.lam))]
    z += [(m["damping_ratio"] - d) / m["std"]["damping_ratio"] for m, d in zip(found, zeta)]
    assert 0.4 < np.mean(np.square(z)) < 1.7, z


SLOW = {"a line": lambda t: t, "a parabola": lambda t: t ** 2 + t,
        "warming": lambda t: np.exp(-2 * t), "a slow wave": lambda t: np.sin(4.7 * t + 1)}


@pytest.mark.parametrize("size", [1, 10, 100])
@pytest.mark.parametrize("kind", list(SLOW))
def test_a_drift_however_large_hides_no_mode_and_is_said(ctl, tmp_path, kind, size):
    """With it each exponent is where it is without, to a third of the bound."""
    s, drift = system(2), SLOW[kind](np.linspace(-1, 1, 20000))
    Y = s.samples(20000, np.random.default_rng(1002))
    drift = (drift - drift.mean()) / drift.std()
    said = identify(ctl, tmp_path / "a.h5", Y).document
    drifts = identify(ctl, tmp_path / "b.h5", Y + size * Y.std(0) * np.outer(drift, [1, -0.3, 0.5]))
    drifts = drifts.document
    assert "drift" in codes(drifts) and "drift" not in codes(said)
    assert "not_ambient" not in codes(drifts) and drifts["stability"]["stable"] is True
    assert len(drifts["modes"]) == len(said["modes"]) == 3
    one, other = (np.array(bench_ambient.compare(s, 20000, d)) for d in (said, drifts))
    assert np.abs(one[:, 1:3] - other[:, 1:3]).max() < 0.34 and other[:, 5:7].max() < 1.3


def test_a_drift_is_left_in_where_that_is_asked(ctl, tmp_path):
    Y = record(3) + np.linspace(-30, 30, 20000)[:, None]
    said = identify(ctl, tmp_path / "a.h5", Y, "-o", "detrend=mean").document
    assert "drift" not in codes(said)


def test_a_channel_that_was_cut_off_is_named_and_a_sine_on_a_coarse_grid_is_not(ctl, tmp_path):
    """At 1.5 standard deviations, by a converter of steps of a thousandth of one; a sine, of which
    the largest value is met most of all, on steps of a sixth of it."""
    Y = record(0, samples=6000)
    Y[:, 1] = np.round(np.clip(Y[:, 1] / Y[:, 1].std(), -1.5, 1.5) * 1000)
    said = identify(ctl, tmp_path / "a.h5", Y).document
    assert [d["channel"] for d in said["diagnostics"] if d["code"] == "clipped"] == [1]
    assert said["stability"]["stable"] is None
    assert all(m["std"]["damping_ratio"] is None for m in said["modes"])
    Y[:, 1] = np.round(6 * np.sin(2 * np.pi * 3.3 * DT * np.arange(6000)) + 0.1 * Y[:, 0])
    said = identify(ctl, tmp_path / "a.h5", Y).document
    assert "clipped" not in codes(said) and "narrow_line" in codes(said)


def test_a_change_of_level_is_said(ctl, tmp_path):
    Y = record(13)
    Y[10000:] *= 4
    assert "not_stationary" in codes(identify(ctl, tmp_path / "a.h5", Y).document)
    assert "not_stationary" not in codes(identify(ctl, tmp_path / "a.h5", record(13)).document)


@pytest.mark.parametrize("options, field, words", [
    (["window=auto"], "window", "accepted with response=ambient: T0,T1"),
    (["period=0.5"], "signals", "120 periods"),
    (["rank.fixed=3"], "rank.fixed", "two a pair"),
    (["rank.fixed=1000"], "rank.fixed", "two a pair"),
    (["pod.rank=40"], "pod.rank", "1 to 12"),
    (["method=partial-floquet"], "method", "says nothing of response=ambient"),
    (["difference=true"], "difference", "says nothing of response=ambient"),
    (["target.error=0.1"], "target.error", "says nothing of response=ambient"),
    (["inputs=0"], "inputs", "accepted with response=forced"),
    (["band=0,0.3"], "band", "lines of the spectrum"),
    (["window=0,2"], "signals", "at least"),
])
def test_what_cannot_be_asked_is_refused_with_what_can(ctl, tmp_path, options, field, words):
    said = identify(ctl, tmp_path / "a.h5", record(0, 3000),
                    *(word for option in options for word in ("-o", option)))
    assert (said.status == 2 and said.document["error"]["field"] == field
            and words in said.document["error"]["message"])


def test_a_tradeoff_says_what_more_of_the_record_buys_as_the_law_of_uncertainty_does(ctl, tmp_path):
    """[Au, MSSP 48 (2014) 15]: of N_c cycles the relative errors of a frequency and the absolute
    ones of a damping ratio z are sqrt(z / (2 pi N_c)), so an exponent's over its modulus is
    sqrt(z / (pi N_c)); modes well apart, little noise, long records."""
    zeta, hertz = np.array([0.012, 0.015, 0.02]), np.array([2.0, 2.6, 5.5])
    s = system(5, hertz, zeta, channels=4, noise=0.01)
    Y = s.samples(40000, np.random.default_rng(5))
    said = ctl("tradeoff", "identify", write_batch(tmp_path / "a.h5", Y, dt=DT), *AMBIENT,
               "-o", "repetitions=1").document
    rungs = {r["settings"].get("window", [0, 0])[1]: r for r in said["rungs"]
             if not {"pod.rank", "rank.fixed"} & set(r["settings"])}
    assert len(rungs) == 4 and all(r["unmatched"] == 0 for r in rungs.values())
    for until, rung in rungs.items():
        law = np.sqrt(zeta / (np.pi * hertz * (until or 40000 * DT))).max()
        assert 0.75 < rung["bound"] / law < 1.4, until
    assert said["bound_at_2x"] == pytest.approx(said["bound"] / np.sqrt(2))
    assert {r["settings"].get("pod.rank") for r in said["rungs"]} == {None, 1, 2}
    assert {r["settings"].get("rank.fixed") for r in said["rungs"]} == {None, 6, 8}
