"""The streaming client: three calls that never disturb their host, and lose nothing while there is
room."""
import contextlib
import json
import os
import pathlib
import re
import shutil
import signal
import socket
import subprocess
import time

import numpy as np
import pytest
import zmq
from conftest import BUILD, PATIENCE, environment, write_batch
from stream_peer import Peer

import modald
import wire

EXAMPLES = BUILD / "examples"
MARKED = 20000              # pushes of bench_stream --marked

# Python cannot load a library that needs the sanitizers' runtime first.
in_python = pytest.mark.skipif(b"__asan_init" in (BUILD / "bin" / "modalctl").read_bytes(),
                               reason="a sanitized library does not load into Python")


@pytest.fixture
def peer(tmp_path):
    made = Peer(f"ipc://{tmp_path}/s").start()
    yield made
    made.stop()


def loop(name, steps, url=None, *more, **env):
    """The C example, its own log as rows."""
    done = subprocess.run([str(EXAMPLES / "example_loop"), name, str(steps), *map(str, more)],
                          capture_output=True, timeout=PATIENCE,
                          env=environment(**({"MODALD_URL": url} if url else {}), **env))
    return done, np.frombuffer(done.stdout).reshape(-1, 2)


def test_the_record_is_the_runs_own_log_bit_for_bit(peer):
    done, log = loop("rig7", 50000, peer.endpoint)
    assert done.returncode == 0 and done.stderr == b"" and len(log) == 50000
    assert np.array_equal(peer.record("rig7"), log)
    assert peer.closes == [("rig7", False)] and not peer.streams["rig7"][-1].gaps
    assert peer.opens["rig7"]["channels"] == 2 and peer.opens["rig7"]["dt"] == 1e-3


def test_without_the_environment_nothing_happens():
    done, log = loop("rig7", 1000)
    assert done.returncode == 0 and done.stderr == b"" and len(log) == 1000


@pytest.mark.parametrize("fault", ["absent", "silent", "wrong-url", "wrong-name", "no-key",
                                   "no-spill"])
def test_a_fault_changes_neither_output_nor_exit_status(fault, peer, tmp_path):
    plain = loop("x", 20000)[0].stdout
    env = {"MODALD_CLOSE_WAIT": "0.3", "MODALD_SPILL": tmp_path}
    url = peer.endpoint
    if fault == "absent":
        url += "-not"
    elif fault == "silent":
        peer.silent = True
    elif fault == "wrong-url":
        url = "nonsense://here"
    elif fault == "wrong-name":
        url = "tcp://nobody.invalid:4711"
    elif fault == "no-key":
        (tmp_path / "key").write_text("public\n")
        env["MODALD_KEYFILE"] = tmp_path / "key"
    else:
        url += "-not"
        env["MODALD_SPILL"] = "/dev/null/nowhere"
    done, _ = loop("x", 20000, url, **env)
    assert done.returncode == 0 and done.stdout == plain
    assert done.stderr.count(b"\n") <= 2


def test_what_an_absent_server_missed_is_replayed(peer, ctl, tmp_path):
    done, log = loop("rig8", 30000, peer.endpoint + "-not", MODALD_SPILL=tmp_path,
                     MODALD_CLOSE_WAIT="0.2")
    left = list(tmp_path.glob("modald-rig8-*.spill"))
    assert len(left) == 1 and str(left[0]).encode() in done.stderr
    said = ctl("replay", left[0], server=peer.endpoint)
    assert said.status == 0 and said.document["samples"] == 30000
    assert np.array_equal(peer.record("rig8"), log)


def test_streams_of_one_name_in_one_process_keep_a_spill_file_each(peer, tmp_path):
    """A PID that comes again, as in a container, is the same case: what is there was never sent,
    and is not written over."""
    text = f"""
import os, sys
sys.path.insert(0, {str(pathlib.Path(modald.__file__).parent.parent)!r})
import modald
for part in range(3):
    with modald.stream("again", 1, 0.01) as s:
        s.push([[100.0 * part + k] for k in range(100)])
"""
    if b"__asan_init" in (BUILD / "bin" / "modalctl").read_bytes():
        pytest.skip("a sanitized library does not load into Python")
    subprocess.run(["/usr/bin/python3", "-c", text], check=True, capture_output=True,
                   timeout=PATIENCE,
                   env=environment(MODALD_URL=peer.endpoint + "-not", MODALD_SPILL=tmp_path,
                                   MODALD_CLOSE_WAIT="0.2"))
    firsts = []
    for left in sorted(tmp_path.glob("modald-again-*.spill"), key=lambda f: f.stat().st_mtime):
        data = left.read_bytes()
        firsts.append(np.frombuffer(data[-800:])[0])
    assert firsts == [0.0, 100.0, 200.0]


