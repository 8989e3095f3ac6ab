"""Steady states under several tones, through `modalctl --local`: against time marching, against one
tone where the tones have a period after all, and what is refused."""
# Tests as well: torus_job.c torus_curve.c torus_open.c tradeoff_tones.c
import json
import math
import pathlib
import subprocess

import numpy as np
import pytest
import sanitized
from scipy.integrate import solve_ivp

from conftest import BUILD, environment

GOLDEN = (1 + 5 ** 0.5) / 2


def run(verb, scene, tmp_path, *options):
    path = pathlib.Path(tmp_path) / "scene.json"
    path.write_text(json.dumps(scene))
    done = subprocess.run([str(BUILD / "bin" / "modalctl"), "--local", "--json", *verb.split(),
                           str(path), *options], capture_output=True, text=True, env=environment(),
                          timeout=120)
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


@pytest.mark.parametrize("ratio", [GOLDEN, 2 ** 0.5, 1.01])
@pytest.mark.parametrize("law", ["gap", "friction"])
def test_lines_of_a_law_with_events_are_those_of_a_long_march(law, ratio, tmp_path):
    tones = [0.8, 0.8 * ratio]
    effect = {"gap": {"type": "gap", "dof": "x", "stiffness": 2, "clearance": 0.2},
              "friction": {"type": "friction", "dof": "x", "stiffness": 0.5, "limit": 0.2}}[law]
    scene = oscillator([effect], tones)
    status, result = run("steady", scene, tmp_path, "-o", "target.error=1e-5")
    assert status == 0 and result["converged"] and result["method"] == "march"
    # 1,200 turns of the faster tone from rest, read after 200, where lines 1 in 100 are apart
    samples, turns = 32, 1200
    dt = 2 * np.pi / tones[1] / samples
    scene["time"] = {"dt": dt, "duration": dt * samples * turns}
    csv = tmp_path / "record.csv"
    status, _ = run("simulate", scene, tmp_path, "-o", "integrator=rk4", "-o", "substeps=24", "-O",
                    str(csv))
    x = np.loadtxt(csv, delimiter=",", skiprows=1, usecols=1)[200 * samples:-1]
    t = (np.arange(len(x)) + 200 * samples) * dt
    u = (2 * np.arange(len(x)) + 1) / len(x) - 1
    window = np.exp(25 * (np.sqrt(1 - u * u) - 1))
    window *= 2 / window.sum()
    rows = result["harmonics"][0]
    X = np.array(rows["re"]) + 1j * np.array(rows["im"])
    k = np.array(rows["k"])
    largest = np.argsort(-np.abs(X))[:30]
    largest = largest[np.any(k[largest] != 0, 1)]
    lines = np.array([np.sum(window * x * np.exp(-1j * w * t))
                      for w in k[largest] @ np.array(tones)])
    assert np.abs(lines - X[largest]).max() <= 1e-5 * np.abs(x).max()
    assert np.count_nonzero(np.abs(X) > 1e-6 * np.abs(x).max()) > 30
    assert np.abs(x[:2000] - motion(result, t[:2000])).max() <= 3 * result["total_error"] + 1e-6


def test_an_error_of_a_hundredth_of_a_per_cent_needs_a_record_of_64_turns(tmp_path):
    effect = {"type": "friction", "dof": "x", "stiffness": 0.5, "limit": 0.2}
    result = run("steady", oscillator([effect], [0.8, 0.8 * 2 ** 0.5]), tmp_path, "-o",
                 "target.error=1e-4")[1]
    finer = run("steady", oscillator([effect], [0.8, 0.8 * 2 ** 0.5]), tmp_path, "-o",
                "target.error=1e-6")[1]
    assert result["method"] == "march" and result["N"] <= 64 * 64 and not result["diagnostics"]
    t = np.linspace(0, 1000, 5000)
    x = motion(finer, t)
    assert result["line_error"] <= 1e-4 * np.abs(x).max()
    assert np.abs(motion(result, t) - x).max() <= 3 * result["total_error"]


def test_what_a_motion_does_between_the_samples_of_a_record_is_within_its_error(tmp_path):
    scene = oscillator([{"type": "friction", "dof": "x", "stiffness": 1.3253, "limit": 0.14069},
                        {"type": "polynomial_damper", "dof": "x",
                         "coefficients": [0, 0, 0.06088]}], [1.3508, 1.3508 * 5 / 3],
                       damping=0.011216)
    scene["structure"].update(M=[[0.41741]], K=[[0.46606]])
    for load, cos, sin in zip(scene["excitation"], [0.04563, 0.02793], [-0.03669, 0]):
        load.update(cos=cos, sin=sin)
    result = run("steady", scene, tmp_path)[1]
    samples, turns = 7 * 64, 300                   # of the faster tone; the last 10 are looked at
    dt = 2 * np.pi / result["tones"][1] / samples
    scene["time"] = {"dt": dt, "duration": dt * samples * turns}
    csv = tmp_path / "record.csv"
    run("simulate", scene, tmp_path, "-o", "integrator=rk4", "-o", "substeps=10", "-O", str(csv))
    x = np.loadtxt(csv, delimiter=",", skiprows=1, usecols=1)[:-1][-10 * samples:]
    t = (np.arange(len(x)) + (turns - 10) * samples) * dt
    off = np.abs(x - motion(result, t)).max()
    assert result["method"] == "march" and result["converged"] and off <= 2 * result["total_error"]


# A slider's tail is a hundred times what any of its lines is off; the finer answer has a tenth of
# the error, and is held against a long march above.
@pytest.mark.parametrize("ratio", [GOLDEN, 2 ** 0.5, 1.01])
@pytest.mark.parametrize("law", ["gap", "friction"])
def test_a_target_limits_the_error_of_each_line_told_or_left_out(law, ratio, tmp_path):
    effect = {"gap": {"type": "gap", "dof": "x", "stiffness": 2, "clearance": 0.2},
              "friction": {"type": "friction", "dof": "x", "stiffness": 0.5, "limit": 0.2}}[law]
    scene = oscillator([effect], [0.8, 0.8 * ratio])
    result, finer = (run("steady", scene, tmp_path, "-o", "target.error=" + target)[1]
                     for target in ("1e-4", "1e-5"))
    told, true = ({tuple(k): complex(re, im) for k, re, im in zip(rows["k"], rows["re"],
                                                                  rows["im"])}
                  for rows in (answer["harmonics"][0] for answer in (result, finer)))
    most = np.abs(motion(finer, np.linspace(0, 1000, 5000))).max()
    off = max(abs(told.get(k, 0) - true.get(k, 0)) for k in {*told, *true})
    assert result["converged"] and not result["diagnostics"] and result["stability"]["stable"]
    assert off <= result["line_error"] and result["line_error"] <= 1.001e-4 * most
    assert result["N"] <= 32 * 256                 # samples of a record


# A gap has no place of its own: volumes of disturbances shrink by exp(-C / M t), whatever it does.
@pytest.mark.parametrize("ratio", [GOLDEN, 1.01])
def test_disturbances_beside_a_gap_lose_together_what_the_damper_takes(ratio, tmp_path):
    scene = oscillator([{"type": "gap", "dof": "x", "stiffness": 2, "clearance": 0.2}],
                       [0.8, 0.8 * ratio], damping=0.1)
    stability = run("steady", scene, tmp_path, "-o", "target.error=1e-4")[1]["stability"]
    assert sum(stability["exponents"]) == pytest.approx(-0.1, abs=1e-10)


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


