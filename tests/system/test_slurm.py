"""modald-slurm: its rounds on stand-ins of Slurm's commands, and pilots on a real Slurm of two
nodes (the longer trials with MODALD_LONG).
"""
import importlib.machinery
import importlib.util
import json
import os
import pathlib
import re
import subprocess
import sys

import pytest
import zmq

import slurm_local
from test_elsewhere import Site, batch, same, state, user
from wire import BUILD, PATIENCE_S, scene_job, until

TOP = pathlib.Path(__file__).resolve().parents[2]
PROGRAM = TOP / "clients" / "slurm" / "modald-slurm"
sys.path.insert(0, str(TOP / "clients" / "python"))
import modald  # noqa: E402

pytestmark = pytest.mark.skipif(not zmq.has("curve"), reason="this pyzmq has no CURVE")
LONG = pytest.mark.skipif(not os.environ.get("MODALD_LONG"), reason="with MODALD_LONG=1")


def module():
    loader = importlib.machinery.SourceFileLoader("modald_slurm", str(PROGRAM))
    made = importlib.util.module_from_spec(importlib.util.spec_from_loader("modald_slurm", loader))
    keep, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    loader.exec_module(made)
    sys.dont_write_bytecode = keep
    return made


# ---- rounds, on stand-ins ------------------------------------------------------------------------

@pytest.mark.parametrize("cpu_s, wait, least, most, want", [
    (0, 60, 0, 8, 0), (0, 60, 2, 8, 2), (0.01, 60, 0, 8, 1), (60, 60, 0, 8, 1), (61, 60, 0, 8, 2),
    (1e6, 60, 0, 8, 8)])
def test_as_many_are_wanted_as_finish_the_queue_in_the_wait(cpu_s, wait, least, most, want):
    assert module().wanted(cpu_s, wait, least, most) == want


class Stand:
    """squeue and sbatch that say what a test wrote and write down what they were asked."""

    def __init__(self, folder, monkeypatch, cpu_s):
        self.folder = folder
        for name in ("squeue", "sbatch", "scancel"):
            path = folder / name
            path.write_text(f"#!/bin/sh\necho \"$@\" >> {folder}/{name}.asked\n"
                            f"[ {name} != sbatch ] || cat > {folder}/script\n"
                            f"cat {folder}/{name}.says; exit $(cat {folder}/{name}.exit)\n")
            path.chmod(0o755)
            self.says(name, "")
        monkeypatch.setenv("PATH", f"{folder}:{os.environ['PATH']}")
        self.program = module()
        self.options = self.program.arguments(
            ["--pool", "lab", "--most", "4", "--wait", "10", "--connect", "tcp://lab:7418",
             "--worker-keyfile", "/home/lab/it's.key", "--", "-p", "long"])
        self.scaler = self.program.Scaler(self.options)
        self.joined = []
        self.scaler.stats = lambda: {"queue": {"elsewhere_s": cpu_s},
                                     "workers": {"names": self.joined}}
        self.clock = [1000.0]
        monkeypatch.setattr(self.program.time, "monotonic", lambda: self.clock[0])

    def says(self, name, text, status=0):
        (self.folder / f"{name}.says").write_text(text)
        (self.folder / f"{name}.exit").write_text(str(status))

    def asked(self, name):
        path = self.folder / f"{name}.asked"
        return path.read_text().splitlines() if path.exists() else []


@pytest.fixture()
def stand(tmp_path, monkeypatch):
    return lambda cpu_s: Stand(tmp_path, monkeypatch, cpu_s)