def records(data):
    """Of a spill file's bytes: where each record begins, its first sample and how many of two
    channels; then where the last one ends."""
    at, found = 12 + int.from_bytes(data[8:12], "little"), []
    while at < len(data):
        first, count = np.frombuffer(data[at:at + 16], "<u8")
        found.append((at, int(first), int(count)))
        at += 24 + 16 * int(count)                      # first, count, CRC-32C, 0, samples
    return [*found, (at, int(first + count), 0)]


def spilled(peer, ctl, tmp_path, change):
    """30,000 samples in a spill file, its bytes changed, replayed; what modalctl said, its records,
    the log."""
    _, log = loop("torn", 30000, peer.endpoint + "-not", MODALD_SPILL=tmp_path,
                  MODALD_CLOSE_WAIT="0.2")
    left, = tmp_path.glob("modald-torn-*.spill")
    data = left.read_bytes()
    found = records(data)
    assert len(found) >= 4 and found[0][1] == 0 and found[-1][0] == len(data)
    left.write_bytes(change(bytearray(data), found))
    return ctl("replay", left, server=peer.endpoint), found, log


def test_the_torn_end_of_a_killed_host_is_said_and_what_is_before_it_is_sent(peer, ctl, tmp_path):
    said, found, log = spilled(peer, ctl, tmp_path, lambda data, found: data[:found[2][0] + 1000])
    assert (said.status == 0 and said.document["samples"] == found[2][1] and said.document["note"]
            == "the last 1000 bytes were torn")
    assert np.array_equal(peer.record("torn"), log[:found[2][1]])


def test_a_damaged_record_is_a_gap_and_what_follows_it_is_sent(peer, ctl, tmp_path):
    def change(data, found):
        data[found[1][0] + 5000] ^= 64
        return data
    said, found, log = spilled(peer, ctl, tmp_path, change)
    _, first, count = found[1]
    assert (said.status == 0 and said.document["note"]
            == f"{count} samples were damaged and left out")
    assert [tuple(g) for g in peer.streams["torn"][-1].gaps] == [(first, first + count)]
    assert np.array_equal(peer.record("torn"), np.concatenate([log[:first], log[first + count:]]))


def test_a_spill_file_of_another_byte_order_is_refused(peer, ctl, tmp_path):
    def change(data, _):
        data[8:12] = data[8:12][::-1]
        return data
    said, *_ = spilled(peer, ctl, tmp_path, change)
    assert (said.status == 2 and said.document["error"]["code"] == "bad_input"
            and said.document["error"]["field"] == "file")


@in_python
def test_a_forked_child_leaves_its_parents_stream_alone(peer, url, tmp_path, monkeypatch):
    """The ring lies in a file that both have mapped: what the child pushes and closes must not be
    in the record."""
    monkeypatch.setenv("MODALD_RING_FILE", str(tmp_path / "ring-%s"))
    monkeypatch.setenv("MODALD_CLOSE_WAIT", str(10 * PATIENCE))
    rows = np.random.default_rng(8).standard_normal((400, 2))
    peer.event = {"stability": {"stable": True},
                  "modes": [{"frequency_hz": 2.5, "damping_ratio": 0.03}]}
    with modald.stream("forks", 2, 0.01) as s:
        s.push(rows[:200])
        end = time.monotonic() + PATIENCE
        while s.estimate is None:
            assert time.monotonic() < end
        child = os.fork()
        if child == 0:
            # its close waits for nobody: a parent's would, for ten times as long
            signal.alarm(PATIENCE)
            s.push(np.full((50, 2), 7.0))
            if s.verdict != "unknown" or s.estimate is not None:
                os._exit(5)
            s.close()
            os._exit(3)
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 3
        s.push(rows[200:])
    assert np.array_equal(peer.record("forks"), rows)


