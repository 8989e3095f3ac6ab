"""The daemon and the machine around it: the service manager, leases, the metrics file, the command
line.
"""
# Tests as well: daemon.c ledger_thread.c loop.c loop_log.c notify.c peers.c pool.c
import json
import math
import os
import pathlib
import re
import signal
import socket
import struct
import subprocess
import time

import pytest
import zmq

from wire import (BUILD, PATIENCE_S, Client, Daemon, crc32c, executed, identity, submit, until,
                  woken)

HERE = pathlib.Path(__file__).parent
FAKE = f"worker_path = {HERE / 'fake_worker.py'}\n"
MODALD = str(BUILD / "bin" / "modald")


def run(*arguments, **more):
    return subprocess.run([MODALD, *arguments], capture_output=True, text=True, timeout=PATIENCE_S,
                          **more)


def test_the_service_manager_hears_ready_watchdog_reload_and_stopping(tmp_path):
    heard = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    heard.bind(str(tmp_path / "notify"))
    heard.settimeout(PATIENCE_S)
    env = {"NOTIFY_SOCKET": str(tmp_path / "notify"), "WATCHDOG_USEC": "400000"}
    with Daemon(folder=tmp_path, config=FAKE, env=env) as d:
        assert heard.recv(200).startswith(b"READY=1")
        assert [heard.recv(200) for _ in range(3)] == [b"WATCHDOG=1"] * 3
        d.process.send_signal(signal.SIGHUP)
        until(lambda: heard.recv(200) == b"RELOADING=1")
        until(lambda: heard.recv(200) == b"READY=1")
        d.process.send_signal(signal.SIGTERM)
        until(lambda: heard.recv(200).startswith(b"STOPPING=1"))


def test_a_worker_that_falls_silent_loses_its_lease_and_the_job_runs_elsewhere():
    with Daemon(config=FAKE + "lease_s = 5\n", workers=2) as d:
        c, gate = d.client(), d.gate()
        job = submit(c, options=gate.options)["job"]
        until(lambda: c.ask("STATUS", job=job)["state"] == "running")
        before = d.children()
        for pid in before:
            os.kill(pid, signal.SIGSTOP)
        until(lambda: c.ask("STATUS", job=job)["attempts"] == 2, "the lease is not lost")
        gate.open()
        done = c.ask("WAIT", job=job, timeout_s=250)
        assert done["state"] == "done" and done["attempts"] == 2
        assert not set(before) & set(d.children())
        assert "event=lease" in d.text()


def test_the_children_of_a_killed_worker_are_gone_too(tmp_path):
    script = tmp_path / "parent.sh"
    script.write_text(f"#!/bin/sh\n[ -e {tmp_path}/child ] || {{ sleep 100 & echo $! > "
                      f"{tmp_path}/child; }}\nexec {HERE / 'fake_worker.py'} \"$@\"\n")
    script.chmod(0o755)
    with Daemon(config=f"worker_path = {script}\n", workers=1) as d:
        c = d.client()
        job = submit(c, options=d.gate().options)["job"]
        until(lambda: c.ask("STATUS", job=job)["state"] == "running")
        child = int((tmp_path / "child").read_text())
        os.kill(child, 0)
        assert c.ask("CANCEL", job=job)["state"] == "cancelled"
        until(lambda: executed(child) is None)


def test_a_workers_last_words_are_one_line_of_the_log():
    with Daemon(config=FAKE, workers=1) as d:
        c = d.client()
        assert (c.ask("WAIT",
                      job=submit(c, options={"say": 'the "end"\nlevel=forged',
                                             "die": True})["job"], timeout_s=250)["state"]
                == "dead")
        lines = [line for line in d.text().splitlines() if "event=worker_exit" in line]
        assert (len(lines) == 3 and all(r'status=9 said="the \"end\"\u000alevel=forged' in line
                                        for line in lines))


