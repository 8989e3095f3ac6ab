#!/usr/bin/python3
"""Streams of one host against their number: 50, 100, 200 and 400 of 8 channels at 100 Hz, windows
of 5 s every second, two workers.  `free` ones swing on, and a window is brought up to date from the
one before; those that noise drives never settle, and each window is found from nothing.

    daemon     of a core, without its workers, in a second of real time
    workers    of a core, both together
    window     ms of a worker, on average
    host       of a core, what simulates included; threads and resident memory that the streams
               cost it
    age        s from the sample that a live result rests on to the last one pushed, over the
               streams: median, and the eldest over the youngest
    live       streams that have a result in the end
    spilled    samples that were not taken in time, or dropped

`ratio` is the figure a stream over that of the first number of streams; of ages and threads of the
figure itself.  $MODALD_STREAMS: the numbers, as `50 100`; $MODALD_SECONDS: how long each runs (20).
"""
import json
import os
import pathlib
import subprocess
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "system"))
from wire import Daemon                      # noqa: E402

HOST = pathlib.Path(os.environ.get("MODALD_BUILD", "build")) / "fault" / "many_streams"
NUMBERS = [int(n) for n in os.environ.get("MODALD_STREAMS", "50 100 200 400").split()]
SECONDS, CHANNELS, RATE = float(os.environ.get("MODALD_SECONDS", "20")), 8, 100
FIRST = {}


def say(kind, case, n, value, unit, each=True):
    share = value / n if each else value
    first = FIRST.setdefault((kind, case), share)
    ratio = share / first if first else 1.0
    print(json.dumps({"bench": "many_streams", "case": f"{case} of {n} {kind} streams",
                      "value": round(value, 4), "unit": unit, "peer": f"{NUMBERS[0]} streams",
                      "ratio": round(ratio, 3), "n": n}), flush=True)


def cpu_s(pid):
    used = pathlib.Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return sum(map(int, used[11:13])) / os.sysconf("SC_CLK_TCK")


def windows_of(daemon):
    client = daemon.client()
    told = client.ask("STATS")["streams"]["windows"]
    client.close()
    return told


def run(kind, n):
    with Daemon(workers=2) as daemon:
        pid = daemon.process.pid
        env = {**os.environ, "MODALD_URL": daemon.endpoint, "MODALD_SPILL": str(daemon.folder),
               "MODALD_CLOSE_WAIT": "60", "MODALD_WINDOW": str(5 * RATE),
               "MODALD_HOP": str(RATE), "MODALD_OPTIONS": '{"rank.fixed":4}'}
        host = subprocess.Popen([str(HOST), str(n), str(CHANNELS), str(RATE), str(SECONDS),
                                 "", "0", kind],
                                stdout=subprocess.PIPE, text=True, env=env)
        before, lines = None, []
        for line in host.stdout:
            lines.append((json.loads(line), cpu_s(pid), cpu_s(host.pid), sum(map(cpu_s, daemon.children())),
                          windows_of(daemon)))
            before = before or lines[-1]
        if host.wait() != 0 or len(lines) < 3:
            sys.exit(f"many_streams: the host ended with {host.returncode}")
    last, daemon_s, host_s, worked_s, windows = lines[-2]
    span = last["s"] - before[0]["s"]
    worked_s, windows = worked_s - before[3], windows - before[4]
    say(kind, "daemon", n, (daemon_s - before[1]) / span, "cores")
    say(kind, "workers", n, worked_s / span, "cores")
    if windows > 0:
        say(kind, "window", n, 1e3 * worked_s / windows, "ms", each=False)
    say(kind, "host", n, (host_s - before[2]) / span, "cores")
    say(kind, "threads", n, last["threads"], "threads", each=False)
    say(kind, "memory", n, last["rss_kb"] / 1024, "MB")
    say(kind, "age", n, last["age_s"][1], "s", each=False)
    youngest, _, eldest = last["age_s"]
    if youngest > 0:
        say(kind, "eldest over youngest", n, eldest / youngest, "ratio", each=False)
    say(kind, "live", n, last["live"], "streams")
    say(kind, "spilled", n, last["spilled"] + last["dropped"], "samples")
    if last["refused"] or last["dropped"]:
        sys.exit(f"many_streams: {last['refused']} of {n} streams were refused, "
                 f"{last['dropped']} samples dropped")


for kind in ("free", "driven"):
    for number in NUMBERS:
        run(kind, number)
