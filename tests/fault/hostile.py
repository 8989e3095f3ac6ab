#!/usr/bin/python3
"""Bad peers, each a process of its own: `hostile.py PROBE HOST:PORT` does its worst until it is
ended, as the user of $HOSTILE_KEYS where that is set.

What libzmq does with each is in README.md.
"""
import contextlib
import ctypes
import json
import os
import pathlib
import random
import signal
import socket
import struct
import subprocess
import sys
import time

import zmq

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "system"))
from wire import crc32c, ring_down  # noqa: E402

VERSION = b"MODALD1"
# of ZMTP 3.0, without security
GREETING = b"\xff" + bytes(8) + b"\x7f\x03\x00NULL" + bytes(16 + 1 + 31)


def dealer(endpoint, identity=None, **options):
    made = zmq.Context.instance().socket(zmq.DEALER)
    made.linger, made.sndhwm, made.sndtimeo = 0, 2, 1000
    for name, value in options.items():
        setattr(made, name, value)
    if "HOSTILE_KEYS" in os.environ:
        made.curve_serverkey, made.curve_publickey, made.curve_secretkey = (
            (key.encode() for key in os.environ["HOSTILE_KEYS"].split(",")))
    if identity:
        made.setsockopt(zmq.IDENTITY, identity)
    made.connect(f"tcp://{endpoint}")
    return made


def bomb(endpoint):
    """Messages of 200,001 parts of 1 kB: no limit of libzmq counts parts."""
    parts, peer = [VERSION, b"HELLO", b'{"id":1}'] + [bytes(1024)] * 199998, dealer(endpoint)
    while True:
        with contextlib.suppress(zmq.Again):
            peer.send_multipart(parts, copy=False)


def oversize(endpoint):
    """Frames of 2 MiB, past what the daemon takes; libzmq drops the connection, and the peer is
    back at once.
    """
    frame, peer = bytes(2 << 20), dealer(endpoint)
    while True:
        with contextlib.suppress(zmq.Again):
            peer.send_multipart([VERSION, b"HELLO", b'{"id":1}', frame])
        time.sleep(0.01)


def silent(endpoint, count=100):
    """Connections that say nothing, and are made once."""
    host, port = endpoint.split(":")
    kept = []
    for _ in range(count):
        with contextlib.suppress(OSError):
            one = socket.socket()
            one.settimeout(5)
            one.connect((host, int(port)))
            kept.append(one)
    print("at work", flush=True)
    time.sleep(3600)


def garbage(endpoint):
    """Connections of random bytes, a third of them after a valid greeting; a hundred a second."""
    host, port = endpoint.split(":")
    dice = random.Random(2385)
    while True:
        with contextlib.suppress(OSError), socket.socket() as one:
            one.settimeout(1)
            one.connect((host, int(port)))
            one.sendall((GREETING if dice.randrange(3) == 0 else b"")
                        + dice.randbytes(dice.randrange(1, 2000)))
        time.sleep(0.01)


def taken(endpoint):
    """Peers that call themselves by the routing id of another."""
    while True:
        peer = dealer(endpoint, b"honest")
        with contextlib.suppress(zmq.Again):
            peer.send_multipart([VERSION, b"HELLO", b'{"id":1}'])
        time.sleep(0.02)
        peer.close()


def keyless(endpoint):
    """Fifty peers without keys that ask again and again."""
    peers = [dealer(endpoint) for _ in range(50)]
    while True:
        for peer in peers:
            with contextlib.suppress(zmq.Again):
                peer.send_multipart([VERSION, b"HELLO", b'{"id":1}'], zmq.DONTWAIT)
        time.sleep(0.01)


def deaf(endpoint):
    """Asks for long answers and never reads one."""
    peer = dealer(endpoint)
    peer.setsockopt(zmq.RCVHWM, 1)
    peer.setsockopt(zmq.RCVBUF, 4096)
    n = 0
    while True:
        n += 1
        with contextlib.suppress(zmq.Again):
            peer.send_multipart([VERSION, b"METRICS", b'{"id":%d}' % n])


def malformed(endpoint):
    """Each a message that breaks PROTOCOL.md, section 2, as fast as they are taken."""
    bad = [[b""], [VERSION], [VERSION, b""], [VERSION, b"HELLO", b"{"],
           [VERSION, b"NOSUCH", b'{"id":1}'], [b"MODALD9", b"HELLO", b'{"id":1}'],
           [VERSION, b"HELLO", b"[" * 40 + b"]" * 40],
           [VERSION, b"HELLO", b'{"id":' + b"9" * 400 + b"}"], [VERSION, b"HELLO", b'{"id":NaN}'],
           [VERSION, b"HELLO", b'{"id":1}'] + [b""] * 9, [bytes(7), bytes(16), bytes(100)],
           [VERSION, b"SUBMIT", os.urandom(65537)]]
    peer = dealer(endpoint)
    while True:
        for message in bad:
            with contextlib.suppress(zmq.Again):
                peer.send_multipart(message)
        while peer.poll(0):
            peer.recv_multipart()


