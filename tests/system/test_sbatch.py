"""--sbatch: a sweep or a list as an array job, computed by a stand-in of sbatch with bash, and on a
real Slurm; the results of --local, whatever of it came late or not at all.
"""
import errno
import json
import math
import os
import pathlib
import re
import resource
import shlex
import signal
import subprocess

import numpy as np
import pytest

import slurm_local
from conftest import BUILD, PATIENCE, decay, environment, write_batch
from test_elsewhere import same
from test_sweep import strutt, table

CTL = str(BUILD / "bin" / "modalctl")


def plain(*words, cwd=None):
    """As a person runs it: no --json."""
    return subprocess.run([CTL, *map(str, words)], capture_output=True, text=True, cwd=cwd,
                          timeout=PATIENCE, env=environment())


def elements(said):
    """Those of an --array, as Slurm reads it."""
    for part in said.split(","):
        first, _, last = part.partition("-")
        yield from range(int(first), int(last or first) + 1)


def sbatch(*words):
    """What sbatch does with `[--array=A] SCRIPT`: the script by bash, once an element."""
    script = pathlib.Path(words[-1])
    asked = words[0] if len(words) > 1 else re.search("^#SBATCH (--array=.*)", script.read_text(),
                                                      re.M)[1]
    return [subprocess.run(["bash", script], cwd="/", timeout=PATIENCE,
                           env={**environment(), "SLURM_ARRAY_TASK_ID": str(i)}).returncode
            for i in elements(asked.removeprefix("--array="))]


def pasted(text):
    """The command that TEXT has in a line of its own, as a shell takes it apart."""
    return shlex.split(re.search("^ +sbatch (.*)", text, re.M)[1])


@pytest.fixture()
def folder(tmp_path):
    """With what a path may have."""
    made = tmp_path / "it's; $(touch pwned) `a` \"b\" é"
    made.mkdir()
    return made


def write(folder, document, name="sweep.json"):
    (folder / name).write_text(json.dumps(document))
    return folder / name


def signals(path, seed=0):
    samples = decay() + 1e-3 * np.random.default_rng(seed).standard_normal((400, 2))
    np.savetxt(path, np.column_stack([np.arange(400) * 0.05, samples]), delimiter=",",
               header="t,a,b",
               comments="", fmt="%.17g")
    return str(path)


# ---- a sweep ----

def test_a_sweep_by_slurm_is_that_of_local(ctl, folder):
    path = write(folder, strutt(7))
    said = plain("sweep", path, "--sbatch", folder / "tasks", "--array", "5")
    assert said.returncode == 0 and sbatch(*pasted(said.stdout)) == [0] * 5
    gathered, local = ctl("gather", folder / "tasks"), ctl("sweep", path)
    assert gathered.status == 0 and table(gathered.document) == table(local.document)
    assert (plain("gather", folder / "tasks", "--csv").stdout
            == plain("--local", "sweep", path, "--csv").stdout)
    assert plain("gather", folder / "tasks", "--plot", folder / "x.svg").returncode == 0
    assert "<svg" in (folder / "x.svg").read_text() and not (folder / "pwned").exists()


def test_of_more_points_than_tasks_every_task_is_a_share(ctl, folder):
    path = write(folder, strutt(40))
    said = ctl("sweep", path, "--sbatch", folder / "tasks", "--array", "3").document
    assert said["tasks"] == 1000 and said["elements"] == 3
    lines = (folder / "tasks" / "tasks.jsonl").read_text().splitlines()[1:]
    shares = [json.loads(line)["options"] for line in lines]
    assert [s["first"] for s in shares] == [math.floor(1600 * i / 1000) for i in range(1000)]
    assert sum(s["count"] for s in shares) == 1600 and min(s["count"] for s in shares) == 1


def test_tasks_that_are_missing_are_named_and_computed_by_what_is_said(ctl, folder):
    path = write(folder, strutt(5))
    first = pasted(plain("sweep", path, "--sbatch", folder / "tasks", "--array", "6").stdout)
    sbatch("--array=1,5", *first)
    (folder / "tasks" / "1.json").write_text('{"kind":"swe')       # a node that died while it wrote
    said = plain("gather", folder / "tasks")
    assert said.returncode == 4 and said.stdout == ""
    assert "not_found: 17 of 25 tasks have no result: point 0, point 1, point 2, point 3, point 5" \
        in said.stderr
    again = pasted(said.stderr)
    assert again[0] == "--array=1-4,6" and sbatch(*again) == [0] * 5
    assert table(ctl("gather", folder / "tasks").document) == table(ctl("sweep", path).document)


