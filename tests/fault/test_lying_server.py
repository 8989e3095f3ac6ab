"""No server ends a simulation, and none takes its memory: neither one that lies (lying_server.py)
nor an honest one that is killed while it speaks.

The host (hosts.c) runs for longer than any heartbeat of the library's, and its output and exit
status are those of a run without a stream. MODALD_HOST_KILLS: how often the honest server is killed
(12; 200 with MODALD_LONG=1).
"""
import contextlib
import os
import pathlib
import subprocess
import sys
import tempfile
import time

import pytest

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "system"))
import lying_server  # noqa: E402
import sanitized  # noqa: E402
from conftest import BUILD, PATIENCE, environment  # noqa: E402
from wire import until  # noqa: E402

HOSTS = pathlib.Path(os.environ.get("MODALD_HOSTS", BUILD / "fault" / "hosts"))
KILLS = int(os.environ.get("MODALD_HOST_KILLS", "200" if os.environ.get("MODALD_LONG") == "1"
                           else "12"))
# 7 s or more: the hang-up that a heartbeat of 5 s finds
STEPS, PACE = 16000, 0.0004
TOGETHER = 8                                    # hosts


class Host:
    """One run; what it writes goes to files, so that nobody makes it wait."""

    def __init__(self, folder, steps=STEPS, pace=PACE, **env):
        self.out, self.err = tempfile.TemporaryFile(dir=folder), tempfile.TemporaryFile(dir=folder)
        self.process = subprocess.Popen([str(HOSTS), "plain", str(steps), str(pace)],
                                        stdout=self.out, stderr=self.err,
                                        env=environment(MODALD_SPILL=folder,
                                                        MODALD_CLOSE_WAIT="0.5", MODALD_WINDOW="64",
                                                        **env))
        self.most_mb = 0

    def runs(self):
        """Is it still there?  The most memory it had is kept."""
        with contextlib.suppress(OSError):
            with open(f"/proc/{self.process.pid}/status") as f:
                self.most_mb = max([self.most_mb, *(int(line.split()[1]) / 1024
                                                    for line in f if line.startswith("VmHWM"))])
        return self.process.poll() is None

    def end(self):
        """What it wrote, how it ended, and what was said."""
        try:
            self.process.wait(timeout=PATIENCE)
        finally:
            self.process.kill()
            self.process.wait()
        for file in (self.out, self.err):
            file.seek(0)
        err = self.err.read().decode(errors="replace")
        sanitized.hear(err)
        return self.out.read(), self.process.returncode, err


def plain_run(folder, steps):
    return Host(folder, steps, 0).end()[:2]


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    return plain_run(tmp_path_factory.mktemp("plain"), STEPS)


@pytest.fixture(scope="module")
def ends(tmp_path_factory):
    """Of each trick: how often it was played, and the host's end.  All at once, for each takes its
    time."""
    folder = tmp_path_factory.mktemp("tricks")
    servers = {trick: lying_server.Server(folder / str(i), trick) for i,
               trick in enumerate(lying_server.TRICKS)}
    begin, out = time.monotonic(), {}
    # on a slow machine a host may be over before its server had a turn: another then
    while left := [trick for trick, server in servers.items() if server.played == 0]:
        assert time.monotonic() < begin + PATIENCE, left
        hosts = {trick: Host(folder, MODALD_URL=servers[trick].url) for trick in left}
        out |= {trick: host.end() for trick, host in hosts.items()}
    for server in servers.values():
        server.stop()
    return {trick: (servers[trick].played, *out[trick]) for trick in servers}


@pytest.mark.parametrize("trick", lying_server.TRICKS, ids=lambda trick: trick.__name__)
def test_no_lie_of_a_server_is_seen_in_the_host(trick, ends, plain):
    played, out, status, err = ends[trick]
    assert played > 0
    assert (out, status) == plain, err
    assert all(line.startswith("modald: ") and line.isprintable() for line in err.splitlines()), err


@pytest.mark.parametrize("flood", lying_server.FLOODS, ids=lambda flood: flood.__name__)
def test_a_server_that_speaks_without_end_costs_the_host_bounded_memory(flood, plain, tmp_path):
    """4 MiB is what is taken of a link before it is hung up on; libzmq may read a few times as fast
    as we do.  Without a bound: 2.3 GB."""
    server, most_mb, end = lying_server.Server(tmp_path / "flood", flood), 0, time.monotonic()
    # on a slow machine a host may be over before it was told that much
    while server.played <= 20:
        assert time.monotonic() < end + PATIENCE, server.played
        host = Host(tmp_path, MODALD_URL=server.url)
        while host.runs():
            time.sleep(0.01)
        out, status, err = host.end()
        assert (out, status) == plain, err
        most_mb = max(most_mb, host.most_mb)
    server.stop()
    print(f"{flood.__name__}: {server.played} blocks, the host had {most_mb:.0f} MB at most")
    assert most_mb < (2000 if sanitized.SANITIZED else 400)


PYTHON = """
import os, sys, modald
while not os.path.exists(sys.argv[3]):
    try:
        with modald.connect(sys.argv[1], timeout=float(sys.argv[2])) as c:
            for event in c.events(0, timeout=float(sys.argv[2])):
                pass
    except modald.Error:
        pass
print("lived")
"""


def ask_by_python(url, seconds, folder, over):
    return ["/usr/bin/python3", "-c", PYTHON, url, str(seconds), str(over)], 0, "lived\n"