def say(peer, verb, body=(), **header):
    """A request whose answer nobody waits for; False: it was not taken."""
    try:
        peer.send_multipart([VERSION, verb.encode(), json.dumps({"id": 1, **header}).encode(),
                             *body], zmq.DONTWAIT)
        return True
    except zmq.Again:
        return False


def half(endpoint):
    """Handshakes that stop after the greeting, or in the middle of the next command; 30 at a time,
    for ever anew.
    """
    host, port = endpoint.split(":")
    dice, kept = random.Random(7), []
    while True:
        with contextlib.suppress(OSError):
            one = socket.create_connection((host, int(port)), timeout=1)
            kept.append(one)
            one.sendall(GREETING[:dice.choice([1, 11, 33, len(GREETING)])]
                        + dice.choice([b"", b"\x04", b"\x04\xff\x05READY"]))
        if len(kept) > 30:
            kept.pop(dice.randrange(30)).close()
        time.sleep(0.02)


def stopped(endpoint):
    """Peers, half of them under one routing id, that pipeline past all limits with heartbeats
    between, read nothing and go: libzmq's stopped input.
    """
    dice = random.Random(9)
    while True:
        peers = [dealer(endpoint, identity=b"x" if i % 2 else None, sndhwm=0, rcvhwm=1,
                        heartbeat_ivl=dice.choice([1, 10, 100])) for i in range(8)]
        for peer in peers:
            for _ in range(dice.choice([5, 40, 900])):
                say(peer, dice.choice(["HELLO", "LIST", "METRICS"]))
        time.sleep(dice.choice([0.05, 0.3, 1]))
        for peer in peers:
            peer.close()


def gone(endpoint):
    """Peers that subscribe and wait, for what never comes, and go."""
    while True:
        peer = dealer(endpoint, sndhwm=0)
        for i in range(20):
            say(peer, "EVENTS", stream=f"never{i}")
            say(peer, "WAIT", job="key:never", timeout_s=3600)
        data, described = ring_down(samples=16)
        say(peer, "SUBMIT", [data], kind="identify", input=described, key="never", not_before=4e9)
        time.sleep(0.05)
        peer.close()


def gaps(endpoint):
    """Streams whose samples lie ever further apart, closed so that the gaps are written."""
    dice, n = random.Random(11), 0
    while True:
        n += 1
        peer = dealer(endpoint, sndhwm=0, rcvtimeo=2000)
        body = struct.pack("<8d", *range(8))
        with contextlib.suppress(zmq.Again, KeyError):
            say(peer, "STREAM", op="open", name=f"gap{n % 10}", channels=1, dt=0.1)
            opened = json.loads(peer.recv_multipart()[2])
            for first in (0, 1000, 10 ** 5, 10 ** 6, dice.choice([10 ** 7, 10 ** 8, 2 ** 50])):
                say(peer, "STREAM", [body], op="push", stream=opened["stream"], epoch=0,
                    first=first, count=8, crc32c=crc32c(body))
                peer.recv_multipart()
            say(peer, "STREAM", op="close", stream=opened["stream"])
            peer.recv_multipart()
        peer.close()
        time.sleep(0.2)


def flood(endpoint):
    """Submissions, as many as are taken, their answers unread but for room."""
    peer, n = dealer(endpoint, sndhwm=100), 0
    while True:
        n += 1
        data, described = ring_down(samples=16, phase=n * 1e-4)
        if not say(peer, "SUBMIT", [data], kind="identify", input=described, key=f"flood{n}"):
            time.sleep(0.001)
        while peer.poll(0):
            peer.recv_multipart()


EVIL = [0, 1, -1, 0.5, 2 ** 31, 2 ** 53, -2 ** 63, 1e308, 1e-320, "", "a", "../../etc/passwd",
        "x" * 65000, "\0", "key:", None, True, [], {}, [[]], "f" * 64]