def test_what_the_ring_cannot_hold_waits_in_a_file_in_its_order(peer, tmp_path):
    """120,000 samples of 32 bytes in a ring of 4 MiB: none can be dropped, more than half the ring
    is spilled."""
    peer.stop()
    with open(tmp_path / "log",
              "wb") as out, subprocess.Popen([str(EXAMPLES / "example_loop"), "rig9", "120000"],
                                             stdout=out, stderr=subprocess.PIPE,
                          env=environment(MODALD_URL=peer.endpoint, MODALD_RING=4194304,
                                          MODALD_SPILL=tmp_path, MODALD_CLOSE_WAIT="120")) as run:
        end = time.monotonic() + PATIENCE
        while not list(tmp_path.glob("modald-rig9-*.spill")):
            assert time.monotonic() < end and run.poll() is None
        peer.start()
        assert run.wait(PATIENCE) == 0 and run.stderr.read() == b""
    log = np.frombuffer((tmp_path / "log").read_bytes()).reshape(-1, 2)
    assert np.array_equal(peer.record("rig9"), log) and not peer.streams["rig9"][-1].gaps
    assert not list(tmp_path.glob("*.spill"))


def test_past_ring_and_spill_samples_are_a_counted_gap(peer):
    done, log = loop("gap", 100000, peer.endpoint + "-not", MODALD_RING=65536, MODALD_SPILL_MAX="0",
                     MODALD_CLOSE_WAIT="0.1")
    assert (done.returncode == 0 and len(log) == 100000
            and b"samples were dropped; the record shows the gap" in done.stderr)


def test_the_server_may_come_and_go(peer, tmp_path):
    """Twenty losses of the connection in a run of a few seconds: gaps 0, the record the run's own
    log."""
    with subprocess.Popen([str(EXAMPLES / "example_loop"), "long", "40000", "2", "0.00005"],
                          stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                          env=environment(MODALD_URL=peer.endpoint, MODALD_SPILL=tmp_path,
                                          MODALD_CLOSE_WAIT="120")) as run:
        import threading
        log = []
        reader = threading.Thread(target=lambda: log.append(run.stdout.read()))
        reader.start()
        for i in range(20):
            have = len(peer.streams["long"][-1].rows) if "long" in peer.streams else 0
            peer.wait(lambda: "long" in peer.streams
                      and (len(peer.streams["long"][-1].rows) > have or bool(peer.closes)))
            peer.stop()
            peer.start()
        assert run.wait(PATIENCE) == 0
        reader.join()
    assert np.array_equal(peer.record("long"), np.frombuffer(log[0]).reshape(-1, 2))
    assert len(peer.streams["long"]) == 1 and not peer.streams["long"][-1].gaps


def test_a_ring_in_a_file_outlives_its_host(peer, tmp_path):
    env = environment(MODALD_URL=peer.endpoint + "-not", MODALD_RING_FILE=tmp_path / "ring-%s",
                      MODALD_SPILL_MAX="0")
    with subprocess.Popen([str(EXAMPLES / "example_loop"), "killed", "1000000", "2", "0.0001"],
                          stdout=subprocess.PIPE, env=env) as run:
        head = run.stdout.read(4096 * 8)                # 2,048 samples are out
        run.kill()
        log = head + run.stdout.read()
    done = subprocess.run([str(BUILD / "bin" / "modalctl"), "--server", peer.endpoint, "--json",
                           "replay", str(tmp_path / "ring-killed")],
                          capture_output=True, text=True, env=environment(), timeout=PATIENCE)
    assert done.returncode == 0, done.stdout
    record, logged = peer.record("killed"), np.frombuffer(log).reshape(-1, 2)
    assert len(record) >= len(logged) >= 2048           # stdout is buffered, the ring is not
    assert np.array_equal(record[:len(logged)], logged)


def test_push_makes_no_system_call(peer, tmp_path):
    if shutil.which("strace") is None or "asan" in BUILD.name:
        pytest.skip("no strace, or a build whose leak check does not run under it")
    bench = BUILD / "bench" / "bench_stream"
    trace = tmp_path / "trace"
    subprocess.run(["strace", "-o", str(trace), str(bench), "--marked"], check=True,
                   capture_output=True, timeout=PATIENCE,
                   env=environment(MODALD_URL=peer.endpoint, MODALD_CLOSE_WAIT="120"))
    text = trace.read_text()
    between = text[text.index("BEGIN"):text.index("END", text.index("BEGIN"))].splitlines()[1:-1]
    calls = [line for line in between if not line.startswith("---")]
    assert calls == [], calls[:5]


