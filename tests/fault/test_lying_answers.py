"""Whoever listens where modald should may answer anything: a client says so and ends, and nothing
that it is told is believed beyond what it can be."""
# Tests as well: client.c answers.py
import concurrent.futures
import json
import pathlib
import subprocess
import sys
import threading
import time

import pytest
import zmq

HERE = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parents[1] / "clients" / "python"), str(HERE.parent / "system")]
import modald  # noqa: E402
from modald import session  # noqa: E402
import sanitized  # noqa: E402
from wire import BUILD, PATIENCE_S  # noqa: E402

BATCH = modald.Batch([0.5, 0.25, 0.125], 0.1)
LARGE = modald.Batch([0.0] * 100000, 0.1)
JOB = {"job": "abcdefgh", "kind": "identify", "state": "queued"}
DONE = {**JOB, "state": "done"}
BEGUN = {"upload": "u", "state": "open", "present": 0, "credit": 1 << 20}
PART = {"job": "abcdefgh", "part": "document", "offset": 0, "bytes": 2}


def error(value):
    return "ERROR", {"error": value}, []


def reply(header=(), *body):
    return "REPLY", dict(header), list(body)


class Liar:
    """A server that answers each verb by the next of ANSWERS, the last again and again."""

    def __init__(self, path, **answers):
        self.url, self.answers, self.asked = f"ipc://{path}", answers, 0
        self.over, self.thread = threading.Event(), threading.Thread(target=self.serve)

    def serve(self):
        with zmq.Context() as context, context.socket(zmq.ROUTER) as socket:
            socket.linger = 0
            socket.bind(self.url)
            while not self.over.is_set():
                if socket.poll(20):
                    self.lie(socket, *socket.recv_multipart())

    def lie(self, socket, peer, _, verb, header, *body):
        verb, self.asked = verb.decode(), self.asked + 1
        answers = self.answers[verb]
        kind, said, body = answers.pop(0) if len(answers) > 1 else answers[0]
        said = {"id": json.loads(header)["id"], "verb": verb, **said}
        socket.send_multipart([peer, b"MODALD1", kind.encode(), json.dumps(said).encode(), *body])

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.over.set()
        self.thread.join()


def identify(client):
    client.identify(BATCH)


def watched(client):
    """The future's own end, which its watch makes: the job's own methods ask anew."""
    [job] = modald.as_completed([client.submit("identify", BATCH)], timeout=PATIENCE_S)
    raise concurrent.futures.Future.exception(job)


