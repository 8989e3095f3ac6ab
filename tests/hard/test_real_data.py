"""Measured signals and other programs' simulations: reference against found, as a table.

The references are those of shared/data/README.md (published, a peer's, or the librarian's own
independent estimate, with its spread). The bell in the windows of its README.  Its second doublet
is judged in a band of 60 Hz: a room's reverberation is not a free decay, and over 600 Hz an order
of 4 has to make up for it.
"""
import json
import os
import pathlib
import subprocess

import h5py
import numpy as np
import pytest

TOP = pathlib.Path(__file__).resolve().parents[2]
SHARED = pathlib.Path(os.environ.get("MODALD_SHARED", TOP / ".." / "shared"))
FOLDER = SHARED / "data"
MODALCTL = pathlib.Path(os.environ.get("MODALD_BUILD", TOP / "build")) / "bin" / "modalctl"

night = pytest.mark.night
pytestmark = [pytest.mark.skipif(not FOLDER.is_dir(), reason=f"no measured data at {FOLDER}"),
              pytest.mark.skipif(not MODALCTL.exists(), reason=f"no {MODALCTL}: build first")]


def run(name, *options):
    args = [str(MODALCTL), "--local", "--json", "identify", str(FOLDER / f"{name}.h5")]
    for option in options:
        args += ["-o", option]
    done = subprocess.run(args, capture_output=True, text=True, timeout=300)
    result = json.loads(done.stdout)
    assert done.returncode == 0, result
    return result


def codes(result):
    return {d["code"] for d in result["diagnostics"]}


def near(result, hz):
    return min(result["modes"], key=lambda m: abs(m["frequency_hz"] - hz))


HAMMER = ("hammer_beam_case1", "signals=1")
AWT = ("awt27_two_bladed_steady_wind", "period=0", "difference=true",
       "signals=YawBrRDxt,YawBrRDyt,YawBrRVxp,YawBrRVyp")

# run, frequency [Hz], its spread, what of damping, reference, spread
TABLE = [
    (HAMMER + ("window=0.1,0.5",), 212.09, 0.02, "damping_ratio", 0.00085, 0.00005),
    (HAMMER + ("window=auto",), 212.10, 0.02, "damping_ratio", 0.00091, 0.00006),
    (HAMMER + ("window=auto",), 579.0, 0.1, "damping_ratio", 0.0019, 0.0001),
    (HAMMER + ("window=auto",), 34.05, 0.02, "damping_ratio", 0.00015, 0.00015),
    (("hammer_beam_case1", "window=auto"), 212.10, 0.02, "damping_ratio", 0.00091, 0.00006),
    (("hammer_beam_case1", "window=auto"), 579.0, 0.1, "damping_ratio", 0.0019, 0.0001),
    (("hammer_beam_case1", "window=auto"), 34.05, 0.02, "damping_ratio", 0.00015, 0.00015),
    (HAMMER + ("window=2.0,2.5",), 212.10, 0.02, "damping_ratio", 0.00095, 0.00005),
    (HAMMER + ("window=0.1,0.5",), 579.0, 0.1, "damping_ratio", 0.0019, 0.0001),
    (HAMMER + ("window=0.01,1", "band=20,50"), 34.05, 0.02, "damping_ratio", 0.00015, 0.00015),
    (("bell_perc", "rank.fixed=4", "band=3315,3915", "window=0.1,0.9"), 3620.9, 0.1, "decay", 1.55,
     0.1),
    (("bell_perc", "rank.fixed=4", "band=3315,3915", "window=0.1,0.9"), 3615.4, 0.1, "decay", 3.0,
     1.0),
    (("bell_perc", "rank.fixed=6", "band=6713,6773", "window=0.02,0.5"), 6748.5, 0.1, "decay",
     6.85, 0.1),
    (("bell_perc", "rank.fixed=6", "band=6713,6773", "window=0.02,0.5"), 6738.3, 0.1, "decay", 7.6,
     0.5),
    (("bell_perc", "band=6443,7043", "window=0.02,0.5"), 6748.5, 0.1, "decay", 6.85, 0.3),
    (("tetraspar_f2t1_free",), 0.7991, 0.0002, "damping_ratio", 0.0045, 0.0001),
    (("tetraspar_f2t1_free",), 0.1002, 0.0002, "damping_ratio", 0.0, 0.0015),
    (AWT, 0.980, 0.001, "damping_ratio", 0.0465, 0.001),
    (("tower_rotor_f0t2s1_free",), 0.457, 0.01, "damping_ratio", 0.003, 0.006),
    (("tower_rotor_f0t2s1_free",), 0.468, 0.01, "damping_ratio", 0.003, 0.006),
]


def label(row):
    return f"{row[0][0]}-{row[1]}Hz-{row[0][-1]}"


def found(row):
    mode = near(run(*row[0]), row[1])
    return (mode["frequency_hz"], -mode["exponent"][0] if row[3] == "decay"
            else mode["damping_ratio"])


