"""Nonlinear modes along their curve: a beam's tongue of internal resonance by a balance of its own
finite elements, a Duffing oscillator by elliptic functions, friction by its describing function.
"""
# Tests as well: backbone.c backbone_job.c damped_mode.c
import json
import math
import os
import pathlib
import subprocess

import numpy
import pytest
import scipy.linalg
import scipy.optimize
import scipy.special

TOP = pathlib.Path(__file__).resolve().parents[2]
CTL = pathlib.Path(os.environ.get("MODALD_BUILD", TOP / "build")) / "bin" / "modalctl"
pytestmark = pytest.mark.skipif(not CTL.exists(), reason=f"no {CTL}: build first")

# A cantilever of steel with a cubic spring at its end, of a published benchmark: 0.7 m long,
# 14 mm x 14 mm, 2.05e11 N/m^2, 7800 kg/m^3, 6e9 N/m^3; 19 elements.
ELEMENTS, LENGTH, EI, MASS, CUBIC = 19, 0.7, 2.05e11 * 0.014 ** 4 / 12, 7800 * 0.014 ** 2, 6e9


def run(tmp_path, scene, *args):
    path = tmp_path / "scene.json"
    path.write_text(json.dumps(scene))
    done = subprocess.run([CTL, "--local", "--json", "steady", path, *args], capture_output=True,
                          text=True, timeout=600, check=True)
    return json.loads(done.stdout)["points"]


def beam_modes():
    """Squared frequencies and the end's share of each, of unit modal mass."""
    l = LENGTH / ELEMENTS
    k = EI / l ** 3 * numpy.array([[12, 6 * l, -12, 6 * l], [6 * l, 4 * l * l, -6 * l, 2 * l * l],
                                   [-12, -6 * l, 12, -6 * l],
                                   [6 * l, 2 * l * l, -6 * l, 4 * l * l]])
    m = MASS * l / 420 * numpy.array([[156, 22 * l, 54, -13 * l],
                                      [22 * l, 4 * l * l, 13 * l, -3 * l * l],
                                      [54, 13 * l, 156, -22 * l],
                                      [-13 * l, -3 * l * l, -22 * l, 4 * l * l]])
    K, M = numpy.zeros((2, 2 * ELEMENTS + 2, 2 * ELEMENTS + 2))
    for e in range(ELEMENTS):
        at = slice(2 * e, 2 * e + 4)
        K[at, at] += k
        M[at, at] += m
    squares, shapes = scipy.linalg.eigh(K[2:, 2:], M[2:, 2:])
    return squares, shapes[-2]


# Two arc-length walks over that balance in numpy, condensed to the end's harmonics, put the fold at
# 4.784491e-4 and 4.784515e-4 m sqrt(kg), of steps 0.005 and 0.001, where f is 30.108 and 30.109 Hz.
def test_a_backbone_runs_through_a_tongue_of_internal_resonance(tmp_path):
    scene = {"structure": {"type": "beam", "length": LENGTH, "elements": ELEMENTS, "EI": EI,
                           "mass_per_length": MASS, "supports": ["clamped", "free"]}, "omega": 1,
             "effects": [{"type": "cubic_spring", "dof": f"w{ELEMENTS}", "coefficient": CUBIC}]}
    points = run(tmp_path, scene, "-o", "backbone=1:1e-5:1e-3", "-o", "harmonics=5")
    assert all(p["converged"] for p in points) and points[-1]["amplitude"] == 1e-3
    squares, end = beam_modes()
    theta = 2 * numpy.pi * numpy.arange(64) / 64
    for p in points:
        tip = next(h for h in p["harmonics"] if h["dof"] == f"w{ELEMENTS}")
        X = numpy.array(tip["re"]) + 1j * numpy.array(tip["im"])
        force = CUBIC * (numpy.exp(1j * numpy.outer(theta, range(6))) @ X).real ** 3
        for k in range(6):
            F = (1 if k == 0 else 2) / 64 * (force @ numpy.exp(-1j * k * theta))
            receptance = (end ** 2 / (squares - (k * p["omega"]) ** 2)).sum()
            # eigh is off by a few roundings of the highest square, 1e8 times the lowest
            assert (abs(F + X[k] / receptance) < 1e-7 * EI / LENGTH ** 3 * abs(X).max()
                    ), (p["amplitude"], k)
        assert X[1].real > 0
    amplitude, hz = numpy.array([(p["amplitude"], p["frequency_hz"]) for p in points]).T
    fold = next(i for i in range(1, len(points)) if amplitude[i + 1] < amplitude[i])
    assert 4.78e-4 < amplitude[fold] <= 4.78453e-4 and 30.10 < hz[fold] < 30.12
    # at its end the second mode moves alone, and the curve comes back on the other side
    least = fold + numpy.argmin(amplitude[fold:])
    assert amplitude[least] < 2e-5 and hz[least] == pytest.approx(29.7695, abs=1e-3)
    fifth = [next(h["re"][5] for h in points[i]["harmonics"] if h["dof"] == f"w{ELEMENTS}")
             for i in (least - 5, least + 5)]
    assert fifth[0] * fifth[1] < 0
    assert (numpy.diff(amplitude[least:]) > 0).all()


