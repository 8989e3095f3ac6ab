"""What the daemon believes of a worker that somebody else has taken over: only what fits the job
that it was given, within limits.
"""
import json
import pathlib

import pytest

from wire import Daemon, submit

HERE = pathlib.Path(__file__).parent
FAKE = f"worker_path = {HERE / 'fake_worker.py'}\n"
MIB = 1 << 20
SIGNALS = {"content": "batch", "samples": 16, "channels": 1, "dt": 0.5}     # 128 bytes


@pytest.fixture(scope="module")
def daemon():
    with Daemon(config=FAKE) as d:
        yield d
        assert d.process.poll() is None


def end_of(client, *messages, key=None):
    """The document of a job whose worker sends MESSAGES: [verb, members, [bytes of each body
    frame]].
    """
    job = submit(client, options={"send": [list(m) for m in messages]}, max_attempts=1,
                 fresh=True)["job"]
    return client.ask("WAIT", job=job, timeout_s=250, result=True)


def part(offset, total, *bodies, part="document", **members):
    return ["PART", {"part": part, "offset": offset, "total": total, **members}, list(bodies)]


DONE = ["DONE", {"cpu_s": 0.01}, []]

REFUSED = {
    "more than its total after an empty one of another": [part(0, 10), part(0, 60000000, MIB, MIB),
                                                          part(0, 60000000, MIB, MIB)],
    "another total at offset 0": [part(0, 10, 4), part(4, 10, 3), part(0, 60000000, MIB)],
    "another total later": [part(0, 10, 4), part(4, 11, 7), DONE],
    "past the total": [part(0, 10, 11), DONE],
    "past the total in the second": [part(0, 10, 4), part(4, 10, 7), DONE],
    "no body": [part(0, 10), DONE],
    "an empty body": [part(0, 10, 0), DONE],
    "two bodies": [part(0, 10, 4, 6), DONE],
    "the first twice": [part(0, 10, 4), part(0, 10, 4)],
    "one left out": [part(4, 10, 6)],
    "of nothing known": [part(0, 10, 10, part="stderr"), DONE],
    "the end missing": [part(0, 10, 4), DONE],
    "a document in DONE too": [part(0, 10, 10), ["DONE", {}, [10]]],
    "no document at all": [DONE],
    "an empty document": [["DONE", {}, [0]]],
    "a document of two frames": [["DONE", {}, [5, 5]]],
    "signals of no bytes": [part(0, 128, 0, part="batch", batch=SIGNALS), ["DONE", {}, [2]]],
    "signals without a body": [part(0, 128, part="batch", batch=SIGNALS), ["DONE", {}, [2]]],
    "signals of another total": [part(0, 120, 8, part="batch", batch=SIGNALS), ["DONE", {}, [2]]],
    "signals past their end": [part(0, 128, 129, part="batch", batch=SIGNALS), ["DONE", {}, [2]]],
    "signals whose end is missing": [part(0, 128, 64, part="batch", batch=SIGNALS),
                                     ["DONE", {}, [2]]],
    "signals that nothing describes": [part(0, 128, 64, part="batch"), ["DONE", {}, [2]]],
    "more than four without a GO": [part(8 * i, 8 * 600, 8, part="batch",
                                         **({"batch": {**SIGNALS, "samples": 600}} if i == 0
                                            else {})) for i in range(600)],
    "more at length than of signals and of an error": [
        ["BEAT", {"x": {"text": "y", "times": 900000}}, []]] * 3 + [["DONE", {}, [7]]],
    "a message that is none": [["done", {}, [2]]],
    "a message of unknown verb": [["OPEN", {}, []]],
}


