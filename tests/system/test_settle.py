"""Steady motions that harmonic balance does not reach from afar, beside the orbit that Newton's
method closes on the map of a period made here: Runge and Kutta's fixed steps in numpy, which know
nothing of harmonics, events or pieces of laws."""
# Tests as well: settle.c

import json
import pathlib

import numpy as np
import pytest
import sanitized
from local_scene import harmonics, run

SCENES = pathlib.Path(__file__).parents[1] / "data" / "steady"


class Period:
    """The map of (x, v, forces of sliders) over a period, of many states at once."""

    def __init__(self, scene, steps):
        m = scene["structure"]
        self.Minv, self.C, self.K = (np.linalg.inv(m["M"]), np.array(m["C"]), np.array(m["K"]))
        self.n, self.omega, self.steps, self.load = (len(self.Minv), scene["omega"], steps,
                                                     scene["excitation"])
        self.effects = [(e, self.across(e)) for e in scene["effects"]]
        self.sliders = [(e, i) for e, i in self.effects if e["type"] == "friction"]
        self.states = 2 * self.n + len(self.sliders)

    def across(self, effect):
        """The row that takes displacements to what the effect sees."""
        row = np.zeros(self.n)
        row[int(effect["dof"][1:]) - 1] = 1
        if "to" in effect:
            row[int(effect["to"][1:]) - 1] = -1
        return row

    def held(self, x, before, force):
        return np.array([np.clip(f + e["stiffness"] * (row @ x - row @ before), -e["limit"],
                                 e["limit"])
                         for (e, row), f in zip(self.sliders, force)]).reshape(force.shape)

    def rate(self, t, y, before, force):
        x, v = y[:self.n], y[self.n:]
        f = -self.K @ x - self.C @ v
        for row in self.load:
            i, phase = int(row["dof"][1:]) - 1, row["k"] * self.omega * t
            f[i] += row["cos"] * np.cos(phase) + row.get("sin", 0) * np.sin(phase)
        for e, row in self.effects:
            d, rate, pushed = row @ x, row @ v, 0 * (row @ x)
            if e["type"] == "gap":
                into = np.maximum(d - e["clearance"], 0)
                pushed = np.maximum(e["stiffness"] * into * (1 + e.get("dissipation", 0) * rate), 0)
            if e["type"] == "parametric_stiffness":
                pushed = e["stiffness"] * np.cos(e["k"] * self.omega * t + e["phase"]) * d
            if e["type"] == "cubic_spring":
                pushed = e["coefficient"] * d ** 3
            if e["type"] == "regularised_coulomb":
                pushed = e["limit"] * np.tanh(rate / e["velocity"])
            f -= np.multiply.outer(row, pushed)
        for (e, row), g in zip(self.sliders, self.held(x, before, force)):
            f -= np.multiply.outer(row, g)
        return np.concatenate([v, self.Minv @ f])

    def __call__(self, u):
        """P(u) of the columns of u, and the displacements of the first on the way."""
        y, force, h, path = (u[:2 * self.n].copy(), u[2 * self.n:].copy(),
                             2 * np.pi / self.omega / self.steps, [])
        for j in range(self.steps):
            t, x = j * h, y[:self.n].copy()
            path.append(x[:, 0])
            a = self.rate(t, y, x, force)
            b = self.rate(t + h / 2, y + h / 2 * a, x, force)
            c = self.rate(t + h / 2, y + h / 2 * b, x, force)
            d = self.rate(t + h, y + h * c, x, force)
            y = y + h / 6 * (a + 2 * b + 2 * c + d)
            force = self.held(y[:self.n], x, force)
        return np.concatenate([y, force]), np.array(path).T

    def orbit(self, u, size, rounds=4):
        """The displacements of the orbit that is closed from u, what it leaves open, and its
        multipliers, by differences that are small beside SIZE, how far it goes: where nothing
        holds a body, where it is may be far more."""
        slope = np.zeros((self.states, self.states))
        for _ in range(rounds):
            unit = np.where(np.abs(u) > 0, size, 1) * 1e-6
            end, path = self(np.column_stack([u, u[:, None] + np.diag(unit)]))
            left = end[:, 0] - u
            slope = (end[:, 1:] - end[:, :1]) / unit
            if np.abs(left).max() < 1e-8 * np.abs(u).max():
                break
            u = u + np.linalg.lstsq(np.eye(self.states) - slope, left, rcond=1e-6)[0]
        return path, np.abs(left).max() / np.abs(u).max(), np.linalg.eigvals(slope)


