"""contact_bed beside the same contacts listed one by one, and beside its law summed by numpy."""
# Tests as well: contact_bed.c at_rest.c

import h5py
import numpy as np
import pytest
from local_scene import call, harmonics, run

LAW = {"normal_stiffness": 300.0, "preload": 20.0, "tangential_stiffness": 200.0, "mu": 0.4}
AREA = 0.5


def strip(nodes, effects, push=60.0, **more):
    """Nodes in a row, each with a normal and a tangential dof, n1, t1, n2, .., held by springs to
    the next and to the ground."""
    n = 2 * nodes
    K = np.diag(np.full(n, 1500.0)) - np.diag(np.full(n - 2, 400.0),
                                              2) - np.diag(np.full(n - 2, 400.0), -2)
    return {"structure": {"type": "matrices", "M": sparse(np.eye(n)), "K": sparse(K),
                          "C": sparse(0.02 * K + 0.3 * np.eye(n)),
                          "dofs": [f"{c}{i + 1}" for i in range(nodes) for c in "nt"]},
            "omega": 9.0, "effects": effects,
            "excitation": [{"dof": f"t{i + 1}", "k": 1, "cos": push / (1 + i % 3)}
                           for i in range(nodes)]
            + [{"dof": f"n{i + 1}", "k": 1, "sin": 12.0} for i in range(0, nodes, 2)], **more}


def sparse(a):
    where = [np.flatnonzero(row) for row in a]
    return {"shape": list(a.shape),
            "row_pointers": np.cumsum([0] + [len(w) for w in where]).tolist(),
            "columns": np.concatenate(where).tolist(),
            "values": np.concatenate([row[w] for row, w in zip(a, where)]).tolist()}


def bed(nodes, **more):
    return [{"type": "contact_bed", **LAW,
             "nodes": [{"normal": f"n{i + 1}", "tangential": f"t{i + 1}", "area": AREA}
                       for i in range(nodes)], **more}]


def one_by_one(nodes):
    per_area = {key: value if key == "mu" else AREA * value for key, value in LAW.items()}
    return [{"type": "contact_friction", "normal": f"n{i + 1}", "tangential": f"t{i + 1}",
             **per_area} for i in range(nodes)]


@pytest.mark.parametrize("nodes", [1, 20, 100, 400])
def test_a_bed_is_the_contacts_listed_one_by_one(nodes, tmp_path):
    words = ("-o", "harmonics=3", "-o", "stability=false")
    as_one, listed = (run(tmp_path, "steady", strip(nodes, effects), *words)
                      for effects in (bed(nodes), one_by_one(nodes)))
    assert as_one["converged"] == listed["converged"] is True
    # it slips
    assert np.array_equal(harmonics(as_one),
                          harmonics(listed)) and np.abs(harmonics(listed)[1, 3]) > 0
    row, = as_one["plan"]["effects"]
    assert row["type"] == "contact_bed" and row["active"]
    assert (row["states"] == nodes and row["evaluations"]
            == sum(e["evaluations"] for e in listed["plan"]["effects"]))


def test_a_bed_moves_as_the_contacts_listed_one_by_one(tmp_path):
    records = []
    for effects in (bed(8), one_by_one(8)):
        run(tmp_path, "simulate", strip(8, effects, time={"dt": 0.01, "duration": 2}), "-O",
            tmp_path / "x.h5")
        with h5py.File(tmp_path / "x.h5") as file:
            records.append(file["signals"][:])
    assert np.array_equal(*records) and np.abs(records[0]).max() > 0.01


def clip(f, bound):
    return np.minimum(np.maximum(f, -bound), bound)


