"""One connection to modald, lost and found again by itself, for any number of threads.

A thread of its own owns the socket; those who ask hand it their messages and wait for what comes
back (`Talk`).

No server may end the interpreter.  libzmq 4.3.4 asserts where input has stopped or a pipe is taken
away (clients/c/stream/state.h tells how), so input never stops (ZMQ_RCVHWM 0), no heartbeat is
ours, nothing is given to a connection that is not ready, and one that is lost ends its socket.  A
server that says more than we take is hung up on.
"""
from __future__ import annotations

import collections
import errno
import grp
import itertools
import os
import pathlib
import queue
import socket
import stat
import threading
import time
from typing import Any, Sequence

import zmq
import zmq.utils.monitor

from . import wire

Document = dict[str, Any]
Frames = Sequence["bytes | memoryview"]
Message = tuple[str, Document, list[bytes]]
FIRST_PATIENCE = 2.0            # s: nobody there at the start
LOST_PATIENCE = 30.0            # s: in which a daemon that was there comes back
PAUSE_LEAST = 0.05              # s between two connections; doubled until one is good
PAUSE_MOST = 1.0                # s
PAUSE_ASKED = 5.0               # s: no longer without asking, whatever a daemon says
UNREAD_MOST = wire.DOCUMENT_MOST     # bytes of a talk that nobody fetches
MESSAGES_MOST = 16384           # of a talk, without a silence
MECHANISM_MISMATCH = 0x11000002     # libzmq's number for "the other side wants keys, or none"
_OPTIONS = ((zmq.LINGER, 0), (zmq.RECONNECT_IVL, 50), (zmq.RECONNECT_IVL_MAX, 1000),
            (zmq.SNDHWM, 256), (zmq.RCVHWM, 0), (zmq.TCP_KEEPALIVE, 1),
            (zmq.TCP_KEEPALIVE_IDLE, 5), (zmq.TCP_KEEPALIVE_INTVL, 5), (zmq.TCP_KEEPALIVE_CNT, 2),
            (zmq.TCP_MAXRT, 15000), (zmq.MAXMSGSIZE, wire.BODY_MOST))
_EVENTS = (zmq.EVENT_HANDSHAKE_SUCCEEDED | zmq.EVENT_DISCONNECTED
           | zmq.EVENT_HANDSHAKE_FAILED_AUTH | zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL
           | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL)


def shown(text: str) -> str:
    """TEXT for people to read, whoever wrote it: what a terminal would obey is escaped."""
    return "".join(c if c.isprintable() or c in "\n\t" else c.encode("unicode_escape").decode()
                   for c in text)


class Error(Exception):
    """A failure: `code` is the protocol's, `field` names what is at fault, `detail` says more."""

    def __init__(self, code: str, message: str, field: str | None = None,
                 detail: Document | None = None):
        """Of a `code` of proto/PROTOCOL.md, or "timeout", "no_server"."""
        super().__init__(shown(f"{code}: {field + ': ' if field else ''}{message}"))
        self.code, self.message, self.field, self.detail = code, message, field, detail or {}

    def __reduce__(self) -> tuple[Any, ...]:
        """All of it travels, also to another process."""
        return Error, (self.code, self.message, self.field, self.detail)

    @classmethod
    def of(cls, error: Any) -> "Error":
        """From an answer's `error`."""
        if not isinstance(error, dict):
            return cls("bad_frame", "the daemon's answer is an error and says none")
        code, message, field = (error.get(name) for name in ("code", "message", "field"))
        detail = error.get("detail")
        return cls(code if isinstance(code, str) else "internal",
                   message if isinstance(message, str) else "",
                   field if isinstance(field, str) else None,
                   detail if isinstance(detail, dict) else None)

    def pause(self, otherwise: float) -> float:
        """Seconds after which to ask again: the daemon's `retry_after_s`, where it says any."""
        told: Any = self.detail.get("retry_after_s", otherwise)
        good = type(told) in (int, float) and told >= 0
        return float(min(PAUSE_ASKED, told if good else otherwise))


def read_keyfile(path: str) -> dict[str, bytes]:
    """Keys of a file that only its owner may read."""
    mode = os.stat(path).st_mode
    if not stat.S_ISREG(mode):
        raise Error("bad_input", f"{path}: no file; accepted: a file of mode 0600", "keyfile")
    if stat.S_IMODE(mode) & 0o077:
        raise Error("bad_input", f"{path}: others may read it; accepted: a file of mode 0600",
                    "keyfile")
    keys = {}
    for line in pathlib.Path(path).read_text().splitlines():
        name, equals, value = line.partition("=")
        if equals and not line.lstrip().startswith("#"):
            keys[name.strip()] = value.strip().strip('"').encode()
    if not {"public-key", "secret-key", "server-key"} <= keys.keys():
        raise Error("bad_input", f"{path}: accepted: public-key, secret-key and server-key",
                    "keyfile")
    return keys