def test_what_is_missing_is_one_array_and_what_is_there_is_asked_of_slurm_each_round(stand):
    it = stand(35)
    it.says("squeue", "7_1|RUNNING|3:02|N/A|None|N/A\n7_2|PENDING|0:00|N/A|Resources|N/A\n"
            "6_1|COMPLETED|1:00|2026-01-01T00:00:00|None|N/A\n")
    assert it.scaler.step()
    assert it.asked("sbatch") == ["--parsable -J md-lab --array=1-2 -n1 -p long"]
    it.says("squeue", "".join(f"7_{i}|RUNNING|3:02|N/A|None|N/A\n" for i in range(4)))
    assert it.scaler.step() and len(it.asked("sbatch")) == 1 and len(it.asked("squeue")) == 2
    text = (it.folder / "script").read_text()
    assert subprocess.run(["bash", "-n"], input=text, text=True).returncode == 0
    assert "--connect tcp://lab:7418" in text and "'/home/lab/it'\"'\"'s.key'" in text


def test_a_failing_sbatch_is_tried_ever_less_often_and_a_good_one_makes_good(stand):
    it = stand(10)
    it.says("sbatch", "", 1)
    tries = []
    for _ in range(40):
        before = len(it.asked("sbatch"))
        assert it.scaler.step()
        if len(it.asked("sbatch")) > before:
            tries.append(it.clock[0])
        it.clock[0] += 1
    assert [b - a for a, b in zip(tries, tries[1:])] == [2, 4, 8, 16]
    it.says("sbatch", "8\n")
    it.clock[0] += 1000
    assert it.scaler.step() and it.scaler.refusals == 0


def test_pilots_that_fail_fast_are_held_back_and_preempted_ones_are_not(stand):
    it = stand(10)
    now = it.program.time.strftime("%Y-%m-%dT%H:%M:%S")
    it.says("squeue", "".join(f"{i}|FAILED|0:05|{now}|None|N/A\n" for i in range(9)))
    assert it.scaler.step() and it.asked("sbatch") == []
    it.clock[0] += 1000
    for ended in (f"1|PREEMPTED|0:05|{now}", f"1|CANCELLED|0:05|{now}", f"1|TIMEOUT|1:00|{now}",
                  f"1|FAILED|1-02:03:04|{now}"):
        it.says("squeue", ended + "|None|N/A\n")
        before = len(it.asked("sbatch"))
        assert it.scaler.step() and len(it.asked("sbatch")) == before + 1, ended


def test_a_pilot_that_does_not_join_counts_until_its_patience_is_over_and_is_cancelled_then(stand):
    it = stand(35)
    it.says("squeue", "".join(f"7_{i}|{state}|3:02|N/A|None|N/A\n" for i, state in
                              enumerate(("RUNNING", "RUNNING", "PENDING", "SUSPENDED"))))
    it.joined = ["7_0", "7_1"]
    for seconds in (0, 1000, 134):
        it.clock[0] += seconds
        assert it.scaler.step() and it.asked("sbatch") == it.asked("scancel") == []
        it.joined = ["7_0"] if seconds == 1000 else it.joined
    it.joined = ["7_0", "7_1"]
    assert it.scaler.step()                               # it was away for less: it is there again
    it.joined = ["7_0", "7_3", "of another pool"]
    assert it.scaler.step()
    it.clock[0] += 136                                    # --idle 120 and 15
    assert it.scaler.step()
    assert it.asked("scancel") == ["7_1"]
    assert it.asked("sbatch") == ["--parsable -J md-lab --array=1-1 -n1 -p long"]


@pytest.mark.parametrize("reason", ["JobHeldAdmin", "launch failed requeued held"])
def test_a_pilot_that_is_held_for_good_is_none_and_holds_back_the_next_as_a_failed_one(
        stand, reason):
    it = stand(35)
    line = f"7_{{}}|PENDING|0:00|N/A|{reason}|{{}}\n"
    now = it.program.time.strftime("%Y-%m-%dT%H:%M:%S")
    it.says("squeue", "".join(line.format(i, now) for i in range(4)))
    assert it.scaler.step() and it.asked("sbatch") == []
    it.clock[0] += 1000
    it.says("squeue", "".join(line.format(i, "2026-01-01T00:00:00") for i in range(4)))
    assert it.scaler.step()
    assert it.asked("sbatch") == ["--parsable -J md-lab --array=1-4 -n1 -p long"]
    assert it.asked("scancel") == []