LIES = {
    "a job without a state": (identify, {"SUBMIT": [reply({"job": "a"})]}),
    "a job without a name": (identify, {"SUBMIT": [reply({"state": "done"})]}),
    "a wait without a state": (identify, {"SUBMIT": [reply(JOB)], "WAIT": [reply()]}),
    "a wait of a watched job without a state": (watched, {"SUBMIT": [reply(JOB)],
                                                          "WAIT": [reply()]}),
    "an error that is none": (watched, {"SUBMIT": [reply(JOB)], "WAIT": [error(None)]}),
    "an error of no text": (watched, {"SUBMIT": [reply(JOB)], "WAIT": [
        error({"code": 5, "message": ["a"], "field": {}, "detail": []})]}),
    "a result without a length": (identify, {"SUBMIT": [reply(DONE)],
                                             "RESULT": [reply(PART, b"{}")]}),
    "a result longer than it says": (identify, {"SUBMIT": [reply(DONE)], "RESULT": [
        reply({**PART, "total": 1}, b"{}")]}),
    "a result that grows": (identify, {"SUBMIT": [reply(DONE)], "RESULT": [
        reply({**PART, "total": 4}, b"{}"), reply({**PART, "total": 1 << 20}, b" " * 99999)]}),
    "a result below nothing": (identify, {"SUBMIT": [reply(DONE)], "RESULT": [
        reply({**PART, "total": -1}, b"{}")]}),
    "a result of a number beyond a double": (identify, {"SUBMIT": [reply(DONE)], "RESULT": [
        reply({**PART, "total": 407}, b'{"x":1' + b"0" * 400 + b"}")]}),
    "a result larger than any": (identify, {"SUBMIT": [reply(DONE)], "RESULT": [
        reply({**PART, "total": 1 << 40}, b" " * 99999)]}),
    "a result that is no object": (identify, {"SUBMIT": [reply(DONE)], "RESULT": [
        reply({**PART, "total": 2}, b"[]")]}),
    "an upload below its beginning": (lambda c: c.upload(LARGE), {"UPLOAD": [
        reply({**BEGUN, "present": -1})]}),
    "an upload of no name": (lambda c: c.upload(LARGE), {"UPLOAD": [
        reply({**BEGUN, "upload": 5})]}),
    "a page of no jobs": (lambda c: list(c.list()), {"LIST": [
        reply({}, b'{"jobs":[1],"next":null}')]}),
    "a page that is nowhere": (lambda c: list(c.streams()), {"STREAMS": [
        reply({}, b'{"streams":[],"next":5}')]}),
    "a page of nothing and a next one, for ever": (lambda c: list(c.list()), {"LIST": [
        reply({}, b'{"jobs":[],"next":"a"}'), reply({}, b'{"jobs":[],"next":"b"}')]}),
    "a page that leads to itself": (lambda c: list(c.streams()), {"STREAMS": [
        reply({}, b'{"streams":[{}],"next":"a"}')]}),
    "more on a page than was asked for": (lambda c: list(c.list(limit=2)), {"LIST": [
        reply({}, b'{"jobs":[{},{},{}],"next":null}')]}),
    "fewer answers than submissions": (
        lambda c: c.submit_many([("identify", BATCH, None, f"k{k}") for k in range(4)], window=64),
        {"SUBMITS": [reply({}, json.dumps({"jobs": [JOB]}).encode())]}),
    "signals of another shape": (lambda c: c.signals("abcdefgh"), {"RESULT": [
        reply({**PART, "total": 2, "batch": {"samples": 2, "channels": 1, "dt": 1}}, b"{}")]}),
}


@pytest.mark.parametrize("ask, answers", LIES.values(), ids=LIES)
def test_the_python_client_says_that_an_answer_is_none(ask, answers, tmp_path):
    with (Liar(tmp_path / "s", **answers) as liar,
          modald.connect(liar.url, timeout=PATIENCE_S) as client):
        with pytest.raises(modald.Error) as why:
            ask(client)
        assert liar.asked > 0 and why.value.code in ("bad_frame", "internal"), why.value


class Slow(Liar):
    """Each answer to RESULT comes 10 ms after it was asked for; none at all comes to WAIT."""

    waits = 0

    def lie(self, socket, peer, mark, verb, header, *body):
        if verb == b"RESULT":
            self.over.wait(0.01)
        if verb == b"WAIT":
            self.waits += 1
        else:
            super().lie(socket, peer, mark, verb, header, *body)


@pytest.mark.parametrize("ask, timeout", [
    (lambda c: c.submit("identify", BATCH).result(), 2),
    (lambda c: c.signals("a", timeout=2), PATIENCE_S)])
def test_pieces_that_keep_coming_are_not_waited_for_beyond_the_timeout(ask, timeout, tmp_path):
    """A thousand pieces, each well within it."""
    pieces = [reply({**PART, "total": 1000}, b" ") for _ in range(1000)]
    with (Slow(tmp_path / "s", SUBMIT=[reply(DONE)], RESULT=pieces) as slow,
          modald.connect(slow.url, timeout=timeout) as client):
        with pytest.raises(modald.Error) as why:
            ask(client)
        assert why.value.code == "timeout" and 2 < slow.asked < 1000, why.value


def test_a_wait_ends_though_the_daemon_says_nothing_to_it(tmp_path, monkeypatch):
    """By its timeout and what an answer may take, not by what a daemon that is lost may, in which
    it was asked five times more."""
    monkeypatch.setattr(session, "ASK_AGAIN", 0.2)
    monkeypatch.setattr(session, "LOST_PATIENCE", 2.0)
    with (Slow(tmp_path / "s", SUBMIT=[reply(JOB)]) as slow,
          modald.connect(slow.url, timeout=PATIENCE_S) as client):
        job = client.submit("identify", BATCH)
        with pytest.raises(modald.Error) as why:
            job.result(timeout=0.2)
        assert why.value.code == "timeout" and slow.waits < 3, (why.value, slow.waits)


