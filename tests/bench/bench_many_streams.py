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
    close      ms of each stream's close, one after the other

`ratio` is the figure a stream over that of the first number of streams; of ages, threads and closes
of the figure itself.

Then the most of these streams, driven, from 1 host and from 40, with a hop by which windows ask for
3 times and for 0.7 of the workers' time.  What a window takes of that is measured just before: at 3
in a run at rest, at 0.7 in the one at 3, from as many hosts, so that what these take is counted:

    told       streams that were told of a window, of all
    left out   windows, of those that were due; at 0.7 none, at 3 two thirds
    interval   s between a stream's windows, on average: the longest over the shortest of all
    daemon     of a core, without its workers; workers and hosts, of them all

$MODALD_STREAMS: the numbers, as `50 100`; $MODALD_SECONDS: how long each runs (20); $MODALD_LOADS,
as `0.7`, and $MODALD_HOSTS, as `1`.  All of it takes some 8 minutes, on a machine that does nothing
else: at 0.7 two workers, the daemon and the hosts take two cores.
"""
import collections
import json
import os
import pathlib
import statistics
import subprocess
import sys
import threading
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "system"))
from wire import Daemon                      # noqa: E402

HOST = pathlib.Path(os.environ.get("MODALD_BUILD", "build")) / "fault" / "many_streams"
NUMBERS = [int(n) for n in os.environ.get("MODALD_STREAMS", "50 100 200 400").split()]
SECONDS, CHANNELS, RATE = float(os.environ.get("MODALD_SECONDS", "20")), 8, 100
LOADS = [float(x) for x in os.environ.get("MODALD_LOADS", "3 0.7").split()]
HOSTS = [int(n) for n in os.environ.get("MODALD_HOSTS", "1 40").split()]
WORKERS = 2
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


def begin_host(daemon, n, seconds, first, kind, hop):
    """A host of N streams from FIRST on, with windows of 5 s every HOP samples."""
    env = {**os.environ, "MODALD_URL": daemon.endpoint, "MODALD_SPILL": str(daemon.folder),
           "MODALD_CLOSE_WAIT": "60", "MODALD_WINDOW": str(5 * RATE), "MODALD_HOP": str(hop),
           "MODALD_OPTIONS": '{"rank.fixed":4}'}
    return subprocess.Popen([str(HOST), str(n), str(CHANNELS), str(RATE), str(seconds), "",
                             str(first), kind], stdout=subprocess.PIPE, text=True, env=env)


def run(kind, n):
    """Print the figures of N streams of one host; s of a worker that a window takes."""
    with Daemon(workers=WORKERS) as daemon:
        pid = daemon.process.pid
        host = begin_host(daemon, n, SECONDS, 0, kind, RATE)
        before, lines = None, []
        for line in host.stdout:
            lines.append((json.loads(line), cpu_s(pid), cpu_s(host.pid),
                          sum(map(cpu_s, daemon.children())), windows_of(daemon)))
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
    say(kind, "close", n, 1e3 * (lines[-1][0]["s"] - last["s"]) / n, "ms", each=False)
    if last["refused"] or last["dropped"]:
        sys.exit(f"many_streams: {last['refused']} of {n} streams were refused, "
                 f"{last['dropped']} samples dropped")
    return worked_s / windows if windows > 0 else None


def hear(client, until, heard):
    """Of each window that is told until then: when, of which stream, and how many were left out."""
    while time.monotonic() < until:
        if client.early or client.socket.poll(200):
            event = client.early.pop(0) if client.early else client.receive()
            if event.verb == "EVENT" and event["event"] == "modes":
                heard.append((time.monotonic(), event["stream"], event["skipped"]))


def used(daemon, hosts):
    """s of a processor so far, of each."""
    return {"daemon": cpu_s(daemon.process.pid), "workers": sum(map(cpu_s, daemon.children())),
            "hosts": sum(cpu_s(host.pid) for host in hosts)}


def share(hosts, n, load, cost_s):
    """N driven streams of HOSTS, whose windows cost COST_S each, and ask for LOAD of the workers;
    what a window cost then, where that is more than there is.  Figures are of what is told once
    each stream has had its turn, for eight turns at least: of those that follow upon each other
    one stream is at first the last, then the first."""
    hop_s = n * cost_s / (WORKERS * load)
    turn_s = max(hop_s, n * cost_s / WORKERS)
    seconds = 5 + 2 * hop_s + turn_s + max(SECONDS, 8 * turn_s)
    with Daemon(workers=WORKERS) as daemon:
        client, heard = daemon.client(), []
        client.ask("EVENTS", kinds=["modes"])
        begun = time.monotonic()
        each = n // hosts
        hop = max(1, round(hop_s * RATE))
        running = [begin_host(daemon, each, seconds, k * each, "driven", hop)
                   for k in range(hosts)]
        lines = [[] for _ in running]
        readers = [threading.Thread(target=lambda of=of, host=host: of.extend(
                                        map(json.loads, host.stdout)))
                   for of, host in zip(lines, running)]
        for reader in readers:
            reader.start()
        hear(client, begun + 5, heard)
        before, since = used(daemon, running), time.monotonic()
        hear(client, begun + seconds - 1, heard)
        cores = {of: (s - before[of]) / (time.monotonic() - since)
                 for of, s in used(daemon, running).items()}
        hear(client, begun + seconds, heard)
        for reader in readers:
            reader.join()
        client.close()
        if any(host.wait() != 0 for host in running):
            sys.exit("many_streams: a host ended with an error")
    late = begun + 5 + 2 * hop_s + turn_s
    since = [one for one in heard if one[0] > late]
    left_out = sum(skipped for _, _, skipped in since)
    times = collections.defaultdict(list)
    for at, stream, _ in since:
        times[stream].append(at)
    intervals = [(at[-1] - at[0]) / (len(at) - 1) for at in times.values() if len(at) > 1]
    last = [of[-2] for of in lines]
    case = f"driven ({hosts} hosts, load {load:g})"
    say(case, "told", n, len({stream for _, stream, _ in heard}), "streams")
    say(case, "left out", n, left_out / max(1, left_out + len(since)), "of windows", each=False)
    if intervals:
        say(case, "interval", n, statistics.median(intervals), "s", each=False)
        say(case, "longest over shortest interval", n, max(intervals) / min(intervals), "ratio",
            each=False)
    say(case, "spilled", n, sum(one["spilled"] + one["dropped"] for one in last), "samples")
    for of, each in cores.items():
        say(case, of, n, each, "cores")
    return WORKERS * (seconds - (late - begun)) / len(since) if load > 1 and since else cost_s


cost = None
for kind in ("free", "driven"):
    for number in NUMBERS:
        cost = run(kind, number) or cost
for hosts in HOSTS:
    taken = cost
    for load in LOADS:
        taken = share(hosts, NUMBERS[-1], load, taken)
