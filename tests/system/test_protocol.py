"""One test a rule of proto/PROTOCOL.md, through the socket; the sentence is the name.  The workers
are fake_worker.py.
"""
import json
import os
import pathlib
import random
import re
import signal
import socket
import struct
import time

import pytest
import zmq

from wire import PATIENCE_S, VERSION, Daemon, crc32c, identity, ring_down, submit, until

HERE = pathlib.Path(__file__).parent
FAKE = f"worker_path = {HERE / 'fake_worker.py'}\n"


@pytest.fixture(scope="module")
def daemon():
    with Daemon(config=FAKE, workers=2) as d:
        yield d


def alive(client):
    return client.ask("HELLO").ok


def wait(client, job, **more):
    return client.ask("WAIT", job=job, timeout_s=250, **more)


def running(client, gate, **more):
    """A job that runs until GATE is opened: its id, once it runs."""
    job = submit(client, options=gate.options, **more)["job"]
    until(lambda: client.ask("STATUS", job=job)["state"] == "running")
    return job


# ---- section 2: frames


def test_another_version_is_answered_by_bad_version_with_those_spoken(client):
    client.raw(b"MODALD9", b"HELLO", b'{"id":1}')
    reply = client.receive()
    assert reply.code == "bad_version" and reply["error"]["detail"]["versions"] == ["MODALD1"]


@pytest.mark.parametrize("frames", [
    [VERSION], [VERSION, b"HELLO"], [VERSION, b"HELLO", b'{"id":1}'] + [b"x"] * 6,
                                    [VERSION, b"", b'{"id":1}'],
    [VERSION, b"A" * 17, b'{"id":1}'], [VERSION, b"hello", b'{"id":1}'], [VERSION, b"HELLO", b""],
                                    [VERSION, b"HELLO", b"[1]"],
    [VERSION, b"HELLO", b"{"], [VERSION, b"HELLO", b'{"id":1,"id":2}'],
                                    [VERSION, b"HELLO", b'{"id":1e999}'],
    [VERSION, b"HELLO", b'{"id":NaN}'], [VERSION, b"HELLO", b'{"id":1,"client":"\xff"}'],
                                    [VERSION, b"HELLO", b"{}"],
    [VERSION, b"HELLO", b'{"id":""}'], [VERSION, b"HELLO", b'{"id":"' + b"x" * 65 + b'"}'],
                                    [VERSION, b"HELLO", b'{"id":1.5}'],
    [VERSION, b"HELLO", b'{"id":1,"client":"' + b"x" * 65536 + b'"}'],
    [VERSION, b"HELLO", b'{"id":1,"client":' + b"[" * 33 + b"]" * 33 + b"}"],
], ids=["one frame", "no header", "9 frames", "empty verb", "long verb", "small letters",
        "empty header", "no object", "cut", "twice",
        "overflow", "NaN", "no UTF-8", "no id", "empty id", "long id", "fraction id",
        "oversize header", "nested past 32"])
def test_a_message_that_breaks_section_2_is_answered_by_bad_frame(client, frames):
    client.raw(*frames)
    assert client.receive().code == "bad_frame"
    assert alive(client)


def test_an_unknown_verb_is_answered_by_unknown_verb(client):
    assert client.ask("FLY").code == "unknown_verb"


def test_an_unknown_member_is_refused_by_its_name(client):
    reply = client.ask("STATUS", job="x", jbo="y")
    assert reply.code == "bad_input" and reply["error"]["field"] == "jbo"


@pytest.mark.parametrize("identifier", [7, -3, 2**53, "a", "x" * 64, "ü"])
def test_every_answer_echoes_the_id_of_its_request(client, identifier):
    client.raw(VERSION, b"HELLO", json.dumps({"id": identifier}).encode())
    assert client.receive()["id"] == identifier


def test_a_frame_over_1048576_bytes_closes_the_connection_and_nothing_else(daemon, client):
    loser, gate = daemon.client(), daemon.gate()
    ended = loser.socket.get_monitor_socket(zmq.EVENT_DISCONNECTED)
    assert loser.ask("HELLO").ok
    job = running(client, gate)
    loser.raw(VERSION, b"SUBMIT", b'{"id":1}', b"x" * (1048576 + 1))
    assert ended.poll(1000 * PATIENCE_S), "the connection lives on"
    gate.open()
    assert wait(client, job)["state"] == "done"
    loser.socket.disable_monitor()
    loser.close()


def test_a_message_of_200_frames_is_answered_and_dropped(daemon, client):
    rude = daemon.client()
    rude.raw(VERSION, b"SUBMIT", b'{"id":1}', *[b"x" * 100] * 200)
    assert rude.receive().code == "bad_frame"
    assert alive(client)


def test_the_senders_other_jobs_are_unharmed_by_malformed_messages(daemon, client):
    gate = daemon.gate()
    job = running(client, gate)
    dice = random.Random(5)
    for _ in range(300):
        client.raw(*[dice.randbytes(dice.randrange(40)) for _ in range(dice.randrange(1, 12))])
    gate.open()
    done = wait(client, job)
    assert done["state"] == "done" and done["attempts"] == 1
    client.early.clear()


# ---- HELLO


def test_hello_tells_versions_limits_and_who_i_am(client):
    hello = client.ask("HELLO", versions=["MODALD1"], client="test 1")
    assert hello["version"] == "MODALD1" and hello["user"] == "local" and hello["role"] == "admin"
    assert hello["limits"]["frames"] == 8 and hello["limits"]["inline"] == 65536


def test_hello_without_a_common_version_is_bad_version(client):
    assert client.ask("HELLO", versions=["MODALD7"]).code == "bad_version"


# ---- SUBMIT


def test_a_small_job_takes_one_round_trip_to_submit_and_one_to_have(client):
    job = submit(client)
    assert job.ok and job["state"] == "queued" and job["duplicate"] is False
    done = wait(client, job["job"], result=True)
    assert done["state"] == "done" and done["attempts"] == 1
    document = client.ask("RESULT", job=job["job"])
    assert document.body[0] == done.body[0] and json.loads(done.body[0])["kind"] == "identify"
    assert document["total"] == len(done.body[0]) == done["bytes"]


