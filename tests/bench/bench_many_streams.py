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
3 times and for 0.7 of what the workers have:

    told       streams that were told of a window, of all
    left out   windows, of those that were due; at 0.7 none, at 3 two thirds
    age        s of a stream's newest result, from the sample that it rests on, averaged over time:
               the median of all, and the oldest over the youngest
    daemon     of a core, without its workers; workers and hosts, of them all

What a window costs and what the workers have is measured first, beside as many hosts: once each
stream has been told of one, while all ask for one a second.  Where they are not all served then,
the workers have the processors that they got: hosts and daemon take their part of the machine.
Thinning lasts as long as TURNS of each stream take: over k turns and a part of one the mean age is
within 1 / (4 k) of what it is for ever, so that what even ones show is under 1.07.

$MODALD_STREAMS: the numbers, as `50 100`; $MODALD_SECONDS: how long each runs (20); $MODALD_LOADS,
as `0.7`, and $MODALD_HOSTS, as `1`.  All of it takes some 15 minutes.

With words, one run of one load, and each figure beside what is wanted of it:

    bench_many_streams.py --streams 400 --seconds 600 --kills 5     (8 channels, 100 Hz, one host)
    bench_many_streams.py --streams 400 --hosts 40
    bench_many_streams.py --streams 400 --load 3
    bench_many_streams.py --streams 1000 --rate 10
    bench_many_streams.py --streams 10 --rate 10000 --channels 64 --seconds 30

The daemon is killed --kills times, and started again at once.  In the end each record is held
against its host's log, sample for sample, where the logs take less than 4 GB.  It ends by itself,
three minutes after its time at the latest; status 1: a figure is not as wanted.
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
    """Print the figures of N streams of one host."""
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


def used(daemon, hosts):
    """s of a processor so far, of each."""
    return {"daemon": cpu_s(daemon.process.pid), "workers": sum(map(cpu_s, daemon.children())),
            "hosts": sum(cpu_s(host.pid) for host in hosts)}


# ---- one run, and what is wanted of it ----

BODY_MOST, LOGS_MOST = 1 << 20, 4 << 30      # bytes: of a window (PROTOCOL.md), of all logs
PATIENCE_S = 180
TURNS, WEIGHED = 8, 100                      # windows: of each stream; by which one is weighed


Heard = collections.namedtuple("Heard", "at stream skipped lag_s")


def hear(client, until, heard, rate=RATE, enough=lambda: False):
    """Of each window that is told until then, or there are enough: when, of which stream, how many
    were left out, and how old its last sample is.  The number of the last event."""
    number = 0
    while time.monotonic() < until and not enough():
        if client.early or client.socket.poll(200):
            event = client.early.pop(0) if client.early else client.receive()
            if event.verb == "EVENT" and event["event"] == "modes":
                number = event["number"]
                heard.append(Heard(time.monotonic(), event["stream"], event["skipped"],
                                   event.get("lag", {}).get("samples", 0) / rate))
    return number


def hosts_of(words, daemon, seconds, hop, logs=""):
    each = words.streams // words.hosts
    return [begin_host(daemon, each, seconds, k * each, words.kind, hop, words.channels, words.rate,
                       logs, words.window) for k in range(words.hosts)]


def weigh(words):
    """What a window takes of a worker, s, and the processors that the workers have."""
    with Daemon(workers=WORKERS) as daemon:
        client, heard, told = daemon.client(), [], []
        client.ask("EVENTS", kinds=["modes"])
        hosts = hosts_of(words, daemon, 2 * PATIENCE_S, max(1, round(words.rate)))
        n, until = words.streams // words.hosts * words.hosts, time.monotonic() + PATIENCE_S
        try:
            hear(client, until, heard, words.rate,
                 lambda: len({one.stream for one in heard[-10 * n:]}) == n)
            before, since = used(daemon, hosts)["workers"], time.monotonic()
            hear(client, until, told, words.rate, lambda: len(told) >= max(n, WEIGHED))
            worked_s = used(daemon, hosts)["workers"] - before
            if len(told) < WEIGHED:
                sys.exit(f"many_streams: {len(told)} windows in {PATIENCE_S} s: the machine does "
                         "something else")
            cores = worked_s / (time.monotonic() - since)
            late = sum(one.skipped for one in told) > len(told) / 10
            return worked_s / len(told), cores if late else WORKERS
        finally:
            client.close()
            for host in hosts:
                host.kill()
                host.wait()


