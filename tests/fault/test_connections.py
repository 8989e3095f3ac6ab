"""What one connection may do to the daemon and to the others: nothing."""
# Tests as well: accept.c hangup.c intake.c
import contextlib
import json
import os
import pathlib
import re
import resource
import signal
import socket
import struct
import sys
import time

import pytest
import zmq

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "system"))
import sanitized  # noqa: E402
import curve_peer  # noqa: E402
from lab import Lab  # noqa: E402
from wire import (  # noqa: E402
    PATIENCE_S, VERSION, Client, Daemon, crc32c, identity, ring_down, submit, until)

HANDSHAKE_S = 3                         # that one may be silent: ZMQ_HANDSHAKE_IVL of daemon.c
# of ZMTP 3.0, without security
GREETING = b"\xff" + bytes(8) + b"\x7f\x03\x00NULL" + bytes(16 + 1 + 31)


def ready(identity=b"", kind=b"DEALER"):
    """The READY command of ZMTP's NULL mechanism (RFC 23)."""
    body = (b"\x05READY\x0bSocket-Type" + struct.pack(">I", len(kind)) + kind + b"\x08Identity"
            + struct.pack(">I", len(identity)) + identity)
    return (b"\x04" + bytes([len(body)]) if len(body) < 256 else b"\x06"
            + struct.pack(">Q", len(body))) + body


def frame(body, more=False):
    return (bytes([more, len(body)]) + body if len(body) < 256 else bytes([2 | more])
            + struct.pack(">Q", len(body)) + body)


def message(*frames):
    return b"".join(frame(f, i + 1 < len(frames)) for i, f in enumerate(frames))


LIST = message(b"MODALD1", b"LIST", b'{"id":1}')
HELLO = message(b"MODALD1", b"HELLO", b'{"id":1}')
PING = b"\x04\x07\x04PING\x00\x0a"


def reach(daemon):
    tcp = daemon.endpoint.startswith("tcp")
    made = socket.socket(socket.AF_INET if tcp else socket.AF_UNIX)
    made.settimeout(PATIENCE_S)
    made.connect(("127.0.0.1", int(daemon.endpoint.rsplit(":", 1)[1])) if tcp
                 else daemon.endpoint.removeprefix("ipc://"))
    return made


def read_until(connection, what):
    seen = b""
    while what not in seen:
        more = connection.recv(4096)
        assert more, f"closed before {what}, after {seen}"
        seen += more


def connect(daemon):
    """A raw connection that has shaken hands: libzmq takes no message before it has sent its own
    READY."""
    made = reach(daemon)
    made.sendall(GREETING + ready())
    read_until(made, b"\x08Identity\0\0\0\0")
    return made


def metric(client, name):
    text = client.ask("METRICS").body[0].decode()
    return next(float(line.split()[1]) for line in text.splitlines()
                if line.startswith(f"modald_{name} "))


def free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


def until_alone(client):
    """Until CLIENT's is the only connection, what the others left being done with."""
    end = time.monotonic() + PATIENCE_S
    while metric(client, "connections") > 1:
        assert time.monotonic() < end, "connections that ended are still counted"


def memory_mb(daemon, what):
    with open(f"/proc/{daemon.pid}/status") as f:
        return next(int(line.split()[1]) for line in f if line.startswith(what)) / 1024


@contextlib.contextmanager
def serving(tmp_path, security, **users):
    """A daemon without keys, or with those of USERS, and who makes clients of it: `made(name,
    identity)`."""
    if security == "null":
        with Daemon(workers=0) as d:
            yield d, lambda _, identity=None: Client(d.endpoint, identity=identity)
        return
    lab = Lab(tmp_path, users, workers=0)
    with lab.daemon as d:
        yield d, lambda name, identity=None: Client(d.endpoint,
                                                    keys=(lab.server[0], *lab.pairs[name]),
                                                    identity=identity)


