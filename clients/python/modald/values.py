"""Numbers as Python has them, as JSON: numpy arrays and scalars, sparse matrices, paths."""
from __future__ import annotations

import os
from typing import Any

import numpy as np
import numpy.typing as npt

COMPLEX = "complex numbers have no place in a scene or in options; accepted: real numbers"


def csr(matrix: Any) -> tuple[tuple[int, int], list[npt.NDArray[Any]]]:
    """Shape of a scipy.sparse matrix, and row pointers, columns and values as they stand behind a
    scene's text.
    """
    if np.iscomplexobj(matrix.data if hasattr(matrix, "data") else matrix):
        raise TypeError(COMPLEX)
    rows = matrix.tocsr().copy()
    rows.sum_duplicates()
    if not np.isfinite(rows.data).all():
        raise ValueError("a sparse matrix has an entry that is not finite")
    return rows.shape, [rows.indptr.astype("<u4"), rows.indices.astype("<u4"),
                        rows.data.astype("<f8")]


def plain(value: Any) -> Any:
    """What `json` does not know: an array as nested lists, a scipy.sparse matrix as the compressed
    rows that a scene takes, a path as its text.  TypeError for anything else, complex numbers too.
    """
    if hasattr(value, "tocsr"):
        rows = value.tocsr().copy()
        rows.sum_duplicates()
        parts = {"shape": list(rows.shape), "row_pointers": rows.indptr,
                 "columns": rows.indices, "values": rows.data}
        return {name: plain(np.asarray(part)) for name, part in parts.items()}
    if isinstance(value, (np.ndarray, np.generic)):
        if np.iscomplexobj(value):
            raise TypeError(COMPLEX)
        return value.tolist()
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if isinstance(value, (set, frozenset, bytes)) or not hasattr(value, "__iter__"):
        raise TypeError(f"{value!r} has no form in JSON")
    return list(value)
