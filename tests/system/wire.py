"""A daemon of one test's own, and raw frames to it: nothing between the test and the protocol but
pyzmq.
"""
import contextlib
import fcntl
import hashlib
import json
import os
import pathlib
import re
import signal
import struct
import subprocess
import tempfile
import time

import zmq

import sanitized

BUILD = pathlib.Path(os.environ.get("MODALD_BUILD", pathlib.Path(__file__).resolve().parents[2]
                                    / "build"))
VERSION = b"MODALD1"
# for what must come: a machine that does something else makes it later, and only its absence is a
# failure
PATIENCE_S = 300


def until(predicate, what="it did not become true"):
    """Wait for what must come."""
    end = time.monotonic() + PATIENCE_S
    while not predicate():
        assert time.monotonic() < end, what
        time.sleep(0.01)


def crc32c(data):
    """CRC-32C bit by bit through a table: written from RFC 3720, not from the daemon."""
    crc = 0xFFFFFFFF
    for byte in data:
        crc = CRC_TABLE[(crc ^ byte) & 255] ^ crc >> 8
    return crc ^ 0xFFFFFFFF


def _crc_row(n):
    for _ in range(8):
        n = n >> 1 ^ (0x82F63B78 if n & 1 else 0)
    return n


CRC_TABLE = [_crc_row(n) for n in range(256)]


def identity(samples, channels, dt, data, period=0.0, units="", names=None):
    """Section 7 of PROTOCOL.md."""
    def text(s):
        b = s.encode()
        return struct.pack("<I", len(b)) + b
    head = b"modald/batch/1\0" + struct.pack("<QQdd", samples, channels, dt, period) + text(units)
    for i in range(channels):
        head += text(names[i] if names else f"ch{i}")
    return hashlib.sha256(head + data).hexdigest()


class Reply:
    def __init__(self, frames):
        self.version, self.verb = frames[0], frames[1].decode()
        self.header = json.loads(frames[2])
        self.body = frames[3:]

    def __getitem__(self, key):
        return self.header[key]

    def get(self, key, default=None):
        return self.header.get(key, default)

    @property
    def ok(self):
        return self.verb == "REPLY"

    @property
    def code(self):
        return self.header["error"]["code"] if self.verb == "ERROR" else None

    def __repr__(self):
        return f"{self.verb} {self.header}"


def woken(pid):
    """How often its threads have gone to sleep."""
    status = [(task / "status").read_text() for task in pathlib.Path(f"/proc/{pid}/task").iterdir()]
    return sum(int(re.search(r"^voluntary_ctxt_switches:\s*(\d+)", text, re.MULTILINE)[1])
               for text in status)


def executed(pid):
    """The program it runs; None where it has ended."""
    try:
        return os.readlink(f"/proc/{pid}/exe")
    except OSError:
        return None


def signal_to(pid, number):
    """To one that may end by itself meanwhile."""
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, number)


class Client:
    def __init__(self, endpoint, timeout_s=PATIENCE_S, keys=None, identity=None):
        self.context = zmq.Context.instance()
        self.socket = self.context.socket(zmq.DEALER)
        self.socket.linger = 0
        self.socket.rcvtimeo = int(timeout_s * 1000)
        if identity:
            self.socket.setsockopt(zmq.IDENTITY, identity)
        if keys:
            (self.socket.curve_serverkey, self.socket.curve_publickey,
             self.socket.curve_secretkey) = keys
        self.socket.connect(endpoint)
        self.number = 0
        self.early = []

    def raw(self, *frames):
        self.socket.send_multipart(list(frames))

    def receive(self):
        return Reply(self.socket.recv_multipart())

    def send(self, verb, body=(), **header):
        self.number += 1
        self.raw(VERSION, verb.encode(), json.dumps({"id": self.number, **header}).encode(), *body)
        return self.number

    def answer(self, number):
        """The answer to request NUMBER; others are kept for their askers."""
        for i, reply in enumerate(self.early):
            if reply.get("id") == number:
                return self.early.pop(i)
        while True:
            reply = self.receive()
            if reply.get("id") == number and reply.verb != "EVENT":
                return reply
            self.early.append(reply)

    def ask(self, verb, body=(), **header):
        return self.answer(self.send(verb, body, **header))

    def close(self):
        self.socket.close()


class Gate:
    """Jobs of fake_worker.py with its options run until it is opened: no job is over before a test
    has looked, on the slowest machine.
    """

    def __init__(self, path):
        self.path, self.options = path, {"until": str(path)}

    def open(self):
        self.path.touch()


