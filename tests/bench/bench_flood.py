#!/usr/bin/python3
"""What an honest submitter has left while eight connections of somebody else submit inputs of 64 kB
as fast as they are answered: his acknowledged submissions a second, and how long an `UPLOAD begin`
takes, beside the same alone.

What the flooding processes take of the machine is not the daemon's doing: alone stands beside as
many compute-bound processes.  Rounds alternate.

    bench_flood.py [--rounds N] [--seconds S] [--no-keys]

Its ratio tells of the daemon only where the machine does nothing else: of two cores busy otherwise
each of the three steps of a request waits for its turn.  In syncs of the ledger it is counted by
tests/fault/test_turns.py.
"""
import argparse
import json
import math
import multiprocessing
import os
import pathlib
import statistics
import struct
import sys
import tempfile
import time

import zmq

HERE = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent / "system")]
from lab import FAKE, Lab  # noqa: E402
from wire import Client, Daemon, ring_down  # noqa: E402

PROCESSES, EACH = 2, 4                  # eight connections
SAMPLES = 8192                          # of 64 kB, the largest input that comes with its SUBMIT
AHEAD = 512                             # what each connection has sent and no answer to
HONEST_AHEAD = 8
WAVE = b"".join(struct.pack("<d", math.sin(0.01 * k)) for k in range(SAMPLES))


def flood(number, endpoint, keys, stop, sent):
    """Submit from EACH connections until told to stop; SENT: taken in and refused."""
    clients = [Client(endpoint, keys=keys) for _ in range(EACH)]
    waiting, said, begun = [0] * EACH, 0, False
    while not stop.is_set() or not begun:
        begun = True
        for i, client in enumerate(clients):
            while waiting[i] < AHEAD and said % 16 != 15:
                said += 1
                waiting[i] += 1
                client.send("SUBMIT", [struct.pack("<d", number * 1e9 + said) + WAVE[8:]],
                            kind="identify", options={"until": "never"},
                            input={"content": "batch", "samples": SAMPLES, "channels": 1,
                                   "dt": 0.01})
            said += 1
            while waiting[i] and client.socket.poll(0 if waiting[i] < AHEAD else 1):
                reply = client.receive()
                waiting[i] -= 1
                sent[0 if reply.ok else 1] += 1
    for client in clients:
        client.close()


def compute(stop):
    while not stop.is_set():
        sum(range(10000))


def honest(client, seconds, mark):
    """Submissions acknowledged a second, and what each `begin` took."""
    data, described = ring_down()
    end, begun, count, waiting = time.monotonic() + seconds, [], 0, []
    while (now := time.monotonic()) < end:
        while len(waiting) < HONEST_AHEAD:
            mark[0] += 1
            waiting.append(client.send("SUBMIT", [struct.pack("<d", mark[0]) + data[8:]],
                                       kind="identify", options={"until": "never"},
                                       input=described))
        assert client.answer(waiting.pop(0)).ok
        count += 1
        if count % HONEST_AHEAD == 0:
            while waiting:
                assert client.answer(waiting.pop(0)).ok
                count += 1
            now = time.monotonic()
            reply = client.ask("UPLOAD", op="begin", content="batch", samples=100, channels=1,
                               dt=0.01)
            begun.append(time.monotonic() - now)
            assert client.ask("UPLOAD", op="abort", upload=reply["upload"]).ok
    return count / seconds, begun


def case(keyed, rounds, seconds):
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        if keyed:
            lab = Lab(folder, {"many": "many submit", "one": "one submit"}, workers=0,
                      config=FAKE + "queue_jobs = 1000000\n")
            daemon, client, keys = (lab.daemon, lab.client("one"),
                                    (lab.server[0], *lab.pairs["many"]))
        else:
            daemon = Daemon(folder=folder, workers=0, config=FAKE + "queue_jobs = 1000000\n")
            client, keys = daemon.client(), None
        with daemon:
            rates, begins, mark = {"alone": [], "flooded": []}, {"alone": [], "flooded": []}, [0]
            taken = [0, 0]
            for _ in range(rounds):
                for name in rates:
                    stop, sent = multiprocessing.Event(), multiprocessing.Array("l", 2)
                    beside = [multiprocessing.Process(
                        target=flood if name == "flooded" else compute,
                        args=(n, daemon.endpoint, keys, stop, sent) if name == "flooded"
                        else (stop,)) for n in range(PROCESSES)]
                    for process in beside:
                        process.start()
                    time.sleep(1)
                    rate, begun = honest(client, seconds, mark)
                    rates[name].append(rate)
                    begins[name] += begun
                    stop.set()
                    for process in beside:
                        process.join()
                    taken = [a + b for a, b in zip(taken, sent)]
                    while client.ask("STATS")["ledger"]["waiting"]:   # what they left behind
                        time.sleep(0.1)
            ratio = statistics.median(rates["flooded"]) / statistics.median(rates["alone"])
            print(json.dumps({
                "bench": "flood", "case": "keys" if keyed else "no keys",
                "submissions_s": {n: [round(x, 1) for x in r] for n, r in rates.items()},
                "ratio": round(ratio, 3),
                "begin_s": {n: {"median": round(statistics.median(b), 4), "worst": round(max(b), 4),
                                "n": len(b)} for n, b in begins.items()},
                "flood": {"taken": taken[0], "busy": taken[1]}}), flush=True)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=4)
    parser.add_argument("--no-keys", action="store_true")
    args = parser.parse_args()
    case(not args.no_keys, args.rounds, args.seconds)
    return 0


if __name__ == "__main__":
    sys.exit(main())