def test_two_tangentials_share_one_normal_force_and_each_has_a_slider(tmp_path):
    """The law marched by numpy along the motion of the answer's own dofs: nothing but the masses'
    balance is asked of the answer."""
    weights = {"normal": {"a3": -1, "b3": 1},
               "tangential": [{"a1": 1, "b1": -1}, {"a2": 1, "b2": -1}]}
    K, M = np.array([900.0, 1100, 1300, 800, 700, 1000]), np.array([1.0, 1, 1, 2, 2, 2])
    dofs = ["a1", "a2", "a3", "b1", "b2", "b3"]
    C, load = 0.03 * K, {"a1": 90.0, "a2": 70.0, "b3": 8.0}
    scene = {"structure": {"type": "matrices", "M": np.diag(M).tolist(), "K": np.diag(K).tolist(),
                           "C": np.diag(C).tolist(), "dofs": dofs}, "omega": 20.0,
             "effects": [{"type": "contact_bed", **LAW, "nodes": [{**weights, "area": AREA}]}],
             "excitation": [{"dof": d, "k": 1, "cos": p} for d, p in load.items()]}
    H, N = 31, 1 << 15
    X = harmonics(run(tmp_path, "steady", scene, "-o", f"harmonics={H}"))
    x = (X @ np.exp(2j * np.pi * np.outer(np.arange(H + 1), np.arange(N)) / N)).real
    d = {"n": x[5] - x[2], "t": x[0] - x[3], "u": x[1] - x[4]}
    normal = np.maximum(0, AREA * (LAW["preload"] + LAW["normal_stiffness"] * d["n"]))
    k, force = AREA * LAW["tangential_stiffness"], {}
    for along in "tu":
        z, f = 0.0, np.empty(N)
        for _ in range(2):
            for i in range(N):
                f[i] = clip(k * (d[along][i] - z), LAW["mu"] * normal[i])
                z = d[along][i] - f[i] / k
        force[along] = f
        # slips and sticks
        assert (np.any(np.abs(f) >= LAW["mu"] * normal * (1 - 1e-12))
                and np.any(np.abs(f) < 0.5 * LAW["mu"] * normal))
    on = np.array([force["t"], force["u"], -normal, -force["t"], -force["u"], normal])
    F = np.fft.rfft(on)[:, :H + 1] * 2 / N
    F[:, 0] /= 2
    w = 20.0 * np.arange(H + 1)
    residual = F + X * (K[:, None] + 1j * w * C[:, None] - w**2 * M[:, None])
    residual[:, 1] -= [load.get(dof, 0) for dof in dofs]
    # N samples of a force with kinks: some of 1 / N^2
    assert np.abs(residual).max() < 1e-5 * np.abs(F).max()


def test_a_node_s_own_numbers_stand_in_place_of_the_bed_s(tmp_path):
    nodes = [{"normal": "n1", "tangential": ["t1"], "preload": 7.0, "mu": 0.1},
             {"normal": "n2", "tangential": {"t2": 2.0}, "normal_stiffness": 90.0,
              "tangential_stiffness": 70.0, "area": 2.0}]
    listed = [{"type": "contact_friction", "normal": "n1", "tangential": "t1", **LAW,
               "preload": 7.0, "mu": 0.1},
              {"type": "contact_friction", "normal": "n2", "tangential": {"t2": 2.0},
               "normal_stiffness": 180.0, "preload": 40.0, "tangential_stiffness": 140.0,
               "mu": 0.4}]
    answers = [run(tmp_path, "steady", strip(2, effects), "-o", "harmonics=7")
               for effects in ([{"type": "contact_bed", **LAW, "nodes": nodes}], listed)]
    assert np.array_equal(*map(harmonics, answers))


def test_two_beds_of_which_one_never_slips_are_told_apart(tmp_path):
    first, second = bed(3)[0], bed(6)[0]
    second = {**second, "nodes": second["nodes"][3:], "mu": 1e3}
    answer = run(tmp_path, "steady", strip(6, [first, second]), "-o", "harmonics=3")
    assert [e["active"] for e in answer["plan"]["effects"]] == [True, False]