def answered(tmp_path, scene, steps, *words):
    """The answer, its displacements, and the orbit from its state at t = 0, as `Period.orbit` has
    it."""
    answer = run(tmp_path, "steady", scene, *words)
    assert answer["converged"], answer["diagnostics"]
    return closed(answer, scene, steps)


def closed(answer, scene, steps):
    """As answered, of an ANSWER."""
    X, period = harmonics(answer), Period(scene, steps)
    k = np.arange(X.shape[1])
    turns = np.exp(2j * np.pi * np.outer(k, np.arange(steps)) / steps)
    x, force = (X @ turns).real, np.zeros(len(period.sliders))
    # what sliders hold, from a period before
    for j in range(2 * steps):
        force = period.held(x[:, j % steps], x[:, j % steps - 1], force)
    start = np.concatenate([X.sum(axis=1).real, (1j * scene["omega"] * X @ k).real, force])
    return answer, x, *period.orbit(start, np.ptp(x, axis=1).max())


def from_rest(scene, answer, steps, periods):
    """The displacements of an ANSWER, those of the last of so many periods from rest, and how far
    these are from the period before."""
    period, X = Period(scene, steps), harmonics(answer)
    u, marched = np.zeros((period.states, 1)), 0
    for _ in range(periods):
        before = marched
        u, marched = period(u)
    x = (X @ np.exp(2j * np.pi * np.outer(np.arange(X.shape[1]), np.arange(steps)) / steps)).real
    return x, marched, np.abs(marched - before).max()


def first_found(tmp_path, scene, tries):
    """What rounding decides: the first answer of scenes that differ by less than it, none of which
    may say that a motion is one where it is none."""
    for i in range(tries):
        near = {**scene, "omega": scene["omega"] * (1 + 1e-13 * i)}
        answer = run(tmp_path, "steady", near, "-o", "stability=true")
        if answer["converged"]:
            return answer
    raise AssertionError(answer["diagnostics"])


@pytest.mark.parametrize("name, steps", [("random_scene_47", 4096), ("random_scene_12", 4096),
                                         ("random_scene_3", 8192), ("stiff_slider", 8192),
                                         ("free_body_on_a_stop", 4096)])
def test_what_the_balance_does_not_reach_from_rest_is_found_in_time(tmp_path, name, steps):
    """A gap that is always closed beside a pulsating spring; one that closes at rest; a free body
    between stops held by a slider; a slider a thousand times as stiff as its spring; a free body
    beside a pulsating spring, which nothing keeps from going far and back, so that what it does not
    come back by is little beside where it is."""
    if sanitized.SANITIZED and steps > 4096:
        pytest.skip("what takes long is numpy's march")
    scene = json.loads((SCENES / f"{name}.json").read_text())
    answer, x, path, left, multipliers = closed(first_found(tmp_path, scene, 8), scene, steps)
    largest = np.abs(multipliers).max()
    if any(row["code"] == "undetermined_mean" for row in answer["diagnostics"]):
        x, path = x - x.mean(axis=1, keepdims=True), path - path.mean(axis=1, keepdims=True)
    assert left < 1e-7
    assert np.abs(path).max() > 0.05                                     # a motion, and no rest
    assert np.abs(x - path).max() < 2 * answer["total_error"] + 1e-5 * np.abs(path).max()
    assert answer["total_error"] < 1e-3 * np.abs(path).max()
    assert abs(answer["stability"]["max_multiplier"] - largest) < 0.02 * largest + 0.05
    assert answer["stability"]["stable"] is (None if abs(largest - 1) < 0.01 else bool(largest < 1))


