"""modald-worker spoken to as the daemon does: proto/PROTOCOL.md, section 13, over a ROUTER of our
own.
"""
# Tests as well: descriptors.c inputs.c link.c serve.c
import json
import math
import os
import pathlib
import random
import shutil
import signal
import socket
import struct
import subprocess
import tempfile
import time

import pytest
import sanitized
import zmq

BUILD = pathlib.Path(os.environ.get("MODALD_BUILD", pathlib.Path(__file__).resolve().parents[2]
                                    / "build"))
WORKER = BUILD / "bin" / "modald-worker"
VERSION = b"MODALW1"
PATIENCE_S = 300


def crc32c(data):
    crc = 0xFFFFFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0x82F63B78 if crc & 1 else 0)
    return crc ^ 0xFFFFFFFF


class Daemon:
    """A stand-in for the daemon with one worker."""

    def __init__(self, *arguments):
        self.dir = tempfile.mkdtemp(prefix="modald-test-")
        os.makedirs(f"{self.dir}/data/spool")
        self.context = zmq.Context()
        self.router = self.context.socket(zmq.ROUTER)
        self.router.linger = 0
        self.endpoint = f"ipc://{self.dir}/w"
        self.router.bind(self.endpoint)
        self.inputs, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        # descriptor 3 of the worker, whatever is this process's
        with theirs:
            self.process = subprocess.Popen(["/bin/bash", "-c", 'exec 3<&"$0" && exec "$@"',
                                             str(theirs.fileno()), WORKER, "--connect",
                                             self.endpoint,
                                             "--inputs", "--data", f"{self.dir}/data", *arguments],
                                            pass_fds=[theirs.fileno()], stderr=subprocess.PIPE)
        self.peer = None

    def next(self, *verbs):
        """The next message whose verb is one of VERBS: (verb, header, body)."""
        end = time.monotonic() + PATIENCE_S
        while time.monotonic() < end:
            if not self.router.poll(100):
                assert self.process.poll() is None, self.process.stderr.read()
                continue
            self.peer, version, verb, header, *body = self.router.recv_multipart()
            assert version == VERSION
            if not verbs or verb.decode() in verbs:
                return verb.decode(), json.loads(header), body
        raise AssertionError(f"none of {verbs} came")

    def drain(self):
        """The verbs of what has come so far."""
        out = []
        while self.router.poll(0):
            out.append(self.router.recv_multipart()[2].decode())
        return out

    def hand(self, job, path, attempt=1):
        """The file of an input, ahead of its RUN."""
        with open(path, "rb") as file:
            socket.send_fds(self.inputs, [f"{job} {attempt}".encode()], [file.fileno()])

    def send(self, verb, header, *body):
        self.router.send_multipart([self.peer, VERSION, verb.encode(), json.dumps(header).encode(),
                                    *body])

    def run(self, job, kind, samples, options=None, **more):
        header = {"job": job, "attempt": 1, "kind": kind, "options": options or {},
                  "run_limit_s": 0,
                  "input": {"content": "batch", "samples": len(samples), "channels": 1, "dt": 0.05,
                            **more}}
        self.send("RUN", header,
                  *([] if "file" in more else [struct.pack(f"<{len(samples)}d", *samples)]))

    def run_scene(self, job, kind, scene, options=None):
        text = json.dumps(scene).encode()
        self.send("RUN", {"job": job, "attempt": 1, "kind": kind, "options": options or {},
                          "run_limit_s": 0,
                          "input": {"content": "scene", "bytes": len(text)}}, text)

    def answer(self, job, go=True):
        """(verb, header, document, signals): the PARTs put together, each answered by GO."""
        parts, description = {"document": b"", "batch": b""}, None
        while True:
            verb, header, body = self.next("PART", "DONE", "FAILED")
            assert header["job"] == job and header["attempt"] == 1
            if verb != "PART":
                document = b"".join(body) or parts["document"]
                return verb, header, json.loads(document) if document else None, (description,
                                                                                  parts["batch"])
            assert (header["offset"] == len(parts[header["part"]]) and len(body) == 1
                    and len(body[0]) <= 1 << 20)
            description = header.get("batch", description)
            parts[header["part"]] += body[0]
            assert len(parts[header["part"]]) <= header["total"]
            if go:
                self.send("GO", {"job": job, "attempt": 1})

    def close(self):
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        sanitized.hear(self.process.stderr.read().decode(errors="replace"))
        self.process.stderr.close()
        self.inputs.close()
        self.router.close()
        self.context.term()
        shutil.rmtree(self.dir)


