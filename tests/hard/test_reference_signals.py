"""Every file of reference/signals meets the tolerance of its README, with its order given and with
defaults alone.
"""
import json
import os
import pathlib
import subprocess

import h5py
import numpy as np
import pytest

TOP = pathlib.Path(__file__).resolve().parents[2]
FOLDER = TOP / "tests" / "data" / "reference" / "signals"
MODALCTL = pathlib.Path(os.environ.get("MODALD_BUILD", TOP / "build")) / "bin" / "modalctl"

pytestmark = [pytest.mark.skipif(not MODALCTL.exists(), reason=f"no {MODALCTL}: build first")]

FILES = sorted(p for p in FOLDER.glob("*.h5"))
GOOD = [p for p in FILES if not p.name.startswith("bad_")]
BAD = [p for p in FILES if p.name.startswith("bad_")]

# What a refusal must name, beside the file's own reason.
BAD_FIELD = {"bad_dt_missing": "dt", "bad_dt_nan": "dt", "bad_dt_negative": "dt",
             "bad_dt_zero": "dt", "bad_period_long": "period"}


def run(path, *options):
    args = [str(MODALCTL), "--local", "--json", "identify", str(path)]
    for option in options:
        args += ["-o", option]
    done = subprocess.run(args, capture_output=True, text=True, timeout=600)
    return done.returncode, json.loads(done.stdout)


def read(path):
    with h5py.File(path, "r") as f:
        return json.loads(f.attrs["truth"]), float(f.attrs["dt"]), float(f.attrs.get("period", 0))


def found_exponents(result):
    """Both of each pair, the offset as the null exponent."""
    out = []
    for mode in result["modes"]:
        z = complex(*mode["exponent"])
        out += [z] if z.imag == 0 else [z, z.conjugate()]
    return out + ([0j] if result["offset"] else [])


def nearest(truth, found):
    """One to one, the closest pairs first; the error of each true value."""
    found, errors = list(found), [None] * len(truth)
    while found and any(e is None for e in errors):
        d, i, j = min((abs(t - f), i, j) for i, t in enumerate(truth) if errors[i] is None
                      for j, f in enumerate(found))
        errors[i] = d
        found.pop(j)
    return [np.inf if e is None else e for e in errors], found


def check_exponents(truth, result):
    modes = truth["modes"]
    lams = [complex(m["lambda_re"], m["lambda_im"]) for m in modes]
    found = [complex(*m["exponent"]) for m in result["modes"]] + ([0j] if result["offset"] else [])
    _, surplus = nearest(lams, found)
    assert not surplus, f"spurious modes {surplus}"
    tol = truth["tolerance"]
    errors, _ = nearest(lams, found)
    pairs = {i: min(found, key=lambda f: abs(f - z)) for i, z in enumerate(lams)}
    for i, (z, e, m) in enumerate(zip(lams, errors, modes)):
        if "lambda_rel" in tol:
            scale = max(abs(z), 1) if truth["kind"].startswith("heavy") else abs(z)
            assert e <= tol["lambda_rel"] * scale, f"{z}: off by {e / scale:.2e}"
        if "lambda_crb" in tol:
            d = pairs[i] - z
            assert (abs(d.real) <= tol["lambda_crb"]
                    * m["crb_std_re"]), f"{z}: Re off by {d.real / m['crb_std_re']:.2f} bounds"
            if z.imag:
                assert (abs(d.imag) <= tol["lambda_crb"]
                        * m["crb_std_im"]), f"{z}: Im off by {d.imag / m['crb_std_im']:.2f} bounds"
    if "mean_rel" in tol:
        mean = complex(truth["mean"]["lambda_re"], truth["mean"]["lambda_im"])
        assert (abs(np.mean(found) - mean) <= tol["mean_rel"]
                * abs(mean)), f"mean off by {abs(np.mean(found) - mean) / abs(mean):.2e}"
    if "damping_abs" in tol:
        for m in modes:
            nearest_mode = min(result["modes"],
                               key=lambda f: abs(complex(*f["exponent"])
                                                 - complex(m["lambda_re"], m["lambda_im"])))
            assert abs(nearest_mode["damping_ratio"] - m["damping_ratio"]) <= tol["damping_abs"]
    for m in modes:     # the sign of damping
        nearest_mode = min(result["modes"],
                           key=lambda f: abs(complex(*f["exponent"])
                                             - complex(m["lambda_re"], m["lambda_im"])))
        if m["damping_ratio"] is not None and abs(m["damping_ratio"]) > 1e-9:
            assert np.sign(nearest_mode["damping_ratio"]) == np.sign(m["damping_ratio"])


def check_multipliers(truth, result):
    found = []
    for mode in result["modes"]:
        z = complex(*mode["multiplier"])
        found += [z] if z.imag == 0 else [z, z.conjugate()]
    errors, surplus = nearest([complex(*z) for z in truth["multipliers"]], found)
    assert not surplus, f"spurious multipliers {surplus}"
    assert max(errors) <= truth["tolerance"]["multiplier_abs"], f"off by {max(errors):.2e}"


def check(path, *options):
    truth, _, period = read(path)
    code, result = run(path, *options)
    assert code == 0, result
    if period > 0:
        check_multipliers(truth, result)
    else:
        check_exponents(truth, result)
    return truth, result


@pytest.mark.parametrize("path", GOOD, ids=lambda p: getattr(p, "stem", "none"))
def test_with_defaults_alone_the_answer_is_within_tolerance(path):
    check(path)


@pytest.mark.parametrize("path", [p for p in GOOD if p.stem != "mathieu_noninteger"],
                         ids=lambda p: getattr(p, "stem", "none"))
def test_with_its_order_given_the_answer_is_within_tolerance(path):
    check(path, f"rank.fixed={read(path)[0]['order']}")


@pytest.mark.parametrize("path", [p for p in GOOD if p.stem != "mathieu_noninteger"],
                         ids=lambda p: getattr(p, "stem", "none"))
def test_the_four_matrices_agree_on_the_multipliers(path):
    """They share one non-zero spectrum; near-defective files: the centroid."""
    order = read(path)[0]["order"]
    spectra = []
    for method in ("partial-floquet", "partial-floquet-full", "autoregressive",
                   "autoregressive-full"):
        code, result = run(path, f"rank.fixed={order}", f"method={method}")
        assert code == 0, result
        spectra.append([complex(*m["multiplier"]) for m in result["modes"]]
                       + ([1 + 0j] if result["offset"] else []))
    for other in spectra[1:]:
        if path.stem.startswith("flutter"):
            assert abs(np.mean(other) - np.mean(spectra[0])) < 1e-9
        else:
            assert max(nearest(spectra[0], other)[0]) < 1e-9


@pytest.mark.parametrize("path", BAD, ids=lambda p: getattr(p, "stem", "none"))
def test_bad_input_is_refused_by_name(path):
    code, result = run(path)
    assert code == 2
    assert result["error"]["code"] == "bad_input"
    assert result["error"]["field"] == BAD_FIELD.get(path.stem, "signals"), result


def test_the_same_numbers_come_out_twice():
    a, b = run(FOLDER / "noise20.h5")[1], run(FOLDER / "noise20.h5")[1]
    for result in (a, b):
        result.pop("cost")
        result.pop("ladder", None)          # rungs with their seconds
    assert a == b