def test_a_slurm_or_a_daemon_that_does_not_answer_ends_the_round_and_not_the_program(stand):
    it = stand(10)
    it.says("squeue", "", 1)
    assert not it.scaler.step() and it.asked("sbatch") == []

    def gone():
        raise modald.Error("no_server", "nobody")
    it.says("squeue", "")
    it.scaler.stats = gone
    assert not it.scaler.step() and it.asked("sbatch") == []


@pytest.mark.parametrize("words", [["--most", "0"], ["--wait", "0"], ["--pool", "a b"],
                                   ["--least", "9"],
                                   ["--wait", "nan"], ["--idle", "-1"]])
def test_what_cannot_be_meant_is_refused(words):
    usual = ["--pool", "lab", "--most", "8", "--connect", "tcp://x:1", "--worker-keyfile", "k"]
    done = subprocess.run([str(PROGRAM), *usual, *words], capture_output=True, text=True,
                          env={**os.environ, "PYTHONPATH": str(TOP / "clients" / "python")})
    assert done.returncode == 2 and "usage: modald-slurm" in done.stderr


# ---- a real Slurm --------------------------------------------------------------------------------

def start_slurm(tmp_path_factory):
    why = slurm_local.missing()
    if why is not None:
        pytest.skip(why)
    return slurm_local.Slurm(tmp_path_factory.mktemp("slurm"))


@pytest.fixture(scope="module")
def slurm(tmp_path_factory):
    made = start_slurm(tmp_path_factory)
    yield made
    made.end()


@pytest.fixture()
def broken_pool(tmp_path, tmp_path_factory):
    """A pool with a Slurm of its own, which nobody needs afterwards."""
    slurm, made = start_slurm(tmp_path_factory), []

    def make(*words):
        made.append(Pool(tmp_path, slurm, *words))
        return made[-1]
    yield make
    for one in made:
        one.end()
    slurm.end()


class Pool(Site):
    """A site whose workers are Slurm's: modald-slurm beside it."""

    def __init__(self, folder, slurm, *words, sbatch=()):
        super().__init__(folder)
        self.slurm, self.pool = slurm, folder.name
        self.words = [str(PROGRAM), "--pool", self.pool, "--server", self.daemon.endpoint,
                      "--keyfile",
                      self.keyfile("rob"), "--connect", self.port, "--worker-keyfile",
                      self.keyfile("wes"), "--worker", str(BUILD / "bin" / "modald-worker"),
                      "--most",
                      "4", "--wait", "1", *words, "--", f"--chdir={folder}",
                      f"--output={folder}/pilot.%A_%a", *sbatch]
        self.env = {**slurm.env, "PYTHONPATH": str(TOP / "clients" / "python")}
        self.scaler = None

    def scale(self):
        said = open(self.folder / "scaler", "ab")
        self.scaler = subprocess.Popen(self.words, stderr=said, env=self.env)
        said.close()

    def scaled(self):
        """What modald-slurm has said."""
        return (self.folder / "scaler").read_text()

    def counted(self, name):
        text = self.client("eva").ask("METRICS").body[0].decode()
        return float(re.search(rf"^{name} (\S+)$", text, re.M)[1])

    def end(self):
        if self.scaler is not None:
            self.scaler.terminate()
            self.scaler.wait()
        self.slurm.ask("scancel", "-n", f"md-{self.pool}")
        super().end()


@pytest.fixture()
def pool(tmp_path, slurm):
    made = []

    def make(*words, **more):
        made.append(Pool(tmp_path, slurm, *words, **more))
        return made[-1]
    yield make
    for one in made:
        one.end()


