#!/usr/bin/python3
"""Random free responses of periodic systems with known multipliers: the largest right, multipliers
missed, spurious ones, false verdicts.

    MODALCTL=build/bin/modalctl tests/bench/bench_identify_periodic.py [count] [seed] [states]
    MODALCTL=build/bin/modalctl tests/bench/bench_identify_periodic.py cost

`cost`: three pairs in 1e-3 of noise, with periods, samples a period and channels doubled one after
the other; CPU beside that of numpy's plain fit of the multipliers (its SVD of all periods but the
last, of rank 6, told), on one thread.

Each record: pairs and real multipliers of either sign, one time in five a growing one, each with up
to four harmonics of the period in 1 to 12 channels; 24 to 240 samples a period, 30 to 60 periods
(60 to 90 of 40 states), 20 to 80 dB of white noise or none.  A multiplier is *detectable* where
chi-squared expected without it, the amplitudes of the others fitted anew, is three times its price
(criterion.c, (3)), and found where one of the answer is within TOLERANCE of its Cramer-Rao bound or
1 / periods.  What is left of the answer is spurious.  All is of the truth, never of a fit.
Where multipliers crowd the others' exponents make up for one that is missing, and one stands for
several: how many of those missed are detectable with the exponents of the others fitted anew, too,
and in how many records a spurious one draws noise, no motion, is told beside.
"""
import math
import os
import subprocess
import sys
import h5py
import json
import tempfile
import time
import numpy as np
import scipy.signal

CTL = os.environ.get("MODALCTL", "modalctl")
DETECTABLE, TOLERANCE, WIDEST = 3, 4, 0.2