class Daemon:
    def __init__(self, folder=None, workers=1, config="", endpoint=None, wrap=(), env=None,
                 build=None):
        self.own = tempfile.TemporaryDirectory(prefix="md") if folder is None else None
        self.folder = pathlib.Path(folder or self.own.name)
        self.endpoint = endpoint or f"ipc://{self.folder}/s.ipc"
        self.config = self.folder / "modald.conf"
        self.config.write_text(config)
        self.workers, self.wrap, self.env, self.build = workers, list(wrap), env, pathlib.Path(
            build or BUILD)
        self.log_path = self.folder / "log"
        self.process, self.gates = None, 0
        self.start()

    def gate(self):
        self.gates += 1
        return Gate(self.folder / f"gate{self.gates}")

    def start(self, ready=True):
        self.log = open(self.log_path, "ab")
        mark = self.log_path.stat().st_size
        command = [*self.wrap, str(self.build / "bin" / "modald"), "--data",
                   str(self.folder / "data"), "--bind", self.endpoint,
                   "--workers", str(self.workers), "--config", str(self.config)]
        self.process = subprocess.Popen(command, stderr=self.log, stdin=subprocess.DEVNULL,
                                        env={**os.environ, **(self.env or {})})
        deadline = time.monotonic() + PATIENCE_S
        while ready:
            if b"event=ready" in self.log_path.read_bytes()[mark:]:
                break
            if self.process.poll() is not None or time.monotonic() > deadline:
                text = self.text()[-2000:]
                self.__exit__()
                raise RuntimeError(f"modald did not start: {text}")
            time.sleep(0.005)
        return self

    @property
    def pid(self):
        return self.process.pid

    def text(self):
        return self.log_path.read_text(errors="replace") if self.log_path.exists() else ""

    def client(self, **options):
        return Client(self.endpoint, **options)

    def kill(self):
        self.process.send_signal(signal.SIGKILL)
        self.process.wait(PATIENCE_S)
        self.log.close()

    def stop(self, number=signal.SIGTERM, timeout_s=PATIENCE_S):
        if self.process.poll() is None:
            self.process.send_signal(number)
        status = self.process.wait(timeout_s)
        self.log.close()
        return status

    def children(self):
        """Its workers.  Neither one that is being started, which is the daemon still and holds it
        until it is another program, nor one that has ended.
        """
        out = subprocess.run(["ps", "-o", "pid=", "--ppid", str(self.pid)], capture_output=True,
                             text=True).stdout.split()
        return [int(pid) for pid in out if executed(pid) not in (None, executed(self.pid))]

    def kill_workers(self):
        for pid in self.children():
            signal_to(pid, signal.SIGKILL)

    def __enter__(self):
        return self

    def end_wrapped(self):
        """A daemon under strace outlives strace: end it by the pid in its lock."""
        try:
            pid = int((self.folder / "data" / "LOCK").read_text())
            command = pathlib.Path(f"/proc/{pid}/cmdline")
            if b"modald" in command.read_bytes():
                os.kill(pid, signal.SIGKILL)
                # held until the last of its threads is gone
                with open(self.folder / "data" / "LOCK") as lock:
                    signal.alarm(PATIENCE_S)
                    fcntl.flock(lock, fcntl.LOCK_EX)
                    signal.alarm(0)
        except (OSError, ValueError):
            pass

    def __exit__(self, *_):
        if self.wrap:
            self.end_wrapped()
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait(PATIENCE_S)
        if not self.log.closed:
            self.log.close()
        sanitized.hear(self.text())
        if self.own:
            self.own.cleanup()


def ring_down(samples=400, dt=0.01, damping=0.8, omega=31.0, phase=0.0):
    """One decaying cosine, and its description."""
    import math
    data = b"".join(struct.pack("<d", math.exp(-damping * dt * k)
                                * math.cos(omega * dt * k + phase)) for k in range(samples))
    return data, {"content": "batch", "samples": samples, "channels": 1, "dt": dt}


def submit(client, key=None, phase=0.0, options=None, **more):
    data, described = ring_down(phase=phase)
    header = {"kind": "identify", "options": options or {}, "input": described, **more}
    if key is not None:
        header["key"] = key
    return client.ask("SUBMIT", [data], **header)


def scene_job(client, seconds=30.0, **more):
    """A job that takes about SECONDS: a chain stepped very finely; one that only its worker's end
    can end early.
    """
    scene = {"structure": {"type": "chain", "masses": [1.0, 2.0], "springs": [100.0, 50.0, 0.0]},
             "effects": [{"type": "cubic_spring", "dof": "x1", "coefficient": 5.0}],
             "initial": {"x": {"x1": 0.3}}, "time": {"dt": 0.001, "duration": 3000.0 * seconds}}
    text = json.dumps(scene).encode()
    return client.ask("SUBMIT", [text], kind="simulate", input={"content": "scene"}, **more)
