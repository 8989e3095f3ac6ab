"""The machine under the daemon: a slow disk (F8), no descriptors left (F9), a clock that jumps
(F15), no processor to spare (F22), files that may not grow.
"""
import collections
import os
import pathlib
import shutil
import signal
import struct
import subprocess
import sys
import threading
import time

import pytest

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "system"))
import sanitized  # noqa: E402
from wire import BUILD, Client, Daemon, crc32c, submit, until  # noqa: E402

FAKE = f"worker_path = {HERE.parent / 'system' / 'fake_worker.py'}\n"
CLOCK = BUILD / "fault" / "libclock.so"


@pytest.mark.skipif(shutil.which("strace") is None, reason="strace is not installed")
def test_a_slow_disk_delays_only_what_needs_it(tmp_path):
    """A second a sync: of the questions that memory answers a hundred fit between few syncs, no
    lease is lost, and each acknowledgement still waits for its sync.
    """
    wrap = ["strace", "-f", "--seccomp-bpf", "-qq", "-o", "/dev/null", "-e",
            "trace=fdatasync,fsync", "-e", "inject=fdatasync,fsync:delay_enter=1000000"]
    with Daemon(folder=tmp_path, config=FAKE + "lease_s = 10\n", wrap=wrap) as d:
        writer, reader, acked, stop = d.client(), d.client(), [], threading.Event()

        def submits():
            while not stop.is_set():
                begin = time.perf_counter()
                numbers = [writer.send("SUBMIT", [bytes(128)], kind="identify",
                                       options={"n": [len(acked), i]},
                                       input={"content": "batch", "samples": 16, "channels": 1,
                                              "dt": 1})
                           for i in range(20)]
                assert all(writer.answer(n).ok for n in numbers)
                acked.append(time.perf_counter() - begin)
        thread = threading.Thread(target=submits, daemon=True)
        thread.start()
        until(lambda: acked)
        between = collections.Counter()
        for _ in range(100):
            assert reader.ask("STATS").ok
            between[len(acked)] += 1
        stop.set()
        thread.join(120)
        assert "event=lease" not in d.text()
        most = max(between.values())
        print(f"\nF8: 1 s a sync: 100 reads, {most} of them between two acknowledgements of 20 "
              f"submissions, each after {min(acked):.2f} s or more")
        # of reads that waited for a sync there would be one or two
        assert most > 4 and min(acked) > 1


@pytest.mark.skipif(sanitized.SANITIZED, reason="no library is loaded before the sanitizer's")
@pytest.mark.parametrize("cut, kill", [("100", False), ("4120", False), ("all", False),
                                       (None, True), ("all", True)])
def test_a_log_cut_between_a_commit_and_what_follows_takes_nothing_acknowledged(tmp_path, cut,
                                                                                kill):
    """A group's commit is synced, and the log is shortened before the daemon looks at it again: the
    group is not acknowledged.  What was before is there, or is told to be lost."""
    env = {"LD_PRELOAD": str(BUILD / "fault" / "libcut.so"), "CUT_AT": "9",
           **({"CUT_BYTES": cut} if cut else {}), **({"CUT_KILL": "1"} if kill else {})}
    acked = {}
    with Daemon(folder=tmp_path, config=FAKE, workers=0, env=env) as d:
        c = d.client()
        for k in range(12):
            number = c.send("SUBMIT", [struct.pack("<d", k) + bytes(120)], kind="identify",
                            options={}, key=f"k{k}", input={"content": "batch", "samples": 16,
                                                            "channels": 1, "dt": 1})
            until(lambda: c.socket.poll(50) or d.process.poll() is not None)
            if not c.socket.poll(0):
                break
            acked[f"k{k}"] = c.answer(number)["job"]
        c.close()
        assert d.process.poll() is not None and (kill or "made shorter" in d.text())
        assert 0 < len(acked) < 12
    if cut == "all":
        with pytest.raises(RuntimeError, match="acknowledged"):
            Daemon(folder=tmp_path, config=FAKE, workers=0)
        return
    with Daemon(folder=tmp_path, config=FAKE, workers=0) as d:
        c = d.client()
        assert {key: c.ask("STATUS", job=f"key:{key}").get("job") for key in acked} == acked