@pytest.mark.skipif("asan" in BUILD.name, reason="the cost of a sanitizer")
@pytest.mark.parametrize("ring", [None, "ring-%s"])
def test_a_push_of_eight_channels_is_under_300_instructions(ring, peer, tmp_path):
    """100 ns, which tests/bench measures, at an instruction a cycle of 3 GHz.  With all that it
    calls; the same on the busiest machine."""
    counts = tmp_path / "counts"
    env = environment(MODALD_URL=peer.endpoint, MODALD_SPILL=tmp_path, MODALD_CLOSE_WAIT="120",
                      **({"MODALD_RING_FILE": tmp_path / ring} if ring else {}))
    subprocess.run(["valgrind", "--tool=callgrind", f"--callgrind-out-file={counts}",
                    "--toggle-collect=modald_push", str(BUILD / "bench" / "bench_stream"),
                    "--marked"],
                   check=True, capture_output=True, timeout=PATIENCE, env=env)
    total = int(re.search(r"^totals: (\d+)$", counts.read_text(), re.MULTILINE)[1])
    assert 20 * MARKED < total < 300 * MARKED


@pytest.mark.parametrize("example", ["example_loop", "example_loop_fortran"])
def test_a_run_stops_itself_when_told_that_it_is_unstable(example, peer):
    if not (EXAMPLES / example).exists():
        pytest.skip(f"{example} was not built: no Fortran compiler")
    peer.event = {"stability": {"stable": False},
                  "modes": [{"frequency_hz": 3.0, "damping_ratio": -0.01,
                             "std": {"frequency_hz": 0.1, "damping_ratio": 0.002}}]}
    if example == "example_loop":
        done, log = loop("verdict", 2000000, peer.endpoint, "2", "0.0001")
        assert done.returncode == 0 and len(log) < 2000000
    else:
        done = subprocess.run([str(EXAMPLES / example), "verdict"], capture_output=True, text=True,
                              env=environment(MODALD_URL=peer.endpoint), timeout=PATIENCE)
        steps = int(done.stdout.split()[1])
        assert done.returncode == 0 and len(peer.record("verdict")) >= min(steps, 2000)


def test_fortran_pushes_what_it_computes(peer):
    if not (EXAMPLES / "example_loop_fortran").exists():
        pytest.skip("no Fortran compiler")
    done = subprocess.run([str(EXAMPLES / "example_loop_fortran"), "oscillator  "],
                          capture_output=True, text=True, env=environment(MODALD_URL=peer.endpoint),
                          timeout=PATIENCE)
    assert done.stdout.split() == ["steps", "2000"]
    record, t = peer.record("oscillator"), np.arange(2000) * 1e-3
    d, k = 0.85, 3.9e4
    w = np.sqrt(k - d * d)
    exact = np.exp(-d * t) * (np.cos(w * t) + d / w * np.sin(w * t))
    # phases up to 400 rad, each rounded to 6e-14
    assert np.allclose(record[:, 0], exact, atol=1e-12)


# -- Python
# --------------------------------------------------------------------------------------------------

@pytest.fixture
def url(peer, monkeypatch):
    monkeypatch.setenv("MODALD_URL", peer.endpoint)
    monkeypatch.setenv("MODALD_CLOSE_WAIT", "120")
    return peer.endpoint


@in_python
def test_python_pushes_rows_names_and_a_verdict(peer, url):
    peer.event = {"stability": {"stable": True},
                  "modes": [{"frequency_hz": 2.5, "damping_ratio": 0.03,
                             "std": {"frequency_hz": 0.25, "damping_ratio": 0.005}},
                                                            {"frequency_hz": 1.5,
                                                             "damping_ratio": 0.01,
                                                             "std": {"frequency_hz": 0.125,
                                                                     "damping_ratio": 0.001}}]}
    rows = np.random.default_rng(2).standard_normal((500, 3))
    with modald.stream("py", ["root", "mid", "tip"], 0.01, units="m", window=100, hop=50) as s:
        s.push(rows)
        end = time.monotonic() + PATIENCE
        while s.verdict == "unknown":                    # the event's arrival
            assert time.monotonic() < end
        assert s.verdict == "stable" and not s.unstable
        assert (s.estimate.frequency_hz, s.estimate.damping_ratio) == (1.5, 0.01)
        assert (s.estimate.frequency_std, s.estimate.damping_std) == (0.125, 0.001)
    assert np.array_equal(peer.record("py"), rows)
    opened = peer.opens["py"]
    assert (opened["names"] == ["root", "mid", "tip"] and opened["units"] == "m"
            and opened["window"] == {"samples": 100, "hop": 50})


