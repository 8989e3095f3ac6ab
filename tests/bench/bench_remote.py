"""Workers elsewhere over those of the daemon's own, on loopback; and what 500 idle ones take of it.

One JSON line a figure.  Small jobs: those of a second, submitted together, of one worker here and
of one elsewhere in turn; the peer is the one here.  Pieces: 100 MB that a real worker pulls by
INPUT and CHUNK, as the daemon measures it (event=link); the peer is bench_pieces.c, ZeroMQ alone
with pieces of the same size over CURVE, as many under way.  The state of each job is checked, and a
worker checks the sum of its input, before a figure is told.
"""
import json
import pathlib
import re
import statistics
import subprocess
import sys
import tempfile
import time

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "system"))
from test_elsewhere import Site, modald, user  # noqa: E402
from wire import BUILD, submit, until  # noqa: E402

TURNS = 5


def tell(case, value, unit, peer=None, n=1):
    print(json.dumps({"bench": "remote", "case": case, "value": round(value, 3), "unit": unit,
                      "peer": None if peer is None else round(peer, 3),
                      "ratio": None if peer is None else round(value / peer, 3), "n": n}),
          flush=True)


def small_jobs(site, turn, count=300):
    """Jobs a second from the first SUBMIT to the last end."""
    client = site.client("ann")
    began = time.perf_counter()
    jobs = [submit(client, phase=turn + i / count)["job"] for i in range(count)]
    ended = {client.ask("WAIT", job=job, timeout_s=250)["state"] for job in jobs}
    took = time.perf_counter() - began
    assert ended == {"done"}
    client.close()
    return count / took


def bench_jobs():
    with tempfile.TemporaryDirectory() as one, tempfile.TemporaryDirectory() as two:
        near, far = Site(pathlib.Path(one), workers=1), Site(pathlib.Path(two))
        far.worker()
        until(lambda: far.elsewhere() == 1)
        rates = [(small_jobs(far, turn), small_jobs(near, turn)) for turn in range(TURNS)]
        far.end()
        near.end()
    tell("small jobs", statistics.median(r[0] for r in rates), "jobs/s",
         statistics.median(r[1] for r in rates), TURNS)


def raw_rate():
    done = subprocess.run([BUILD / "bench" / "bench_pieces"], capture_output=True, check=True)
    return json.loads(done.stdout)["value"]


def pulled_rate(site, client, number):
    """What a worker of its own pulls at, as the daemon measures it: MB/s."""
    worker = site.worker()
    until(lambda: site.daemon.text().count("event=link ") == number)
    rate = re.findall(r"event=link .* mb_s=(\S+)", site.daemon.text())[-1]
    until(lambda: json.loads(client.ask("LIST", state="running").body[0])["jobs"])
    worker.kill()
    worker.wait()
    return float(rate)


def bench_pieces(total=100 << 20):
    signals = np.random.default_rng(1).standard_normal(total // 8).reshape(-1, 64)
    with tempfile.TemporaryDirectory() as folder:
        site = Site(pathlib.Path(folder))
        with user(site) as ann:
            job = ann.submit("identify", modald.Batch(signals, 0.01), max_attempts=TURNS + 1)
            client = site.client("ann")
            rates = [(pulled_rate(site, client, turn + 1), raw_rate()) for turn in range(TURNS)]
            ann.cancel(job.id)
        site.end()
    tell("100 MB in pieces", statistics.median(r[0] for r in rates), "MB/s",
         statistics.median(r[1] for r in rates), TURNS)


def memory_kb(pid):
    status = pathlib.Path(f"/proc/{pid}/status").read_text()
    return int(status.split("VmRSS:")[1].split()[0])


def bench_idle(count=500):
    with tempfile.TemporaryDirectory() as folder:
        site = Site(pathlib.Path(folder))
        client = site.client("ann")

        def slow():
            times = []
            for i in range(200):
                began = time.perf_counter()
                assert submit(client, phase=time.perf_counter()).ok
                times.append(time.perf_counter() - began)
            return sorted(times)[197]
        alone, before = slow(), memory_kb(site.daemon.pid)
        # none has memory for a job: they stay idle
        hands = [site.hand(beats=False, memory_bytes=0) for _ in range(count)]
        until(lambda: site.elsewhere() == count)
        tell("memory of an idle worker", (memory_kb(site.daemon.pid) - before) / count, "kB", None,
             count)
        for hand in hands:
            hand.say("BEAT")
        tell("p99 of SUBMIT beside 500 idle workers", 1e3 * slow(), "ms", 1e3 * alone, 200)
        site.end()


if __name__ == "__main__":
    bench_jobs()
    bench_pieces()
    bench_idle()
