"""Steady states under several tones, through `modalctl --local`: against time marching, against one
tone where the tones have a period after all, and what is refused."""
# Tests as well: torus_job.c
import json
import math
import pathlib
import subprocess

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from conftest import BUILD, environment

GOLDEN = (1 + 5 ** 0.5) / 2


def run(verb, scene, tmp_path, *options):
    path = pathlib.Path(tmp_path) / "scene.json"
    path.write_text(json.dumps(scene))
    done = subprocess.run([str(BUILD / "bin" / "modalctl"), "--local", "--json", verb, str(path),
                           *options], capture_output=True, text=True, env=environment(), timeout=120)
    return done.returncode, json.loads(done.stdout)


def oscillator(effects, tones, amplitude=0.2, damping=0.1):
    loads = [{"dof": "x", "k": [int(i == j) for j in range(len(tones))], "cos": amplitude}
             for i in range(len(tones))]
    return {"structure": {"type": "matrices", "M": [[1]], "C": [[damping]], "K": [[1]],
                          "dofs": ["x"]},
            "effects": effects, "excitation": loads, "steady": {"tones": tones}}


def motion(result, t, derivative=0):
    rows = result["harmonics"][0]
    w = np.array(rows["k"]) @ np.array(result["tones"])
    x = (np.array(rows["re"]) + 1j * np.array(rows["im"])) * (1j * w) ** derivative
    return (np.exp(1j * np.outer(t, w)) @ x).real


@pytest.mark.parametrize("ratio", [GOLDEN, 2 ** 0.5, 1.01])
def test_a_cubic_spring_moves_as_time_marching_says(ratio, tmp_path):
    tones = [0.7, 0.7 * ratio]
    scene = oscillator([{"type": "cubic_spring", "dof": "x", "coefficient": 0.5}], tones, 0.3)
    status, result = run("steady", scene, tmp_path, "-o", "target.error=1e-8")
    assert status == 0 and result["converged"] and result["total_error"] < 3e-8
    t = np.linspace(0, 400, 2001)

    def rate(at, y):
        load = 0.3 * sum(math.cos(w * at) for w in tones)
        return [y[1], load - 0.1 * y[1] - y[0] - 0.5 * y[0] ** 3]
    start = [motion(result, np.zeros(1))[0], motion(result, np.zeros(1), 1)[0]]
    marched = solve_ivp(rate, (0, 400), start, "DOP853", t, rtol=1e-11, atol=1e-12).y[0]
    assert np.abs(marched - motion(result, t)).max() <= 3 * result["total_error"]


def slide(x, z, stiffness, limit):
    """A slider's force at x and its place after, z before."""
    force = stiffness * (x - z)
    bound = min(max(force, -limit), limit)
    return bound, (x - bound / stiffness if bound != force else z)


@pytest.mark.parametrize("law", ["gap", "friction"])
def test_a_law_with_events_moves_as_time_marching_says_within_its_error(law, tmp_path):
    tones = [0.8, 0.8 * GOLDEN]
    effect = {"gap": {"type": "gap", "dof": "x", "stiffness": 2, "clearance": 0.2},
              "friction": {"type": "friction", "dof": "x", "stiffness": 0.5, "limit": 0.2}}[law]
    status, result = run("steady", oscillator([effect], tones), tmp_path, "-o", "target.error=1e-2")
    assert status == 0 and result["converged"]
    x, v, z, h, t, worst, most = 0.0, 0.0, 0.0, 0.01, 0.0, 0.0, 0.0
    for step in range(60000):
        def acceleration(x, v, t):
            force = slide(x, z, 0.5, 0.2)[0] if law == "friction" else 2 * max(0, x - 0.2)
            load = 0.2 * (math.cos(tones[0] * t) + math.cos(tones[1] * t))
            return load - 0.1 * v - x - force
        a1 = acceleration(x, v, t)
        a2 = acceleration(x + h / 2 * v, v + h / 2 * a1, t + h / 2)
        a3 = acceleration(x + h / 2 * (v + h / 2 * a1), v + h / 2 * a2, t + h / 2)
        a4 = acceleration(x + h * (v + h / 2 * a2), v + h * a3, t + h)
        x, v = x + h * v + h * h / 6 * (a1 + a2 + a3), v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        z, t = slide(x, z, 0.5, 0.2)[1], t + h
        if step > 30000 and step % 20 == 0:
            worst = max(worst, abs(x - motion(result, np.array([t]))[0]))
            most = max(most, abs(x))
    assert worst <= 3 * result["total_error"] and worst < 0.03 * most


