"""`reduce`: the answer is that of a Craig-Bampton model made in scipy, and its error is told."""
import json
import os
import pathlib
import subprocess

import numpy
import pytest
import scipy.io
import scipy.linalg
import scipy.sparse

TOP = pathlib.Path(__file__).resolve().parents[2]
CTL = pathlib.Path(os.environ.get("MODALD_BUILD", TOP / "build")) / "bin" / "modalctl"
pytestmark = pytest.mark.skipif(not CTL.exists(), reason=f"no {CTL}: build first")

ROWS, COLUMNS, OMEGA = 9, 14, 0.21
LOADED, LAW, SEEN = 30, 75, 101


def modalctl(folder, verb, scene, *args):
    (folder / "scene.json").write_text(json.dumps(scene))
    done = subprocess.run([CTL, "--local", "--json", *verb.split(), folder / "scene.json", *args],
                          capture_output=True, text=True, timeout=300)
    return done.returncode, json.loads(done.stdout)


def membrane(folder, effects, tilt=0.0):
    """A membrane with a consistent mass, one dof with a law, one loaded, one seen."""
    def line(n, a, b):
        return scipy.sparse.diags([numpy.full(n, a), numpy.full(n - 1, b), numpy.full(n - 1, b)],
                                  [0, 1, -1])
    K = (scipy.sparse.kron(scipy.sparse.eye(ROWS), line(COLUMNS, 2.0, -1.0))
         + scipy.sparse.kron(line(ROWS, 2.0, -1.0), scipy.sparse.eye(COLUMNS)))
    M = scipy.sparse.kron(line(ROWS, 2 / 3, 1 / 6), line(COLUMNS, 2 / 3, 1 / 6))
    C = scipy.sparse.lil_matrix(0.02 * K)
    C[5, 5] += 0.3                                  # no modes share this
    K = scipy.sparse.lil_matrix(K)
    K[3, 4] += tilt
    matrices = {"M": M, "K": K, "C": C}
    for name, matrix in matrices.items():
        scipy.io.mmwrite(folder / f"{name}.mtx", scipy.sparse.coo_matrix(matrix), precision=17,
                         symmetry="general")
    scene = {"structure": {"type": "matrices", "M": "M.mtx", "K": "K.mtx", "C": "C.mtx"},
             "omega": OMEGA, "effects": effects, "sensors": [{"dof": f"x{SEEN}"}],
             "excitation": [{"dof": f"x{LOADED}", "k": 1, "cos": 1.0},
                            {"dof": f"x{LAW}", "k": 3, "sin": 0.5}]}
    return scene, [matrices[name].toarray() for name in "MKC"]


def motion(answer):
    return {row["dof"]: numpy.array(row["re"]) + 1j * numpy.array(row["im"])
            for row in answer["harmonics"]}


def apart(one, other):
    """max over time and the dofs of ONE."""
    most, a, b = 0, motion(one), motion(other)
    for dof in a:
        n = max(len(a[dof]), len(b[dof]))
        X = numpy.zeros(n, complex)
        X[:len(a[dof])] += a[dof]
        X[:len(b[dof])] -= b[dof]
        phases = numpy.exp(2j * numpy.pi * numpy.outer(numpy.arange(4 * n), numpy.arange(n)) / 4
                           / n)
        most = max(most, abs((phases @ X).real).max())
    return most


def craig_bampton(matrices, kept, modes):
    """The frequencies of the modes in it, and the kept dofs' motion."""
    M, K, C = matrices
    rest = numpy.setdiff1d(numpy.arange(len(M)), kept)
    w2, phi = scipy.linalg.eigh(K[numpy.ix_(rest, rest)], M[numpy.ix_(rest, rest)])
    T = numpy.zeros((len(M), len(kept) + modes))
    T[kept, range(len(kept))] = 1
    T[rest, :len(kept)] = -numpy.linalg.solve(K[numpy.ix_(rest, rest)], K[numpy.ix_(rest, kept)])
    T[rest, len(kept):] = phi[:, :modes]
    X = numpy.zeros((len(kept), 4), complex)
    for k, dof, P in (1, LOADED, 1.0), (3, LAW, -0.5j):
        L = T.T @ (K + 1j * k * OMEGA * C - (k * OMEGA)**2 * M) @ T
        X[:, k] = numpy.linalg.solve(L, T.T[:, dof - 1] * P)[:len(kept)]
    return numpy.sqrt(w2), X


@pytest.mark.parametrize("modes", [1, 7, 30, 123])
def test_a_reduced_linear_answer_is_that_of_an_independent_craig_bampton_model(tmp_path, modes):
    scene, matrices = membrane(tmp_path, [])
    code, answer = modalctl(tmp_path, "steady", scene, "-o", f"reduce={modes}", "-o",
                            "dofs=x30,x101")
    assert code == 0 and answer["converged"], answer
    kept = [LOADED - 1, LAW - 1, SEEN - 1]
    frequencies, X = craig_bampton(matrices, kept, modes)
    plan = answer["plan"]["reduction"]
    assert (plan["kept"], plan["modes"]) == (3, modes)
    assert plan["highest"] == pytest.approx(frequencies[modes - 1], rel=1e-9)
    if modes < 123:
        assert plan["next"] == pytest.approx(frequencies[modes], rel=1e-9)
    else:
        assert plan["next"] is None
    found = motion(answer)
    assert list(found) == ["x30", "x101"]
    for dof, row in ("x30", 0), ("x101", 2):
        assert abs(found[dof] - X[row]).max() < 1e-8 * abs(X).max()


