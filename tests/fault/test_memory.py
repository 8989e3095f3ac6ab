"""F10: the n-th allocation of the daemon, of a worker or of modalctl fails: an error that says so,
or a restart; nothing acknowledged is lost, and no result is another.

n goes up by a stride through everything that the process allocates; MODALD_ALLOCATIONS tries more
of them.
"""
import json
import os
import pathlib
import shutil
import subprocess
import sys
import time

import pytest
import zmq

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "system"))
from wire import BUILD, Daemon, submit  # noqa: E402

SHIM = BUILD / "fault" / "libmalloc.so"
TRIES = int(os.environ.get("MODALD_ALLOCATIONS", 30))
SECONDS_MOST = 25                                # each of the two sweeps, however slow the machine
FAKE = f"worker_path = {HERE.parent / 'system' / 'fake_worker.py'}\n"

pytestmark = pytest.mark.skipif("san" in BUILD.name, reason="a sanitizer has its own malloc")


def shim(n):
    return {"LD_PRELOAD": str(SHIM), "MALLOC_FAIL": str(n), "MALLOC_PROGRAM": "modald"}


def use(client, acks):
    """A little of everything; what is acknowledged goes to ACKS.  False: the daemon no longer
    answers.
    """
    try:
        for i in range(6):
            reply = submit(client, key=f"k{len(acks)}-{i}", phase=len(acks) + i * 1e-3,
                           options={"note": "x" * 50 * i})
            if reply.ok:
                acks[reply["key"]] = reply["job"]
            else:
                assert reply.code in ("no_memory", "busy", "internal", "io_error"), reply
        for verb in ("LIST", "STATS", "METRICS", "WHOAMI"):
            client.ask(verb)
        last = client.ask("WAIT", job=list(acks.values())[-1], timeout_s=2, result=True)
        assert last.ok
    except (zmq.Again, IndexError):
        return False
    return True


def check(daemon, acks):
    client = daemon.client()
    lost = [key for key, job in acks.items() if client.ask("STATUS", job=f"key:{key}").get("job")
            != job]
    client.close()
    assert not lost, f"lost after a failed allocation: {lost}"


class Perhaps:
    """A daemon that may not come up: then None."""

    def __init__(self, folder, n):
        self.folder, self.n, self.daemon = folder, n, None

    def __enter__(self):
        try:
            self.daemon = Daemon(self.folder, config=FAKE, env=shim(self.n))
        except RuntimeError:
            return None
        return self.daemon

    def __exit__(self, *_):
        if self.daemon is not None:
            self.daemon.__exit__()


def allocations(tmp_path):
    """More than a daemon makes that is started, used a little and stopped: n doubled until none
    fails.
    """
    n = 4096
    while True:
        folder = tmp_path / f"count{n}"
        folder.mkdir()
        with Perhaps(folder, n) as d:
            if d is not None:
                use(d.client(timeout_s=1), {})
            reached = b"allocation_failed" in (folder / "log").read_bytes()
        if not reached:
            return n
        n *= 2


def test_the_nth_allocation_of_the_daemon_fails_and_nothing_acknowledged_is_lost(tmp_path, capsys):
    most, begin, tried, reached, ended, unstarted = allocations(
        tmp_path), time.monotonic(), 0, 0, 0, 0
    folder, acks = tmp_path / "swept", {}
    folder.mkdir()
    for i in range(TRIES):
        if time.monotonic() - begin > SECONDS_MOST:
            break
        n = 1 + i * most // TRIES
        with Perhaps(folder, n) as d:
            tried += 1
            if d is None:
                unstarted += 1
            elif not use(d.client(timeout_s=1), acks) or d.process.poll() is not None:
                ended += 1
        reached += b"allocation_failed" in (folder / "log").read_bytes()
        (folder / "log").write_bytes(b"")
        if i % 5 == 4 or i == TRIES - 1:
            with Daemon(folder, config=FAKE) as d:
                check(d, acks)
    with Daemon(folder, config=FAKE) as d:
        check(d, acks)
        assert use(d.client(), acks)
    with capsys.disabled():
        print(f"\nP6: allocation n of the daemon fails: {tried} of {most} tried, {reached} "
              f"reached, {unstarted} did not start, {ended} ended, "
              f"{len(acks)} acknowledged, 0 lost")
    assert acks and reached > 0


