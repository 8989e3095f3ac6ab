"""Excitation of type noise beside its own definition: the density of its force, and of what an
oscillator answers to it."""
# Tests as well: noise.c
import json
import subprocess

import h5py
import numpy as np
import pytest
from conftest import BUILD, PATIENCE, environment


def call(tmp_path, verb, scene, *words):
    (tmp_path / "scene.json").write_text(json.dumps(scene))
    done = subprocess.run([BUILD / "bin" / "modalctl", "--local", "--json", verb,
                           tmp_path / "scene.json", *words], capture_output=True, text=True,
                          timeout=PATIENCE,
                          env=environment())
    return done.returncode, json.loads(done.stdout)


def record(tmp_path, scene, *words):
    code, answer = call(tmp_path, "simulate", scene, "-O", tmp_path / "x.h5", *words)
    assert code == 0, answer
    with h5py.File(tmp_path / "x.h5") as file:
        return file["signals"][:]


def force(tmp_path, duration=400.0, dt=0.01, **noise):
    """What it is: the acceleration of a free mass of 1."""
    scene = {"structure": {"type": "chain", "masses": [1.0], "springs": [0, 0]},
             "excitation": [{"dof": "x1", "type": "noise", **noise}],
             "sensors": [{"dof": "x1", "derivative": 2}], "time": {"dt": dt, "duration": duration}}
    return record(tmp_path, scene)[:, 0]


def bands(values, dt, count):
    """Means over COUNT bands of the one-sided density of values that straight lines join, up to 0.9
    of 1 / (2 dt); with each the number of lines."""
    n = len(values)
    window = np.hanning(n)
    density = 2 * dt * np.abs(np.fft.rfft(values * window))**2 / np.sum(window**2)
    f = np.arange(len(density)) / (n * dt)
    density *= np.sinc(f * dt)**4
    use = np.flatnonzero((f > 5 / (n * dt)) & (f < 0.45 / dt))
    return [(f[part].mean(), density[part].mean(), len(part))
            for part in np.array_split(use, count)]


def near(got, want, lines):
    """Of LINES lines of a periodogram, each spread as its mean, neighbours of which a Hann window
    joins."""
    return abs(got / want - 1) < 5 * np.sqrt(2 / lines)


@pytest.mark.parametrize("seed", [1, 2])
def test_white_noise_has_its_density_up_to_half_the_rate_and_no_mean(seed, tmp_path):
    values = force(tmp_path, psd=0.5, seed=seed)
    for _, density, lines in bands(values, 0.01, 12):
        assert near(density, 0.5, lines)
    assert abs(values.mean()) < 5 * np.sqrt(0.5 / 2 / 400)
    third, fourth = (np.mean(values**k) / np.mean(values**2)**(k / 2) for k in (3, 4))
    assert abs(third) < 0.1 and abs(fourth - 3) < 0.2                    # normal


def test_coloured_noise_falls_past_its_corner(tmp_path):
    values = force(tmp_path, psd=2.0, seed=3, corner=5.0)
    for f, density, lines in bands(values, 0.01, 60):
        assert near(density, 2.0 / (1 + (f / 5.0)**2), lines)


def test_a_seed_is_a_force_and_another_is_another(tmp_path):
    one, again, other = (force(tmp_path, duration=20.0, psd=1.0, seed=s) for s in (7, 7, 8))
    assert np.array_equal(one, again)
    assert abs(np.corrcoef(one, other)[0, 1]) < 5 / np.sqrt(len(one))
    scaled = force(tmp_path, duration=20.0, psd=4.0, seed=7)
    assert np.abs(scaled - 2 * one).max() < 1e-12 * np.abs(one).max()


