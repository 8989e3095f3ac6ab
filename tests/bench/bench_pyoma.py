#!/usr/bin/python3
"""pyOMA2's own example, other draws of its noise: the damping of each mode against subspaces'.

    MODALD_BUILD=build [PYOMA2=FOLDER] tests/bench/bench_pyoma.py [FIRST] [LAST] [data] [-v]

Five storeys of 25.91 kg on springs of 10,000 N/m, the fifth of them on the ground, each mode damped
by 0.02; on each a white force held over a sample, accelerations at 100 Hz, 30,001 of them, with
noise of a tenth of each channel's own.  Ours is told nothing; subspaces are given the order and are
numpy's from 60 covariances (30 block rows, as pyOMA2's example has), with `data` also from the
data, and pyOMA2's own where its folder (that holds pyoma2/) is given.  A mode of theirs is the pole
nearest to the true one.
"""
import os
import sys
import numpy as np
import scipy.linalg
import scipy.signal
from scipy.optimize import linear_sum_assignment
from bench_ambient import run, say, subspaces

STOREYS, ZETA, DT, SAMPLES, NOISE, ROWS = 5, 0.02, 0.01, 30001, 0.1, 30


def building():
    """The discrete system, and the exponents of its modes."""
    n = STOREYS
    K = 10000 / 25.91 * (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    K[0, 0] /= 2                                          # the top storey has one spring
    w2, V = np.linalg.eigh(K)
    C = V @ np.diag(2 * ZETA * np.sqrt(w2)) @ V.T
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-K, -C]])
    B = np.vstack([np.zeros((n, n)), np.eye(n)])
    both = scipy.linalg.expm(np.block([[A, B], [np.zeros((n, 3 * n))]]) * DT)
    return ((both[:2 * n, :2 * n], both[:2 * n, 2 * n:], A[n:], np.eye(n), DT),
            np.sqrt(w2) * (-ZETA + 1j * np.sqrt(1 - ZETA ** 2)))


def record(system, seed):
    rng = np.random.default_rng(seed)
    Y = scipy.signal.dlsim(system, rng.standard_normal((SAMPLES, STOREYS)))[1]
    return Y + NOISE * Y.std(0) * rng.standard_normal(Y.shape)


def from_covariances(Y):
    """Exponents a sample: H = E y(t+a+b+1) y(t)^T, its leading part's shift."""
    l, N = Y.shape[1], len(Y) - 2 * ROWS
    R = [Y[k:k + N].T @ Y[:N] / N for k in range(2 * ROWS)]
    H = np.block([[R[a + b + 1] for b in range(ROWS)] for a in range(ROWS - 1)])
    U, s, _ = np.linalg.svd(H)
    O = U[:, :2 * STOREYS] * np.sqrt(s[:2 * STOREYS])
    return np.log(np.linalg.eigvals(np.linalg.lstsq(O[:-l], O[l:], rcond=None)[0]).astype(complex))


def from_pyoma(Y):
    sys.path[:0] = [os.environ["PYOMA2"]]
    from pyoma2.functions import ssi
    H, _ = ssi.build_hank(Y.T, Y.T, ROWS, "cov")
    A = ssi.SSI_fast(H, ROWS, 2 * STOREYS, step=2 * STOREYS)[1][-1]
    return np.log(np.linalg.eigvals(A).astype(complex))


def damping(found, truth):
    """The damping ratio of each true mode; NaN: not found."""
    found, zeta = np.asarray(found), np.full(len(truth), np.nan)
    if len(found):
        for k, i in zip(*linear_sum_assignment(abs(truth[:, None] - found))):
            zeta[k] = -found[i].real / abs(found[i])
    return zeta


def ours(Y):
    return [complex(*m["exponent"]) for m in run(Y, DT)["modes"]]


def ways():
    """Name and way to exponents, 1/s."""
    yield "ours", ours
    yield "numpy's subspaces from covariances", lambda Y: from_covariances(Y) / DT
    if "data" in sys.argv:
        yield "numpy's subspaces from the data", lambda Y: subspaces(Y, ROWS, 2 * STOREYS) / DT
    if "PYOMA2" in os.environ:
        yield "pyOMA2", lambda Y: from_pyoma(Y) / DT


def many(first, last, verbose):
    system, truth = building()
    errors = {name: [] for name, _ in ways()}
    orders = 0
    for seed in range(first, last):
        Y = record(system, seed)
        for name, way in ways():
            found = way(Y)
            orders += name == "ours" and len(found) == STOREYS
            errors[name].append(damping(found, truth) - ZETA)
        if verbose:
            print(seed, {name: np.round(e[-1], 4).tolist() for name, e in errors.items()},
                  flush=True)
    square = {name: np.nanmean(np.square(e), 0) for name, e in errors.items()}
    say("five modes found", orders / (last - first), n=last - first)
    for name, e in errors.items():
        for k in range(STOREYS):
            say(f"damping of mode {k + 1}: root mean square error, {name}",
                np.sqrt(square[name][k]), missed=int(np.isnan(np.array(e)[:, k]).sum()))
            if name != "ours":
                say(f"damping of mode {k + 1}: our mean squared error over that of {name}",
                    square["ours"][k] / square[name][k])


if __name__ == "__main__":
    numbers = [int(x) for x in sys.argv[1:] if x.isdigit()]
    many(numbers[0] if numbers else 0, numbers[1] if len(numbers) > 1 else 100, "-v" in sys.argv)