def by_hand(scene, spring=0.0, level=0.0, friction=0.0):
    """Mean and first harmonic, with a spring and a load at each normal dof and a spring at each
    tangential one."""
    n, nodes = scene["structure"]["M"]["shape"][0], scene["structure"]["M"]["shape"][0] // 2
    K = np.diag(np.full(n, 1500.0)) - np.diag(np.full(n - 2, 400.0),
                                              2) - np.diag(np.full(n - 2, 400.0), -2)
    C = 0.02 * K + 0.3 * np.eye(n)
    K += np.diag([spring, friction] * nodes)
    p, load = np.array([-level, 0.0] * nodes), np.zeros(n, complex)
    for e in scene["excitation"]:
        load[scene["structure"]["dofs"].index(e["dof"])] += e.get("cos", 0) - 1j * e.get("sin", 0)
    return np.column_stack([np.linalg.solve(K, p),
                            np.linalg.solve(K + 9j * C - 81 * np.eye(n), load)])


@pytest.mark.parametrize("more, held",
                         [({"preload": -50.0}, {}),
                          ({}, {"spring": 150.0, "level": 10.0, "friction": 100.0})],
                         ids=["open", "closed"])
def test_a_bed_that_stays_open_or_closed_is_its_springs_and_each_law_is_asked_once(more, held,
                                                                                   tmp_path):
    nodes = 150
    scene = strip(nodes, bed(nodes, **more), push=1.0)
    answer = run(tmp_path, "steady", scene)
    X = by_hand(scene, **held)
    assert np.abs(harmonics(answer)[:, :2] - X).max() < 1e-13 * np.abs(X).max() * nodes
    assert answer["plan"]["effects"][0]["active"] is False
    # a bound tells: nothing is sampled, transformed or iterated
    assert answer["plan"]["effects"][0]["evaluations"] == nodes
    assert answer["plan"]["ffts"] == answer["iterations"] == 0
    assert answer["total_error"] == 0 and answer["residual"] < 1e-12
    assert [d["code"] for d in answer["diagnostics"] if d["code"]
            == "undetermined_offset"] == (["undetermined_offset"] if held else [])


def test_the_first_contact_that_slips_is_not_missed(tmp_path):
    held = {"spring": 150.0, "level": 10.0, "friction": 100.0}
    active = []
    scene = strip(4, bed(4), push=1.0)
    X = by_hand(scene, **held)
    # no less holds at any time: mu N
    least = 0.4 * (10.0 + 150.0 * (X[::2, 0].real - np.abs(X[::2, 1])))
    share = (100.0 * np.abs(X[1::2, 1]) / least).max()                   # of it that push = 1 takes
    assert 0 < share < 1
    for push in (0.9 / share, 40 / share):
        answer = run(tmp_path, "steady", strip(4, bed(4), push=push), "-o", "harmonics=5")
        assert answer["converged"]
        active.append(answer["plan"]["effects"][0]["active"])
    assert active == [False, True]


def test_motions_at_rest_and_others_are_of_one_sweep(tmp_path):
    """As the frequency comes up to resonance a contact begins to slip, and past it rests again."""
    scene = {"structure": {"type": "chain", "masses": [1.0], "springs": [100.0, 0],
                           "dampers": [0.4, 0]}, "omega": 10.0,
             "effects": [{"type": "friction", "dof": "x1", "stiffness": 1.25, "limit": 0.0625}]
             * 16, "excitation": [{"dof": "x1", "k": 1, "cos": 2.0}]}
    swept = run(tmp_path, "steady", scene, "--sweep", "omega=8:14:13", "-o",
                "harmonics=9")["points"]
    methods = {p["method"] for p in swept}
    assert "linear" in methods and len(methods) > 1
    for p in swept:
        alone = run(tmp_path, "steady", {**scene, "omega": p["omega"]}, "-o", "harmonics=9", "-o",
                    "method=newton")
        assert np.abs(harmonics(p) - harmonics(alone)).max() < 1e-9


GAP = {"structure": {"type": "chain", "masses": [1], "springs": [100, 0], "dampers": [0.4, 0]},
       "excitation": [{"dof": "x1", "cos": 1.0}], "omega": 11.5,
       "effects": [{"type": "gap", "dof": "x1", "stiffness": 12.5, "clearance": 0.05}] * 16}