LAWS = {"cubic": {"type": "cubic_spring", "coefficient": 0.5},
        "gap": {"type": "gap", "stiffness": 1.0, "clearance": 0.1},
        "friction": {"type": "friction", "stiffness": 1.0, "limit": 0.05}}


@pytest.mark.parametrize("law", LAWS)
def test_the_error_told_of_a_reduction_is_the_one_it_has(tmp_path, law):
    scene, _ = membrane(tmp_path, [{**LAWS[law], "dof": f"x{LAW}"}])
    words = ["-o", "harmonics=15", "-o", "stability=false"]
    whole = modalctl(tmp_path, "steady", scene, *words)[1]
    assert whole["converged"]
    for modes in 3, 10, 30, 60, 123:
        code, answer = modalctl(tmp_path, "steady", scene, *words, "-o", f"reduce={modes}")
        assert code == 0 and answer["converged"], answer
        assert set(motion(answer)) == {"x30", "x75", "x101"}     # those kept, unasked
        made, told = apart(answer, whole), answer["reduction_error"]
        assert made <= 3 * told + 1e-10 and told <= 30 * made + 1e-10, (modes, made, told)
        assert answer["total_error"] >= told
        coarse = "reduction_coarse" in [d["code"] for d in answer["diagnostics"]]
        assert coarse == (modes < 123), (modes, told)


def test_every_point_of_a_curve_tells_the_error_of_its_reduction(tmp_path):
    scene, _ = membrane(tmp_path, [{**LAWS["cubic"], "dof": f"x{LAW}"}])
    for path in "omega=0.15:0.3:4", "effects[0].coefficient=0.1:0.5:3":
        words = ["-o", "harmonics=7", "-o", "stability=false", "--sweep", path]
        whole = modalctl(tmp_path, "steady", scene, *words)[1]["points"]
        curve = modalctl(tmp_path, "steady", scene, *words, "-o", "reduce=20")[1]
        assert curve["plan"]["reduction"]["modes"] == 20
        assert len(curve["points"]) == len(whole)
        for point, exact in zip(curve["points"], whole):
            made = apart(point, exact)
            assert 0 < made <= 3 * point["reduction_error"], (path, point["value"])
            assert point["reduction_error"] <= 30 * made


def test_a_reduction_with_all_modes_starts_where_the_whole_ends(tmp_path):
    scene, _ = membrane(tmp_path, [{**LAWS["cubic"], "dof": f"x{LAW}"}])
    words = ["-o", "harmonics=7", "-o", "stability=false"]
    whole = modalctl(tmp_path, "steady", scene, *words)[1]
    start = {row["dof"]: {key: row[key] for key in ("k", "re", "im")}
             for row in whole["harmonics"]}
    answer = modalctl(tmp_path, "steady", scene, *words, "-o", "reduce=123", "-o",
                      "start=" + json.dumps(start))[1]
    assert answer["iterations"] <= 2                 # it begins where it ends
    assert apart(answer, whole) < 1e-10


def test_tradeoff_has_reductions_as_rungs_with_the_errors_they_have(tmp_path):
    n = 30
    scene = {"structure": {"type": "chain", "masses": [1] * n, "springs": [1] * (n + 1),
                           "dampers": [0.6] * (n + 1)}, "omega": 0.4,
             "effects": [{"type": "cubic_spring", "dof": "x9", "coefficient": 0.5}],
             "excitation": [{"dof": "x9", "k": 1, "cos": 1.0}, {"dof": "x20", "k": 1, "cos": 1.0}]}
    code, answer = modalctl(tmp_path, "tradeoff steady", scene, "-o", "repetitions=1")
    assert code == 0, answer
    errors = {rung["settings"]["reduce"]: rung["error"] for rung in answer["rungs"]
              if "reduce" in rung["settings"]}
    assert sorted(errors) == [10, 20]                # 28 dofs are left to reduce
    words = ["-o", "harmonics=32", "-o", "stability=false", "-o"]
    whole = modalctl(tmp_path, "steady", scene, *words, "threads=1")[1]
    scale = max(abs(sum(X * numpy.exp(2j * numpy.pi * t * numpy.arange(len(X)))).real)
                for X in motion(whole).values() for t in numpy.linspace(0, 1, 400))
    for modes, error in errors.items():
        reduced = modalctl(tmp_path, "steady", scene, *words, f"reduce={modes}")[1]
        assert error == pytest.approx(apart(reduced, whole) / scale, rel=0.05)


@pytest.mark.parametrize("change, words, field, said", [
    ({}, ["reduce=0"], "reduce", "1"),
    ({}, ["reduce=5", "tones=0.2,0.31"], "reduce", "tones"),
    ({}, ["reduce=5", "backbone=1:0.1:1"], "reduce", "backbone"),
    ({"tilt": 0.5}, ["reduce=5"], "reduce", "symmetric"),
    ({}, ["reduce=5", "dofs=" + ",".join(f"x{i + 1}" for i in range(ROWS * COLUMNS))], "reduce",
     "nothing to reduce"),
])
def test_a_reduction_that_cannot_be_is_refused_by_name(tmp_path, change, words, field, said):
    scene, _ = membrane(tmp_path, [{**LAWS["cubic"], "dof": f"x{LAW}"}], **change)
    code, answer = modalctl(tmp_path, "steady", scene, *sum((["-o", w] for w in words), []))
    assert code == 2 and answer["error"]["code"] == "bad_input", answer
    assert answer["error"]["field"] == field and said in answer["error"]["message"], answer
