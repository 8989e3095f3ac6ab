#!/usr/bin/python3
"""Random free responses of periodic systems whose period is no whole number of samples, beside
their Cramer-Rao bound: multipliers missed, spurious ones, false verdicts, what bars cover.

    MODALCTL=build/bin/modalctl tests/bench/bench_identify_families.py [count] [seed]

Each record: one to four multipliers, pairs or real of either sign, one record in ten with one that
grows, each with the harmonics -4 to 4 of the period; 10 to 100 samples and a part a period, 25 to
70 periods, 1 to 8 channels, 20 to 80 dB of white noise or none.  A multiplier is *found* where one
of the answer is within TOLERANCE bounds of it or within a thousandth; what is left is spurious.
All is of the truth: the bound is that of a model of the lines that there are, their amplitudes
unknown.
"""
import json
import math
import os
import subprocess
import sys
import tempfile

import h5py
import numpy as np

from bench_identify_periodic import assign

CTL = os.environ.get("MODALCTL", "modalctl")
TOLERANCE, FASTEST, HARMONICS = 5, 2.8, 4


def multipliers(rng, count):
    angle = [rng.choice([0, np.pi]) if rng.random() < 0.15 else rng.uniform(0.1, np.pi - 0.1)
             for _ in range(count)]
    size = 1 - 10 ** rng.uniform(-2.5, -0.3, count)
    if rng.random() < 0.1:
        size[0] = 1 + 10 ** rng.uniform(-2.5, -1.5)
    return size * np.exp(1j * np.array(angle))


def lines(exponent, omega, dt):
    all_of = [exponent + 1j * k * omega for k in range(-HARMONICS, HARMONICS + 1)]
    return [z for z in all_of if abs(z.imag) * dt < FASTEST]


def record(seed):
    rng = np.random.default_rng(seed)
    count, channels = rng.integers(1, 5), rng.integers(1, 9)
    per_period = math.floor(10 ** rng.uniform(1, 2)) + rng.uniform(0.07, 0.93)
    rows, period = int(per_period * rng.integers(25, 71)), 10 ** rng.uniform(-2, 1)
    dt, omega = period / per_period, 2 * np.pi / period
    t, truth = np.arange(rows) * dt, multipliers(rng, count)
    y = np.zeros((rows, channels))
    for z in np.log(truth) / period:
        for line in lines(z, omega, dt):
            k = round((line.imag - z.imag) / omega)
            part = rng.standard_normal((2, channels)) * rng.uniform(0.1, 0.5, channels) ** abs(k)
            y += (np.exp(line * t)[:, None] * (part[0] + 1j * part[1])).real
    sd = 0 if rng.random() < 0.1 else y.std() * 10 ** (-rng.uniform(20, 80) / 20)
    return dict(y=y + sd * rng.standard_normal(y.shape), clean=y, dt=dt, period=period, noise=sd,
                multipliers=truth.real + 1j * np.where(abs(truth.imag) < 1e-9, 0, abs(truth.imag)))


def bounds(r):
    """Of the exponents: (Re, Im), 1/s; 0 for Im of a real multiplier."""
    t, omega = np.arange(len(r["y"])) * r["dt"], 2 * np.pi / r["period"]
    columns, parts = [], []
    for m in r["multipliers"]:
        own = np.array([f(np.exp(z * t)) for z in lines(np.log(m) / r["period"], omega, r["dt"])
                        for f in (np.real, np.imag)]).T
        parts.append(own)
        columns.append(own)
    basis = np.hstack(columns)
    u, s, _ = np.linalg.svd(basis / np.maximum(np.linalg.norm(basis, axis=0), 1e-300),
                            full_matrices=False)
    u = u[:, s > 1e-10 * s[0]]
    amplitudes = np.linalg.lstsq(basis, r["clean"], rcond=1e-12)[0]
    slopes, at = [], 0
    for m, own in zip(r["multipliers"], parts):
        a = amplitudes[at:at + own.shape[1]]
        at += own.shape[1]
        # d/dRe and d/dIm of Re(z) x + Im(z) y
        for turned in [own] if m.imag == 0 else [own, own[:, [i ^ 1 for i in range(len(a))]]
                                                 * np.tile([-1, 1], len(a) // 2)]:
            d = (t[:, None] * turned) @ a
            slopes.append((d - u @ (u.T @ d)).ravel())
    J = np.array(slopes) / max(r["noise"], 1e-13 * r["clean"].std())
    std = iter(np.sqrt(np.diag(np.linalg.pinv(J @ J.T))))
    return [(next(std), next(std)) if m.imag else (next(std), 0) for m in r["multipliers"]]


def identify(r):
    with tempfile.TemporaryDirectory() as d:
        with h5py.File(d + "/r.h5", "w") as h:
            signals = h.create_dataset("signals", data=r["y"])
            signals.attrs["dt"], signals.attrs["period"] = r["dt"], r["period"]
        out = subprocess.run([CTL, "--local", "--json", "identify", d + "/r.h5"],
                             capture_output=True, text=True, timeout=300).stdout
    return json.loads(out)


def match(document, r):
    may = [max(TOLERANCE * abs(m) * r["period"] * math.hypot(*b), 1e-3)
           for m, b in zip(r["multipliers"], bounds(r))]
    return assign(document, r["multipliers"], may)


def covered(document, r, hit):
    parts = within = 0
    for i, j in hit.items():
        mode, truth = document["modes"][j], np.log(r["multipliers"][i]) / r["period"]
        std = mode["std"]["exponent"]
        if std[0] is None or r["noise"] == 0:
            continue
        parts += 1 + (std[1] > 0)
        within += abs(mode["exponent"][0] - truth.real) <= 1.96 * std[0]
        within += std[1] > 0 and abs(abs(mode["exponent"][1]) - abs(truth.imag)) <= 1.96 * std[1]
    return parts, within


def main():
    count, seed = (int(x) for x in (sys.argv[1:] + ["40", "1"][len(sys.argv) - 1:]))
    all_of = missed = spurious = false = decided = parts = within = 0
    began = os.times()
    for s in range(seed, seed + count):
        r = record(s)
        document = identify(r)
        hit, more = match(document, r)
        stable, truth = document["stability"]["stable"], abs(r["multipliers"]).max()
        decided += stable is not None
        false += stable is not None and stable != (truth < 1)
        lost = len(r["multipliers"]) - len(hit)
        all_of, missed = all_of + len(r["multipliers"]), missed + lost
        spurious += more > 0
        p, w = covered(document, r, hit)
        parts, within = parts + p, within + w
        if lost or more:
            print(s, f"{len(r['multipliers'])} multipliers, {r['period'] / r['dt']:.2f} samples a "
                  f"period, {r['y'].shape}: missed {lost}, spurious {more}", flush=True)
    cpu = os.times().children_user - began.children_user
    print(f"{count} records from seed {seed}: missed {missed} of {all_of} multipliers, {spurious} "
          f"records with a spurious one, {within} of {parts} components within 1.96 standard "
          f"deviations, {false} false verdicts of {decided}, {cpu:.1f} s of CPU")


if __name__ == "__main__":
    main()