def test_the_same_key_again_returns_the_same_job(client):
    first = submit(client, key="same", options={"sleep": 0.2})
    again = submit(client, key="same", options={"sleep": 0.2}, priority=3, run_limit_s=9)
    assert again["job"] == first["job"] and again["duplicate"] is True
    assert wait(client, "key:same")["attempts"] == 1
    assert submit(client, key="same", options={"sleep": 0.2})["state"] == "done"


def test_the_order_of_options_is_no_difference(client):
    first = submit(client, key="order", options={"say": "x", "progress": 0.5})
    assert submit(client, key="order", options={"progress": 0.5, "say": "x"})["job"] == first["job"]


@pytest.mark.parametrize("sign", ["\x1b", "\x7f", "\x80", "\x9b", "\x9f", "\u202e",
                                  "\u2066", "\u200f"])
def test_no_key_unit_or_name_of_a_stream_or_channel_has_a_sign_that_a_terminal_obeys(client, sign):
    text, what = f"a{sign}31m", dict(content="batch", samples=400, channels=1, dt=0.01)
    for verb, header in (("SUBMIT", {"kind": "identify", "key": text, "input": what}),
                         ("SUBMIT", {"kind": "identify", "input": {**what, "units": text}}),
                         ("SUBMIT", {"kind": "identify", "input": {**what, "names": [text]}}),
                         ("UPLOAD", {"op": "begin", "key": text, **what}),
                         ("UPLOAD", {"op": "begin", "names": [text], **what}),
                         ("STREAM", {"op": "open", "name": "x", "names": [text], "channels": 1,
                                     "dt": 0.01}),
                         ("STREAM", {"op": "open", "name": text, "channels": 1, "dt": 0.01})):
        reply = client.ask(verb, [bytes(3200)] if verb == "SUBMIT" else [], **header)
        assert reply.code == "bad_input" and "control" in reply["error"]["message"], reply


@pytest.mark.parametrize("other", [{"options": {"say": "other"}}, {"phase": 0.7}],
                         ids=["options", "input"])
def test_the_same_key_with_other_content_is_a_conflict(client, other):
    submit(client, key=f"clash{sorted(other)}")
    assert submit(client, key=f"clash{sorted(other)}", **other).code == "conflict"


def test_a_repeated_submission_in_flight_is_one_job(client):
    data, described = ring_down(phase=0.31)
    numbers = [client.send("SUBMIT", [data], kind="identify", input=described, key="burst")
               for _ in range(20)]
    replies = [client.answer(n) for n in numbers]
    assert (len({r["job"] for r in replies}) == 1
            and [r["duplicate"] for r in replies].count(False) == 1)


def parts(client, jobs, body):
    """The answers to the submissions JOBS in one message."""
    reply = client.ask("SUBMITS", [body] if body else [], jobs=jobs)
    assert reply.ok and reply["verb"] == "SUBMITS", reply
    answers = json.loads(reply.body[0])["jobs"]
    assert len(answers) == reply["count"] == len(jobs)
    return answers


def test_submissions_in_one_message_are_answered_each_as_by_submit(client):
    one, described = ring_down(samples=40, phase=0.41)
    two, _ = ring_down(samples=40, phase=0.42)
    scene = b'{"structure":{"type":"chain","masses":[1.0],"springs":[100.0,0.0]}}'
    known = client.ask("SUBMIT", [one], kind="identify", input=described, key="together")
    job = {"kind": "identify", "input": described}
    answers = parts(client, [{**job, "key": "together"}, {**job, "key": "together"},
                             {**job, "key": "new", "priority": 7}, {**job, "kind": "identfy"},
                             {"kind": "steady", "input": {"content": "scene", "bytes": len(scene)},
                              "key": "scene"},
                             {**job, "key": "new", "priority": 8}, {**job, "priority": 256},
                             {"kind": "identify", "input": {"sha256": "0" * 64}}],
                    one + two + two + one + scene + two + one)
    assert answers[0]["job"] == known["job"] and answers[0]["duplicate"] is True
    assert answers[1]["error"]["code"] == "conflict"
    assert ((answers[2]["state"], answers[2]["duplicate"], answers[2]["priority"],
             answers[2]["key"]) == ("queued", False, 7, "new"))
    assert (answers[3]["error"]["code"], answers[3]["error"]["field"]) == ("bad_input", "kind")
    assert answers[4]["kind"] == "steady" and answers[4]["duplicate"] is False
    assert (answers[5]["job"] == answers[2]["job"] and answers[5]["duplicate"] is True
            and answers[5]["priority"] == 7)
    assert (answers[6]["error"]["code"], answers[6]["error"]["field"]) == ("bad_input", "priority")
    assert answers[7]["error"]["code"] == "not_found"
    assert wait(client, "key:new")["state"] == "done"
    assert client.ask("RESULT", job="key:new", part="input").body[0] == two
    assert client.ask("RESULT", job="key:scene", part="input").body[0] == scene


def test_256_submissions_go_in_one_message_and_survive_a_kill_once_they_are_answered():
    with Daemon(config=FAKE, workers=0) as d:
        c, described = d.client(), {"content": "batch", "samples": 16, "channels": 1, "dt": 1}
        answers = parts(c, [{"kind": "identify", "input": described, "key": f"k{i}"}
                            for i in range(256)], os.urandom(256 * 128))
        d.kill()
        d.start()
        c = d.client()
        assert ([c.ask("STATUS", job=f"key:k{i}")["job"] for i in range(256)]
                == [a["job"] for a in answers])
        assert len({a["job"] for a in answers}) == 256


def test_a_message_whose_inputs_cannot_be_told_apart_is_refused_and_nothing_of_it_taken(client):
    data, described = ring_down(samples=40, phase=0.43)
    job = {"kind": "identify", "input": described, "key": "apart"}
    for jobs, body, field in (([job], data + b"x", "body"),
                              ([job, {**job, "key": "b"}], data, "body"),
                              ([job, {"kind": "steady", "input": {"content": "scene"}}], data,
                               "jobs[1].input.bytes"),
                              ([job, {**job, "input": {**described, "samples": 1.5}}], data,
                               "jobs[1].input.samples"), ([job] * 257, data * 5, "jobs")):
        reply = client.ask("SUBMITS", [body], jobs=jobs)
        assert (reply.code, reply["error"]["field"]) == ("bad_input", field), reply
    assert client.ask("STATUS", job="key:apart").code == "not_found"