@pytest.fixture
def daemon():
    made = Daemon()
    yield made
    made.close()


def test_a_worker_says_ready_and_which_kernels_it_uses(daemon):
    _, header, _ = daemon.next("READY")
    assert header["pid"] == daemon.process.pid and header["version"] and header["core"]


def test_the_heart_beats_every_second_idle(daemon):
    """Beats come on and on, and never more of them than seconds have passed since it was ready."""
    # before it was started: the fixture has just done so
    begin = time.monotonic()
    daemon.next("READY")
    for n in range(4):
        _, header, _ = daemon.next("BEAT")
        assert "job" not in header
    assert n - 1 <= time.monotonic() - begin


def test_an_unknown_kind_fails_with_its_field_and_the_worker_is_ready_again(daemon):
    for i in range(3):
        daemon.next("READY")
        daemon.run(f"job{i}", "no-such-kind", [1.0] * 20)
        verb, header, _ = daemon.next("DONE", "FAILED")
        assert verb == "FAILED" and header["job"] == f"job{i}" and header["attempt"] == 1
        assert header["error"]["code"] == "bad_input" and header["error"]["field"] == "kind"
        assert header["cpu_s"] >= 0


def test_an_input_that_does_not_match_its_checksum_is_corrupt(daemon):
    daemon.next("READY")
    path = f"{daemon.dir}/data/spool/1.h5"
    with open(path, "wb") as file:
        file.write(b"\0" * 4096 + struct.pack("<20d", *range(20)))
    daemon.hand("a", path)
    daemon.run("a", "identify", [0.0] * 20, file=path, offset=4096, crc32c=12345)
    _, header, _ = daemon.next("DONE", "FAILED")
    assert header["error"]["code"] == "corrupt" and path in header["error"]["message"]
    daemon.next("READY")
    daemon.hand("b", path)
    # the file ends before
    daemon.run("b", "identify", [0.0] * 21, file=path, offset=4096, crc32c=12345)
    assert daemon.next("DONE", "FAILED")[1]["error"]["code"] == "corrupt"


def test_a_worker_takes_the_input_of_its_attempt_and_opens_none_itself(daemon):
    raw, other = (struct.pack("<20d", *range(first, first + 20)) for first in (0, 1))
    for name, data in (("1", raw), ("2", other)):
        pathlib.Path(f"{daemon.dir}/data/spool/{name}.h5").write_bytes(data)
    daemon.next("READY")
    daemon.run("a", "identify", [0.0] * 20, file=f"{daemon.dir}/data/spool/1.h5", offset=0,
               crc32c=crc32c(raw))
    error = daemon.next("DONE", "FAILED")[1]["error"]
    assert (error["code"] == "io_error"
            and "handed over no input for attempt 1 of job a" in error["message"])
    daemon.next("READY")
    # those of another job and another attempt first
    for job, attempt, name in (("a", 1, "2"), ("b", 2, "2"), ("b", 1, "1")):
        daemon.hand(job, f"{daemon.dir}/data/spool/{name}.h5", attempt)
    daemon.run("b", "identify", [0.0] * 20, {"rank.fixed": 1}, file="1.h5", offset=0,
               crc32c=crc32c(raw))
    verb, header = daemon.next("DONE", "FAILED")[:2]
    assert verb == "DONE" or header["error"]["code"] != "corrupt", header
    fds = os.listdir(f"/proc/{daemon.process.pid}/fd")
    assert not [fd for fd in fds if os.readlink(f"/proc/{daemon.process.pid}/fd/{fd}").endswith(
        ".h5")]


