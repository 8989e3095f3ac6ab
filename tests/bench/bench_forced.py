#!/usr/bin/python3
"""Forced responses of random systems, simulated by scipy, against the Cramer-Rao bound.

    MODALD_BUILD=build tests/bench/bench_forced.py [count] [seed] [records]

Each record: 2 to 8 modes (two in five with a pair 2 % apart, 5 % for one response), damping 0.2 to
5 %, 1 to 8 responses (displacements, velocities or accelerations), 1 to 3 inputs (random, sweeps,
or 1 to 5 hits each), 1000 to 4000 samples, an initial state, white noise of 1 to 10 %.  The bound
is that of complex shapes and drives, initial state and direct terms unknown.  A mode is detectable
where its bound is at most 30 % of its damping; pooled are those found of at most 15 %, with
errors; what has none (a fit that did not converge) is counted.  `records`:
each is two to six hammer records of 400 to 1200 samples and one to three hits, put one after
another, each with an initial state and, with its noise, a level of its own, told by `starts`.
"""
import json
import os
import subprocess
import sys
import tempfile
import numpy as np
import scipy.signal as signal

CTL = os.path.join(os.environ.get("MODALD_BUILD", "build"), "bin", "modalctl")
DT, DETECTABLE, POOLED, ASTRAY = 0.01, 0.3, 0.15, 8


def matrices(rng, modes, responses, inputs):
    f = np.sort(rng.uniform(0.02, 0.7, modes) * 0.5 / DT)
    if rng.random() < 0.4:
        k = rng.integers(0, modes - 1)
        f[k + 1] = f[k] * (1.02 if responses > 1 else 1.05)
    w, zeta = 2 * np.pi * f, 10 ** rng.uniform(np.log10(0.002), np.log10(0.05), modes)
    shape, part = rng.standard_normal((responses, modes)), rng.standard_normal((modes, inputs))
    A, B = np.zeros((2 * modes, 2 * modes)), np.zeros((2 * modes, inputs))
    C, D, sensor = np.zeros((responses, 2 * modes)), np.zeros((responses, inputs)), rng.integers(3)
    for p in range(modes):
        A[2 * p:2 * p + 2, 2 * p:2 * p + 2] = [[0, 1], [-w[p] ** 2, -2 * zeta[p] * w[p]]]
        B[2 * p + 1] = part[p]
        if sensor == 0:
            C[:, 2 * p] = shape[:, p] * w[p] ** 2
        elif sensor == 1:
            C[:, 2 * p + 1] = shape[:, p] * w[p]
        else:
            C[:, 2 * p:2 * p + 2] = np.outer(shape[:, p], A[2 * p + 1, 2 * p:2 * p + 2])
            D += np.outer(shape[:, p], part[p])
    x0 = rng.standard_normal(2 * modes) * 0.03 * rng.uniform()
    x0[0::2] *= np.abs(part).max(1) / w ** 2 / np.maximum(zeta, 0.01)
    x0[1::2] *= np.abs(part).max(1) / w / np.maximum(zeta, 0.01)
    return (A, B, C, D), x0, -zeta * w + 1j * w * np.sqrt(1 - zeta ** 2)


def excitation(rng, samples, inputs, kind):
    t = np.arange(samples) * DT
    if kind == 0:
        return rng.standard_normal((samples, inputs))
    if kind == 1:
        ends = [(0.3, 40), (40, 0.3), (1, 30)]
        return np.stack([signal.chirp(t, a, t[-1], b) for a, b in ends[:inputs]], 1)
    u = np.zeros((samples, inputs))
    for j in range(inputs):
        for at in rng.integers(0, int(0.8 * samples), rng.integers(1, 6)):
            length = rng.integers(2, 6)
            u[at:at + length - 1, j] += 10 * np.sin(np.pi * np.arange(1, length) / length)
    return u


