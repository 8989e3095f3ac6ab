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
    close      ms a stream, all of them closed at once

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

With words, one run of one load, and each figure beside what is wanted of it:

    bench_many_streams.py --streams 400 --seconds 600 --kills 5     (8 channels, 100 Hz, one host)
    bench_many_streams.py --streams 400 --hosts 40
    bench_many_streams.py --streams 400 --load 3
    bench_many_streams.py --streams 1000 --rate 10
    bench_many_streams.py --streams 10 --rate 10000 --channels 64 --seconds 30

What a window costs is measured first, for 10 s; windows are then so many that they take --load of
the workers' time.  The daemon is killed --kills times, and started again at once.  In the end each
record is held against its host's log, sample for sample, where the logs take less than 4 GB.  It
ends by itself, at the latest three minutes after --seconds; status 1: a figure is not as wanted.
"""
import argparse
import collections
import json
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile
import threading
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "system"))
from wire import Daemon, identity            # noqa: E402

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


def begin_host(daemon, n, seconds, first, kind, hop, channels=CHANNELS, rate=RATE, logs="",
               window=5 * RATE):
    """A host of N streams from FIRST on, with windows of 5 s every HOP samples."""
    env = {**os.environ, "MODALD_URL": daemon.endpoint, "MODALD_SPILL": str(daemon.folder),
           "MODALD_CLOSE_WAIT": "60", "MODALD_WINDOW": str(window), "MODALD_HOP": str(hop),
           "MODALD_OPTIONS": '{"rank.fixed":4}'}
    return subprocess.Popen([str(HOST), str(n), str(channels), str(rate), str(seconds), str(logs),
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


# ---- one run, and what is wanted of it ----

BODY_MOST, LOGS_MOST = 1 << 20, 4 << 30      # bytes: of a window (PROTOCOL.md), of all logs
PATIENCE_S = 180
AFTER_S = 10                                 # after a kill: what was late by it is told by then


class Run:
    """Hosts with their streams, a daemon that is killed under them, and what is told of windows."""

    def __init__(self, words, seconds, hop, kills, logs):
        self.words, self.seconds, self.hop, self.logs = words, seconds, hop, logs
        self.each = words.streams // words.hosts
        self.heard, self.number, self.killed, self.cores = [], 0, [], collections.Counter()
        with Daemon(workers=WORKERS) as daemon:
            self.hosts = [begin_host(daemon, self.each, seconds, k * self.each, words.kind, hop,
                                     words.channels, words.rate, logs, words.window)
                          for k in range(words.hosts)]
            self.lines = [[] for _ in self.hosts]
            readers = [threading.Thread(target=lambda of=of, host=host: of.extend(
                                            map(json.loads, host.stdout)), daemon=True)
                       for of, host in zip(self.lines, self.hosts)]
            for reader in readers:
                reader.start()
            try:
                self.follow(daemon, kills)
                deadline = time.monotonic() + PATIENCE_S
                self.ended = [host.wait(max(1, deadline - time.monotonic())) for host in self.hosts]
                for reader in readers:
                    reader.join(10)
                self.close_s = time.monotonic() - self.begun - seconds
                self.spans = [line["s"] for of in self.lines for line in of[-1:]]
                self.sealed = sealed(daemon)
                self.spill_files = len(list(daemon.folder.glob("*.spill")))
            finally:
                for host in self.hosts:
                    host.kill()

    def follow(self, daemon, kills):
        """Until the hosts close their streams: the daemon is killed at equal times."""
        self.begun = time.monotonic()
        for k in range(kills + 1):
            before, since = used(daemon, self.hosts), time.monotonic()
            self.hear(daemon, self.begun + (self.seconds - 1) * (k + 1) / (kills + 1))
            for of, s in used(daemon, self.hosts).items():
                self.cores[of] += s - before[of]
            self.cores["s"] += time.monotonic() - since
            if k < kills:
                self.killed.append(time.monotonic())
                daemon.kill()
                daemon.start()

    def hear(self, daemon, until):
        client = daemon.client()
        client.ask("EVENTS", kinds=["modes"], **{"from": self.number + 1})
        while time.monotonic() < until:
            if client.early or client.socket.poll(200):
                event = client.early.pop(0) if client.early else client.receive()
                if event.verb == "EVENT" and event["event"] == "modes":
                    self.number = event["number"]
                    self.heard.append((time.monotonic(), event["stream"], event["skipped"]))
        client.close()

    def settled(self):
        """What was heard once all had begun, and not within AFTER_S of a kill."""
        first = self.begun + (self.words.window + 2 * self.hop) / self.words.rate
        return [one for one in self.heard if one[0] > first
                and not any(0 <= one[0] - at < AFTER_S for at in self.killed)]

    def window_s(self):
        """s of a worker that a window took."""
        return self.cores["workers"] / max(1, len(self.heard))

    def intervals(self):
        times = collections.defaultdict(list)
        for at, stream, _ in self.settled():
            times[stream].append(at)
        return [max(b - a for a, b in zip(at, at[1:])) if self.killed else
                (at[-1] - at[0]) / (len(at) - 1) for at in times.values() if len(at) > 1]


def sealed(daemon):
    """Of each stream that has a batch its samples and SHA-256."""
    client, found, after = daemon.client(), {}, {}
    while True:
        page = json.loads(client.ask("STREAMS", limit=1000, **after).body[0])
        found.update({one["name"]: (one["samples"], one["sha256"]) for one in page["streams"]
                      if one["state"] == "sealed"})
        if page["next"] is None:
            client.close()
            return found
        after = {"after": page["next"]}


def records_right(run):
    """Streams whose batch is their log, of all; NaN where there are no logs."""
    if not run.logs:
        return float("nan")
    right = 0
    for k in range(run.each * run.words.hosts):
        data = pathlib.Path(run.logs, f"many-{k}").read_bytes()
        samples, sha256 = run.sealed.get(f"many-{k}", (0, ""))
        right += sha256 == identity(len(data) // (8 * run.words.channels), run.words.channels,
                                    1 / run.words.rate, data)
    return right


def report(run):
    """Each figure beside what is wanted; False: one is not so."""
    words, n = run.words, run.each * len(run.hosts)
    last = [of[-2] for of in run.lines if len(of) > 1]
    settled, spans = run.settled(), run.intervals()
    left_out = sum(one[2] for one in settled)
    rows = [
        ("hosts that ended well", sum(one == 0 for one in run.ended), "==", len(run.hosts)),
        ("streams live in the end", sum(one["live"] for one in last), "==", n),
        ("streams told of a window", len({one[1] for one in run.heard}), "==", n),
        ("samples pushed, of what is due", sum(one["pushed"] for one in last) /
         (n * words.rate * run.seconds), ">=", 0.99),
        ("samples spilled", sum(one["spilled"] for one in last), "==", 0),
        ("samples dropped", sum(one["dropped"] for one in last), "==", 0),
        ("samples refused", sum(one["refused"] for one in last), "==", 0),
        ("spill files in the end", run.spill_files, "==", 0),
        ("records that are their logs", records_right(run), "==", n),
        ("daemon, cores", run.cores["daemon"] / run.cores["s"], "<=", 0.3),
        ("threads of a host", max(one["threads"] for one in last), "<=", 3),
        ("MB of a host a stream", sum(one["rss_kb"] for one in last) / 1024 / n, "<=", 2),
        ("windows left out, %", 100 * left_out / max(1, left_out + len(settled)), "<=",
         0 if words.load <= 0.7 else None),
        ("longest over shortest interval", max(spans) / min(spans) if spans else float("nan"), "<=",
         1.5 if words.load > 1 else None),
        ("workers, cores", run.cores["workers"] / run.cores["s"], "~", words.load * WORKERS),
        ("hosts, cores", run.cores["hosts"] / run.cores["s"], "", None),
        ("ms of a worker a window", 1e3 * run.window_s(), "", None),
        ("s between windows of a stream", run.hop / words.rate, "", None),
        ("s after the last sample, until all was sealed", run.close_s, "", None),
        ("load of the machine", os.getloadavg()[0], "", None),
    ]
    good = True
    for name, value, sign, wanted in rows:
        right = {"==": value == wanted, "<=": wanted is None or value <= wanted,
                 ">=": wanted is None or value >= wanted}.get(sign, True) or value != value
        good &= right
        print(f"{name:46s} {value:12.4g}   {f'{sign} {wanted:g}' if wanted is not None else '':12s}"
              f" {'' if right else 'NO'}", flush=True)
    return good


def one_run(words):
    """What a window costs with windows every second, then the run."""
    words.window = min(int(5 * words.rate), BODY_MOST // (8 * words.channels))
    cost_s = Run(words, 5 + 10, max(1, round(words.rate)), 0, "").window_s()
    hop = max(1, round(words.streams * cost_s / (WORKERS * words.load) * words.rate))
    bytes_s = words.streams * words.rate * words.channels * 8
    with tempfile.TemporaryDirectory(prefix="mdlogs") as folder:
        logs = folder if bytes_s * words.seconds < LOGS_MOST else ""
        print(f"{words.streams} streams of {words.channels} channels at {words.rate:g} Hz, "
              f"{words.hosts} hosts, {words.seconds:g} s, {words.kills} kills, "
              f"load {words.load:g}: "
              f"windows of {words.window} samples every {hop}, {1e3 * cost_s:.3g} ms each before",
              flush=True)
        return 0 if report(Run(words, words.seconds, hop, words.kills, logs)) else 1


def words_read():
    parser = argparse.ArgumentParser(description="one run with many streams")
    for name, of, value in (("streams", int, 400), ("hosts", int, 1), ("channels", int, CHANNELS),
                            ("rate", float, RATE), ("seconds", float, 60.0), ("kills", int, 0),
                            ("load", float, 0.7)):
        parser.add_argument(f"--{name}", type=of, default=value)
    parser.add_argument("--kind", choices=("free", "driven"), default="driven")
    return parser.parse_args()


# ---- all of it ----

if sys.argv[1:]:
    sys.exit(one_run(words_read()))
cost = None
for kind in ("free", "driven"):
    for number in NUMBERS:
        cost = run(kind, number) or cost
for hosts in HOSTS:
    taken = cost
    for load in LOADS:
        taken = share(hosts, NUMBERS[-1], load, taken)