# The gap's motion under 2/1 is unstable, which a balance over all phases has to 1e-4.
@pytest.mark.parametrize("law, p, q", [("friction", 5, 4), ("gap", 5, 4), ("gap", 2, 1)])
def test_events_under_tones_with_a_common_period_answer_as_one_within_both_errors(law, p, q,
                                                                                  tmp_path):
    effect = {"gap": {"type": "gap", "dof": "x", "stiffness": 2, "clearance": 0.2},
              "friction": {"type": "friction", "dof": "x", "stiffness": 0.5, "limit": 0.2}}[law]
    two = oscillator([effect], [0.8, 0.8 * p / q])
    one = {**two, "omega": 0.8 / q, "steady": {},
           "excitation": [{"dof": "x", "k": k, "cos": 0.2} for k in (q, p)]}
    a, b = (run("steady", scene, tmp_path)[1] for scene in (one, two))
    t = np.linspace(0, 2 * np.pi * q / 0.8, 300)
    rows = a["harmonics"][0]
    x = np.exp(1j * 0.8 / q * np.outer(t, rows["k"])) @ (np.array(rows["re"])
                                                         + 1j * np.array(rows["im"]))
    assert a["converged"] and b["converged"] and not b["diagnostics"]
    assert np.abs(x.real - motion(b, t)).max() <= a["total_error"] + b["total_error"]
    assert a["stability"]["stable"] is b["stability"]["stable"]


def test_three_tones_are_balanced_too(tmp_path):
    tones = [0.61, 0.61 * 2 ** 0.5, 0.61 * 3 ** 0.5]
    scene = oscillator([{"type": "cubic_spring", "dof": "x", "coefficient": 0.2}], tones, 0.1)
    status, result = run("steady", scene, tmp_path, "-o", "target.error=1e-5")
    assert status == 0 and result["converged"] and len(result["harmonics"][0]["k"][0]) == 3
    t = np.linspace(0, 500, 400)
    x, v, a = (motion(result, t, d) for d in range(3))
    left = a + 0.1 * v + x + 0.2 * x ** 3 - 0.1 * sum(np.cos(w * t) for w in tones)
    assert np.abs(left).max() < 1e-3