def test_a_worker_whose_daemon_is_gone_ends_whatever_it_is_doing(daemon):
    daemon.next("READY")
    daemon.run_scene("long", "simulate", {**OSCILLATOR, "time": {"dt": 1e-7, "duration": 300.0}})
    daemon.inputs.close()                            # its parent, this process, lives
    assert daemon.process.wait(PATIENCE_S) == 1


def test_a_worker_whose_parent_is_not_the_maker_of_its_socket_does_not_begin():
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ours, theirs:
        done = subprocess.run(["/bin/bash", "-c", 'exec 3<&"$0"; "$@"; exit $?',
                               str(theirs.fileno()), WORKER, "--connect", "ipc:///nowhere",
                               "--inputs"],
                              pass_fds=[theirs.fileno()], capture_output=True, text=True,
                              timeout=PATIENCE_S)
    assert done.returncode == 1 and "the daemon has ended" in done.stderr


def test_a_run_of_the_wrong_length_is_a_bad_frame(daemon):
    daemon.next("READY")
    daemon.send("RUN", {"job": "a", "attempt": 1, "kind": "identify", "options": {},
                        "run_limit_s": 0,
                        "input": {"content": "batch", "samples": 20, "channels": 1, "dt": 0.05}},
                b"\0" * 152)
    assert daemon.next("DONE", "FAILED")[1]["error"]["code"] == "bad_frame"


def test_stop_ends_it_with_0_and_sigterm_ends_it(daemon):
    daemon.next("READY")
    daemon.send("STOP", {})
    assert daemon.process.wait(PATIENCE_S) == 0
    other = Daemon()
    other.next("READY")
    other.process.terminate()
    assert other.process.wait(PATIENCE_S) == -signal.SIGTERM
    other.close()


def test_it_is_nice_confined_and_alone_in_its_group(daemon):
    daemon.next("READY")
    pid = daemon.process.pid
    status = dict(line.split(":\t", 1) for line in open(f"/proc/{pid}/status").read().splitlines()
                  if ":\t" in line)
    assert os.getpriority(os.PRIO_PROCESS, pid) == max(10, os.getpriority(os.PRIO_PROCESS, 0))
    assert os.getpgid(pid) == pid
    if b"__asan_init" not in WORKER.read_bytes():
        assert status["NoNewPrivs"] == "1"
        for thread in os.listdir(f"/proc/{pid}/task"):
            assert "Seccomp:\t2" in open(f"/proc/{pid}/task/{thread}/status").read()


def test_without_a_daemon_it_ends_and_says_why():
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run([WORKER, "--connect", f"ipc://{folder}/nobody"], capture_output=True,
                              text=True, timeout=PATIENCE_S)
    assert done.returncode == 1 and "nobody answers" in done.stderr


def test_wrong_usage_ends_with_2():
    for arguments in ([], ["--connect"], ["--connect", "ipc://x", "y"],
                      ["--connect", "ipc://x", "--memory", "much"], ["--what"]):
        assert subprocess.run([WORKER, *arguments], capture_output=True).returncode == 2


def test_after_its_jobs_it_ends_by_itself():
    daemon = Daemon("--jobs", "2")
    for i in range(2):
        daemon.next("READY")
        daemon.run(f"job{i}", "no-such-kind", [1.0] * 20)
        daemon.next("FAILED")
    assert daemon.process.wait(PATIENCE_S) == 0
    daemon.close()


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can become another user")
def test_started_by_root_it_runs_as_the_user_it_is_told():
    daemon = Daemon("--user", "nobody")
    os.chmod(daemon.dir, 0o755)
    daemon.next("READY")
    status = open(f"/proc/{daemon.process.pid}/status").read()
    assert "Uid:\t65534\t65534\t65534\t65534" in status
    daemon.close()


