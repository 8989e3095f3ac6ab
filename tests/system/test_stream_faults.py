"""A simulation beside the real daemon under every fault: its output and exit status stay its own,
and its record is its log.

MODALD_KILLS: how many kills of each kind (4); 50 were run once.  MODALD_SAMPLES: samples pushed at
a dead server (2000000); 10^8 were run once.
"""
import contextlib
import json
import os
import random
import signal
import subprocess
import time

import pytest
import zmq

import sanitized
from conftest import BUILD, PATIENCE, environment
from lab import Lab
from wire import Daemon, identity

LOOP = BUILD / "examples" / "example_loop"
KILLS = int(os.environ.get("MODALD_KILLS", "4"))
SAMPLES = int(os.environ.get("MODALD_SAMPLES", "2000000"))
STEPS, DT = 12000, 1e-3


def run(name, *more, **env):
    done = subprocess.run([str(LOOP), name, *map(str, more)], capture_output=True, timeout=PATIENCE,
                          env=environment(**env))
    return done.returncode, done.stdout


def begin(name, *more, **env):
    return subprocess.Popen([str(LOOP), name, *map(str, more)], stdout=subprocess.PIPE,
                            stderr=subprocess.DEVNULL, env=environment(**env))


def wait(true):
    end = time.monotonic() + PATIENCE
    while not true():
        assert time.monotonic() < end
        time.sleep(0.002)


# What a pipe holds, and a host's output is more than: it has not ended before that is read.
PIPE = 65536


def arrived(daemon, name):
    """Samples of a stream that are durable; 0 before it is open."""
    c = daemon.client()
    try:
        return c.ask("STREAM", op="open", name=name, channels=2, dt=DT).get("next", 0)
    finally:
        c.close()


# -- requirement 2
# --------------------------------------------------------------------------------------------------

@pytest.mark.parametrize("fault", ["absent", "killed", "stopped", "disk full", "wrong key",
                                   "not a number"])