def test_a_dry_run_says_what_it_would_submit_and_submits_nothing(pool):
    it = pool("--dry-run", "--least", "2")
    done = subprocess.run(it.words, env=it.env, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    first, script = done.stdout.split("\n", 1)
    assert first.startswith(f"sbatch --parsable -J md-{it.pool} --array=1-2 -n1 ")
    assert script.startswith("#!/bin/bash") and it.slurm.ask("squeue", "-h") == ""


def test_pilots_come_for_a_queue_answer_as_this_host_does_and_end_idle(pool):
    it = pool("--idle", "2")
    with user(it) as ann:
        jobs = [ann.submit("identify", batch(400 + i, 2), fresh=True) for i in range(12)]
        jobs.append(ann.submit("identify", batch(3000, 60)))
        it.scale()
        results = [job.result(PATIENCE_S) for job in jobs]
        assert {ann.status(job.id)["attempts"] for job in jobs} == {1}
    with modald.local() as here:
        for i in (0, 12):
            data = batch(3000, 60) if i == 12 else batch(400 + i, 2)
            alone = here.submit("identify", data).result(PATIENCE_S)
            assert same(dict(results[i])) == same(dict(alone))
    until(lambda: it.slurm.pilots(it.pool) == {}, "the pilots did not end")
    assert it.elsewhere() == 0


def busy(it, client, jobs):
    """Nodes of those that run, by job."""
    docs = {job: state(client, job) for job in jobs}
    return {job: doc["worker"]["node"] for job, doc in docs.items() if "worker" in doc.header}


@pytest.mark.parametrize("count", [40, pytest.param(500, marks=LONG)])
def test_from_a_cold_start_all_jobs_are_done_once_though_a_node_dies_under_them(broken_pool, count):
    it = broken_pool("--idle", "20", "--least", "4")
    ann = it.client("ann")
    long = [scene_job(ann, seconds=0.4, fresh=True, priority=200)["job"] for _ in range(4)]
    with user(it) as client:
        jobs = [client.submit("identify", batch(400 + i % 7, 2), fresh=True) for i in range(count)]
        it.scale()
        until(lambda: "n1" in busy(it, ann, long).values())
        it.slurm.kill_node("n1")
        results = [job.result(PATIENCE_S) for job in jobs]
        again = [client.status(job.id)["attempts"] for job in jobs]
    with modald.local() as here:
        alone = [here.submit("identify", batch(400 + i, 2)).result(PATIENCE_S) for i in range(7)]
    assert all(same(dict(r)) == same(dict(alone[i % 7])) for i, r in enumerate(results))
    again += [ann.ask("WAIT", job=job, timeout_s=250)["attempts"] for job in long]
    # two were under way on n1, or one; a busy machine's pilots may have been silent for too long,
    # also once their result was here
    assert 1 in again and max(again) > 1
    assert it.counted("modald_worker_deaths_total") >= sum(again) - len(again)
    assert len(set(json.loads(ann.ask("LIST", limit=1000).body[0])["jobs"][i]["job"]
                   for i in range(count + 4))) == count + 4


@LONG
def test_a_controller_that_is_killed_delays_pilots_and_nothing_else(broken_pool):
    it = broken_pool("--idle", "25", "--least", "2")
    it.scale()
    until(lambda: it.elsewhere() >= 2)
    it.slurm.wait_saved()
    it.slurm.kill_controller()
    with user(it) as ann:
        first = [ann.submit("identify", batch(400 + i, 2), fresh=True) for i in range(6)]
        for job in first:
            job.result(PATIENCE_S)              # by the pilots that there are
        until(lambda: it.elsewhere() == 0, "idle pilots did not end")
        then = [ann.submit("identify", batch(500 + i, 2), fresh=True) for i in range(6)]
        until(lambda: "event=round" in it.scaled(), "the scaler said nothing")
        assert it.scaler.poll() is None
        it.slurm.start_controller()
        for job in then:
            job.result(PATIENCE_S)
        assert {ann.status(job.id)["attempts"] for job in first + then} == {1}


def test_a_pilot_that_slurm_holds_for_good_is_no_pilot(pool):
    it = pool("--idle", "2", "--least", "1", "--dry-run")
    it.slurm.ask("sbatch", "--hold", "--array=1-1", "-J", f"md-{it.pool}", "--output=/dev/null",
                 "--wrap=true")
    until(lambda: it.slurm.ask("squeue", "-h", "-r", "-n", f"md-{it.pool}"))

    def asked():
        return subprocess.run(it.words, env=it.env, capture_output=True, text=True).stdout
    until(lambda: "--array=1-1" not in asked())
    for job in it.slurm.ask("squeue", "-h", "-n", f"md-{it.pool}", "-o", "%F").split():
        it.slurm.ask("scontrol", "release", job)
        it.slurm.ask("scontrol", "hold", job)              # by root: the admin's hold
    assert "JobHeldAdmin" in it.slurm.ask("squeue", "-h", "-r", "-n", f"md-{it.pool}", "-o", "%r")
    until(lambda: "--array=1-1" in asked())                # once the hold of a failed one is over


@LONG
def test_a_controller_killed_at_the_start_of_its_pilots_leaves_none_that_count_and_never_come(
        broken_pool):
    it = broken_pool("--idle", "5", "--least", "2")
    it.slurm.ask("sbatch", "--array=1-2", "-J", f"md-{it.pool}", "--output=/dev/null",
                 "--wrap=sleep 10000")                    # as what is left of pilots: no worker
    until(lambda: len(it.slurm.pilots(it.pool)) == 2)
    gone = set(it.slurm.pilots(it.pool))
    it.slurm.kill_controller()
    it.scale()
    it.slurm.start_controller()
    with user(it) as ann:
        ann.submit("identify", batch(400, 2)).result(PATIENCE_S)
    until(lambda: it.elsewhere() == 2)
    said = it.scaled()
    # Slurm may call them running for ever, or have failed at once what it began anew
    assert "event=lost" in said or "failed_fast=2" in said, said
    assert not gone & set(it.slurm.pilots(it.pool))


@LONG
def test_a_pilot_that_is_cancelled_finishes_its_job_and_is_replaced(pool):
    it = pool("--idle", "60", "--least", "2", "--grace", "25")
    it.scale()
    until(lambda: it.elsewhere() >= 2)
    ann = it.client("ann")
    jobs = [scene_job(ann, seconds=1, fresh=True, max_attempts=1)["job"] for _ in range(6)]
    until(lambda: len(busy(it, ann, jobs)) >= 2)
    gone = next(iter(it.slurm.pilots(it.pool)))
    it.slurm.ask("scancel", gone)
    assert {ann.ask("WAIT", job=job, timeout_s=250)["state"] for job in jobs} == {"done"}
    until(lambda: gone not in it.slurm.pilots(it.pool) and it.elsewhere() >= 2,
          "no other pilot came")


@LONG
def test_a_daemon_killed_under_its_pilots_loses_and_doubles_nothing(pool):
    it = pool("--idle", "60", "--least", "2")
    it.scale()
    until(lambda: it.elsewhere() >= 2)
    ann = it.client("ann")
    jobs = [scene_job(ann, seconds=1, key=f"k{i}")["job"] for i in range(6)]
    until(lambda: len(busy(it, ann, jobs)) >= 2)
    it.daemon.kill()
    it.daemon.start()
    ann = it.client("ann")
    assert {ann.ask("WAIT", job=job, timeout_s=250)["state"] for job in jobs} == {"done"}
    assert len(json.loads(ann.ask("LIST").body[0])["jobs"]) == 6


@LONG
def test_no_job_is_killed_by_a_walltime_of_a_minute(pool):
    it = pool("--idle", "30", "--grace", "15", sbatch=("--time=1",))
    ann = it.client("ann")
    jobs = [scene_job(ann, seconds=0.5, fresh=True, max_attempts=1, run_limit_s=30)["job"]
            for _ in range(10)]
    it.scale()
    assert {ann.ask("WAIT", job=job, timeout_s=280)["state"] for job in jobs} == {"done"}
    assert "was lost" not in it.daemon.text()
