"""The queue as its users meet it: cancel, limits, workers that die, many submissions, events."""
import json
import os
import signal
import subprocess
import time

import numpy as np
import pytest
from conftest import BUILD, PATIENCE, SLOW, environment

import modald


SOME = {"rows": 1900, "columns": 2000, "rank.fixed": 60, "refine": False}     # about a second of one processor


def until(client, state, job, start=0):
    """The first event that takes JOB to STATE."""
    for event in client.events(start=start, job=job, timeout=PATIENCE):
        if event.header.get("state") == state:
            return event
    raise AssertionError(f"{job} never was {state}")


def slow_job(client, path, **more):
    return client.submit("identify", modald.Batch.read(path), SLOW, fresh=True, **more)


def test_cancel_of_a_running_job_is_final_in_under_two_seconds(client, daemon, slow_batch):
    job = slow_job(client, slow_batch)
    until(client, "running", job.id)
    start = time.monotonic()
    assert job.cancel().state == "cancelled"
    assert job.wait(10).state == "cancelled" and time.monotonic() - start < 2
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
        assert waiting.cancel().state == "cancelled" and waiting.document["attempts"] == 0
        busy.cancel()
        assert waiting.status().document["attempts"] == 0


def test_a_passed_run_limit_ends_the_attempt_in_under_two_seconds(client, slow_batch):
    job = slow_job(client, slow_batch, run_limit=0.5)
    until(client, "running", job.id)
    start = time.monotonic()
    job.wait(20)
    assert job.state == "failed" and job.document["error"]["code"] == "run_limit"
    assert time.monotonic() - start < 0.5 + 2


def test_a_deadline_ends_a_job_that_waits(own_daemon, slow_batch, batch):
    with own_daemon(workers=1).client() as client:
        busy = slow_job(client, slow_batch)
        until(client, "running", busy.id)
        job = client.submit("identify", modald.Batch.read(batch), deadline=0.3)
        assert job.wait(10).state == "failed" and job.document["error"]["code"] == "deadline" and job.document["attempts"] == 0
        busy.cancel()


def test_higher_priority_starts_first(own_daemon, slow_batch, batch):
    with own_daemon(workers=1).client() as client:
        busy = slow_job(client, slow_batch)
        until(client, "running", busy.id)
        read = modald.Batch.read(batch)
        low, high = (client.submit("identify", read, {"rank.fixed": 2 + i}, priority=p) for i, p in enumerate((50, 200)))
        assert high.status().document["position"] == 0 and low.status().document["position"] == 1
        busy.cancel()
        assert low.wait(30).document["started"] >= high.wait(30).document["finished"]


def test_a_job_whose_worker_is_killed_completes_on_another(own_daemon, slow_batch):
    daemon = own_daemon(workers=1)
    with daemon.client() as client:
        job = client.submit("identify", modald.Batch.read(slow_batch), SOME)
        until(client, "running", job.id)
        before = set(daemon.workers_now())
        for pid in before:
            os.kill(pid, signal.SIGKILL)
        assert job.wait(PATIENCE).state == "done" and job.document["attempts"] == 2, job.document
        assert not before & set(daemon.workers_now())


def test_an_input_that_kills_its_workers_ends_dead_and_blocks_nobody(own_daemon, ctl, slow_batch, batch):
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
        assert said.status == 1 and said.document["state"] == "dead" and said.document["error"]["code"] == "worker_died"
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
        waiting = subprocess.Popen([str(BUILD / "bin" / "modalctl"), "--server", daemon.endpoint, "--json", "wait", "key:second"],
                                   stdout=subprocess.PIPE, text=True, env=environment())
        until(client, "running", slow.id)
        daemon.kill()
        daemon.start()
        assert client.submit("identify", modald.Batch.read(batch), {"rank.fixed": 4}, key="first").id == job.id
        assert slow.wait(PATIENCE).state == "done", slow.document
        out, _ = waiting.communicate(timeout=PATIENCE)
        assert waiting.returncode == 0 and json.loads(out)["result"]["kind"] == "identify"