def test_the_hosts_output_and_exit_status_are_unchanged(fault, tmp_path):
    killed = fault in ("killed", "stopped")
    words = [PIPE // 16 + 3000 if killed else 3000, "nan" if fault == "not a number" else 2, 0.0002]
    plain = run("host", *words[:2])
    env = {"MODALD_SPILL": tmp_path, "MODALD_CLOSE_WAIT": "0.5"}
    if fault == "absent":
        assert run("host", *words, MODALD_URL=f"ipc://{tmp_path}/nobody", **env) == plain
        return
    if fault == "wrong key":
        lab = Lab(tmp_path, {"ann": "ann submit"})
        public, secret = zmq.curve_keypair()
        lab.write(tmp_path / "mine",
                  f'public-key = "{public.decode()}"\nsecret-key = "{secret.decode()}"\nserver-key '
                  f'= "{lab.server[0].decode()}"\n')
        try:
            assert run("host", *words, MODALD_URL=lab.daemon.endpoint,
                       MODALD_KEYFILE=tmp_path / "mine", **env) == plain
        finally:
            lab.daemon.__exit__()
        return
    with Daemon(workers=1) as daemon:
        if fault == "not a number":
            assert run("host", *words, MODALD_URL=daemon.endpoint, MODALD_WINDOW=500,
                       MODALD_HOP=100, **env) == plain
            return
        # what the ring cannot hold has no room either: a spill on a file system of 16 kB
        if fault == "disk full":
            (tmp_path / "small").mkdir()
            mount = ["unshare", "-m", "sh", "-c",
                     f'mount -t tmpfs -o size=16k none {tmp_path}/small && exec "$0" "$@"']
            if subprocess.run([*mount, "true"], capture_output=True).returncode != 0:
                pytest.skip("no mount namespaces here")
            done = subprocess.run([*mount, str(LOOP), "host", "30000", "2"], capture_output=True,
                                  timeout=PATIENCE,
                                  env=environment(MODALD_URL=f"ipc://{tmp_path}/nobody",
                                                  MODALD_SPILL=tmp_path / "small",
                                                  MODALD_RING=65536, MODALD_CLOSE_WAIT="0.5"))
            assert (done.returncode, done.stdout) == run("host", 30000, 2)
            return
        with begin("host", *words, MODALD_URL=daemon.endpoint, **env) as host:
            wait(lambda: arrived(daemon, "host") > 0)
            daemon.process.send_signal(signal.SIGKILL if fault == "killed" else signal.SIGSTOP)
            out = host.communicate(timeout=PATIENCE)[0]
            assert (host.returncode, out) == plain


# -- requirement 3
# --------------------------------------------------------------------------------------------------

def test_memory_stays_bounded_with_a_dead_server(tmp_path):
    """8 MiB of ring and what the process is anyway, by much more with sanitizers; 2 x 10^6 samples
    of 16 bytes would be 32 MB more, 10^8 of them 1.6 GB."""
    bound_mb = 40 if sanitized.SANITIZED else 20
    out = subprocess.Popen([str(LOOP), "dead", str(SAMPLES)], stdout=subprocess.DEVNULL,
                           stderr=subprocess.DEVNULL,
                           env=environment(MODALD_URL=f"ipc://{tmp_path}/nobody",
                                           MODALD_SPILL=tmp_path, MODALD_SPILL_MAX="1000000",
                                           MODALD_CLOSE_WAIT="0.2"))
    most = 0
    while out.poll() is None:
        with contextlib.suppress(OSError, StopIteration):
            most = max(most, next(int(line.split()[1]) for line in open(f"/proc/{out.pid}/status")
                                  if line.startswith("VmHWM")))
        time.sleep(0.02)
    assert out.returncode == 0 and 0 < most < bound_mb * 1024    # kB
    assert sum(f.stat().st_size for f in tmp_path.iterdir() if f.is_file()) < 1100000


# -- requirement 4
# --------------------------------------------------------------------------------------------------

def is_sealed_as(daemon, name, log):
    """Is there a batch of exactly these samples?  By its SHA-256, which a job may name."""
    whole = identity(len(log) // 16, 2, DT, log)
    c = daemon.client()
    try:
        return c.ask("SUBMIT", kind="identify", input={"sha256": whole}).ok
    finally:
        c.close()


def test_the_record_is_the_log_though_the_daemon_is_killed_again_and_again(tmp_path):
    plain = run("long", STEPS)[1]
    dice = random.Random(1)
    with Daemon(workers=1) as daemon:
        with begin("long", STEPS, 2, 0.0004, MODALD_URL=daemon.endpoint, MODALD_RING_FILE=tmp_path
                   / "ring-%s", MODALD_SPILL=tmp_path, MODALD_CLOSE_WAIT="120") as host:
            out, part = b"", (len(plain) - 2 * PIPE) // KILLS   # read so, it runs at every kill
            for _ in range(KILLS):
                out += host.stdout.read(part)
                time.sleep(dice.uniform(0.01, 0.08))
                assert host.poll() is None
                daemon.kill()
                daemon.start()
            assert out + host.stdout.read() == plain and host.wait(PATIENCE) == 0
        assert is_sealed_as(daemon, "long", plain)


def test_the_record_is_the_log_though_the_host_is_killed_again_and_again(tmp_path):
    """Each time the ring's file is replayed by another process: the record is the log's beginning
    bit for bit, and lacks nothing that the host had written."""
    plain = run("again", STEPS)[1]
    dice = random.Random(2)
    with Daemon(workers=1) as daemon:
        for i in range(KILLS):
            name = f"again-{i}"
            with begin(name, STEPS, 2, 0.0004, MODALD_URL=daemon.endpoint,
                       MODALD_RING_FILE=tmp_path / "ring-%s", MODALD_SPILL=tmp_path) as host:
                head = host.stdout.read(4096)                     # it is at work
                time.sleep(dice.uniform(0, 0.3))
                host.kill()
                had = len(head + host.stdout.read()) // 16
            sent = arrived(daemon, name)
            done = subprocess.run([str(BUILD / "bin" / "modalctl"), "--server", daemon.endpoint,
                                   "--json", "replay", str(tmp_path / f"ring-{name}")],
                                  capture_output=True,
                                  text=True, env=environment(), timeout=PATIENCE)
            assert done.returncode == 0, done.stdout + done.stderr
            # what was replayed may have been there already
            most = sent + json.loads(done.stdout)["samples"]
            assert max(sent, had) <= most
            assert any(is_sealed_as(daemon, name, plain[:16 * n])
                       for n in range(most, max(sent, had) - 1, -1))