@pytest.mark.parametrize("scheme", ["ipc", "tcp"])
def test_who_hangs_up_behind_a_stopped_input_ends_nothing(scheme):
    """More requests than the pipe to the loop holds, a PING among them, and gone: libzmq answers it
    with an assertion where it hears of the hang-up while its input is stopped.  Here it is kept
    from it 200 times; a few dozen connections ended the daemon."""
    with Daemon(workers=0, endpoint=f"tcp://127.0.0.1:{free_port()}" if scheme == "tcp"
                else None) as d:
        honest, made, kept = d.client(), 0, 0
        while kept < 200 and made < 20000:
            group = [connect(d) for _ in range(25)]
            for i, s in enumerate(group):
                with contextlib.suppress(OSError):
                    s.sendall((LIST * (5, 18, 40, 100)[i % 4] + PING) * (1, 3, 10)[i % 3]
                              + LIST * 20)
                    if i % 2:
                        s.shutdown(socket.SHUT_RDWR)
            for s in group:
                s.close()
                made += 1
            assert d.process.poll() is None, d.text()[-400:]
            kept = metric(honest, "hangups_kept_total")
        print(f"\nP6: {scheme}: {made} connections hung up behind their requests, {kept:.0f} "
              "hang-ups kept from a stopped input")
        assert kept >= 200 and honest.ask("HELLO").ok
        until_alone(honest)                      # none of them is kept for ever


def test_each_connection_ended_for_what_it_sends_is_counted_and_the_log_has_a_line_a_second():
    """Those of another protocol, and one whose message does not end; who speaks properly and leaves
    is none of them."""
    with Daemon(workers=0) as d:
        honest, begin, strangers = d.client(), time.monotonic(), 60
        connect(d).close()
        for _ in range(strangers):
            with reach(d) as s:
                s.sendall(b"GET / HTTP/1.1\r\n\r\n")
                with contextlib.suppress(ConnectionResetError):
                    while s.recv(64):            # greeted, then the end
                        pass
        with connect(d) as s, contextlib.suppress(OSError):
            for _ in range(10):
                s.sendall((b"\x03" + (1 << 20).to_bytes(8, "big") + bytes(1 << 20)))
        until_alone(honest)
        assert metric(honest, "connections_ended_total") == strangers + 1

        def told():
            return [int(n) for n in re.findall(r"event=connections_ended count=(\d+)", d.text())]
        while sum(told()) < strangers + 1:
            assert time.monotonic() < begin + PATIENCE_S, told()
        assert sum(told()) == strangers + 1 and len(told()) <= time.monotonic() - begin + 1


def test_what_is_asked_and_left_behind_is_not_answered_and_what_is_submitted_is_done():
    """Else who comes and goes leaves thousands of questions, and everybody else waits for their
    turns."""
    data, described = ring_down(samples=16)
    with Daemon(workers=0) as d:
        honest, left, together = d.client(), 300, 50
        for first in range(0, left, together):
            group = [connect(d) for _ in range(together)]
            os.kill(d.pid, signal.SIGSTOP)       # else it may be quicker than who leaves
            for i, s in enumerate(group, first):
                header = json.dumps({"id": 2, "kind": "identify", "input": described,
                                     "key": f"k{i}"}).encode()
                s.sendall(LIST * 100 + message(b"MODALD1", b"SUBMIT", header, data) + LIST * 40)
                s.close()
            os.kill(d.pid, signal.SIGCONT)
        until_alone(honest)
        # a job counts once it is committed
        until(lambda: honest.ask("STATS")["jobs"]["queued"] == left, "submissions are lost")
        answered = metric(honest, "replies_total")
        print(f"\nP6: {left * 140} questions left behind: {answered:.0f} answered")
        assert answered < left * 140 / 2


@pytest.mark.parametrize("identity", [b"rig", b"\0\1\2\3\4"])
@pytest.mark.parametrize("security", ["null", "curve"])
def test_a_routing_id_of_a_client_s_own_is_not_used(tmp_path, security, identity):
    """Whoever has it: a second connection with it is served beside the first, and after the first
    has gone."""
    with serving(tmp_path, security, ann="ann submit", bob="bob read") as (d, made):
        first, second = made("ann", identity), made("bob", identity)
        assert first.ask("HELLO").ok and second.ask("HELLO").ok and first.ask("HELLO").ok
        first.close()
        until_alone(second)
        assert second.ask("HELLO").ok and made("ann", identity).ask("HELLO").ok