def fuzz(endpoint):
    """Requests of all verbs but DRAIN, members missing, wrong and evil; one frame in twenty is
    noise.
    """
    dice, peer = random.Random(13), dealer(endpoint, sndhwm=100)
    data, described = ring_down(samples=16)
    known = {"HELLO": {"versions": ["MODALD1"]}, "STATUS": {"job": "key:a"},
             "WAIT": {"job": "key:a", "timeout_s": 0.1},
             "RESULT": {"job": "key:a", "offset": 0, "length": 9},
             "CANCEL": {"job": "key:a"}, "RETRY": {"job": "key:a"}, "DELETE": {"job": "key:a"},
             "LIST": {"limit": 9, "state": "done"}, "STATS": {}, "METRICS": {}, "WHOAMI": {},
             "STREAMS": {"name": "f", "limit": 9},
             "EVENTS": {"from": 1, "job": "key:a"},
             "SUBMIT": {"kind": "identify", "options": {"rank.fixed": 2}, "input": described,
                        "key": "a", "run_limit_s": 1},
             "SUBMITS": {"jobs": [{"kind": "identify", "input": described}]},
             "UPLOAD": {"op": "begin", "upload": "00000000", "content": "batch", "samples": 16,
                        "channels": 1, "dt": 1.0, "offset": 0, "sha256": "f" * 64, "crc32c": 1},
             "STREAM": {"op": "open", "name": "f", "channels": 1, "dt": 0.1, "stream": "00000000",
                        "epoch": 0, "first": 0, "count": 16, "crc32c": crc32c(data)}}
    ops = {"UPLOAD": ["begin", "chunk", "seal", "abort"], "STREAM": ["open", "push", "close"]}
    while True:
        verb = dice.choice(list(known))
        header = {key: dice.choice(EVIL) if dice.random() < 0.1 else value
                  for key, value in known[verb].items() if dice.random() > 0.05}
        if "op" in header and dice.random() < 0.9:
            header["op"] = dice.choice(ops[verb])
        frames = [VERSION, verb.encode(), json.dumps({"id": 1, **header}).encode(),
                  *([data] if dice.random() < 0.6 else [])]
        if dice.random() < 0.05:
            frames[dice.randrange(len(frames))] = dice.randbytes(dice.randrange(40))
        with contextlib.suppress(zmq.Again):
            peer.send_multipart(frames)
        while peer.poll(0):
            peer.recv_multipart()
        if dice.random() < 0.002:
            peer.close()
            peer = dealer(endpoint, sndhwm=100)


def shaken(endpoint):
    """A raw connection past ZMTP's handshake."""
    host, port = endpoint.split(":")
    one = socket.create_connection((host, int(port)), 20)
    body = b"\x05READY\x0bSocket-Type\0\0\0\x06DEALER\x08Identity\0\0\0\0"
    one.sendall(GREETING + b"\x04" + bytes([len(body)]) + body)
    seen = b""
    while b"\x08Identity\0\0\0\0" not in seen:
        more = one.recv(4096)
        if not more:
            raise ConnectionResetError
        seen += more
    return one


def hangups(endpoint):
    """More requests than the pipe to the loop holds, a PING among them, and gone: what ended the
    daemon through libzmq 4.3.4.
    """
    asked = b"\x01\x07MODALD1\x01\x04LIST\x00\x08" + b'{"id":1}'
    while True:
        with contextlib.suppress(OSError), shaken(endpoint) as one:
            one.sendall((asked * 40 + b"\x04\x07\x04PING\x00\x0a") * 3 + asked * 20)
        time.sleep(0.001)


def fleeting(endpoint):
    """Connections that ask once, subscribe, wait, and are gone."""
    asked = b"".join(b"\x01\x07MODALD1\x01" + bytes([len(verb)]) + verb + b"\x00"
                     + bytes([len(header)]) + header
                     for verb, header in ((b"HELLO", b'{"id":1}'), (b"EVENTS", b'{"id":2}'),
                                          (b"WAIT",
                                           b'{"id":3,"job":"key:known","timeout_s":3600}')))
    while True:
        with contextlib.suppress(OSError), shaken(endpoint) as one:
            one.sendall(asked)
            one.recv(4096)
        time.sleep(0.001)


def endless(endpoint):
    """A message whose frames do not end; closed by the daemon, it begins again."""
    part = b"\x01\xfa" + bytes(250)
    while True:
        with contextlib.suppress(OSError), shaken(endpoint) as one:
            while True:
                one.sendall(part * 1000)
        time.sleep(0.01)


@contextlib.contextmanager
def attack(probe, daemon, keys=None):
    """The probe, at work on DAEMON while the body runs; with KEYS, of server and user, as that
    user.
    """
    process = subprocess.Popen([sys.executable, __file__, probe,
                                daemon.endpoint.removeprefix("tcp://")], stdout=subprocess.PIPE,
                               env={**os.environ, **(
        {"HOSTILE_KEYS": ",".join(key.decode() for key in keys)} if keys else {})})
    try:
        process.stdout.readline()
        assert process.poll() is None
        yield process
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


def free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


PROBES = {probe.__name__: probe for probe in (bomb, oversize, silent, garbage, taken, keyless,
                                              deaf, malformed, half, stopped, gone, gaps, flood,
                                              fuzz,
                                               hangups, fleeting, endless)}

if __name__ == "__main__":
    if sys.argv[1] != "silent":                   # which says so once it has all its connections
        print("at work", flush=True)
    parent = os.getpid()
    # libzmq may end a peer of this kind: another takes its place
    while True:
        if os.fork() == 0:
            # PR_SET_PDEATHSIG; whose parent ended before has no signal to come
            ctypes.CDLL(None).prctl(1, signal.SIGKILL)
            if os.getppid() != parent:
                os._exit(0)
            PROBES[sys.argv[1]](sys.argv[2])
        os.wait()
        time.sleep(0.1)