def test_an_oscillator_answers_with_its_variance_and_its_spectrum(tmp_path):
    """m = 2, f = 1 Hz, zeta = 0.05: of white noise of one-sided density G the variance is G / (8
    zeta omega^3 m^2)."""
    m, w, zeta, G, dt = 2.0, 2 * np.pi, 0.05, 0.3, 0.05
    scene = {"structure": {"type": "chain", "masses": [m], "springs": [m * w**2, 0],
                           "dampers": [2 * zeta * m * w, 0]}, "time": {"dt": dt, "duration": 20000}}
    x = record(tmp_path,
               {**scene, "excitation": [{"dof": "x1", "type": "noise", "psd": G,
                                         "seed": 11}]})[400:, 0]
    # independent stretches: half the rate at which its variance settles, 2 zeta omega
    assert np.var(x) == pytest.approx(G / (8 * zeta * w**3 * m**2),
                                      rel=5 / np.sqrt(zeta * w * 20000))
    n = len(x)
    density = 2 * dt * np.abs(np.fft.rfft(x * np.hanning(n)))**2 / np.sum(np.hanning(n)**2)
    f = np.arange(len(density)) / (n * dt)
    H = 1 / (m * (w**2 - (2 * np.pi * f)**2 + 2j * zeta * w * 2 * np.pi * f))
    for low, high in ((0.2, 0.6), (0.9, 0.97), (0.97, 1.03), (1.03, 1.1), (2, 4)):
        part = (f > low) & (f < high)
        assert near(np.mean(density[part] / np.abs(H[part])**2), G, part.sum())


def test_the_force_does_not_depend_on_the_steps_of_the_integrator(tmp_path):
    scene = {"structure": {"type": "chain", "masses": [1.0, 1.0], "springs": [40.0, 20.0, 0]},
             "time": {"dt": 0.02, "duration": 20},
             "effects": [{"type": "cubic_spring", "dof": "x1", "coefficient": 30.0},
                         {"type": "damper", "dof": "x1", "coefficient": 0.5}],
             "excitation": [{"dof": "x2", "type": "noise", "psd": 1.0, "seed": 5}]}
    coarse = record(tmp_path, scene)
    fine = record(tmp_path, scene, "-o", "tolerance=1e-12")
    steps = record(tmp_path, scene, "-o", "integrator=rk4", "-o", "substeps=20")
    assert np.abs(coarse).max() > 0.1
    assert np.abs(coarse - fine).max() < 1e-6 * np.abs(fine).max()
    assert np.abs(steps - fine).max() < 1e-6 * np.abs(fine).max()


@pytest.mark.parametrize("change, field, says", [
    ({"psd": -1}, "excitation[0].psd", "N^2/Hz"), ({"corner": 0}, "excitation[0].corner", "Hz"),
    ({"seed": 1.5}, "excitation[0].seed", "whole number"),
    ({"seed": None}, "excitation[0].seed", "whole number"),
    ({"amplitude": 1}, "excitation[0].amplitude", "unknown key")])
def test_what_is_no_noise_is_refused(change, field, says, tmp_path):
    scene = {"structure": {"type": "chain", "masses": [1.0], "springs": [1, 0]},
             "time": {"dt": 0.1, "duration": 1}, "omega": 1.0,
             "excitation": [{"dof": "x1", "type": "noise", "psd": 1.0, "seed": 1, **change}]}
    code, answer = call(tmp_path, "simulate", scene, "-O", tmp_path / "x.h5")
    assert code == 2 and answer["error"]["field"] == field and says in answer["error"]["message"]


def test_noise_without_an_end_or_a_step_and_in_a_steady_state_is_refused(tmp_path):
    scene = {"structure": {"type": "chain", "masses": [1.0], "springs": [1, 0]}, "omega": 1.0,
             "excitation": [{"dof": "x1", "type": "noise", "psd": 1.0, "seed": 1}]}
    code, answer = call(tmp_path, "steady", scene)
    assert (code == 2 and answer["error"]["field"] == "excitation[0].type"
            and "`time`" in answer["error"]["message"])
    code, answer = call(tmp_path, "steady", {**scene, "time": {"dt": 0.1, "duration": 1}})
    assert code == 2 and answer["error"]["field"].startswith("excitation")
    many = {**scene, "excitation": scene["excitation"] * 102,
            "time": {"dt": 1e-5, "duration": 0.99}}
    code, answer = call(tmp_path, "simulate", many, "-O", tmp_path / "x.h5")
    assert (code == 2 and answer["error"]["code"] == "too_large" and answer["error"]["field"]
            == "excitation[101].type")
    code, answer = call(tmp_path, "simulate", {**scene, "time": {"dt": 1e-6, "duration": 2}}, "-O",
                        tmp_path / "x.h5")
    assert (code == 2 and answer["error"]["code"] == "too_large"
            and "at most 999998" in answer["error"]["message"])
