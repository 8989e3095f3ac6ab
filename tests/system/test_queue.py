"""The queue as its users meet it: cancel, limits, workers that die, many submissions, events."""
import contextlib
import json
import os
import pathlib
import random
import signal
import subprocess
import time

import numpy as np
import pytest
from conftest import BUILD, PATIENCE, SLOW, environment, watched, write_batch

import modald
import wire


# about a second of one processor
SOME = {"rows": 1900, "columns": 2000, "rank.fixed": 60, "refine": False}


def until(client, state, job, start=0):
    """The first event that takes JOB to STATE."""
    for event in client.events(start=start, job=job, timeout=PATIENCE):
        if event.header.get("state") == state:
            return event
    raise AssertionError(f"{job} never was {state}")


def slow_job(client, path, **more):
    return client.submit("identify", modald.Batch.read(path), SLOW, fresh=True, **more)


def test_cancel_of_a_running_job_is_final_and_its_worker_goes(own_daemon, slow_batch):
    daemon = own_daemon(workers=1)
    with daemon.client() as client:
        job = slow_job(client, slow_batch)
        until(client, "running", job.id)
        before = set(daemon.workers_now())
        assert job.cancel() and job.wait(PATIENCE).state == "cancelled"
        wire.until(lambda: not before & set(daemon.workers_now()), "the worker lives on")
        with pytest.raises(modald.Error) as why:
            client.result(job.id)
    assert why.value.code == "cancelled"


def test_cancel_of_a_queued_job_never_starts_it(own_daemon, slow_batch, batch):
    daemon = own_daemon(workers=1)
    with daemon.client() as client:
        busy = slow_job(client, slow_batch)
        until(client, "running", busy.id)
        waiting = client.submit("identify", modald.Batch.read(batch))
        assert waiting.state == "queued" and waiting.document["position"] == 0
        assert (waiting.cancel() and waiting.state == "cancelled" and waiting.document["attempts"]
                == 0)
        busy.cancel()
        assert waiting.status().document["attempts"] == 0


def test_a_passed_run_limit_ends_the_attempt(client, slow_batch):
    job = slow_job(client, slow_batch, run_limit=0.5)
    job.wait(PATIENCE)
    assert (job.state == "failed" and job.document["error"]["code"] == "run_limit"
            and job.document["attempts"] == 1)


def test_a_deadline_ends_a_job_that_waits(own_daemon, slow_batch, batch):
    with own_daemon(workers=1).client() as client:
        busy = slow_job(client, slow_batch)
        until(client, "running", busy.id)
        job = client.submit("identify", modald.Batch.read(batch), deadline=0.3)
        assert (job.wait(PATIENCE).state == "failed"
                and job.document["error"]["code"] == "deadline" and job.document["attempts"] == 0)
        busy.cancel()


def test_higher_priority_starts_first(own_daemon, slow_batch, batch):
    with own_daemon(workers=1).client() as client:
        busy = slow_job(client, slow_batch)
        until(client, "running", busy.id)
        read = modald.Batch.read(batch)
        low, high = (client.submit("identify", read, {"rank.fixed": 2 + i}, priority=p)
                     for i, p in enumerate((50, 200)))
        assert high.status().document["position"] == 0 and low.status().document["position"] == 1
        busy.cancel()
        assert low.wait(PATIENCE).document["started"] >= high.wait(PATIENCE).document["finished"]


def test_a_job_whose_worker_is_killed_completes_on_another(own_daemon, slow_batch):
    daemon = own_daemon(workers=1)
    with daemon.client() as client:
        wire.until(lambda: client.stats()["workers"]["alive"] == 1)
        before = set(daemon.workers_now())
        for pid in before:                      # one that has not done it before it is killed
            os.kill(pid, signal.SIGSTOP)
        job = client.submit("identify", modald.Batch.read(slow_batch), SOME)
        until(client, "running", job.id)
        for pid in before:
            wire.signal_to(pid, signal.SIGKILL)
        assert job.wait(PATIENCE).state == "done" and job.document["attempts"] == 2, job.document
        assert not before & set(daemon.workers_now())