# -- scripts -----------------------------------------------------------------------------------------------------------

def listed(tmp_path, batch, count):
    path = tmp_path / "list.jsonl"
    path.write_text("".join(json.dumps({"kind": "identify", "file": batch, "options": {"rank.fixed": 2 + i % 3}}) + "\n" for i in range(count)))
    return path


def test_a_list_is_submitted_once_however_often_it_is_sent(daemon, ctl, client, batch, tmp_path):
    path = listed(tmp_path, batch, 200)
    first, second = (ctl("submit", "--from", path, server=daemon, one=False) for _ in range(2))
    assert first.status == second.status == 0
    assert {d["line"]: d["job"] for d in first.lines} == {d["line"]: d["job"] for d in second.lines}
    assert sorted(d["line"] for d in first.lines) == list(range(1, 201)) and all(d["duplicate"] for d in second.lines)
    assert all(client.wait(d["job"], PATIENCE)["state"] == "done" for d in first.lines)


def test_resume_sends_only_what_was_not_accepted(daemon, ctl, batch, tmp_path):
    path = listed(tmp_path, batch, 30)
    assert len(ctl("submit", "--from", path, "--resume", server=daemon, one=False).lines) == 30
    with open(path, "a") as file:
        file.write(json.dumps({"kind": "identify", "file": batch}) + "\n")
    again = ctl("submit", "--from", path, "--resume", server=daemon, one=False)
    assert [d["line"] for d in again.lines] == [31] and again.status == 0


def test_a_list_survives_the_daemons_death(own_daemon, batch, tmp_path):
    daemon = own_daemon()
    path = listed(tmp_path, batch, 3000)
    run = subprocess.Popen([str(BUILD / "bin" / "modalctl"), "--server", daemon.endpoint, "--json", "submit", "--from", str(path)],
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


@pytest.mark.parametrize("line, field", [("{", "line[1]"), ('{"kind": "identify"}', "line[1].file"), ('{"kind": "identify", "file": "x", "keys": 1}', "line[1].keys")])
def test_a_bad_line_is_named_before_anything_is_sent(line, field, daemon, ctl, tmp_path):
    (tmp_path / "list.jsonl").write_text(line + "\n")
    said = ctl("submit", "--from", tmp_path / "list.jsonl", server=daemon)
    assert said.status == 2 and said.document["error"]["field"] == field


def test_pages_of_list_cover_every_job_once(own_daemon, ctl, batch):
    daemon = own_daemon()
    with daemon.client() as client:
        read = modald.Batch.read(batch)
        jobs = client.submit_many([("identify", read, {"rank.fixed": 4}, f"k{i}") for i in range(25)])
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


def test_an_upload_cut_off_resumes_where_it_was(own_daemon, tmp_path):
    """The second sender begins at what the first one had acknowledged."""
    daemon = own_daemon()
    batch = modald.Batch(np.random.default_rng(5).standard_normal((200000, 2)), 0.01)      # 3.2 MB: 13 chunks
    with daemon.client() as client:
        begun, _ = client.ask("UPLOAD", {"op": "begin", "sha256": batch.sha256(), **batch.description()})
        for offset in (0, 262144):
            chunk = batch.bytes()[offset:offset + 262144]
            client.ask("UPLOAD", {"op": "chunk", "upload": begun["upload"], "offset": offset, "crc32c": modald.wire.crc32c(chunk)}, [chunk])
    daemon.kill()
    daemon.start()
    with daemon.client() as client:
        again, _ = client.ask("UPLOAD", {"op": "begin", "sha256": batch.sha256(), **batch.description()})
        assert again["upload"] == begun["upload"] and again["present"] == 2 * 262144
        shares = []
        assert client.upload(batch, progress=lambda what, share: shares.append(share)) == batch.sha256()
        assert shares[0] > 2 * 262144 / batch.signals.nbytes and shares[-1] == 1
        assert client.submit("identify", sha256=batch.sha256(), options={"rank.fixed": 2, "rows": 20, "columns": 40, "refine": False}).wait(PATIENCE).state == "done"