@in_python
@pytest.mark.parametrize("whose",
                         [{"stream_id": "id-another"}, {"stream_id": "id-mine", "epoch": 4},
                          {"stream_id": "id-mine-too"}])
def test_what_is_said_of_another_run_of_that_name_or_another_epoch_is_no_verdict(whose, peer, url):
    """A window of a run before, computed late on a busy machine, would stop the run after it.  The
    second push is answered behind the first's event."""
    def acknowledged(s, count):
        end = time.monotonic() + PATIENCE
        while s.report.acknowledged < count:
            assert time.monotonic() < end
    with modald.stream("mine", 1, 0.01) as s:
        for stable, said in ((whose, "unknown"),
                             ({"stream_id": "id-mine", "epoch": 0}, "unstable")):
            peer.event = {"stability": {"stable": False},
                          "modes": [{"frequency_hz": 2.5, "damping_ratio": -0.03}], **stable}
            at = s.report.pushed
            s.push([[1.0], [2.0]])
            acknowledged(s, at + 2)
            with peer.changed:                           # the event is on its way
                peer.event = None
            s.push([[3.0]])
            acknowledged(s, at + 3)
            assert s.verdict == said


@in_python
def test_an_epoch_that_begins_knows_nothing_of_the_one_before(peer, url):
    def wait_for(answered):
        end = time.monotonic() + PATIENCE
        while not answered():
            assert time.monotonic() < end
    with modald.stream("anew", 1, 0.01) as s:
        peer.event = {"stability": {"stable": True},
                      "modes": [{"frequency_hz": 2.5, "damping_ratio": 0.03}]}
        s.push([[1.0], [2.0]])
        wait_for(lambda: s.verdict == "stable")
        assert s.estimate.frequency_hz == 2.5
        peer.event = None
        s.seek(0)
        s.push([[5.0], [6.0]])                                 # other numbers: an epoch
        wait_for(lambda: s.report.acknowledged >= 4)
        assert len(peer.streams["anew"]) == 2 and s.verdict == "unknown" and s.estimate is None
        peer.event = {"stability": {"stable": None}, "modes": []}
        s.push([[7.0]])
        wait_for(lambda: s.verdict == "undecided")
        assert s.estimate is None


@in_python
def test_an_exception_closes_the_stream_as_broken_off(peer, url):
    with pytest.raises(ZeroDivisionError):
        with modald.stream("broken", 1, 0.01) as s:
            s.push([1.0])
            1 / 0
    assert peer.closes == [("broken", True)]


@in_python
def test_python_without_the_environment_does_nothing(monkeypatch):
    monkeypatch.delenv("MODALD_URL", raising=False)
    with modald.stream("none", 2, 0.01) as s:
        s.push([1, 2])
        assert s.verdict == "unknown" and s.estimate is None and s.report.pushed == 0


@in_python
def test_the_verdict_is_forgotten_when_the_link_breaks(peer, url):
    peer.event = {"stability": {"stable": True}, "modes": []}
    with modald.stream("stale", 1, 0.01) as s:
        s.push(np.ones((10, 1)))
        end = time.monotonic() + PATIENCE
        while s.verdict != "stable":
            assert time.monotonic() < end
        peer.stop()
        while s.verdict != "unknown":
            assert time.monotonic() < end
        peer.start()


@in_python
def test_a_run_from_a_checkpoint_repeats_or_begins_an_epoch(peer, url):
    rows = np.arange(100.0).reshape(-1, 1)
    with modald.stream("run", 1, 0.01) as s:
        s.push(rows[:60])
    with modald.stream("run", 1, 0.01) as s:                # the same again from 40 on: a repeat
        s.seek(40)
        s.push(rows[40:])
    assert len(peer.streams["run"]) == 1 and np.array_equal(peer.record("run"), rows)
    with modald.stream("run", 1, 0.01) as s:                # other numbers: an epoch, both kept
        s.seek(50)
        s.push(-rows[50:70])
    assert (len(peer.streams["run"]) == 2 and np.array_equal(peer.record("run"), -rows[50:70])
            and np.array_equal(peer.record("run", 0), rows))


