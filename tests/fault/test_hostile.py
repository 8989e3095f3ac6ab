"""P6: bad peers (hostile.py) leave honest clients served, and cost the daemon bounded memory; what
they cost in time tests/bench/bench_hostile.py says."""
import contextlib
import pathlib
import socket
import sys
import time

import pytest
import zmq

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "system"))
from hostile import attack, free_port  # noqa: E402
from lab import Lab  # noqa: E402
from wire import PATIENCE_S, Client, Daemon, submit, until, woken  # noqa: E402

FAKE = f"worker_path = {HERE.parent / 'system' / 'fake_worker.py'}\n"
ASKED, BOMBS = 300, 10


def memory_mb(daemon, what="VmHWM"):
    with open(f"/proc/{daemon.pid}/status") as f:
        return next(int(line.split()[1]) for line in f if line.startswith(what)) / 1024


def ask_much(client):
    for _ in range(ASKED):
        assert client.ask("STATUS", job="key:known").ok


@pytest.mark.parametrize("probe", ["oversize", "garbage", "taken", "deaf", "malformed", "hangups",
                                   "fleeting", "endless"])
def test_a_bad_peer_leaves_honest_clients_served(probe):
    with Daemon(config=FAKE, endpoint=f"tcp://127.0.0.1:{free_port()}") as d:
        client = Client(d.endpoint, identity=b"honest")
        assert submit(client, key="known").ok
        for _ in range(3):
            with attack(probe, d):
                ask_much(client)
                assert submit(Client(d.endpoint)).ok             # who comes new is served too
        assert (client.ask("WAIT", job="key:known", timeout_s=250)["state"] == "done"
                and client.ask("STATS")["draining"] is False)
        print(f"\nP6: {probe}: {3 * ASKED} questions answered, RSS at most {memory_mb(d):.0f} MB")
        assert memory_mb(d) < 200


@pytest.mark.skipif(not zmq.has("curve"), reason="this pyzmq has no CURVE")
def test_peers_without_keys_leave_those_with_keys_served(tmp_path):
    it = Lab(tmp_path, {"ann": "ann submit"}, endpoint=f"tcp://127.0.0.1:{free_port()}")
    with it.daemon:
        client = it.client("ann")
        assert submit(client, key="known").ok
        for _ in range(3):
            with attack("keyless", it.daemon):
                ask_much(client)
                assert it.client("ann").ask("HELLO").ok
        assert memory_mb(it.daemon) < 200


