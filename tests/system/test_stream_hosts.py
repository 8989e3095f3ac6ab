"""Hosts that live dangerously (tests/fault/hosts.c), and hosts in other languages, with a stream
and without: the same output, the same exit status.

Each runs beside no daemon at all, beside one that listens, and with its ring in a file; where
nothing that the host does can disturb it, the stream's record is the host's log bit for bit.
"""
import contextlib
import os
import pathlib
import shutil
import signal
import socket
import subprocess
import time

import pytest
import zmq

import modald
import sanitized
from conftest import BUILD, PATIENCE, environment
from lab import Lab
from test_stream_faults import PIPE, is_sealed_as
from wire import Daemon, crc32c, identity

HOSTS = BUILD / "fault" / "hosts"
LIBRARY = BUILD / "lib" / "libmodald-stream.so.0"
HABITS = subprocess.run([str(HOSTS)], capture_output=True, text=True).stderr.splitlines()
STEPS, PACE = 1200, 0.0001
STREAMS = {"plain": "plain", "has handlers and masks": "signals",
           "counts its descriptors": "counts", "has few descriptors later": "fewer",
           "closes a pipe": "pipe",
           "changes folder": "folder", "becomes nobody": "nobody", "uses zmq": "zmq",
           "changes its environment": "environment", "forks children": "forks",
           "closes all descriptors": "closer", "pushes after close": "closed",
           "speaks with a comma": "comma"}


@pytest.fixture(scope="module")
def daemon():
    with Daemon(workers=1) as made:
        yield made


@pytest.fixture(scope="module")
def german(tmp_path_factory):
    """A folder with a language whose numbers have a comma."""
    folder = tmp_path_factory.mktemp("locale")
    if shutil.which("localedef"):
        subprocess.run(["localedef", "-i", "de_DE", "-f", "UTF-8", str(folder / "de_DE.UTF-8")],
                       capture_output=True)
    return folder


def begin(habit, folder, german, **env):
    more = {"MODALD_SPILL": folder, "MODALD_CLOSE_WAIT": "0.2", "HOSTS_LIBRARY": LIBRARY,
            "LOCPATH": german}
    return subprocess.Popen([str(HOSTS), habit, str(STEPS), str(PACE)], stdout=subprocess.PIPE,
                            stderr=subprocess.PIPE, cwd=folder,
                            env=environment(**{**more, **env}))


def end(host):
    out, err = host.communicate(timeout=PATIENCE)
    sanitized.hear(err.decode(errors="replace"))
    return host.returncode, out


def log_of(habit, out):
    """Of the host's output, what it pushed: half of it, where the other half came after a close."""
    if habit == "pushes after close":
        return out[:8 * STEPS]
    if habit == "closes all descriptors":                # the second half stands behind seven lines
        lines = out[8 * STEPS:].split(b"\n", 7)
        return out[:8 * STEPS] + lines[7][:8 * STEPS]
    if habit == "forks children":
        parts = out.split(b"child ")
        return b"".join(p[p.index(b"\n") + 1 if i else 0:][:2 * STEPS] for i, p in enumerate(parts))
    return out[:16 * STEPS]


@pytest.mark.parametrize("habit", HABITS)
def test_a_host_that_lives_dangerously_runs_as_without_a_stream(habit, daemon, german, tmp_path):
    if habit == "loads and unloads" and sanitized.SANITIZED:
        pytest.skip("a sanitized library is not loaded into a program")
    tmp_path.chmod(0o777)
    nobody, rings = f"ipc://{tmp_path}/nobody", tmp_path / "ring-%s"
    plain, absent, live, ring = (begin(habit, tmp_path, german, **env) for env in (
        {}, {"MODALD_URL": nobody}, {"MODALD_URL": daemon.endpoint, "MODALD_CLOSE_WAIT": "120"},
        {"MODALD_URL": nobody, "MODALD_RING_FILE": rings}))
    status, out = end(plain)
    assert status == 7 and (len(out) >= 16 * STEPS or habit == "opens and closes")
    if b"no such language here" in out:
        pytest.skip("no language with a comma can be made here")
    assert end(absent) == (status, out)
    assert end(ring) == (status, out)
    assert end(live) == (status, out)
    if habit in STREAMS:
        log = log_of(habit, out)
        if habit == "speaks with a comma":
            assert is_sealed_under(daemon, identity(len(log) // 16, 2, 0.0025, log, period=0.125,
                                                    units="m"))
        else:
            assert is_sealed_as(daemon, STREAMS[habit], log)


def is_sealed_under(daemon, sha256):
    c = daemon.client()
    try:
        return c.ask("SUBMIT", kind="identify", input={"sha256": sha256}).ok
    finally:
        c.close()