def test_tones_with_a_common_period_answer_as_one(tmp_path):
    spring = [{"type": "cubic_spring", "dof": "x", "coefficient": 0.5}]
    one = oscillator(spring, [1.05, 0.7])
    two = dict(one)
    one = {**one, "omega": 0.35, "steady": {},
           "excitation": [{"dof": "x", "k": 3, "cos": 0.2}, {"dof": "x", "k": 2, "cos": 0.2}]}
    a = run("steady", one, tmp_path, "-o", "target.error=1e-11")[1]
    b = run("steady", two, tmp_path, "-o", "target.error=1e-11")[1]
    assert a["converged"] and b["converged"]
    t = np.linspace(0, 2 * np.pi / 0.35, 200)
    rows = a["harmonics"][0]
    x = np.exp(0.35j * np.outer(t, rows["k"])) @ (np.array(rows["re"]) + 1j * np.array(rows["im"]))
    assert np.abs(x.real - motion(b, t)).max() < 1e-10


def test_three_tones_are_balanced_too(tmp_path):
    tones = [0.61, 0.61 * 2 ** 0.5, 0.61 * 3 ** 0.5]
    scene = oscillator([{"type": "cubic_spring", "dof": "x", "coefficient": 0.2}], tones, 0.1)
    status, result = run("steady", scene, tmp_path, "-o", "target.error=1e-5")
    assert status == 0 and result["converged"] and len(result["harmonics"][0]["k"][0]) == 3
    t = np.linspace(0, 500, 400)
    x, v, a = (motion(result, t, d) for d in range(3))
    left = a + 0.1 * v + x + 0.2 * x ** 3 - 0.1 * sum(np.cos(w * t) for w in tones)
    assert np.abs(left).max() < 1e-3


def test_a_scene_of_tones_is_simulated_with_its_loads(tmp_path):
    tones = [0.7, 0.7 * GOLDEN]
    scene = {**oscillator([], tones), "time": {"dt": 0.05, "duration": 400}}
    status, _ = run("simulate", scene, tmp_path, "-O", str(tmp_path / "out.h5"))
    assert status == 0
    import h5py
    with h5py.File(tmp_path / "out.h5") as f:
        x = f["signals"][:, 0]
    result = run("steady", scene, tmp_path)[1]
    t = 0.05 * np.arange(len(x))
    assert np.abs(x - motion(result, t))[6000:].max() < 1e-5


def test_more_combinations_than_can_be_solved_for_are_refused_at_once(tmp_path):
    scene = oscillator([{"type": "cubic_spring", "dof": "x", "coefficient": 0.5}], [0.7, 1.1])
    status, said = run("steady", scene, tmp_path, "-o", "harmonics=8000")
    assert status == 2 and said["error"]["code"] == "too_large"
    assert said["error"]["field"] == "steady.harmonics"


@pytest.mark.parametrize("change,field", [
    ({"steady": {"tones": [1]}}, "steady.tones"),
    ({"steady": {"tones": [1, 2, 3, 4]}}, "steady.tones"),
    ({"steady": {"tones": [1, -2]}}, "steady.tones[1]"),
    ({"steady": {"tones": [1, 1]}}, "tones"),
    ({"steady": {"tones": [1, 2], "start": {"x": {"k": [1], "re": [1], "im": [0]}}}}, "start"),
    ({"steady": {"tones": [1, 2], "solutions": "all"}}, "solutions"),
    ({"steady": {}, "omega": 1}, "excitation"),
    ({"excitation": [{"dof": "x", "k": [1, 0.5], "cos": 1}]}, "excitation[0].k"),
    ({"excitation": [{"dof": "x", "k": [1, 2, 3, 4], "cos": 1}]}, "excitation[0].k"),
    ({"excitation": [{"dof": "x", "k": [1, 2, 3], "cos": 1}]}, "excitation[0]"),
    ({"effects": [{"type": "coulomb", "dof": "x", "limit": 1}]}, "tones"),
    ({"omega": 1, "effects": [{"type": "parametric_stiffness", "dof": "x", "stiffness": 0.1,
                               "k": 1}]}, "tones"),
])
def test_what_tones_do_not_take_is_refused_by_its_field(change, field, tmp_path):
    scene = {**oscillator([], [0.7, 0.7 * GOLDEN]), **change}
    status, said = run("steady", scene, tmp_path)
    assert status == 2 and said["error"]["code"] == "bad_input" and said["error"]["field"] == field
