"""F23: everything at once for MODALD_SOAK_SECONDS (60; nightly 3600), on real workers: no job lost
or wrong, nothing leaks.

Five kinds of client work beside each other while workers are killed, the daemon drains and undrains
and reads its configuration again.  Each client checks its own answers; in the end `modalctl fsck`
finds nothing.  Retention is of seconds, so that what the daemon holds has a steady size: memory and
descriptors are compared between two stretches of the run.
"""
import contextlib
import json
import os
import pathlib
import random
import signal
import statistics
import struct
import subprocess
import sys
import threading
import time

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "system"))
import sanitized  # noqa: E402
from test_durability import ended, patiently  # noqa: E402
from wire import (  # noqa: E402
    BUILD, PATIENCE_S, Client, Daemon, crc32c, identity, ring_down, scene_job)

SECONDS = float(os.environ.get("MODALD_SOAK_SECONDS", 60))
CONFIG = ("result_age_s = 3\ninput_age_s = 3\ntombstone_age_s = 6\nevents_kept = 1024\nqueue_jobs "
          "= 1000\n")
FIXED = {"rank.fixed": 2}
# of an upload: a job that takes as long as workers live is done on no machine that is busy
PART = {"rank.fixed": 2, "rows": 8, "window": [0, 2]}


class Load(threading.Thread):
    """One client that does WORK(client, i) over and over."""

    def __init__(self, daemon, name, work):
        super().__init__(daemon=True, name=name)
        self.endpoint, self.work, self.done, self.error, self.stop = (daemon.endpoint, work, 0,
                                                                      None, threading.Event())

    def run(self):
        client = Client(self.endpoint, timeout_s=5)
        try:
            while not self.stop.is_set():
                self.work(client, self.done)
                self.done += 1
        except BaseException as error:
            self.error = error
        finally:
            client.close()


def finish(client, job):
    """Wait to the end; one whose workers were killed three times is tried again, as its owner
    would.
    """
    while (doc := ended(client, job))["state"] == "dead":
        patiently(client, "RETRY", job=job)
    return doc


def frequency(client, job):
    document = json.loads(patiently(client, "RESULT", job=job).body[0])
    return document["modes"][0]["frequency_rad_s"]


def submits(client, i):
    """A damped cosine of a frequency of its own: its mode must be that one, whoever computes it and
    however often it is tried.
    """
    omega = 20 + i % 997 * 0.05
    data, described = ring_down(samples=200, omega=omega)
    job = patiently(client, "SUBMIT", [data], kind="identify", options=FIXED, input=described,
                    key=f"{threading.current_thread().name} {i}")["job"]
    doc = finish(client, job)
    assert doc["state"] == "done", doc
    expected = (omega ** 2 + 0.8 ** 2) ** 0.5
    assert abs(frequency(client, job) - expected) < 1e-6 * expected


def cancels(client, i):
    # a slow machine's workers are killed three times before it is cancelled
    job = scene_job(client, seconds=30, key=f"c{i}", max_attempts=10)
    if job.code in ("draining", "busy"):
        time.sleep(0.05)
        return
    time.sleep(random.Random(i).uniform(0, 0.3))
    doc = patiently(client, "CANCEL", job=job["job"])
    assert doc["state"] == "cancelled", doc


BLOCK = b"".join(struct.pack("<d", ((k * 7919) % 1009 - 504) / 504) for k in range(32768))
BLOCK_CRC = crc32c(BLOCK)


