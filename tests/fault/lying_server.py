"""A server of streams that lies: ZMTP 3 by hand on an ipc socket, so that every byte is ours and no
library stands between us and the host's.

Each function below is a trick, played on every connection that comes until the host is gone.
`Server(path, trick)` runs one in a thread; `played` counts how often it came as far as it meant to.
"""
import contextlib
import json
import random
import socket
import struct
import threading
import time

SIGNATURE = b"\xff" + bytes(8) + b"\x7f"
MORE, LONG, COMMAND = 1, 2, 4
EVENT = (b'{"subscription":"1","event":"modes","stream":"plain","stream_id":"abcd1234","epoch":0,'
         b'"to":5,"modes":[{"frequency_hz":4,"damping_ratio":0.1}],"stability":{"stable":true}}')


def greeting(version=b"\x03\x01", mechanism=b"NULL"):
    return SIGNATURE + version + mechanism.ljust(20, b"\0") + bytes(32)


def frame(body, flags=0):
    return (struct.pack(">BB", flags, len(body)) + body if len(body) < 256
            else struct.pack(">BQ", flags | LONG, len(body)) + body)


def message(*parts):
    return b"".join(frame(part, MORE if i + 1 < len(parts) else 0) for i, part in enumerate(parts))


def said(kind, header):
    return message(b"MODALD1", kind, header if isinstance(header, bytes)
                   else json.dumps(header).encode())


PING = frame(b"\x04PING\0\0", COMMAND)
READY = frame(b"\x05READY\x0bSocket-Type\0\0\0\x06ROUTER", COMMAND)


class Gone(Exception):
    """The host has hung up."""


class Connection:
    def __init__(self, s, streams):
        self.s, self.came, self.streams = s, b"", streams
        self.many = 2000 if streams else 12000          # events: more than either library let wait

    def send(self, data):
        try:
            self.s.sendall(data)
        except OSError as why:
            raise Gone from why

    def take(self, count):
        while len(self.came) < count:
            try:
                more = self.s.recv(1 << 16)
            except OSError as why:
                raise Gone from why
            if not more:
                raise Gone
            self.came += more
        out, self.came = self.came[:count], self.came[count:]
        return out

    def shake_hands(self):
        self.send(greeting())
        self.take(64)
        self.send(READY)
        self.request()

    def request(self):
        """The parts of the next message or command, PINGs answered."""
        parts = []
        while True:
            flags = self.take(1)[0]
            size = struct.unpack(">Q", self.take(8))[0] if flags & LONG else self.take(1)[0]
            body = self.take(size)
            if flags & COMMAND and body.startswith(b"\x04PING"):
                self.send(frame(b"\x04PONG" + body[7:], COMMAND))
                continue
            parts.append(body)
            if not flags & MORE:
                return parts

    def header(self, op=None):
        """The next request's header; with OP the next of that kind, whatever comes before it
        answered as it should be."""
        while True:
            parts = self.request()
            header = json.loads(parts[2])
            if op is None or header.get("op") == op:
                return header
            self.send(said(b"REPLY", answer(header)))

    def opened(self):
        """Answer until samples come: the first push.  Of a client without a stream: its first
        question, answered too."""
        self.shake_hands()
        header = self.header("push" if self.streams else None)
        if not self.streams:
            self.send(said(b"REPLY", {**answer(header), "subscription": "1", "next": 1}))
        return header


def answer(header):
    return {"id": header["id"], "verb": "STREAM", "stream": "abcd1234", "name": "plain", "epoch": 0,
            "next": header.get("first", 0) + header.get("count", 0),
            "credit": 1000000}


# -- tricks
# --------------------------------------------------------------------------------------------------

def busy_then_a_flood_then_gone(c, played):
    """The thread that reads was to sleep, the pipe to fill, input to stop and the hang-up to be
    found there by the next heartbeat."""
    push = c.opened()
    c.send(said(b"ERROR",
                {"id": push["id"],
                 "error": {"code": "busy", "message": "x", "detail": {"retry_after_s": 0.5}}}) * 20)
    c.send(said(b"EVENT", EVENT) * c.many * 2)
    played()


def a_flood_with_pings_then_gone(c, played):
    """What is still in the buffer when input goes on again asks for a PONG, and there is nobody to
    send it to."""
    c.opened()
    c.send(b"".join(said(b"EVENT", EVENT) + PING for _ in range(c.many)))
    played()


def pings_and_gone(c, played):
    c.shake_hands()
    c.send(PING * 500 + frame(b"\x04PING", COMMAND)
           + frame(b"\x04PING\xff\xff" + b"c" * 16, COMMAND) * 20)
    played()