def test_a_task_with_a_result_is_not_computed_again(folder):
    first = pasted(plain("sweep", write(folder, strutt(2)), "--sbatch", folder / "tasks").stdout)
    sbatch(*first)
    done = {p: p.stat().st_mtime_ns for p in (folder / "tasks").glob("*.json")}
    assert sbatch(*first) == [0] * 4
    assert {p: p.stat().st_mtime_ns for p in (folder / "tasks").glob("*.json")} == done
    assert not list((folder / "tasks").glob("*.part*"))


def test_what_a_sweep_was_when_its_tasks_were_written_is_computed(ctl, folder):
    path = write(folder, strutt(3))
    local = ctl("sweep", path).document
    first = pasted(plain("sweep", path, "--sbatch", folder / "tasks").stdout)
    write(folder, strutt(4))
    sbatch(*first)
    assert table(ctl("gather", folder / "tasks").document) == table(local)


def test_points_that_fail_stay_in_their_rows_and_a_failed_share_is_named(ctl, folder):
    document = strutt(3)
    document["grid"][1]["values"][1] = -1
    path = write(folder, document)
    first = pasted(plain("sweep", path, "--sbatch", folder / "tasks").stdout)
    sbatch(*first)
    gathered = ctl("gather", folder / "tasks")
    assert gathered.status == 1 and table(gathered.document) == table(ctl("sweep", path).document)
    error = {"error": {"code": "no_memory", "message": "no memory for it"}}
    (folder / "tasks" / "3.json").write_text(json.dumps(error))
    said = ctl("gather", folder / "tasks").document["error"]
    assert (said["code"], said["message"]) == ("no_memory", "task 3, point 2: no memory for it")
    sbatch(*first)
    again = ctl("gather", folder / "tasks").document
    assert table(again) == table(gathered.document)


@pytest.mark.parametrize("words, field", [
    (["--wait"], "wait"), (["--key", "k"], "key"), (["--priority", "9"], "priority"),
    (["--cancel"], "cancel"), (["-o", "first=1"], "sbatch"), (["--array", "0"], "array")])
def test_what_an_array_job_has_no_use_for_is_refused(ctl, folder, words, field):
    said = ctl("sweep", write(folder, strutt(2)), "--sbatch", folder / "tasks", *words)
    assert said.status == 2 and said.document["error"]["field"] == field
    assert not (folder / "tasks").exists()


def test_a_folder_of_tasks_is_not_written_over(ctl, folder):
    path = write(folder, strutt(2))
    assert ctl("sweep", path, "--sbatch", folder / "tasks").status == 0
    kept = (folder / "tasks" / "tasks.jsonl").read_bytes()
    said = ctl("sweep", write(folder, strutt(3)), "--sbatch", folder / "tasks")
    assert said.status == 2 and "holds tasks already" in said.document["error"]["message"]
    assert (folder / "tasks" / "tasks.jsonl").read_bytes() == kept
    assert ctl("gather", folder).document["error"]["field"] == "folder"
    assert ctl("task", folder / "tasks", "5").document["error"]["field"] == "arguments"


# ---- a list ----

def listed(folder, lines):
    path = folder / "list 1.jsonl"
    path.write_text("".join((line if isinstance(line, str) else json.dumps(line)) + "\n"
                            for line in lines))
    return path


SCENE = {"structure": {"type": "matrices", "M": [[2]], "C": [[0.4]], "K": [[200]]}, "omega": 3,
         "excitation": [{"dof": "x1", "k": 1, "cos": 1}], "time": {"dt": 0.01, "duration": 2}}


