#!/usr/bin/python3
"""Very long records that begin with noise, beside the same response alone: CPU of each in s.

    MODALCTL=build/bin/modalctl tests/bench/bench_unclean.py [rows] [rows of noise] [seed]

Ends with 1 where the record as it came costs more than MOST of the clean one, or window=auto does.
"""
import json
import os
import subprocess
import sys
import tempfile
import h5py
import numpy as np

CTL = os.environ.get("MODALCTL", "modalctl")
MOST = 2


def record(rows, quiet, seed, channels, modes, noise):
    rng = np.random.default_rng(seed)
    t = np.arange(rows) - quiet
    y = np.zeros((rows, channels))
    for f in np.exp(rng.uniform(np.log(0.003), np.log(0.4), modes)):
        z = np.exp(-rng.uniform(1, 8) / rows * np.maximum(t, 0)) * np.sin(2 * np.pi * f * t + 1)
        y += np.where(t >= 0, z, 0)[:, None] * rng.normal(size=channels)
    return y + noise * rng.normal(size=y.shape)


def cpu(y, *options):
    with tempfile.NamedTemporaryFile(suffix=".h5") as f:
        with h5py.File(f.name, "w") as h:
            h["signals"], h.attrs["dt"] = y, 1e-3
        args = [CTL, "--local", "--json", "identify", f.name]
        args += [w for o in options for w in ("-o", o)]
        done = subprocess.run(args, capture_output=True, text=True)
        return json.loads(done.stdout)["cost"]["cpu_s"]


def main():
    given = sys.argv[1:] + ["150000", "40000", "1"][len(sys.argv) - 1:]
    rows, quiet, seed = (int(a) for a in given)
    worst = 0
    for channels, modes, noise in ((1, 3, 0.01), (3, 6, 0.01), (3, 6, 0.1), (1, 6, 0.001)):
        y = record(rows, quiet, seed, channels, modes, noise)
        clean, unclean, auto = cpu(y[quiet:]), cpu(y), cpu(y, "window=auto")
        worst = max(worst, unclean / clean, auto / clean)
        print(f"{channels} x {rows}, {modes} modes, noise {noise:g}: clean {clean:.2f}, as it came "
              f"{unclean:.2f}, window=auto {auto:.2f}")
    print(f"at most {worst:.1f} times the clean one")
    return worst > MOST


if __name__ == "__main__":
    sys.exit(main())