def test_the_log_says_where_a_job_came_from_and_what_it_took():
    with Daemon(config=FAKE, workers=1) as d:
        c = d.client()
        job = submit(c, options={"sleep": 0.3})["job"]
        assert c.ask("WAIT", job=job, timeout_s=PATIENCE_S)["state"] == "done"
        edge = f"event=edge job={job} "
        until(lambda: d.text().count(edge) == 3)
        edges = [line for line in d.text().splitlines() if edge in line]
        assert edges[0].endswith(f" peer=pid:{os.getpid()}")
        took = re.search(r" to=done attempts=1 wall_s=([0-9.]+) cpu_s=([0-9.]+)$", edges[2])
        assert took and 0.3 <= float(took[1]) < PATIENCE_S and float(took[2]) < PATIENCE_S
        assert not any("wall_s" in line or "peer=" in line for line in edges[1:2])


def test_the_metrics_file_is_written_whole(tmp_path):
    file = tmp_path / "modald.prom"
    with Daemon(config=FAKE + f"metrics_file = {file}\nmetrics_s = 0.2\n", workers=1) as d:
        c = d.client()
        c.ask("WAIT", job=submit(c)["job"], timeout_s=250)
        until(lambda: file.exists() and 'modald_jobs{state="done"} 1' in file.read_text())
        for line in file.read_text().splitlines():
            assert (line.startswith("# ")
                    or re.fullmatch(r'[a-z_]+(\{[a-z]+="[^"]*"\})? -?[0-9.e+-]+', line)), line


def test_version_and_check_config(tmp_path):
    assert re.fullmatch(r"modald \d+\.\d+\.\d+\n", run("--version").stdout)
    good, bad = tmp_path / "good", tmp_path / "bad"
    good.write_text(f"# a comment\ndata = {tmp_path}/d\nbind = \"ipc://{tmp_path}/s\"\nworkers = "
                    "3\nresult_bytes = 2G\n")
    assert run("--config", str(good), "--check-config").returncode == 0
    for line, said in (("workers = many", "workers"), ("wrokers = 3", "wrokers"),
                       ("workers", "key = value"), ("bind = tcp://*:1", "without keys"),
                       ("keys = /x", "server_key"), ("ipc_mode = 9999", "ipc_mode"),
                       ("sandbox = maybe", "on, off")):
        bad.write_text(f"data = {tmp_path}/d\n{line}\n")
        out = run("--config", str(bad), "--check-config",
                  env={**os.environ, "XDG_RUNTIME_DIR": str(tmp_path)})
        assert out.returncode == 2 and said in out.stderr, (line, out)


@pytest.mark.parametrize("lines, said", [
    ("workers = 1\nbind = ipc://@/s\nworkers = 2", "c:4: workers stands in line 2 too"),
    ("bind = tcp://127.0.0.1:99999", "a port from 0 to 65535"),
    ("bind = tcp://127.0.0.1:-1", "a port from 0 to 65535"),
    ("bind = tcp://127.0.0.1", "a port from 0 to 65535"),
    ("worker_bind = tcp://127.0.0.1:65536", "a port from 0 to 65535"),
    ("run_limit_s = 1e-10", "less than a nanosecond"),
    ("windows_elsewhere_s = 4.9e-324", "less than a nanosecond"),
    ("metrics_file = @/c", "something else in it"),
    ("metrics_file = /dev/null", "is no file"),
    ("metrics_file = @", "is no file"),
    ("server_key = @/pair\nkeys = @/keys", "keys:3: the key of user \"ann\" stands here again"),
])
def test_a_setting_that_would_be_taken_for_another_is_refused(lines, said, tmp_path):
    """Twice (the later was taken), a port beyond those there are (taken modulo 65536), a time that
    is rounded to none (no limit), a file of metrics over one that is something else."""
    key, other = (pair.decode() for pair in zmq.curve_keypair())
    (tmp_path / "keys").write_text(f"{key} ann read\n{other} bob read\n{key} ann admin\n")
    (tmp_path / "keys").chmod(0o600)
    (tmp_path / "pair").touch()
    c = tmp_path / "c"
    c.write_text(f"data = {tmp_path}/d\n" + lines.replace("@", str(tmp_path)) + "\n")
    out = run("--config", str(c), "--check-config",
              env={**os.environ, "XDG_RUNTIME_DIR": str(tmp_path)})
    assert out.returncode == 2 and said in out.stderr, out