def test_an_unknown_kind_is_refused_with_the_accepted_ones(client):
    data, described = ring_down()
    reply = client.ask("SUBMIT", [data], kind="identfy", input=described)
    assert (reply.code == "bad_input" and reply["error"]["field"] == "kind"
            and "identify" in reply["error"]["message"])


@pytest.mark.parametrize("change, field", [
    ({"dt": 0}, "dt"), ({"dt": -1}, "dt"), ({"samples": 0}, "samples"),
                                           ({"samples": 1.5}, "samples"),
                                           ({"channels": 0}, "channels"),
    ({"channels": 65537}, "channels"), ({"names": ["a", "b"]}, "names"),
                                           ({"period": -2}, "period"),
                                           ({"content": "song"}, "content"),
    ({"units": 7}, "units"), ({"attributes": []}, "attributes"), ({"samples": 399}, "body"),
])
def test_a_wrong_description_is_bad_input_with_its_field(client, change, field):
    data, described = ring_down()
    reply = client.ask("SUBMIT", [data], kind="identify", input={**described, **change})
    assert reply.code == "bad_input" and reply["error"]["field"].split(".")[-1] == field


@pytest.mark.parametrize("member",
                         [{"priority": 256}, {"priority": -1}, {"key": ""}, {"key": "x" * 129},
                          {"key": "a\nb"}, {"run_limit_s": 0},
                                    {"deadline_s": -1}, {"max_attempts": 0}, {"max_attempts": 11},
                          {"not_before": "now"}, {"fresh": 1}])
def test_a_member_out_of_range_is_bad_input_with_its_field(client, member):
    data, described = ring_down()
    reply = client.ask("SUBMIT", [data], kind="identify", input=described, **member)
    assert reply.code == "bad_input" and reply["error"]["field"] == next(iter(member))


def test_an_inline_input_over_65536_bytes_is_too_large(client):
    described = {"content": "batch", "samples": 8193, "channels": 1, "dt": 1}
    assert (client.ask("SUBMIT", [bytes(8 * 8193)], kind="identify", input=described).code
            == "too_large")


def test_an_equal_job_is_answered_from_the_result_and_marked_cached(client):
    first = submit(client, options={"say": "once"})
    wait(client, first["job"])
    again = submit(client, options={"say": "once"})
    assert again["job"] != first["job"] and again["state"] == "done" and again["cached"] is True
    assert (client.ask("RESULT", job=again["job"]).body
            == client.ask("RESULT", job=first["job"]).body)
    fresh = submit(client, options={"say": "once"}, fresh=True)
    assert fresh["state"] == "queued" and "cached" not in fresh.header
    client.ask("DELETE", job=first["job"])
    assert client.ask("RESULT",
                      job=again["job"]).ok, "a cached answer outlives the job it came from"


def test_an_equal_job_is_one_whose_input_has_equal_attributes_too(client):
    """Attributes stand in the answer as provenance: another's are no answer."""
    data, described = ring_down()

    def asked(attributes, **more):
        return client.ask("SUBMIT", [data], kind="identify",
                          input={**described, "attributes": attributes}, options={"say": "mine"},
                          **more)
    first = asked({"rig": "one", "run": 1}, key="attributes")
    wait(client, first["job"])
    assert asked({"run": 1.0, "rig": "one"})["cached"] is True, "the order of members tells nothing"
    for other in ({"rig": "two", "run": 1}, {"rig": "one"}, {}):
        reply = asked(other)
        assert reply["state"] == "queued" and "cached" not in reply.header, other
        assert wait(client, reply["job"])["state"] == "done"
    assert asked({"rig": "one", "run": 1}, key="attributes")["job"] == first["job"]
    assert asked({"rig": "two", "run": 1}, key="attributes").code == "conflict"


def test_an_upload_of_equal_samples_and_other_attributes_is_another_input():
    data, described, sha = big(seed=12)
    with Daemon(config=FAKE) as d:
        c = d.client()
        idents = {}
        for rig in ("one", "two"):
            begin = {"op": "begin", **described, "sha256": sha, "attributes": {"rig": rig}}
            opened = c.ask("UPLOAD", **begin)
            assert opened["state"] == "open"
            idents[rig] = upload(c, data, described, ident=opened["upload"])[0]
            assert c.ask("UPLOAD", op="seal", upload=idents[rig], sha256=sha)["state"] == "sealed"
            again = c.ask("UPLOAD", **begin)
            assert (again["state"], again["upload"]) == ("sealed", idents[rig])
        assert idents["one"] != idents["two"]
        for _ in range(2):                                       # before a restart and after it
            jobs = [c.ask("SUBMIT", kind="identify", options={"say": "x"}, input=i)
                    for i in ({"upload": idents["one"]}, {"upload": idents["two"]},
                              {"sha256": sha})]
            assert all(wait(c, j["job"])["state"] == "done" for j in jobs)
            d.kill()
            d.start()
            c = d.client()
        assert all(j["cached"] for j in jobs), "each is known again after a restart"
        c.ask("UPLOAD", op="begin", **described, sha256=sha, attributes={"rig": "three"})
        assert c.ask("SUBMIT", kind="identify", options={"say": "x"},
                     input={"sha256": sha})["cached"], "an open upload is no input"


def test_higher_priority_is_more_urgent(daemon):
    with Daemon(config=FAKE, workers=1) as d:
        c = d.client()
        gate = d.gate()
        first = running(c, gate)
        low = submit(c, options={"say": "low"}, priority=10)
        high = submit(c, options={"say": "high", "sleep": 0.05}, priority=200)
        assert c.ask("STATUS", job=low["job"])["position"] == 1
        gate.open()
        wait(c, low["job"])
        assert (wait(c, first)["started"] <= wait(c, high["job"])["started"]
                < wait(c, low["job"])["started"])


def test_not_before_delays_the_start(client):
    at = time.time() + 0.7
    job = submit(client, options={"say": "later"}, not_before=at)
    done = wait(client, job["job"])
    assert done["started"] >= at - 0.002


# ---- STATUS, WAIT, RESULT