def test_a_limit_on_the_size_of_files_is_a_full_disk_and_ends_nothing():
    """RLIMIT_FSIZE of 1 MB, whose signal ended the daemon without a word; what was acknowledged
    stays, and what comes when the limit is gone is taken."""
    def limit(most):
        subprocess.run(["prlimit", "--pid", str(d.pid), f"--fsize={most}:"], check=True)

    with Daemon(config=FAKE, workers=0) as d:
        c = d.client()
        first = submit(c, key="first")["job"]
        limit(1000000)
        told = [c.ask("SUBMIT", [bytes(8 * i) + struct.pack("<d", i) + bytes(8 * (7999 - i))],
                      kind="identify", input={"content": "batch", "samples": 8000, "channels": 1,
                                              "dt": 1}).code for i in range(40)]
        assert set(told) == {None, "storage_full"}, told
        assert c.ask("STATUS", job=first)["state"] == "queued" and c.ask("STATS").ok
        limit("unlimited")
        until(lambda: submit(c, key="last").ok)
        d.kill()
        d.start()
        c = d.client()
        assert c.ask("STATUS", job="key:first")["job"] == first
        assert c.ask("STATS")["jobs"]["queued"] == 2 + told.count(None)


def test_a_fifo_in_the_place_of_a_file_of_the_data_folder_is_refused_by_name(tmp_path):
    """Whoever opens one waits for who opens its other end: the start never ended."""
    with Daemon(folder=tmp_path, config=FAKE, workers=0) as d:
        submit(d.client(), key="kept")
        d.kill()
        for name in ("LOCK", "RESERVE", "tape", "ledger.db", "ledger.db-wal", "ledger.db-shm",
                     "ledger.db-journal"):
            place, kept = tmp_path / "data" / name, tmp_path / "kept"
            if place.exists():
                place.rename(kept)
            os.mkfifo(place)
            d.start(ready=False)
            assert d.process.wait(120) == 1 and f"{name} is no file" in d.text(), name
            d.log.close()
            place.unlink(missing_ok=True)
            if kept.exists():
                kept.rename(place)
        d.start()
        assert d.client().ask("STATUS", job="key:kept")["state"] == "queued"


def test_a_log_that_nobody_reads_stops_nobody_and_tells_what_it_dropped(tmp_path):
    """stderr is a pipe of 64 KiB; the daemon stood still when it was full.  Every line is in it at
    last, or counted.
    """
    read, write = os.pipe()
    (tmp_path / "conf").write_text(FAKE)
    command = [BUILD / "bin" / "modald", "--data", tmp_path / "data", "--bind",
               f"ipc://{tmp_path}/s", "--workers", "0", "--config", tmp_path / "conf"]
    process = subprocess.Popen([str(word) for word in command], stderr=write)
    try:
        c, said = Client(f"ipc://{tmp_path}/s"), b""
        jobs = [c.answer(c.send("SUBMIT", [struct.pack("<d", i) + bytes(120)], kind="identify",
                                options={"until": "never"}, key=f"{i:0120d}",
                                input={"content": "batch", "samples": 16, "channels": 1,
                                       "dt": 1}))["job"] for i in range(1500)]
        assert c.ask("STATS")["jobs"]["queued"] == len(jobs)
        os.set_blocking(read, False)

        def is_told():
            nonlocal said
            try:
                said += os.read(read, 1 << 20)
            except BlockingIOError:
                pass
            return b"event=log_dropped" in said
        until(is_told)
        lines = [line for line in said.decode().splitlines() if "event=edge" in line]
        dropped = int(said.decode().split("event=log_dropped lines=")[1].split()[0])
        assert len(lines) + dropped == len(jobs) and len(lines) > 0 and dropped > 0
        assert c.ask("CANCEL", job=jobs[0]).ok
        until(lambda: is_told() and f"job={jobs[0]} user=local kind=identify from=queued "
              "to=cancelled" in said.decode())
        c.close()
        process.send_signal(signal.SIGTERM)
        assert process.wait(120) == 0
        os.set_blocking(write, False)
    finally:
        process.kill()
        process.wait()
        os.close(read)
        os.close(write)