def uploads(client, i):
    """A mebibyte in five chunks, the first of its own; every fourth is given up half way."""
    first = struct.pack("<d", i + 0.25) * 1024
    data = first + BLOCK * 4
    described = {"content": "batch", "samples": len(data) // 256, "channels": 32, "dt": 0.01}
    begun = patiently(client, "UPLOAD", op="begin", key=f"u{i}", **described)
    at = 0
    for piece, crc in [(first, crc32c(first))] + [(BLOCK, BLOCK_CRC)] * (1 if i % 4 == 3 else 4):
        reply = patiently(client, "UPLOAD", [piece], op="chunk", upload=begun["upload"], offset=at,
                          crc32c=crc)
        assert (reply.ok or reply["error"].get("detail", {}).get("expected") == at
                + len(piece)), reply
        at += len(piece)
    if i % 4 == 3:
        assert patiently(client, "UPLOAD", op="abort", upload=begun["upload"]).ok
        return
    sha = identity(described["samples"], 32, 0.01, data)
    assert patiently(client, "UPLOAD", op="seal", upload=begun["upload"], sha256=sha).ok
    job = patiently(client, "SUBMIT", kind="identify",
                    options=PART, input={"sha256": sha}, key=f"j{i}")["job"]
    doc = finish(client, job)
    assert doc["state"] == "done", doc
    assert patiently(client, "DELETE", job=job).ok


def streams(client, i):
    """2,000 samples with live windows, sealed into the batch of exactly these samples."""
    data, _ = ring_down(samples=2000, omega=31 + i % 100)
    opened = patiently(client, "STREAM", op="open", name=f"r{i}", channels=1, dt=0.01,
                       window={"samples": 400, "hop": 400, "options": FIXED})
    for at in range(0, 2000, 250):
        piece = data[8 * at:8 * (at + 250)]
        assert (patiently(client, "STREAM", [piece], op="push", stream=opened["stream"], epoch=0,
                          first=at, count=250, crc32c=crc32c(piece))["next"] == at + 250)
    closed = patiently(client, "STREAM", op="close", stream=opened["stream"])
    assert closed["sha256"] == identity(2000, 1, 0.01, data) and closed["gaps"] == []
    time.sleep(0.1)


def looks(client, i):
    for verb in ("STATS", "METRICS", "WHOAMI", "LIST"):
        assert patiently(client, verb).ok
    time.sleep(0.05)


def worries(daemon, enough):
    """What an unlucky machine and its administrator do until it is enough of what they did: what
    the daemon took meanwhile, and how often each.
    """
    dice, admin, counts = random.Random(23), daemon.client(timeout_s=5), {"kills": 0, "drains": 0,
                                                                          "reloads": 0}
    samples = []
    while not enough(counts):
        time.sleep(0.5)
        samples.append(measure(daemon))
        what = dice.randrange(12)
        if what < 4:
            workers = daemon.children()
            # one that has just gone by itself, or none
            with contextlib.suppress(ProcessLookupError, IndexError):
                os.kill(dice.choice(workers), signal.SIGKILL)
                counts["kills"] += 1
        elif what == 4:
            assert patiently(admin, "DRAIN").ok
            time.sleep(0.3)
            assert patiently(admin, "UNDRAIN").ok
            counts["drains"] += 1
        elif what == 5:
            daemon.process.send_signal(signal.SIGHUP)
            counts["reloads"] += 1
    admin.close()
    return samples, counts


def measure(daemon):
    with open(f"/proc/{daemon.pid}/status") as f:
        fields = dict(line.split(":", 1) for line in f)
    return {"rss_kb": int(fields["VmRSS"].split()[0]), "threads": int(fields["Threads"]),
            "descriptors": len(os.listdir(f"/proc/{daemon.pid}/fd")),
            "disk_kb": sum(blocks(p) for p in list((daemon.folder / "data").rglob("*"))) // 2}


def blocks(path):
    try:
        return path.lstat().st_blocks
    except FileNotFoundError:                            # gone since the folder was listed
        return 0


def typical(samples, what, begin, end):
    return statistics.median(s[what]
                             for s in samples[int(len(samples) * begin):int(len(samples) * end)])


def test_a_mixed_load_for_a_while_loses_nothing_and_leaks_nothing():
    with Daemon(config=CONFIG, workers=2) as d:
        loads = [Load(d, name, work)
                 for name, work in (("submits", submits), ("submits too", submits),
                                    ("cancels", cancels), ("uploads", uploads),
                                                        ("streams", streams), ("looks", looks))]
        for load in loads:
            load.start()
        begin = time.monotonic()

        def enough(counts):
            """SECONDS, and for a machine on which that is nothing until each has done something."""
            spent = time.monotonic() - begin
            assert spent < SECONDS + PATIENCE_S, [(load.name, load.done, load.error)
                                                  for load in loads]
            return (any(load.error for load in loads)
                    or spent > SECONDS and counts["kills"] > 0
                    and all(load.done > 3 for load in loads))
        samples, counts = worries(d, enough)
        seconds = time.monotonic() - begin
        for load in loads:
            load.stop.set()
        for load in loads:
            load.join(PATIENCE_S)
            assert not load.is_alive() and load.error is None, (load.name, load.done, load.error)
        states = d.client().ask("STATS")["jobs"]
        assert d.stop() == 0
        report = json.loads(subprocess.run([BUILD / "bin" / "modalctl", "--json", "fsck",
                                            d.folder / "data"], capture_output=True, text=True,
                                           timeout=120).stdout)
        was = {what: typical(samples, what, 0.5, 0.7) for what in samples[0]}
        now = {what: typical(samples, what, 0.8, 1) for what in samples[0]}
        print(f"\nsoak of {seconds:.0f} s: "
              + ", ".join(f"{load.done} {load.name}" for load in loads) + ", "
              + ", ".join(f"{n} {what}" for what, n in counts.items())
              + f"; jobs left {states}; " + ", ".join(f"{what} {was[what]:.0f} -> {now[what]:.0f}"
                                                      for what in was)
              + f"; fsck: {len(report['problems'])} problems")
        assert report["problems"] == []
        over = sum(load.done for load in loads if load.name not in ("streams", "looks"))
        # held for 3 s and one round of retention, not for ever
        assert states["done"] + states["cancelled"] < 1000 + over * 30 / seconds
        assert (now["threads"] == was["threads"]
                and abs(now["descriptors"] - was["descriptors"]) <= 8)
        assert now["disk_kb"] < 2 * was["disk_kb"] + 8192
        if not sanitized.SANITIZED:                      # which keeps what was freed
            assert now["rss_kb"] < 1.1 * was["rss_kb"] + 4096
