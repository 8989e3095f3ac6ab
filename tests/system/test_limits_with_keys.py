"""What a job may take where nobody said how much: with keys, one user's jobs hold neither the
memory nor the workers for ever.
"""
import json
import pathlib
import re

import pytest
from lab import FAKE, Lab
from wire import BUILD, PATIENCE_S, Daemon, ring_down, submit, until

DAY_S = 86400
SANITIZED = b"__asan_init" in (BUILD / "bin" / "modald-worker").read_bytes()


def data_limit(pid):
    """RLIMIT_DATA of a process; None: none."""
    found = re.search(r"Max data size +(\S+)", pathlib.Path(f"/proc/{pid}/limits").read_text())[1]
    return None if found == "unlimited" else int(found)


def machine_memory():
    """The machine's, or less where a control group of this process has less."""
    most = int(re.search(r"MemTotal: +(\d+) kB",
                         pathlib.Path("/proc/meminfo").read_text())[1]) * 1024
    own = [line.split("::", 1)[1]
           for line in pathlib.Path("/proc/self/cgroup").read_text().splitlines()
           if line.startswith("0::")]
    group = pathlib.Path("/sys/fs/cgroup" + own[0]) if own else None
    while group is not None and group != pathlib.Path("/sys/fs"):
        limit = group / "memory.max"
        if limit.exists() and limit.read_text().strip() != "max":
            most = min(most, int(limit.read_text()))
        group = group.parent
    return most


def limits_of_a_worker(client, daemon, **more):
    """(run limit that RUN has, data limit): of the fake worker; of the real one the second.

    Of two real ones the other may not have begun, and has no limit then.
    """
    job = submit(client, fresh=True, **more)["job"]
    done = client.ask("WAIT", job=job, timeout_s=250, result=True)
    assert done["state"] == "done", done
    limits = [data_limit(child) for child in daemon.children()]
    return (json.loads(done.body[0]).get("run_limit_s"),
            next((limit for limit in limits if limit is not None), None))


def test_with_keys_an_attempt_has_a_day_unless_somebody_says_otherwise(tmp_path):
    with_keys = Lab(tmp_path, {"a": "a submit"})
    with with_keys.daemon as daemon:
        client = with_keys.client("a")
        assert limits_of_a_worker(client, daemon)[0] == DAY_S
        assert limits_of_a_worker(client, daemon, run_limit_s=2385)[0] == 2385
        with_keys.daemon.config.write_text(with_keys.config + "run_limit_s = 0\n")
        with_keys.reload()
        assert limits_of_a_worker(client, daemon)[0] == 0
        client.close()
    with Daemon(config=FAKE) as daemon:
        client = daemon.client()
        assert limits_of_a_worker(client, daemon)[0] == 0
        client.close()


def test_a_job_that_passes_the_limit_of_the_configuration_is_told_whose_it_is():
    with Daemon(config=FAKE + "run_limit_s = 0.5\n") as daemon:
        client = daemon.client()
        job = submit(client, options={"sleep": 600})["job"]
        error = client.ask("WAIT", job=job, timeout_s=250)["error"]
        assert (error["code"] == "run_limit" and "0.5 s" in error["message"]
                and "run_limit_s" in error["message"])
        client.close()


@pytest.mark.skipif(SANITIZED, reason="a sanitizer's shadow is larger than any limit")
def test_with_keys_a_worker_has_its_part_of_the_memory_unless_somebody_says_otherwise(tmp_path):
    share = max(1 << 30, machine_memory() // 3)
    lab = Lab(tmp_path, {"a": "a submit"}, workers=2)
    lab.daemon.stop()
    config = lab.config.replace(FAKE, "")
    for line, expected in (("", share), ("worker_memory = 3G\n", 3 << 30),
                           ("worker_memory = 0\n", None)):
        lab.daemon.config.write_text(config + line)
        lab.daemon.start()
        try:
            client = lab.client("a")
            found = limits_of_a_worker(client, lab.daemon)[1]
            client.close()
        finally:
            lab.daemon.stop()
        assert found == expected or (expected == share and found is not None
                                     and abs(found - share) <= 4096), (line, found, expected)
    with Daemon() as daemon:
        client = daemon.client()
        assert limits_of_a_worker(client, daemon)[1] is None
        client.close()


def flood(client, first, count):
    """COUNT jobs with keys from FIRST on, all of them answered by one result."""
    data, described = ring_down(samples=16)
    for at in range(first, first + count, 250):
        jobs = [{"kind": "identify", "input": {**described, "bytes": len(data)},
                 "key": f"k{i:05}"} for i in range(at, at + 250)]
        reply = client.ask("SUBMITS", [data * 250], jobs=jobs)
        assert reply.ok and b'"error"' not in reply.body[0], reply


def test_a_user_who_floods_the_daemon_with_jobs_loses_his_own_oldest_and_nobody_elses(tmp_path):
    """11,000 a second were taken of results that were there, each 650 bytes of memory, for 30
    days."""
    lab = Lab(tmp_path, {"ann": "ann submit", "eve": "eve submit", "root": "root admin"},
              config=FAKE + "jobs_kept = 1000\n", workers=1)
    with lab.daemon as d:
        ann, eve, root = (lab.client(name) for name in ("ann", "eve", "root"))
        for client in (ann, eve):
            job = submit(client, key="first")["job"]
            assert client.ask("WAIT", job=job, timeout_s=PATIENCE_S)["state"] == "done"
        flood(eve, 0, 5000)

        def kept():
            return root.ask("STATS")["jobs"]["done"]
        # the first of each, and a row of eve's that is not shown, whose result the others have
        until(lambda: kept() <= 1002, "jobs past jobs_kept stay")
        assert kept() == 1002 and ann.ask("STATUS", job="key:first").ok
        assert eve.ask("STATUS", job="key:k04999").ok

        def seen():
            """Each user's own, and what METRICS has of all: without the row that is not shown."""
            told = root.ask("METRICS").body[0].decode()
            return (ann.ask("STATS")["jobs"]["done"], eve.ask("STATS")["jobs"]["done"],
                    int(re.search(r'^modald_jobs_kind{kind="identify"} (\d+)$', told, re.M)[1]))
        assert seen() == (1, 1000, 1001)

        def keys_gone():
            # forgotten, remembered, there
            return [eve.ask("STATUS", job=f"key:{key}").code for key in ("k00500", "k03500",
                                                                         "k04500")]
        assert keys_gone() == ["not_found", "expired", None]
        d.kill()
        d.start()
        ann, eve, root = (lab.client(name) for name in ("ann", "eve", "root"))
        assert kept() == 1002 and ann.ask("STATUS", job="key:first").ok
        assert seen() == (1, 1000, 1001)
        assert keys_gone() == ["not_found", "expired", None]