def test_of_three_tones_an_answer_that_more_is_asked_of_is_no_worse(tmp_path):
    effect = {"type": "friction", "dof": "x", "stiffness": 0.5, "limit": 0.1}
    scene = oscillator([effect], [0.8, 0.8 * GOLDEN, 0.8 * 2 ** 0.5])
    answers = [run("steady", scene, tmp_path, "-o", "target.error=" + target)[1]
               for target in ("1e-3", "1e-4", "1e-6")]
    errors = [result["line_error"] for result in answers]
    assert errors[0] >= errors[1] >= 0.5 * errors[2]      # these two: of the same record, estimates
    for result in answers:                # half of it for a balance that was not to be the answer
        assert result["work"]["spent"] < result["work"]["allowed"] / 3
    dt, steps = 0.1, 12000
    scene["time"] = {"dt": dt, "duration": dt * steps}
    csv = tmp_path / "record.csv"
    run("simulate", scene, tmp_path, "-o", "integrator=rk4", "-o", "substeps=20", "-O", str(csv))
    x = np.loadtxt(csv, delimiter=",", skiprows=1, usecols=1)[steps // 2:steps]
    for result in answers:
        off = x - motion(result, np.arange(steps // 2, steps) * dt)
        assert np.abs(off).max() <= 3 * result["total_error"]


# Balanced and marched as three it had 3e-4 of the motion after 60 times the work.
def test_three_tones_of_which_two_have_a_common_period_are_answered_as_two(tmp_path):
    effect = {"type": "friction", "dof": "x", "stiffness": 0.5, "limit": 0.1}
    scene = oscillator([effect], [0.8, 0.8 * GOLDEN, 1.2])
    result = run("steady", scene, tmp_path, "-o", "target.error=1e-4")[1]
    assert result["converged"] and not result["diagnostics"]
    k = np.array(result["harmonics"][0]["k"])
    assert k.shape[1] == 3 and len(np.unique(k @ [2, 0, 3] * 100 + k[:, 1])) == len(k)
    dt, steps = 0.1, 12000
    scene["time"] = {"dt": dt, "duration": dt * steps}
    csv = tmp_path / "record.csv"
    run("simulate", scene, tmp_path, "-o", "integrator=rk4", "-o", "substeps=20", "-O", str(csv))
    x = np.loadtxt(csv, delimiter=",", skiprows=1, usecols=1)[steps // 2:steps]
    off = x - motion(result, np.arange(steps // 2, steps) * dt)
    assert np.abs(off).max() <= 3 * result["total_error"]
    assert result["line_error"] <= 1e-4 * np.abs(x).max()


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


def van_der_pol(rate, **more):
    """x'' + rate (x^2 - 1) x' + x = ..."""
    damper = {"type": "polynomial_damper", "dof": "x", "coefficients": [-rate, 0, rate]}
    return {"structure": {"type": "matrices", "M": [[1]], "C": [[0]], "K": [[1]], "dofs": ["x"]},
            "effects": [damper], **more}


def limit_cycle(rate, start, until):
    """The frequency and the maxima of all coordinates of where RATE's motion ends."""
    cross = lambda t, y: y[len(y) // 2]
    cross.direction = -1
    run = solve_ivp(rate, (0, until), start, "DOP853", events=cross, rtol=1e-11, atol=1e-12)
    end = solve_ivp(rate, (0, run.t_events[0][-1] - run.t_events[0][-2]), run.y_events[0][-2],
                    "DOP853", rtol=1e-11, atol=1e-12, max_step=1e-2)
    return 2 * math.pi / (run.t_events[0][-1] - run.t_events[0][-2]), np.abs(end.y).max(1)


def maxima(result):
    w, = result["tones"]
    t = np.linspace(0, 2 * np.pi / w, 8192)
    return [np.abs(motion({"harmonics": [rows], "tones": [w]}, t)).max()
            for rows in result["harmonics"]]


@pytest.mark.parametrize("rate", [0.1, 0.5, 3, 10])
def test_a_self_excited_motion_is_the_one_that_marching_ends_in(rate, tmp_path):
    status, result = run("steady", van_der_pol(rate), tmp_path, "-o", "tones=free")
    w, amplitude = limit_cycle(lambda t, y: [y[1], rate * (1 - y[0] ** 2) * y[1] - y[0]], [2, 0],
                               60 + 40 / rate)
    assert status == 0 and result["converged"]
    assert result["tones"][0] == pytest.approx(w, rel=1e-9)
    assert maxima(result)[0] == pytest.approx(amplitude[0], abs=5e-6)


def zieglers_column(load):
    """streaming.md's: unit links, springs and masses, dampers of 0.1, and of 0.3 angle^2 beside."""
    return {"structure": {"type": "matrices", "M": [[3, 1], [1, 1]],
                          "C": [[0.2, -0.1], [-0.1, 0.1]],
                          "K": [[2 - load, load - 1], [-1, 1]], "dofs": ["a", "b"]},
            "effects": [{"type": "polynomial_damper", "dof": "a", "coefficients": [0, 0, 0.3]},
                        {"type": "polynomial_damper", "dof": "b", "to": "a",
                         "coefficients": [0, 0, 0.3]}], "steady": {"tones": ["free"]}}


# Flutter begins at 41/28 + 0.1^2 / 2 = 1.46929, with sqrt(2/7) rad/s.
@pytest.mark.parametrize("load", [1.6, 2.2])
def test_zieglers_column_flutters_as_far_as_marching_says(load, tmp_path):
    scene = zieglers_column(load)

    def rate(t, y):
        a, b, u, v = y
        outer = (0.1 + 0.3 * (b - a) ** 2) * (v - u) + (b - a)
        inner = (0.1 + 0.3 * a ** 2) * u + a - load * (a - b)
        turn = (outer - inner + outer) / 2          # 3 a" + b" = outer - inner, a" + b" = -outer
        return [u, v, turn, -outer - turn]
    status, result = run("steady", scene, tmp_path)
    assert status == 0 and result["converged"]
    begin = [np.real(sum(h["re"]) * 1.02) for h in result["harmonics"]]
    w, amplitude = limit_cycle(rate, [*begin, 0, 0], {1.6: 1500, 2.2: 300}[load])
    assert result["tones"][0] == pytest.approx(w, rel=1e-7)
    assert maxima(result) == pytest.approx(amplitude[:2], abs=2e-5)


def test_zieglers_limit_cycle_begins_at_its_flutter_load(tmp_path):
    loads = [1.4696, 1.4700]
    square = []
    for load in loads:
        result = run("steady", zieglers_column(load), tmp_path)[1]
        square.append(maxima(result)[0] ** 2)
        assert result["tones"][0] == pytest.approx((2 / 7) ** 0.5, abs=2e-3)
    begins = loads[0] - square[0] * (loads[1] - loads[0]) / (square[1] - square[0])
    assert begins == pytest.approx(41 / 28 + 0.005, abs=1e-5)


@pytest.mark.parametrize("scene", [zieglers_column(1.46),
                                   {**van_der_pol(0.5), "effects": [
                                       {"type": "cubic_spring", "dof": "x", "coefficient": 1}]}])
def test_what_comes_to_rest_has_no_tone_of_its_own(scene, tmp_path):
    if scene["effects"][0]["type"] == "cubic_spring":
        scene["structure"]["C"] = [[0.1]]
    status, result = run("steady", scene, tmp_path, "-o", "tones=free")
    assert not result["converged"] and result["total_error"] is None
    assert result["diagnostics"][0]["code"] == "not_converged"


def forced_van_der_pol(omega):
    return van_der_pol(0.5, omega=omega, excitation=[{"dof": "x", "k": 1, "cos": 1.5}])


def test_past_its_neimark_sacker_point_the_motion_has_a_second_tone(tmp_path):
    status, result = run("steady", forced_van_der_pol(1.5), tmp_path, "-o", "tones=1.5,free",
                         "-o", "target.error=1e-8")
    assert status == 0 and result["converged"] and result["total_error"] < 1e-7
    t = np.linspace(0, 600, 3001)
    start = [motion(result, np.zeros(1))[0], motion(result, np.zeros(1), 1)[0]]
    marched = solve_ivp(lambda t, y: [y[1], 1.5 * math.cos(1.5 * t) + 0.5 * (1 - y[0] ** 2) * y[1]
                                      - y[0]], (0, 600), start, "DOP853", t, rtol=1e-11, atol=1e-12)
    # what the start is off shifts the phase of the second tone, and nothing brings that back
    assert np.abs(marched.y[0] - motion(result, t)).max() <= 20 * result["total_error"]


# The point itself is test_steady_references.py's, by shooting.
def test_the_second_tone_begins_at_the_neimark_sacker_point(tmp_path):
    omegas, square = [1.4121, 1.4127], []
    for omega in omegas:
        result = run("steady", forced_van_der_pol(omega), tmp_path, "-o", f"tones={omega},free")[1]
        rows = result["harmonics"][0]
        at = rows["k"].index([0, 1])
        square.append(rows["re"][at] ** 2 + rows["im"][at] ** 2)
    begins = omegas[0] - square[0] * (omegas[1] - omegas[0]) / (square[1] - square[0])
    assert begins == pytest.approx(1.4117959625669958, abs=1e-5)
    curve = {**forced_van_der_pol(1), "steady": {"harmonics": 31, "start": {
        "x": {"k": [1], "re": [0], "im": [-2]}}}}
    point, = run("steady", curve, tmp_path, "--continue", "omega=1.0:1.7")[1]["bifurcations"]
    second, told = result["tones"][1], point["second_tone"]
    assert min(abs(second - told), abs(point["omega"] - second - told)) < 1e-3


def test_a_smooth_motion_of_its_own_phases_alone_is_found_and_exact(tmp_path):
    spring = [{"type": "cubic_spring", "dof": "x", "coefficient": 0.5}]
    two = oscillator(spring, [0.8, 1.2], 0.3)
    one = {**two, "omega": 0.4, "steady": {},
           "excitation": [{"dof": "x", "k": k, "cos": 0.3} for k in (2, 3)]}
    a = run("steady", one, tmp_path, "-o", "target.error=1e-11")[1]
    b = run("steady", two, tmp_path, "-o", "target.error=1e-11")[1]
    assert a["converged"] and b["converged"]
    t, rows = np.linspace(0, 5 * np.pi, 500), a["harmonics"][0]
    x = (np.exp(0.4j * np.outer(t, rows["k"]))
         @ (np.array(rows["re"]) + 1j * np.array(rows["im"]))).real
    assert np.abs(x - motion(b, t)).max() <= 1e-10 * np.abs(x).max()


# Tones 2 to 1 march to twice their period: no line of theirs, and their own motion is unstable.
@pytest.mark.parametrize("law, p, q, least", [("gap", 2, 1, 1.5e-2), ("gap", 3, 2, 2e-6),
                                              ("friction", 5, 3, 2e-6)])
def test_a_law_with_events_under_tones_of_a_common_period_moves_as_under_one(law, p, q, least,
                                                                             tmp_path):
    effect = {"gap": {"type": "gap", "dof": "x", "stiffness": 2, "clearance": 0.2},
              "friction": {"type": "friction", "dof": "x", "stiffness": 0.5, "limit": 0.2}}[law]
    two = oscillator([effect], [0.8, 0.8 * p / q])
    one = {**two, "omega": 0.8 / q, "steady": {},
           "excitation": [{"dof": "x", "k": q, "cos": 0.2}, {"dof": "x", "k": p, "cos": 0.2}]}
    a, b = run("steady", one, tmp_path)[1], run("steady", two, tmp_path)[1]
    assert a["converged"] and b["converged"]
    t = np.linspace(0, 2 * np.pi * q / 0.8, 500)
    rows = a["harmonics"][0]
    x = (np.exp(0.8j / q * np.outer(t, rows["k"]))
         @ (np.array(rows["re"]) + 1j * np.array(rows["im"]))).real
    assert np.abs(x - motion(b, t)).max() <= 3 * (a["total_error"] + b["total_error"])
    assert b["line_error"] <= least * np.abs(x).max()
    assert (b["stability"]["stable"] is False) == (p == 2)


def exponents(stiffness, damping, until, start):
    """Lyapunov's, of y'' + damping(t) y' + stiffness(t) y = 0, by marching two disturbances."""
    y, grown, count = np.eye(2), np.zeros(2), 0
    for at in np.arange(0, until, until / 400):
        y = solve_ivp(lambda t, y: [y[2], y[3], -damping(t) * y[2] - stiffness(t) * y[0],
                                    -damping(t) * y[3] - stiffness(t) * y[1]],
                      (at, at + until / 400), y.ravel(), rtol=1e-8, atol=1e-12).y[:, -1]
        y, sizes = np.linalg.qr(y.reshape(2, 2))
        if at >= start:
            grown, count = grown + np.log(np.abs(np.diag(sizes))), count + 1
    return sorted(grown / (count * until / 400))[::-1]


def test_disturbances_of_a_torus_decay_as_marching_says(tmp_path):
    tones = [0.7, 0.7 * GOLDEN]
    scene = oscillator([{"type": "cubic_spring", "dof": "x", "coefficient": 0.5}], tones, 0.3)
    result = run("steady", scene, tmp_path)[1]
    stability = result["stability"]
    rows = result["harmonics"][0]
    X = np.array(rows["re"]) + 1j * np.array(rows["im"])
    keep = np.abs(X) > 1e-4
    X, w = X[keep], (np.array(rows["k"]) @ np.array(tones))[keep]
    told = exponents(lambda t: 1 + 1.5 * (np.exp(1j * w * t) @ X).real ** 2, lambda t: 0.1, 800, 80)
    assert stability["stable"] is True and stability["max_multiplier"] is None
    assert sum(stability["exponents"]) == pytest.approx(-0.1, abs=1e-5)    # all volume: the damper
    assert stability["exponents"] == pytest.approx(told, abs=4 * stability["margin_std"] + 2e-3)


# Of two exponents one is 0, and both sum to the mean of minus the damping along the cycle.
@pytest.mark.parametrize("coefficients,stable", [([-0.5, 0, 0.5], True),
                                                 ([0.1, 0, -1, 0, 1], False)])
def test_a_limit_cycle_is_told_stable_or_not(coefficients, stable, tmp_path):
    scene = van_der_pol(1)
    scene["effects"][0]["coefficients"] = coefficients
    result = run("steady", scene, tmp_path, "-o", "tones=free")[1]
    t = np.linspace(0, 2 * np.pi / result["tones"][0], 4097)[:-1]
    decays = np.polynomial.polynomial.polyval(motion(result, t), coefficients).mean()
    assert result["converged"] and result["stability"]["stable"] is stable
    assert result["stability"]["margin"] == pytest.approx(decays, abs=1e-3)
    assert bool(decays > 0) is stable


def growth_of_friction(tones, until=1200.0, start=150.0, h=0.02, apart=1e-5):
    """Mean growth, 1/s, of the distance of two motions of test_disturbances_..., brought back to
    APART each second."""
    def step(t, x, v, z):
        def acceleration(x, v, t):
            return (0.2 * sum(math.cos(w * t) for w in tones) - 0.1 * v - x
                    - slide(x, z, 0.5, 0.2)[0])
        a1 = acceleration(x, v, t)
        a2 = acceleration(x + h / 2 * v, v + h / 2 * a1, t + h / 2)
        a3 = acceleration(x + h / 2 * (v + h / 2 * a1), v + h / 2 * a2, t + h / 2)
        a4 = acceleration(x + h * (v + h / 2 * a2), v + h * a3, t + h)
        x, v = x + h * v + h * h / 6 * (a1 + a2 + a3), v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        return x, v, slide(x, z, 0.5, 0.2)[1]
    a, b, grown = (0.0, 0.0, 0.0), (apart, 0.0, 0.0), 0.0
    for n in range(round(until / h)):
        a, b = step(n * h, *a), step(n * h, *b)
        if n % 50 == 49:
            size = math.dist(a, b)
            grown += math.log(size / apart) if n * h >= start else 0
            b = tuple(p + (q - p) * apart / size for p, q in zip(a, b))
    return grown / (until - start)


def test_disturbances_beside_a_slider_decay_as_two_marches_say(tmp_path):
    tones = [0.8, 0.8 * 2 ** 0.5]
    scene = oscillator([{"type": "friction", "dof": "x", "stiffness": 0.5, "limit": 0.2}], tones)
    stability = run("steady", scene, tmp_path, "-o", "target.error=1e-3")[1]["stability"]
    assert stability["stable"] is True and stability["margin_std"] < 0.01
    assert stability["exponents"][0] == pytest.approx(growth_of_friction(tones),
                                                      abs=3 * stability["margin_std"])


def test_a_slider_at_rest_leaves_the_stability_of_a_torus_unknown(tmp_path):
    scene = oscillator([{"type": "friction", "dof": "x", "stiffness": 0.5, "limit": 5}],
                       [0.8, 0.8 * GOLDEN])
    result = run("steady", scene, tmp_path)[1]
    assert result["converged"] and result["stability"]["stable"] is None
    assert "stability_unknown" in [d["code"] for d in result["diagnostics"]]


# A march of Runge and Kutta from the motion told, 1600 steps a turn, leaves it: it is 2.5e-6 off
# after 614 s, 8.9e-6 after 1228, 2.1e-3 1/s, and ends at a motion of twice the period.
def test_a_gap_that_drives_a_motion_away_is_told_beside_a_slider_at_rest(tmp_path):
    M = np.array([17.09938, 23.48087, 12.20674, 4.95133])
    K = np.array([[76.8237, -5.44083, 0, 0], [-5.44083, 20.5635, -15.12267, 0],
                  [0, -15.12267, 21.46442, -6.34175], [0, 0, -6.34175, 6.34175]]) * 1e-3
    C = 1.2134 * K + 8.744e-4 * np.diag(M)
    scene = chain(M, C, K,
                  [{"type": "friction", "dof": "x2", "stiffness": 36.07145e-3,
                    "limit": 0.3153589e-3},
                   {"type": "gap", "dof": "x2", "stiffness": 0.3336733, "clearance": 8.23e-3}],
                  [(2, [1, 0], 0.3380539e-3, 0.0853323e-3)], [0.0505982, 0.0505998])
    result = run("steady", scene, tmp_path)[1]
    stability = result["stability"]
    assert result["converged"] and stability["stable"] is False
    assert stability["exponents"][0] == pytest.approx(2.1e-3, abs=3 * stability["margin_std"])


def test_a_torus_that_its_structure_drives_away_is_unstable_beside_a_slider_at_rest(tmp_path):
    scene = oscillator([{"type": "friction", "dof": "x", "stiffness": 0.5, "limit": 5}],
                       [0.8, 0.8 * GOLDEN], damping=-0.05)
    stability = run("steady", scene, tmp_path)[1]["stability"]
    assert stability["stable"] is False                     # x'' - 0.05 x' + 1.5 x
    assert stability["exponents"][0] == pytest.approx(0.025, abs=3 * stability["margin_std"])


# Two gaps under a tone 707 times slower than the other.  Marched from the balance's own start, 800
# steps of Runge and Kutta a turn, the motion follows it for 60 turns and is 0.6 of its size off at
# 94: along that part of the slow phase the balanced branch is unstable, though disturbances decay
# over all of it.
def test_a_balance_that_a_part_of_a_slow_phase_drives_away_is_no_answer(tmp_path):
    scene = {"structure": {"type": "matrices", "dofs": ["x0", "x1"],
                           "M": [[0.517429, 0], [0, 2.649075]],
                           "C": [[0.0117125, -0.0053389], [-0.0053389, 0.0161357]],
                           "K": [[1.0725075, -0.5962332], [-0.5962332, 0.5962332]]},
             "effects": [{"type": "gap", "dof": "x1", "stiffness": 1.200625,
                          "clearance": 0.7536745},
                         {"type": "gap", "dof": "x1", "to": "x0", "stiffness": 0.6835772,
                          "clearance": 0.7519279},
                         {"type": "polynomial_damper", "dof": "x1",
                          "coefficients": [0, 0, 0.3518037]}],
             "excitation": [{"dof": "x1", "k": [1, 0], "cos": 0.1483185, "sin": 0.088207},
                            {"dof": "x1", "k": [0, 1], "cos": 0.2390434}],
             "steady": {"tones": [0.756865044, 0.00107036881]}}
    result = run("steady", scene, tmp_path)[1]
    assert not result["converged"]
    assert "does not last" in result["diagnostics"][0]["message"]


# A march of the motion told, 800 steps of Runge and Kutta a turn, leaves it: by 2.0e-4 of its size
# at turn 500, by 1.04e-2 at 1100, 8655 s later: 4.57e-4 1/s.  The stiffest mode turns some ten
# times as fast as the tones: a method that slows it by 1 % moves it out of that resonance.
def test_growth_in_a_narrow_resonance_of_a_stiff_mode_is_told(tmp_path):
    scene = {"structure": {"type": "matrices", "dofs": ["x0", "x1", "x2", "x3"],
                           "M": np.diag([3.03202051, 1.84464264, 2.67529102, 0.63153292]).tolist(),
                           "C": [[0.01835367, -0.00619985, 0, 0],
                                 [-0.00619985, 0.01753013, -0.00518042, 0],
                                 [0, -0.00518042, 0.04161215, -0.02751257],
                                 [0, 0, -0.02751257, 0.02961804]],
                           "K": [[1.36319479, -1.02503256, 0, 0],
                                 [-1.02503256, 1.88152089, -0.85648833, 0],
                                 [0, -0.85648833, 5.40519006, -4.54870174],
                                 [0, 0, -4.54870174, 4.54870174]]},
             "effects": [{"type": "cubic_spring", "dof": "x0", "coefficient": 4.6981591719}],
             "excitation": [{"dof": "x1", "k": [1, 0], "cos": 0.8040423321},
                            {"dof": "x0", "k": [0, 1], "sin": 0.6298589005}],
             "steady": {"tones": [0.431242404953, 0.435554829002]}}
    result = run("steady", scene, tmp_path)[1]
    stability = result["stability"]
    assert result["converged"] and stability["stable"] is False
    assert stability["exponents"][0] == pytest.approx(4.57e-4, rel=0.1)


def chain(M, C, K, effects, loads, tones):
    dofs = [f"x{i}" for i in range(len(M))]
    return {"structure": {"type": "matrices", "M": np.diag(M).tolist(), "C": C.tolist(),
                          "K": K.tolist(), "dofs": dofs},
            "effects": effects, "steady": {"tones": tones},
            "excitation": [{"dof": dofs[i], "k": k, "cos": c, "sin": s} for i, k, c, s in loads]}


def rk4(acceleration, x, v, h, steps, after):
    """Motion of one mass from x and v; AFTER(x) once a step is done."""
    out = np.empty(steps + 1)
    for step in range(steps + 1):
        out[step], t = x, step * h
        a1 = acceleration(x, v, t)
        a2 = acceleration(x + h / 2 * v, v + h / 2 * a1, t + h / 2)
        a3 = acceleration(x + h / 2 * (v + h / 2 * a1), v + h / 2 * a2, t + h / 2)
        a4 = acceleration(x + h * (v + h / 2 * a2), v + h * a3, t + h)
        x, v = (x + h * v + h * h / 6 * (a1 + a2 + a3),
                v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4))
        after(x)
    return out


@pytest.mark.parametrize("stiffness", [0, 0.05])
def test_a_body_that_a_slider_alone_holds_has_a_mean_of_its_history(stiffness, tmp_path):
    tones, z = [0.8, 0.8 * GOLDEN], [0.0]
    scene = oscillator([{"type": "friction", "dof": "x", "stiffness": 0.5, "limit": 0.1}], tones)
    scene["structure"]["K"] = [[stiffness]]
    result = run("steady", scene, tmp_path, "-o", "target.error=1e-3")[1]
    codes = [d["code"] for d in result["diagnostics"]]
    assert result["converged"] and ("undetermined_mean" in codes) == (stiffness == 0)

    def acceleration(x, v, t):
        load = 0.2 * (math.cos(tones[0] * t) + math.cos(tones[1] * t))
        return load - 0.1 * v - stiffness * x - slide(x, z[0], 0.5, 0.1)[0]

    def after(x):
        z[0] = slide(x, z[0], 0.5, 0.1)[1]
    h, steps = 0.01, 120000
    x = rk4(acceleration, 3, 0, h, steps, after)[steps // 2:]   # settled about its own place
    t = np.arange(steps // 2, steps + 1) * h
    off = x - motion(result, t)
    assert np.abs(off.mean()) > 0.1 if stiffness == 0 else np.abs(off.mean()) < 1e-3
    assert np.abs(off - off.mean()).max() <= 3 * result["total_error"]


@pytest.mark.parametrize("ratio", [GOLDEN, 1e-3 * 2 ** 0.5])
def test_a_chain_that_nothing_holds_moves_about_any_place_as_marching_says(ratio, tmp_path):
    M, K = np.array([1.1, 2.3]), 1.7 * np.array([[1, -1], [-1, 1]])
    scene = chain(M, 0.05 * K + 0.07 * np.diag(M), K,
                  [{"type": "friction", "dof": "x0", "to": "x1", "stiffness": 0.5, "limit": 0.02},
                   {"type": "gap", "dof": "x1", "to": "x0", "stiffness": 0.9, "clearance": 0.02}],
                  [(0, [1, 0], 0.4, 0), (1, [0, 1], 0.3 * min(1, ratio), 0.1 * min(1, ratio))],
                  [0.9, 0.9 * ratio])
    result = run("steady", scene, tmp_path)[1]
    assert result["converged"] and result["stability"]["stable"] is True
    assert "undetermined_mean" in [d["code"] for d in result["diagnostics"]]
    dt, steps = 0.1, 6000
    scene["time"] = {"dt": dt, "duration": dt * steps}
    csv = tmp_path / "record.csv"
    run("simulate", scene, tmp_path, "-o", "integrator=rk4", "-o", "substeps=100", "-O", str(csv))
    x = np.loadtxt(csv, delimiter=",", skiprows=1, usecols=(1, 2)).T[:, steps // 2:steps]
    off = x - all_motions(result, np.arange(steps // 2, steps) * dt)
    assert np.abs(off - off.mean()).max() <= 3 * result["total_error"] + 1e-6 * np.ptp(x)


def test_a_contact_beside_a_slider_at_rest_is_told_through_a_whole_beat(tmp_path):
    tones, M, C, K = [1.35, 1.35 * 1.01], 0.5732, 0.05, 1.6497
    scene = oscillator([{"type": "friction", "dof": "x", "stiffness": 0.25, "limit": 0.073},
                        {"type": "gap", "dof": "x", "stiffness": 6.949, "clearance": 0.0364}],
                       tones)
    scene["structure"].update(M=[[M]], C=[[C]], K=[[K]])
    for load, force in zip(scene["excitation"], [0.0422, 0.0295]):
        load["cos"] = force
    result = run("steady", scene, tmp_path)[1]
    start = [motion(result, np.zeros(1))[0], motion(result, np.zeros(1), 1)[0]]

    def acceleration(x, v, t):                     # |x| < 0.073 / 0.25: the slider is a spring
        load = 0.0422 * math.cos(tones[0] * t) + 0.0295 * math.cos(tones[1] * t)
        return (load - C * v - (K + 0.25) * x - 6.949 * max(0, x - 0.0364)) / M
    h, steps = 0.005, 200000                       # two beats
    x = rk4(acceleration, *start, h, steps, lambda x: None)[::20]
    off = np.abs(x - motion(result, np.arange(len(x)) * 20 * h)).max()
    assert result["converged"] and off <= 3 * result["total_error"] + 1e-4 * np.abs(x).max()


def all_motions(result, t, derivative=0):
    return np.array([motion({**result, "harmonics": [rows]}, t, derivative)
                     for rows in result["harmonics"]])


def test_lines_beyond_the_highest_of_a_slow_tone_are_within_the_error_stated(tmp_path):
    M = np.array([0.9, 0.4, 2.7, 2.1])
    K = np.array([[2.7, -2.7, 0, 0], [-2.7, 6.3, -3.6, 0], [0, -3.6, 7.1, -3.5], [0, 0, -3.5, 3.5]])
    C, w = 0.0027 * K + 0.013 * np.diag(M), [1.23, 0.0017]
    scene = chain(M, C, K, [{"type": "cubic_spring", "dof": "x3", "coefficient": 0.8}],
                  [(2, [1, 0], 1.4, 0), (1, [0, 1], 0.7, -0.9)], w)
    result = run("steady", scene, tmp_path, "-o", "stability=false")[1]
    t = np.linspace(0, 510, 2000)

    def rate(at, y):
        x, v = y[:4], y[4:]
        force = np.array([0, 0.7 * np.cos(w[1] * at) - 0.9 * np.sin(w[1] * at),
                          1.4 * np.cos(w[0] * at), -0.8 * x[3] ** 3])
        return np.concatenate([v, (force - K @ x - C @ v) / M])
    start = np.concatenate([all_motions(result, np.zeros(1))[:, 0],
                            all_motions(result, np.zeros(1), 1)[:, 0]])
    marched = solve_ivp(rate, (0, 510), start, "DOP853", t, rtol=1e-9, atol=1e-10).y[:4]
    assert np.abs(marched - all_motions(result, t)).max() <= 3 * result["total_error"]


# No record tells the second tone from the first: all lines are of the one that a load acts with.
def test_a_twin_tone_without_a_load_takes_none_of_the_lines_of_a_march(tmp_path):
    effects = [{"type": "friction", "dof": "x", "stiffness": 0.5, "limit": 0.1},
               {"type": "regularised_coulomb", "dof": "x", "to": "ground", "limit": 0.02,
                "velocity": 0.05}]
    scene = oscillator(effects, [0.8, 0.8 * (1 + 2e-5)], 0.3)
    scene["excitation"][1]["cos"] = 0
    status, result = run("steady", scene, tmp_path)
    one = {**scene, "omega": 0.8, "steady": {},
           "excitation": [{"dof": "x", "k": 1, "cos": 0.3}]}
    alone = run("steady", one, tmp_path, "-o", "target.error=1e-7")[1]["harmonics"][0]
    true = dict(zip(alone["k"], np.array(alone["re"]) + 1j * np.array(alone["im"])))
    rows = result["harmonics"][0]
    assert status == 0 and result["converged"] and not result["diagnostics"]
    assert result["method"] == "march"
    for k, re, im in zip(rows["k"], rows["re"], rows["im"]):
        assert abs(re + 1j * im - (true.get(k[0], 0) if k[1] == 0 else 0)) <= result["total_error"]


def test_tones_that_no_record_tells_apart_leave_a_balance_its_work(tmp_path):
    M, K = np.array([0.66, 2.4]), np.array([[1.0, -1], [-1, 1]])
    C, w = np.array([[0.075, -0.033], [-0.033, 0.19]]), [1.2243, 1.2243 * 1.00001]
    scene = chain(M, C, K,
                  [{"type": "friction", "dof": "x0", "stiffness": 0.16, "limit": 0.04},
                   {"type": "gap", "dof": "x1", "stiffness": 0.1, "clearance": 0.9}],
                  [(1, [1, 0], 0.47, -0.5), (0, [0, 1], 0.5, 0)], w)
    result = run("steady", scene, tmp_path, "-o", "stability=false")[1]
    assert result["converged"]
    h, z, worst = 2 * math.pi / w[0] / 200, 0.0, 0.0
    t = h * np.arange(-2000, 2001)
    told = all_motions(result, t)
    for x in told[0, :2001]:
        z = slide(x, z, 0.16, 0.04)[1]
    x, v = told[:, 2000].copy(), all_motions(result, np.zeros(1), 1)[:, 0]

    def acceleration(x, v, t):
        force = np.array([0.5 * math.cos(w[1] * t) - slide(x[0], z, 0.16, 0.04)[0],
                          0.47 * math.cos(w[0] * t) - 0.5 * math.sin(w[0] * t)
                          - 0.1 * max(0, x[1] - 0.9)])
        return (force - K @ x - C @ v) / M
    for n in range(2000, 4000):
        worst = max(worst, np.abs(x - told[:, n]).max())
        a1 = acceleration(x, v, t[n])
        a2 = acceleration(x + h / 2 * v, v + h / 2 * a1, t[n] + h / 2)
        a3 = acceleration(x + h / 2 * (v + h / 2 * a1), v + h / 2 * a2, t[n] + h / 2)
        a4 = acceleration(x + h * (v + h / 2 * a2), v + h * a3, t[n] + h)
        x, v = x + h * v + h * h / 6 * (a1 + a2 + a3), v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        z = slide(x[0], z, 0.16, 0.04)[1]
    assert worst <= 3 * result["total_error"]


SPRING = [{"type": "cubic_spring", "dof": "x", "coefficient": 0.5}]


@pytest.mark.parametrize("path,values", [("tones[1]", [1.2, 1.4]), ("steady.tones[0]", [0.5, 0.7]),
                                         ("excitation[1].cos", [0.05, 0.15])])
def test_points_of_a_sweep_are_the_motions_found_alone(path, values, tmp_path):
    scene = oscillator(SPRING, [0.7, 0.7 * GOLDEN], 0.05)
    tight = ["-o", "target.error=1e-8"]
    status, curve = run("steady", scene, tmp_path, "--sweep", f"{path}={values[0]}:{values[1]}:3",
                        *tight)
    assert status == 0 and curve["kind"] == "curve" and len(curve["points"]) == 3
    t = np.linspace(0, 300, 500)
    for point in curve["points"]:
        alone = json.loads(json.dumps(scene))
        if path.startswith("excitation"):
            alone["excitation"][1]["cos"] = point["value"]
        else:
            alone["steady"]["tones"][int(path[-2])] = point["value"]
        assert point["converged"] and point["tones"] == alone["steady"]["tones"]
        one = run("steady", alone, tmp_path, *tight)[1]
        assert np.abs(motion(point, t) - motion(one, t)).max() <= 3 * (point["total_error"]
                                                                       + one["total_error"])


def test_a_sweep_stays_on_the_branch_that_it_came_by(tmp_path):
    """Hardening, hardly damped: near its resonance large and small motions stand side by side."""
    scene = oscillator([{"type": "cubic_spring", "dof": "x", "coefficient": 1}], [1.2, 0.31], 0.15,
                       0.04)
    scene["excitation"][1]["cos"] = 0.02
    up, down = (run("steady", scene, tmp_path, "--sweep", f"tones[0]={ends}", "-o",
                    "stability=false")[1]["points"] for ends in ("1:1.6:25", "1.6:1:25"))
    size = lambda p: np.abs(motion(p, np.linspace(0, 200, 2000))).max()
    large, small = size(up[16]), size(down[8])
    assert up[16]["value"] == pytest.approx(down[8]["value"]) and up[16]["converged"]
    assert down[8]["converged"] and large > 2 * small


def test_a_free_tone_is_swept_over_a_number_of_the_scene(tmp_path):
    scene = van_der_pol(0.5)
    path = "effects[0].coefficients[0]"
    status, curve = run("steady", scene, tmp_path, "--sweep", f"{path}=-0.5:-2:4", "-o",
                        "tones=free")
    assert status == 0
    for point in curve["points"]:
        scene["effects"][0]["coefficients"][0] = point["value"]
        alone = run("steady", scene, tmp_path, "-o", "tones=free")[1]
        assert point["converged"]
        assert point["tones"][0] == pytest.approx(alone["tones"][0], rel=1e-8)
        assert maxima(point) == pytest.approx(maxima(alone), rel=1e-5)


# A record of 32 samples a turn is one of pieces; the other way takes 64 and more.
@pytest.mark.parametrize("effect", [{"type": "friction", "stiffness": 0.5, "limit": 0.1},
                                    {"type": "gap", "stiffness": 1, "clearance": 0.2}])
def test_a_chain_whose_far_end_motion_reaches_late_is_marched_in_pieces(effect, tmp_path):
    n, tones = 5, [0.8, 0.8 * GOLDEN]
    K = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    K[-1, -1] = 1
    scene = chain(np.ones(n), 0.05 * K + 0.05 * np.eye(n), K,
                  [{**effect, "dof": f"x{i}"} for i in range(n)],
                  [(n - 1, [1, 0], 0.2, 0), (n // 2, [0, 1], 0.2, 0)], tones)
    result = run("steady", scene, tmp_path, "-o", "target.error=1e-3")[1]
    assert result["method"] == "march" and result["N"] <= 32 * 512 and result["converged"]
    dt, steps, seen = 0.1, 32000, 4000             # the gaps' slowest disturbance: -0.0045 1/s
    scene["time"] = {"dt": dt, "duration": dt * steps}
    csv = tmp_path / "record.csv"
    run("simulate", scene, tmp_path, "-o", "integrator=rk4", "-o", "substeps=20", "-O", str(csv))
    x = np.loadtxt(csv, delimiter=",", skiprows=1, usecols=range(1, n + 1)).T[:, steps - seen:steps]
    off = np.abs(x - all_motions(result, np.arange(steps - seen, steps) * dt)).max()
    assert off <= 3 * result["total_error"]


def test_where_two_tones_meet_a_sweep_has_no_answer_and_goes_on(tmp_path):
    status, curve = run("steady", oscillator(SPRING, [0.7, 1]), tmp_path, "--sweep",
                        "tones[1]=0.6:0.8:3")
    assert status == 0
    assert [p["converged"] for p in curve["points"]] == [True, False, True]
    assert "same" in curve["points"][1]["diagnostics"][0]["message"]


def hardening(second, tones=(0.8, 0.37)):
    scene = oscillator([{"type": "cubic_spring", "dof": "x", "coefficient": 0.5}], list(tones), 0.3)
    scene["excitation"][1]["cos"] = second
    return scene


# A load of nothing at the second tone leaves one tone's curve, which path.c follows by other means.
def test_a_branch_under_a_second_tone_without_a_load_has_the_folds_of_one_tone(tmp_path):
    one = hardening(0)
    one["excitation"] = [{"dof": "x", "k": 1, "cos": 0.3}]
    one["omega"] = one.pop("steady")["tones"][0]
    expected = run("steady", one, tmp_path, "--continue", "omega=0.8:2.2")[1]["folds"]
    curve = run("steady", hardening(0), tmp_path, "--continue", "tones[0]=0.8:2.2", "-o",
                "stability=false")[1]
    assert curve["complete"] and len(curve["folds"]) == len(expected) == 2
    for fold, known in zip(curve["folds"], expected):
        assert fold["tones[0]"] == pytest.approx(known["omega"], abs=1e-4)


# At a fold one motion meets another, of which one is unstable: exponents are of the variational
# flow, which knows nothing of the branch.
@pytest.mark.parametrize("path,values,tones", [
    ("tones[0]", "0.8:2.2", (0.8, 0.37)), ("excitation[0].cos", "0.02:1.2", (1.4, 0.37)),
    ("excitation[0].cos", "1.2:0.02", (1.4, 0.37)),
    ("effects[0].coefficient", "0.01:2", (1.4, 0.37))])
def test_a_branch_of_tones_changes_its_stability_at_its_folds(path, values, tones, tmp_path):
    curve = run("steady", hardening(0.1, tones), tmp_path, "--continue", f"{path}={values}", "-o",
                "target.error=1e-5")[1]
    points, folds = curve["points"], [fold[path] for fold in curve["folds"]]
    assert curve["complete"] and all(point["converged"] for point in points) and len(folds) == 2
    stable = [point["stability"]["stable"] for point in points]
    turns = [n for n in range(1, len(stable)) if stable[n] is not stable[n - 1]]
    value = [point["value"] for point in points]
    assert stable[0] is stable[-1] is True and None not in stable and len(turns) == 2
    for n, fold in zip(turns, folds):
        near = value[max(0, n - 2):n + 2]
        assert min(abs(v - fold) for v in near) <= 2 * np.ptp(near)
    assert value[-1] == float(values.split(":")[1])
    outer = range(turns[0] + 1, turns[1] - 1)          # on the way back
    assert all((value[n + 1] - value[n]) * (value[-1] - value[0]) < 0 for n in outer)


# Where places are known to a hundredth of themselves, two of them tell no direction of a branch to
# better than that.
def test_a_branch_goes_on_where_its_places_are_known_to_a_hundredth(tmp_path):
    scene = oscillator([{"type": "gap", "dof": "x", "stiffness": 2, "clearance": 0.2}], [0.8, 1.4])
    curve = run("steady", scene, tmp_path, "--continue", "tones[1]=1.4:1.45", "-o",
                "target.error=1e-4", "-o", "stability=false")[1]
    assert curve["complete"] and curve["points"][-1]["value"] == 1.45
    assert max(point["total_error"] for point in curve["points"]) > 1e-3


def test_a_branch_that_begins_nowhere_says_so(tmp_path):
    status, said = run("steady", hardening(0.1), tmp_path, "--continue", "tones[1]=0.8:0.9")
    assert status == 0 and not said["complete"] and "set out" in said["reason"]
    status, said = run("steady", hardening(0.1), tmp_path, "--continue", "tones[2]=0.8:0.9")
    assert status == 2 and said["error"]["field"] == "continue"


def test_a_map_over_a_tone_and_an_amplitude_is_that_of_its_points(tmp_path):
    scene = oscillator(SPRING, [0.7, 0.7 * GOLDEN], 0.2)
    document = {"verb": "steady", "scene": scene, "options": {"stability": False},
                "grid": [{"path": "steady.tones[1]", "values": [1.0, 1.3]},
                         {"path": "excitation[0].cos", "values": [0.1, 0.2]}]}
    points = run("sweep", document, tmp_path)[1]["points"]
    assert len(points) == 4 and all(p["converged"] for p in points)
    scene["steady"]["tones"][1], scene["excitation"][0]["cos"] = 1.3, 0.1
    t = np.linspace(0, 200, 300)
    alone = run("steady", scene, tmp_path)[1]
    assert np.abs(motion(points[2], t) - motion(alone, t)).max() < 1e-9


@pytest.mark.parametrize("sweep", ["omega=1:2:3", "tones[2]=1:2:3", "tones[1]=-1:2:3",
                                   "tones[0]=1:2:3", "excitation[9].cos=1:2:3"])
def test_a_sweep_over_what_is_no_tone_is_refused(sweep, tmp_path):
    scene = oscillator(SPRING, [0.7, 1])
    free = sweep.startswith("tones[0]")
    if free:
        scene["excitation"] = scene["excitation"][1:]
    status, said = run("steady", scene, tmp_path, "--sweep", sweep,
                       *(["-o", "tones=free,1"] if free else []))
    assert status == 2 and said["error"]["code"] == "bad_input"
    assert said["error"]["field"].startswith("sweep")


def test_what_balanced_before_a_set_grew_too_large_is_the_answer_with_its_error(tmp_path):
    """A strong cubic between two masses of four: growth ends at some 300 combinations."""
    M = np.diag([0.0196, 0.0118, 0.00205, 0.00719])
    C = [[0.0044, -0.000409, 0, 0], [-0.000409, 0.00257, -0.000616, 0],
         [0, -0.000616, 0.00262, -0.00174], [0, 0, -0.00174, 0.00268]]
    K = [[1, -0.223, 0, 0], [-0.223, 0.559, -0.336, 0], [0, -0.336, 1.28, -0.946],
         [0, 0, -0.946, 0.946]]
    tones = [1, 2 ** 0.5]
    scene = {"structure": {"type": "matrices", "M": M.tolist(), "C": C, "K": K,
                           "dofs": ["x0", "x1", "x2", "x3"]},
             "effects": [{"type": "cubic_spring", "dof": "x1", "to": "x3",
                          "coefficient": 0.0198}],
             "excitation": [{"dof": "x2", "k": [1, 0], "cos": 1},
                            {"dof": "x2", "k": [0, 1], "cos": 0.834, "sin": -0.13}],
             "steady": {"tones": tones, "stability": False}}
    result = run("steady", scene, tmp_path)[1]
    assert result["converged"] and result["diagnostics"][0]["code"] == "target_not_met"
    each = lambda t, d: np.array([motion({**result, "harmonics": [h]}, np.array([t]), d)[0]
                                  for h in result["harmonics"]])

    def rate(t, y):
        x, v = y[:4], y[4:]
        f = np.array([0, -0.0198 * (x[1] - x[3]) ** 3, math.cos(t) + 0.834 * math.cos(tones[1] * t)
                      - 0.13 * math.sin(tones[1] * t), 0.0198 * (x[1] - x[3]) ** 3])
        return np.concatenate([v, (f - C @ v - K @ x) / M.diagonal()])
    C, K = np.array(C), np.array(K)
    marched = solve_ivp(rate, (0, 60), np.concatenate([each(0, 0), each(0, 1)]), "DOP853",
                        [40, 50, 60], rtol=1e-9, atol=1e-9).y[:4].T
    most = max(np.abs(x).max() for x in marched)
    for t, x in zip([40, 50, 60], marched):
        assert np.abs(x - each(t, 0)).max() <= 3 * result["total_error"] < 0.05 * most


def test_ten_cubic_springs_of_a_chain_are_balanced_within_the_work_allowed(tmp_path):
    scene = {"structure": {"type": "chain", "masses": [1] * 10, "springs": [1] * 10 + [0],
                           "dampers": [0.05] * 10 + [0]},
             "effects": [{"type": "cubic_spring", "dof": f"x{i + 1}", "coefficient": 0.3}
                         for i in range(10)],
             "excitation": [{"dof": "x1", "k": [1, 0], "cos": 0.3},
                            {"dof": "x6", "k": [0, 1], "cos": 0.3}],
             "steady": {"tones": [0.5, 0.5 * GOLDEN], "stability": False}}
    result = run("steady", scene, tmp_path, "-o", "target.error=1e-3")[1]
    assert result["converged"] and result["diagnostics"] == []
    t, left = np.linspace(0, 300, 300), 0
    x, v, a = ([motion({**result, "harmonics": [h]}, t, d) for h in result["harmonics"]]
               for d in range(3))
    for i in range(10):
        force = 0.3 * np.cos(0.5 * t) * (i == 0) + 0.3 * np.cos(0.5 * GOLDEN * t) * (i == 5)
        for j in [i - 1, i + 1]:
            if j < 10:
                other = x[j] if j >= 0 else 0 * t
                rate = v[j] if j >= 0 else 0 * t
                force += (other - x[i]) + 0.05 * (rate - v[i])
        left = max(left, np.abs(a[i] + 0.3 * x[i] ** 3 - force).max())
    assert left < 0.02 * 0.3


def chain_of_laws(effect, n):
    """N unit masses, springs between them and to the ground, EFFECT at each; loads on the last and
    on the middle."""
    K = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    K[-1, -1] = 1
    tones = [0.8, 0.8 * GOLDEN]
    return {"structure": {"type": "matrices", "M": np.eye(n).tolist(),
                          "C": (0.02 * K + 0.05 * np.eye(n)).tolist(), "K": K.tolist(),
                          "dofs": [f"x{i}" for i in range(n)]},
            "effects": [{**effect, "dof": f"x{i}"} for i in range(n)],
            "excitation": [{"dof": f"x{i}", "k": k, "cos": 0.4}
                           for i, k in ((n - 1, [1, 0]), (n // 2, [0, 1]))],
            "steady": {"tones": tones}}


# Runge and Kutta's steps from where the motion told is at 0, sliders having followed it for 30
# turns: what it is off by after 30 more is of the order of the error stated.  The target is that of
# each line; MOST bounds all errors, for sliders mostly what lines too many and too small to be told
# are together: 0.68 % with 66 harmonics told, 1.1 % with 36, as the march's own errors come out.
@pytest.mark.skipif(sanitized.SANITIZED, reason="a minute under sanitizers")
@pytest.mark.parametrize("effect,n,most", [
    ({"type": "cubic_spring", "coefficient": 0.3}, 80, 1e-3),
    ({"type": "gap", "stiffness": 1, "clearance": 0.2}, 40, 1e-2),
    ({"type": "gap", "stiffness": 1, "clearance": 0.2}, 128, 1e-3),
    ({"type": "friction", "stiffness": 0.5, "limit": 0.1}, 40, 1.5e-2)])
def test_a_chain_with_a_law_at_each_dof_moves_as_marching_says(effect, n, most, tmp_path):
    scene = chain_of_laws(effect, n)
    result = run("steady", scene, tmp_path, "-o", "target.error=1e-3", "-o", "stability=false")[1]
    C, K = (np.array(scene["structure"][name]) for name in "CK")
    tones, load = scene["steady"]["tones"], np.zeros((2, n))
    load[0, n - 1] = load[1, n // 2] = 0.4
    w = np.array(result["harmonics"][0]["k"]) @ np.array(tones)
    X = np.array([np.array(r["re"]) + 1j * np.array(r["im"]) for r in result["harmonics"]])
    per, turns, z = 120, 30, np.zeros(n)
    h = 2 * np.pi / tones[1] / per

    def forces(x, z):
        if effect["type"] == "cubic_spring":
            return 0.3 * x ** 3
        if effect["type"] == "gap":
            return np.maximum(x - 0.2, 0)
        return np.clip(0.5 * (x - z), -0.1, 0.1)

    def rate(t, y):
        x, v = y
        return np.array([v, np.cos(np.array(tones) * t) @ load - C @ v - K @ x - forces(x, z)])
    for t in np.arange(-per * turns, 1) * h:
        x = (X @ np.exp(1j * w * t)).real
        z = np.clip(z, x - 0.2, x + 0.2)
    y, off = np.array([x, (X @ (1j * w)).real]), 0.0
    for i in range(per * turns):
        a = rate(i * h, y)
        b = rate((i + 0.5) * h, y + h / 2 * a)
        c = rate((i + 0.5) * h, y + h / 2 * b)
        y = y + h / 6 * (a + 2 * b + 2 * c + rate((i + 1) * h, y + h * c))
        z = np.clip(z, y[0] - 0.2, y[0] + 0.2)
        told = (X @ np.exp(1j * w * (i + 1) * h)).real
        off = max(off, np.abs(y[0] - told).max())
    largest = np.abs(X).sum(1).max()
    assert result["converged"] and result["total_error"] < most * largest
    assert result["line_error"] <= 1e-3 * largest
    assert off <= 3 * result["total_error"]


def test_a_motion_locked_to_its_load_has_no_second_tone(tmp_path):
    result = run("steady", forced_van_der_pol(1.2), tmp_path, "-o", "tones=1.2,free")[1]
    assert not result["converged"] and "locked" in result["diagnostics"][0]["message"]


# Where the load is three times as fast as the oscillator the motion repeats after 3 of its turns,
# 100 turns before its end as well, and after no fewer: DOP853's.
@pytest.mark.parametrize("load", [2, 1])
def test_a_motion_locked_to_a_third_of_its_load_is_told_to_repeat_after_three_turns(load, tmp_path):
    scene = van_der_pol(0.3, omega=3, excitation=[{"dof": "x", "k": 1, "cos": load}])
    rate = lambda t, y: [y[1], load * math.cos(3 * t) + 0.3 * (1 - y[0] ** 2) * y[1] - y[0]]
    turns = np.array([200, 297, 298, 299, 300])
    x = solve_ivp(rate, (0, 200 * math.pi), [0, 0], "DOP853", turns * 2 * math.pi / 3, rtol=1e-10,
                  atol=1e-12).y[0]
    assert abs(x[4] - x[1]) < 1e-6 and abs(x[3] - x[0]) < 1e-3
    assert min(abs(x[4] - x[2]), abs(x[4] - x[3])) > 0.1
    result = run("steady", scene, tmp_path, "-o", "tones=3,free")[1]
    assert not result["converged"] and result["diagnostics"][0]["code"] == "not_converged"
    assert "repeats after 3 turns of the forced tone: it is locked" in (
        result["diagnostics"][0]["message"])


# Order 3 against scipy's DOP853 from settled; omega, where a scene has one as well, is not what
# tones go by.
@pytest.mark.parametrize("more", [{}, {"omega": 1}])
def test_a_tradeoff_of_tones_has_the_errors_of_time_marching(more, tmp_path):
    tones = [0.7, 0.7 * GOLDEN]
    scene = {**oscillator(SPRING, tones), **more}
    status, doc = run("tradeoff steady", scene, tmp_path, "-o", "repetitions=1")
    errors = {str(r["settings"]): r["error"] for r in doc["rungs"]}
    rough = run("steady", scene, tmp_path, "-o", "harmonics=3")[1]
    t = np.linspace(400, 1400, 8000)
    x = solve_ivp(lambda t, y: [y[1], 0.2 * sum(math.cos(w * t) for w in tones) - 0.1 * y[1] - y[0]
                                - SPRING[0]["coefficient"] * y[0] ** 3],
                  (0, 1400), [0, 0], method="DOP853", rtol=1e-10, atol=1e-12, t_eval=t).y[0]
    assert status == 0 and doc["reference"]["method"] == "adaptive"
    assert errors["{'harmonics': 3}"] == pytest.approx(
        np.abs(motion(rough, t) - x).max() / np.abs(x).max(), rel=0.2)
    assert None not in errors.values()
    assert errors["{'target.error': 1e-08}"] < 1e-7 < errors["{'target.error': 0.001}"] < 1e-3


def test_a_tradeoff_takes_no_tone_that_is_free(tmp_path):
    status, said = run("tradeoff steady", {**forced_van_der_pol(1.2), "steady":
                                           {"tones": [1.2, "free"]}}, tmp_path)
    assert status == 2 and said["error"]["field"] == "tones"


def test_more_combinations_than_a_start_has_samples_for_are_balanced(tmp_path):
    scene = oscillator(SPRING, [0.7, 0.7 * GOLDEN])
    errors = [run("steady", scene, tmp_path, "-o", f"harmonics={h}")[1] for h in (7, 8, 9)]
    assert all(e["converged"] for e in errors)
    assert errors[2]["total_error"] < 0.1 * errors[0]["total_error"]


@pytest.mark.parametrize("change,field", [
    ({"steady": {"tones": ["free", "free"]}}, "steady.tones[1]"),
    ({"steady": {"tones": [1, "own"]}}, "steady.tones[1]"),
    ({"steady": {"tones": [1, "free"]},
      "excitation": [{"dof": "x", "k": [0, 1], "cos": 1}]}, "excitation[0]"),
    ({"steady": {"tones": [1, "free"]}, "excitation": []}, "tones"),
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