def test_a_job_of_nobody_is_not_found(client):
    for verb in ("STATUS", "WAIT", "RESULT", "CANCEL", "RETRY", "DELETE"):
        assert client.ask(verb, job="00000000").code == "not_found"
        assert client.ask(verb, job="key:nobody").code == "not_found"


def test_wait_answers_at_its_timeout_with_the_doc_of_that_moment(daemon, client):
    """The job ends after the answer only: the timeout alone can have brought it."""
    gate = daemon.gate()
    job = running(client, gate)
    begin = time.monotonic()
    reply = client.ask("WAIT", job=job, timeout_s=0.4)
    assert time.monotonic() - begin >= 0.39 and reply["state"] == "running"
    gate.open()
    assert wait(client, job)["state"] == "done"


def test_a_result_comes_in_parts(client):
    job = submit(client, options={"document": 3_000_000})["job"]
    done = wait(client, job, result=True)
    assert done["state"] == "done" and done.body == [] and done["bytes"] > 3_000_000
    text, offset = b"", 0
    while offset < done["bytes"]:
        part = client.ask("RESULT", job=job, offset=offset, length=1_000_003)
        assert part["offset"] == offset and part["total"] == done["bytes"]
        text += part.body[0]
        offset += part["bytes"]
    assert len(json.loads(text)["pad"]) == 3_000_000


def test_the_signals_of_a_job_are_a_part_of_its_result(client):
    job = submit(client, options={"signals": 320000})["job"]
    assert wait(client, job)["state"] == "done"
    whole = b""
    while len(whole) < 2560000:
        part = client.ask("RESULT", job=job, part="batch", offset=len(whole))
        assert part["batch"]["samples"] == 320000 and part["batch"]["dt"] == 0.5
        whole += part.body[0]
    assert whole == bytes(range(256)) * 10000


def test_a_job_that_failed_answers_its_own_error(client):
    job = submit(client, options={"fail": "no_convergence"})["job"]
    done = wait(client, job)
    assert (done["state"] == "failed" and done["error"]["code"] == "no_convergence"
            and done["error"]["field"] == "options.fail")
    assert client.ask("RESULT", job=job).code == "no_convergence"


def test_a_job_that_runs_has_no_result_yet(daemon, client):
    gate = daemon.gate()
    job = running(client, gate)
    assert client.ask("RESULT", job=job).code == "conflict"
    gate.open()
    wait(client, job)


def test_the_input_can_be_read_back(client):
    data, _ = ring_down(phase=0.11)
    job = submit(client, phase=0.11)["job"]
    assert (client.ask("RESULT", job=job, part="input", offset=100, length=64).body[0]
            == data[100:164])


# ---- CANCEL, RETRY, DELETE, limits


def test_cancel_of_a_queued_job_ends_it_at_once():
    with Daemon(config=FAKE, workers=1) as d:
        c, gate = d.client(), d.gate()
        busy = running(c, gate)
        job = submit(c, options={"say": "never"})["job"]
        assert c.ask("CANCEL", job=job)["state"] == "cancelled"
        assert wait(c, job)["error"]["code"] == "cancelled"
        gate.open()
        wait(c, busy)
        assert c.ask("STATUS", job=job)["attempts"] == 0


def test_cancel_ends_a_job_that_would_run_for_ever_and_its_worker_is_gone(daemon, client):
    job = running(client, daemon.gate())
    before = set(daemon.children())
    assert client.ask("CANCEL", job=job)["state"] == "cancelled"
    until(lambda: before - set(daemon.children()), "no worker went")


def test_cancel_of_a_job_that_ended_says_how_it_ended(client):
    job = submit(client)["job"]
    wait(client, job)
    assert client.ask("CANCEL", job=job)["state"] == "done"


def test_a_passed_run_limit_fails_a_job_that_would_run_for_ever(daemon, client):
    job = submit(client, options=daemon.gate().options, run_limit_s=0.5)["job"]
    done = wait(client, job)
    assert (done["state"] == "failed" and done["error"]["code"] == "run_limit" and done["finished"]
            - done["started"] >= 0.5)


def test_a_passed_deadline_fails_queued_and_running_jobs():
    with Daemon(config=FAKE, workers=1) as d:
        c, gate = d.client(), d.gate()
        running(c, gate)
        queued = submit(c, options={"say": "queued"}, deadline_s=0.4)["job"]
        assert (wait(c, queued)["error"]["code"] == "deadline"
                and c.ask("STATUS", job=queued)["attempts"] == 0)
        gate.open()
        ended, deadline_s = {"attempts": 0}, 1
        # one that passed before the job could start is tried with more
        while ended["attempts"] == 0:
            ended = wait(c, submit(c, options=d.gate().options, deadline_s=deadline_s)["job"])
            assert ended["error"]["code"] == "deadline" and deadline_s < 100
            deadline_s *= 3


def test_a_job_whose_worker_dies_is_tried_again_and_dead_after_the_third(client):
    job = submit(client, options={"die": True, "say": "last words"})["job"]
    dead = wait(client, job)
    assert (dead["state"] == "dead" and dead["attempts"] == 3
            and dead["error"]["code"] == "worker_died")
    assert b"last words" in client.ask("RESULT", job=job, part="stderr").body[0]
    assert client.ask("RESULT", job=job, part="input").ok
    again = client.ask("RETRY", job=job)
    assert again["state"] == "queued"
    assert wait(client, job)["attempts"] == 6


def test_a_job_whose_worker_has_no_memory_for_a_document_is_not_tried_again(client):
    """By its exit status, WIRE_WORKER_NO_MEMORY; by any other one it died."""
    failed = wait(client, submit(client, options={"exit": 3})["job"])
    assert (failed["state"], failed["attempts"]) == ("failed", 1), failed
    assert failed["error"]["code"] == "no_memory"
    dead = wait(client, submit(client, options={"exit": 4}, max_attempts=1)["job"])
    assert dead["error"]["code"] == "worker_died"


def test_only_a_dead_job_can_be_tried_again(client):
    job = submit(client)["job"]
    wait(client, job)
    assert client.ask("RETRY", job=job).code == "conflict"