def test_a_list_by_slurm_is_what_local_gives_line_by_line(ctl, folder):
    data, scene = signals(folder / "it's a $HOME.csv"), str(write(folder, SCENE, "s.json"))
    path = listed(folder, [
        {"kind": "identify", "file": data, "options": {"rank.fixed": 4}, "key": "'; touch pwned #"},
        "",
        {"kind": "identify", "file": data, "options": {"rank.fixed": "$(touch pwned)"}},
        {"kind": "steady", "file": scene},
        {"kind": "tradeoff", "of": "steady", "file": scene},
        {"kind": "simulate", "file": scene}])
    said = plain("submit", "--from", path, "--sbatch", folder / "tasks", "--array", "2")
    sbatch(*pasted(said.stdout))
    gathered = ctl("gather", folder / "tasks", one=False)
    assert [line["line"] for line in gathered.lines] == [1, 3, 4, 5, 6]
    assert gathered.lines[0]["job"] == "key:'; touch pwned #"
    assert gathered.lines[1]["job"].startswith("key:list 1.jsonl:3:")
    assert gathered.lines[1]["error"]["code"] == "bad_input"
    alone = {1: ctl("identify", data, "-o", "rank.fixed=4").document,
             4: ctl("steady", scene).document}
    for line in gathered.lines:
        if line["line"] in alone:
            assert same(line["result"]) == same(alone[line["line"]])
    assert [line["result"]["kind"] for line in gathered.lines if "result" in line] == [
        "identify", "steady", "tradeoff", "simulate"]
    assert (folder / "tasks" / "5.h5").stat().st_size > 200 * 8
    assert not [p for p in pathlib.Path("/").glob("pwned")] and not (folder / "pwned").exists()


def test_a_list_and_the_daemon_say_the_same_of_it(ctl, daemon, folder):
    data = signals(folder / "d.csv")
    path = listed(folder, [{"kind": "identify", "file": data, "options": {"rank.fixed": n}}
                           for n in (2, 4)])
    ctl("submit", "--from", path, "--wait", server=daemon, one=False)
    served = ctl("results", "--from", path, server=daemon, one=False).lines
    sbatch(*pasted(plain("submit", "--from", path, "--sbatch", folder / "tasks").stdout))
    gathered = ctl("gather", folder / "tasks", one=False).lines
    assert [{**a, "result": same(a["result"])} for a in gathered] == [
        {**a, "result": same(a["result"])} for a in served]
    assert plain("gather", folder / "tasks", "--csv").stdout.count("\n") == 1 + 1 + 2


def test_of_a_list_what_is_missing_is_an_error_of_its_line(ctl, folder):
    data = signals(folder / "d.csv")
    path = listed(folder, [{"kind": "identify", "file": data, "options": {"rank.fixed": 4}}] * 3)
    first = pasted(plain("submit", "--from", path, "--sbatch", folder / "tasks").stdout)
    sbatch("--array=2", *first)
    gathered = ctl("gather", folder / "tasks", one=False)
    assert gathered.status == 4 and ["result" in line for line in gathered.lines] == [False, True,
                                                                                     False]
    assert gathered.lines[2]["error"]["code"] == "not_found"
    assert str(folder / "tasks" / "log.3") in gathered.lines[2]["error"]["message"]
    again = pasted(plain("gather", folder / "tasks").stderr)
    assert again[0] == "--array=1,3"


def test_an_input_that_is_another_by_then_is_none(ctl, folder):
    data = signals(folder / "d.csv")
    path = listed(folder, [{"kind": "identify", "file": data, "options": {"rank.fixed": 4}}])
    first = pasted(plain("submit", "--from", path, "--sbatch", folder / "tasks").stdout)
    signals(folder / "d.csv", seed=1)
    assert sbatch(*first) == [1]
    said = ctl("gather", folder / "tasks", one=False).lines[0]["error"]
    assert said["field"] == "file" and "is not what it was" in said["message"]
    signals(folder / "d.csv")
    assert sbatch(*first) == [0] and ctl("gather", folder / "tasks", one=False).status == 0


