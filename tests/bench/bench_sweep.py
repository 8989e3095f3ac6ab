#!/usr/bin/python3
"""Strutt's diagram of 200 x 200 points as one sweep through a daemon of two workers: are both cores
busy with points?

    busy      CPU seconds of the workers over 2 x the wall time of the whole sweep, its submission
    and its table included; peer: all of it
    wanted    the share of that time in which a worker ran or waited for a core that others held:
    what `busy` would be on a quiet machine
    machine   the same of every process, the client among them (from /proc/stat: what else runs
    counts too)
    overhead  CPU seconds of the workers over those of the same points in one process, --local

MODALD_BENCH_POINTS (200) is the side of the grid.  The table must be --local's before a figure
counts.
"""
import json
import math
import os
import pathlib
import subprocess
import sys
import tempfile
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "system"))
from wire import BUILD, Daemon    # noqa: E402

POINTS, WORKERS, TICK = int(os.environ.get("MODALD_BENCH_POINTS",
                                           "200")), 2, os.sysconf("SC_CLK_TCK")
EI, M = 6570.0, 3.24              # N m^2, kg/m, of a beam of 1 m
W1, P1 = math.pi ** 2 * math.sqrt(EI / M), math.pi ** 2 * EI


def say(case, value, unit, peer, ratio, n):
    print(json.dumps({"bench": "sweep", "case": case, "value": round(value, 3), "unit": unit,
                      "peer": peer, "ratio": round(ratio, 3), "n": n}), flush=True)


def strutt(elements):
    structure = {"type": "beam", "length": 1, "elements": elements, "EI": EI, "mass_per_length": M}
    mu, omega = ([low + (high - low) * (i + 0.5) / POINTS for i in range(POINTS)]
                 for low, high in ((0, 0.45), (0.4, 1.4)))
    return {"verb": "floquet",
            "scene": {"structure": structure, "omega": 2 * W1,
                      "effects": [{"type": "axial_load", "amplitude": P1}]},
            "options": {"hill": False},
            "grid": [{"path": "effects[0].amplitude", "values": [2 * P1 * m for m in mu]},
                     {"path": "omega", "values": [2 * W1 * o for o in omega]}]}


def descendants(pid):
    """The daemon's processes below it, to any depth."""
    parents = {}
    for stat in pathlib.Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rsplit(")", 1)[1].split()
        except OSError:
            continue
        parents.setdefault(int(fields[1]), []).append(int(stat.parent.name))
    found, todo = [], [pid]
    while todo:
        children = parents.get(todo.pop(), [])
        found += children
        todo += children
    return found


def cpu(pids):
    total = 0
    for pid in pids:
        try:
            fields = pathlib.Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
        except OSError:
            continue
        total += int(fields[11]) + int(fields[12])
    return total / TICK


def wanted(pids):
    """Seconds in which the main threads of PIDS ran or stood in the run queue."""
    total = 0
    for pid in pids:
        try:
            total += sum(map(int, pathlib.Path(f"/proc/{pid}/schedstat").read_text().split()[:2]))
        except OSError:
            continue
    return total / 1e9


def machine_busy():
    user, nice, system, idle, iowait, *rest = map(int,
                                                  pathlib.Path("/proc/stat").read_text().split(
        "\n", 1)[0].split()[1:])
    return (user + nice + system + sum(rest[:3])) / TICK


def main():
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "sweep.json"
        path.write_text(json.dumps(strutt(elements=1)))
        command = [str(BUILD / "bin/modalctl"), "--json"]
        before = os.times()
        local = subprocess.run([*command, "--local", "sweep", str(path)], capture_output=True,
                               check=True)
        after = os.times()
        alone = (after.children_user + after.children_system - before.children_user
                 - before.children_system)
        daemon = Daemon(workers=WORKERS)
        try:
            pids = descendants(daemon.pid)
            start, used, busy, asked = time.monotonic(), cpu(pids), machine_busy(), wanted(pids)
            served = subprocess.run([*command, "--server", daemon.endpoint, "sweep", str(path),
                                     "--wait"], capture_output=True, check=True)
            wall, pids = time.monotonic() - start, descendants(daemon.pid)
            used, busy, asked = cpu(pids) - used, machine_busy() - busy, wanted(pids) - asked
        finally:
            daemon.stop()
        a, b = json.loads(local.stdout), json.loads(served.stdout)
        assert (len(b["points"]) == POINTS ** 2
                and a["points"] == b["points"]), "the table differs from --local's"
    n = POINTS ** 2
    say(f"busy {POINTS}x{POINTS}", used / (WORKERS * wall), "of the two workers' wall time", "1",
        used / (WORKERS * wall), n)
    say(f"wanted {POINTS}x{POINTS}", asked / (WORKERS * wall), "of the two workers' wall time",
        "1", asked / (WORKERS * wall), n)
    say(f"machine {POINTS}x{POINTS}", busy / (os.cpu_count() * wall), "of all cores", "1",
        busy / (os.cpu_count() * wall), n)
    say(f"overhead {POINTS}x{POINTS}", used, "CPU s", "--local", used / alone, n)


if __name__ == "__main__":
    main()
