"""The machine under the daemon: a slow disk (F8), no descriptors left (F9), a clock that jumps (F15), no processor to spare (F22)."""
import os
import pathlib
import shutil
import statistics
import subprocess
import sys
import threading
import time

import pytest

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "system"))
import sanitized  # noqa: E402
from wire import BUILD, Daemon, crc32c, submit  # noqa: E402

FAKE = f"worker_path = {HERE.parent / 'system' / 'fake_worker.py'}\n"
CLOCK = BUILD / "fault" / "libclock.so"


def until(predicate, seconds=20):
    end = time.monotonic() + seconds
    while not predicate():
        assert time.monotonic() < end, "it did not become true"
        time.sleep(0.01)


def answered_ms(client, count=100):
    """How long each of COUNT questions that memory can answer took, ascending."""
    out = []
    for _ in range(count):
        begin = time.perf_counter()
        assert client.ask("STATS").ok
        out.append((time.perf_counter() - begin) * 1e3)
        time.sleep(0.005)
    return sorted(out)


@pytest.mark.skipif(shutil.which("strace") is None, reason="strace is not installed")
def test_a_disk_of_300_ms_a_sync_delays_only_what_needs_it(tmp_path):
    """Reads are answered within 50 ms, no lease is lost, and each acknowledgement still waits for its sync."""
    wrap = ["strace", "-f", "--seccomp-bpf", "-qq", "-o", "/dev/null", "-e", "trace=fdatasync,fsync", "-e", "inject=fdatasync,fsync:delay_enter=300000"]
    with Daemon(folder=tmp_path, config=FAKE + "lease_s = 1.5\n", wrap=wrap) as d:
        writer, reader, acked, stop = d.client(timeout_s=60), d.client(timeout_s=60), [], threading.Event()

        def submits():
            while not stop.is_set():
                begin = time.perf_counter()
                numbers = [writer.send("SUBMIT", [bytes(128)], kind="identify", options={"n": [len(acked), i]}, input={"content": "batch", "samples": 16, "channels": 1, "dt": 1})
                           for i in range(20)]
                assert all(writer.answer(n).ok for n in numbers)
                acked.append(time.perf_counter() - begin)
        thread = threading.Thread(target=submits, daemon=True)
        thread.start()
        until(lambda: acked)
        read = answered_ms(reader)
        stop.set()
        thread.join(60)
        assert "event=lease" not in d.text()
        print(f"\nF8: 300 ms a sync: reads {statistics.median(read):.2f} ms, 95 of 100 within {read[94]:.1f} ms; 20 submissions acknowledged in {statistics.median(acked):.2f} s")
        assert read[94] < 50 and min(acked) > 0.3


def descriptors(d):
    return len(os.listdir(f"/proc/{d.pid}/fd"))


def test_without_descriptors_the_daemon_serves_who_is_there_and_recovers():
    """The limit is set to what is open: no connection, no upload, no new worker, but answers, and jobs of the warm worker; a push waits."""
    with Daemon(config=FAKE, workers=1) as d:
        c = d.client()
        assert c.ask("WAIT", job=submit(c)["job"], timeout_s=20)["state"] == "done"
        begin = dict(content="batch", samples=100000, channels=1, dt=1)
        stream, rows = c.ask("STREAM", op="open", name="patient", channels=1, dt=1)["stream"], bytes(80)
        most = int(subprocess.run(["prlimit", "--pid", str(d.pid), "--nofile", "--noheadings", "--raw", "-o", "SOFT"], capture_output=True, text=True, check=True).stdout)
        subprocess.run(["prlimit", "--pid", str(d.pid), f"--nofile={descriptors(d)}:"], check=True)
        served = submit(c, phase=0.25)
        assert c.ask("WAIT", job=served["job"], timeout_s=20)["state"] == "done"
        refused = c.ask("UPLOAD", op="begin", key="large", **begin)
        assert refused.code in ("busy", "storage_full"), refused
        os.kill(d.children()[0], 9)
        queued = submit(c, phase=0.5)
        assert queued.ok and c.ask("STATS").ok
        pushed = c.send("STREAM", [rows], op="push", stream=stream, epoch=0, first=0, count=10, crc32c=crc32c(rows))
        newcomer = d.client()
        asked = newcomer.send("HELLO")
        time.sleep(1)
        assert d.process.poll() is None and c.ask("STATS").ok
        subprocess.run(["prlimit", "--pid", str(d.pid), f"--nofile={most}:"], check=True)
        assert newcomer.answer(asked).ok and c.answer(pushed)["next"] == 10
        assert c.ask("WAIT", job=queued["job"], timeout_s=30)["state"] == "done"
        assert c.ask("UPLOAD", op="begin", key="large", **begin).ok
        print("\nF9: no descriptor left: 0 jobs lost, all served again afterwards")


@pytest.mark.skipif(sanitized.SANITIZED, reason="a preloaded library comes before the sanitizer's")
def test_a_clock_that_jumps_neither_ends_nor_prolongs_a_lease_a_limit_or_a_wait(tmp_path):
    """P10: an hour and a day forwards and back, while a job runs, one waits for its deadline, and a client waits."""
    step = tmp_path / "step"
    step.write_text("0")
    with Daemon(folder=tmp_path, config=FAKE + "lease_s = 1.5\n", env={"LD_PRELOAD": str(CLOCK), "CLOCK_STEP": str(step)}) as d:
        c = d.client()
        began = submit(c, options={"sleep": 4}, run_limit_s=30)["job"]
        until(lambda: c.ask("STATUS", job=began)["state"] == "running")
        late = submit(c, options={"say": "too late"}, deadline_s=2)["job"]
        begin = time.monotonic()
        for seconds in (3600, -3600, 86400, -86400, 0):
            step.write_text(f"{seconds}      ")
            now = c.ask("STATUS", job=began)
            assert now["state"] == "running" and now["attempts"] == 1
            time.sleep(0.1)
        asked = c.ask("WAIT", job=began, timeout_s=0.5)
        assert asked["state"] == "running" and time.monotonic() - begin < 2
        ended = c.ask("WAIT", job=late, timeout_s=20)
        assert ended["error"]["code"] == "deadline" and 1.5 < time.monotonic() - begin < 3.8
        done = c.ask("WAIT", job=began, timeout_s=20)
        assert done["state"] == "done" and done["attempts"] == 1 and "event=lease" not in d.text()
        print("\nP10: 5 jumps of the clock, 0 violations")


def test_leases_hold_while_four_spinners_have_the_processors():
    """F22: at nice 0 against workers at nice 10; the daemon answers, and the worker's heartbeats come through."""
    with Daemon(config=FAKE + "lease_s = 3\n", workers=1) as d:
        c = d.client()
        spinners = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(4)]
        try:
            job = submit(c, options={"sleep": 5})["job"]
            took = answered_ms(c, 200)
            done = c.ask("WAIT", job=job, timeout_s=60)
        finally:
            for one in spinners:
                one.kill()
                one.wait()
        print(f"\nF22: 4 spinners: answers {statistics.median(took):.2f} ms, 95 % within {took[189]:.1f} ms")
        assert done["state"] == "done" and done["attempts"] == 1 and "event=lease" not in d.text()
