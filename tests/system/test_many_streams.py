"""Many streams of one host (tests/fault/many_streams.c): one connection and one sending thread
serve them all, none waits for another, and a slow one takes little.
"""
import json
import os
import pathlib
import re
import subprocess
import threading
import time

import numpy as np
import pytest

import modald
import sanitized
from conftest import BUILD, PATIENCE, environment
from stream_peer import Peer
from wire import Daemon, identity

HOST = BUILD / "fault" / "many_streams"
STREAMS, CHANNELS, RATE = 40, 8, 100

# Python cannot load a library that needs the sanitizers' runtime first.
in_python = pytest.mark.skipif(sanitized.SANITIZED,
                                reason="a sanitized library does not load into Python")


def begin(*words, **env):
    return subprocess.Popen([str(HOST), *map(str, words)], stdout=subprocess.PIPE, text=True,
                            env=environment(**env))


def end(host):
    out, _ = host.communicate(timeout=PATIENCE)
    assert host.returncode == 0
    return [json.loads(line) for line in out.splitlines()]


def until(true):
    last = time.monotonic() + PATIENCE
    while not true():
        assert time.monotonic() < last
        time.sleep(0.002)


def is_sealed(daemon, data, channels, dt):
    """Is there a batch of exactly these samples?  By its SHA-256, which a job may name."""
    c = daemon.client()
    try:
        sha256 = identity(len(data) // (8 * channels), channels, dt, data)
        return c.ask("SUBMIT", kind="identify", input={"sha256": sha256}).ok
    finally:
        c.close()


def sealed(daemon):
    """How many records of all their samples the daemon has of the streams of a host that ended."""
    listed = json.loads(daemon.client().ask("STREAMS", limit=1000).body[0])["streams"]
    return [one["samples"] for one in listed if one["state"] == "sealed"]


def test_forty_streams_cost_their_host_three_threads_and_less_than_2_mb_each(tmp_path):
    """Two of the threads are libzmq's.  Once 40 had 120 and 9 MB each."""
    with Daemon(workers=1) as daemon:
        *_, last, closed = end(begin(STREAMS, CHANNELS, RATE, 3, MODALD_URL=daemon.endpoint,
                                     MODALD_SPILL=tmp_path, MODALD_CLOSE_WAIT="600"))
        assert sealed(daemon) == [3 * RATE] * STREAMS
    assert last["streams"] == STREAMS and last["dropped"] == 0
    assert 0 < last["threads"] <= 3 and closed["threads"] == 0
    if not sanitized.SANITIZED:
        assert last["rss_kb"] < 2048 * STREAMS


@pytest.mark.parametrize("streams, rate, seconds, most_kb", [(10, 160, 20, 1600),
                                                             (2, 3000, 8, 4096)])
def test_a_ring_gives_back_what_was_read(tmp_path, streams, rate, seconds, most_kb):
    """64 channels: at 160 Hz 85 kB/s a stream, so that in 20 s 1.7 MB go through its ring, which
    would all be there still; at 3 kHz 12 MB in 8 s, in a ring of 8 MB.  Looked at once the daemon
    has all of it: how far it is behind is the machine's to say."""
    if sanitized.SANITIZED:
        pytest.skip("sanitizers keep memory of their own")
    with Daemon(workers=1) as daemon:
        lines = end(begin(streams, 64, rate, seconds, "", 0, "read", MODALD_URL=daemon.endpoint,
                          MODALD_SPILL=tmp_path, MODALD_CLOSE_WAIT="60"))
    assert lines[-2]["dropped"] == 0 and lines[-2]["rss_kb"] < most_kb * streams


def waked(pid):
    """How often its threads slept and went on, but for the first, which simulates."""
    found = re.compile(r"^voluntary_ctxt_switches:\s*(\d+)", re.M)
    return sum(int(found.search((task / "status").read_text())[1])
               for task in pathlib.Path(f"/proc/{pid}/task").iterdir() if int(task.name) != pid)


def test_frames_of_forty_slow_streams_leave_together(tmp_path):
    """Twenty beats a second, and 200 looks at the rings.  Once each stream waked both threads by
    itself: 1,200 times a second."""
    with Daemon(workers=1) as daemon:
        host = begin(STREAMS, CHANNELS, RATE, 5, MODALD_URL=daemon.endpoint, MODALD_SPILL=tmp_path,
                     MODALD_CLOSE_WAIT="600")
        told, times = [], []
        for _ in range(4):
            told.append(json.loads(host.stdout.readline()))
            times.append(waked(host.pid))
        end(host)
        assert sealed(daemon) == [5 * RATE] * STREAMS
    assert times[-1] - times[0] < 600 * (told[-1]["s"] - told[0]["s"])


def counted(client, *names):
    """Counters of METRICS."""
    lines = client.ask("METRICS").body[0].decode().splitlines()
    return [float(line.split()[1]) for name in names for line in lines
            if line.split()[0] in (f"modald_{name}_total", f"modald_{name}")]


def test_frames_of_forty_slow_streams_are_one_message_and_one_answer(tmp_path):
    """Each is a transaction of its own; once each was asked and answered by itself, too."""
    with Daemon(workers=1) as daemon:
        client = daemon.client()
        host = begin(STREAMS, CHANNELS, RATE, 5, MODALD_URL=daemon.endpoint, MODALD_SPILL=tmp_path,
                     MODALD_CLOSE_WAIT="60")
        seen = []
        for _ in range(4):
            json.loads(host.stdout.readline())
            seen.append(counted(client, "transactions", "replies"))
        end(host)
    stored, answered = (last - first for first, last in zip(seen[0], seen[-1]))
    assert stored >= STREAMS and answered < stored / 4


def test_samples_of_a_slow_stream_travel_more_than_one_to_a_frame(tmp_path):
    """200 samples at 30 Hz: two in 50 ms.  Once each was a frame, and an entry in the ledger."""
    class Counting(Peer):
        pushes = 0

        def push(self, *args):
            self.pushes += 1
            super().push(*args)
    peer = Counting(f"ipc://{tmp_path}/s").start()
    try:
        (tmp_path / "logs").mkdir()
        end(begin(1, 2, 30, 200 / 30, tmp_path / "logs", MODALD_URL=peer.endpoint,
                  MODALD_CLOSE_WAIT="60"))
        log = np.fromfile(tmp_path / "logs" / "many-0").reshape(-1, 2)
        assert np.array_equal(peer.record("many-0"), log)
        assert len(peer.record("many-0")) == 200 and 0 < peer.pushes < 200 / 1.5
    finally:
        peer.stop()


def test_a_host_asks_no_more_at_once_than_a_daemon_keeps_answers_for(tmp_path):
    """PROTOCOL section 8: 1024 for a connection, beyond which requests are dropped.  700 streams
    have 1,400 questions to a daemon that does not answer, and 512 are asked."""
    class Mute(Peer):
        asked = 0

        def answer(self, *_):
            self.asked += 1
    peer = Mute(f"ipc://{tmp_path}/s").start()
    try:
        host = begin(700, 2, 10, 4, MODALD_URL=peer.endpoint, MODALD_SPILL=tmp_path,
                     MODALD_CLOSE_WAIT="0")
        assert json.loads(host.stdout.readline())["threads"] == 3
        until(lambda: peer.asked >= 500)
        told = json.loads(host.stdout.readline())        # and a second later no more were asked
        assert peer.asked <= 512 and told["acknowledged"] == 0
        end(host)
    finally:
        peer.stop()


def check_records(folder, streams, seconds, kills, workers, **env):
    """The records of STREAMS are their logs though the daemon is killed KILLS times.  The last line
    before they are closed."""
    logs = folder / "logs"
    logs.mkdir()
    with Daemon(workers=workers) as daemon:
        host = begin(streams, CHANNELS, RATE, seconds, logs, MODALD_URL=daemon.endpoint,
                     MODALD_SPILL=folder, MODALD_CLOSE_WAIT="600", **env)
        lines = []
        reader = threading.Thread(target=lambda: lines.extend(map(json.loads, host.stdout)))
        reader.start()
        killed = 0
        for _ in range(kills):
            time.sleep(seconds / (kills + 2))
            # a slow machine's daemon may still have started when the host's time was over
            if host.poll() is None:
                daemon.kill()
                daemon.start()
                killed += 1
        assert killed > 0
        reader.join(seconds + PATIENCE)
        assert host.wait(PATIENCE) == 0
        last = lines[-2]
        assert last["dropped"] == last["spilled"] == last["refused"] == 0
        assert last["pushed"] > streams * 0.8 * seconds * RATE
        sealed = [is_sealed(daemon, (logs / f"many-{k}").read_bytes(), CHANNELS, 1 / RATE)
                  for k in range(streams)]
        assert sealed == [True] * streams
    assert not list(folder.glob("*.spill"))
    return last


def test_forty_records_are_their_logs_though_the_daemon_is_killed_twice(tmp_path):
    check_records(tmp_path, STREAMS, 6, 2, 1)


@pytest.mark.skipif(os.environ.get("MODALD_LONG") != "1", reason="ten minutes: --long")
def test_four_hundred_records_are_their_logs_though_the_daemon_is_killed_five_times(tmp_path):
    """Ten minutes, with windows of 5 s every 20 s: some 7 ms of a worker each."""
    last = check_records(tmp_path, 400, 600, 5, 2, MODALD_WINDOW=5 * RATE, MODALD_HOP=20 * RATE,
                         MODALD_OPTIONS='{"rank.fixed":4}')
    assert last["live"] == 400 and 0 < last["threads"] <= 3
    if not sanitized.SANITIZED:
        assert last["rss_kb"] < 2048 * 400


@in_python
def test_a_host_that_pushes_most_of_a_ring_at_once_spills_nothing_where_the_daemon_is_quick(
        tmp_path, monkeypatch):
    """As one that had no processor for a second does: 90,000 slots of 80 bytes, of 8 MiB.  They
    went to the spill file once half the ring was full, before any was sent.
    """
    monkeypatch.setenv("MODALD_SPILL", str(tmp_path))
    monkeypatch.setenv("MODALD_CLOSE_WAIT", "60")
    peer = Peer(f"ipc://{tmp_path}/s").start()
    monkeypatch.setenv("MODALD_URL", peer.endpoint)
    rows = np.random.default_rng(6).standard_normal((90000, 8))
    s = modald.stream("burst", 8, 0.01)
    for part in (rows[:1], rows[1:]):              # the daemon is there when the burst comes
        s.push(part)
        until(lambda: s.report.waiting == 0)
    report = s.report
    s.close()
    peer.stop()
    assert (report.spilled, report.dropped, report.acknowledged) == (0, 0, 90000)
    assert np.array_equal(peer.record("burst"), rows)


@in_python
def test_a_stream_that_is_refused_or_never_answered_holds_up_no_other(tmp_path, monkeypatch):
    """Three of one process: of a daemon that never answers, refused, and one that goes on."""
    monkeypatch.setenv("MODALD_SPILL", str(tmp_path))
    monkeypatch.setenv("MODALD_CLOSE_WAIT", "0.2")
    peer = Peer(f"ipc://{tmp_path}/silent").start()
    peer.silent = True
    rows = np.random.default_rng(3).standard_normal((5000, 2))

    def threads():
        return len(list(pathlib.Path("/proc/self/task").iterdir()))
    with Daemon(workers=1) as daemon:
        c = daemon.client()
        assert c.ask("STREAM", op="open", name="refused", channels=3, dt=0.01).ok
        before = threads()
        monkeypatch.setenv("MODALD_URL", peer.endpoint)
        waits = modald.stream("waits", 2, 0.01)
        monkeypatch.setenv("MODALD_URL", daemon.endpoint)
        refused, goes = modald.stream("refused", 2, 0.01), modald.stream("goes", 2, 0.01)
        for s in (waits, refused, goes):
            s.push(rows)
        until(lambda: refused.report.refused == 1 and goes.report.acknowledged == 5000)
        assert waits.report.acknowledged == 0 and goes.report.refused == 0
        assert threads() - before <= 6                   # three a connection
        waits.close()
        refused.close()
        goes.push(rows)
        until(lambda: goes.report.acknowledged == 10000)
        monkeypatch.setenv("MODALD_CLOSE_WAIT", "60")
        goes.close()
        c.close()
        until(lambda: threads() <= before)          # one that ended is counted for a moment
        assert len(list(tmp_path.glob("modald-waits-*.spill"))) == 1
    peer.stop()


def seconds_of(close):
    begin = time.monotonic()
    close()
    return time.monotonic() - begin


@in_python
@pytest.mark.parametrize("there", [False, True])
def test_closing_many_streams_of_a_dead_daemon_takes_one_patience(tmp_path, monkeypatch, there):
    """Not one each, 40 here: its socket is gone, or takes all and nobody answers.  Each stream has
    its samples in a spill file then; one that is closed once it answers again is sealed.
    """
    monkeypatch.setenv("MODALD_SPILL", str(tmp_path))
    monkeypatch.setenv("MODALD_CLOSE_WAIT", "1.5")
    peer = Peer(f"ipc://{tmp_path}/s")
    monkeypatch.setenv("MODALD_URL", peer.endpoint)
    peer.silent = True
    if there:
        peer.start()
    rows = np.random.default_rng(5).standard_normal((50, 2))
    streams = [modald.stream(f"many-{k}", 2, 0.01) for k in range(41)]
    for s in streams:
        s.push(rows)
    kept = streams.pop()
    first, *others = [seconds_of(s.close) for s in streams]
    assert sum(others) < len(others) * first / 2
    assert len(list(tmp_path.glob("modald-many-*.spill"))) == 40
    peer.silent = False
    monkeypatch.setenv("MODALD_CLOSE_WAIT", "60")
    if not there:
        peer.start()
    peer.wait(lambda: "many-40" in peer.streams and len(peer.streams["many-40"][-1].rows) == 50)
    kept.close()
    peer.stop()
    assert peer.closes == [("many-40", False)]


@in_python
def test_streams_that_are_closed_at_once_share_their_groups_of_commits(tmp_path, monkeypatch):
    """A close is two groups, one of its last samples and one of its batch; one after the other each
    stream has its own."""
    monkeypatch.setenv("MODALD_SPILL", str(tmp_path))
    monkeypatch.setenv("MODALD_CLOSE_WAIT", "60")
    rows = np.random.default_rng(7).standard_normal((50, 2))
    with Daemon(workers=1) as daemon:
        monkeypatch.setenv("MODALD_URL", daemon.endpoint)
        client = daemon.client()
        streams = [modald.stream(f"many-{k}", 2, 0.01) for k in range(STREAMS)]
        for s in streams:
            s.push(rows)
        until(lambda: all(s.report.acknowledged == 50 for s in streams))
        before = counted(client, "commit_seconds_count")
        modald.close_all([*streams, streams[0], modald.stream("empty", 2, 0.01)])
        took = counted(client, "commit_seconds_count")[0] - before[0]
        assert took < STREAMS / 2
        assert all(is_sealed(daemon, rows.tobytes(), 2, 0.01) for _ in streams)
        kept = json.loads(client.ask("STREAMS").body[0])["streams"]
        assert [s["state"] for s in kept] == ["sealed"] * STREAMS
        modald.close_all(streams)
        client.close()


@in_python
def test_a_stream_hears_no_answers_to_one_that_was_closed_before(tmp_path, monkeypatch):
    """The slot of a closed stream is another's then, on the same connection."""
    monkeypatch.setenv("MODALD_CLOSE_WAIT", "60")
    peer = Peer(f"ipc://{tmp_path}/s").start()
    monkeypatch.setenv("MODALD_URL", peer.endpoint)
    rows = np.random.default_rng(4).standard_normal((300, 2))
    kept = modald.stream("kept", 2, 0.01)
    for k in range(20):
        with modald.stream(f"short-{k}", 2, 0.01) as s:
            s.push(rows[k:])
        kept.push(rows[10 * k:10 * k + 10])
    kept.close()
    peer.stop()
    assert np.array_equal(peer.record("kept"), rows[:200])
    assert all(np.array_equal(peer.record(f"short-{k}"), rows[k:]) for k in range(20))
    assert sorted(peer.closes) == sorted((name, False)
                                         for name in ("kept", *(f"short-{k}" for k in range(20))))