def bound(system, lam, u, clean, sigma, starts=(0,)):
    """Of Re and Im of each exponent, by the lines of the transform but the mean; records that begin
    at `starts` are one with a jump of the state at each."""
    N, (responses, inputs), modes = len(u), system[3].shape, len(lam)
    Ad, Bd, Cd, _, _ = signal.cont2discrete(system, DT, method="foh")
    values, V = np.linalg.eig(Ad)
    at = [np.argmin(abs(values - r)) for r in np.exp(lam * DT)]
    r, shape, part = values[at], (Cd @ V)[:, at], np.linalg.solve(V, Bd)[at]
    n = np.arange(1, (N - 1) // 2 + 1)
    z = np.exp(2j * np.pi * n / N)[:, None]
    U, Y = (np.fft.fft(x, axis=0)[n] / np.sqrt(N) for x in (u, clean))

    def columns(drive, poles, where):
        """Of a complex unknown: its real and imaginary part."""
        a, b = np.outer(drive * poles[0], where), np.outer(drive * poles[1], where.conj())
        return [(a + b).ravel(), (1j * (a - b)).ravel()]

    def solve(J, y):
        return np.linalg.lstsq(np.vstack([J.real, J.imag]), np.concatenate([y.real, y.imag]),
                               rcond=None)[0]

    eye, jumps = np.eye(responses), [z[:, 0] ** (1 - s) for s in starts]
    pole = [(1 / (z[:, 0] - x), 1 / (z[:, 0] - x.conj())) for x in r]
    direct = [np.outer(U[:, j], e).ravel() for j in range(inputs) for e in eye]
    states = [c for p in range(modes) for jump in jumps
              for c in columns(jump, pole[p], shape[:, p])]
    moved = sum(np.outer((U @ part[p]) * pole[p][0], shape[:, p])
                + np.outer((U @ part[p].conj()) * pole[p][1], shape[:, p].conj())
                for p in range(modes))
    known = solve(np.array(states + direct).T, (Y - moved).ravel())[:len(states)]
    T, W, J = (known[0::2] + 1j * known[1::2]).reshape(modes, -1), np.column_stack([U] + jumps), []
    for p in range(modes):
        q, (a, b) = np.append(part[p], T[p]), pole[p]
        x, y = (np.outer(W @ d * c * c * e, s) for d, c, e, s in (
            (q, a, r[p], shape[:, p]), (q.conj(), b, r[p].conj(), shape[:, p].conj())))
        J += [(x + y).ravel(), (1j * (x - y)).ravel()]
    for p in range(modes):
        q, (a, b) = np.append(part[p], T[p]), pole[p]
        for e in eye:
            x, y = np.outer(W @ q * a, e).ravel(), np.outer(W @ q.conj() * b, e).ravel()
            J += [x + y, 1j * (x - y)]
        for j in set(range(W.shape[1])) - {int(np.argmax(abs(q)))}:
            J += columns(W[:, j], pole[p], shape[:, p])
    J = np.array(J + direct).T / np.tile(sigma / np.sqrt(2), len(n))[:, None]
    J = np.vstack([J.real, J.imag])
    size = np.linalg.norm(J, axis=0)
    std = np.sqrt(np.diag(np.linalg.inv((J / size).T @ (J / size)))) / size / DT
    return std[0:2 * modes:2], std[1:2 * modes:2]


def simulate(system, x0, u):
    t, responses = np.arange(len(u)) * DT, system[3].shape[0]
    return signal.lsim(system, u, t, X0=x0)[1].reshape(len(u), responses)


def records(seed):
    """Some, and where they begin, in rows."""
    rng = np.random.default_rng(seed)
    modes, responses, inputs = rng.integers(2, 7), rng.integers(1, 7), rng.integers(1, 3)
    system, x0, lam = matrices(rng, modes, responses, inputs)
    lengths = rng.integers(400, 1200, rng.integers(2, 7))
    starts = np.r_[0, np.cumsum(lengths)[:-1]]
    each = [excitation(rng, n, inputs, 2) for n in lengths]
    clean = np.vstack([simulate(system, x0 * rng.standard_normal(), u) for u in each])
    u, sigma = np.vstack(each), 10 ** rng.uniform(-2, -1) * clean.std(0)
    level = np.repeat(rng.standard_normal((len(lengths), responses)), lengths, 0) * sigma
    return u, clean + rng.standard_normal(clean.shape) * sigma + level, lam, \
        bound(system, lam, u, clean, sigma, starts), starts


def record(seed):
    rng = np.random.default_rng(seed)
    modes, responses, inputs = rng.integers(2, 9), rng.integers(1, 9), rng.integers(1, 4)
    samples = int(rng.choice([1000, 2000, 4000]))
    system, x0, lam = matrices(rng, modes, responses, inputs)
    u = excitation(rng, samples, inputs, rng.integers(3))
    clean = simulate(system, x0, u)
    sigma = 10 ** rng.uniform(-2, -1) * clean.std(0) * rng.uniform(0.5, 1.5, responses)
    return u, clean + rng.standard_normal(clean.shape) * sigma, lam, \
        bound(system, lam, u, clean, sigma), [0]


def identify(folder, u, y, starts):
    path = os.path.join(folder, "record.npz")
    np.savez(path, signals=np.hstack([u, y]), dt=DT)
    inputs = "inputs=" + ",".join(map(str, range(u.shape[1])))
    more = ["-o", "starts=" + ",".join("%.10g" % (s * DT) for s in starts[1:])]
    done = subprocess.run([CTL, "--local", "--json", "identify", path, "-o", "response=forced",
                           "-o", inputs] + more * (len(starts) > 1), capture_output=True,
                          text=True, check=True)
    return json.loads(done.stdout)


def main():
    draw = records if "records" in sys.argv else record
    numbers = [int(a) for a in sys.argv[1:] if a.isdigit()]
    count, seed = numbers + [60, 1][len(numbers):]
    squares, within, bars, missed, spurious, silent, cpu = [], [], [], 0, 0, 0, 0
    with tempfile.TemporaryDirectory() as folder:
        for k in range(count):
            u, y, lam, (re, im), starts = draw(seed + k)
            result = identify(folder, u, y, starts)
            cpu += result["cost"]["cpu_s"]
            left = list(result["modes"])
            for p in np.argsort(re / -lam.real):
                off = [abs(complex(*m["exponent"]) - lam[p]) for m in left]
                if not left or min(off) > ASTRAY * np.hypot(re[p], im[p]):
                    missed += re[p] < DETECTABLE * -lam[p].real
                    continue
                mode = left.pop(int(np.argmin(off)))
                if re[p] > POOLED * -lam[p].real:
                    continue
                error, std = complex(*mode["exponent"]) - lam[p], mode["std"]
                if std["damping_ratio"] is None:
                    silent += 1
                    continue
                squares.append([(error.real / re[p]) ** 2, (error.imag / im[p]) ** 2])
                zeta, hertz = -lam[p].real / abs(lam[p]), abs(lam[p]) / 2 / np.pi
                within.append([abs(mode["damping_ratio"] - zeta) < 1.96 * std["damping_ratio"],
                               abs(mode["frequency_hz"] - hertz) < 1.96 * std["frequency_hz"]])
                bars.append([std["exponent"][0] / re[p], std["exponent"][1] / im[p]])
            spurious += len(left)
    squares, within, bars = (np.mean(x, axis=0) for x in (squares, within, bars))
    for case, value, unit in (
            ("damping: mean square error", squares[0], "bound"),
            ("frequency: mean square error", squares[1], "bound"),
            ("damping: within 1.96 std", within[0], "share"),
            ("frequency: within 1.96 std", within[1], "share"),
            ("damping: std", bars[0], "bound"), ("frequency: std", bars[1], "bound"),
            ("modes missed", missed, "of all"), ("modes spurious", spurious, "of all"),
            ("modes without errors", silent, "of all"),
            ("CPU", cpu / count, "s a record")):
        print(json.dumps({"bench": "forced", "case": case, "value": round(float(value), 4),
                          "unit": unit, "peer": None, "ratio": None, "n": count}))


if __name__ == "__main__":
    main()
