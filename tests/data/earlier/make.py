#!/usr/bin/python3
"""A data folder and a client's session as an earlier version makes them, for
tests/system/test_earlier.py.

    make.py TREE    TREE: that version's source, built in TREE/build

Writes folder.tar.xz, told.json (what its daemon answered about the folder), sessions.json.xz (its
clients and its daemon, every frame) and schemas.json.xz (of its requests).  The folder ends by kill
-9, so that the ledger's log is part of it.
"""
import base64
import hashlib
import json
import lzma
import math
import os
import pathlib
import struct
import subprocess
import sys
import tarfile
import tempfile
import threading
import time

HERE = pathlib.Path(__file__).resolve().parent
KEPT = "result_age_s = 3e9\ninput_age_s = 3e9\ntombstone_age_s = 3e9\nupload_idle_s = 3e9\n"
CHUNK, SAMPLES = 65536, 24576                        # of the uploads: three chunks
SCENE = {"structure": {"type": "chain", "masses": [1.0, 2.0], "springs": [100.0, 50.0, 0.0]},
         "effects": [],
         "initial": {"x": {"x1": 0.3}}, "time": {"dt": 0.01, "duration": 60.0}}
LONG = {**SCENE, "effects": [{"type": "cubic_spring", "dof": "x1", "coefficient": 5.0}],
        "time": {"dt": 0.001, "duration": 90000.0}}