def test_an_input_that_kills_its_workers_ends_dead_and_blocks_nobody(own_daemon, ctl, slow_batch,
                                                                     batch):
    daemon = own_daemon(workers=1)
    with daemon.client() as client:
        job = slow_job(client, slow_batch)
        after = client.submit("identify", modald.Batch.read(batch), {"rank.fixed": 4})
        kills = 0
        for event in client.events(start=0, job=job.id, timeout=PATIENCE):
            if event.header.get("state") == "running":
                for pid in daemon.workers_now():
                    os.kill(pid, signal.SIGKILL)
                kills += 1
            if event.header.get("state") == "dead":
                break
        assert kills == 3
        said = ctl("wait", job.id, server=daemon)
        assert (said.status == 1 and said.document["state"] == "dead"
                and said.document["error"]["code"] == "worker_died")
        assert said.document["attempts"] == 3
        assert after.wait(PATIENCE).state == "done"
        # its input and the worker's last words are kept; it can be tried again
        assert ctl("stderr", job.id, server=daemon).status == 0
        said = ctl("retry", job.id, server=daemon)
        assert said.status == 0 and said.document["state"] in ("queued", "running")
        client.cancel(job.id)


def test_clients_find_a_daemon_that_was_killed_again(own_daemon, slow_batch, batch):
    daemon = own_daemon(workers=1)
    with daemon.client() as client:
        job = client.submit("identify", modald.Batch.read(batch), {"rank.fixed": 4}, key="first")
        job.wait(PATIENCE)
        slow = client.submit("identify", modald.Batch.read(slow_batch), SOME, key="second")
        waiting = subprocess.Popen([str(BUILD / "bin" / "modalctl"), "--server", daemon.endpoint,
                                    "--json", "wait", "key:second"],
                                   stdout=subprocess.PIPE, text=True, env=environment())
        until(client, "running", slow.id)
        daemon.kill()
        daemon.start()
        assert (client.submit("identify", modald.Batch.read(batch), {"rank.fixed": 4},
                              key="first").id == job.id)
        assert slow.wait(PATIENCE).state == "done", slow.document
        out, _ = waiting.communicate(timeout=PATIENCE)
        assert waiting.returncode == 0 and json.loads(out)["result"]["kind"] == "identify"


# -- scripts ---------------------------------------------------------------------------------------

def listed(tmp_path, batch, count):
    path = tmp_path / "list.jsonl"
    path.write_text("".join(json.dumps({"kind": "identify", "file": batch,
                                        "options": {"rank.fixed": 2 + i % 3}}) + "\n"
                            for i in range(count)))
    return path


def test_a_list_is_submitted_once_however_often_it_is_sent(daemon, ctl, client, batch, tmp_path):
    path = listed(tmp_path, batch, 200)
    first, second = (ctl("submit", "--from", path, server=daemon, one=False) for _ in range(2))
    assert first.status == second.status == 0
    assert {d["line"]: d["job"] for d in first.lines} == {d["line"]: d["job"] for d in second.lines}
    assert (sorted(d["line"] for d in first.lines) == list(range(1, 201))
            and all(d["duplicate"] for d in second.lines))
    assert all(client.wait(d["job"], PATIENCE)["state"] == "done" for d in first.lines)


def test_a_list_is_waited_for_and_the_exit_status_says_whether_all_succeeded(daemon, ctl, batch,
                                                                             tmp_path):
    path = listed(tmp_path, batch, 20)
    said = ctl("submit", "--from", path, "--wait", "--resume", server=daemon, one=False)
    accepted, ended = said.lines[:20], said.lines[20:]
    assert (said.status == 0 and [d["line"] for d in ended] == list(range(1, 21))
            and {d["state"] for d in ended} == {"done"})
    assert {d["line"]: d["job"] for d in accepted} == {d["line"]: d["job"] for d in ended}
    # all of it was accepted: it is waited for all the same
    again = ctl("submit", "--from", path, "--wait", "--resume", server=daemon, one=False)
    assert again.status == 0 and [d["job"] for d in again.lines[20:]] == [d["job"] for d in ended]


def test_of_a_list_that_is_waited_for_one_failure_is_told_and_one_refusal_too(daemon, ctl, batch,
                                                                              tmp_path):
    path = listed(tmp_path, batch, 3)
    good = path.read_text()
    (tmp_path / "zeros.csv").write_text("t,y\n" + "".join(f"{0.01 * i},0\n" for i in range(64)))
    path.write_text(good
                    + json.dumps({"kind": "identify", "file": str(tmp_path / "zeros.csv"),
                                  "options": {"rank.fixed": 60}}) + "\n")
    said = ctl("submit", "--from", path, "--wait", server=daemon, one=False)
    assert (said.status == 1 and [d["state"] for d in said.lines[4:]] == ["done"] * 3
            + ["failed"]), said.lines
    path.write_text(json.dumps({"kind": "identify", "file": batch, "priority": 999}) + "\n" + good)
    said = ctl("submit", "--from", path, "--wait", server=daemon, one=False)
    assert said.status == 4 and [d["state"] for d in said.lines[4:]] == ["done"] * 3