def record(seed, states):
    rng = np.random.default_rng(seed)
    p, periods = int(rng.choice([24, 48, 96, 240])), int(rng.integers(30, 61))
    periods += max(0, 3 * (states - 20) // 2)        # more than there are states
    S, reals = int(rng.integers(1, 13)), int(rng.integers(0, 2))
    t = np.arange(periods * p) / p
    lam = [complex(-rng.uniform(0.05, 3) * 1.5 / periods * rng.choice([1, 4]),
                   rng.uniform(0.02, 0.98) * np.pi) for _ in range(states // 2 - reals)]
    if rng.random() < 0.2:
        lam[0] = complex(rng.uniform(0.2, 2) / periods, lam[0].imag)
    for _ in range(2 * reals):
        lam.append(complex(-rng.uniform(0.5, 8) / periods, 0 if rng.random() < 0.5 else np.pi))
    y = np.zeros((periods * p, S))
    for z in lam:
        most = int(rng.integers(1, 5))
        k = np.arange(-most, most + 1)
        g = ((rng.normal(size=(2 * most + 1, S)) + 1j * rng.normal(size=(2 * most + 1, S)))
             * (0.5 ** abs(k))[:, None])
        size = np.exp(z.real * (t - (t[-1] if z.real > 0 else 0)))
        y += (size[:, None] * (np.exp(1j * np.outer(t, z.imag + 2 * np.pi * k)) @ g)).real
    snr = rng.uniform(20, 80) if rng.random() > 0.1 else None
    noise = 0 if snr is None else np.sqrt(np.mean(y ** 2)) * 10 ** (-snr / 20)
    multiplier = np.exp(np.array(lam))
    return dict(y=y + noise * rng.normal(size=y.shape), p=p, periods=periods, snr=snr, clean=y,
                noise=max(noise, 1e-13 * np.sqrt(np.mean(y ** 2))),
                multipliers=multiplier.real + 1j * np.where(abs(multiplier.imag) < 1e-9, 0,
                                                            abs(multiplier.imag)))


def columns(multipliers, periods):
    """Of each its one or two real columns over the periods, none above 1."""
    late = [np.arange(periods) - (periods - 1 if abs(m) > 1 else 0) for m in multipliers]
    powers = [m ** k.astype(float) for m, k in zip(multipliers, late)]
    return [np.column_stack([v.real, v.imag]) if m.imag else v.real[:, None]
            for m, v in zip(multipliers, powers)]


def price(r, width):
    """What a multiplier of WIDTH columns pays, of chi-squared."""
    S = r["y"].shape[1] * r["p"]
    x = math.log(4 * r["periods"] / 1e-3)
    alarm = width * (S + 1) + 2 * math.sqrt(width * S * x) + 2 * x
    return min(alarm, width * (S + 1 + 1 / S) * math.log(r["y"].size))


def losses(r):
    """Chi-squared expected without each multiplier, over its price."""
    y = r["clean"].reshape(r["periods"], -1)
    basis = columns(r["multipliers"], r["periods"])

    def left(parts):
        q = np.linalg.qr(np.column_stack(parts))[0]
        return ((y - q @ (q.T @ y)) ** 2).sum() / r["noise"] ** 2
    return [left(basis[:j] + basis[j + 1:]) / price(r, b.shape[1]) for j, b in enumerate(basis)]


def derivatives(multipliers, periods, y):
    """What the best amplitudes leave of Y, and what moves it by the exponents over a period: real
    part and, of a pair, imaginary part of each."""
    parts = columns(multipliers, periods)
    basis = np.column_stack(parts)
    q, triangle = np.linalg.qr(basis)
    amplitudes = np.linalg.solve(triangle, q.T @ y)
    slopes, at = [], 0
    for m, part in zip(multipliers, parts):
        late = (np.arange(periods) * part.T).T
        c = amplitudes[at:at + part.shape[1]]
        turns = [c, np.array([c[1], -c[0]])] if m.imag else [c]
        slopes += [late @ t - q @ (q.T @ (late @ t)) for t in turns]
        at += part.shape[1]
    return y - basis @ amplitudes, np.array([s.ravel() for s in slopes])


def bounds(r):
    """Standard deviations of the exponents over a period by the Cramer-Rao bound: real part and,
    of a pair, imaginary part."""
    y = r["clean"].reshape(r["periods"], -1)
    J = derivatives(r["multipliers"], r["periods"], y)[1] / r["noise"]
    std = iter(np.sqrt(np.diag(np.linalg.inv(J @ J.T))))
    return [(next(std), next(std)) if m.imag else (next(std), 0) for m in r["multipliers"]]


def refitted(r, multipliers):
    """Chi-squared of the motion without its noise that MULTIPLIERS leave once all their exponents
    have made up for what is missing, begun where they are: Levenberg and Marquardt."""
    y, damping = r["clean"].reshape(r["periods"], -1), 1e-3
    rest, J = derivatives(multipliers, r["periods"], y)
    for _ in range(60):
        normal = J @ J.T
        step = np.linalg.lstsq(normal + damping * np.diag(np.diag(normal)), J @ rest.ravel(),
                               rcond=None)[0]
        part = iter(np.clip(step, -0.2, 0.2))
        moved = [m * np.exp(complex(next(part), next(part) if m.imag else 0)) for m in multipliers]
        moved = [complex(m.real, abs(m.imag)) for m in moved]
        new, slopes = derivatives(moved, r["periods"], y)
        fall = 1 - np.sum(new ** 2) / np.sum(rest ** 2)
        damping = damping / 5 if fall > 0 else 8 * damping
        if fall > 0:
            multipliers, rest, J = moved, new, slopes
        if 0 < fall < 1e-6 or damping > 1e9:
            break
    return np.sum(rest ** 2) / r["noise"] ** 2


def seen_refitted(r, i):
    """Is multiplier I worth DETECTABLE prices where the others' exponents are fitted anew, too?"""
    m = r["multipliers"]
    left = refitted(r, [x for j, x in enumerate(m) if j != i])
    return left >= DETECTABLE * price(r, 2 if m[i].imag else 1)


def drawn(r, found, k):
    """Does K of the multipliers FOUND take its price of the motion without its noise, beside the
    others as they are?"""
    y, left = r["clean"].reshape(r["periods"], -1), []
    for kept in (found, found[:k] + found[k + 1:]):
        q = np.linalg.qr(np.column_stack(columns(kept, r["periods"])))[0]
        left.append(np.sum((y - q @ (q.T @ y)) ** 2) / r["noise"] ** 2)
    return left[1] - left[0] >= price(r, 2 if found[k].imag else 1)


def identify(r):
    with tempfile.TemporaryDirectory() as d:
        with h5py.File(d + "/r.h5", "w") as h:
            h.create_dataset("signals", data=r["y"]).attrs["dt"] = 1 / r["p"]
        out = subprocess.run([CTL, "--local", "--json", "identify", d + "/r.h5", "-o", "period=1"],
                             capture_output=True, text=True, timeout=300).stdout
    return json.loads(out)


def multipliers_of(document):
    found = [complex(*m["multiplier"]) for m in document["modes"]]
    return [complex(z.real, abs(z.imag) if abs(z.imag) > 1e-9 else 0) for z in found]


def assign(document, multipliers, may):
    """Of each multiplier that is found the mode, the nearest in units of what it MAY be off first;
    how many are besides."""
    found = multipliers_of(document)
    off = {(i, j): abs(f - m) / may[i] for i, m in enumerate(multipliers)
           for j, f in enumerate(found)}
    hit = {}
    for i, j in sorted(off, key=off.get):
        if off[i, j] < 1 and i not in hit and j not in hit.values():
            hit[i] = j
    return hit, len(found) - len(hit)


def match(document, r):
    may = [max(min(TOLERANCE * abs(m) * math.hypot(*b), WIDEST), 1 / r["periods"])
           for m, b in zip(r["multipliers"], bounds(r))]
    return assign(document, r["multipliers"], may)


def covered(document, r, hit):
    """Components of the exponents found, and those within 1.96 of their standard deviations."""
    parts = within = 0
    for i, j in hit.items():
        mode, truth = document["modes"][j], np.log(complex(r["multipliers"][i]))
        z, std = mode["exponent"], mode["std"]["exponent"]
        if abs(truth.imag) > 1e-9 and std[1] and abs(abs(z[1]) - np.pi) > 1e-9:
            parts, within = parts + 1, within + (abs(abs(z[1]) - abs(truth.imag)) < 1.96 * std[1])
        if std[0]:
            parts, within = parts + 1, within + (abs(z[0] - truth.real) < 1.96 * std[0])
    return parts, within


def few(periods, p, S, correlation=0):
    """Three pairs, each with four harmonics, in noise of 1e-3 with CORRELATION."""
    rng = np.random.default_rng(periods + p + S)
    t, k = np.arange(periods * p) / p, np.arange(-2, 3)
    y = 1e-3 * rng.normal(size=(periods * p, S))
    y = scipy.signal.lfilter([(1 - correlation ** 2) ** 0.5], [1, -correlation], y, axis=0)
    for z in (-2 / periods + 0.6j, -3 / periods + 1.7j, -1 / periods + 2.6j):
        g = (rng.normal(size=(5, S)) + 1j * rng.normal(size=(5, S))) * (0.5 ** abs(k))[:, None]
        y += (np.exp(z.real * t)[:, None]
              * (np.exp(1j * np.outer(t, z.imag + 2 * np.pi * k)) @ g)).real
    return dict(y=y, p=p)


def plain(r):
    """Multipliers from one period to the next in the span of the six strongest directions."""
    rows = r["y"].reshape(len(r["y"]) // r["p"], -1)
    u, s, vt = np.linalg.svd(rows[:-1].T, full_matrices=False)
    return np.linalg.eigvals(u[:, :6].T @ rows[1:].T @ vt[:6].T / s[:6])


def cost():
    print("periods x samples x channels (x correlation of noise): CPU, that of numpy's fit, ratio; "
          "multipliers")
    grown = {(60 * i, 24 * j, 2 * k) for n in (1, 2, 4, 8)
             for i, j, k in ((n, 1, 1), (1, n, 1), (1, 1, n))}
    for size in sorted(grown) + [(250, 96, 4), (257, 240, 8), (1000, 24, 4),
                                 (60, 240, 6, 0.6), (60, 240, 6, 0.9)]:
        r, began = few(*size), os.times()
        found = len(identify(r)["modes"])
        ours, before = os.times().children_user - began.children_user, time.process_time()
        plain(r)
        theirs = time.process_time() - before
        print(f"{' x '.join(map(str, size))}: {ours:.2f} s, {theirs:.3f} s, {ours / theirs:.1f}; "
              f"{found}", flush=True)


def main():
    count, seed, states = (int(x) for x in (sys.argv[1:] + ["40", "1", "10"][len(sys.argv) - 1:]))
    largest = false = detectable = missed = spurious = whole = right = parts = within = 0
    clearly = noise = 0
    began = os.times()
    for s in range(seed, seed + count):
        r = record(s, states)
        seen, document = [x >= DETECTABLE for x in losses(r)], identify(r)
        hit, more = match(document, r)
        lost = sum(v and i not in hit for i, v in enumerate(seen))
        truth, stable = abs(r["multipliers"]).max(), document["stability"]["stable"]
        found = max((abs(complex(*m["multiplier"])) for m in document["modes"]), default=0)
        largest += abs(found / truth - 1) <= 0.05
        false += stable is not None and stable != (truth < 1)
        detectable, missed, spurious = detectable + sum(seen), missed + lost, spurious + (more > 0)
        whole, right = whole + all(seen), right + (all(seen) and not lost and not more)
        if r["snr"] is not None:
            p, w = covered(document, r, {i: j for i, j in hit.items() if seen[i]})
            parts, within = parts + p, within + w
        gone = [i for i, v in enumerate(seen) if v and i not in hit]
        extra = [k for k in range(len(document["modes"])) if k not in hit.values()]
        clearly += sum(seen_refitted(r, i) for i in gone)
        noise += not all(drawn(r, multipliers_of(document), k) for k in extra)
        if lost or more:
            print(s, f"{len(seen)} multipliers, {sum(seen)} detectable, {r['periods']} x {r['p']} "
                  f"in {r['y'].shape[1]} channels: missed {lost}, spurious {more}", flush=True)
    cpu = os.times().children_user - began.children_user
    print(f"{count} records of {states} states from seed {seed}: largest within 5 % in {largest}, "
          f"missed {missed} of {detectable} detectable multipliers ({clearly} detectable where "
          f"the others' exponents are fitted anew), {spurious} records with a spurious one "
          f"({noise} where it draws noise), order right in {right} of {whole} with all detectable, "
          f"{within} of {parts} components of detectable ones within 1.96 standard deviations, "
          f"{false} false verdicts, {cpu:.1f} s of CPU")


if __name__ == "__main__":
    cost() if sys.argv[1:] == ["cost"] else main()
