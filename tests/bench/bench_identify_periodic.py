#!/usr/bin/python3
"""Random free responses of periodic systems with known multipliers: the largest right, multipliers
missed, spurious ones, false verdicts.

    MODALCTL=build/bin/modalctl tests/bench/bench_identify_periodic.py [count] [seed] [states]

Each record: pairs and real multipliers of either sign, one time in five a growing one, each with up
to four harmonics of the period in 1 to 12 channels; 24 to 240 samples a period, 30 to 60 periods,
20 to 80 dB of white noise or none.  A multiplier is *detectable* where the criterion (criterion.h)
loses three times its price without it, the amplitudes of the others fitted anew.
"""
import math
import os
import subprocess
import sys
import h5py
import json
import tempfile
import numpy as np

CTL = os.environ.get("MODALCTL", "modalctl")
DETECTABLE = 3


def record(seed, states):
    rng = np.random.default_rng(seed)
    p, periods = int(rng.choice([24, 48, 96, 240])), int(rng.integers(30, 61))
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
    return dict(y=y + noise * rng.normal(size=y.shape), p=p, periods=periods, snr=snr,
                multipliers=multiplier.real + 1j * np.where(abs(multiplier.imag) < 1e-9, 0,
                                                            abs(multiplier.imag)))


def columns(multipliers, periods):
    """Of each its one or two real columns over the periods, none above 1."""
    powers = [m ** np.arange(periods) / max(1, abs(m) ** (periods - 1)) for m in multipliers]
    return [np.column_stack([v.real, v.imag]) if m.imag else v.real[:, None]
            for m, v in zip(multipliers, powers)]


def losses(r):
    """What the criterion loses without each multiplier, in prices."""
    y = r["y"].reshape(r["periods"], -1)
    basis = columns(r["multipliers"], r["periods"])

    def left(parts):
        q = np.linalg.qr(np.column_stack(parts))[0]
        return max(((y - q @ (q.T @ y)) ** 2).sum(), 1e-26 * (y ** 2).sum())
    n, least = y.size, left(basis)
    return [n * math.log(left(basis[:j] + basis[j + 1:]) / least)
            / (b.shape[1] * (y.shape[1] + 1 + 1 / y.shape[1]) * math.log(n))
            for j, b in enumerate(basis)]


def identify(r):
    with tempfile.TemporaryDirectory() as d:
        with h5py.File(d + "/r.h5", "w") as h:
            h.create_dataset("signals", data=r["y"]).attrs["dt"] = 1 / r["p"]
        out = subprocess.run([CTL, "--local", "--json", "identify", d + "/r.h5", "-o", "period=1"],
                             capture_output=True, text=True, timeout=300).stdout
    return json.loads(out)


def match(document, r):
    """Which multipliers are found, the largest first, each once, and how many are besides."""
    found = [complex(*m["multiplier"]) for m in document["modes"]]
    found = [complex(z.real, abs(z.imag)) for z in found]
    hit = set()
    for i in np.argsort(-abs(r["multipliers"])):
        z = r["multipliers"][i]
        near = min(found, key=lambda f: abs(f - z), default=None)
        if near is not None and abs(near - z) < max(0.3 * abs(math.log(abs(z))), 1 / r["periods"]):
            found.remove(near)
            hit.add(int(i))
    return hit, len(found)


def main():
    count, seed, states = (int(x) for x in (sys.argv[1:] + ["40", "1", "10"][len(sys.argv) - 1:]))
    largest = false = detectable = missed = spurious = 0
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
        if lost or more:
            print(s, f"{len(seen)} multipliers, {sum(seen)} detectable, {r['periods']} x {r['p']} "
                  f"in {r['y'].shape[1]} channels: missed {lost}, spurious {more}")
    print(f"{count} records of {states} states from seed {seed}: largest within 5 % in {largest}, "
          f"missed {missed} of {detectable} detectable multipliers, {spurious} records with a "
          f"spurious one, {false} false verdicts")


if __name__ == "__main__":
    main()
