"""Structures for scenes from matrices: dense or sparse, from files, whole or reduced.

    K, M, dofs = modald.scene.calculix("beam.sti", "beam.mas", "beam.dof")
    small = modald.scene.craig_bampton(M, K, keep=["12.3", "40.3"], modes=10, dofs=dofs)
    result = client.steady({"structure": small.structure, "omega": w, "effects": [...]})

Sparse matrices and files need scipy.  Units are the user's, one consistent system.
"""
from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any, Sequence

import numpy as np
import numpy.typing as npt

from .link import Error

Matrix = Any                # numpy array or scipy.sparse matrix, square


def _names(count: int, dofs: Sequence[str] | None) -> list[str]:
    names = [f"x{i + 1}" for i in range(count)] if dofs is None else [str(name) for name in dofs]
    if len(names) != count or len(set(names)) != count:
        raise Error("bad_input", f"{len(names)} names, {len(set(names))} of them different, for "
                    f"{count} dofs; accepted: one name each", "dofs")
    return names


def _square(matrix: Matrix, name: str, count: int | None = None) -> Matrix:
    """As it is where it is sparse, else as an array of float64."""
    if not hasattr(matrix, "tocsr"):
        try:
            matrix = np.asarray(matrix, dtype=float)
        except (TypeError, ValueError) as why:
            raise Error("bad_input", f"{name} is no matrix of real numbers: {why}", name) from why
    shape = matrix.shape
    if len(shape) != 2 or shape[0] != shape[1] or (count is not None and shape[0] != count):
        raise Error("bad_input", f"{name} has shape {tuple(shape)}; accepted: square"
                    + (f", {count} x {count} as M" if count is not None else ""), name)
    return matrix


def matrices(M: Matrix, K: Matrix, C: Matrix | None = None, G: Matrix | None = None, *,
             speed: float | None = None, dofs: Sequence[str] | None = None) -> dict[str, Any]:
    """A structure of M x'' + (C + speed G) x' + K x = p, of numpy or scipy.sparse matrices, shape
    (n, n); `speed` [rad/s] of G; `dofs`: n names, default x1, x2, ..
    """
    count = _square(M, "M").shape[0]
    given = {"M": M, "K": K, "C": C, "G": G}
    out: dict[str, Any] = {"type": "matrices"}
    out.update({name: _square(matrix, name, count) for name, matrix in given.items()
                if matrix is not None})
    if speed is not None:
        out["speed"] = speed
    if dofs is not None:
        out["dofs"] = _names(count, dofs)
    return out


@dataclass
class Reduced:
    """A structure by fewer coordinates: x = `basis` z, `basis` of shape (n, len(dofs)); the first
    of z are the dofs that were kept, under their names, the others q1, q2, .. of the fixed modes at
    `frequencies` [rad/s].
    """

    structure: dict[str, Any]
    basis: npt.NDArray[np.float64]
    dofs: list[str]
    frequencies: npt.NDArray[np.float64]


def craig_bampton(M: Matrix, K: Matrix, keep: Sequence[int | str], modes: int,
                  C: Matrix | None = None, *, dofs: Sequence[str] | None = None) -> Reduced:
    """M and K (and C), shape (n, n), symmetric, by the dofs `keep` (names, or numbers from 0) and
    so many `modes` of the rest with `keep` held: Craig and Bampton's reduction.

    It is exact in statics, and to first order below the highest fixed mode's frequency; keep the
    dofs of laws, loads and sensors.
    """
    M = _square(M, "M")
    count = M.shape[0]
    K = _square(K, "K", count)
    names = _names(count, dofs)
    kept = [_number(dof, names) for dof in keep]
    if len(set(kept)) != len(kept) or not 0 <= modes <= count - len(kept):
        raise Error("bad_input", f"{len(kept)} dofs ({len(set(kept))} different) and {modes} modes "
                    f"of {count}; accepted: different dofs, and as many modes as are left at most",
                    "keep" if len(set(kept)) != len(kept) else "modes")
    rest = np.setdiff1d(np.arange(count), kept)
    values, shapes = _fixed(_part(K, rest, rest), _part(M, rest, rest), modes)
    basis = np.zeros((count, len(kept) + modes))
    basis[kept, np.arange(len(kept))] = 1
    if len(rest) and len(kept):
        basis[np.ix_(rest, np.arange(len(kept)))] = -_solve(_part(K, rest, rest),
                                                            _dense(_part(K, rest, np.array(kept))))
    basis[rest, len(kept):] = shapes
    found = [names[i] for i in kept] + [f"q{i + 1}" for i in range(modes)]
    small: dict[str, Any] = {name: _reduced(basis, _square(matrix, name, count)) for name, matrix
             in (("M", M), ("K", K), ("C", C)) if matrix is not None}
    return Reduced(matrices(**small, dofs=found), basis, found, np.sqrt(np.maximum(values, 0)))


def _number(dof: int | str, names: list[str]) -> int:
    if isinstance(dof, str):
        if dof in names:
            return names.index(dof)
    elif 0 <= int(dof) < len(names):
        return int(dof)
    raise Error("bad_input", f"no dof {dof!r}; accepted: a name of dofs, or 0 to "
                f"{len(names) - 1}", "keep")


def _part(matrix: Matrix, rows: Any, columns: Any) -> Matrix:
    return (matrix.tocsr()[rows, :][:, columns] if hasattr(matrix, "tocsr")
            else matrix[np.ix_(rows, columns)])


