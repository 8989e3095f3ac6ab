"""Workers elsewhere over those of the daemon's own, on loopback; and what 500 idle ones take of it.

One JSON line a figure.  Small jobs: those of a second, submitted together, of one worker here and of
one elsewhere in turn; the peer is the one here.  Pieces: 100 MB pulled by INPUT and CHUNK; the peer
is another process that answers pieces of the same size from memory over CURVE, as many under way.
The document of each job and the bytes of each pull are checked before a figure is told.
"""
import hashlib
import json
import multiprocessing
import pathlib
import statistics
import sys
import tempfile
import time

import numpy as np
import zmq

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "system"))
from test_elsewhere import Site, modald, user  # noqa: E402
from wire import submit, until  # noqa: E402

PIECE, CREDIT, TURNS = 1 << 20, 4, 5


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


def pull(ask, hear, total):
    """Pieces by ASK(offset, length), CREDIT under way; the seconds and what came."""
    out, asked, got = bytearray(total), 0, 0
    began = time.perf_counter()
    while got < total:
        while asked < total and asked - got < CREDIT * PIECE:
            ask(asked, min(PIECE, total - asked))
            asked += PIECE
        offset, body = hear()
        out[offset:offset + len(body)] = body
        got += len(body)
    return time.perf_counter() - began, out


def serve_raw(pipe, total, keys):
    socket = zmq.Context().socket(zmq.ROUTER)
    socket.curve_server = True
    socket.curve_publickey, socket.curve_secretkey = keys
    pipe.send(socket.bind_to_random_port("tcp://127.0.0.1"))
    data = memoryview(np.random.default_rng(1).standard_normal(total // 8).tobytes())
    while True:
        peer, text = socket.recv_multipart()
        if text == b"end":
            return
        at, length = json.loads(text)
        socket.send_multipart([peer, text, data[at:at + length]], copy=False)


def raw_pull(total):
    keys, own = zmq.curve_keypair(), zmq.curve_keypair()
    ours, theirs = multiprocessing.Pipe()
    server = multiprocessing.Process(target=serve_raw, args=(theirs, total, keys))
    server.start()
    socket = zmq.Context.instance().socket(zmq.DEALER)
    socket.curve_serverkey, (socket.curve_publickey, socket.curve_secretkey) = keys[0], own
    socket.connect(f"tcp://127.0.0.1:{ours.recv()}")

    def hear():
        text, body = socket.recv_multipart(copy=False)
        return json.loads(text.bytes)[0], body.buffer
    took, out = pull(lambda at, length: socket.send_multipart([json.dumps([at, length]).encode()]),
                     hear, total)
    socket.send(b"end")
    server.join()
    socket.close()
    return took, out


def bench_pieces(total=100 << 20):
    signals = np.random.default_rng(1).standard_normal(total // 8).reshape(-1, 64)
    digest = hashlib.sha256(signals.tobytes()).digest()
    ours, raw = [], []
    with tempfile.TemporaryDirectory() as folder:
        site = Site(pathlib.Path(folder))
        with user(site) as ann:
            ann.submit("identify", modald.Batch(signals, 0.01))
            for _ in range(TURNS):
                hand = site.hand(beats=False)
                _, of = hand.run()

                def hear(hand=hand):
                    frames = hand.socket.recv_multipart(copy=False)
                    return json.loads(frames[2].bytes)["offset"], frames[3].buffer
                took, out = pull(lambda at, length, hand=hand, of=of: hand.say(
                    "INPUT", offset=at, length=length, **of), hear, total)
                assert hashlib.sha256(out).digest() == digest
                ours.append(total / took / 1e6)
                hand.say("RELEASE", why="drain", **of)
                took, out = raw_pull(total)
                assert hashlib.sha256(out).digest() == digest
                raw.append(total / took / 1e6)
        site.end()
    tell("100 MB in pieces", statistics.median(ours), "MB/s", statistics.median(raw), TURNS)


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