def test_an_endpoint_where_a_file_lies_is_refused_and_the_file_stays(tmp_path):
    file = tmp_path / "results.csv"
    file.write_text("1, 2\n")
    out = run("--data", str(tmp_path / "d"), "--bind", f"ipc://{file}")
    assert out.returncode == 2 and "something else than a socket" in out.stderr, out
    assert file.read_text() == "1, 2\n"


@pytest.mark.parametrize("name, value", [
    ("WATCHDOG_USEC", "-400000"), ("WATCHDOG_USEC", "0"), ("WATCHDOG_USEC", ""),
    ("WATCHDOG_USEC", "400000us"), ("WATCHDOG_USEC", "9223372036854775807"),
    ("WATCHDOG_USEC", "18446744073709551616"), ("WATCHDOG_PID", "me")])
def test_a_watchdog_s_time_that_is_none_is_refused_at_the_start(name, value, tmp_path):
    env = {**os.environ, "WATCHDOG_USEC": "400000", name: value}
    out = run("--data", str(tmp_path / "d"), "--bind", f"ipc://{tmp_path}/s", env=env)
    assert out.returncode == 2 and f"${name} is" in out.stderr, out


def test_the_watchdog_of_another_process_is_none_of_ours(tmp_path):
    heard = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    heard.bind(str(tmp_path / "notify"))
    heard.settimeout(PATIENCE_S)
    env = {"NOTIFY_SOCKET": str(tmp_path / "notify"), "WATCHDOG_USEC": "1000", "WATCHDOG_PID": "1"}
    with Daemon(folder=tmp_path, config=FAKE, env=env) as d:
        assert heard.recv(200).startswith(b"READY=1")
        c = d.client()
        c.ask("WAIT", job=submit(c)["job"], timeout_s=250)
        d.process.send_signal(signal.SIGTERM)
        assert heard.recv(200).startswith(b"STOPPING=1")


def in_group(name, gid, tmp_path):
    """A wrapper under which group GID is called NAME: /etc/group of a mount namespace of its own.
    """
    if (os.geteuid() != 0 or subprocess.run(["unshare", "-m", "true"],
                                            capture_output=True).returncode != 0):
        pytest.skip("needs root and a mount namespace")
    groups = [line for line in pathlib.Path("/etc/group").read_text().splitlines()
              if line.split(":")[0] != name]
    (tmp_path / "group").write_text("\n".join(groups) + f"\n{name}:x:{gid}:\n")
    script = (f'mount --bind {tmp_path}/group /etc/group && exec setpriv --regid={gid} '
              '--clear-groups "$@"')
    return ["unshare", "-m", "sh", "-c", script, "sh"]


@pytest.mark.parametrize("name, line, mode",
                         [("modald", "", "0o660"), ("staff9", "", "0o600"),
                          ("modald", "ipc_mode = 0600\n", "0o600"),
                                              ("staff9", "ipc_mode = 0660\n", "0o660")])
def test_the_group_modald_may_open_the_socket_of_a_daemon_of_that_group_and_no_other_unless_told(
    tmp_path, name, line, mode):
    gid = 61234
    with Daemon(folder=tmp_path, config=FAKE + line, workers=0,
                wrap=in_group(name, gid, tmp_path)) as d:
        known = pathlib.Path(d.endpoint[6:]).stat()
        assert (known.st_gid, oct(known.st_mode & 0o777)) == (gid, mode)


def test_the_socket_of_a_daemon_of_ones_own_is_private_and_ready_names_every_endpoint(tmp_path):
    with Daemon(folder=tmp_path, config=FAKE, workers=0, endpoint=f"ipc://{tmp_path}/a.ipc") as d:
        assert (oct((tmp_path / "a.ipc").stat().st_mode & 0o777) == "0o600"
                and f"endpoint=ipc://{tmp_path}/a.ipc " in d.text())
    with Daemon(folder=tmp_path, config=FAKE, endpoint=f"ipc://{tmp_path}/a.ipc",
                wrap=["sh", "-c", f'exec "$@" --bind ipc://{tmp_path}/b.ipc', "sh"]) as d:
        assert f"endpoint=ipc://{tmp_path}/a.ipc,ipc://{tmp_path}/b.ipc " in d.text()


@pytest.mark.parametrize("arguments", [[], ["--data"], ["--data", "x", "y"], ["--speed", "9"],
                                       ["--data", "x", "--workers", "-1"]])