def test_a_list_that_is_not_finished_in_time_is_5(own_daemon, ctl, slow_batch, tmp_path):
    daemon = own_daemon(workers=1)
    (tmp_path / "list.jsonl").write_text(json.dumps({"kind": "identify", "file": str(slow_batch),
                                                     "options": SLOW}) + "\n")
    said = ctl("submit", "--from", tmp_path / "list.jsonl", "--wait", "--timeout", "1",
               server=daemon, one=False)
    assert said.status == 5 and said.lines[-1]["error"]["code"] == "timeout"
    daemon.kill()                                             # its job would be waited for


def test_resume_sends_only_what_was_not_accepted(daemon, ctl, batch, tmp_path):
    path = listed(tmp_path, batch, 30)
    assert len(ctl("submit", "--from", path, "--resume", server=daemon, one=False).lines) == 30
    with open(path, "a") as file:
        file.write(json.dumps({"kind": "identify", "file": batch}) + "\n")
    again = ctl("submit", "--from", path, "--resume", server=daemon, one=False)
    assert [d["line"] for d in again.lines] == [31] and again.status == 0


def test_a_line_that_was_changed_or_torn_in_the_journal_is_sent_by_resume(daemon, ctl, batch,
                                                                          tmp_path):
    """A torn 12 of 123 is not line 12, and a list with a line put in front of the others has other
    lines at the same numbers.
    """
    path = tmp_path / "torn.jsonl"
    lines = [json.dumps({"kind": "identify", "file": batch, "options": {"rank.fixed": 4},
                         "key": f"torn-{i}"}) for i in range(30)]

    def resumed():
        said = ctl("submit", "--from", path, "--resume", server=daemon, one=False)
        assert said.status == 0
        return sorted((d["line"], d["key"]) for d in said.lines)
    path.write_text("\n".join(lines[:20]))
    assert len(resumed()) == 20 and resumed() == []
    journal = tmp_path / "torn.jsonl.accepted"
    rows = journal.read_text().splitlines(keepends=True)
    last = int(rows[-1].split()[0])
    assert len(rows) == 20
    journal.write_text("".join(rows[:-1]) + rows[-1][:7])
    assert resumed() == [(last, f"torn-{last - 1}")] and resumed() == []
    path.write_text("\n".join(lines[20:] + lines[:20]))      # other lines at these numbers
    assert [line for line, _ in resumed()] == list(range(1, 31)) and resumed() == []


KILLS = int(os.environ.get("MODALD_KILLS", "4"))