def wave(count, step):
    """Samples that pack well: a period of 64, exactly repeated."""
    return struct.pack("<64d",
                       *(math.sin(step * k * math.pi / 32) for k in range(64))) * (count // 64)


def store(wire, folder):
    """Jobs of each end and each kind of file in FOLDER; what is asked about them later."""
    config = "workers = 1\n" + KEPT
    told = {"jobs": {}, "expired": "deleted"}
    with wire.Daemon(folder=folder, config=config) as d:
        c = d.client()

        def job(key, reply):
            assert reply.ok, reply
            told["jobs"][key] = reply["job"]
            return reply["job"]

        def upload(key, data, chunks=3, seal=True):
            u = c.ask("UPLOAD", op="begin", content="batch", samples=SAMPLES, channels=1, dt=0.5,
                      key=key)["upload"]
            for k in range(chunks):
                part = data[k * CHUNK:(k + 1) * CHUNK]
                assert c.ask("UPLOAD", [part], op="chunk", upload=u, offset=k * CHUNK,
                             crc32c=wire.crc32c(part)).ok
            if seal:
                assert c.ask("UPLOAD", op="seal", upload=u,
                             sha256=wire.identity(SAMPLES, 1, 0.5, data)).ok
            return u

        def push(s, first, data, channels=1):
            assert c.ask("STREAM", [data], op="push", stream=s, epoch=0, first=first,
                         count=len(data) // 8 // channels, crc32c=wire.crc32c(data)).ok

        for key in ("done", "deleted"):
            c.ask("WAIT", job=job(key, wire.submit(c, key=key, phase=len(key))), timeout_s=60)
        c.ask("DELETE", job="key:deleted")
        del told["jobs"]["deleted"]
        job("cached", wire.submit(c, key="cached", phase=len("done")))
        c.ask("WAIT", job=job("failed", wire.submit(c, key="failed", options={"rank.fixed": -3})),
              timeout_s=60)
        text = json.dumps(SCENE).encode()
        c.ask("WAIT", job=job("signals",
                              c.ask("SUBMIT", [text], kind="simulate", key="signals",
                                    input={"content": "scene"})), timeout_s=60)
        c.ask("WAIT", job=job("spooled",
                              c.ask("SUBMIT", kind="identify", key="spooled",
                                    options={"rank.fixed": 2},
                                    input={"upload": upload("in", wave(SAMPLES, 3))})),
              timeout_s=60)
        s = c.ask("STREAM", op="open", name="sealed", channels=2, dt=0.25, names=["a", "b"],
                  units="m", attributes={"rig": 7}, window={"samples": 100})["stream"]
        ear = d.client()
        ear.ask("EVENTS", stream="sealed")
        push(s, 5, struct.pack("<256d",
                               *(math.exp(-0.01 * k) * math.cos(0.4 * k + ch) for k in range(128)
                                 for ch in range(2))), 2)
        assert ear.receive()["event"] == "modes"
        push(s, 150, wave(128, 1), 2)
        told["sealed"] = c.ask("STREAM", op="close", stream=s)["sha256"]
        c.ask("WAIT", job=job("stream",
                              c.ask("SUBMIT", kind="identify", key="stream",
                                    options={"rank.fixed": 2}, input={"sha256": told["sealed"]})),
              timeout_s=60)
        text = json.dumps(LONG).encode()
        job("cancelled", c.ask("SUBMIT", [text], kind="simulate", key="cancelled",
                               input={"content": "scene"}))
        assert c.ask("CANCEL", job="key:cancelled")["state"] == "cancelled"
        job("dead", c.ask("SUBMIT", [text], kind="simulate", key="dead", max_attempts=1,
                          input={"content": "scene"}))
        while c.ask("STATUS", job="key:dead")["state"] != "running":
            time.sleep(0.01)
        for pid in d.children():
            os.kill(pid, 9)
        assert c.ask("WAIT", job="key:dead", timeout_s=60)["state"] == "dead"
        d.stop()
        d.workers = 0
        d.start()
        c = d.client()
        for key in ("queued1", "queued2"):
            job(key, wire.submit(c, key=key, phase=0.1 * int(key[-1])))
        upload("open", wave(SAMPLES, 5), chunks=2, seal=False)
        s = c.ask("STREAM", op="open", name="open", channels=1, dt=0.5)["stream"]
        push(s, 0, wave(1024, 2))
        push(s, 1100, wave(64, 7))
        ask_all(c, told)
        d.kill()
    return told


def ask_all(client, told):
    """All that is told about the folder's jobs, inputs and events, into TOLD."""
    told["docs"] = {key: client.ask("STATUS", job=ident).header
                    for key, ident in told["jobs"].items()}
    told["by_key"] = {key: client.ask("STATUS", job="key:" + key).header["job"]
                      for key in told["jobs"]}
    told["results"] = {}
    for key in told["jobs"]:
        for part in ("document", "batch", "input", "stderr"):
            reply = client.ask("RESULT", job="key:" + key, part=part, length=1 << 20)
            told["results"][key + " " + part] = {**reply.header,
                                                 "sha256": [hashlib.sha256(body).hexdigest()
                                                            for body in reply.body]}
    told["list"] = json.loads(client.ask("LIST", limit=1000).body[0])["jobs"]
    next_number = client.ask("EVENTS", **{"from": 1})["next"]
    told["events"] = []
    while not told["events"] or told["events"][-1]["number"] < told.get("last_event", 1):
        event = client.receive()
        told["events"].append({k: v for k, v in event.header.items() if k != "subscription"})
        told.setdefault("last_event", int(client.ask("STATS")["ledger"]["events"]))
        told["events"] += [{k: v for k, v in early.header.items() if k != "subscription"}
                           for early in client.early]
        client.early.clear()
    assert next_number == 1
    told["used"] = client.ask("WHOAMI")["used"]


class Proxy:
    """Between a daemon of TREE and a client: every frame of both, in the order in which they came.
    """

    def __init__(self, tree, folder):
        import zmq
        self.tree, self.folder, self.zmq, self.kept, self.over = (tree, folder, zmq, [],
                                                                  threading.Event())
        self.front = f"ipc://{folder}/f"

    def __enter__(self):
        command = [self.tree / "build" / "bin" / "modald", "--data", f"{self.folder}/data",
                   "--bind", f"ipc://{self.folder}/d", "--workers", "1"]
        self.daemon = subprocess.Popen(command, stderr=subprocess.DEVNULL)
        self.thread = threading.Thread(target=self.relay)
        self.thread.start()
        return self

    def relay(self):
        context, backs = self.zmq.Context(), {}
        front = context.socket(self.zmq.ROUTER)
        front.bind(self.front)
        while not self.over.is_set():
            while front.poll(10):
                peer, *frames = front.recv_multipart()
                if peer not in backs:
                    backs[peer] = context.socket(self.zmq.DEALER)
                    backs[peer].connect(f"ipc://{self.folder}/d")
                self.keep("request", frames)
                backs[peer].send_multipart(frames)
            for peer, back in backs.items():
                while back.poll(0):
                    frames = back.recv_multipart()
                    self.keep("answer", frames)
                    front.send_multipart([peer, *frames])
        context.destroy(0)

    def keep(self, what, frames):
        self.kept.append((what, [base64.b64encode(frame).decode() for frame in frames]))

    def __exit__(self, *_):
        self.over.set()
        self.thread.join()
        self.daemon.kill()
        self.daemon.wait()


def sessions(tree):
    """The Python client of TREE, by every method of a lab's day, and a simulation with its
    streaming client.
    """
    sys.path.insert(0, str(tree / "clients" / "python"))
    import modald
    import numpy
    with tempfile.TemporaryDirectory() as own, Proxy(tree, own) as proxy:
        with modald.connect(proxy.front) as client:
            told = day(modald, numpy, client)
    with tempfile.TemporaryDirectory() as own, Proxy(tree, own) as simulated:
        env = {"PATH": os.environ["PATH"], "MODALD_URL": simulated.front, "MODALD_SPILL": own,
               "MODALD_CLOSE_WAIT": "60"}
        subprocess.run([tree / "build" / "examples" / "example_loop", "host", "300", "2"], env=env,
                       check=True, stdout=subprocess.DEVNULL)
    return {"day": proxy.kept, "told": told, "simulation": simulated.kept}


def day(modald, numpy, client):
    """What a user does, by the client's own methods; the present client does it too, see
    test_earlier.py.
    """
    t = numpy.arange(400) * 0.01
    record = numpy.exp(-0.5 * t) * numpy.cos(31 * t)
    told = {"hello": client.hello()["version"], "role": client.whoami()["role"]}
    told["identified"] = client.identify(record, 0.01, {"rank.fixed": 2})
    job = client.submit("identify", modald.Batch(record[:, None], 0.01), {"rank.fixed": 4},
                        key="again").wait()
    told["same"] = client.submit("identify", modald.Batch(record[:, None], 0.01),
                                 {"rank.fixed": 4}, key="again").id == job.id
    long = numpy.resize(numpy.sin(numpy.arange(64) * numpy.pi / 32), 9216)
    told["uploaded"] = client.submit("identify", modald.Batch(long[:, None], 0.5),
                                     {"rank.fixed": 2}, key="large").wait().state
    told["result"] = client.result(job.id)
    document, signals = client.simulate({**SCENE, "time": {"dt": 0.01, "duration": 5.0}})
    told["signals"] = list(signals.signals.shape)
    told["many"] = [j.id == k.id
                    for j, k in zip(*(client.submit_many(
        [("identify", modald.Batch(record[:100 + n, None], 0.01), None, f"m{n}")
         for n in range(3)]) for _ in range(2)))]
    told["listed"] = len(list(client.list()))
    told["jobs"] = client.stats()["jobs"]["done"]
    try:
        client.submit("identify", modald.Batch(record[:50, None], 0.01), {}, key="again")
    except modald.Error as error:
        told["conflict"] = error.code
    client.delete(job.id)
    try:
        client.status("key:again")
    except modald.Error as error:
        told["expired"] = error.code
    told["metrics"] = "modald_jobs" in client.metrics()
    return told


def pack(name, value):
    (HERE / name).write_bytes(lzma.compress(json.dumps(value).encode(),
                                            preset=9 | lzma.PRESET_EXTREME))


def main(tree):
    os.environ["MODALD_BUILD"] = str(tree / "build")
    sys.path.insert(0, str(tree / "tests" / "system"))
    import wire
    with tempfile.TemporaryDirectory() as own:
        told = store(wire, pathlib.Path(own))
        data = pathlib.Path(own, "data")
        (data / "RESERVE").unlink(missing_ok=True)
        with tarfile.open(HERE / "folder.tar.xz", "w:xz", preset=9) as tar:
            for path in sorted(data.rglob("*")):
                if path.is_file() and not path.name.endswith("-shm"):
                    tar.add(path, path.relative_to(own), filter=lambda i: setattr(i, "uid", 0)
                            or setattr(i, "gid", 0) or i)
        (HERE / "told.json").write_text(json.dumps(told, indent=1) + "\n")
    pack("schemas.json.xz",
         {p.name.split(".")[0]: json.loads(p.read_text())
          for p in sorted((tree / "proto" / "schema").glob("*.request.json"))})
    pack("sessions.json.xz", sessions(tree))


if __name__ == "__main__":
    main(pathlib.Path(sys.argv[1]).resolve())
