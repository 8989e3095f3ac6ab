#!/usr/bin/python3
"""A friction damper under two tones: CPU beside Runge and Kutta's method, which marches until its
spectrum has the same error.

    MODALCTL=build/bin/modalctl tests/bench/bench_tones_march.py [case ..]

Cases: one mass; chains of 8 and 32 masses, a damper at the last; a clamped beam of 2 and of 4
elements with a damper at its tip.  Tones of ratio golden, sqrt 2, 1.01; 1e-4 of the largest motion
asked for.  The march (march_tones.c, compiled, products over bands) begins at rest as ours does; of
steps a turn, turns left out and turns read the cheapest are taken whose worst line is that near;
its lines are least squares under a window at the frequencies of our lines above a tenth of the
error.  That CPU is told beside the march's and not in the ratio, which numpy's reading would be
most of; nor is a second march, without which nobody knows that the first is near enough: one of
half as many steps would be half as much again.  Ours is without a verdict of stability, which no
spectrum has.  What both are compared with is a march of twice as many steps as the finest of these
over three times the turns.  A row: our CPU, the march's and its reading's, the march's over ours,
true worst lines of both and ours stated, as parts of the largest motion; steps a turn, turns out,
turns read.
"""
import os
import pathlib
import resource
import subprocess
import sys
import tempfile
import time
os.environ["OPENBLAS_NUM_THREADS"] = "1"      # before numpy: CPU of one thread
import numpy as np
import bench_tones

ASKED = 1e-4
TRIES = 5                                # of ours: the least counts, for the rest is the machine's
FINER, TURNS, OUT = (1, 2, 4, 8, 16), (128, 256, 512, 1024), (16, 32, 64, 128)   # of steps: times
                                         # the fewest that a march is stable with
RATIOS = {"golden": (1 + 5 ** 0.5) / 2, "sqrt 2": 2 ** 0.5, "1.01": 1.01}
PER = 64                                 # samples of a turn that are read, and lines below half
MOST = 1024                              # steps a turn of a ladder


def chain(n):
    K = np.diag([2.0] * (n - 1) + [1.0])
    K -= np.diag([1.0] * (n - 1), 1) + np.diag([1.0] * (n - 1), -1)
    return np.eye(n), K, n - 1, 0.7 * np.sqrt(np.linalg.eigvalsh(K)[0])


def beam(elements):
    """Length, stiffness and mass 1; deflection and angle of each node."""
    h, n = 1 / elements, 2 * elements
    k = np.array([[12, 6 * h, -12, 6 * h], [6 * h, 4 * h * h, -6 * h, 2 * h * h],
                  [-12, -6 * h, 12, -6 * h], [6 * h, 2 * h * h, -6 * h, 4 * h * h]]) / h ** 3
    m = np.array([[156, 22 * h, 54, -13 * h], [22 * h, 4 * h * h, 13 * h, -3 * h * h],
                  [54, 13 * h, 156, -22 * h], [-13 * h, -3 * h * h, -22 * h, 4 * h * h]]) * h / 420
    M, K = np.zeros((n + 2, n + 2)), np.zeros((n + 2, n + 2))
    for e in range(elements):
        M[2 * e:2 * e + 4, 2 * e:2 * e + 4] += m
        K[2 * e:2 * e + 4, 2 * e:2 * e + 4] += k
    M, K = M[2:, 2:], K[2:, 2:]
    return M, K, n - 2, 0.7 * np.sqrt(np.linalg.eigvals(np.linalg.solve(M, K)).real.min())


CASES = {"one": lambda: chain(1), "chain 8": lambda: chain(8), "chain 32": lambda: chain(32),
         "beam 2": lambda: beam(2), "beam 4": lambda: beam(4)}


def case(name, ratio):
    """A damper half as stiff as the structure there, which slips at two thirds of the loads."""
    M, K, tip, w = CASES[name]()
    static = 1 / np.linalg.inv(K)[tip, tip]
    return dict(n=len(M), M=M, K=K, C=0.02 * w * M + 0.01 / w * K, free=False, tip=tip,
                laws=[[2, tip, -1, 0.5 * static, 0.3]], tones=[w, w * ratio],
                loads=[[tip, [1, 0], 0.45, 0.0], [tip, [0, 1], 0.45, 0.0]])