def test_wrong_usage_ends_with_2_and_says_why(arguments):
    out = run(*arguments)
    assert out.returncode == 2 and out.stderr


def test_the_default_endpoint_works_without_root(tmp_path):
    process = subprocess.Popen([MODALD, "--data", str(tmp_path / "data"), "--workers", "0"],
                               stderr=subprocess.DEVNULL,
                               env={**os.environ, "XDG_RUNTIME_DIR": str(tmp_path)})
    try:
        endpoint = tmp_path / "modald" / "modald.ipc"
        until(endpoint.exists)
        assert Client(f"ipc://{endpoint}").ask("HELLO").ok
        assert endpoint.stat().st_mode & 0o777 == 0o600
    finally:
        process.terminate()
        assert process.wait(PATIENCE_S) == 0


def test_a_data_folder_with_a_long_path_works():
    import tempfile
    with tempfile.TemporaryDirectory() as top:
        deep = pathlib.Path(top) / ("x" * 60) / ("y" * 60)
        deep.mkdir(parents=True)
        with Daemon(folder=deep, config=FAKE, endpoint=f"ipc://{top}/s.ipc") as d:
            c = d.client()
            assert c.ask("WAIT", job=submit(c)["job"], timeout_s=250)["state"] == "done"


def test_an_endpoint_where_another_daemon_listens_is_refused(tmp_path):
    with Daemon(config=FAKE, endpoint=f"ipc://{tmp_path}/one.ipc") as d:
        with pytest.raises(RuntimeError, match="another daemon"):
            Daemon(config=FAKE, endpoint=f"ipc://{tmp_path}/one.ipc")
        assert d.client().ask("HELLO").ok


def test_a_workers_process_is_replaced_after_its_share_of_jobs_and_none_is_lost():
    with Daemon(config=FAKE + "worker_jobs = 3\n") as d:
        c, pids = d.client(), set()
        for i in range(8):
            job = submit(c, options={"say": f"n{i}"})["job"]
            done = c.ask("WAIT", job=job, timeout_s=250)
            assert (done["state"], done["attempts"]) == ("done", 1)
            pids |= set(d.children())
        assert len(pids) >= 3 and "event=worker_exit" not in d.text()


def resident_mb(pid):
    lines = pathlib.Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmRSS:")) / 1000


@pytest.mark.skipif("asan" in str(BUILD), reason="the sanitizers' shadow is counted too")
def test_the_daemon_has_at_most_30_mb_at_rest_and_again_after_load():
    """Load: 3,000 jobs with inputs of their own and 64 MB of chunks; a moment later all but what
    must be known of the jobs is given back.
    """
    with Daemon(config=FAKE, workers=0) as d:
        assert resident_mb(d.pid) <= 30
        c, piece = d.client(), os.urandom(262144)
        check = crc32c(piece)
        upload = c.ask("UPLOAD", op="begin", content="batch", samples=len(piece) * 256 // 8,
                       channels=1, dt=1)["upload"]
        for first in range(0, 256, 16):
            asked = [c.send("UPLOAD", [piece], op="chunk", upload=upload, offset=i * len(piece),
                            crc32c=check) for i in range(first, first + 16)]
            assert all(c.answer(number).ok for number in asked)
        job = {"kind": "identify", "input": {"content": "batch", "samples": 64, "channels": 1,
                                             "dt": 1}}
        for first in range(0, 3000, 250):
            answer = c.ask("SUBMITS", [os.urandom(512 * 250)],
                           jobs=[{**job, "key": f"k{i}"} for i in range(first, first + 250)])
            assert all("job" in part for part in json.loads(answer.body[0])["jobs"])
        until(lambda: resident_mb(d.pid) <= 30)
        for first in range(0, 3000, 500):
            asked = [c.send("CANCEL", job=f"key:k{i}") for i in range(first, first + 500)]
            assert all(c.answer(number)["state"] == "cancelled" for number in asked)
        until(lambda: resident_mb(d.pid) <= 30)


