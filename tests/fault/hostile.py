#!/usr/bin/python3
"""Bad peers, each a process of its own: `hostile.py PROBE HOST:PORT` does its worst until it is ended.

What libzmq does with each is in README.md.
"""
import contextlib
import os
import random
import socket
import subprocess
import sys
import time

import zmq

VERSION = b"MODALD1"
GREETING = b"\xff" + bytes(8) + b"\x7f\x03\x00NULL" + bytes(16 + 1 + 31)      # of ZMTP 3.0, without security


def dealer(endpoint, identity=None):
    made = zmq.Context.instance().socket(zmq.DEALER)
    made.linger, made.sndhwm, made.sndtimeo = 0, 2, 1000
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
    """Frames of 2 MiB, past what the daemon takes; libzmq drops the connection, and the peer is back at once."""
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
            one.sendall((GREETING if dice.randrange(3) == 0 else b"") + dice.randbytes(dice.randrange(1, 2000)))
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
    bad = [[b""], [VERSION], [VERSION, b""], [VERSION, b"HELLO", b"{"], [VERSION, b"NOSUCH", b'{"id":1}'], [b"MODALD9", b"HELLO", b'{"id":1}'],
           [VERSION, b"HELLO", b"[" * 40 + b"]" * 40], [VERSION, b"HELLO", b'{"id":' + b"9" * 400 + b"}"], [VERSION, b"HELLO", b'{"id":NaN}'],
           [VERSION, b"HELLO", b'{"id":1}'] + [b""] * 9, [bytes(7), bytes(16), bytes(100)], [VERSION, b"SUBMIT", os.urandom(65537)]]
    peer = dealer(endpoint)
    while True:
        for message in bad:
            with contextlib.suppress(zmq.Again):
                peer.send_multipart(message)
        while peer.poll(0):
            peer.recv_multipart()


@contextlib.contextmanager
def attack(probe, daemon):
    """The probe, at work on DAEMON while the body runs."""
    process = subprocess.Popen([sys.executable, __file__, probe, daemon.endpoint.removeprefix("tcp://")], stdout=subprocess.PIPE)
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


PROBES = {probe.__name__: probe for probe in (bomb, oversize, silent, garbage, taken, keyless, deaf, malformed)}

if __name__ == "__main__":
    if sys.argv[1] != "silent":                   # which says so once it has all its connections
        print("at work", flush=True)
    PROBES[sys.argv[1]](sys.argv[2])