def _dense(matrix: Matrix) -> npt.NDArray[np.float64]:
    return np.asarray(matrix.todense() if hasattr(matrix, "tocsr") else matrix, dtype=float)


def _reduced(basis: npt.NDArray[np.float64], matrix: Matrix) -> npt.NDArray[np.float64]:
    """Symmetric to the last bit where the matrix is."""
    product = basis.T @ np.asarray(matrix @ basis)
    symmetric = abs(matrix - matrix.T).max() == 0
    return np.asarray((product + product.T) / 2 if symmetric else product)


def _solve(K: Matrix, right: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    try:
        if hasattr(K, "tocsr"):
            from scipy.sparse.linalg import splu
            return np.asarray(splu(K.tocsc()).solve(right))
        return np.linalg.solve(K, right)
    except (RuntimeError, np.linalg.LinAlgError) as why:
        raise Error("bad_input", f"K of what is not kept is singular: {why}; keep the dofs that "
                    "hold it", "keep") from why


def _fixed(K: Matrix, M: Matrix, modes: int) -> tuple[npt.NDArray[np.float64],
                                                      npt.NDArray[np.float64]]:
    """The lowest so many of K y = w^2 M y: w^2, and y of unit modal mass."""
    count = M.shape[0]
    try:
        if hasattr(K, "tocsr") and hasattr(M, "tocsr") and 0 < modes < count - 1:
            from scipy.sparse.linalg import eigsh
            values, shapes = eigsh(K.tocsc(), modes, M.tocsc(), sigma=0.0)
            order = np.argsort(values)
            return values[order], shapes[:, order]
        lower = np.linalg.inv(np.linalg.cholesky(_dense(M))) if count else np.zeros((0, 0))
        values, shapes = np.linalg.eigh(lower @ _dense(K) @ lower.T)
        return values[:modes], (lower.T @ shapes)[:, :modes]
    except (RuntimeError, np.linalg.LinAlgError) as why:
        raise Error("bad_input", f"M and K of what is not kept have no modes: {why}; accepted: M "
                    "positive definite, K not singular", "M") from why


def _scipy(what: str) -> Any:
    try:
        import scipy.io
        import scipy.sparse
    except ImportError as why:
        raise Error("bad_input", f"{what} needs scipy (Debian package python3-scipy)",
                    "scipy") from why
    return scipy


def matrix_market(path: str | os.PathLike[str]) -> Matrix:
    """A matrix from a file of Matrix Market: scipy.sparse CSR, or an array where it is dense."""
    scipy = _scipy("matrix_market")
    try:
        found = scipy.io.mmread(os.fspath(path))
    except (OSError, ValueError, IndexError, OverflowError, StopIteration) as why:
        raise Error("bad_input", f"{os.fspath(path)}: {why or 'cut short'}", "file") from why
    return found.tocsr() if hasattr(found, "tocsr") else found


def calculix(stiffness: str | os.PathLike[str], mass: str | os.PathLike[str],
             dofs: str | os.PathLike[str] | None = None) -> tuple[Matrix, Matrix, list[str] | None]:
    """K, M (scipy.sparse, shape (n, n)) and the names of dofs ("NODE.DIRECTION") that CalculiX
    writes as .sti, .mas and .dof with *FREQUENCY, SOLVER=MATRIXSTORAGE.
    """
    scipy = _scipy("calculix")
    K, M = (_triangle(scipy, path) for path in (stiffness, mass))
    if K.shape != M.shape:
        count = max(K.shape[0], M.shape[0])
        K.resize((count, count))
        M.resize((count, count))
    if dofs is None:
        return K, M, None
    try:
        with open(dofs, encoding="ascii") as file:
            names = file.read().split()
    except (OSError, ValueError) as why:
        raise Error("bad_input", f"{os.fspath(dofs)}: {why}", "file") from why
    if len(names) != M.shape[0]:
        raise Error("bad_input", f"{os.fspath(dofs)}: {len(names)} names for {M.shape[0]} dofs",
                    "dofs")
    return K, M, names


def _triangle(scipy: Any, path: str | os.PathLike[str]) -> Matrix:
    """Lines `i j value` from 1, one of each pair of a symmetric matrix."""
    try:
        with open(path, encoding="ascii") as file:
            numbers = np.array(file.read().split(), dtype=float)
    except (OSError, ValueError) as why:
        raise Error("bad_input", f"{os.fspath(path)}: {why}", "file") from why
    table = numbers[:len(numbers) // 3 * 3].reshape(-1, 3)
    whole = (table[:, :2] >= 1).all() and (table[:, :2] % 1 == 0).all()
    if not len(table) or len(numbers) % 3 or not whole or not np.isfinite(table).all():
        raise Error("bad_input", f"{os.fspath(path)}: accepted: lines of row, column (from 1) and "
                    "value", "file")
    i, j = table[:, 0].astype(int) - 1, table[:, 1].astype(int) - 1
    value, count = table[:, 2], int(table[:, :2].max())
    if count > len(table):                              # each dof has its diagonal
        raise Error("bad_input", f"{os.fspath(path)}: row {count} in {len(table)} lines; it is cut "
                    "short, or no matrix of CalculiX", "file")
    one = scipy.sparse.coo_matrix((value, (i, j)), shape=(count, count)).tocsr()
    if abs(one - one.T).max() == 0:                     # both of each pair, or only a diagonal
        return one
    return (one + one.T - scipy.sparse.diags(one.diagonal())).tocsr()