def test_files_without_a_row_go_at_the_next_start_and_files_with_one_stay():
    """A crash between a file and its row leaves the file; one between a row's end and its file's,
    too.
    """
    samples = bytes(8 * 1000)
    with Daemon(config=FAKE) as d:
        data = d.folder / "data"
        c = d.client()
        opened = c.ask("UPLOAD", op="begin", content="batch", samples=1000, channels=1,
                       dt=1)["upload"]
        assert c.ask("UPLOAD", [samples], op="chunk", upload=opened, offset=0,
                     crc32c=crc32c(samples)).ok
        sealed = c.ask("UPLOAD", op="begin", content="batch", samples=1000, channels=1,
                       dt=2)["upload"]
        assert c.ask("UPLOAD", [samples], op="chunk", upload=sealed, offset=0,
                     crc32c=crc32c(samples)).ok
        kept = identity(1000, 1, 2.0, samples)
        assert c.ask("UPLOAD", op="seal", upload=sealed, sha256=kept).ok
        assert d.stop() == 0
        stray = [data / "spool" / "777777.part", data / "spool" / "777778.h5",
                 data / "results" / "777779.json"]
        for path in stray:
            path.write_bytes(b"x" * 4096)
        before = sorted(p.name for p in (data / "spool").iterdir() if p not in stray)
        d.start()
        assert (not any(path.exists() for path in stray)
                and d.text().count("event=orphan_removed") == 3)
        assert len(before) == 2 and sorted(p.name for p in (data / "spool").iterdir()) == before
        c = d.client()
        assert c.ask("UPLOAD", op="seal", upload=opened, sha256=identity(1000, 1, 1.0, samples)).ok
        assert c.ask("SUBMIT", kind="identify", input={"sha256": kept}).ok


def test_an_idle_daemon_wakes_for_its_workers_heartbeats_and_little_else():
    """A beat a second of its worker wakes a thread or two of libzmq's and the loop; at 50 us a
    wake, 20 a second are a thousandth of a core.
    """
    with Daemon(config=FAKE, workers=1) as d:
        c = d.client()
        until(lambda: c.ask("STATS")["workers"]["alive"] == 1)
        time.sleep(1)
        before, begin = woken(d.pid), time.monotonic()
        time.sleep(10)
        assert woken(d.pid) - before <= 20 * (time.monotonic() - begin)


def test_a_job_whose_names_and_options_fill_two_headers_reaches_its_worker():
    """UPLOAD and SUBMIT may each bring 65536 bytes of header; RUN has both."""
    names = ["n" * 50 + str(k) for k in range(1000)]
    data = struct.pack("<40000d",
                       *[math.exp(-0.01 * i) * math.sin(0.1 * i * (k % 7 + 1)) for i in range(40)
                         for k in range(1000)])
    with Daemon(workers=1) as d:
        client = d.client()
        upload = client.ask("UPLOAD", op="begin", content="batch", samples=40, channels=1000,
                            dt=0.1, names=names)["upload"]
        for at in range(0, len(data), 262144):
            part = data[at:at + 262144]
            assert client.ask("UPLOAD", [part], op="chunk", upload=upload, offset=at,
                              crc32c=crc32c(part)).ok
        assert client.ask("UPLOAD", op="seal", upload=upload,
                          sha256=identity(40, 1000, 0.1, data, names=names)).ok
        job = client.ask("SUBMIT", kind="identify", options={"misspelt": "x" * 60000},
                         input={"upload": upload})["job"]
        ended = client.ask("WAIT", job=job, timeout_s=250)
        assert ((ended["state"], ended["error"]["code"], ended["error"]["field"],
                 ended["attempts"]) == ("failed", "bad_input", "misspelt", 1))


@pytest.mark.parametrize("name", ["LOCK", "RESERVE", "ledger.db", "ledger.db-wal", "ledger.db-shm",
                                  "tape"])
def test_a_link_in_the_data_folder_leads_the_daemon_to_write_over_nothing(name, tmp_path):
    """Whoever may write there had it write over any file of its user's."""
    (tmp_path / "another").write_text("another's" * 1000)
    (tmp_path / "data").mkdir(mode=0o750)
    (tmp_path / "data" / name).symlink_to(tmp_path / "another")
    done = run("--data", tmp_path / "data", "--bind", f"ipc://{tmp_path}/s")
    assert done.returncode == 1 and "is no file" in done.stderr, done.stderr
    assert (tmp_path / "another").read_text() == "another's" * 1000