def odd_commands(c, played):
    c.opened()
    for body in (b"", b"\x09SUBSCRIBE", b"\x09SUBSCRIBEall", b"\x06CANCEL", b"\x05ERROR\x03400",
                 b"\x05READY", b"\xffx", b"\x04PONG", b"\x04PING\0\1"):
        for flags in (COMMAND, COMMAND | MORE):
            c.send(frame(body, flags))
    c.send(said(b"EVENT", EVENT))
    played()
    c.request()


def gone_while_its_events_are_read(c, played):
    """Honest events, and a hang-up at any moment: also between two frames of one of them, as the
    host reads it."""
    c.opened()
    r = random.Random(played())
    for _ in range(r.randrange(1, 60)):
        c.send(said(b"EVENT", EVENT) * 80)
        time.sleep(r.random() * 4e-4)


def half_a_message_and_gone(c, played):
    c.opened()
    c.send(said(b"EVENT", EVENT) * 50 + frame(b"MODALD1", MORE) + frame(b"EVENT", MORE))
    played()


def half_a_frame_and_gone(c, played):
    c.opened()
    c.send(said(b"EVENT", EVENT) * 50 + frame(EVENT, MORE)[:40])
    played()


def a_frame_beyond_all_bounds(c, played):
    c.opened()
    c.send(struct.pack(">BQ", LONG, 2**63 - 1) + b"x" * 1000)
    played()
    c.request()


def a_frame_of_2_MiB(c, played):
    c.opened()
    played()
    c.send(message(b"MODALD1", b"EVENT", b" " * (2 << 20)))
    c.request()


def messages_of_other_shapes(c, played):
    c.opened()
    c.send(message(b"") + message(b"MODALD1") + message(b"MODALD1", b"REPLY")
           + message(b"MODALD2", b"REPLY", b"{}") + message(*[b"x"] * 200)
           + message(b"MODALD1", b"REPLY" * 40, b"{}", b"body")
           + message(b"MODALD1", b"REPLY", b"", b"", b"{}")
           + message(b"MODALD1", b"EVENT", b"\0" * 100))
    played()
    c.request()


def garbage(c, played):
    c.shake_hands()
    c.send(random.Random(5).randbytes(5000))
    played()


def no_greeting_of_this_time(c, played):
    """ZMTP 1.0, 2.0, versions that are not there yet, mechanisms that are not ours; one a
    connection."""
    kinds = [b"\x01\0", SIGNATURE + b"\0\5" + b"\0\0", SIGNATURE + b"\1\5" + b"\0\0",
             greeting(b"\x09\x09"), greeting(mechanism=b"PLAIN"), greeting(mechanism=b"CURVE"),
             greeting(mechanism=b""), b"HTTP/1.1 400 Bad Request\r\n\r\n"]
    c.send(kinds[played() % len(kinds)] + b"\0\3abc" * 20)
    c.take(1 << 20)


def half_a_greeting_and_gone(c, played):
    c.send(greeting()[:played() % 64])


def a_handshake_that_fails(c, played):
    bodies = [b"\x05ERROR\x03400", b"\x05ERROR\xff", b"\x05ERROR", b"\x05READY\xff",
              b"\x05READY\x0bSocket-Type\xff\xff\xff\xff", b"\x05READY\x0bSocket-Type\0\0\0\x03PUB",
              b""]
    c.send(greeting())
    c.take(64)
    c.send(frame(bodies[played() % len(bodies)], COMMAND) * 3)
    c.take(1 << 20)


NUMBERS = ["0", "-1", "1e308", "-1e308", "1e999", "nan", "inf", "9007199254740993",
           "18446744073709551616", "1e19", "", '"x"', "0x7f", "262144", "1", "0.5"]
LIES = ['{"subscription":"1","stability":{"stable":true},"modes":[],"epoch":0,"stream_id":',
        '{"stability":{"stable":true},"epoch":0,"stream_id":"', '{"id":0,"credit":1e308}',
        '{"id":0,"credit":-1}', '{"id":0,"credit":nan}',
        '{"stability":{"stable":true},"epoch":1e308}', '{"id":inf}', '{', '{"id', '[' * 9000,
        '{"a":' * 9000, '"', '"\\', "", "\x00"]