def test_subscriptions_and_waits_end_with_their_connections():
    """4160 subscriptions and 4096 waits are a user's; those of connections that are gone are
    nobody's."""
    with Daemon(workers=0) as d:
        honest = d.client()
        job = submit(honest)["job"]
        for _ in range(65):
            client = d.client()
            for _ in range(64):
                client.send("EVENTS", stream="never")
            assert client.ask("WHOAMI").ok
            client.close()
        for _ in range(8):
            client = d.client()
            for _ in range(512):
                client.send("WAIT", job=job, timeout_s=3600)
            assert client.ask("WHOAMI").ok
            client.close()
        until_alone(honest)
        assert (honest.ask("EVENTS", stream="never").ok
                and honest.ask("WAIT", job=job, timeout_s=0.01)["state"] == "queued")


def test_a_user_may_have_a_subscription_a_stream_and_64_beside_and_not_one_more():
    with Daemon(workers=0) as d:
        client = d.client()
        for _ in range(65):
            for number in [client.send("EVENTS", stream="never") for _ in range(64)]:
                assert client.answer(number).ok
        refused = client.ask("EVENTS", stream="never")
        assert refused["error"]["code"] == "busy" and "4160" in refused["error"]["message"]


def test_what_a_connection_waited_for_reaches_no_other_of_its_routing_id(tmp_path):
    lab = Lab(tmp_path, {"alice": "alice submit", "bob": "bob read"})
    with lab.daemon as d:
        def client(name, identity=None):
            return Client(d.endpoint, keys=(lab.server[0], *lab.pairs[name]), identity=identity)
        alice, later = client("alice", b"rig"), client("alice")
        assert alice.ask("EVENTS").ok
        job = submit(alice, key="secret", not_before=time.time() + 1)["job"]
        alice.send("WAIT", job=job, timeout_s=250, result=True)
        assert alice.ask("WHOAMI").ok
        for _ in range(200):                     # and does not read what is sent: it queues
            alice.send("METRICS")
        assert later.ask("STATUS", job=job).ok
        alice.close()
        bob = client("bob", b"rig")
        assert bob.ask("HELLO").ok
        assert later.ask("WAIT", job=job, timeout_s=250)["state"] == "done"
        assert bob.ask("HELLO").ok and bob.early == []


def is_open(connection):
    connection.setblocking(False)
    try:
        return connection.recv(4096) != b""
    except BlockingIOError:
        return True
    except ConnectionResetError:
        return False


def greeted(daemon):
    """A connection that the daemon has accepted, and that says nothing."""
    made = reach(daemon)
    read_until(made, b"\xff")
    return made


def test_one_who_speaks_is_served_before_those_who_are_silent_have_had_their_time():
    """They have three seconds, and came within a moment: before, none was left when he was heard.
    """
    with Daemon(config="connections = 8\n") as d:
        taken_s = HANDSHAKE_S
        # on a machine that was busy meanwhile their time may have been over: again
        for _ in range(20):
            if taken_s < HANDSHAKE_S:
                break
            with contextlib.ExitStack() as stack:
                begin = time.monotonic()
                silent = [stack.enter_context(greeted(d)) for _ in range(8)]
                c = d.client()
                answered, kept = c.ask("HELLO").ok, sum(map(is_open, silent))
                connections = metric(c, "connections")
                taken_s = time.monotonic() - begin
                c.close()
        assert taken_s < HANDSHAKE_S, "so busy a machine tells nothing"
        assert answered and kept == 7, "one place was wanted, and one given"
        assert connections == 8


def test_who_has_spoken_keeps_his_place():
    with Daemon(config="connections = 4\n") as d, contextlib.ExitStack() as stack:
        kept = [stack.enter_context(connect(d)) for _ in range(4)]
        late = [stack.enter_context(reach(d)) for _ in range(4)]
        for one in late:
            assert not one.recv(64), "one too many is closed"
        assert all(map(is_open, kept))