def test_a_duffing_curve_without_a_count_is_the_elliptic_functions(tmp_path):
    scene = {"structure": {"type": "matrices", "M": [[2.0]], "K": [[3.0]]}, "omega": 1,
             "effects": [{"type": "cubic_spring", "dof": "x1", "coefficient": 0.7}]}
    for ends in ("0.01:5", "5:0.01"):
        points = run(tmp_path, scene, "-o", f"backbone=1:{ends}", "-o", "harmonics=41")
        begin, end = map(float, ends.split(":"))
        assert points[0]["amplitude"] == begin and points[-1]["amplitude"] == end
        assert len(points) > 40
        for p in points:
            A = sum(p["harmonics"][0]["re"])
            stiff = 1.5 + 0.35 * A * A
            omega = (math.pi * math.sqrt(stiff)
                     / (2 * scipy.special.ellipk(0.35 * A * A / (2 * stiff))))
            assert p["omega"] == pytest.approx(omega, rel=1e-12)
            assert abs(p["damping_ratio"]) < 1e-13


# omega^2 = 1 + Re k(a), 2 zeta omega^2 = c omega + Im k(a), k the slider's, of one harmonic.
def test_a_curve_without_a_count_follows_friction_into_slip(tmp_path):
    scene = {"structure": {"type": "matrices", "M": [[1.0]], "C": [[0.02]], "K": [[1.0]]},
             "omega": 1, "effects": [{"type": "friction", "dof": "x1", "stiffness": 0.5,
                                      "limit": 0.3}]}
    points = run(tmp_path, scene, "-o", "backbone=1:0.1:10", "-o", "harmonics=1")
    assert points[-1]["amplitude"] == 10
    for p in points:
        ratio, k = p["amplitude"] * 0.5 / 0.3, complex(0.5, 0)
        if ratio > 1:
            angle = math.acos(1 - 2 / ratio)
            k = complex(0.5 / math.pi * (angle - math.sin(2 * angle) / 2),
                        2 / (math.pi * ratio) * (1 - 1 / ratio))
        omega = math.sqrt(1 + k.real)
        assert p["omega"] == pytest.approx(omega, rel=1e-11)
        assert p["damping_ratio"] == pytest.approx(k.imag / (2 * omega ** 2) + 0.02 / (2 * omega),
                                                   rel=1e-9)


# Motions so small that the rounded friction is a damper of limit / velocity = 100 N s/m, which no
# mode of M and K alone resembles: K - w^2 M + i w (C - 2 zeta w M) is singular, by fsolve.
def test_a_mode_begins_where_rounded_friction_nearly_sticks(tmp_path):
    M, C, K = numpy.diag([0.02, 1]), numpy.diag([100.0, 0]), numpy.array([[40, -40], [-40, 640]])
    scene = {"structure": {"type": "matrices", "M": M.tolist(), "K": K.tolist()}, "omega": 1,
             "effects": [{"type": "regularised_coulomb", "dof": "x1", "limit": 5,
                          "velocity": 0.05}]}

    def singular(y):
        det = numpy.linalg.det(K - y[0] ** 2 * M + 1j * y[0] * (C - 2 * y[1] * y[0] * M))
        return det.real, det.imag
    omega, zeta = scipy.optimize.fsolve(singular, (25.3, 0), xtol=1e-14)
    points = run(tmp_path, scene, "-o", "backbone=1:1e-5:10", "-o", "harmonics=21")
    assert points[0]["omega"] == pytest.approx(omega, rel=1e-9)
    assert points[0]["damping_ratio"] == pytest.approx(zeta, rel=1e-6)
    assert points[-1]["converged"] and points[-1]["amplitude"] == 10
    # sliding at last: the mode of the free contact, within what 5 N do to a motion of 10 m
    squares = scipy.linalg.eigh(K, M, eigvals_only=True)
    assert points[-1]["omega"] == pytest.approx(math.sqrt(squares[0]), rel=1e-4)


# A mass on two springs at large deflections: its first mode gives its motion to the second, of
# near twice its frequency, and has it back: X_1 is never 0.71.
def test_a_curve_that_comes_back_to_its_beginning_ends(tmp_path):
    a, b = 1.13 ** 2, 4.0
    c = (a + b) / 2
    terms = [{"coefficient": size, "on": on,
              "powers": {dof: n for dof, n in (("x1", p), ("x2", q)) if n}}
             for on, size, p, q in
             (("x1", 1.5 * a, 2, 0), ("x1", b, 1, 1), ("x1", a / 2, 0, 2), ("x1", c, 3, 0),
              ("x1", c, 1, 2), ("x2", b / 2, 2, 0), ("x2", a, 1, 1), ("x2", 1.5 * b, 0, 2),
              ("x2", c, 2, 1), ("x2", c, 0, 3))]
    scene = {"structure": {"type": "matrices", "M": [[1, 0], [0, 1]], "K": [[a, 0], [0, b]]},
             "omega": 1, "effects": [{"type": "polynomial_coupling", "terms": terms}]}
    points = run(tmp_path, scene, "-o", "backbone=1:1e-3:0.71", "-o", "harmonics=7")
    assert all(p["converged"] for p in points) and len(points) < 500
    assert max(p["energy"] for p in points) > 1e4 * points[0]["energy"] > 1e4 * points[-1]["energy"]