def test_a_job_survives_the_death_of_its_worker(daemon, client):
    gate = daemon.gate()
    job = running(client, gate)
    daemon.kill_workers()
    until(lambda: client.ask("STATUS", job=job)["attempts"] == 2)
    gate.open()
    done = wait(client, job)
    assert done["state"] == "done" and done["attempts"] >= 2


def test_delete_makes_the_key_answer_expired(client):
    job = submit(client, key="gone", options={"say": "gone"})["job"]
    wait(client, job)
    assert client.ask("DELETE", job=job)["deleted"] is True
    assert client.ask("STATUS", job=job).code == "not_found"
    assert client.ask("STATUS", job="key:gone").code == "expired"
    assert submit(client, key="gone", options={"say": "gone"}).code == "expired"


def test_delete_of_a_running_job_is_a_conflict(daemon, client):
    gate = daemon.gate()
    job = running(client, gate)
    assert client.ask("DELETE", job=job).code == "conflict"
    gate.open()
    wait(client, job)


# ---- LIST, EVENTS, STATS, METRICS, WHOAMI, DRAIN


def test_list_walks_all_jobs_once_oldest_first():
    with Daemon(config=FAKE, workers=2) as d:
        c = d.client()
        jobs = [submit(c, key=f"l{i}", options={"say": str(i)})["job"] for i in range(25)]
        seen, after = [], None
        while True:
            page = c.ask("LIST", limit=7, **({"after": after} if after else {}))
            page = json.loads(page.body[0])
            seen += [doc["job"] for doc in page["jobs"]]
            after = page["next"]
            if after is None:
                break
        assert seen == jobs
        for job in jobs:
            wait(c, job)
        assert json.loads(c.ask("LIST", state="done", limit=1000).body[0])["next"] is None
        assert len(json.loads(c.ask("LIST", state="failed").body[0])["jobs"]) == 0


def collect(client, last_job):
    events = []
    while not (events and events[-1].get("job") == last_job and events[-1].get("state") == "done"):
        reply = client.receive()
        if reply.verb == "EVENT":
            events.append(reply.header)
    return events


def test_events_replay_from_a_number_and_go_on_live_without_a_hole():
    with Daemon(config=FAKE, workers=2) as d:
        c = d.client()
        for i in range(3):
            wait(c, submit(c, options={"say": f"e{i}"})["job"])
        d.kill()
        d.start()                                    # the first nine are in the ledger only
        c = d.client()
        watcher = d.client()
        assert watcher.ask("EVENTS", **{"from": 1}).ok
        last = submit(c, options={"say": "live"})["job"]
        wait(c, last)
        numbers = [e["number"] for e in collect(watcher, last) if e["event"] == "state"]
        assert numbers == list(range(1, 13))


def test_progress_comes_as_an_event_without_a_number(client):
    watcher = client
    watcher.ask("EVENTS")
    job = submit(client, options={"progress": 0.25, "sleep": 0.3})["job"]
    events = collect(watcher, job)
    assert any(e["event"] == "progress" and e["progress"]["fraction"] == 0.25 and "number" not in e
               for e in events)


def test_a_cancelled_subscription_is_not_found_again(client):
    s = client.ask("EVENTS")["subscription"]
    assert client.ask("EVENTS", op="cancel", subscription=s).ok
    assert client.ask("EVENTS", op="cancel", subscription=s).code == "not_found"


def test_stats_count_jobs_and_rejects(client):
    stats = client.ask("STATS")
    assert (set(stats["jobs"]) == {"queued", "running", "done", "failed", "cancelled", "dead"}
            and stats["workers"]["total"] == 2)


def test_metrics_are_prometheus_text_without_duplicate_series(client):
    assert submit(client, fresh=True).ok
    lines = client.ask("METRICS").body[0].decode().splitlines()
    series = [line.split(" ")[0] for line in lines if not line.startswith("#")]
    assert len(series) == len(set(series)) > 20
    typed = {line.split(" ")[2] for line in lines if line.startswith("# TYPE")}
    histograms = {line.split(" ")[2] for line in lines if line.startswith("# TYPE")
                  and line.endswith(" histogram")}
    assert ({"modald_submit_seconds", "modald_commit_seconds", "modald_commit_transactions"}
            <= histograms)
    for line in lines:                                # the text format: HELP, TYPE, then samples
        assert re.fullmatch(r'# HELP [a-z_]+ \S.*|# TYPE [a-z_]+ '
                            r'(gauge|counter|histogram)|[a-z_]+(\{[a-z]+="[^"\\]*"\})? \S+',
                            line), line
    names = {s.split("{")[0] for s in series}
    wanted = {"jobs", "jobs_kind", "queue_oldest_seconds", "submit_seconds", "commit_seconds",
              "commit_transactions", "ledger_bytes", "stored_bytes", "attempts_total",
              "leases_lost_total", "worker_deaths_total", "user_cpu_seconds", "user_stored_bytes",
              "rejects_total", "received_bytes_total", "sent_bytes_total",
              "credit_stalls_total", "replay_seconds", "build_info"}
    assert {"modald_" + name for name in wanted} <= typed
    assert (names == typed - histograms
            | {h + part for h in histograms for part in ("_bucket", "_sum", "_count")})
    values = {line.split(" ")[0]: float(line.split(" ")[1]) for line in lines
              if not line.startswith("#")}
    for h in histograms:                              # cumulative, and the last holds all
        counts = [value for name, value in values.items() if name.startswith(h + "_bucket")]
        assert counts == sorted(counts) and counts[-1] == values[h + "_count"]
    assert values["modald_submit_seconds_count"] > 0 and values["modald_ledger_bytes"] > 4096


def test_whoami_names_user_role_and_limits(client):
    who = client.ask("WHOAMI")
    assert (who["user"] == "local" and who["role"] == "admin" and "queued" in who["limits"]
            and "bytes" in who["used"])


def test_while_draining_no_job_starts_and_submits_are_refused():
    with Daemon(config=FAKE, workers=1) as d:
        c, gate = d.client(), d.gate()
        first = running(c, gate)
        queued = submit(c, options={"say": "waits"})["job"]
        assert c.ask("DRAIN")["draining"] is True
        refused = submit(c, options={"say": "refused"})
        assert refused.code == "draining" and refused["error"]["detail"]["retry_after_s"] > 0
        gate.open()
        assert wait(c, first)["state"] == "done"
        assert c.ask("STATUS", job=queued)["state"] == "queued"
        d.kill()
        d.start()
        c = d.client()
        assert c.ask("HELLO")["draining"] is True, "a drained daemon stays so over a restart"
        assert c.ask("UNDRAIN")["draining"] is False
        assert wait(c, queued)["state"] == "done"