@pytest.mark.parametrize("messages", REFUSED.values(), ids=REFUSED)
def test_parts_that_do_not_fit_end_the_worker_and_nothing_else(daemon, client, messages):
    before = daemon.text().count("event=worker_protocol")
    end = end_of(client, *messages)
    assert end["state"] == "dead" and end["error"]["code"] == "worker_died"
    assert (daemon.process.poll() is None
            and daemon.text().count("event=worker_protocol") == before + 1)
    # the next worker, the next job
    assert end_of(client, ["DONE", {"cpu_s": 0}, [7]]).body == [b"A" * 7]


def test_an_error_of_a_worker_is_cut_to_what_an_error_may_be(daemon, client):
    error = {"code": "bad_input", "message": {"text": "ö", "times": 3000},
             "field": {"text": "é", "times": 3000},
             "detail": {"x": {"text": "y", "times": 900000}}}
    end = end_of(client, ["FAILED", {"cpu_s": 0.1, "error": error}, []])
    assert (end["state"] == "failed" and end["error"]["code"] == "bad_input"
            and "detail" not in end["error"])
    assert set(end["error"]["message"]) == {"ö"} and set(end["error"]["field"]) == {"é"}
    assert len(json.dumps(end.header)) < 8192
    assert "event=detail_left_out" in daemon.text()


def test_what_is_said_at_length_once_a_job_is_heard(client):
    """Of signals what they are, and an error: as long as headers may be, job after job."""
    long = [[verb, {"x": {"text": "y", "times": 1000000}}, []] for verb in ("BEAT", "READY")]
    for _ in range(3):
        assert end_of(client, *long, ["DONE", {}, [7]])["state"] == "done"


def test_a_detail_of_4_kB_is_kept(client):
    detail = {"x": "y" * (4096 - len('{"x":""}'))}
    assert (end_of(client,
                   ["FAILED", {"error": {"code": "bad_input", "message": "m", "detail": detail}},
                    []])["error"]["detail"] == detail)
    assert ("detail" not in end_of(client,
                                   ["FAILED", {"error": {"code": "bad_input", "message": "m",
                                                         "detail": {"x": detail["x"] + "y"}}},
                                    []])["error"])


@pytest.mark.parametrize("error",
                         [{"code": "ok", "message": "x"}, {"code": "none such", "message": "x"},
                          {}, [], "text", None])
def test_a_failure_without_a_code_of_this_protocol_is_internal(client, error):
    end = end_of(client, ["FAILED", {"error": error}, []])
    assert end["state"] == "failed" and end["error"]["code"] == "internal"


@pytest.mark.parametrize("claimed", [1e9, 1e300, 86400])
def test_no_more_cpu_time_is_booked_than_the_cores_of_the_job_can_have_given(client, claimed):
    used = client.ask("WHOAMI")["used"]["cpu_s_day"]
    end = end_of(client, ["DONE", {"cpu_s": claimed}, [7]])
    assert end["state"] == "done"
    failed = end_of(client,
                    ["FAILED", {"cpu_s": claimed, "error": {"code": "bad_input", "message": "m"}},
                     []])
    assert failed["state"] == "failed"
    assert client.ask("WHOAMI")["used"]["cpu_s_day"] - used < 60


def test_late_messages_are_told_once_and_not_a_line_each(daemon, client):
    before = daemon.text().count("event=late")
    late = [["DONE", {"attempt": 99}, [7]]] * 500
    assert end_of(client, *late, ["DONE", {}, [7]])["state"] == "done"
    assert daemon.text().count("event=late") == before + 1


def test_progress_over_4_kB_is_not_kept(client):
    end = end_of(client, ["PROGRESS", {"progress": {"x": "y" * 5000}}, []], ["DONE", {}, [7]])
    assert end["state"] == "done" and "progress" not in end.header


def test_progress_that_nobody_is_told_is_no_length_that_a_worker_is_killed_for(client):
    """As workers of before say the points of a sweep, each second."""
    long = [["PROGRESS", {"progress": {"x": {"text": "y", "times": 900000}}}, []]] * 4
    end = end_of(client, *long, ["DONE", {}, [7]])
    assert end["state"] == "done" and "progress" not in end.header
