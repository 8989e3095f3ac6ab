"""No worker outlives its daemon: kill -9 at any moment of a worker's life, and another daemon on
the same folder at once.
"""
import os
import pathlib
import sys
import time

import pytest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "system"))
from wire import BUILD, Daemon, scene_job, submit  # noqa: E402

END_S = 300


def workers_of(folder):
    """Process number and parent of each worker of a daemon of this folder, those that are still a
    wrapping shell among them.
    """
    found = {}
    for entry in os.listdir("/proc"):
        try:
            command = (pathlib.Path(f"/proc/{entry}/cmdline").read_bytes() if entry.isdigit()
                       else b"")
            if str(folder).encode() in command and b"--connect" in command:
                found[int(entry)] = int(
                    pathlib.Path(f"/proc/{entry}/stat").read_text().rsplit(")", 1)[1].split()[1])
        except OSError:
            pass                                     # it has ended meanwhile
    return found


def none_left(folder, but_of=None):
    """Wait until every worker of the folder is a child of the daemon BUT_OF."""
    end = time.monotonic() + END_S
    while left := {pid: parent for pid, parent in workers_of(folder).items() if parent != but_of}:
        assert time.monotonic() < end, left
        time.sleep(0.02)


def test_a_worker_that_had_not_begun_when_its_daemon_was_killed_does_not_serve_the_next(tmp_path):
    script = tmp_path / "worker"
    script.write_text(f"#!/bin/sh\nuntil [ -e {tmp_path}/go ]; do sleep 0.05; done\nexec "
                      f"{BUILD}/bin/modald-worker \"$@\"\n")
    script.chmod(0o755)
    with Daemon(folder=tmp_path, config=f"worker_path = {script}\n", workers=3) as daemon:
        # not a shell's child of a moment
        while len(orphans := {pid for pid, parent in workers_of(tmp_path).items()
                              if parent == daemon.pid}) < 3:
            time.sleep(0.01)
        daemon.kill()
        daemon.config.write_text("")                 # the next one's workers begin at once
        daemon.start()
        assert orphans <= set(workers_of(tmp_path))
        (tmp_path / "go").touch()
        none_left(tmp_path, but_of=daemon.pid)
        client = daemon.client()
        job = submit(client)["job"]
        assert client.ask("WAIT", job=job, timeout_s=250)["state"] == "done"
        client.close()


@pytest.mark.parametrize("busy", [False, True], ids=["idle or starting", "computing"])
def test_kill_9_at_any_moment_leaves_no_worker(tmp_path, busy):
    with Daemon(folder=tmp_path, workers=4) as daemon:
        for i in range(24):
            if busy:
                client = daemon.client()
                scene_job(client, key=f"k{i}", max_attempts=1)
                client.close()
            # from its first instant to the life of a worker that has begun
            time.sleep(0.4 * i / 24 if i % 3 else 0)
            daemon.kill()
            daemon.start()
            none_left(tmp_path, but_of=daemon.pid)
        daemon.kill()
        none_left(tmp_path)