def test_a_stray_signal_is_told_and_ends_nothing():
    with Daemon(config=FAKE, workers=0) as d:
        strays = [signal.SIGUSR1, signal.SIGUSR2, signal.SIGALRM, signal.SIGVTALRM, signal.SIGPROF,
                  signal.SIGIO, signal.SIGPWR, signal.SIGXCPU, signal.SIGSTKFLT,
                  signal.SIGRTMIN, signal.SIGRTMAX, signal.SIGPIPE, signal.SIGHUP]
        for number in strays:
            os.kill(d.pid, number)
            assert d.client().ask("HELLO").ok, number
        for number in strays[:-2]:
            until(lambda number=number: f"event=signal number={int(number)} " in d.text())


@pytest.mark.skipif(sanitized.SANITIZED, reason="the sanitizer has descriptors of its own")
def test_too_few_open_files_are_refused_at_the_start_and_enough_serve_a_client(tmp_path):
    """Of 24 a daemon that was ready ended at its first read; as many as it asks for do."""
    with Daemon(folder=tmp_path, config=FAKE, workers=2) as d:
        d.stop()
        d.wrap = ["prlimit", "--nofile=24"]
        d.start(ready=False)
        assert d.process.wait(120) == 1
        d.log.close()
        told = d.text().rpartition("24 files may be open at once")[2]
        needed = int(told.split("one client need ")[1].split(",")[0])
        d.wrap = ["prlimit", f"--nofile={needed - 1}"]
        d.start(ready=False)
        assert d.process.wait(120) == 1
        d.log.close()
        d.wrap = ["prlimit", f"--nofile={needed}"]
        d.start()
        c = d.client()
        jobs = [submit(c, phase=0.1 * i)["job"] for i in range(4)]
        assert all(c.ask("WAIT", job=job, timeout_s=250)["state"] == "done" for job in jobs)
        assert all(c.ask("RESULT", job=job).ok for job in jobs)


def descriptors(d):
    return len(os.listdir(f"/proc/{d.pid}/fd"))


def test_without_descriptors_the_daemon_serves_who_is_there_and_recovers():
    """The limit is set to what is open: no connection, no upload, no new worker, but answers, and
    jobs of the warm worker; a push waits.
    """
    with Daemon(config=FAKE, workers=1) as d:
        c = d.client()
        assert c.ask("WAIT", job=submit(c)["job"], timeout_s=250)["state"] == "done"
        begin = dict(content="batch", samples=100000, channels=1, dt=1)
        stream, rows = c.ask("STREAM", op="open", name="patient", channels=1,
                             dt=1)["stream"], bytes(80)
        most = int(subprocess.run(["prlimit", "--pid", str(d.pid), "--nofile", "--noheadings",
                                   "--raw", "-o", "SOFT"], capture_output=True, text=True,
                                  check=True).stdout)
        subprocess.run(["prlimit", "--pid", str(d.pid), f"--nofile={descriptors(d)}:"], check=True)
        served = submit(c, phase=0.25)
        assert c.ask("WAIT", job=served["job"], timeout_s=250)["state"] == "done"
        refused = c.ask("UPLOAD", op="begin", key="large", **begin)
        assert refused.code in ("busy", "storage_full"), refused
        os.kill(d.children()[0], 9)
        queued = submit(c, phase=0.5)
        assert queued.ok and c.ask("STATS").ok
        pushed = c.send("STREAM", [rows], op="push", stream=stream, epoch=0, first=0, count=10,
                        crc32c=crc32c(rows))
        newcomer = d.client()
        asked = newcomer.send("HELLO")
        time.sleep(1)
        assert d.process.poll() is None and c.ask("STATS").ok
        subprocess.run(["prlimit", "--pid", str(d.pid), f"--nofile={most}:"], check=True)
        assert newcomer.answer(asked).ok and c.answer(pushed)["next"] == 10
        assert c.ask("WAIT", job=queued["job"], timeout_s=250)["state"] == "done"
        assert c.ask("UPLOAD", op="begin", key="large", **begin).ok
        print("\nF9: no descriptor left: 0 jobs lost, all served again afterwards")


