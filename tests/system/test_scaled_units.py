"""Forty laws on forty dofs in units of 1e-8 to 1e8, and with dampers of 1e-6: the motion is the one
in units of 1, and the equations of motion hold.  Run with and without sanitizers.
"""
import json
import subprocess

import numpy as np
import pytest
from conftest import BUILD, PATIENCE, environment

N, OMEGA = 40, 0.3
LAWS = ["cubic", "gap", "friction"]
UNITS = [(1e8, 1e-8, 1e8), (1e-8, 1e8, 1e-8), (1e-8, 1e-8, 1e-8), (1e8, 1e8, 1e8)]


def law_at(law, dof, stiffness, length, small):
    """In units of STIFFNESS and LENGTH; SMALL: for a motion of some hundredths."""
    clearance, limit = (0.003, 0.005) if small else (0.3, 0.05)
    return {"dof": dof, **{
        "cubic": {"type": "cubic_spring", "coefficient": 0.1 * stiffness / length**2},
        "gap": {"type": "gap", "stiffness": stiffness, "clearance": clearance * length},
        "friction": {"type": "friction", "stiffness": stiffness,
                     "limit": limit * stiffness * length}}[law]}


def chain(law, mass=1, length=1, time=1, damping=0.05, load=0.5):
    stiffness = mass / time**2
    return {"structure": {"type": "chain", "masses": [mass] * N, "springs": [stiffness] * (N + 1),
                          "dampers": [damping * mass / time] * (N + 1)}, "omega": OMEGA / time,
            "effects": [law_at(law, f"x{i + 1}", stiffness, length, load < 0.1) for i in range(N)],
            "excitation": [{"dof": "x1", "k": 1, "cos": load * stiffness * length}],
            "steady": {"harmonics": 7, "stability": False}}


def motion(tmp_path, scene):
    """Harmonics, a dof a row."""
    path = tmp_path / "scene.json"
    path.write_text(json.dumps(scene))
    done = subprocess.run([BUILD / "bin" / "modalctl", "--local", "--json", "steady", path],
                          capture_output=True, text=True, timeout=PATIENCE,
                          env=environment(OPENBLAS_NUM_THREADS=1))
    assert done.returncode == 0, done.stderr[-800:]
    answer = json.loads(done.stdout)
    assert answer["converged"], answer["diagnostics"]
    return np.array([np.array(h["re"]) + 1j * np.array(h["im"]) for h in answer["harmonics"]])


@pytest.mark.parametrize("law", LAWS)
def test_a_motion_is_the_same_in_all_units(law, tmp_path):
    plain = motion(tmp_path, chain(law))
    for mass, length, time in UNITS:
        other = motion(tmp_path, chain(law, mass, length, time)) / length
        # a Newton step from either of two roundings ends in the other's: some kappa = 1e3 of them
        assert abs(other - plain).max() < 1e-11 * abs(plain).max(), (mass, length, time)


def force(law, x, small):
    spec = law_at(law, "", 1, 1, small)
    if law == "cubic":
        return spec["coefficient"] * x**3
    if law == "gap":
        return np.maximum(x - spec["clearance"], 0)
    f, z = np.empty_like(x), np.zeros(len(x))
    for j in list(range(x.shape[1])) * 2:
        z = np.clip(z, x[:, j] - spec["limit"], x[:, j] + spec["limit"])
        f[:, j] = x[:, j] - z
    return f


@pytest.mark.parametrize("law", LAWS)
def test_dampers_of_a_millionth_leave_the_equations_of_motion_in_balance(law, tmp_path):
    load, damping, samples = 0.02, 1e-6, 1 << 13
    X = motion(tmp_path, chain(law, damping=damping, load=load))
    k = np.arange(X.shape[1])
    x = (X @ np.exp(2j * np.pi * np.outer(k, np.arange(samples)) / samples)).real
    F = np.fft.rfft(force(law, x, True), axis=1)[:, :len(k)] / samples
    F[:, 1:] *= 2
    K = 2 * np.eye(N) - np.eye(N, k=1) - np.eye(N, k=-1)
    left = K @ X + 1j * damping * OMEGA * k * (K @ X) - (OMEGA * k)**2 * X + F
    left[0, 1] -= load
    # an event between two samples moves a harmonic by the square of a step at most
    assert abs(left).max() < (2 * np.pi / samples)**2 * load