def ask_by_modalctl(url, seconds, folder, over):
    """It goes on watching whatever is said, and ends by itself: by its own time, or by an answer
    that is none."""
    return ["sh", "-c", f'until [ -e {over} ]; do timeout -s KILL {PATIENCE} "$0" --server "$1" '
            f'--timeout {seconds} watch >{folder}/said 2>&1; rc=$?; [ $rc -le 5 ] || exit $rc; '
            'sleep 0.05; done; echo lived', str(BUILD / "bin" / "modalctl"), url], 0, "lived\n"


QUESTIONS = [t for t in lying_server.TRICKS if t is not lying_server.all_is_busy]


@pytest.fixture(scope="module", params=[ask_by_python, ask_by_modalctl], ids=["python", "modalctl"])
def clients(request, tmp_path_factory):
    """The same tricks for who asks, in place of who pushes: of each, how often it was played and
    how the client ended.  They ask until each was played, and for longer than a heartbeat of the
    library's."""
    folder = tmp_path_factory.mktemp("asked")
    over, begin = folder / "over", time.monotonic()
    servers = {trick: lying_server.Server(folder / str(i), trick, streams=False) for i,
               trick in enumerate(QUESTIONS)}
    runs = {}
    for i, (trick, server) in enumerate(servers.items()):
        own = folder / f"client-{i}"
        own.mkdir()
        words, status, out = request.param(server.url, 7, own, over)
        runs[trick] = (subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                        text=True,
                                        env=environment(PYTHONPATH=HERE.parents[1] / "clients"
                                                        / "python")), status, out)
    until(lambda: all(server.played > 0 or run.poll() is not None for server, (run, *_)
                      in zip(servers.values(), runs.values())) and time.monotonic() > begin + 7,
          "a trick was not played")
    over.touch()
    ends = {}
    for trick, (run, status, out) in runs.items():
        said, err = run.communicate(timeout=PATIENCE)
        ends[trick] = (servers[trick].played, (run.returncode, said) == (status, out),
                       run.returncode, said[-300:], err[-600:])
        servers[trick].stop()
    return ends


@pytest.mark.parametrize("trick", QUESTIONS, ids=lambda trick: trick.__name__)
def test_no_lie_of_a_server_ends_who_asks_it(trick, clients):
    played, good, *told = clients[trick]
    assert played > 0
    assert good, told


@pytest.mark.parametrize("cut", [b"\x04PING", b"\x04PING\0"])
@pytest.mark.parametrize("piece", [1, 3, 64])
def test_a_server_that_cuts_a_ping_short_is_told_nothing_of_modalctls_memory(cut, piece, tmp_path):
    """libzmq echoes 16 bytes behind it.  A whole PING is answered by what came with it."""
    came = []                                    # of each connection
    whole = lying_server.frame(b"\x04PONGecho", lying_server.COMMAND)

    def trick(c, played):
        c.shake_hands()
        own = bytearray()
        came.append(own)
        c.send(lying_server.frame(b"\x04PING\0\0echo", lying_server.COMMAND))
        while whole not in own:
            own.extend(c.take(1))
        text = lying_server.frame(cut, lying_server.COMMAND)
        played()
        for at in range(0, len(text), piece):
            c.send(text[at:at + piece])
            time.sleep(0.01)                     # each a read of its own
        while True:
            own.extend(c.take(1))

    server = lying_server.Server(tmp_path / "s", trick, streams=False)
    with subprocess.Popen([BUILD / "bin" / "modalctl", "--server", server.url, "stats"],
                          stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as asks:
        # it is answered, or hangs up and comes again
        until(lambda: server.played > 1 or any(own.count(b"PONG") > 1 for own in came), "no PING")
        asks.kill()
    server.stop()
    assert all(own.count(b"PONG") <= 1 for own in came)


HONEST = f"""
import json, sys, zmq
s = zmq.Context().socket(zmq.ROUTER)
s.setsockopt(zmq.SNDHWM, 64), s.setsockopt(zmq.ROUTER_MANDATORY, 1), s.bind(sys.argv[1])
hosts = set()

def send(peer, kind, header):
    try:
        s.send_multipart([peer, b"MODALD1", kind, header], zmq.NOBLOCK)
    except zmq.Again:
        pass
    except zmq.ZMQError:
        hosts.discard(peer)

while True:
    while s.poll(0):
        peer, _, _, header, *_ = s.recv_multipart()
        hosts.add(peer)
        asked = json.loads(header)
        send(peer, b"REPLY", json.dumps({{
            "id": asked["id"], "verb": "STREAM", "stream": "abcd1234", "name": "plain", "epoch": 0,
            "next": asked.get("first", 0) + asked.get("count", 0), "credit": 1000000}}).encode())
    for peer in list(hosts):
        send(peer, b"EVENT", {lying_server.EVENT!r})
"""


def test_hosts_outlive_an_honest_server_killed_in_the_midst_of_its_live_results(tmp_path):
    """Each kill cuts a flood of whole messages at some byte of some frame, for eight hosts at
    once."""
    # of a second and a half each
    url, kills, steps = f"ipc://{tmp_path}/honest", 0, 3000 * KILLS
    plain = plain_run(tmp_path, steps)
    hosts = [Host(tmp_path, steps, MODALD_URL=url) for _ in range(TOGETHER)]
    while all(host.runs() for host in hosts):
        server = subprocess.Popen([sys.executable, "-c", HONEST, url])
        time.sleep(0.5 + 0.02 * (kills % 7))
        server.kill()
        server.wait()
        kills += 1
    ends = [host.end() for host in hosts]
    print(f"{kills} kills, {TOGETHER} hosts")
    assert [end[:2] == plain for end in ends] == [True] * TOGETHER, [end[1:] for end in ends]
    assert kills > 0
