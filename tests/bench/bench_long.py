#!/usr/bin/python3
"""identify of very long records beside numpy's rfft over all channels of the same array: processor
time without reading (`read` of the cost), and the memory at its most over that of the record.

    MODALD_BUILD=build tests/bench/bench_long.py [rows] [case]

Ends with 1 where frequencies are more than six standard errors from the truth, or a figure of the
cases of few modes is over what is asked: MOST times the transform; bytes are told alone, since the
program itself takes 26 MB.
"""
import json
import os
import subprocess
import sys
import tempfile
import time
import h5py
import numpy as np

CTL = os.path.join(os.environ.get("MODALD_BUILD", "build"), "bin", "modalctl")
MOST = 5
# channels, modes, dB of noise below the signal, decay over the record or damping ratio
CASES = {"plain": (3, 3, 40, {}), "loud": (3, 3, 0, {}), "exact": (3, 3, None, {}),
         "slow": (3, 3, 40, {"zeta": 1e-5}), "fast": (3, 3, 40, {"zeta": 0.01}),
         "growing": (3, 3, 40, {"grows": True}), "six": (3, 6, 40, {}), "twelve": (3, 12, 40, {}),
         "channels": (16, 4, 40, {}), "driven": (3, 3, 26, {"zeta": 0.01, "driven": True})}
ASKED = ("plain", "loud", "exact", "slow", "fast", "growing")


def driven_by_noise(rng, rows, rate, f):
    """A mode under white noise, in a circle: without a beginning or an end."""
    pole, z = np.exp(-rate + 2j * np.pi * f), np.exp(-2j * np.pi * np.arange(rows // 2 + 1) / rows)
    gain = 1 / np.abs((1 - pole * z) * (1 - pole.conjugate() * z))
    e = np.fft.irfft(np.fft.rfft(rng.normal(size=rows)) * gain, rows)
    return e / e.std()


def record(rows, channels, modes, noise_db, zeta=None, grows=False, driven=False):
    rng = np.random.default_rng(rows + 97 * modes + channels)
    f = np.exp(rng.uniform(np.log(0.003), np.log(0.4), modes))
    rate = 2 * np.pi * f * zeta if zeta else rng.uniform(1, 8, modes) / rows
    rate[0] *= -1 if grows else 1
    y, t = np.zeros((rows, channels)), np.arange(rows)
    for a, g in zip(rate, f):
        e = np.exp(-a * (t - (rows if a < 0 else 0))) * np.sin(2 * np.pi * g * t + 1)
        e = driven_by_noise(rng, rows, a, g) if driven else e
        y += e[:, None] * rng.normal(size=channels)
    if noise_db is not None:
        y += 10 ** (-noise_db / 20) * y.std() * rng.normal(size=y.shape)
    return y, np.sort(f)


def transform(y):
    """The least of five."""
    spent = []
    for _ in range(5):
        begun = time.process_time()
        np.fft.rfft(y, axis=0)
        spent.append(time.process_time() - begun)
    return min(spent)


def identify(shell, y):
    """By a shell that began before there were arrays: a process is told to have had the memory of
    the one that made it."""
    with tempfile.NamedTemporaryFile(suffix=".h5") as file:
        with h5py.File(file.name, "w") as h:
            h["signals"], h.attrs["dt"] = y, 1
        shell.stdin.write(f"{CTL} --local --json identify {file.name} | tr -d '\\n'; echo\n")
        shell.stdin.flush()
        return json.loads(shell.stdout.readline())


def right(answer, truth, driven=False):
    if driven:
        return "not_free_decay" in [d["code"] for d in answer["diagnostics"]]
    found = sorted(answer["modes"], key=lambda m: m["frequency_hz"])
    return len(found) == len(truth) and all(
        abs(m["frequency_hz"] - f * np.sqrt(1 + m["damping_ratio"] ** 2))
        < 6 * m["std"]["frequency_hz"] + 1e-12 for m, f in zip(found, truth))


def main():
    rows = int(sys.argv[1]) if len(sys.argv) > 1 else 1200000
    bad = False
    shell = subprocess.Popen(["/bin/sh"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    for name in sys.argv[2:] or CASES:
        channels, modes, noise, more = CASES[name]
        y, truth = record(rows, channels, modes, noise, **more)
        peer, answer = transform(y), identify(shell, y)
        cost = answer["cost"]
        spent = cost["cpu_s"] - cost["stages"]["read"]
        if not right(answer, truth, more.get("driven", False)):
            print(f"bench_long: {name} is not what was put in", file=sys.stderr)
            bad = True
        bad |= name in ASKED and spent > MOST * peer
        print(json.dumps({"bench": "long", "case": f"{name}, {channels} x {rows}, {modes} modes",
                          "value": round(spent, 3), "unit": "s", "peer": "numpy rfft",
                          "ratio": round(peer / spent, 3), "n": rows * channels,
                          "times_record": round(cost["peak_bytes"] / y.nbytes, 2)}), flush=True)
    shell.communicate()
    return bad


if __name__ == "__main__":
    sys.exit(main())