@pytest.mark.parametrize("row", TABLE, ids=label)
def test_free_decays_reproduce_their_references_within_the_stated_spread(row, capsys):
    hz, damping = found(row)
    with capsys.disabled():
        print(f"\n{row[0][0]:34s} {row[1]:10.4f} Hz +- {row[2]:<7g} found {hz:10.4f}   "
              f"{row[3]:13s} {row[4]:8.5f} +- {row[5]:<8g} found {damping:8.5f}", end="")
    assert abs(hz - row[1]) <= row[2]
    assert abs(damping - row[4]) <= row[5]


# What defaults alone give of the same files, with no window, band, channel or order named, and
# whether it is within the spread (of the frames: the span over their amplitudes).  Seven of fifteen
# are not: a hit in the window, a band of 22 kHz.  A row that turns right is to be written down here
# too.
DEFAULTS = [
    ("hammer_beam_case1", 212.09, 0.02, "damping_ratio", 0.00085, 0.00005, 212.115, 0.00096, False),
    ("hammer_beam_case1", 579.0, 0.1, "damping_ratio", 0.0019, 0.0001, 578.914, 0.00254, False),
    ("hammer_beam_case1", 34.05, 0.02, "damping_ratio", 0.00015, 0.00015, 34.054, 0.00022, True),
    ("bell_perc", 3620.9, 0.1, "decay", 1.55, 0.1, 3620.900, 1.409, False),
    ("bell_perc", 3615.4, 0.1, "decay", 3.0, 1.0, 3615.514, 2.100, False),
    ("bell_perc", 6748.5, 0.1, "decay", 6.85, 0.1, 6748.482, 6.507, False),
    ("bell_perc", 6738.3, 0.1, "decay", 7.6, 0.5, 6738.032, 6.797, False),
    ("tetraspar_f2t1_free", 0.7991, 0.0002, "damping_ratio", 0.0045, 0.0001, 0.79913, 0.00453,
     True),
    ("tetraspar_f2t1_free", 0.1002, 0.0002, "damping_ratio", 0.0, 0.0015, 0.10018, -0.00025, True),
    ("awt27_two_bladed_steady_wind", 0.980, 0.001, "damping_ratio", 0.0465, 0.001, 0.98026,
     0.04671, True),
    ("tower_rotor_f0t2s1_free", 0.457, 0.01, "damping_ratio", 0.003, 0.006, 0.45507, 0.00282, True),
    ("tower_rotor_f0t2s1_free", 0.468, 0.01, "damping_ratio", 0.003, 0.006, 0.46809, 0.00244, True),
    ("shaketable_3storey_flexible", 3.768, 0.04, "damping_ratio", 0.0052, 0.0025, 3.75562, 0.00688,
     True),
    ("nmr_fid_13c", 9887, 3, "decay", 132, 4, 9887.938, 132.07, True),
    ("nmr_fid_13c", 9818.4, 3, "decay", 145, 4, 9818.235, 152.89, False),
]


@pytest.mark.parametrize("name", [pytest.param(name, marks=[night] * (name == "nmr_fid_13c"))
                                  for name in sorted({row[0] for row in DEFAULTS})])
def test_what_defaults_give_of_a_file_is_right_or_wrong_as_written(name, capsys):
    result = run(name)
    for _, hz, hz_spread, what, damping, spread, hz_then, damping_then, right in (
        (row for row in DEFAULTS if row[0] == name)):
        mode = near(result, hz)
        found_ = -mode["exponent"][0] if what == "decay" else mode["damping_ratio"]
        with capsys.disabled():
            print(f"\n{name:34s} {hz:10.4f} Hz +- {hz_spread:<7g} found "
                  f"{mode['frequency_hz']:10.4f} (was {hz_then:10.4f})   "
                  f"{what:13s} {damping:8.5f} +- {spread:<8g} found {found_:8.5f} (was "
                  f"{damping_then:8.5f})", end="")
        assert ((abs(mode["frequency_hz"] - hz) <= hz_spread and abs(found_ - damping) <= spread)
                == right), (hz, mode["frequency_hz"], found_)


def test_cart3s_exponents_are_its_monodromys_modulo_omega():
    """Slow ones to rounding; the flap pair, 8e-4 apart in a record where it decays by e^-62, to
    1e-4 each, and nothing at a multiple of Omega.
    """
    with h5py.File(FOLDER / "cart3_rotor_ltp_free.h5", "r") as f:
        truth = [complex(*z) for z in f["floquet_exponents_re_im"][:] if z[1] >= 0]
    result = run("cart3_rotor_ltp_free")
    found_ = [complex(*m["exponent"]) for m in result["modes"]]
    assert len(found_) == 6
    for z in truth:
        assert min(abs(f - z) for f in found_) < (1e-4 if z.real < -2 else 1e-9)


