"""Laws along a direction: in coordinates of which the first is d = sum of weight x, they are laws
on one dof.

With x = T q and w' T = (1, 0, ..) the scene T'MT, T'CT, T'KT, T'p with the law on q1 is the same
system, whatever T's other columns are: both answers must be one motion.  Scenes of many dofs are
held against forces summed here, by numpy, at the harmonics given.
"""

import h5py
import numpy as np
import pytest
from local_scene import call, run

OMEGA = 2.1
WEIGHTS = np.array([0.8, -1.5, 0.6])
T = np.linalg.inv(np.array([WEIGHTS, [0.3, 1.0, -0.2], [-0.5, 0.4, 1.0]]))
M = np.array([[2.0, 0.3, 0], [0.3, 1.5, 0.1], [0, 0.1, 1.0]])
K = np.array([[9.0, -3, 0], [-3, 8, -2], [0, -2, 5]])
C = 0.05 * M + 0.02 * K
LOAD = np.array([1.5, -0.4, 0.7])
LAWS = {
    "spring": {"stiffness": 3.0}, "damper": {"coefficient": 0.7},
    "cubic_spring": {"coefficient": 2.0},
    "polynomial_spring": {"coefficients": [0.5, 0.8, 1.5]},
    "polynomial_damper": {"coefficients": [0.1, 0, 0.6]},
    "friction": {"stiffness": 6.0, "limit": 0.5},
    "iwan": {"stiffnesses": [4.0, 2.0], "limits": [0.3, 0.6]},
    "gap": {"stiffness": 20.0, "clearance": 0.2}, "coulomb": {"limit": 0.2},
    "regularised_coulomb": {"limit": 0.3, "velocity": 0.2},
    "parametric_stiffness": {"stiffness": 1.0, "k": 2, "phase": 0.3},
    "lua": {"source": "function force(t, x, v, memory) return 2 * x * x * x + 0.3 * v end"},
}


def both(law, **more):
    """The scene along WEIGHTS, and the same one in q."""
    where = {"direction": {f"x{i + 1}": w for i, w in enumerate(WEIGHTS)}}
    for change, at in ((np.eye(3), where), (T, {"dof": "x1"})):
        matrices = {name: (change.T @ a @ change).tolist() for name,
                    a in (("M", M), ("C", C), ("K", K))}
        yield {"structure": {"type": "matrices", **matrices}, "omega": OMEGA,
               "effects": [{"type": law, **at, **LAWS[law]}],
               "excitation": [{"dof": f"x{i + 1}", "k": 1, "cos": p} for i,
                              p in enumerate(change.T @ LOAD)], **more}


def harmonics(answer):
    rows = [np.array(row["re"]) + 1j * np.array(row["im"]) for row in answer["harmonics"]]
    return np.array(rows)


@pytest.mark.parametrize("law", LAWS)
def test_a_steady_state_along_a_direction_is_that_of_the_coordinate_and_its_stability_too(
        law, tmp_path):
    along, turned = (run(tmp_path, "steady", scene, "-o", "stability=true") for scene in both(law))
    x, q = harmonics(along), T @ harmonics(turned)
    shared = min(x.shape[1], q.shape[1])
    assert along["converged"] and turned["converged"]
    assert (np.abs(x[:, :shared] - q[:, :shared]).max() <= along["total_error"] + np.abs(T).sum()
            * turned["total_error"] + 1e-9 * np.abs(q).max())
    assert along["stability"]["stable"] == turned["stability"]["stable"]
    assert (along["stability"]["max_multiplier"]
            == pytest.approx(turned["stability"]["max_multiplier"], rel=1e-6))
    assert [e["active"] for e in along["plan"]["effects"]] == [True]


@pytest.mark.parametrize("law", LAWS)
def test_a_motion_along_a_direction_is_that_of_the_coordinate(law, tmp_path):
    records = []
    start = np.array([0.4, -0.2, 0.1])
    for scene, change in zip(both(law), (np.eye(3), T)):
        q = np.linalg.solve(change, start)
        scene["initial"] = {"x": {f"x{i + 1}": v for i, v in enumerate(q)}}
        scene["time"] = {"dt": 0.05, "duration": 12}
        run(tmp_path, "simulate", scene, "-O", tmp_path / "x.h5")
        with h5py.File(tmp_path / "x.h5") as file:
            records.append(file["signals"][:] @ change.T)
    assert np.abs(records[0] - records[1]).max() < 2e-7 * np.abs(records[1]).max()


def test_multipliers_of_a_pulsating_direction_are_those_of_the_coordinate(tmp_path):
    def spectrum(scene):
        del scene["excitation"]
        return np.sort_complex([complex(*z)
                                for z in run(tmp_path, "floquet", scene)["multipliers"]])
    along, turned = map(spectrum, both("parametric_stiffness"))
    assert np.abs(along - turned).max() < 1e-9


def test_a_backbone_along_a_direction_is_that_of_the_coordinate(tmp_path):
    points = []
    for scene, change in zip(both("cubic_spring"), (np.eye(3), T)):
        del scene["excitation"]
        answer = run(tmp_path, "steady", scene, "-o", "backbone=1:0.01:0.2:4")
        points.append([(p["omega"], p["energy"]) for p in answer["points"]])
    energies = [np.array(p)[:, 1] for p in points]
    assert np.interp(np.log(energies[0][1]), np.log(energies[1]),
                     np.array(points[1])[:, 0]) == pytest.approx(points[0][1][0], rel=2e-2)
    assert points[0][0][0] == pytest.approx(np.array(points[1])[0, 0], rel=1e-2)