@pytest.mark.skipif(sanitized.SANITIZED, reason="a preloaded library comes before the sanitizer's")
def test_a_clock_that_jumps_neither_ends_nor_prolongs_a_lease_a_limit_or_a_wait(tmp_path):
    """P10: a day and an hour back and forwards, while a job runs, two wait for their deadlines, and
    a client waits.
    """
    step = tmp_path / "step"
    step.write_text("0")
    with Daemon(folder=tmp_path, config=FAKE + "lease_s = 10\n",
                env={"LD_PRELOAD": str(CLOCK), "CLOCK_STEP": str(step)}) as d:
        c, gate = d.client(), d.gate()
        began = submit(c, options=gate.options, run_limit_s=3000)["job"]
        until(lambda: c.ask("STATUS", job=began)["state"] == "running")
        patient = submit(c, options={"say": "in time"}, deadline_s=3000)["job"]
        soon = submit(c, options={"say": "too late"}, deadline_s=2)["job"]
        # by this clock the rest of all limits is a day longer
        step.write_text("-86400      ")
        assert c.ask("WAIT", job=soon, timeout_s=250)["error"]["code"] == "deadline"
        assert c.ask("WAIT", job=began, timeout_s=0.5)["state"] == "running"
        for seconds in (3600, -3600, 86400, -86400, 0):
            step.write_text(f"{seconds}      ")          # and by this one long over
            for job, state, attempts in ((began, "running", 1), (patient, "queued", 0)):
                now = c.ask("STATUS", job=job)
                assert (now["state"], now["attempts"]) == (state, attempts)
            assert c.ask("WAIT", job=began, timeout_s=0.1)["state"] == "running"
        gate.open()
        for job in (began, patient):
            done = c.ask("WAIT", job=job, timeout_s=250)
            assert (done["state"] == "done" and done["attempts"] == 1
                    and "event=lease" not in d.text())
        print("\nP10: 6 jumps of the clock, 0 violations")


@pytest.mark.skipif(sanitized.SANITIZED, reason="a preloaded library comes before the sanitizer's")
@pytest.mark.parametrize("seconds", [-2**31, 2**33])
def test_by_a_clock_before_1970_or_past_2262_jobs_are_done(tmp_path, seconds):
    """A job without a time has 0, and nanoseconds in 64 bits end in 2262."""
    step = tmp_path / "step"
    step.write_text(f"{seconds}      ")
    with Daemon(folder=tmp_path, config=FAKE,
                env={"LD_PRELOAD": str(CLOCK), "CLOCK_STEP": str(step)}) as d:
        c = d.client()
        job = submit(c)["job"]
        late = submit(c, options={"say": "later"}, deadline_s=3000)["job"]
        for one in (job, late):
            assert c.ask("WAIT", job=one, timeout_s=250)["state"] == "done"
        assert d.stop() == 0


def test_leases_hold_while_four_spinners_have_the_processors():
    """F22: at nice 0 against workers at nice 10; the daemon answers, and the worker's heartbeats
    come through: two leases' time and more.
    """
    lease_s = 8
    with Daemon(config=FAKE + f"lease_s = {lease_s}\n", workers=1) as d:
        c, gate = d.client(), d.gate()
        spinners = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(4)]
        try:
            job = submit(c, options=gate.options)["job"]
            until(lambda: c.ask("STATUS", job=job)["state"] == "running")
            end = time.monotonic() + 2.5 * lease_s
            while time.monotonic() < end:
                assert c.ask("STATS").ok
                time.sleep(0.1)
            gate.open()
            done = c.ask("WAIT", job=job, timeout_s=250)
        finally:
            for one in spinners:
                one.kill()
                one.wait()
        assert done["state"] == "done" and done["attempts"] == 1 and "event=lease" not in d.text()