def lies_in_headers(c, played):
    """Of every number and every end of a header, at random from a seed a connection."""
    r = random.Random(played())
    push = c.opened()
    for lie in LIES:
        for kind in (b"REPLY", b"ERROR", b"EVENT"):
            c.send(said(kind, lie.encode()))
    for _ in range(3000):
        n = lambda: r.choice(NUMBERS)  # noqa: E731
        modes = ",".join(
            f'{{"frequency_hz":{n()},"damping_ratio":{n()},'
            f'"std":{{"frequency_hz":{n()},"damping_ratio":{n()}}}}}'
            for _ in range(r.choice([0, 1, 3, 30])))
        texts = {b"REPLY":
                 f'{{"id":{push["id"]},"verb":"STREAM","stream":"abcd1234","epoch":{n()},'
                 f'"next":{n()},"credit":{n()}}}',
                 b"EVENT":
                 f'{{"epoch":{n()},"to":{n()},"modes":[{modes}],'
                 f'"stability":{{"stable":{r.choice(["true", "false", "null", "", "}"])}}},'
                 f'"stream_id":"abcd1234"}}',
                 b"ERROR":
                 f'{{"id":{n()},"error":{{"code":"{r.choice(["busy", "quota", "not_found"])}",'
                 f'"message":"%s%n","detail":{{"retry_after_s":{n()}}}}}}}'}
        kind = r.choice(list(texts))
        text = texts[kind].encode()
        c.send(said(kind, text[:r.randrange(len(text))] if r.random() < 0.3 else text))


def all_is_busy(c, played):
    c.shake_hands()
    while True:
        header = c.header()
        c.send(said(b"REPLY", answer(header)) if header.get("op") != "push"
               else said(b"ERROR",
                         {"id": header["id"], "error": {"code": "busy", "message": "x",
                                                        "detail": {"retry_after_s": 0.05}}}))
        played()


def refusal_in_control_signs(c, played):
    push = c.opened()
    c.send(said(b"ERROR", {"id": push["id"],
                           "error": {"code": "denied",
                                     "message": "no \x1b]0;owned\x07 \r\n\x1b[2J"}}))
    played()
    c.request()


def events_without_end(c, played):
    c.opened()
    block = said(b"EVENT", EVENT) * 1000
    while True:
        c.send(block)
        played()


def large_events_without_end(c, played):
    c.opened()
    block = said(b"EVENT", EVENT[:-1] + b',"x":"' + b"y" * 900000 + b'"}')
    while True:
        c.send(block)
        played()


def commands_without_end(c, played):
    """Those that libzmq answers, passes on as messages, or drops."""
    c.opened()
    block = b"".join(frame(body, COMMAND) for body in (
        b"\x04PING\xff\xffand what is echoed", b"\x09SUBSCRIBEall", b"\x06CANCELall",
        b"\x05ERROR\x03400", b"\x07UNKNOWN" + bytes(1000), b"")) * 500
    while True:
        c.send(block)
        played()


TRICKS = [busy_then_a_flood_then_gone, a_flood_with_pings_then_gone, pings_and_gone, odd_commands,
          gone_while_its_events_are_read, half_a_message_and_gone, half_a_frame_and_gone,
          a_frame_beyond_all_bounds, a_frame_of_2_MiB, messages_of_other_shapes, garbage,
          no_greeting_of_this_time, half_a_greeting_and_gone, a_handshake_that_fails,
          lies_in_headers, all_is_busy, refusal_in_control_signs]
FLOODS = [events_without_end, large_events_without_end, commands_without_end]


class Server:
    def __init__(self, path, trick, streams=True):
        self.url, self.trick, self.streams, self.played = f"ipc://{path}", trick, streams, 0
        self.lock, self.open = threading.Lock(), set()
        self.listener = socket.socket(socket.AF_UNIX)
        self.listener.bind(str(path))
        self.listener.listen(8)
        self.threads = [threading.Thread(target=self.serve)]
        self.threads[0].start()

    def count(self):
        with self.lock:
            self.played += 1
            return self.played - 1

    def serve(self):
        while True:
            try:
                s, _ = self.listener.accept()
            except OSError:
                return
            self.open.add(s)
            self.threads.append(threading.Thread(target=self.play, args=(s,)))
            self.threads[-1].start()

    def play(self, s):
        with s, contextlib.suppress(Gone, ValueError):
            self.trick(Connection(s, self.streams), self.count)
        self.open.discard(s)

    def stop(self):
        self.listener.shutdown(socket.SHUT_RDWR)
        self.threads[0].join()
        for s in list(self.open):
            with contextlib.suppress(OSError):
                s.shutdown(socket.SHUT_RDWR)
        for thread in self.threads:
            thread.join()
        self.listener.close()