@in_python
def test_uneven_steps_are_brought_to_equal_ones_and_the_error_is_estimated(peer, url):
    dt, w = 0.01, 2 * np.pi * 3
    t = np.cumsum(np.random.default_rng(4).uniform(0.3, 1.0, 3000) * dt)
    with modald.stream("uneven", 1, dt) as s:
        for moment in t:
            s.push_at(moment, [np.sin(w * moment)])
        end = time.monotonic() + PATIENCE
        while s.report.acknowledged < t[-10] / dt - 200 and time.monotonic() < end:
            pass
        estimate = s.report.resampling_error
    record = peer.record("uneven")[:, 0]
    first = int(np.ceil(t[0] / dt))
    exact = np.sin(w * dt * (first + np.arange(len(record))))
    error = np.max(np.abs(record - exact)) / np.sqrt(np.mean(exact ** 2))
    # the cubic's error is at most 3/128 (w h)^4 with h <= dt between points, once more at the two
    # ends: (w h)^4 / 24
    assert error < (w * dt) ** 4 / 24 * np.sqrt(2) + 1e-12 and error <= estimate < (w * dt) ** 3
    assert abs(first + len(record) - 1 - t[-1] / dt) <= 1


# -- codes by others
# --------------------------------------------------------------------------------------------------

def test_rosco_gets_its_answer_and_the_numbers_become_a_stream(peer, tmp_path):
    where = f"ipc://{tmp_path}/rosco"
    bridge = subprocess.Popen([str(EXAMPLES / "rosco_bridge"), where, "200"],
                              env=environment(MODALD_URL=peer.endpoint))
    sent = np.random.default_rng(6).standard_normal((200, 14))
    # as ROSCO does: a new context, REQ, text with 7 digits
    for i, row in enumerate(sent):
        context = zmq.Context()
        request = context.socket(zmq.REQ)
        request.connect(where)
        request.send_string(",".join(f"{x:.6e}" for x in (1, 0, 0.025 * i, *row)))
        assert request.poll(1000 * PATIENCE)
        reply = [float(x) for x in request.recv_string().split(",")]
        assert len(reply) == 8 and reply[:5] == [0] * 5
        context.destroy(linger=0)
    assert bridge.wait(PATIENCE) == 0
    record = peer.record("rosco-1")
    assert len(record) == 199 and np.allclose(record, sent[1:], atol=1e-6)


def rosco(where, numbers):
    """One call of a controller, as ROSCO makes it: a new context, REQ, text."""
    context = zmq.Context()
    request = context.socket(zmq.REQ)
    request.connect(where)
    request.send_string(",".join(f"{x:.6e}" for x in numbers))
    assert request.poll(1000 * PATIENCE)
    answer = request.recv_string()
    context.destroy(linger=0)
    return answer


def test_the_last_call_of_a_rosco_simulation_closes_its_stream_and_a_signal_closes_the_others(
        peer, tmp_path):
    where = f"ipc://{tmp_path}/rosco"
    bridge = subprocess.Popen([str(EXAMPLES / "rosco_bridge"), where],
                              env=environment(MODALD_URL=peer.endpoint))
    for run in range(2):
        for i in range(20):
            for turbine in (1, 2):
                rosco(where, (turbine, -1 if i == 19 and turbine == 1 else 0, 0.1 * i, float(run),
                              turbine, *([0] if i == 7 else [])))
    peer.wait(lambda: peer.closes == [("rosco-1", False)] * 2)
    bridge.terminate()
    assert bridge.wait(PATIENCE) == 0
    assert sorted(peer.closes) == [("rosco-1", False)] * 2 + [("rosco-2", False)]


def test_a_signal_ends_the_listener_and_seals_what_mbdyn_sent(peer, tmp_path):
    where = str(tmp_path / "mbdyn.sock")
    listener = subprocess.Popen([str(EXAMPLES / "mbdyn_listener"), where, "mbdyn", "3", "0.001"],
                                env=environment(MODALD_URL=peer.endpoint))
    rows = np.random.default_rng(9).standard_normal((500, 3))
    end = time.monotonic() + PATIENCE
    with socket.socket(socket.AF_UNIX) as out:
        while out.connect_ex(where) != 0:
            assert time.monotonic() < end and listener.poll() is None
        out.sendall(rows.tobytes())
        peer.wait(lambda: "mbdyn" in peer.streams and len(peer.streams["mbdyn"][-1].rows) == 500)
        listener.terminate()
        assert listener.wait(PATIENCE) == 0
    assert np.array_equal(peer.record("mbdyn"),
                          rows) and peer.closes == [("mbdyn", False)] and not os.path.exists(where)