def decay(count=600):
    return [math.exp(-0.1 * 0.05 * k) * math.cos(6.0 * 0.05 * k) for k in range(count)]


OSCILLATOR = {"structure": {"type": "matrices", "M": [[1.0]], "C": [[0.2]], "K": [[9.0]]},
              "effects": [],
              "excitation": [{"type": "harmonic", "dof": "x1", "k": 1, "cos": 1.0}], "omega": 2.0,
              "initial": {"x": {"x1": 1.0}}, "time": {"dt": 0.01, "duration": 5.0}}


def test_identify_gives_the_same_document_from_a_mapped_file_and_from_the_message(daemon):
    samples = decay()
    raw = struct.pack(f"<{len(samples)}d", *samples)
    path = f"{daemon.dir}/data/spool/1.h5"
    with open(path, "wb") as file:
        file.write(b"\0" * 4104 + raw)
    crc = crc32c(raw)
    found = []
    for more in ({}, {"file": path, "offset": 4104, "crc32c": crc}):
        daemon.next("READY")
        daemon.hand("a", path)
        daemon.run("a", "identify", samples, {"rank.fixed": 2}, **more)
        verb, header, document, _ = daemon.answer("a")
        assert verb == "DONE" and header["cpu_s"] > 0, header
        mode = document["modes"][0]
        assert abs(mode["exponent"][0] + 0.1) < 1e-9 and abs(abs(mode["exponent"][1]) - 6.0) < 1e-9
        found.append([document["modes"], document["rank"]])
    assert found[0] == found[1]


def window(stream, attempt, channels, first, count, size):
    """RUN's header and body as the daemon sends a live window: COUNT samples of noise from FIRST on
    of STREAM."""
    body = random.Random(f"{stream} {first}").randbytes(count * channels)
    return ({"job": "live", "attempt": attempt, "kind": "identify",
             "options": {"rank.fixed": 4}, "run_limit_s": 60,
             "live": {"stream": stream, "epoch": 0, "to": first + count - 1, "window": size,
                      "hop": 8},
             "input": {"content": "batch", "samples": count, "channels": channels, "dt": 0.01}},
            struct.pack(f"<{count * channels}d", *body))


@pytest.mark.parametrize("last", [("long", 2000, 8), ("other", 0, 2000)])
def test_the_end_of_a_window_does_not_wait_for_one_that_takes_long_after_it(daemon, last):
    """Two of 2000 x 40, behind them one of 50 x 2, then one like the first, which its worker has
    had or has not; all are there before the short one begins.  Once the ends of the last two came
    together."""
    stream, first, count = last
    runs = [window(name, k + 1, 40, 0, 2000, 2000) for k, name in enumerate(["long", "a"])]
    runs += [window("short", 3, 2, 0, 50, 50), window(stream, 4, 40, first, count, 2000)]
    daemon.next("READY")
    apart, rounds = False, 0
    # who reads late on a busy machine finds both there: the ends that come apart are seen so once
    while not apart:
        assert (rounds := rounds + 1) <= 20, "the ends come together"
        for run in runs:
            daemon.send("RUN", *run)
        times, used = {}, {}
        while len(times) < len(runs):
            _, header, _ = daemon.next("DONE")
            times[header["attempt"]], used[header["attempt"]] = time.monotonic(), header["cpu_s"]
        assert list(times) == [1, 2, 3, 4] and used[4] > 0.02
        apart = times[4] - times[3] > used[4] / 2


def test_the_signals_of_simulate_come_in_parts_of_at_most_a_mebibyte(daemon):
    daemon.next("READY")
    scene = {**OSCILLATOR, "time": {"dt": 1e-4, "duration": 20.0}}
    daemon.run_scene("s", "simulate", scene)
    verb, header, document, (description, raw) = daemon.answer("s")
    assert verb == "DONE", header
    assert (document["kind"] == "simulate" and description["samples"] == 200001 and len(raw) == 8
            * description["samples"] * description["channels"])
    assert description["dt"] == 1e-4 and struct.unpack_from("<d", raw)[0] == 1.0