@pytest.mark.parametrize("told", [1e308, 10**400, -1, "x", None, True, [1]])
def test_nobody_sleeps_for_ever_as_he_is_told(told):
    assert 0 <= modald.Error("busy", "", detail={"retry_after_s": told}).pause(0.2) <= 5


@pytest.mark.parametrize("answers", [
    [reply({**PART, "total": -1}, b"A" * 5000)], [reply({**PART, "total": 1e300}, b"A" * 5000)],
    [reply({**PART, "total": 0.5}, b"A" * 5000)], [reply(PART, b"A" * 5000)],
    [reply({**PART, "total": 67108865}, b"A" * 5000)],
    [reply({**PART, "total": 5001}, b"A" * 5000), reply({**PART, "total": 1 << 20}, b"A" * 90000)],
    [reply({**PART, "total": 6000}, b"A" * 5000), reply({**PART, "total": 10}, b"A" * 900)],
], ids=["below nothing", "beyond all", "a half", "none", "larger than any", "more later",
        "less later"])
def test_modalctl_takes_no_more_of_a_result_than_it_has_room_for(answers, tmp_path):
    with Liar(tmp_path / "s", RESULT=answers) as liar:
        done = subprocess.run([BUILD / "bin" / "modalctl", "--json", "--server", liar.url,
                               "--timeout", "20", "result", "abcdefgh"], capture_output=True,
                              text=True, timeout=250)
        sanitized.hear(done.stderr)
        assert done.returncode == 2, (done.returncode, done.stderr)
        assert json.loads(done.stdout)["error"]["code"] == "bad_frame", done.stdout


@pytest.mark.parametrize("document", [
    {"kind": "identify", "modes": 5}, {"kind": "identify", "modes": [5]},
    {"kind": "identify", "modes": [{"frequency_hz": "x", "exponent": [1, 2, 3], "shape": 5}]},
    {"kind": "steady", "harmonics": [{"dof": 1}]}, {"kind": "curve", "points": 7},
    {"kind": "floquet", "multipliers": [["a", "b"]]}, {"kind": "tradeoff", "rungs": [{}]},
    {"kind": "sweep", "points": [1]}, {"kind": "ablate", "effects": [{}]}],
    ids=lambda document: str(document)[:60])
def test_a_result_that_is_none_says_so_whatever_is_read_of_it(document):
    """Every member gives what it is for or raises Error, and one of them does."""
    found, wrong = modald.results.Result(document), 0
    for name in ("frequency_hz", "std_frequency_hz", "exponent", "multiplier", "shapes"):
        try:
            getattr(found, name)
        except modald.Error as why:
            wrong += why.code == "bad_frame"
    for read in (found.rows, found.svg, found._repr_html_):
        try:
            read()
        except modald.Error as why:
            wrong += why.code == "bad_frame"
    assert wrong > 0


class Flood(Liar):
    """An event, and the next, without end, once it is asked for them."""

    def lie(self, socket, peer, mark, verb, header, *body):
        answer = {"id": json.loads(header)["id"], "verb": "EVENTS", "subscription": "1", "next": 1}
        parts = [peer, b"MODALD1", b"REPLY", json.dumps(answer).encode()]
        while not self.over.is_set():
            socket.send_multipart(parts)
            parts = [peer, b"MODALD1", b"EVENT", b'{"subscription":"1","event":"modes"}']


def test_events_end_at_their_timeout_though_they_never_pause(tmp_path):
    begin, count = time.monotonic(), 0
    with Flood(tmp_path / "s") as flood, modald.connect(flood.url, timeout=PATIENCE_S) as client:
        for _ in client.events(0, timeout=0.3):
            count += 1
            assert time.monotonic() < begin + PATIENCE_S
        assert count > 0