@pytest.mark.parametrize("count", [15, 25, 47])
def test_a_contact_that_its_harmonics_do_not_resolve_has_the_error_and_multipliers_it_says(
        tmp_path, count):
    """A mass on soft ground is thrown far off and meets a stiff stop: so few harmonics balance with
    a contact at other instants, which called this unstable motion stable and its error half."""
    scene = {"structure": {"type": "matrices", "M": [[0.809]], "K": [[0.001]], "C": [[0.0486]]},
             "omega": 0.15, "steady": {"harmonics": count, "stability": True},
             "effects": [{"type": "gap", "dof": "x1", "stiffness": 6.27, "clearance": 0.0879,
                          "dissipation": 0.423}],
             "excitation": [{"dof": "x1", "k": 1, "cos": 3.9224, "sin": 0.0}]}
    answer, x, path, left, multipliers = answered(tmp_path, scene, 4096)
    largest = np.abs(multipliers).max()
    assert left < 1e-7
    assert np.abs(x - path).max() < 1.5 * answer["total_error"]
    assert abs(answer["stability"]["max_multiplier"] - largest) < 0.01 * largest
    assert answer["stability"]["stable"] is False


@pytest.mark.skipif(sanitized.SANITIZED, reason="what takes long is numpy's march")
def test_a_motion_that_time_comes_to_is_not_called_unstable_for_its_series(tmp_path):
    """A stiff slider, a stop and a pulsating spring: 31 harmonics balance 8 % off the motion, and
    with a multiplier of 4.6 that is truly 0.31."""
    scene = json.loads((SCENES / "random_scene_171091.json").read_text())
    answer = run(tmp_path, "steady", scene)
    x, marched, left = from_rest(scene, answer, 2048, 12)
    assert left < 1e-5 * np.abs(marched).max()                          # it attracts
    assert np.abs(x - marched).max() < 1.5 * answer["total_error"]
    assert answer["stability"]["stable"] is True


# Of each random scene displacements at t = 0, T/4, T/2, 3T/4, by dof: what RK4's steps whose ends
# are events come to from rest, until a period repeats to 2e-12; with twice the steps they change in
# the ninth digit.
MARCHED = {
    "random_scene_231111": [
        [1.04119112068398, -0.239955783643668, -6.26031081823568, -0.766348233014574],
        [0.986512621943861, -0.150859727973782, -3.5374289248631, -0.817615945050049]],
    "random_scene_231031": [
        [-0.2343178803737524, -0.2377877762206349, -0.23954496189715072, -0.2360520123163066],
        [-0.23613720117686043, -0.23721887206958125, -0.23769363995038736, -0.23665298524568926],
        [-0.24822030607917714, -0.23303015225377852, -0.2260836494321426, -0.24036161509480033],
        [-0.23407647948559193, -0.2500773384030697, -0.24004895322051525, -0.2239105190737092],
        [-0.2296407006923255, -0.243687061116033, -0.2391895191511961, -0.2368490118208309],
        [-0.2427364245767726, -0.22239724084506204, -0.24495561111560143, -0.23725301762403855]],
    "random_scene_221095": [
        [113.84727200261212, 117.36770847865658, 116.2642607411735, 114.74255356052194],
        [113.81998418360727, 117.28036262874518, 116.3523699770212, 114.8550967420967]],
}


def off(answer, name):
    """How far an ANSWER is from the march of NAME, but for a mean that it says is free, and the
    latter's span."""
    X, marched = harmonics(answer), np.array(MARCHED[name])
    away = (X @ 1j ** np.outer(np.arange(X.shape[1]), np.arange(4))).real - marched
    if any(row["code"] == "undetermined_mean" for row in answer["diagnostics"]):
        away -= away.mean()
    return np.abs(away).max(), np.ptp(marched, axis=1).max()


