"""Structures of many dofs whose matrices are Matrix Market files: the steady state is that of a
condensation and a Newton's method in scipy."""
import json
import os
import pathlib
import subprocess

import numpy
import pytest
import scipy.io
import scipy.sparse
import scipy.sparse.linalg

TOP = pathlib.Path(__file__).resolve().parents[2]
CTL = pathlib.Path(os.environ.get("MODALD_BUILD", TOP / "build")) / "bin" / "modalctl"
pytestmark = pytest.mark.skipif(not CTL.exists(), reason=f"no {CTL}: build first")

OMEGA, CUBIC, HARMONICS, CONTACTS = 0.31, 0.4, 7, 10


def steady(folder, scene, *args):
    (folder / "scene.json").write_text(json.dumps(scene))
    done = subprocess.run([CTL, "--local", "--json", "steady", folder / "scene.json", *args],
                          capture_output=True, text=True, timeout=300)
    return done.returncode, json.loads(done.stdout)


def springs(n, free):
    ends = numpy.full(n, 2.0)
    ends[[0, -1]] -= free
    return scipy.sparse.diags([ends, -numpy.ones(n - 1), -numpy.ones(n - 1)], [0, 1, -1])


def structure(folder, rows, columns, free):
    """A chain or a membrane, numbered at random: M, K, C, the dofs of the contacts, and one
    more."""
    across, along = springs(columns, free), springs(rows, free)
    K = scipy.sparse.kron(scipy.sparse.eye(rows), across)
    if rows > 1:
        K = K + scipy.sparse.kron(along, scipy.sparse.eye(columns))
    random, n = numpy.random.RandomState(7), rows * columns
    order = random.permutation(n)
    K = scipy.sparse.csr_matrix(K)[order][:, order]
    M = scipy.sparse.diags(1 + 0.3 * random.rand(n))
    matrices = {"M": M, "K": K, "C": 0.02 * K + 0.01 * M}
    for name, matrix in matrices.items():
        scipy.io.mmwrite(folder / f"{name}.mtx", scipy.sparse.coo_matrix(matrix), precision=17,
                         symmetry="symmetric" if name != "C" else "general")
    dofs = random.permutation(n)[:CONTACTS + 1]
    return [scipy.sparse.csc_matrix(matrices[name]) for name in "MKC"], dofs


def scene_of(dofs):
    return {"structure": {"type": "matrices", "M": "M.mtx", "K": "K.mtx", "C": "C.mtx"},
            "effects": [{"type": "cubic_spring", "dof": f"x{dof + 1}", "coefficient": CUBIC}
                        for dof in dofs[:-1]], "omega": OMEGA,
            "excitation": [{"dof": f"x{dofs[-1] + 1}", "k": 1, "cos": 3.0},
                           {"dof": f"x{dofs[0] + 1}", "k": 2, "sin": 1.0}],
            "steady": {"harmonics": HARMONICS, "stability": False}}


def condensed(M, K, C, dofs):
    """S_k and p_k of the contacts, and what the loaded linear dof does for them and by itself."""
    n, kept = M.shape[0], dofs[:-1]
    rest = numpy.setdiff1d(numpy.arange(n), kept)
    at, S, p, G, g = numpy.searchsorted(rest, dofs[-1]), [], [], [], []
    for k in range(HARMONICS + 1):
        L = scipy.sparse.csc_matrix(K + 1j * k * OMEGA * C - (k * OMEGA)**2 * M)
        P = numpy.zeros(n, complex)
        P[dofs[-1]], P[dofs[0]] = 3.0 * (k == 1), -1j * (k == 2)
        factors = scipy.sparse.linalg.splu(scipy.sparse.csc_matrix(L[rest][:, rest]))
        Y = factors.solve(L[rest][:, kept].toarray().astype(complex))
        y = factors.solve(P[rest])
        S.append(L[kept][:, kept].toarray() - L[kept][:, rest] @ Y)
        p.append(P[kept] - L[kept][:, rest] @ y)
        G.append(Y[at])
        g.append(y[at])
    return S, p, G, g


def real(X):
    return numpy.concatenate([X[:, :1].real, X[:, 1:].real, X[:, 1:].imag], axis=1).ravel()


def motion(u):
    U = u.reshape(CONTACTS, -1)
    return numpy.concatenate([U[:, :1], U[:, 1:HARMONICS + 1] + 1j * U[:, HARMONICS + 1:]], axis=1)