def test_relative_paths_are_those_of_the_folder_where_the_stream_was_opened(german, tmp_path):
    status, out = end(begin("changes folder", tmp_path, german))
    host = begin("changes folder", tmp_path, german, MODALD_URL="ipc://nobody", MODALD_SPILL=".")
    assert end(host) == (status, out)
    assert [f.name for f in tmp_path.glob("*.spill")] == [f"modald-folder-{host.pid}.spill"]


def test_a_host_sends_nothing_to_a_port_that_is_another_modulo_65536(german, tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as other:
        host = begin("plain", tmp_path, german,
                     MODALD_URL=f"tcp://127.0.0.1:{other.getsockname()[1] + 65536}")
        out, err = host.communicate()
        other.setblocking(False)
        with pytest.raises(BlockingIOError):
            other.accept()
    assert host.returncode == 7 and b"no socket to the daemon" in err


def test_a_key_file_that_is_a_fifo_makes_no_host_wait(german, tmp_path):
    os.mkfifo(tmp_path / "key", 0o600)
    host = begin("plain", tmp_path, german, MODALD_URL=f"ipc://{tmp_path}/nobody",
                 MODALD_KEYFILE=tmp_path / "key")
    out, err = host.communicate()
    assert host.returncode == 7 and b"the key file is not one of mode 0600" in err


def test_a_ring_file_that_the_disk_has_no_room_for_does_not_end_the_host(german, tmp_path):
    """A page of a mapped file that cannot be stored is a SIGBUS: 16 kB of disk for a ring of 8
    MiB."""
    small = tmp_path / "small"
    small.mkdir()
    mount = ["unshare", "-m", "sh", "-c",
             f'mount -t tmpfs -o size=16k none {small} && exec "$0" "$@"']
    if subprocess.run([*mount, "true"], capture_output=True).returncode != 0:
        pytest.skip("no mount namespaces here")
    plain = end(begin("plain", tmp_path, german))
    done = subprocess.run([*mount, str(HOSTS), "plain", str(STEPS)], capture_output=True,
                          timeout=PATIENCE, cwd=tmp_path,
                          env=environment(MODALD_URL=f"ipc://{tmp_path}/nobody",
                                          MODALD_SPILL=tmp_path, MODALD_RING_FILE=small / "ring",
                                          MODALD_CLOSE_WAIT="0.2"))
    assert (done.returncode, done.stdout) == plain
    assert b"the ring's file cannot be used" in done.stderr


@pytest.mark.skipif(sanitized.SANITIZED or shutil.which("prlimit") is None,
                    reason="sanitizers need all addresses, or no prlimit")
def test_a_host_at_any_memory_limit_runs_as_without_a_stream(daemon, german, tmp_path):
    """Address space that ends somewhere in the ring, the threads or libzmq, which ends the process
    where it gets no thread."""
    plain, least = end(begin("plain", tmp_path, german)), 0
    for megabytes in range(8, 72, 2):
        words = ["prlimit", f"--as={megabytes << 20}", str(HOSTS), "plain", str(STEPS)]
        alone = subprocess.run(words, capture_output=True, env=environment())
        if alone.returncode != 7:
            continue
        least = least or megabytes
        with_stream = subprocess.run(words, capture_output=True, cwd=tmp_path,
                                     env=environment(MODALD_URL=daemon.endpoint,
                                                     MODALD_SPILL=tmp_path, MODALD_CLOSE_WAIT="5"))
        assert (with_stream.returncode,
                with_stream.stdout) == plain, (megabytes, with_stream.stderr)
    assert 0 < least < 40


def test_a_ring_file_has_one_stream_at_a_time(daemon, german, tmp_path):
    """Two runs of one name: the second's samples must not be written over the first's; nor does a
    replay send what a run still writes."""
    env = {"MODALD_URL": f"ipc://{tmp_path}/nobody", "MODALD_RING_FILE": tmp_path / "ring-%s"}
    first = subprocess.Popen([str(HOSTS), "plain", "100000", "0.001"], stdout=subprocess.DEVNULL,
                             stderr=subprocess.DEVNULL, env=environment(**env), cwd=tmp_path)
    try:
        until = time.monotonic() + PATIENCE
        while (not (tmp_path / "ring-plain").exists() or (tmp_path / "ring-plain").stat().st_size
               < 1 << 20):
            assert time.monotonic() < until
        said = begin("plain", tmp_path, german, **env).communicate(timeout=PATIENCE)[1]
        assert b"another stream has the ring's file" in said
        replay = subprocess.run([str(BUILD / "bin" / "modalctl"), "--server", daemon.endpoint,
                                 "--json", "replay", str(tmp_path / "ring-plain")],
                                capture_output=True,
                                text=True, env=environment(), timeout=PATIENCE)
        assert replay.returncode == 2 and "a run still has it" in replay.stdout
    finally:
        first.kill()
        first.wait()


def test_a_run_is_told_that_another_pushes_under_its_name(daemon, german, tmp_path):
    # more output than a pipe holds: it pushes still when that is read, after the other did
    words = [str(HOSTS), "plain", str(PIPE // 16 + 3000), "0.0001"]
    env = environment(MODALD_URL=daemon.endpoint, MODALD_SPILL=tmp_path, MODALD_CLOSE_WAIT="120")
    log = subprocess.run(words[:3], capture_output=True, env=environment(), timeout=PATIENCE).stdout
    host = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=env)
    other = daemon.client()
    until = time.monotonic() + PATIENCE
    while True:
        opened = other.ask("STREAM", op="open", name="plain", channels=2, dt=1e-3)
        if opened.get("next", 0) > 0:
            break
        assert time.monotonic() < until
    other.ask("STREAM", [bytes(16)], op="push", stream=opened["stream"], epoch=opened["epoch"],
              first=0, count=1, crc32c=crc32c(bytes(16)))
    out, err = host.communicate(timeout=PATIENCE)
    other.close()
    assert ((host.returncode, out) == (7, log) and b"another run pushes to a stream of this name"
            in err)


# -- Fortran and Python
# --------------------------------------------------------------------------------------------------

PYTHON = """
import sys
sys.path.insert(0, {clients!r})
import modald, math
rows = []
with modald.stream("host", 2, 1e-3) as s:
    for i in range(20000):
        y = [math.exp(-1e-4 * i) * math.cos(0.1 * i),
             math.sin(0.1 * i) if {fault!r} != "not a number" or i % 7 else math.nan]
        s.push(y)
        if {fault!r} == "wrong shape" and i % 100 == 0:
            s.push([1.0, 2.0, 3.0])
            s.push("no number")
            s.push_at(1.0, [[1.0, 2.0], [3.0, 4.0]])
        if s.unstable:
            break
        rows.append(y)
s.push([1.0, 2.0])
s.close()
print(rows)
raise SystemExit(7)
"""
FAULTS = ["absent", "killed", "stopped", "wrong name", "wrong key", "no library", "not a number",
          "wrong shape"]


def command(language, fault):
    if language == "fortran":
        return [str(BUILD / "examples" / "example_loop_fortran"), "host", "2000000"]
    clients = str(pathlib.Path(modald.__file__).parent.parent)
    return ["/usr/bin/python3", "-c", PYTHON.format(clients=clients, fault=fault)]


def fault_environment(fault, tmp_path, stack):
    env = {"MODALD_SPILL": tmp_path, "MODALD_SPILL_MAX": "10000000", "MODALD_CLOSE_WAIT": "0.3",
           "MODALD_URL": f"ipc://{tmp_path}/nobody"}
    if fault == "wrong name":
        env["MODALD_URL"] = "tcp://nobody.invalid:4711"
    if fault == "no library":
        env["MODALD_LIBRARY"] = tmp_path / "none.so"
    if fault == "wrong key":
        lab = Lab(tmp_path, {"ann": "ann submit"})
        stack.callback(lab.daemon.__exit__)
        public, secret = zmq.curve_keypair()
        lab.write(tmp_path / "mine",
                  f'public-key = "{public.decode()}"\nsecret-key = "{secret.decode()}"\nserver-key '
                  f'= "{lab.server[0].decode()}"\n')
        env |= {"MODALD_URL": lab.daemon.endpoint, "MODALD_KEYFILE": tmp_path / "mine"}
    return env


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("language", ["fortran", "python"])
def test_a_host_in_another_language_runs_as_without_a_stream(language, fault, tmp_path):
    words = command(language, fault)
    if language == "fortran" and (fault in FAULTS[5:] or not pathlib.Path(words[0]).exists()):
        pytest.skip("a fault of Python's only, or no Fortran compiler")
    if language == "python" and sanitized.SANITIZED:
        pytest.skip("a sanitized library does not load into Python")
    plain = subprocess.run(words, capture_output=True, timeout=PATIENCE, env=environment())
    assert plain.stderr == b"" and plain.returncode == (7 if language == "python" else 0)
    with contextlib.ExitStack() as stack:
        env = fault_environment(fault, tmp_path, stack)
        if fault in ("killed", "stopped", "not a number", "wrong shape"):
            daemon = stack.enter_context(Daemon(workers=1))
            env["MODALD_URL"] = daemon.endpoint
        with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                              env=environment(**env)) as host:
            if fault in ("killed", "stopped"):
                c = daemon.client()
                until = time.monotonic() + PATIENCE
                while host.poll() is None and c.ask("STREAM", op="open", name="host", channels=2,
                                                    dt=1e-3).get("next", 0) == 0:
                    assert time.monotonic() < until
                c.close()
                daemon.process.send_signal(signal.SIGKILL if fault == "killed" else signal.SIGSTOP)
            out, err = host.communicate(timeout=PATIENCE)
            assert (host.returncode, out) == (plain.returncode, plain.stdout), err
            assert err.count(b"\n") <= 3
            if fault == "stopped":
                os.kill(daemon.process.pid, signal.SIGCONT)