def test_connections_that_come_and_go_leave_no_memory_and_no_descriptors_behind():
    def come_and_go(count):
        for _ in range(count // 50):
            group = [connect(d) for _ in range(50)]
            for s in group:
                s.sendall(HELLO)
            for s in group:
                read_until(s, b'"store"')
                s.close()

    with Daemon(workers=0) as d:
        honest = d.client()
        come_and_go(3000)
        until_alone(honest)
        before, open_before = memory_mb(d, "VmRSS"), len(os.listdir(f"/proc/{d.pid}/fd"))
        come_and_go(15000)
        until_alone(honest)
        grown = memory_mb(d, "VmRSS") - before
        print(f"\nP6: 15000 connections came and went: RSS grew by {grown:.1f} MB")
        assert len(os.listdir(f"/proc/{d.pid}/fd")) == open_before
        assert grown < 5 or sanitized.SANITIZED          # which keeps what was freed


@pytest.mark.skipif(sanitized.SANITIZED, reason="AddressSanitizer keeps what was freed")
def test_what_was_freed_goes_back_to_the_system_though_the_daemon_is_never_at_rest():
    """A burst under an attack: 56 MiB of messages begun by eight connections, which are gone then,
    while somebody asks again and again."""
    with Daemon(workers=0) as d:
        honest = d.client()
        assert honest.ask("LIST").ok
        before, group = memory_mb(d, "VmRSS"), [connect(d) for _ in range(8)]
        for s in group:
            for _ in range(7):
                s.sendall(frame(bytes(1 << 20), True))
        end = time.monotonic() + PATIENCE_S

        def asked_until(enough, what):
            while not enough(memory_mb(d, "VmRSS") - before):
                assert time.monotonic() < end, what
                assert honest.ask("LIST").ok
                time.sleep(0.05)
        asked_until(lambda grown: grown > 50, "nothing is kept of a message that has begun")
        for s in group:
            s.close()
        asked_until(lambda grown: grown < 15, "memory stays as it was at its most")


@pytest.mark.parametrize("body", [b"\x04PING", b"\x04PING\0"])
@pytest.mark.parametrize("pieces", [1, 2, 7])
def test_a_ping_that_is_cut_short_is_answered_with_nothing_of_the_daemons_memory(body, pieces):
    """libzmq echoes 16 bytes behind it, which may be an address.  A whole PING is answered by what
    came with it, a PONG by nothing, and neither ends the connection."""
    with Daemon(workers=0) as d, connect(d) as s:
        s.sendall(b"\x04\x0b\x04PING\0\x0aecho")
        read_until(s, b"\x04\x09\x04PONGecho")
        s.sendall(b"\x04\x05\x04PONG" + HELLO)
        read_until(s, b'"store"')
        cut = b"\x04" + bytes([len(body)]) + body
        seen, size = b"", -(-len(cut) // pieces)
        with contextlib.suppress(ConnectionResetError, BrokenPipeError):
            for at in range(0, len(cut), size):
                s.sendall(cut[at:at + size])
                time.sleep(0.01)                 # each a read of its own
            while more := s.recv(4096):
                seen += more
        assert b"PONG" not in seen and d.client().ask("HELLO").ok


@contextlib.contextmanager
def peer_by_hand(tmp_path, security):
    """A daemon, an honest client, and a connection that has shaken hands: `(daemon, honest, socket,
    command)`, the last making the bytes of a command."""
    if security == "null":
        with Daemon(workers=0) as d, connect(d) as s:
            yield d, d.client(), s, lambda body: curve_peer.frame(body, 4)
        return
    lab = Lab(tmp_path, {"ann": "ann submit", "eve": "eve submit"}, workers=0)
    with lab.daemon as d, reach(d) as s:
        one = curve_peer.Session(s, lab.server[0], *lab.pairs["eve"])
        yield d, lab.client("ann"), s, lambda body: one.message(body, 2)


COMMANDS = [b"\x04PING\xff\xffand what is echoed", b"\x04PONG", b"\x09SUBSCRIBEall",
            b"\x06CANCELall", b"\x05ERROR\x03400", b"\x04JOINall", b"\x07UNKNOWN", b"", b"\xffx"]


@pytest.mark.skipif(sanitized.SANITIZED, reason="AddressSanitizer locks no memory")
@pytest.mark.skipif(resource.getrlimit(resource.RLIMIT_MEMLOCK)[0] < 1 << 16,
                    reason="no memory may be locked here")
@pytest.mark.skipif(not zmq.has("curve"), reason="this pyzmq has no CURVE")
def test_the_secrets_of_all_handshakes_lie_in_memory_that_was_locked_for_the_first(tmp_path):
    """Locked and set free for each, which took a third of a handshake, none is while none is under
    way."""
    lab = Lab(tmp_path, {"ann": "ann submit"}, workers=0)
    with lab.daemon as d:
        locked = []
        for _ in range(4):
            assert lab.client("ann").ask("WHOAMI").ok
            locked.append(memory_mb(d, "VmLck"))
        assert locked[0] > 0 and locked == locked[:1] * 4


@pytest.mark.parametrize("body", COMMANDS, ids=lambda body: body[1:6].hex())
@pytest.mark.parametrize("security", ["null", "curve"])
def test_a_flood_of_commands_ends_its_connection_and_nobody_elses(tmp_path, security, body):
    """Each is libzmq's own work, in the one thread that reads for all: no full pipe stops them.
    Under CURVE subscriptions are requests of a wrong shape, as which they wait in the pipe."""
    if security == "curve" and body[1:2] in b"SC":
        pytest.skip("no command of libzmq's")
    with peer_by_hand(tmp_path, security) as (d, honest, s, command):
        ended = metric(honest, "connections_ended_total")
        sent = 0
        with pytest.raises(OSError):
            while sent < 200000:
                s.sendall(b"".join(command(body) for _ in range(500)))
                sent += 500
        assert sent < 200000
        until(lambda: metric(honest, "connections_ended_total") == ended + 1,
              "what was ended is not counted")
        assert d.process.poll() is None


@pytest.mark.parametrize("security", ["null", "curve"])
def test_who_sends_heartbeats_after_a_long_silence_and_between_many_requests_is_heard(
        tmp_path, security):
    """200 that a stopped network held back, each answered; then one beside every request."""
    with peer_by_hand(tmp_path, security) as (d, honest, s, command):
        s.sendall(b"".join(command(b"\x04PING\0\x0a%04d" % i) for i in range(200)))
        count, seen = 0, b""
        while count < 200:
            assert (more := s.recv(4096)), f"closed after {count}"
            seen += more
            count = (seen.count(b"\x04PONG") if security == "null"
                     else seen.count(b"\x07MESSAGE"))
        assert metric(honest, "connections_ended_total") == 0


@pytest.mark.parametrize("size, count", [(1 << 20, 300), (250, 500000), (0, 4000000)])
def test_a_message_without_an_end_ends_its_connection(size, count):
    """libzmq keeps frames until the last: 300 of 1 MiB were 300 MiB of memory.  A message may hold
    8 of them."""
    with Daemon(workers=0) as d:
        honest = d.client()
        assert honest.ask("HELLO").ok
        before, s = memory_mb(d, "VmHWM"), connect(d)
        pieces = max(1, (1 << 20) // (size + 2))
        piece = frame(bytes(size), True) * pieces
        with pytest.raises(OSError):
            for _ in range(count // pieces):
                s.sendall(piece)
        grown = memory_mb(d, "VmHWM") - before
        print(f"\nP6: a message of {count} frames of {size} bytes: RSS grew by {grown:.1f} MB")
        assert grown < 40 and honest.ask("HELLO").ok


def test_messages_begun_by_many_connections_take_bounded_memory_together():
    """80 of 6 MiB, none too long by itself, were 480 MiB; all together may have 256."""
    with Daemon(workers=0) as d:
        honest, group = d.client(), [connect(d) for _ in range(80)]
        assert honest.ask("HELLO").ok
        before = memory_mb(d, "VmHWM")
        for s in group:
            with contextlib.suppress(OSError):
                s.sendall(frame(bytes(1 << 20), True) * 6)
        assert honest.ask("HELLO").ok
        assert memory_mb(d, "VmHWM") - before < 300
        assert metric(honest, "connections_ended_total") >= 80 - 256 / 6 - 1
        for s in group:
            s.close()
        until_alone(honest)                      # what they held is free for others
        with connect(d) as s:
            s.sendall(message(b"MODALD1", b"HELLO", b'{"id":1}', *[bytes(1 << 20)] * 5))
            read_until(s, b"bad_input")


def sealed_mib(client):
    """An input of 1 MiB, and the request for all of it."""
    data = bytes(1 << 20)
    begun = client.ask("UPLOAD", op="begin", content="batch", samples=len(data) // 8, channels=1,
                       dt=0.1)
    for at in range(0, len(data), 1 << 18):
        assert client.ask("UPLOAD", [data[at:at + (1 << 18)]], op="chunk", offset=at,
                          upload=begun["upload"], crc32c=crc32c(data[:1 << 18])).ok
    assert client.ask("UPLOAD", op="seal", upload=begun["upload"],
                      sha256=identity(len(data) // 8, 1, 0.1, data)).ok
    return begun["upload"], message(b"MODALD1", b"RESULT", json.dumps({
        "id": 1, "upload": begun["upload"], "part": "input"}).encode())


@pytest.mark.parametrize("connections, each", [(40, 100), (400, 60), (700, 1)])
def test_answers_that_nobody_reads_take_bounded_memory_in_whatever_order_they_come(connections,
                                                                                  each):
    """Bodies of 1 MiB, asked for by one connection after the other: of all together 256 MiB wait,
    and as each that came had a share of its time 400 had 856, 700 of one body each 726.  Whoever
    reads is answered meanwhile."""
    with Daemon(workers=0) as d:
        honest = d.client()
        upload, asked = sealed_mib(honest)
        before, group = memory_mb(d, "VmHWM"), []
        for i in range(connections):
            group.append(connect(d))
            group[-1].setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            group[-1].sendall(asked * each)
            if i % 50 == 49:
                assert honest.ask("RESULT", upload=upload, part="input").ok
        assert honest.ask("RESULT", upload=upload, part="input").ok
        grown = memory_mb(d, "VmHWM") - before
        print(f"\nP6: {connections} x {each} bodies of 1 MiB that nobody reads: RSS grew by "
              f"{grown:.1f} MB")
        # as much again for what is read from the disk and not queued yet, or ended and not freed
        assert grown < 2 * 256
        for s in group:
            s.close()


@pytest.mark.skipif(not zmq.has("curve"), reason="this pyzmq has no CURVE")
def test_a_message_without_an_end_is_bounded_under_curve_too(tmp_path):
    """Which frame is the last is hidden there: what the pipe may hold of whole messages is the
    bound, 16 of 5 MiB and one that comes."""
    with serving(tmp_path, "curve", ann="ann submit", bob="bob read") as (d, made):
        honest = made("ann")
        assert honest.ask("HELLO").ok
        bomb, before, part = made("bob"), memory_mb(d, "VmHWM"), bytes(900000)
        assert bomb.ask("HELLO").ok
        bomb.raw(VERSION, b"HELLO", b'{"id":1}', *[part] * 400)
        # it is ended, and comes again at once; libzmq sends none of the rest
        until(lambda: metric(honest, "connections_ended_total") > 0, "its connection is not ended")
        assert memory_mb(d, "VmHWM") - before < 150 and honest.ask("HELLO").ok


@pytest.mark.parametrize("security", ["null", "curve"])
def test_messages_of_the_greatest_size_are_answered_however_many_are_pipelined(tmp_path, security):
    """Section 2 of PROTOCOL.md: five body frames of 1 MiB; HELLO has no use for them, and says
    so."""
    with serving(tmp_path, security, ann="ann submit") as (d, made):
        client, part = made("ann"), bytes(1 << 20)
        sent = [client.send("HELLO", [part] * 5) for _ in range(30)]
        assert [client.answer(number).code for number in sent] == ["bad_input"] * 30
        assert metric(client, "connections") == 1


@pytest.mark.parametrize("greeting", [b"\xff" + bytes(8) + b"\x7f\x01\x05\0\0", b"\x01\0" + HELLO])
def test_protocols_before_zmtp_3_are_closed(greeting):
    with Daemon(workers=0) as d:
        s, seen = reach(d), b""
        s.sendall(greeting)
        with contextlib.suppress(ConnectionResetError):
            while (more := s.recv(4096)) != b"":
                seen += more
        assert b"MODALD1" not in seen and d.client().ask("HELLO").ok