def residual(u, S, p):
    X, samples = motion(u), 64
    half = numpy.zeros((CONTACTS, samples // 2 + 1), complex)
    half[:, 0], half[:, 1:HARMONICS + 1] = X[:, 0], X[:, 1:] / 2
    x = numpy.fft.irfft(half * samples, axis=1)
    F = 2 * numpy.fft.rfft(CUBIC * x**3, axis=1)[:, :HARMONICS + 1] / samples
    F[:, 0] /= 2
    return real(numpy.einsum("kij,jk->ik", numpy.array(S), X) + F - numpy.array(p).T)


@pytest.mark.parametrize("rows, columns, free",
                         [(1, 20000, True), (1, 3000, False), (50, 50, True)])
def test_contacts_on_a_sparse_structure_move_as_an_independent_condensation_says(
        tmp_path, rows, columns, free):
    (M, K, C), dofs = structure(tmp_path, rows, columns, free)
    code, answer = steady(tmp_path, scene_of(dofs))
    assert code == 0 and answer["converged"], answer
    X = {row["dof"]: numpy.array(row["re"]) + 1j * numpy.array(row["im"])
         for row in answer["harmonics"]}
    S, p, G, g = condensed(M, K, C, dofs)
    found = numpy.array([X[f"x{dof + 1}"] for dof in dofs[:-1]])
    u, step = real(found), 1e-6
    for _ in range(3):
        J = [(residual(u + step * e, S, p) - residual(u - step * e, S, p)) / (2 * step)
             for e in numpy.eye(len(u))]
        u = u - numpy.linalg.solve(numpy.array(J).T, residual(u, S, p))
    assert abs(real(found) - u).max() < 1e-8 * abs(u).max()
    loaded = numpy.array([g[k] - (G[k] * motion(u)[:, k]).sum() for k in range(HARMONICS + 1)])
    assert abs(X[f"x{dofs[-1] + 1}"] - loaded).max() < 1e-8 * abs(loaded).max()


def test_of_many_dofs_those_of_laws_and_loads_are_reported_and_others_where_asked_for(tmp_path):
    (M, K, C), dofs = structure(tmp_path, 1, 2500, True)
    code, answer = steady(tmp_path, scene_of(dofs))
    rows = {row["dof"]: row for row in answer["harmonics"]}
    assert code == 0 and set(rows) == {f"x{dof + 1}" for dof in dofs}
    other = next(dof for dof in range(2500) if dof not in dofs)
    code, asked = steady(tmp_path, scene_of(dofs), "-o", f"dofs=x{other + 1}")
    assert code == 0 and [row["dof"] for row in asked["harmonics"]] == [f"x{other + 1}"]
    rest = numpy.setdiff1d(numpy.arange(2500), dofs[:-1])
    L = scipy.sparse.csc_matrix(K + 1j * OMEGA * C - OMEGA**2 * M)
    P = numpy.zeros(2500, complex)
    P[dofs[-1]] = 3
    X = numpy.array([rows[f"x{dof + 1}"]["re"][1] + 1j * rows[f"x{dof + 1}"]["im"][1]
                     for dof in dofs[:-1]])
    x = scipy.sparse.linalg.spsolve(scipy.sparse.csc_matrix(L[rest][:, rest]),
                                    P[rest] - L[rest][:, dofs[:-1]] @ X)
    first = asked["harmonics"][0]
    found = first["re"][1] + 1j * first["im"][1]
    assert abs(found - x[numpy.searchsorted(rest, other)]) < 1e-8 * abs(x).max()


@pytest.mark.parametrize("text, said", [
    ("1 1 1\n1 1 2\n", "first line"),
    ("%%MatrixMarket matrix coordinate complex general\n1 1 1\n1 1 2 0\n",
     "accepted: coordinate or array"),
    ("%%MatrixMarket matrix coordinate real general\n2 3 1\n1 1 2\n", "accepted: square"),
    ("%%MatrixMarket matrix coordinate real general\n% a comment\n2 2 2\n1 1 2\n3 1 1\n",
     "line 5: (3, 1) is outside"),
    ("%%MatrixMarket matrix coordinate real general\n2 2 2\n1 1 2\n",
     "\"row column value\" is wanted"),
    ("%%MatrixMarket matrix coordinate real general\n1 1 1\n1 1 2\n1 1 2\n", "more entries"),
    ("%%MatrixMarket matrix array real general\n2 2\n1\nx\n", "line 4: a number is wanted"),
    ("%%MatrixMarket matrix coordinate real general\n1 1 1\n1 1 nan\n", "is wanted"),
    ("%%MatrixMarket matrix coordinate real general\n1e300 1e300 1\n", "accepted: square"),
])
def test_a_matrix_market_file_that_is_wrong_is_refused_at_its_key_with_its_line(tmp_path, text,
                                                                                said):
    (tmp_path / "K.mtx").write_text(text)
    scene = {"structure": {"type": "matrices", "M": [[1]], "K": "K.mtx"}, "omega": 1,
             "excitation": [{"dof": "x1", "k": 1, "cos": 1}]}
    code, answer = steady(tmp_path, scene)
    assert code == 2 and answer["error"]["field"] == "structure.K"
    assert said in answer["error"]["message"]


@pytest.mark.parametrize("text, K", [
    ("%%MatrixMarket matrix coordinate integer symmetric\n\n2 2 3\n1 1 5\n2 1 -2\n 2 2\t4\n",
     [[5, -2], [-2, 4]]),
    ("%%MatrixMarket MATRIX Array Real General\n2 2\n5\n-1\n\n-2\n4\n", [[5, -2], [-1, 4]]),
    ("%%MatrixMarket matrix array real symmetric\n2 2\n5\n-2\n4", [[5, -2], [-2, 4]]),
    ("%%MatrixMarket matrix coordinate real general\n2 2 4\n1 1 3\n1 1 2\n1 2 -2\n2 2 4\n",
     [[5, -2], [0, 4]]),
])
def test_every_form_of_a_matrix_market_file_is_the_matrix_it_says(tmp_path, text, K):
    (tmp_path / "K.mtx").write_text(text.replace("MATRIX", "matrix"))
    scene = {"structure": {"type": "matrices", "M": [[1, 0], [0, 2]], "C": [[0.1, 0], [0, 0.1]],
                           "K": "K.mtx"}, "omega": 1.3,
             "excitation": [{"dof": "x1", "k": 1, "cos": 1}]}
    code, answer = steady(tmp_path, scene)
    assert code == 0, answer
    X = numpy.linalg.solve(numpy.array(K) + 0.13j * numpy.eye(2) - 1.69 * numpy.diag([1, 2]),
                           [1, 0])
    found = numpy.array([row["re"][-1] + 1j * row["im"][-1] for row in answer["harmonics"]])
    assert abs(found - X).max() < 1e-13