@pytest.mark.parametrize("local", [True, False])
def test_mbdyns_rows_become_a_stream(local, peer, tmp_path):
    if local:
        where = str(tmp_path / "mbdyn.sock")
    else:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            where = str(probe.getsockname()[1])
    listener = subprocess.Popen([str(EXAMPLES / "mbdyn_listener"), where, "mbdyn", "5", "0.001"],
                                env=environment(MODALD_URL=peer.endpoint))
    rows = np.random.default_rng(8).standard_normal((3000, 5))
    end = time.monotonic() + PATIENCE
    while True:
        out = socket.socket(socket.AF_UNIX if local else socket.AF_INET)
        try:
            out.connect(where if local else ("127.0.0.1", int(where)))
            break
        except OSError:
            out.close()
            assert time.monotonic() < end and listener.poll() is None
    out.sendall(rows.tobytes() + b"\0" * 11)                # broken off within a row
    out.close()
    assert listener.wait(PATIENCE) == 0
    assert np.array_equal(peer.record("mbdyn"), rows)


# The flutter root of Ziegler's column, its quartic solved: streaming facts of the project, checked
# here against the closed form.
def flutter_root(p, beta=0.1):
    """Two links, masses 2 and 1, springs 1, dampers beta, follower force p: M x'' + beta D x' + (D
    - p P) x = 0 in absolute angles."""
    mass = np.array([[3.0, 1.0], [1.0, 1.0]])
    joints = np.array([[2.0, -1.0], [-1.0, 1.0]])
    force = np.array([[1.0, -1.0], [0.0, 0.0]])
    a = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(mass, joints - p * force),
                                                  -beta * np.linalg.solve(mass, joints)]])
    roots = np.linalg.eigvals(a)
    return max((r for r in roots if r.imag > 0), key=lambda r: r.real)


@pytest.mark.parametrize("p, table",
                         [(1.20, -0.004134964 + 0.492721119j), (1.46, -0.000209726 + 0.532864142j),
                          (1.48, 0.000250405 + 0.536459161j), (1.60, 0.003819840 + 0.560042841j)])
def test_zieglers_column_by_simbody_gives_the_quartics_roots(p, table, peer, ctl, tmp_path):
    if not (EXAMPLES / "example_ziegler").exists():
        pytest.skip("example_ziegler was not built: Debian package libsimbody-dev")
    assert abs(flutter_root(p) - table) < 1e-8
    done = subprocess.run([str(EXAMPLES / "example_ziegler"), "column", str(p), "1500"],
                          capture_output=True, text=True,
                          env=environment(MODALD_URL=peer.endpoint), timeout=PATIENCE)
    assert done.returncode == 0, done.stderr
    path = write_batch(tmp_path / "column.h5", peer.record("column"), 0.1)
    said = ctl("identify", path, "-o", "rank.fixed=4")
    assert said.status == 0, said.document
    found = max((complex(*m["exponent"]) for m in said.document["modes"] if m["exponent"][1] > 0),
                key=lambda r: r.real)
    assert abs(found - table) < 1e-6
    assert said.document["stability"]["stable"] is (table.real < 0)


# -- modalctl stream
# --------------------------------------------------------------------------------------------------

def test_a_file_is_pushed_as_a_simulation_would(peer, ctl, tmp_path):
    peer.event = {"stability": {"stable": True},
                  "modes": [{"frequency_hz": 1.5, "damping_ratio": 0.01,
                             "std": {"frequency_hz": 0.1, "damping_ratio": 0.001}}]}
    rows = np.random.default_rng(9).standard_normal((3000, 2))
    said = ctl("stream", write_batch(tmp_path / "run.h5", rows), "--name", "file",
               server=peer.endpoint, one=False)
    assert said.status == 0 and np.array_equal(peer.record("file"), rows)
    assert said.lines[-1]["acknowledged"] == 3000 and said.lines[-1]["dropped"] == 0
    assert all(line["frequency_hz"] == 1.5 for line in said.lines[:-1])