# ---- UPLOAD


def upload(client, data, described, key=None, chunk=262144, upto=None, start=0, ident=None):
    ident = (ident or client.ask("UPLOAD", op="begin", **described,
                                 **({"key": key} if key else {}))["upload"])
    numbers = []
    for at in range(start, upto or len(data), chunk):
        piece = data[at:at + chunk]
        numbers.append(client.send("UPLOAD", [piece], op="chunk", upload=ident, offset=at,
                                   crc32c=crc32c(piece)))
    return ident, [client.answer(n) for n in numbers]


def big(samples=40000, channels=4, seed=3):
    dice = random.Random(seed)
    data = struct.pack(f"<{samples * channels}d",
                       *[dice.random() for _ in range(samples * channels)])
    return data, {"content": "batch", "samples": samples, "channels": channels,
                  "dt": 0.001}, identity(samples, channels, 0.001, data)


def test_an_upload_is_sealed_by_its_sha256_and_serves_many_jobs(client):
    data, described, sha = big()
    ident, replies = upload(client, data, described)
    assert all(r.ok for r in replies) and replies[-1]["present"] == len(data)
    sealed = client.ask("UPLOAD", op="seal", upload=ident, sha256=sha)
    assert sealed["state"] == "sealed" and sealed["sha256"] == sha
    assert client.ask("UPLOAD", op="seal", upload=ident, sha256=sha)["state"] == "sealed"
    for reference in ({"upload": ident}, {"sha256": sha}):
        job = client.ask("SUBMIT", kind="identify", input=reference,
                         options={"say": str(reference)})
        assert wait(client, job["job"])["state"] == "done"
    part = client.ask("RESULT", job=job["job"], part="input", offset=262140, length=1000)
    assert part.body[0] == data[262140:263140]
    assert (client.ask("UPLOAD", op="begin", **described, sha256=sha)["state"]
            == "sealed"), "what is here need not be sent"


def test_begin_again_with_the_same_key_resumes_after_a_kill():
    with Daemon(config=FAKE) as d:
        c = d.client()
        data, described, sha = big(seed=4)
        ident, _ = upload(c, data, described, key="res", upto=600000)
        d.kill()
        d.start()
        c = d.client()
        again = c.ask("UPLOAD", op="begin", **described, key="res")
        assert again["upload"] == ident and again["present"] == 786432
        upload(c, data, described, start=again["present"], ident=ident)
        assert c.ask("UPLOAD", op="seal", upload=ident, sha256=sha)["state"] == "sealed"


def test_the_same_upload_key_with_another_description_is_a_conflict(client):
    _, described, _ = big()
    assert client.ask("UPLOAD", op="begin", **described, key="two").ok
    assert (client.ask("UPLOAD", op="begin", **{**described, "dt": 0.5}, key="two").code
            == "conflict")


@pytest.mark.parametrize("offset", [4096, 262144 * 2])
def test_a_chunk_out_of_order_names_the_expected_offset(client, offset):
    data, described, _ = big(seed=5)
    ident, _ = upload(client, data, described, upto=262144)
    reply = client.ask("UPLOAD", [data[:100]], op="chunk", upload=ident, offset=offset,
                       crc32c=crc32c(data[:100]))
    assert (reply.code == "bad_input" and reply["error"]["field"] == "offset"
            and reply["error"]["detail"]["expected"] == 262144)
    assert client.ask("UPLOAD", op="abort", upload=ident)["state"] == "gone"
    assert client.ask("UPLOAD", op="abort", upload=ident).code == "not_found"


def test_a_chunk_with_a_wrong_crc_is_refused_and_can_be_sent_again(client):
    data, described, _ = big(seed=6)
    ident = client.ask("UPLOAD", op="begin", **described)["upload"]
    wrong = client.ask("UPLOAD", [data[:1000]], op="chunk", upload=ident, offset=0,
                       crc32c=crc32c(data[:1000]) ^ 1)
    assert wrong.code == "bad_input" and wrong["error"]["field"] == "crc32c"
    assert client.ask("UPLOAD", [data[:1000]], op="chunk", upload=ident, offset=0,
                      crc32c=crc32c(data[:1000])).ok


def test_an_oversize_chunk_is_too_large(client):
    data, described, _ = big(seed=7)
    ident = client.ask("UPLOAD", op="begin", **described)["upload"]
    piece = data[:262145]
    assert (client.ask("UPLOAD", [piece], op="chunk", upload=ident, offset=0,
                       crc32c=crc32c(piece)).code == "too_large")


def test_a_chunk_past_the_end_is_refused(client):
    data, described = bytes(800), {"content": "batch", "samples": 100, "channels": 1, "dt": 1}
    ident = client.ask("UPLOAD", op="begin", **described)["upload"]
    piece = data + b"12345678"
    reply = client.ask("UPLOAD", [piece], op="chunk", upload=ident, offset=0, crc32c=crc32c(piece))
    assert reply.code == "bad_input" and reply["error"]["field"] == "offset"


def test_sealing_with_bytes_missing_says_how_many(client):
    data, described, sha = big(seed=8)
    ident, _ = upload(client, data, described, upto=262144)
    reply = client.ask("UPLOAD", op="seal", upload=ident, sha256=sha)
    assert (reply.code == "bad_input" and reply["error"]["field"] == "present"
            and reply["error"]["detail"]["expected"] == len(data))


def test_a_wrong_sha256_ends_the_upload(client):
    data, described, sha = big(seed=9)
    ident, _ = upload(client, data, described)
    reply = client.ask("UPLOAD", op="seal", upload=ident, sha256="0" * 64)
    assert (reply.code == "bad_input" and reply["error"]["field"] == "sha256"
            and reply["error"]["detail"]["found"] == sha)
    until(lambda: client.ask("UPLOAD", op="seal", upload=ident, sha256=sha).code == "not_found")