def test_leaving_a_direction_out_is_the_scene_without_it(tmp_path):
    scene, _ = both("cubic_spring")
    whole = run(tmp_path, "ablate", scene)
    plain = run(tmp_path, "steady", {**scene, "effects": []})
    without = whole["effects"][0]["without"]
    assert whole["effects"][0]["type"] == "cubic_spring"
    assert np.abs(harmonics(without)[:, 1] - harmonics(plain)[:, 1]).max() < 1e-12


def chain(n, effects, **more):
    return {"structure": {"type": "chain", "masses": [1.0] * n, "springs": [50.0] * (n + 1),
                          "dampers": [0.8] * (n + 1)}, "omega": 1.7,
            "effects": effects, "excitation": [{"dof": f"x{n // 3}", "k": 1, "cos": 4.0}], **more}


def test_a_long_chain_with_three_dofs_a_direction_balances_forces_summed_by_numpy(tmp_path):
    n, H, N = 80, 7, 64
    ends = [(i, {i: 1.0, i + 1: -2.0, i + 2: 1.0}) for i in range(0, n - 2, 3)]
    effects = [{"type": "cubic_spring", "coefficient": 40.0,
                "direction": {f"x{j + 1}": w for j, w in d.items()}} for _, d in ends]
    answer = run(tmp_path, "steady", chain(n, effects), "-o", f"harmonics={H}", "-o", "samples=64")
    X, k = harmonics(answer), np.arange(H + 1)
    wave = np.exp(2j * np.pi * np.outer(k, np.arange(N)) / N)
    matrix = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    force = np.zeros((n, H + 1), complex)
    for _, d in ends:
        y = (sum(w * X[j] for j, w in d.items()) @ wave).real
        F = np.fft.rfft(40 * y**3)[:H + 1] * 2 / N
        F[0] /= 2
        for j, w in d.items():
            force[j] += w * F
    residual = force + 50 * matrix @ X + 0.8 * matrix @ X * (1j * 1.7 * k) - X * (1.7 * k)**2
    residual[n // 3 - 1, 1] -= 4
    assert answer["converged"] and np.abs(force).max() > 0.01
    assert np.abs(residual).max() < 1e-8 * np.abs(force).max()


def test_the_long_way_of_simulating_takes_directions_too(tmp_path):
    n = 60
    records = []
    for where in ({"dof": "x9", "to": "x12"}, {"direction": {"x9": 1, "x12": -1}}):
        effects = [{"type": t, **where, **LAWS[t]} for t in ("cubic_spring", "friction", "gap")]
        run(tmp_path, "simulate", chain(n, effects, time={"dt": 0.1, "duration": 20}), "-O",
            tmp_path / "x.h5")
        with h5py.File(tmp_path / "x.h5") as file:
            records.append(file["signals"][:])
    assert np.abs(records[0]).max() > 0.1
    assert np.abs(records[0] - records[1]).max() <= 1e-12 * np.abs(records[0]).max()


def test_rigid_frictions_along_one_line_hold_as_one(tmp_path):
    def scene(*effects):
        return {**next(both("coulomb")), "effects": [{"type": "coulomb", **e} for e in effects]}
    d = {f"x{i + 1}": w for i, w in enumerate(WEIGHTS)}
    one = run(tmp_path, "steady", scene({"direction": d, "limit": 0.2}))
    two = run(tmp_path, "steady", scene({"direction": d, "limit": 0.1},
                                        {"direction": {x: -2 * w for x, w in d.items()},
                                         "limit": 0.05}))
    assert np.abs(harmonics(one) - harmonics(two)).max() < 1e-9


@pytest.mark.parametrize("where, field, says", [
    ({"direction": {}}, "direction", "an object of 1 to 64 weights"),
    ({"direction": ["x1"]}, "direction", "an object of 1 to 64 weights"),
    ({"direction": {"x4": 1}}, "direction.x4", "no dof \"x4\""),
    ({"direction": {"ground": 1}}, "direction.ground", "no dof \"ground\""),
    ({"direction": {"x1": 1, "x2": 0}}, "direction.x2", "a number that is not 0"),
    ({"direction": {"x1": "1"}}, "direction.x1", "a number that is not 0"),
    ({"direction": {"x1": 1e200}}, "direction.x1", "of size 1e-150 to 1e+150"),
    ({"direction": {"x1": 1}, "dof": "x2"}, "direction", "beside `dof` or `to`"),
    ({"direction": {"x1": 1}, "to": "ground"}, "direction", "beside `dof` or `to`"),
    ({"direction": {f"y{i}": 1 for i in range(65)}}, "direction", "has 65 dofs"),
    ({}, "dof", "is missing"),
])
def test_a_direction_that_is_none_is_refused_by_its_name(where, field, says, tmp_path):
    scene = {**next(both("cubic_spring")),
             "effects": [{"type": "cubic_spring", "coefficient": 1, **where}]}
    code, answer = call(tmp_path, "steady", scene)
    assert code == 2
    assert answer["error"]["field"] == f"effects[0].{field}"
    assert says in answer["error"]["message"]