def test_two_close_tower_modes_in_two_cycles_are_not_passed_off_as_certain():
    result = run("tower_rotor_f0t2s1_free")
    assert {"short_record", "unresolved_pair"} <= codes(result)
    for hz in (0.457, 0.468):
        mode = near(result, hz)
        assert mode["std"]["frequency_hz"] > 0.003 and mode["std"]["damping_ratio"] > 0.003
        assert abs(mode["frequency_hz"] - hz) < 2 * mode["std"]["frequency_hz"]


def test_what_turns_less_than_once_has_bars_as_wide_as_its_scatter_over_orders():
    """README: 0.1002 Hz, no damping resolved; orders 5 to 20 differ by 3e-5 Hz and 2e-4 in the
    damping ratio, the Jacobian alone says 1e-6 and 7e-6.
    """
    mode = min(run("tetraspar_f2t1_free")["modes"], key=lambda m: abs(m["frequency_hz"] - 0.1002))
    assert abs(mode["frequency_hz"] - 0.1002) <= 3 * mode["std"]["frequency_hz"] < 1e-3
    assert abs(mode["damping_ratio"]) <= 3 * mode["std"]["damping_ratio"] < 0.0015


@pytest.mark.parametrize("name",
                         ["hammer_beam_case1", "tetraspar_f2t1_free", "tower_rotor_f0t2s1_free",
                          pytest.param("nmr_fid_13c", marks=night),
                          "shaketable_3storey_flexible"])
def test_a_structure_that_rings_down_is_not_called_unstable(name):
    """Drift, rounding, friction and the driver's tail get poles, and some of those grow."""
    assert run(name)["stability"]["stable"] is not False


@pytest.mark.parametrize("window", ["0.05,1", "0.1,1", "0.05,1.5"])
def test_a_passive_beam_whose_harmonic_grows_in_a_window_is_not_called_unstable(window):
    """578.5 Hz is three times its 192.6 Hz (README: nonlinearity, not a mode); its amplitude is
    nearly constant.
    """
    result = run("vibration_toolbox_case2/vibration_toolbox_case2", "window=" + window)
    assert result["stability"]["stable"] is not False


# Shaken frames, mode 1: window [s], frequency [Hz], damping ratio (README: Hilbert envelope of one
# floor).
SHAKEN = [("0.5,3", 3.734, 0.0077), ("3,6", 3.750, 0.0061), ("6,10", 3.768, 0.0052),
          ("10,15", 3.785, 0.0043),
          ("15,20", 3.798, 0.0033), ("20,30", 3.808, 0.0024), ("30,40", 3.815, 0.0020),
          ("40,50", 3.818, 0.0019)]


@pytest.mark.parametrize("window, hz, zeta", SHAKEN)
def test_a_window_of_the_shaken_frames_has_one_mode_there(window, hz, zeta):
    """An envelope's slope and an exponential's fit weigh a window differently: 2e-3 of the
    frequency, 15 % of the damping.
    """
    result = run("shaketable_3storey_flexible", "signals=0,1,2,3", "window=" + window)
    modes = [m for m in result["modes"] if 3 < m["frequency_hz"] < 4.5]
    assert len(modes) == 1
    assert (abs(modes[0]["frequency_hz"] - hz) < 2e-3 * hz
            and abs(modes[0]["damping_ratio"] - zeta) < 0.15 * zeta)


def test_the_shaken_frames_are_amplitude_dependent_with_their_trend_and_no_close_pair():
    result = run("shaketable_3storey_flexible", "signals=0,1,2,3")
    assert "amplitude_dependent" in codes(result)
    assert len([m for m in result["modes"] if 3 < m["frequency_hz"] < 4.5]) == 1
    middle = {sum(map(float, w.split(","))) / 2: (hz, zeta) for w, hz, zeta in SHAKEN}
    for part in result["trend"]:
        hz = np.interp(part["t"], list(middle), [v[0] for v in middle.values()])
        zeta = np.interp(part["t"], list(middle), [v[1] for v in middle.values()])
        assert (abs(part["frequency_hz"] - hz) < 2e-3 * hz
                and abs(part["damping_ratio"] - zeta) < 0.15 * zeta)
    mode = near(result, 3.76)
    assert mode["std"]["frequency_hz"] > 0.02 and mode["std"]["damping_ratio"] > 0.001


def test_the_overpass_in_an_earthquake_is_not_a_free_decay():
    assert "poor_reconstruction" in codes(run("painter_street_overpass_eq2022"))


def test_the_moving_roller_is_not_explained_by_constant_modes():
    result = run("dropbear_moving_roller", "signals=0", "window=0,3")
    assert codes(result) & {"poor_reconstruction", "parameters_change"}


def test_repeats_of_an_nmr_decay_give_their_lines_as_conjugate_pairs():
    result = run("nmr_fid_13c", "window=0,0.018")
    for hz, spread in ((9887, 3), (9818.4, 3)):
        mode = near(result, hz)
        assert abs(abs(mode["damped_frequency_rad_s"]) / 2 / np.pi - hz) <= spread
