#!/usr/bin/python3
"""Streams through the daemon: how fast they are made durable, and what a live result costs.

    rate    64 channels x 1 kHz x 10 minutes pushed by the client library as fast as credit allows,
    until the last sample is acknowledged as
            durable, in MB/s; over the least of (a) the same bytes in the client's frames through
            raw ZeroMQ, every frame answered, (b) write and fdatasync, a megabyte a time, (c) their
            SHA-256
    live    CPU of a live result after a hop, in ms, over an `identify` job of the same window in
    the same daemon's worker

Every record is compared with what was pushed before a figure counts.  Rounds of ours and the peers'
alternate; medians.
"""
import hashlib
import json
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile
import threading
import time

import h5py
import numpy as np
import zmq

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "system"))
from wire import Daemon, crc32c, identity    # noqa: E402
import modald                                # noqa: E402

CHANNELS, DT, SAMPLES, FRAME, ROUNDS = (64, 1e-3,
                                        int(os.environ.get("MODALD_BENCH_SAMPLES", "600000")),
                                        131072, 3)
WINDOW, HOP = 1000, 100


def say(case, value, unit, peer, ratio, n):
    print(json.dumps({"bench": "stream_rate", "case": case, "value": round(value, 3), "unit": unit,
                      "peer": peer, "ratio": round(ratio, 3), "n": n}), flush=True)


def ours(daemon, data, name):
    os.environ.update(MODALD_URL=daemon.endpoint, MODALD_SPILL=str(daemon.folder),
                      MODALD_CLOSE_WAIT="120", MODALD_RING=str(64 << 20))
    start = time.perf_counter()
    with modald.stream(name, CHANNELS, DT) as s:
        for at in range(0, len(data), 4096):
            s.push(data[at:at + 4096])
            # a quarter of the ring: nothing is spilled
            while s.report.pushed - s.report.acknowledged > 32768:
                time.sleep(0.0005)
        while s.report.acknowledged < len(data):
            time.sleep(0.0005)
        took = time.perf_counter() - start
        assert s.report.dropped == 0 and s.report.spilled == 0
    c = daemon.client(timeout_s=60)
    job = c.ask("SUBMIT", kind="identify", options={"rank.fixed": 2},
                input={"sha256": identity(len(data), CHANNELS, DT, data.tobytes())})
    assert job.ok                                       # a batch of exactly these samples is there
    c.ask("CANCEL", job=job["job"])
    c.close()
    return took


def raw(data):
    context, view = zmq.Context(), memoryview(data).cast("B")
    router, dealer = context.socket(zmq.ROUTER), context.socket(zmq.DEALER)
    with tempfile.TemporaryDirectory() as folder:
        router.bind(f"ipc://{folder}/raw")
        dealer.connect(f"ipc://{folder}/raw")

        def answer():
            for _ in range(0, len(view), FRAME):
                peer, _ = router.recv_multipart()
                router.send_multipart([peer, b""])
        thread = threading.Thread(target=answer)
        start, waiting = time.perf_counter(), 0
        thread.start()
        for at in range(0, len(view), FRAME):
            dealer.send(view[at:at + FRAME])
            waiting += 1
            while waiting >= 32:
                dealer.recv()
                waiting -= 1
        for _ in range(waiting):
            dealer.recv()
        took = time.perf_counter() - start
        thread.join()
        context.destroy(linger=0)
    return took


def disk(daemon, data):
    view, path = memoryview(data).cast("B"), daemon.folder / "raw"
    start = time.perf_counter()
    with open(path, "wb", buffering=0) as out:
        for at in range(0, len(view), 8 * FRAME):                       # a megabyte a sync
            out.write(view[at:at + 8 * FRAME])
            os.fdatasync(out.fileno())
    took = time.perf_counter() - start
    path.unlink()
    return took


def sha(data):
    start = time.perf_counter()
    hashlib.sha256(memoryview(data).cast("B")).digest()
    return time.perf_counter() - start


def rate():
    data = np.random.default_rng(1).standard_normal((SAMPLES, CHANNELS))
    took = {"ours": [], "raw ZeroMQ": [], "write and fdatasync": [], "SHA-256": []}
    with Daemon(workers=1) as daemon:
        for i in range(ROUNDS):
            took["ours"].append(ours(daemon, data, f"rate-{i}"))
            took["raw ZeroMQ"].append(raw(data))
            took["write and fdatasync"].append(disk(daemon, data))
            took["SHA-256"].append(sha(data))
    mb = data.nbytes / 1e6
    median = {k: statistics.median(v) for k, v in took.items()}
    slowest = max((k for k in median if k != "ours"), key=median.get)
    for k in median:
        if k != "ours":
            say(f"rate of {k}", mb / median[k], "MB/s", "", 1, ROUNDS)
    say(f"rate {CHANNELS} channels {SAMPLES} samples", mb / median["ours"], "MB/s", slowest,
        median[slowest] / median["ours"], ROUNDS)


def decays(samples, channels):
    rng, t = np.random.default_rng(2), np.arange(samples) * 0.05
    y = np.zeros((samples, channels))
    for f, z in ((1.0, 2e-4), (2.3, 1e-4), (4.1, 1e-4)):
        w = 2 * np.pi * f
        for c in range(channels):
            y[:, c] += rng.uniform(0.4, 1) * np.exp(-z * w * t) * np.cos(w * t + rng.uniform(0, 6))
    return y + 0.01 * np.sqrt(np.mean(y * y)) * rng.standard_normal(y.shape)


def live(daemon, channels, window, hop, hops=20):
    y, name, cpu, batch = decays(window + hops * hop, channels), f"live-{channels}-{window}", [], []
    c = daemon.client(timeout_s=60)
    c.ask("EVENTS", stream=name)
    s = c.ask("STREAM", op="open", name=name, channels=channels, dt=0.05,
              window={"samples": window, "hop": hop})["stream"]
    for at in range(0, len(y), hop):
        data = y[at:at + hop].tobytes()
        assert c.ask("STREAM", [data], op="push", stream=s, epoch=0, first=at, count=hop,
                     crc32c=crc32c(data)).ok
        while at + hop >= window and len(cpu) + len(batch) < (at + hop - window) // hop + 1:
            reply = c.early.pop(0) if c.early else c.receive()
            if reply.verb == "EVENT":
                (cpu if reply["update"]["updated"] else batch).append(reply["update"]["cpu_s"])
    jobs = []
    for i in range(1, hops + 1, 2):                     # the same windows as jobs
        part = np.ascontiguousarray(y[i * hop:i * hop + window])
        path = daemon.folder / "window.h5"
        with h5py.File(path, "w") as f:
            f.create_dataset("signals", data=part).attrs["dt"] = 0.05
        out = subprocess.run([str(pathlib.Path(os.environ["MODALD_BUILD"]) / "bin" / "modalctl"),
                              "--server", daemon.endpoint, "--json", "submit", "identify",
                              str(path), "--wait"],
                             capture_output=True, check=True)
        jobs.append(json.loads(out.stdout)["result"]["cost"]["cpu_s"])
    c.close()
    assert len(cpu) >= 0.8 * hops
    ours_s, theirs = statistics.median(cpu), statistics.median(jobs)
    say(f"live {channels} channels window {window} hop {hop}", 1e3 * ours_s, "ms",
        "identify job of the window", theirs / ours_s, len(cpu))


def main():
    rate()
    with Daemon(workers=1) as daemon:
        for channels, window, hop in ((3, 1200, 100), (8, 4000, 500), (64, 2000, 200)):
            live(daemon, channels, window, hop)


main()