class Run:
    """Hosts with their streams, a daemon that is killed under them, and what is told of windows:
    where these cost COST_S each, and workers have CORES."""

    def __init__(self, words, cost_s, cores, logs=""):
        n = words.streams // words.hosts * words.hosts
        turn_s = n * cost_s / cores
        self.words, self.logs, self.each = words, logs, words.streams // words.hosts
        self.hop = max(1, round(turn_s / words.load * words.rate))
        # s until each stream has had its turn, and from where hops count of those begun together
        self.late_s = 5 + (words.window + 2 * self.hop) / words.rate
        self.late_s += turn_s if words.load > 1 else 0
        self.seconds = max(words.seconds, self.late_s + (TURNS * turn_s if words.load > 1 else
                                                         2 * self.hop / words.rate))
        self.heard, self.number, self.cores = [], 0, collections.Counter()
        with Daemon(workers=WORKERS) as daemon:
            self.hosts = hosts_of(words, daemon, self.seconds, self.hop, logs)
            self.lines = [[] for _ in self.hosts]
            readers = [threading.Thread(target=lambda of=of, host=host: of.extend(
                                            map(json.loads, host.stdout)), daemon=True)
                       for of, host in zip(self.lines, self.hosts)]
            for reader in readers:
                reader.start()
            try:
                self.follow(daemon, words.kills)
                deadline = time.monotonic() + PATIENCE_S
                self.ended = [host.wait(max(1, deadline - time.monotonic())) for host in self.hosts]
                for reader in readers:
                    reader.join(10)
                self.close_s = time.monotonic() - self.begun - self.seconds
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
            client = daemon.client()
            client.ask("EVENTS", kinds=["modes"], **{"from": self.number + 1})
            self.ended_at = self.begun + (self.seconds - 1) * (k + 1) / (kills + 1)
            self.number = hear(client, self.ended_at, self.heard, self.words.rate) or self.number
            client.close()
            for of, s in used(daemon, self.hosts).items():
                self.cores[of] += s - before[of]
            self.cores["s"] += time.monotonic() - since
            if k < kills:
                daemon.kill()
                daemon.start()

    def settled(self):
        """What was heard once all had begun."""
        return [one for one in self.heard if one.at > self.begun + self.late_s]

    def window_s(self):
        """s of a worker that a window took."""
        return self.cores["workers"] / max(1, len(self.heard))

    def ages(self):
        """Of each stream that was told of a window by then, s of its newest result from the sample
        that it rests on, averaged over the time once all had begun."""
        begin, times = self.begun + self.late_s, collections.defaultdict(list)
        for one in self.heard:
            times[one.stream].append(one)
        ages = []
        for told in times.values():
            area, ends = 0, [one.at for one in told[1:]] + [self.ended_at]
            for one, end in zip(told, ends):
                since = max(one.at, begin)
                if end > since:
                    area += (end - since) * ((since + end) / 2 - one.at + one.lag_s)
            if told[0].at <= begin < self.ended_at:
                ages.append(area / (self.ended_at - begin))
        return ages


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


