#!/usr/bin/python3
"""Lines of one mass under two tones beside a long march, and commensurate tones beside one omega.

    MODALCTL=build/bin/modalctl tests/bench/bench_tones_lines.py [march|omega] [law ..]

march: cubic spring, gap, friction at golden, sqrt 2 and 1.01; our 60 largest lines above 1e-6 of
the motion, the others taken as ours, beside least squares, under a window, of 2,500 turns of Runge
and Kutta's method (march_tones.c) after 500, and its own error: what half as many steps a turn move
it by.  omega: p/q with q at most 5, the greatest difference over a period beside the sum of both
stated errors.
"""
import sys
import tempfile
import numpy as np
import bench_tones

LAWS = {"cubic": [0, 0, -1, 0.5, 0], "gap": [1, 0, -1, 2, 0.2], "friction": [2, 0, -1, 0.5, 0.2]}
RATIOS = {"golden": (1 + 5 ** 0.5) / 2, "sqrt 2": 2 ** 0.5, "1.01": 1.01}
ASKED = {"cubic": (1e-9, 2048), "gap": (1e-6, 1024), "friction": (1e-6, 1024)}  # and steps a turn
PER, OUT, TURNS, LARGEST = 64, 500, 2500, 60
FRACTIONS = [(2, 1), (3, 2), (3, 1), (5, 4), (4, 3), (5, 3), (5, 2), (4, 1), (5, 1)]


def system(law, tones):
    one = np.ones((1, 1))
    return dict(n=1, M=one, C=0.1 * one, K=one, free=False, laws=[LAWS[law]], tones=tones,
                loads=[[0, [1, 0], 0.2, 0.0], [0, [0, 1], 0.2, 0.0]])


def lines_of(x, w, dt):
    """Least squares under a window, which one line's leak falls off fast by."""
    square, right, part = 0, 0, 8192
    for first in range(0, len(x), part):
        n = np.arange(first, min(first + part, len(x)))
        u = (2 * n + 1) / len(x) - 1
        window = np.exp(12.5 * (np.sqrt(1 - u * u) - 1))
        waves = np.exp(1j * np.outer((n + OUT * PER) * dt, w))
        A = np.hstack([waves.real, -waves.imag[:, w > 0]]) * window[:, None]
        square, right = square + A.T @ A, right + A.T @ (window * x[n])
    c = np.linalg.solve(square, right)
    X = c[:len(w)].astype(complex)
    X[w > 0] += 1j * c[len(w):]
    return X


def told_apart(w, X, least, apart):
    """The largest lines above LEAST, none as near to a larger one as APART."""
    keep = np.zeros(len(w), bool)
    for i in np.argsort(-np.abs(X))[:LARGEST]:
        keep[i] = np.abs(X[i]) > least and (np.abs(w[keep] - w[i]) > apart).all()
    return keep


def beside_march(folder, binary):
    for law, (asked, steps) in ASKED.items():
        if sys.argv[2:] and law not in sys.argv[2:]:
            continue
        for kind, ratio in RATIOS.items():
            a = system(law, [0.8, 0.8 * ratio])
            result, _, _ = bench_tones.answer(bench_tones.scene_of(a), folder, "-o",
                                              f"target.error={asked}")
            w, X = bench_tones.lines_of(result)
            X, dt = X[0], 2 * np.pi / max(a["tones"]) / PER
            records = [bench_tones.record(a, binary, s, OUT + TURNS, PER)[OUT * PER:-1, 0]
                       for s in (steps // 2, steps)]
            size = np.abs(records[1]).max()
            keep = told_apart(w, X, 1e-6 * size, 4 * max(a["tones"]) / TURNS)
            t = (np.arange(TURNS * PER) + OUT * PER) * dt
            for i in np.flatnonzero(~keep):
                records = [x - (X[i] * np.exp(1j * w[i] * t)).real for x in records]
            coarse, fine = [lines_of(x, w[keep], dt) for x in records]
            print(f"{law:8s} {kind:7s} {(np.abs(X) > 1e-6 * size).sum():4d} lines above 1e-6, "
                  f"{keep.sum()} told apart, worst off "
                  f"{np.abs(fine - X[keep]).max() / size:.1e}, stated "
                  f"{result['line_error'] / size:.1e}, the march's own "
                  f"{np.abs(fine - coarse).max() / size:.1e}, CPU {result['cost']['cpu_s']:.3f} s",
                  flush=True)


def beside_omega(folder, _):
    for law in sys.argv[2:] or LAWS:
        for p, q in FRACTIONS:
            two = bench_tones.scene_of(system(law, [0.8, 0.8 * p / q]))
            one = {**two, "steady": {}, "omega": 0.8 / q}
            one["excitation"] = [{**load, "k": k} for load, k in zip(two["excitation"], (q, p))]
            target = f"target.error={1e-11 if law == 'cubic' else 1e-6}"
            a, b = (bench_tones.answer(scene, folder, "-o", target)[0] for scene in (one, two))
            t = np.linspace(0, 2 * np.pi * q / 0.8, 500)
            rows = a["harmonics"][0]
            x = np.exp(1j * np.outer(t, np.array(rows["k"]) * a["omega"])) @ (
                np.array(rows["re"]) + 1j * np.array(rows["im"]))
            w, X = bench_tones.lines_of(b)
            off = (x - np.exp(1j * np.outer(t, w)) @ X[0]).real
            if any(d["code"].startswith("undet") for d in a["diagnostics"] + b["diagnostics"]):
                off -= off.mean()
            stated = a["total_error"] + b["total_error"]
            print(f"{law:8s} {p}/{q} apart {np.abs(off).max() / np.abs(x).max():.1e}, over both "
                  f"errors stated {np.abs(off).max() / stated:.2g}", flush=True)


def main():
    with tempfile.TemporaryDirectory() as folder:
        binary = bench_tones.build(folder)
        for part in sys.argv[1:2] or ["march", "omega"]:
            {"march": beside_march, "omega": beside_omega}[part](folder, binary)


if __name__ == "__main__":
    main()