def test_the_nth_allocation_of_a_worker_fails_and_the_job_still_ends(tmp_path, capsys):
    """A worker that cannot go on says no_memory or dies, and the daemon does not; what did not hurt
    the job ends it well.
    """
    begin, tried, reached, ends = time.monotonic(), 0, 0, {}
    wrapper = tmp_path / "worker"                # workers get an environment of their own
    for i in range(TRIES):
        if time.monotonic() - begin > SECONDS_MOST:
            break
        mark, n = tmp_path / f"reached{i}", 1 + i * i * 4
        wrapper.write_text(f"#!/bin/sh\nMALLOC_FAIL={n} MALLOC_PROGRAM=modald-worker "
                           f"MALLOC_MARK={mark} LD_PRELOAD={SHIM} exec {BUILD}/bin/modald-worker "
                           "\"$@\"\n")
        wrapper.chmod(0o755)
        with Daemon(workers=1, config=f"worker_path = {wrapper}\nsandbox = off\n") as d:
            client = d.client()
            job = submit(client, key="one", max_attempts=1)["job"]
            doc = client.ask("WAIT", job=job, timeout_s=15)
            # the worker fails before it is ready, each time anew
            if doc["state"] in ("queued", "running"):
                # or it has come to its end since
                assert client.ask("CANCEL", job=job)["state"] in ("cancelled", "done", "failed",
                                                                          "dead")
            elif doc["state"] != "done":
                assert (doc["error"]["code"] in ("no_memory", "worker_died", "internal",
                                                 "io_error")), doc
            if b"no memory for a document" in d.log_path.read_bytes():    # tried again in vain
                assert doc.get("error", {}).get("code") != "worker_died", doc
            state = doc["state"]
            ends[state] = ends.get(state, 0) + 1
            assert d.process.poll() is None
            tried += 1
            reached += mark.exists()
    with capsys.disabled():
        print(f"\nP4: allocation n of the worker fails: {tried} tried, {reached} reached, jobs "
              f"{ends}, daemon alive each time")
    assert reached > 0


def without_times(value):
    """A document without what two runs of it differ in."""
    if isinstance(value, dict):
        return {key: without_times(v) for key, v in value.items()
                if key not in ("cost", "seconds")}
    return [without_times(v) for v in value] if isinstance(value, list) else value


def without_verdict(document):
    return {key: v for key, v in document.items() if key not in ("stability", "diagnostics")}


SCENE = {"structure": {"type": "chain", "masses": [1], "springs": [100, 0], "dampers": [0.4, 0]},
         "excitation": [{"dof": "x1", "k": 1, "cos": 1}], "omega": 5}


def test_where_the_nth_allocation_of_modalctl_fails_no_result_is_another(tmp_path, capsys):
    """One document, whole, or an error: a member that cJSON has no memory for it leaves out.  A
    verdict that there was no memory for is left open, and a diagnostic says so."""
    (tmp_path / "scene.json").write_text(json.dumps(SCENE))
    mark = tmp_path / "reached"

    def run(n):
        mark.unlink(missing_ok=True)
        return subprocess.run(
            [BUILD / "bin" / "modalctl", "--json", "--local", "steady", tmp_path / "scene.json"],
            capture_output=True, timeout=250,
            env={**os.environ, "LD_PRELOAD": str(SHIM), "MALLOC_FAIL": str(n),
                 "MALLOC_PROGRAM": "modalctl", "MALLOC_MARK": str(mark)})

    whole, n, ends = without_times(json.loads(run(10**9).stdout)), 64, {}
    while run(n) and mark.exists():
        n *= 2
    for i in range(n, 0, -max(1, n // TRIES)):
        done = run(i)
        if not mark.exists():
            continue
        ends[done.returncode] = ends.get(done.returncode, 0) + 1
        if done.returncode not in (0, 1, 2):    # the loader and libgfortran end programs themselves
            assert done.stderr and not done.stdout, (i, done)
            continue
        said = without_times(json.loads(done.stdout))
        if done.returncode:
            assert "error" in said, (i, done)
        elif said != whole:
            assert [note["code"] for note in said["diagnostics"]
                    if note not in whole["diagnostics"]] == ["stability_unknown"], (i, said)
            assert said["stability"]["stable"] is None, (i, said)
            assert without_verdict(said) == without_verdict(whole), (i, said)
    with capsys.disabled():
        print(f"\nallocation n of modalctl fails: of {n}, ends {ends}")
    assert ends.get(1, 0) > 0