def report(run, cores):
    """Each figure beside what is wanted; False: one is not so."""
    words, n = run.words, run.each * len(run.hosts)
    last = [of[-2] for of in run.lines if len(of) > 1]
    settled, ages = run.settled(), run.ages()
    left_out = sum(one.skipped for one in settled)
    told = collections.Counter(one.stream for one in settled)
    thinned = words.load > 1
    rows = [
        ("hosts that ended well", sum(one == 0 for one in run.ended), "==", len(run.hosts)),
        ("streams live in the end", sum(one["live"] for one in last), "==", n),
        ("streams told of a window", len({one.stream for one in run.heard}), "==", n),
        ("samples pushed, of what is due", sum(one["pushed"] for one in last) /
         (n * words.rate * run.seconds), ">=", 0.99),
        ("samples spilled", sum(one["spilled"] for one in last), "==", 0),
        ("samples dropped", sum(one["dropped"] for one in last), "==", 0),
        ("samples refused", sum(one["refused"] for one in last), "==", 0),
        ("spill files in the end", run.spill_files, "==", 0),
        ("records that are their logs", records_right(run), "==", n if run.logs else None),
        ("daemon, cores", run.cores["daemon"] / run.cores["s"], "<=", 0.3),
        ("threads of a host", max(one["threads"] for one in last), "<=", 3),
        ("MB of a host a stream", sum(one["rss_kb"] for one in last) / 1024 / n, "<=", 2),
        ("windows left out, %", 100 * left_out / max(1, left_out + len(settled)), "<=",
         0 if words.load <= 0.7 else None),
        ("windows of a stream, least", min(told.values()) if len(told) == n else 0, ">=",
         TURNS // 2 if thinned else 1),
        ("streams with an age", len(ages), "==", n if thinned else None),
        ("mean age, oldest over youngest", max(ages) / min(ages) if ages else float("nan"), "<=",
         1.5 if thinned else None),
        ("mean age, median, s", statistics.median(ages) if ages else float("nan"), "", None),
        ("asked of the workers, of what they have",
         n * run.window_s() * words.rate / run.hop / cores, ">=",
         None if thinned else 0.85 * words.load),
        ("workers, cores", run.cores["workers"] / run.cores["s"], "~", min(words.load, 1) * cores),
        ("hosts, cores", run.cores["hosts"] / run.cores["s"], "", None),
        ("ms of a worker a window", 1e3 * run.window_s(), "", None),
        ("s between windows of a stream", run.hop / words.rate, "", None),
        ("s after the last sample, until all was sealed", run.close_s, "", None),
        ("load of the machine", os.getloadavg()[0], "", None),
    ]
    good = True
    for name, value, sign, wanted in rows:
        right = wanted is None or {"==": value == wanted, "<=": value <= wanted,
                                   ">=": value >= wanted}.get(sign, True)
        good &= right
        print(f"{name:46s} {value:12.4g}   {f'{sign} {wanted:g}' if wanted is not None else '':12s}"
              f" {'' if right else 'NO'}", flush=True)
    return good


def one_run(words):
    """What a window costs with windows every second, then the run."""
    words.window = min(int(5 * words.rate), BODY_MOST // (8 * words.channels))
    cost_s, cores = weigh(words)
    bytes_s = words.streams * words.rate * words.channels * 8
    with tempfile.TemporaryDirectory(prefix="mdlogs") as folder:
        run = Run(words, cost_s, cores, folder if bytes_s * words.seconds < LOGS_MOST else "")
        print(f"{words.streams} streams of {words.channels} channels at {words.rate:g} Hz, "
              f"{words.hosts} hosts, {run.seconds:.0f} s, {words.kills} kills, load "
              f"{words.load:g}: windows of {words.window} samples every {run.hop}, "
              f"{1e3 * cost_s:.3g} ms each before, workers with {cores:.3g} cores", flush=True)
        return 0 if report(run, cores) else 1


def share(hosts, n):
    """The figures of N driven streams of HOSTS at each load."""
    words = argparse.Namespace(streams=n, hosts=hosts, channels=CHANNELS, rate=RATE, kills=0,
                               seconds=SECONDS, kind="driven", window=5 * RATE)
    weight = weigh(words)
    for words.load in LOADS:
        run = Run(words, *weight)
        if any(run.ended):
            sys.exit("many_streams: a host ended with an error")
        settled, ages, last = run.settled(), run.ages(), [of[-2] for of in run.lines]
        left_out = sum(one.skipped for one in settled)
        case = f"driven ({hosts} hosts, load {words.load:g})"
        say(case, "told", n, len({one.stream for one in run.heard}), "streams")
        say(case, "left out", n, left_out / max(1, left_out + len(settled)), "of windows",
            each=False)
        if ages:
            say(case, "age", n, statistics.median(ages), "s", each=False)
            say(case, "oldest over youngest age", n, max(ages) / min(ages), "ratio", each=False)
        say(case, "spilled", n, sum(one["spilled"] + one["dropped"] for one in last), "samples")
        for of in ("daemon", "workers", "hosts"):
            say(case, of, n, run.cores[of] / run.cores["s"], "cores")


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
for kind in ("free", "driven"):
    for number in NUMBERS:
        run(kind, number)
for hosts in HOSTS:
    share(hosts, NUMBERS[-1])