def ours(a, folder):
    scene = bench_tones.scene_of(a)
    told = [bench_tones.answer(scene, folder, "-o", f"target.error={ASKED}",
                               "-o", "stability=false")[0] for _ in range(TRIES)]
    return told[0], min(r["cost"]["cpu_s"] for r in told)


def march(a, binary, steps, turns):
    """x of the tip, PER a turn, and the CPU of it."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    x = bench_tones.record(a, binary, steps, turns, PER)[:, a["tip"]]
    return x, resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before


def fit(x, w, dt, out, turns):
    """Lines at W of x's TURNS turns from OUT on, at t = 0 of the march."""
    n = np.arange(out * PER, (out + turns) * PER)
    window = np.sin(np.pi * (n - n[0] + 0.5) / len(n)) ** 2
    waves = np.exp(1j * np.outer(n * dt, w))
    A = np.hstack([waves.real, -waves.imag[:, w > 0]]) * window[:, None]
    c = np.linalg.solve(A.T @ A, A.T @ (x[n] * window))
    X = c[:len(w)].astype(complex)
    X[w > 0] += 1j * c[len(w):]
    return X


def fewest(a, binary, size):
    """Steps a turn, a power of two, that do not blow up."""
    steps = PER
    while True:
        x, _ = march(a, binary, steps, 32)
        if np.isfinite(x).all() and np.abs(x).max() < 10 * size:
            return steps
        steps *= 2


def cheapest(a, binary, ladder, w, exact, size):
    """(CPU, error, steps, out, turns) of the cheapest march whose worst line is near enough."""
    best, dt = None, 2 * np.pi / max(a["tones"]) / PER
    for steps in ladder:
        if best is not None and steps * (OUT[0] + TURNS[0]) > best[2] * (best[3] + best[4]):
            break
        x, spent = march(a, binary, steps, OUT[-1] + TURNS[-1])
        for out in OUT:
            for turns in TURNS:
                part = spent * (out + turns) / (OUT[-1] + TURNS[-1])
                if best is not None and part >= best[0] or PER * turns < 3 * len(w):
                    continue
                off = np.abs(fit(x, w, dt, out, turns) - exact).max() / size
                if off <= ASKED:
                    best = part, off, steps, out, turns
    return best


def reading(a, binary, peer, w):
    """CPU of the lines of PEER's march."""
    _, _, steps, out, turns = peer
    x, _ = march(a, binary, steps, out + turns)
    before = time.process_time()
    fit(x, w, 2 * np.pi / max(a["tones"]) / PER, out, turns)
    return time.process_time() - before


def row(name, kind, binary, folder):
    a = case(name, RATIOS[kind])
    result, spent = ours(a, folder)
    w = np.array(result["harmonics"][0]["k"]) @ np.array(result["tones"])
    h = result["harmonics"][a["tip"]]
    X = np.array(h["re"]) + 1j * np.array(h["im"])
    size = np.abs(X).sum()
    keep = (np.abs(X) > ASKED / 10 * size) & (w < 0.4 * PER * max(a["tones"]))
    least = fewest(a, binary, size)
    ladder = [least * finer for finer in FINER if least * finer <= max(MOST, 2 * least)]
    x, _ = march(a, binary, 2 * ladder[-1], 2 * OUT[-1] + 3 * TURNS[-1])
    exact = fit(x, w[keep], 2 * np.pi / max(a["tones"]) / PER, 2 * OUT[-1], 3 * TURNS[-1])
    peer = cheapest(a, binary, ladder, w[keep], exact, size)
    off, stated = np.abs(X[keep] - exact).max() / size, result["line_error"] / size
    tail = "no march of these is that near" if peer is None else (
        f"{1e3 * peer[0]:9.2f} ms + {1e3 * reading(a, binary, peer, w[keep]):.0f}  "
        f"ratio {peer[0] / spent:8.3g}  {peer[1]:.1e}  "
        f"{peer[2]} steps, {peer[3]} + {peer[4]} turns")
    print(f"{name:9s} {kind:7s} {result['method']:7s} {keep.sum():4d} lines "
          f"{1e3 * spent:8.2f} ms {off:.1e} (stated {stated:.1e}) | {tail}", flush=True)


def main():
    with tempfile.TemporaryDirectory() as folder:
        binary = bench_tones.build(pathlib.Path(folder))
        for name in sys.argv[1:] or CASES:
            for kind in RATIOS:
                row(name, kind, binary, folder)


if __name__ == "__main__":
    main()
