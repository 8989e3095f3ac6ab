"""F16: the network between a client and the daemon breaks: two network namespaces, one pair of
interfaces, ZMTP between.

The daemon's namespace lives as long as a process in it, so that no end of a test leaves one behind.
"""
import contextlib
import os
import pathlib
import signal
import subprocess
import sys
import threading
import time

import pytest
import zmq

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "system"))
from lab import Lab  # noqa: E402
from test_durability import check_everything, ended, patiently  # noqa: E402
from wire import PATIENCE_S, ring_down, until  # noqa: E402

pytestmark = pytest.mark.skipif(not zmq.has("curve"), reason="this pyzmq has no CURVE")
HEARTBEAT_S, PORT = 10, 47391          # PROTOCOL.md, section 10


class Wire:
    """A namespace at the other end of a pair of interfaces, 10.x.y.2 there and 10.x.y.1 here."""

    def __init__(self):
        number = os.getpid() % 65536
        self.here, self.there, self.net = (f"mda{number}", f"mdb{number}",
                                           f"10.{number >> 8}.{number & 255}")
        self.holder = subprocess.Popen(["unshare", "-n", "sh", "-c", "echo there; cat"],
                                       stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                       stderr=subprocess.DEVNULL, text=True)
        self.inside = ["nsenter", "-t", str(self.holder.pid), "-n"]
        try:
            if self.holder.stdout.readline() != "there\n":
                raise OSError("unshare -n")
            self.ip("link", "add", self.here, "type", "veth", "peer", "name", self.there, "netns",
                    str(self.holder.pid))
            self.ip("addr", "add", f"{self.net}.1/24", "dev", self.here)
            self.ip("addr", "add", f"{self.net}.2/24", "dev", self.there, wrap=self.inside)
            self.ip("link", "set", self.there, "up", wrap=self.inside)
            self.ip("link", "set", "lo", "up", wrap=self.inside)
            self.up()
        except (OSError, subprocess.CalledProcessError) as why:
            self.close()
            pytest.skip(f"network namespaces need root and iproute2: {why}")

    @staticmethod
    def ip(*words, wrap=()):
        subprocess.run([*wrap, "ip", *words], check=True, capture_output=True)

    def up(self):
        self.ip("link", "set", self.here, "up")

    def down(self):
        self.ip("link", "set", self.here, "down")

    def close(self):
        subprocess.run(["ip", "link", "del", self.here], capture_output=True, check=False)
        self.holder.kill()
        self.holder.wait()
        self.holder.stdin.close()
        self.holder.stdout.close()


@pytest.fixture
def wire():
    made = Wire()
    yield made
    made.close()


@pytest.fixture
def lab(wire, tmp_path):
    made = Lab(tmp_path, {"ann": "ann submit", "eva": "eva admin"},
               endpoint=f"tcp://{wire.net}.2:{PORT}", wrap=wire.inside, workers=2)
    yield made
    made.daemon.__exit__()


def connections(lab):
    """The established ones that the daemon's side knows, by /proc/net/tcp of its namespace: state
    01."""
    rows = [line.split() for line
            in pathlib.Path(f"/proc/{lab.daemon.pid}/net/tcp").read_text().splitlines()[1:]]
    return sum(row[3] == "01" and int(row[1].split(":")[1], 16) == PORT for row in rows)


def test_a_partition_loses_and_doubles_no_submission(wire, lab):
    """The interface goes down and comes up five times under a client that repeats whatever was not
    answered."""
    acks, errors = {}, []

    def submitter():
        client = lab.client("ann", timeout_s=0.5)
        try:
            for i in range(400):
                data, described = ring_down(samples=16, phase=i * 1e-3)
                acks[f"k{i}"] = patiently(client, "SUBMIT", [data], kind="identify",
                                          input=described, key=f"k{i}")["job"]
        except BaseException as error:
            errors.append(error)
        finally:
            client.close()

    thread = threading.Thread(target=submitter, daemon=True)
    thread.start()
    cuts = 0
    while cuts < 5 and thread.is_alive():
        time.sleep(0.1)
        wire.down()
        time.sleep(0.8)
        wire.up()
        cuts += 1
    thread.join(PATIENCE_S)
    assert not errors and len(acks) == 400, errors
    check_everything(lab.client("ann"), acks)
    print(f"\nP2 P4: {cuts} partitions, {len(acks)} acknowledged jobs, 0 violations")


def test_half_open_connections_are_ended_by_heartbeats(wire, lab):
    """Twenty clients vanish without a word: their side is cut off first, so that no FIN ever
    arrives."""
    before = connections(lab)
    clients = [lab.client("ann") for _ in range(20)]
    assert all(client.ask("HELLO").ok for client in clients)
    assert connections(lab) == before + 20
    wire.down()
    for client in clients:
        client.close()
    begin = time.monotonic()
    # TCP by itself would keep them for a quarter of an hour
    until(lambda: connections(lab) <= before, "half-open connections live on")
    waited = time.monotonic() - begin
    wire.up()
    assert lab.client("ann").ask("HELLO").ok
    print(f"\nP6: 20 half-open connections gone after {waited:.1f} s; {3 * HEARTBEAT_S} are "
          "promised")


def test_a_job_runs_on_while_its_client_is_cut_off_and_the_answer_is_there_afterwards(wire, lab):
    client = lab.client("ann", timeout_s=1)
    data, described = ring_down()
    asked = patiently(client, "SUBMIT", [data], kind="identify", input=described, key="long",
                      options={"sleep": 2})
    wire.down()
    with contextlib.suppress(zmq.Again):
        client.ask("WAIT", job=asked["job"], timeout_s=1)
    time.sleep(2)
    wire.up()
    done = ended(client, asked["job"])
    assert done["state"] == "done" and done["attempts"] == 1


def test_a_daemon_that_stands_still_is_a_silence_and_no_loss(lab):
    """SIGSTOP for longer than the client's patience: the same key asked again is the same job, once
    it goes on."""
    client = lab.client("ann", timeout_s=0.5)
    data, described = ring_down()
    first = client.send("SUBMIT", [data], kind="identify", input=described, key="still")
    os.kill(lab.daemon.pid, signal.SIGSTOP)
    try:
        with pytest.raises(zmq.Again):
            client.answer(first)
            client.ask("HELLO")
    finally:
        os.kill(lab.daemon.pid, signal.SIGCONT)
    job = patiently(client, "SUBMIT", [data], kind="identify", input=described, key="still")
    assert job["duplicate"] is True
    assert ended(client, job["job"])["state"] == "done"