def seconds_of_cpu(daemon):
    fields = pathlib.Path(f"/proc/{daemon.pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / 100


def test_100_silent_connections_at_64_descriptors_stop_nobody_for_longer_than_the_handshake():
    """F9: who was connected goes on, jobs too; who comes new is served once the silent are dropped;
    accept does not spin, and afterwards all is as before."""
    with Daemon(config=FAKE, endpoint=f"tcp://127.0.0.1:{free_port()}",
                wrap=["prlimit", "--nofile=64"]) as d:
        client = d.client()
        assert submit(client, key="known").ok
        with attack("silent", d) as silent:
            begin, cpu_s = time.monotonic(), seconds_of_cpu(d)
            ask_much(client)
            assert client.ask("WAIT", job=submit(client, key="meanwhile", phase=0.1)["job"],
                              timeout_s=250)["state"] == "done"
            newcomer = Client(d.endpoint)
            assert newcomer.ask("HELLO").ok and silent.poll() is None
            waited, cpu_s = time.monotonic() - begin, seconds_of_cpu(d) - cpu_s
            until(lambda: metric(client, "connections") <= 2, "silent connections are kept")
        begin, before = time.monotonic(), woken(d.pid)
        ask_much(client)
        rounds = (woken(d.pid) - before - 20 * (time.monotonic() - begin)) / ASKED
        print(f"\nP6: silent: newcomer served after {waited:.1f} s, {cpu_s / waited:.2f} cores "
              f"meanwhile, then {rounds:.1f} rounds a question, RSS at most {memory_mb(d):.0f} MB")
        # a question and its answer pass four threads' sleeps
        assert cpu_s < 0.5 * waited + 0.5 and rounds < 8 and memory_mb(d) < 200


def metric(client, name):
    text = client.ask("METRICS").body[0].decode()
    return next(float(line.split()[1]) for line in text.splitlines()
                if line.startswith(f"modald_{name} "))


# ZMTP's greeting and READY, after which a connection is no longer silent (RFC 23)
SPOKEN = (b"\xff" + bytes(8) + b"\x7f\x03\x00NULL" + bytes(16 + 1 + 31)
          + b"\x04\x1c\x05READY\x0bSocket-Type\0\0\0\x06DEALER")


@pytest.mark.parametrize("scheme, given, most, wrap",
                         [("tcp", 8, 8, []), ("ipc", 8, 8, []),
                          ("ipc", 60000, 48, ["prlimit", "--nofile=96"])])
def test_connections_past_their_limit_are_closed_and_counted_and_those_there_go_on(scheme, given,
                                                                                   most, wrap):
    """Of 96 descriptors half are for connections, whatever the configuration says; its own are a
    third."""
    with Daemon(config=FAKE + f"connections = {given}\n", endpoint=f"tcp://127.0.0.1:{free_port()}"
                if scheme == "tcp" else None, wrap=wrap) as d:
        client = d.client()
        assert (submit(client, key="known").ok and metric(client, "connections") == 1
                and metric(client, "connections_refused_total") == 0)
        flood = []
        for _ in range(60):
            s = socket.socket(socket.AF_INET if scheme == "tcp" else socket.AF_UNIX)
            s.settimeout(120)
            s.connect(("127.0.0.1", int(d.endpoint.rsplit(":", 1)[1])) if scheme == "tcp"
                      else d.endpoint.removeprefix("ipc://"))
            with contextlib.suppress(BrokenPipeError, ConnectionResetError):    # closed as it came
                s.sendall(SPOKEN)
            flood.append(s)
        closed = 0
        for s in flood:                          # greeted (ZMTP's first byte), or closed as it came
            with contextlib.suppress(ConnectionResetError):
                if s.recv(1) == b"\xff":
                    continue
            closed += 1
        assert closed == 60 - (most - 1)
        assert client.ask("WAIT", job=submit(client, key="meanwhile", phase=0.1)["job"],
                          timeout_s=250)["state"] == "done"
        assert (metric(client, "connections") <= most
                and metric(client, "connections_refused_total") >= closed)
        for s in flood:
            s.close()
        assert d.client().ask("HELLO").ok
        until(lambda: metric(client, "connections") <= 2,
              "connections that ended are still counted")
        print(f"\nP6: {scheme}: 60 connections at connections = {given}: {closed} closed as they "
              "came")


def test_a_multipart_bomb_ends_its_own_connection_and_loses_nothing():
    """libzmq bounds no number of parts, the daemon their bytes: within an address space that the
    message would fill it lives on."""
    with Daemon(config=FAKE, endpoint=f"tcp://127.0.0.1:{free_port()}",
                wrap=["prlimit", "--as=400000000"]) as d:
        client, acks, deaths, peak, ended = d.client(timeout_s=3), {}, 0, 0.0, 0
        end = time.monotonic() + PATIENCE_S
        with attack("bomb", d):
            while ended < BOMBS or len(acks) < ASKED // 3:
                assert time.monotonic() < end, (ended, len(acks))
                with contextlib.suppress(zmq.Again):
                    key = f"k{len(acks)}"
                    acks[key] = submit(client, key=key, phase=len(acks) * 1e-3)["job"]
                    ended = metric(client, "connections_ended_total")
                if d.process.poll() is not None:
                    deaths += 1
                    d.log.close()
                    d.start()
                    client.close()
                    client = d.client(timeout_s=3)
                with contextlib.suppress(OSError, StopIteration):
                    peak = max(peak, memory_mb(d))
        if d.process.poll() is not None:
            d.start()
        client = d.client()
        lost = [key for key,
                job in acks.items() if client.ask("STATUS", job=f"key:{key}").get("job") != job]
        print(f"\nP6: bomb: {ended:.0f} of them, {len(acks)} jobs acknowledged under it, "
              f"RSS at most {peak:.0f} MB, {deaths} restarts, {len(lost)} lost")
        assert not lost and peak < 400 and deaths == 0
