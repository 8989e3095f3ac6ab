#!/usr/bin/python3
"""What a start of modalctl costs: processor time beside /bin/true's, of processes started in turns.

    version    all of `modalctl --version`
    identify   `modalctl --local identify` of a small file, less what the job itself took
    (cost.cpu_s):
               loading, reading the file, printing

Medians of MODALD_BENCH_STARTS (101) starts of each.
"""
import json
import math
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile

TOP = pathlib.Path(__file__).resolve().parents[2]
CTL = str(pathlib.Path(os.environ.get("MODALD_BUILD", TOP / "build")) / "bin" / "modalctl")
STARTS = int(os.environ.get("MODALD_BENCH_STARTS", "101"))


def start(words):
    """Processor time in ms, and what it printed."""
    with subprocess.Popen(words, stdout=subprocess.PIPE) as process:
        out = process.stdout.read()
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        sys.exit(f"{' '.join(words)} ended with {process.returncode}")
    return 1e3 * (used.ru_utime + used.ru_stime), out


def identify(file):
    used, out = start([CTL, "--local", "--json", "identify", file])
    return used - 1e3 * json.loads(out)["cost"]["cpu_s"]


def main():
    with tempfile.NamedTemporaryFile("w", suffix=".csv") as file:
        for i in range(400):
            t = 0.01 * i
            file.write(
                f"{t:.2f},{math.exp(-0.2 * t) * math.cos(7 * t):.9f},"
                f"{math.exp(-0.2 * t) * math.sin(7 * t):.9f}\n")
        file.flush()
        kinds = {"true": lambda: start(["/bin/true"])[0],
                 "version": lambda: start([CTL, "--version"])[0],
                 "identify": lambda: identify(file.name)}
        spent = {kind: [] for kind in kinds}
        for _ in range(STARTS):
            for kind, once in kinds.items():
                spent[kind].append(once())
    least = statistics.median(spent.pop("true"))
    for kind, times in spent.items():
        value = statistics.median(times)
        print(json.dumps({"bench": "start", "case": kind, "value": round(value, 3), "unit": "ms",
                          "peer": round(least, 3),
                          "ratio": round(value / least, 2), "n": STARTS}), flush=True)


if __name__ == "__main__":
    main()