def test_more_than_64_open_uploads_are_busy():
    with Daemon(config=FAKE) as d:
        c = d.client()
        described = {"content": "batch", "samples": 100, "channels": 1, "dt": 1}
        replies = [c.ask("UPLOAD", op="begin", **described) for _ in range(65)]
        assert all(r.ok for r in replies[:64]) and replies[64].code == "busy"


def test_a_scene_comes_by_upload_too(client):
    import hashlib
    text = json.dumps({"pad": "x" * 100000}).encode()
    sha = hashlib.sha256(b"modald/scene/1\0" + struct.pack("<Q", len(text)) + text).hexdigest()
    ident, replies = upload(client, text, {"content": "scene", "bytes": len(text)})
    assert client.ask("UPLOAD", op="seal", upload=ident, sha256=sha)["state"] == "sealed"
    job = client.ask("SUBMIT", kind="simulate", input={"upload": ident})["job"]
    assert wait(client, job)["state"] == "done"
    assert (client.ask("RESULT", job=job, part="input", offset=99990, length=5).body[0]
            == text[99990:99995])


# ---- bounds and ends


def test_a_full_queue_answers_busy_with_retry_after():
    with Daemon(config=FAKE + "queue_jobs = 5\n", workers=1) as d:
        c, gate = d.client(), d.gate()
        running(c, gate)
        replies = [submit(c, options={"say": f"q{i}"}) for i in range(7)]
        assert [r.code for r in replies] == [None] * 5 + ["busy"] * 2
        assert replies[-1]["error"]["detail"]["retry_after_s"] > 0
        gate.open()


def test_a_client_that_never_reads_costs_the_others_nothing(daemon, client):
    sleeper = daemon.client()
    sleeper.socket.set(zmq.RCVHWM, 1)
    for i in range(20000):
        sleeper.number += 1
        try:
            sleeper.socket.send_multipart([VERSION, b"METRICS", b'{"id":%d}' % i], zmq.DONTWAIT)
        except zmq.Again:
            break
    for _ in range(50):
        assert alive(client)
    with open(f"/proc/{daemon.pid}/status") as f:
        rss_kb = next(int(line.split()[1]) for line in f if line.startswith("VmRSS"))
    assert rss_kb < 200 * 1024
    sleeper.close()


def test_results_past_their_age_go_and_their_keys_answer_expired():
    with Daemon(config=FAKE + "result_age_s = 1\n", workers=1) as d:
        c = d.client()
        wait(c, submit(c, key="old")["job"])
        until(lambda: c.ask("STATUS", job="key:old").code == "expired")
        assert submit(c, key="old").code == "expired"


def test_retention_takes_all_that_is_past_its_age_however_many():
    with Daemon(config=FAKE + "result_age_s = 1\n", workers=1) as d:
        c = d.client()
        wait(c, submit(c, key="first")["job"])
        for numbers in [range(at, at + 500) for at in range(0, 3000, 500)]:
            data, described = ring_down()
            asked = [c.send("SUBMIT", [data], kind="identify", options={}, input=described,
                            key=f"again{i}") for i in numbers]
            assert all(c.answer(number).ok for number in asked)
        # every 10 s, and then without a pause until none is left
        until(lambda: c.ask("STATS")["jobs"]["done"] == 0)
        assert c.ask("STATUS", job="key:again2999").code == "expired"


def test_retention_by_bytes_takes_the_oldest_results_and_no_more_than_it_must():
    with Daemon(config=FAKE + "result_bytes = 100000\n", workers=1) as d:
        c = d.client()
        for i in range(30):
            wait(c, submit(c, key=f"k{i}", options={"document": 5000, "say": str(i)})["job"])
        left = 100000 // len(c.ask("RESULT", job="key:k29").body[0])
        assert 15 < left <= 20
        until(lambda: c.ask("STATS")["jobs"]["done"] <= left)   # some may go while jobs still come
        assert c.ask("STATS")["jobs"]["done"] == left
        assert (c.ask("STATUS", job=f"key:k{29 - left}").code == "expired"
                and c.ask("STATUS", job=f"key:k{30 - left}")["state"] == "done")


def test_a_restart_takes_up_everything_that_was_acknowledged():
    with Daemon(config=FAKE, workers=1) as d:
        c = d.client()
        done = submit(c, key="d")["job"]
        document = wait(c, done, result=True).body
        gate = d.gate()
        first = running(c, gate, key="r")
        queued = [submit(c, key=f"q{i}", options={"say": str(i)}, priority=i)["job"]
                  for i in range(10)]
        d.kill()
        d.start()
        c = d.client()
        assert c.ask("RESULT", job=done).body == document
        assert submit(c, key="r", options=gate.options)["job"] == first
        gate.open()
        for job in [first, *queued]:
            assert wait(c, job)["state"] == "done"
        assert submit(c, key="d")["job"] == done


def test_sigterm_lets_running_jobs_finish_and_keeps_queued_ones():
    with Daemon(config=FAKE, workers=1) as d:
        c, gate = d.client(), d.gate()
        first = running(c, gate)
        queued = submit(c, options={"say": "kept"})["job"]
        d.process.send_signal(signal.SIGTERM)
        until(lambda: "event=terminate" in d.text())
        gate.open()
        assert d.process.wait(PATIENCE_S) == 0
        d.start()
        c = d.client()
        assert (c.ask("STATUS", job=first)["state"] == "done"
                and c.ask("STATUS", job=first)["attempts"] == 1)
        assert wait(c, queued)["state"] == "done"


def test_a_second_sigterm_stops_at_once():
    """Its job would run for ever, and the drain alone for a day."""
    with Daemon(config=FAKE + "drain_s = 86400\n", workers=1) as d:
        job = running(d.client(), d.gate())
        d.process.send_signal(signal.SIGTERM)
        until(lambda: "event=terminate" in d.text())
        assert d.stop() == 0
        d.start()
        assert d.client().ask("STATUS", job=job)["state"] in ("queued", "running")