def test_no_more_than_four_parts_wait_for_their_go(daemon):
    daemon.next("READY")
    # 8 MB
    daemon.run_scene("s", "simulate", {**OSCILLATOR, "time": {"dt": 2e-5, "duration": 20.0}})
    for _ in range(4):
        daemon.next("PART", "DONE", "FAILED")
    daemon.next("BEAT")
    # two seconds later the heart still beats, and no fifth has come
    daemon.next("BEAT")
    assert not any(verb in ("PART", "DONE") for verb in daemon.drain())
    for _ in range(9):
        daemon.send("GO", {"job": "s", "attempt": 1})
    assert daemon.next("PART")[1]["offset"] == 4 << 20


@pytest.mark.parametrize("kind, scene, options", [
    ("steady", OSCILLATOR, {}), ("floquet", OSCILLATOR, {}),
])
def test_each_kind_runs_confined(daemon, kind, scene, options):
    daemon.next("READY")
    daemon.run_scene("k", kind, scene, options)
    verb, header, document, _ = daemon.answer("k")
    assert verb == "DONE" and document, header


def test_more_blas_threads_start_within_the_walls(daemon):
    daemon.next("READY")
    daemon.run("t", "identify", decay(2000), {"threads": 2, "rank.fixed": 2})
    verb, header, _, _ = daemon.answer("t")
    assert verb == "DONE", header


def test_the_heart_beats_with_the_job_while_it_works(daemon):
    daemon.next("READY")
    daemon.run_scene("long", "simulate", {**OSCILLATOR, "time": {"dt": 1e-6, "duration": 30.0}})
    verb, header = "BEAT", {}
    while verb == "BEAT" and header == {}:                  # of before it began
        verb, header, _ = daemon.next("BEAT", "PART", "DONE", "FAILED")
    # a machine on which it ends within a second tells nothing
    assert verb in ("PART", "DONE") or (verb, header) == ("BEAT", {"job": "long", "attempt": 1})


LUA = [("", "DONE"), ("io.open('/etc/passwd')", "FAILED"), ("os.execute('true')", "FAILED"),
       ("os.exit(3)", "FAILED"),
       ("require('socket')", "FAILED"), ("dofile('/etc/passwd')", "FAILED")]


def test_a_lua_force_reaches_neither_files_nor_programs_nor_the_network(daemon):
    for attack, expected in LUA:
        daemon.next("READY")
        source = f"function force(t, x, v, memory) {attack}; return 0.1 * x^3 end"
        daemon.run_scene("l", "steady",
                         {**OSCILLATOR, "effects": [{"type": "lua", "dof": "x1",
                                                     "source": source}]})
        verb, header, _, _ = daemon.answer("l")
        assert verb == expected, (attack, header)
        assert expected == "DONE" or header["error"]["code"] == "element_failed", (attack, header)
        assert daemon.process.poll() is None


@pytest.mark.skipif(b"__asan_init" in WORKER.read_bytes(),
                    reason="a sanitizer's shadow is larger than any limit")
def test_a_job_that_wants_more_memory_than_it_may_have_fails_with_the_limit_and_the_worker_lives():
    daemon = Daemon("--memory", str(400 << 20))
    for _ in range(2):
        daemon.next("READY")
        # 90,000,001 samples: 720 MB
        daemon.run_scene("m", "simulate", {**OSCILLATOR, "time": {"dt": 1e-6, "duration": 90.0}})
        verb, header, _, _ = daemon.answer("m")
        assert verb == "FAILED" and header["error"]["code"] == "no_memory", header
        assert "a worker has at most 419430400 bytes (worker_memory)" in header["error"]["message"]
    daemon.next("READY")
    daemon.run("a", "identify", decay(), {"rank.fixed": 2})
    assert daemon.answer("a")[0] == "DONE"
    daemon.close()
