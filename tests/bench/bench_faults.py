#!/usr/bin/python3
"""Faults of samples in free records: errors over bars, modes missed and spurious, codes, CPU.

    MODALCTL=build/bin/modalctl tests/bench/bench_faults.py [rows] [channels] [records]
        [seed] [KIND ...]

Three modes at 40 dB that decay by 2 to 20 over the record. CPU is over that of the same record
without faults.
"""
import collections
import json
import os
import subprocess
import sys
import tempfile
import h5py
import numpy as np

CTL = os.environ.get("MODALCTL", "modalctl")
NOISE = 0.01


def motion(rng, rows, channels, modes=3):
    """Exponents a sample, apart by 20 lines, and their motion."""
    while True:
        hertz = np.sort(np.exp(rng.uniform(np.log(max(0.005, 8 / rows)), np.log(0.4), modes)))
        if np.min(np.diff(hertz), initial=1) > max(20 / rows, 0.004):
            break
    poles = -rng.uniform(2, 20, modes) / rows + 2j * np.pi * hertz
    t = np.arange(rows)
    y = np.zeros((rows, channels))
    for p in poles:
        shape = rng.normal(size=channels) + 1j * rng.normal(size=channels)
        y += (np.exp(p * t)[:, None] * shape).real
    return poles, y


def some(rng, channels, everywhere):
    return range(channels) if everywhere else [rng.integers(channels)]


def spikes(rng, y, share, size):
    for c in range(y.shape[1]):
        at = rng.choice(len(y), max(1, int(share * len(y))), replace=False)
        y[at, c] += NOISE * size * rng.choice([-1, 1], len(at)) * rng.uniform(0.5, 1.5, len(at))


def clusters(rng, y, size=1000):
    for _ in range(max(1, min(10, len(y) // 400))):
        at = rng.integers(50, len(y) - 50)
        for c in some(rng, y.shape[1], rng.random() < 0.5):
            rows = at + rng.choice(20, 8, replace=False)
            y[rows, c] += NOISE * size * rng.normal(size=8)


def dropouts(rng, y, held, longest=40):
    for _ in range(max(1, min(10, len(y) // 400))):
        at, n = rng.integers(50, len(y) - 50 - longest), rng.integers(5, longest)
        for c in some(rng, y.shape[1], rng.random() < 0.5):
            y[at:at + n, c] = y[at - 1, c] if held else 0


def cut(y, share):
    for c in range(y.shape[1]):
        top = np.max(np.abs(y[:, c])) * (1 - share)
        y[:, c] = np.clip(y[:, c], -top, top)


def one_cut(rng, y):
    """The largest sample of a channel alone, unless it is among the first: of an onset nobody can
    tell it."""
    c = rng.integers(y.shape[1])
    at = 2 + np.argmax(np.abs(y[2:, c]))
    y[at, c] *= rng.uniform(0.5, 0.95)


def step(rng, y, everywhere):
    at = rng.integers(len(y) // 4, 3 * len(y) // 4)
    for c in some(rng, y.shape[1], everywhere):
        y[at:, c] += rng.choice([-1, 1]) * 100 * NOISE


KINDS = {
    "clean": lambda rng, y: None,
    "one spike 1e4": lambda rng, y: spikes(rng, y, 0, 1e4),
    "spikes 0.2% 100": lambda rng, y: spikes(rng, y, 0.002, 100),
    "spikes 2% 30": lambda rng, y: spikes(rng, y, 0.02, 30),
    "spikes 2% 1000": lambda rng, y: spikes(rng, y, 0.02, 1000),
    "spikes 2% 1e4": lambda rng, y: spikes(rng, y, 0.02, 1e4),
    "clusters": clusters,
    "zeros": lambda rng, y: dropouts(rng, y, False),
    "held": lambda rng, y: dropouts(rng, y, True),
    "one cut": one_cut,
    "cut 20%": lambda rng, y: cut(y, 0.2),
    "cut 50%": lambda rng, y: cut(y, 0.5),
    "step in one": lambda rng, y: step(rng, y, False),
    "step in all": lambda rng, y: step(rng, y, True),
}


def identify(y):
    with tempfile.NamedTemporaryFile(suffix=".h5") as f:
        with h5py.File(f.name, "w") as h:
            h["signals"], h.attrs["dt"] = y, 1.0
        done = subprocess.run([CTL, "--local", "--json", "identify", f.name], capture_output=True,
                              text=True)
        return json.loads(done.stdout)


def judge(poles, document):
    """Components within 1.96 std, all of them, largest error over std, missed, spurious."""
    found = [complex(*m["exponent"]) if isinstance(m["exponent"], list) else
             complex(m["exponent"]["re"], m["exponent"]["im"]) for m in document["modes"]]
    stds = [m["std"]["damping_ratio"] for m in document["modes"]]
    hz = [m["std"]["frequency_hz"] for m in document["modes"]]
    inside = every = 0
    worst, missed, used = 0, 0, set()
    for p in poles:
        near = [i for i, z in enumerate(found) if abs(abs(z) - abs(p)) < 0.02 * abs(p)
                and i not in used]
        if not near:
            missed += 1
            continue
        i = min(near, key=lambda i: abs(found[i] - p))
        used.add(i)
        for error, std in ((abs(found[i]) - abs(p), 2 * np.pi * (hz[i] or np.inf)),
                           (found[i].real / abs(found[i]) - p.real / abs(p), stds[i] or np.inf)):
            inside, every = inside + (abs(error) <= 1.96 * std), every + 1
            worst = max(worst, abs(error) / std)
    return inside, every, worst, missed, len(found) - len(used)


def main():
    given = [int(a) for a in sys.argv[1:5]] + [3000, 3, 10, 1][len(sys.argv[1:5]):]
    rows, channels, records, seed = given
    print(f"{rows} x {channels}, {records} records")
    for kind in sys.argv[5:] or KINDS | {"t3": None}:
        rng = np.random.default_rng([seed, rows, channels])
        total, worst, codes, clean, own = np.zeros(4, int), 0, collections.Counter(), 0, 0
        bars = []
        for _ in range(records):
            poles, y = motion(rng, rows, channels)
            noise = rng.standard_t(3, y.shape) if kind == "t3" else rng.normal(size=y.shape)
            y += NOISE * noise
            base = identify(y)
            if kind in KINDS:
                KINDS[kind](rng, y)
            document = base if kind in ("clean", "t3") else identify(y)
            inside, every, most, missed, spurious = judge(poles, document)
            total += inside, every, missed, spurious
            worst = max(worst, most)
            codes.update({d["code"] for d in document["diagnostics"]})
            clean, own = clean + base["cost"]["cpu_s"], own + document["cost"]["cpu_s"]
            if len(document["modes"]) == len(base["modes"]):
                bars += [m["std"]["frequency_hz"] / b["std"]["frequency_hz"] for m, b in
                         zip(document["modes"], base["modes"]) if m["std"]["frequency_hz"]
                         and b["std"]["frequency_hz"]]
        print(f"{kind:16} covered {total[0]:3} of {total[1]:3}, worst {worst:7.3g} std, bars "
              f"{np.median(bars or [np.nan]):5.3f}, missed {total[2]}, spurious {total[3]}, CPU "
              f"{own / clean:5.2f} of {clean / records:.3f} s, {dict(codes)}", flush=True)


if __name__ == "__main__":
    main()