def test_a_bad_configuration_is_refused_at_reload_and_the_old_one_stays():
    with Daemon(config=FAKE, workers=1) as d:
        d.config.write_text(FAKE + "queue_jbos = 5\n")
        d.process.send_signal(signal.SIGHUP)
        until(lambda: "event=reload_refused" in d.text())
        assert "queue_jbos" in d.text() and alive(d.client())
        for wrong, said in (("connections = many\n", "connections is"),
                            ("result_age_s = 0\n", "result_age_s is"), ("\0\0\0\0", "zero byte"),
                            ("x" * 1100000, "1048576")):
            d.config.write_text(FAKE + wrong)
            d.process.send_signal(signal.SIGHUP)
            until(lambda: said in d.text())
            assert alive(d.client())
        assert "event=reload accounts" not in d.text()
        d.config.write_text(FAKE + "queue_jobs = 7\n")
        d.process.send_signal(signal.SIGHUP)
        until(lambda: "event=reload accounts" in d.text())
        assert (d.client().ask("HELLO")["limits"]["queue_jobs"] == 7
                and "event=reload_later" not in d.text())
        d.config.write_text(FAKE + "bind = ipc:///nowhere/else.ipc\nipc_mode = 0660\n")
        d.process.send_signal(signal.SIGHUP)
        until(lambda: "event=reload_later" in d.text())


def test_two_daemons_on_one_data_folder_are_refused():
    with Daemon(config=FAKE) as d:
        with pytest.raises(RuntimeError, match="busy"):
            Daemon(folder=d.folder, config=FAKE, endpoint=f"ipc://{d.folder}/other.ipc")
        assert alive(d.client())


def test_without_keys_only_ipc_and_loopback_are_bound(tmp_path):
    for endpoint in ("tcp://0.0.0.0:5999", "tcp://*:5999", "tcp://192.168.1.1:5999"):
        with pytest.raises(RuntimeError, match="without keys"):
            d = Daemon(folder=tmp_path, config=FAKE, endpoint=endpoint)
            d.__exit__()


def test_loopback_is_bound_when_told_to():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        port = s.getsockname()[1]
    with Daemon(config=FAKE, endpoint=f"tcp://127.0.0.1:{port}") as d:
        assert alive(d.client())


# ---- every member of every verb, with values of every type


WRONG = [None, True, 0, -1, 1.5, 1e308, -1e308, 2**53, 2**53 + 2, "", "x", "x" * 200, "\x7f",
         "a\u0001", "key:", "key:x", [], [1], {}, {"a": 1},
         {"content": "batch"}, {"upload": "x"}, {"sha256": "0" * 64}, "\u00e9" * 100]
MEMBERS = {
    "HELLO": ({}, "versions client"), "STATUS": ({"job": "key:a"}, "job"),
    "WAIT": ({"job": "key:a", "timeout_s": 0}, "job timeout_s result"),
    "RESULT": ({"job": "key:a"}, "job upload part offset length"),
    "CANCEL": ({"job": "key:a"}, "job"), "RETRY": ({"job": "key:a"}, "job"),
    "DELETE": ({"job": "key:z"}, "job"), "LIST": ({}, "state kind limit after"),
    "EVENTS": ({}, "op from job stream subscription"),
    "STATS": ({}, ""), "METRICS": ({}, ""), "WHOAMI": ({}, ""),
    "STREAMS": ({}, "name user limit after"),
    "SUBMIT": ({"kind": "identify", "options": {}},
               "kind options input key priority run_limit_s deadline_s not_before max_attempts "
               "fresh"),
    "UPLOAD begin": ({"op": "begin", "content": "batch", "samples": 100, "channels": 2, "dt": 0.1},
                     "op content key sha256 samples channels dt period names units attributes "
                     "bytes"),
    "UPLOAD chunk": ({"op": "chunk", "offset": 0, "crc32c": 0}, "upload offset crc32c"),
    "STREAM open": ({"op": "open", "name": "n", "channels": 1, "dt": 0.1},
                    "op name channels dt period names units attributes window"),
    "STREAM push": ({"op": "push", "epoch": 0, "first": 0, "count": 10, "crc32c": 0},
                    "stream epoch first count crc32c"),
}
BODIES = {"SUBMIT": [[ring_down()[0]]],
          "UPLOAD chunk": [[], [b""], [b"x"], [b"x" * 300000], [b"x", b"y"]],
          "STREAM push": [[], [b"x" * 160], [b"x" * 300000], [b"x", b"y"]]}


def put_away(client, reply):
    """What a value that was no mistake has opened: a user may have few."""
    if reply.ok and reply["verb"] == "UPLOAD" and reply.get("state") == "open":
        client.ask("UPLOAD", op="abort", upload=reply["upload"])
    if reply.ok and reply["verb"] == "STREAM" and "gaps" not in reply.header:
        client.ask("STREAM", op="close", stream=reply["stream"])
    if reply.ok and "subscription" in reply.header:
        client.ask("EVENTS", op="cancel", subscription=reply["subscription"])


@pytest.mark.parametrize("what", MEMBERS)
def test_a_wrong_member_is_answered_by_its_name_and_what_is_accepted(what):
    usual, members = MEMBERS[what]
    with Daemon(config=FAKE, workers=1) as d:
        client = d.client()
        assert submit(client, key="a").ok
        if what == "UPLOAD chunk":
            usual = {**usual, "upload": client.ask("UPLOAD", op="begin", content="batch",
                                                   samples=100, channels=2, dt=0.1)["upload"]}
        if what == "STREAM push":
            usual = {**usual, "stream": client.ask("STREAM", op="open", name="n", channels=2,
                                                   dt=0.1)["stream"]}
        if what == "SUBMIT":
            usual = {**usual, "input": ring_down()[1]}
        for member in [*members.split(), "misspelt"]:
            for value in WRONG:
                for body in BODIES.get(what, [[]]):
                    reply = client.ask(what.split()[0], body, **{**usual, member: value})
                    assert reply.code != "internal", (member, value, reply)
                    if reply.code in ("bad_input", "too_large"):
                        assert (reply["error"]["field"]
                                and any(word in reply["error"]["message"]
                                        for word in ("accepted", "must be"))), (member, value,
                                                                                reply)
                    if what not in ("UPLOAD chunk", "STREAM push"):
                        put_away(client, reply)
            assert (member != "misspelt" or reply.code == "bad_input"
                    and reply["error"]["field"] == "misspelt")
        assert d.process.poll() is None