class Talk:
    """What one caller asks, and what comes back, in its order.

    None comes once after a loss of the connection that took answers with it.
    Of one thread; `with` ends it, however it is left: what was asked in it is then nobody's."""

    def __init__(self, link: "Link"):
        """Nothing is asked yet."""
        self.link = link
        self.inbox: queue.SimpleQueue[tuple[Message | None, int]] = queue.SimpleQueue()
        self.unread = 0                                 # bytes
        self.numbers: set[int] = set()                  # asked, not answered
        self.listens = False                            # to events

    def __enter__(self) -> "Talk":
        """Itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Nobody waits for what was asked in it any more."""
        self.link.forget(self)

    def send(self, verb: str, header: Document, body: Frames = ()) -> int:
        """Ask; the number that the answer will have as its id."""
        return self.link.post(self, verb, header, body)

    def receive(self, deadline: float, what: str = "nothing came in time") -> Message | None:
        """The next answer, until `deadline` of time.monotonic(): then Error "timeout", WHAT."""
        while True:
            left = deadline - time.monotonic()
            try:
                look = 0.5 if self.link.ready else 0.02
                message, size = self.inbox.get(timeout=max(0.0, min(left, look)))
                self.unread -= size
                return message
            except queue.Empty:
                self.link.check()
                if left <= 0:
                    raise (Error("timeout", f"{self.link.endpoint}: {what}") if self.link.ready
                           else self.link.nobody())


def endpoint_fault(endpoint: str) -> str:
    """What it is not that an endpoint is; nothing: libzmq may be asked, which takes ports modulo
    65536."""
    way, _, rest = endpoint.partition("://")
    if way == "ipc":
        return "" if rest else "has no path"
    if way != "tcp":
        return "begins with neither ipc:// nor tcp://"
    port = rest.rpartition(":")[2]
    good = port.isascii() and port.isdigit() and 1 <= float(port) <= 65535 and ":" in rest
    return "" if good else "ends in no port of 1 to 65535"