@pytest.mark.parametrize("name", ["random_scene_231031", "random_scene_231111"])
def test_what_no_way_of_the_balance_leads_to_is_sought_in_time_with_the_rest(tmp_path, name):
    """A free chain that comes to rest away from three stiff stops, where nothing holds it, and two
    masses on soft ground between two: a quarter of the budget does not close what is near, and the
    rest was left unspent."""
    answer = run(tmp_path, "steady", json.loads((SCENES / f"{name}.json").read_text()))
    assert answer["converged"], answer["diagnostics"]
    far, span = off(answer, name)
    assert far < 1.5 * answer["total_error"] + 1e-7 * span
    assert (name == "random_scene_231031") is any(row["code"] == "undetermined_mean"
                                                  for row in answer["diagnostics"])
    assert answer["total_error"] < 0.02 * span
    assert answer["work"]["spent"] < answer["work"]["allowed"]


@pytest.mark.parametrize("count", [15, 16])
def test_a_motion_of_too_few_harmonics_to_march_from_is_no_wrong_one(tmp_path, count):
    """Two masses on soft ground between sliders: a period marched from what so few harmonics say
    goes far, and none closes from there, though the motion is there; with 16 it is ten times
    further off than an error of first order says."""
    name = "random_scene_221095"
    scene = json.loads((SCENES / f"{name}.json").read_text())
    answer = run(tmp_path, "steady", scene, "-o", f"harmonics={count}")
    assert answer["converged"], answer["diagnostics"]
    far, span = off(answer, name)
    assert far < 2 * answer["total_error"] < 0.4 * span
    assert answer["stability"]["stable"]


def test_a_motion_that_settles_after_hundreds_of_periods_is_found(tmp_path):
    """A free body: in time it takes 500 periods, and no balance leads to it from rest."""
    scene = json.loads((SCENES / "settles_after_hundreds_of_periods.json").read_text())
    answer, x, path, left, multipliers = answered(tmp_path, scene, 2048)
    assert left < 1e-7
    assert np.abs(multipliers).max() < 1 and answer["stability"]["stable"]
    assert np.abs(x - path).max() < 2 * answer["total_error"] + 1e-4 * np.abs(path).max()


def test_a_motion_that_attracts_is_given_for_an_unstable_one(tmp_path):
    """A free body's motion near rest repeats but is unstable; from rest it goes to another, far
    away, within 30 periods."""
    scene = json.loads((SCENES / "attracted_far_from_rest.json").read_text())
    answer = run(tmp_path, "steady", scene, "-o", "stability=true")
    x, marched, _ = from_rest(scene, answer, 256, 40)
    assert answer["converged"] and answer["stability"]["stable"] is not False
    assert np.abs(x - marched).max() < 2 * answer["total_error"] + 1e-3 * np.abs(marched).max()


@pytest.mark.parametrize("stiffness", [1e4])
def test_a_stiff_slider_moves_as_friction_without_stiffness_does(tmp_path, stiffness):
    """Two programs for one motion: what sticks bends by limit / stiffness, and no more is between
    them."""
    scene = json.loads((SCENES / "stiff_slider.json").read_text())
    rigid = json.loads(json.dumps(scene))
    rigid["effects"] = [{"type": "coulomb", "dof": "x1", "limit": 0.6}]
    scene["effects"][0]["stiffness"] = stiffness
    soft, hard = (run(tmp_path, "steady", s, "-o", "harmonics=63") for s in (scene, rigid))
    turns = np.exp(2j * np.pi * np.outer(np.arange(64), np.arange(512)) / 512)
    apart = np.abs(((harmonics(soft) - harmonics(hard)) @ turns).real).max()
    assert soft["converged"]
    assert apart < soft["total_error"] + hard["total_error"] + 5 * 0.6 / stiffness


def test_a_body_that_friction_cannot_hold_is_no_periodic_motion(tmp_path):
    """Its mean load is above the slider's limit: it goes on and on, and an answer that closes would
    be a wrong one."""
    scene = {"structure": {"type": "matrices", "M": [[1.0]], "K": [[0.0]], "C": [[0.1]]},
             "omega": 1.0,
             "effects": [{"type": "friction", "dof": "x1", "stiffness": 10.0, "limit": 0.3}],
             "excitation": [{"dof": "x1", "k": 1, "cos": 1.0}, {"dof": "x1", "k": 0, "cos": 0.5}]}
    assert not run(tmp_path, "steady", scene)["converged"]