def test_how_files_are_read_is_said_to_the_tasks_too(ctl, folder):
    np.savetxt(folder / "bare.csv", decay(), delimiter=",", fmt="%.17g")
    path = listed(folder, [{"kind": "identify", "file": str(folder / "bare.csv")}])
    words = ["-o", "rank.fixed=4", "--dt", "0.05", "--scale", "2"]
    sbatch(*pasted(plain("submit", "--from", path, "--sbatch", folder / "tasks", *words).stdout))
    assert (same(ctl("gather", folder / "tasks", one=False).lines[0]["result"])
            == same(ctl("identify", folder / "bare.csv", *words).document))


def test_a_run_limit_that_passes_is_the_tasks_error(ctl, folder):
    scene = write(folder, {**SCENE, "time": {"dt": 0.01, "duration": 1e4}}, "s.json")
    path = listed(folder, [{"kind": "simulate", "file": str(scene), "run_limit_s": 0.001,
                            "options": {"integrator": "rk4", "substeps": 1000}}])
    sbatch(*pasted(plain("submit", "--from", path, "--sbatch", folder / "tasks").stdout))
    assert ctl("gather", folder / "tasks", one=False).lines[0]["error"]["code"] == "run_limit"


@pytest.mark.parametrize("line, told", [
    ({"kind": "identify", "file": "absent.csv"}, "absent.csv"),
    ({"kind": "identify", "file": "stream:rig7"}, "stream:rig7"),
    ({"kind": "identify", "file": "-"}, "-"),
    ({"kind": "identfy", "file": "d.csv"}, "identify"),
    ({"kind": "identify", "file": "d.csv", "optoins": {}}, "optoins"),
    ("{", "line 2")])
def test_a_line_that_cannot_be_a_task_is_named_and_nothing_stays(ctl, folder, line, told):
    good = {"kind": "identify", "file": signals(folder / "d.csv")}
    path = listed(folder, [good, {**line, "file": str(folder / "d.csv")}
                           if isinstance(line, dict) and line["file"] == "d.csv" else line])
    said = ctl("submit", "--from", path, "--sbatch", folder / "tasks")
    assert said.status == 2 and said.document["error"]["message"].startswith("line 2: ")
    assert told in said.document["error"]["message"]
    assert not list((folder / "tasks").iterdir())
    assert ctl("gather", folder / "tasks").status == 2


# ---- a real Slurm ----

@pytest.fixture()
def slurm(tmp_path):
    why = slurm_local.missing()
    if why is not None:
        pytest.skip(why)
    (tmp_path / "slurm").mkdir()
    made = slurm_local.Slurm(tmp_path / "slurm")
    yield made
    made.end()


def test_a_real_slurm_computes_what_local_does(ctl, slurm, folder):
    path = write(folder, strutt(9))
    said = plain("sweep", path, "--sbatch", folder / "tasks", "--array", "4")
    ran = subprocess.run(["sbatch", "--parsable", "--wait", *pasted(said.stdout)], cwd=folder,
                         env={**slurm.env, **environment()}, capture_output=True, text=True,
                         timeout=PATIENCE)
    assert ran.returncode == 0, (ran.stderr, [p.read_text() for p in folder.glob("tasks/log.*")])
    assert table(ctl("gather", folder / "tasks").document) == table(ctl("sweep", path).document)
    assert sorted(p.name for p in (folder / "tasks").glob("log.*")) == [f"log.{i}" for i in
                                                                       range(1, 5)]


def test_tasks_that_there_is_no_room_for_leave_nothing(tmp_path):
    """The script, which is written before, has room: it went, and tasks.jsonl was closed twice."""
    write_batch(tmp_path / "in.h5", decay(100))
    listed = tmp_path / "list"
    listed.write_text(10 * f'{{"kind": "identify", "file": "{tmp_path}/in.h5"}}\n')
    assert plain("submit", "--from", listed, "--sbatch", tmp_path / "a").returncode == 0
    room = (tmp_path / "a" / "job.sh").stat().st_size
    assert room < (tmp_path / "a" / "tasks.jsonl").stat().st_size

    def few_bytes():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (room, room))

    done = subprocess.run([CTL, "submit", "--from", listed, "--sbatch", tmp_path / "b"],
                          preexec_fn=few_bytes, capture_output=True, text=True, timeout=PATIENCE,
                          env=environment())
    assert done.returncode == 2 and os.strerror(errno.EFBIG) in done.stderr, done
    assert not list((tmp_path / "b").iterdir())