class Link:
    """See the module.  Everything below the line belongs to the thread."""

    def __init__(self, endpoint: str, keyfile: str | None):
        """Begin to connect; does not wait."""
        self.endpoint = endpoint
        accepted = "accepted: ipc://PATH or tcp://HOST:PORT"
        if fault := endpoint_fault(endpoint):
            raise Error("bad_input", f'"{endpoint}" {fault}; {accepted}', "server")
        try:
            self.keys = read_keyfile(keyfile) if keyfile else {}
        except (OSError, UnicodeDecodeError) as why:
            raise Error("bad_input", f"{endpoint}: {why}", "keyfile") from why
        self.ready = self.was_ready = False
        self.failure = ""               # of the last try: "key", "mechanism", "handshake"
        self.since = time.monotonic()                   # of the connection's absence
        self._ended: Error | None = None
        self._ids = itertools.count(1)
        self._pid = os.getpid()
        # the collector may close a client while the thread is inside
        self._lock = threading.RLock()
        self._asking: dict[int, Talk] = {}              # by the number of what is not answered yet
        self._listeners: list[Talk] = []
        self._outgoing: collections.deque[tuple[int, Frames]] = collections.deque()
        self._bell, self._rope = socket.socketpair()    # a byte wakes the thread
        self._bell.setblocking(False)
        self._rope.setblocking(False)
        self._context = zmq.Context()
        self._lost = self._broken = False
        self._pause, self._sockets = PAUSE_LEAST, 0
        try:
            self._open()
        except zmq.ZMQError as why:
            self._context.destroy(linger=0)
            raise Error("bad_input", f"{endpoint}: {why}; {accepted}", "server") from why
        self._thread = threading.Thread(target=self._run, name="modald", daemon=True)
        self._thread.start()

    @staticmethod
    def frames(verb: str, header: Document, body: Frames) -> list[bytes | memoryview]:
        """A request as it is sent, or Error "bad_input"."""
        try:
            return wire.encode(verb, header, *body)
        except (TypeError, ValueError) as why:          # too long, NaN, or no text
            raise Error("bad_input", str(why), "header") from why

    def post(self, talk: Talk, verb: str, header: Document, body: Frames) -> int:
        """A message on its way as soon as there is a connection; its number."""
        self.check()
        number = next(self._ids)
        frames = self.frames(verb, {**header, "id": number}, body)
        with self._lock:
            self._asking[number] = talk
            talk.numbers.add(number)
            if talk.listens and talk not in self._listeners:
                self._listeners.append(talk)
            self._outgoing.append((number, frames))
        self._ring()
        return number

    def forget(self, talk: Talk) -> None:
        """Its answers, when they come, are nobody's."""
        if os.getpid() != self._pid:            # the thread may have had the lock: it is gone
            return
        with self._lock:
            for number in talk.numbers:
                self._asking.pop(number, None)
            if any(number in talk.numbers for number, _ in self._outgoing):
                self._outgoing = collections.deque(one for one in self._outgoing
                                                   if one[0] not in talk.numbers)
            if talk in self._listeners:
                self._listeners.remove(talk)
            talk.numbers.clear()

    def close(self) -> None:
        """Whoever still waits is told so."""
        if os.getpid() != self._pid or self._ended is not None:
            return
        self._ended = Error("no_server", f"{self.endpoint}: the client was closed")
        self._ring()
        if threading.current_thread() is not self._thread:
            self._thread.join()

    def check(self) -> None:
        """Raise where there is no connection, and none is to be expected."""
        if os.getpid() != self._pid:
            raise Error("bad_input", "this client was made before a fork; a child makes its own",
                        "client")
        if self._ended is not None:
            raise Error(self._ended.code, self._ended.message)
        if not self.ready and self._given_up():
            raise self.nobody()

    def _given_up(self) -> bool:
        if self.was_ready:
            return time.monotonic() > self.since + LOST_PATIENCE
        return (self.failure in ("key", "mechanism")
                or time.monotonic() > self.since + FIRST_PATIENCE
                or self._closed_to_us() is not None)

    def _closed_to_us(self) -> str | None:
        """Why we may not open a socket of this host; None: we may, or it is none."""
        path = self.endpoint.removeprefix("ipc://")
        if path == self.endpoint or path.startswith("@"):
            return None
        try:
            found = os.stat(path)
        except OSError as why:
            return "a folder on its way is closed to us" if why.errno == errno.EACCES else None
        if os.access(path, os.W_OK, effective_ids=True):
            return None
        try:
            group = grp.getgrgid(found.st_gid).gr_name
        except KeyError:
            group = "unknown"
        return (f"the socket has mode {stat.S_IMODE(found.st_mode):03o} and group {group}; "
                "ipc_mode of the daemon and being of that group let one in")

    def nobody(self) -> Error:
        """Why there is no connection."""
        closed = self._closed_to_us()
        if closed is not None:
            return Error("denied", f"{self.endpoint}: permission denied: {closed}")
        keys = bool(self.keys)
        code, text = {
            "": ("no_server", f"no modald at {self.endpoint}"),
            "key": ("denied", "our key was refused: the daemon's keys file does not have it"),
            "mechanism": ("denied", "the daemon takes no keys: leave out keyfile and "
                                    "$MODALD_KEYFILE" if keys else
                                    "the daemon wants a key: keyfile or $MODALD_KEYFILE names a "
                                    "file that modalctl keygen made"),
            "handshake": ("denied", "somebody is there, but does not answer to our keys: "
                                    "server-key in the key file is another daemon's, or the daemon "
                                    "takes no keys") if keys else
                         ("no_server", "somebody is there, but no modald, or one that wants a key "
                                       "(keyfile, $MODALD_KEYFILE)"),
        }[self.failure]
        return Error(code, f"{self.endpoint}: {text}" if self.failure else text)

    def _ring(self) -> None:
        with self._lock:  # the thread may be gone, and the rope with it
            if self._rope.fileno() < 0:
                return
            try:
                self._rope.send(b"!")
            except BlockingIOError:                     # it has been rung often enough
                pass

    # -- the thread's -----------------------------------------------------------------------------

    def _open(self) -> None:
        self._socket = self._context.socket(zmq.DEALER)
        for option, value in _OPTIONS:
            self._socket.setsockopt(option, value)
        if self.keys:
            self._socket.curve_publickey = self.keys["public-key"]
            self._socket.curve_secretkey = self.keys["secret-key"]
            self._socket.curve_serverkey = self.keys["server-key"]
        self._sockets += 1
        self._monitor = self._socket.get_monitor_socket(_EVENTS,
                                                        f"inproc://monitor-{self._sockets}")
        self._socket.connect(self.endpoint)
        self._poller = zmq.Poller()
        for one in (self._socket, self._monitor, self._bell):
            self._poller.register(one, zmq.POLLIN)

    def _renew(self) -> None:
        """This connection's socket ends with it; the next has one of its own, after a pause."""
        self._socket.disable_monitor()
        self._monitor.close()
        self._socket.close()
        self._lost = self._broken = False
        with self._lock:
            gone = {number for number in self._asking} - {number for number, _ in self._outgoing}
            talks = {self._asking.pop(number) for number in gone} | set(self._listeners)
            self._listeners.clear()
        for talk in talks:
            talk.numbers -= gone
            talk.inbox.put((None, 0))
        begin, self._pause = time.monotonic() + self._pause, min(2 * self._pause, PAUSE_MOST)
        while self._ended is None and (left := begin - time.monotonic()) > 0:
            time.sleep(min(left, 0.02))
        self._open()

    def _listen(self) -> None:
        while self._monitor.poll(0):
            event = zmq.utils.monitor.recv_monitor_message(self._monitor)
            kind = event["event"]
            if kind == zmq.EVENT_HANDSHAKE_SUCCEEDED:
                self.ready = self.was_ready = True
                self.failure = ""
            elif kind == zmq.EVENT_DISCONNECTED:
                self._lost = self._lost or self.ready or self._broken
                self.since = time.monotonic() if self.ready else self.since
                self.ready = False
            else:
                self._broken = kind != zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL
                self.failure = ("key" if kind == zmq.EVENT_HANDSHAKE_FAILED_AUTH else
                                "mechanism" if self._broken
                                and event["value"] == MECHANISM_MISMATCH else "handshake")

    def _deliver(self, frames: list[bytes]) -> bool:
        """To whom it is for; False: he has more than he fetches."""
        try:
            message = wire.decode(frames)
        except ValueError:
            return True                                 # no message of the protocol
        kind, header, _ = message
        number: int | None = header.get("id")
        with self._lock:
            if kind == "EVENT":
                talks = list(self._listeners)
            elif number is None and kind == "ERROR":    # a header of ours that could not be read
                talks = list(set(self._asking.values()))
            else:
                talk = self._asking.pop(number or 0, None)
                talks = [talk] if talk is not None else []
        size = sum(map(len, frames))
        for talk in talks:
            talk.numbers.discard(number or 0)           # numbers begin at 1
            talk.unread += size
            talk.inbox.put((message, size))
        return all(talk.unread <= UNREAD_MOST for talk in talks)

    def _receive(self) -> None:
        """All that has come; of a server that never pauses, enough."""
        for _ in range(MESSAGES_MOST):
            try:
                frames = self._socket.recv_multipart(zmq.DONTWAIT)
            except zmq.Again:
                return
            if not self._deliver(frames):
                break
            self._pause = PAUSE_LEAST
        self._lost, self._pause = True, PAUSE_MOST
        self.since, self.ready = time.monotonic(), False

    def _send(self) -> bool:
        """All that waits; False: it cannot be sent now."""
        while self.ready and self._outgoing:
            with self._lock:
                if not self._outgoing:
                    break
                number, frames = self._outgoing[0]
                try:
                    self._socket.send_multipart(frames, zmq.DONTWAIT)
                except zmq.Again:
                    return False
                self._outgoing.popleft()
        return True

    def _turn(self) -> None:
        full = not self._send()
        if full:
            self._poller.register(self._socket, zmq.POLLIN | zmq.POLLOUT)
        what = dict(self._poller.poll())
        if full:
            self._poller.register(self._socket, zmq.POLLIN)
        if self._bell.fileno() in what:
            self._bell.recv(4096)
        if self._monitor in what:
            self._listen()
        if self._socket in what:
            self._receive()
        if self._lost:
            self._renew()

    def _run(self) -> None:
        try:
            while self._ended is None:
                self._turn()
        except Exception as why:  # nobody shall wait for a thread that is gone
            self._ended = Error("internal",
                                f"{self.endpoint}: the connection's thread ended: {why!r}")
        self.ready = False
        self._context.destroy(linger=0)
        with self._lock:
            talks = {*self._asking.values(), *self._listeners}
            self._rope.close()
            self._bell.close()
        for talk in talks:
            talk.inbox.put((None, 0))