def test_a_pushed_file_shows_alarms_and_tracks_and_windows_without_modes(peer, ctl, tmp_path):
    """Also those behind the last window, which nothing follows."""
    peer.event = {"error": {"code": "worker_died", "message": "the window is left out"}}
    peer.behind = [{"event": "track", "track": 3, "state": "born", "frequency_hz": 4.5},
                   {"event": "alarm", "rule": "growth", "state": "raised"}]
    path = write_batch(tmp_path / "run.h5", np.ones((300, 1)))
    said = ctl("stream", path, server=peer.endpoint, one=False)
    lines = [line for line in said.lines[:-1] if line["to"] == 299]
    assert said.status == 0 and [line["event"] for line in lines] == ["modes", "track", "alarm"]
    window, track, alarm = lines
    assert window["error"]["code"] == "worker_died" and window["frequency_hz"] is None
    assert (track["track"], track["state"], alarm["rule"],
            alarm["state"]) == (3, "born", "growth", "raised")


def test_rows_from_stdin_are_pushed_as_they_come(peer):
    with subprocess.Popen([str(BUILD / "bin" / "modalctl"), "--server", peer.endpoint, "--json",
                           "stream", "-", "--dt", "0.1"], stdin=subprocess.PIPE,
                          stdout=subprocess.PIPE, text=True, env=environment()) as run:
        run.stdin.write("tip,root\n1.5,-2\n")
        run.stdin.flush()
        # before the second row exists
        peer.wait(lambda: "stdin" in peer.streams and len(peer.streams["stdin"][-1].rows) == 1)
        out, _ = run.communicate("2.5, 4e-3\n", timeout=PATIENCE)
    assert run.returncode == 0 and np.array_equal(peer.record("stdin"), [[1.5, -2], [2.5, 4e-3]])


@pytest.mark.parametrize("text, words, field",
                         [("1 2\n", [], "dt"), ("1 2\n3\n", ["--dt", "0.1"], "signals"),
                          ("", ["--dt", "0.1"], "signals")])
def test_bad_rows_from_stdin_are_named(text, words, field, peer, ctl):
    said = ctl("stream", "-", *words, server=peer.endpoint, stdin=text)
    assert said.status == 2 and said.document["error"]["field"] == field


# -- the daemon itself
# --------------------------------------------------------------------------------------------------

def test_a_growing_run_stops_itself_by_the_daemons_verdict(daemon):
    """Damping -2 at 31.8 Hz grows by e a second: told after the first windows of 500 samples.  Of
    20,000 steps the run has made some 4,000, which a pipe holds, when it has been told."""
    with contextlib.closing(wire.Client(daemon.endpoint)) as ear:
        assert ear.ask("EVENTS", stream="growing", kinds=["modes"]).ok
        with subprocess.Popen([str(EXAMPLES / "example_loop"), "growing", "20000", "-2", "0.0005"],
                              stdout=subprocess.PIPE,
                              env=environment(MODALD_URL=daemon.endpoint, MODALD_WINDOW=500,
                                              MODALD_HOP=100)) as run:
            while ear.receive()["verdict"] != "unstable":
                pass
            log, _ = run.communicate(timeout=PATIENCE)
    assert run.returncode == 0 and 500 <= len(log) // 16 < 20000


@pytest.mark.parametrize("p, unstable, pace", [(1.60, True, "0.02"), (1.46, False, "0.001")])
def test_zieglers_column_stops_itself_only_where_it_is_unstable(p, unstable, pace, daemon,
                                                                tmp_path):
    """What grows is to be heard of before its end, and takes a minute to it, for a worker that is
    sanitized and one of many."""
    if not (EXAMPLES / "example_ziegler").exists():
        pytest.skip("example_ziegler was not built: Debian package libsimbody-dev")
    done = subprocess.run([str(EXAMPLES / "example_ziegler"), f"column-{p}", str(p), "3001", "1e-5",
                           pace], capture_output=True, text=True, timeout=PATIENCE,
                          env=environment(MODALD_URL=daemon.endpoint, MODALD_WINDOW=600,
                                          MODALD_HOP=100, MODALD_OPTIONS='{"rank.fixed":4}',
                                          MODALD_SPILL=tmp_path))
    assert done.returncode == 0, done.stderr
    words = done.stdout.split()
    steps, tip, verdict = int(words[1]), float(words[3]), int(words[5])
    if unstable:
        # said before the tip passes 1 % of a link
        assert steps < 3001 and verdict == 2 and tip < 0.01
    else:
        assert steps == 3001 and verdict != 2