def test_10000_jobs_are_each_there_once_though_their_submission_is_killed_again_and_again(
        own_daemon, batch, tmp_path):
    """KILLS kills of modalctl, each at a random place; what it printed or not, the last run ends 0
    and every line is one job.
    """
    daemon = own_daemon(workers=1)
    path, dice, count = tmp_path / "list.jsonl", random.Random(11), 10000
    path.write_text("".join(json.dumps({"kind": "identify", "file": batch,
                                        "options": {"rank.fixed": 4}}) + "\n"
                            for _ in range(count)))
    words = [str(BUILD / "bin" / "modalctl"), "--server", daemon.endpoint, "--json", "submit",
             "--from", str(path), "--resume"]
    killed, journal = 0, pathlib.Path(f"{path}.accepted")
    for _ in range(KILLS):
        # who prints a line a job waits for who reads: it has not ended before the kill
        with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
                              env=environment()) as run:
            for _ in range(dice.randrange(1, 2 * count // 3 // KILLS)):
                run.stdout.readline()
            time.sleep(dice.uniform(0, 0.02))
            killed += run.poll() is None
            run.kill()
    before = sum(1 for _ in open(journal))
    last = subprocess.run(words, capture_output=True, text=True, env=environment(),
                          timeout=PATIENCE)
    assert last.returncode == 0 and killed > 0, last.stderr
    told = [json.loads(line)["line"] for line in last.stdout.splitlines()]
    assert len(told) == len(set(told)) and count - before <= len(told) <= count - before + 1
    with daemon.client() as client:
        keys = [job["key"] for job in client.list(limit=1000)]
    assert (len(keys) == count
            and sorted(int(key.split(":")[1]) for key in keys) == list(range(1, count + 1)))


def test_a_list_survives_the_daemons_death(own_daemon, batch, tmp_path):
    daemon = own_daemon()
    path = listed(tmp_path, batch, 3000)
    run = subprocess.Popen([str(BUILD / "bin" / "modalctl"), "--server", daemon.endpoint, "--json",
                            "submit", "--from", str(path)],
                           stdout=subprocess.PIPE, text=True, env=environment())
    first = run.stdout.readline()
    daemon.kill()
    daemon.start()
    rest = run.stdout.read()
    run.wait(PATIENCE)
    documents = [json.loads(line) for line in [first, *rest.splitlines()]]
    assert run.returncode == 0 and sorted(d["line"] for d in documents) == list(range(1, 3001))
    with daemon.client() as client:
        assert sum(1 for _ in client.list(limit=1000)) == len({d["job"] for d in documents}) == 3000


@pytest.mark.parametrize("line, field",
                         [("{", "line[1]"), ('{"kind": "identify"}', "line[1].file"),
                          ('{"kind": "identify", "file": "x", "keys": 1}', "line[1].keys")])
def test_a_bad_line_is_named_before_anything_is_sent(line, field, daemon, ctl, tmp_path):
    (tmp_path / "list.jsonl").write_text(line + "\n")
    said = ctl("submit", "--from", tmp_path / "list.jsonl", server=daemon)
    assert said.status == 2 and said.document["error"]["field"] == field


def test_pages_of_list_cover_every_job_once(own_daemon, ctl, batch):
    daemon = own_daemon()
    with daemon.client() as client:
        read = modald.Batch.read(batch)
        jobs = client.submit_many([("identify", read, {"rank.fixed": 4}, f"k{i}")
                                   for i in range(25)])
        for job in jobs:
            job.wait(PATIENCE)
    seen, after = [], []
    while True:
        page = ctl("list", "--limit", "10", "--state", "done", *after, server=daemon).document
        seen += [d["job"] for d in page["jobs"]]
        if page["next"] is None:
            break
        after = ["--after", page["next"]]
    assert seen == [job.id for job in jobs]


def test_watch_prints_each_edge_once_as_lines_of_json(daemon, ctl, client, batch):
    job = client.submit("identify", modald.Batch.read(batch), {"rank.fixed": 4}, fresh=True)
    job.wait(PATIENCE)
    said = ctl("watch", job.id, server=daemon, one=False)
    assert said.status == 0 and [e["state"] for e in said.lines] == ["queued", "running", "done"]
    numbers = [e["number"] for e in said.lines]
    assert numbers == sorted(set(numbers))


def test_a_pushed_file_gives_live_modes_and_its_stream_can_be_watched_by_name(daemon, ctl,
                                                                              tmp_path):
    """One oscillation of 0.5 Hz and damping -0.05: each window of 200 samples has it."""
    t = 0.05 * np.arange(1000)
    path = write_batch(tmp_path / "run.h5", (np.exp(-0.05 * t) * np.cos(np.pi * t))[:, None])
    said = ctl("stream", path, "--name", "watched-run", "--window", "200", "--hop", "100",
               server=daemon, one=False)
    assert said.status == 0 and said.lines[-1]["acknowledged"] == 1000
    assert (said.lines[-2]["sample"] == 999
            and abs(said.lines[-2]["frequency_hz"] - np.hypot(np.pi, 0.05) / (2 * np.pi)) < 1e-9)
    lines = watched(daemon, "watched-run", until=lambda lines: lines)
    assert ({line["stream"] for line in lines if "stream" in line} == {"watched-run"}
            and lines[0]["event"] == "modes")


def test_a_worker_that_gave_signals_takes_the_next_job(own_daemon):
    """Its READY may come while the signals are still being sealed; one worker, so that a lost one
    is missed.
    """
    scene = {"structure": {"type": "chain", "masses": [1], "springs": [4, 0], "dampers": [0.1, 0]},
             "effects": [], "initial": {"x": {"x1": 1}}}
    with own_daemon(workers=1).client() as client:
        for samples in (100, 2000, 50000, 100, 200):
            job = client.submit("simulate",
                                {**scene, "time": {"dt": 0.01, "duration": 0.01 * samples}}).wait(
                PATIENCE)
            assert job.state == "done" and client.signals(job.id).signals.shape == (samples + 1, 1)


def test_an_upload_cut_off_resumes_where_it_was(own_daemon, tmp_path):
    """The second sender begins at what the first one had acknowledged."""
    daemon = own_daemon()
    # 3.2 MB: 13 chunks
    batch = modald.Batch(np.random.default_rng(5).standard_normal((200000, 2)), 0.01)
    with daemon.client() as client:
        begun, _ = client.ask("UPLOAD",
                              {"op": "begin", "sha256": batch.sha256(), **batch.description()})
        for offset in (0, 262144):
            chunk = batch.bytes()[offset:offset + 262144]
            client.ask("UPLOAD", {"op": "chunk", "upload": begun["upload"], "offset": offset,
                                  "crc32c": modald.wire.crc32c(chunk)}, [chunk])
    daemon.kill()
    daemon.start()
    with daemon.client() as client:
        again, _ = client.ask("UPLOAD",
                              {"op": "begin", "sha256": batch.sha256(), **batch.description()})
        assert again["upload"] == begun["upload"] and again["present"] == 2 * 262144
        shares = []
        assert (client.upload(batch, progress=lambda what, share: shares.append(share))
                == batch.sha256())
        assert shares[0] > 2 * 262144 / batch.signals.nbytes and shares[-1] == 1
        assert (client.submit("identify", sha256=batch.sha256(),
                              options={"rank.fixed": 2, "rows": 20, "columns": 40,
                                       "refine": False}).wait(PATIENCE).state == "done")


# -- the operator ----------------------------------------------------------------------------------

def test_a_backup_of_a_running_daemon_is_whole_and_starts(own_daemon, ctl, large_batch, tmp_path):
    daemon = own_daemon()
    assert (ctl("submit", "identify", large_batch, "-o", "rank.fixed=4", "--key", "kept", "--wait",
                server=daemon).status == 0)
    said = ctl("backup", tmp_path / "copy", "--data", daemon.data)
    assert said.status == 0, said.document
    for folder in (daemon.data, tmp_path / "copy"):
        said = ctl("fsck", "--data", folder)
        assert said.status == 0 and said.document["problems"] == [] and said.document["jobs"] == 1
    rows = ctl("dump", "--data", tmp_path / "copy", one=False).lines
    assert [row["row"] for row in rows].count("job") == 1
    first = ctl("result", "key:kept", server=daemon).document
    daemon.stop()
    daemon.data = str(tmp_path / "copy")
    daemon.start()
    assert ctl("result", "key:kept", server=daemon).document == first


def test_fsck_says_which_file_is_damaged_and_where(own_daemon, ctl, large_batch):
    daemon = own_daemon()
    assert (ctl("submit", "identify", large_batch, "-o", "rank.fixed=4", "--wait",
                server=daemon).status == 0)
    daemon.stop()
    path = next(pathlib.Path(daemon.data, "spool").glob("*.h5"))
    with open(path, "r+b") as file:
        file.seek(path.stat().st_size // 2)
        byte = file.read(1)
        file.seek(-1, os.SEEK_CUR)
        file.write(bytes([byte[0] ^ 1]))
    said = ctl("fsck", "--data", daemon.data)
    assert (said.status == 1 and said.document["error"]["code"] == "corrupt"
            and "input 1" in said.document["problems"][0]
            and "chunk" in said.document["problems"][0])


def test_what_is_no_data_folder_is_bad_input(ctl, tmp_path):
    for words in (["fsck"], ["dump"], ["backup", tmp_path / "b"]):
        assert ctl(*words).document["error"]["field"] == "data"
        assert ctl(*words, "--data", tmp_path / "absent").status == 2


def test_drained_a_daemon_refuses_work_and_answers_the_rest(own_daemon, ctl, batch):
    daemon = own_daemon()
    assert ctl("drain", server=daemon).document["draining"] is True
    said = ctl("submit", "identify", batch, server=daemon)
    assert said.status == 4 and said.document["error"]["code"] == "draining"
    assert ctl("list", server=daemon).status == 0
    assert ctl("undrain", server=daemon).document["draining"] is False
    assert ctl("identify", batch, "-o", "rank.fixed=4", server=daemon).status == 0


def keys_of(ctl, path, *server_key):
    return ctl("keygen", path, *server_key).document["public"]


def test_with_keys_each_user_has_their_own_jobs_and_nobody_else_gets_in(own_daemon, ctl, batch,
                                                                        tmp_path):
    server = keys_of(ctl, tmp_path / "server.key")
    public = {name: keys_of(ctl, tmp_path / f"{name}.key", server)
              for name in ("ann", "ben", "eve")}
    (tmp_path / "keys").write_text(f"{public['ann']} ann submit\n{public['ben']} ben read\n")
    (tmp_path / "keys").chmod(0o600)

    import conftest
    start = conftest.Daemon.start

    def with_key(self):                                     # the fixture's HELLO needs a key, too
        os.environ["MODALD_KEYFILE"] = str(tmp_path / "ann.key")
        try:
            start(self)
        finally:
            del os.environ["MODALD_KEYFILE"]
    conftest.Daemon.start = with_key
    try:
        daemon = own_daemon(config=[f"server_key = {tmp_path}/server.key",
                                    f"keys = {tmp_path}/keys"])
    finally:
        conftest.Daemon.start = start

    def as_user(name, *words):
        return ctl("--keyfile", tmp_path / f"{name}.key", *words, server=daemon)
    job = as_user("ann", "submit", "identify", batch, "--wait").document["job"]
    assert as_user("ann", "whoami").document["user"] == "ann"
    said = as_user("ben", "status", job)
    nothing = as_user("ben", "status", "nosuchjob")
    # B cannot tell whether A's job exists
    assert said.status == 4 and said.document == nothing.document
    assert as_user("ben", "submit", "identify", batch).document["error"]["code"] == "denied"
    assert as_user("eve", "whoami").status in (3, 4)
    assert ctl("--keyfile", tmp_path / "ann.key", "whoami", server=daemon).status == 0
    assert ctl("whoami", server=daemon).status in (3, 4)                   # no key at all
    (tmp_path / "ann.key").chmod(0o644)
    said = as_user("ann", "whoami")
    assert said.status == 2 and said.document["error"]["field"] == "keyfile"


def listed_keys(said):
    return [job["key"] for job in said.document["jobs"]]


def test_a_list_is_of_the_newest_first_page_by_page_and_of_keys_that_begin_so(own_daemon, ctl,
                                                                              batch):
    daemon = own_daemon(workers=1)
    for i in range(7):
        assert ctl("submit", "identify", batch, "--key", f"{'even' if i % 2 == 0 else 'odd'}-{i}",
                   "--wait", server=daemon).status == 0
    everything = [f"{'even' if i % 2 == 0 else 'odd'}-{i}" for i in range(7)]
    assert listed_keys(ctl("list", server=daemon)) == everything
    assert listed_keys(ctl("list", "--newest", server=daemon)) == everything[::-1]
    walked, after = [], []
    while True:
        page = ctl("list", "--newest", "--limit", 3, *after, server=daemon)
        walked += listed_keys(page)
        if page.document["next"] is None:
            break
        after = ["--after", page.document["next"]]
    assert walked == everything[::-1]
    assert listed_keys(ctl("list", "--newest", "--key", "odd-",
                           server=daemon)) == ["odd-5", "odd-3", "odd-1"]
    assert listed_keys(ctl("list", "--key", "odd-", "--state", "failed", server=daemon)) == []
    assert listed_keys(ctl("list", "--newest", "--key", "even-", "--limit", 2,
                           server=daemon)) == ["even-6", "even-4"]


def test_a_list_is_of_what_was_submitted_since(own_daemon, ctl, client, batch):
    daemon = own_daemon(workers=1)
    submitted = [ctl("submit", "identify", batch, "--key", f"k{i}", "--wait",
                     server=daemon).document["submitted"] for i in range(3)]
    with contextlib.closing(wire.Client(daemon.endpoint)) as asked:
        for i, since in enumerate(submitted):
            reply = asked.ask("LIST", since=since - 1e-4)
            assert [job["key"]
                    for job in json.loads(reply.body[0])["jobs"]] == [f"k{n}" for n in range(i, 3)]
    assert (listed_keys(ctl("list", "--since", "1d", server=daemon)) == ["k0", "k1", "k2"]
            == listed_keys(ctl("list", "--since", "2020-02-29T12:00", server=daemon)))
    assert listed_keys(ctl("list", "--since", "2999-01-01", server=daemon)) == []
    for wrong in ("yesterday", "12", "-3h", "2026-13-01", "1w"):
        said = ctl("list", "--since", wrong, server=daemon)
        assert said.status == 2 and said.document["error"]["field"] == "since", wrong