def test_all_motions_are_found_beside_one_at_rest_with_the_harmonics_that_contact_has(tmp_path):
    """Between its folds, at 10.93 and 12.04, the curve of a gap has three; one stays clear of the
    stop."""
    found = run(tmp_path, "steady", GAP, "-o", "solutions=all", "-o",
                "stability=false")["solutions"]
    amplitudes = sorted(np.abs(harmonics(one)[0, 1]) for one in found)
    assert len(found) == 3 and all(one["H"] >= 8 for one in found)
    assert amplitudes[0] == pytest.approx(1 / abs(100 - 11.5**2 + 0.4j * 11.5),
                                          rel=1e-9) and amplitudes[1] > 0.05


def test_a_curve_that_sets_out_at_rest_has_the_harmonics_that_contact_has(tmp_path):
    curve = run(tmp_path, "steady", GAP, "--continue", "omega=8:14", "-o", "stability=false")
    assert max(p["H"] for p in curve["points"]) >= 8
    assert len(curve["folds"]) == 2


def test_nodes_that_couple_too_many_dofs_are_refused_before_anything_is_solved(tmp_path):
    wide = {f"{c}{i + 1}": 1.0 for i in range(32) for c in "nt"}
    code, answer = call(tmp_path, "steady",
                        strip(32, [{"type": "contact_bed", **LAW,
                                    "nodes": [{"normal": wide, "tangential": wide}] * 1300}]))
    assert (code == 2 and answer["error"]["code"] == "too_large" and "couplings of dofs by laws"
            in answer["error"]["message"])


NODE = {"normal": "n1", "tangential": "t1"}


@pytest.mark.parametrize("nodes, field, says", [
    ([], "nodes", "a list of 1 to 20000 objects"),
    ([NODE] * 20001, "nodes", "at most 20000"),
    ([NODE, {"normal": "n1"}], "nodes[1].tangential", "is missing"),
    ([{**NODE, "normal": "n9"}], "nodes[0].normal", "no dof \"n9\""),
    ([{**NODE, "normal": 3}], "nodes[0].normal", "the name of a dof, or an object"),
    ([{**NODE, "tangential": []}], "nodes[0].tangential", "one or two"),
    ([{**NODE, "tangential": ["t1", "t1", "t1"]}], "nodes[0].tangential", "one or two"),
    ([{**NODE, "tangential": ["t1", "t9"]}], "nodes[0].tangential[1]", "no dof \"t9\""),
    ([{**NODE, "tangential": ["t1", {"n1": 0}]}], "nodes[0].tangential[1].n1",
     "a number that is not 0"),
    ([{**NODE, "area": -1}], "nodes[0].area", "m^2"),
    ([{**NODE, "slip": 1}], "nodes[0].slip", "unknown key"),
])
def test_what_is_no_node_is_refused_by_its_place(nodes, field, says, tmp_path):
    code, answer = call(tmp_path, "steady",
                        strip(2, [{"type": "contact_bed", **LAW, "nodes": nodes}]))
    assert code == 2
    assert answer["error"]["field"] == f"effects[0].{field}"
    assert says in answer["error"]["message"]


def test_of_a_hundred_contacts_one_is_timed_for_the_plan(tmp_path):
    n = 100
    answer = run(tmp_path, "steady", {
        "structure": {"type": "chain", "masses": [1] * n, "springs": [1] * (n + 1),
                      "dampers": [0.03] * (n + 1)}, "omega": 0.3,
        "effects": [{"type": "gap", "dof": f"x{i + 1}", "stiffness": 1.0, "clearance": 1e3}
                    for i in range(n)],
        "excitation": [{"dof": "x1", "k": 1, "cos": 0.5}], "steady": {"stability": False}})
    rows = answer["plan"]["effects"]
    assert len(rows) == n and not any(row["active"] for row in rows)
    assert len({row["seconds"] / row["evaluations"] for row in rows}) == 1
