"""A worker of another host that somebody has taken over: it has a key of role worker and speaks by
CURVE, and is believed no more than one of the daemon's own (test_taken_over_worker.py).
"""
import json
import os
import socket

import pytest
import zmq

from test_elsewhere import Hand, Site, VERSION
from test_taken_over_worker import DONE, REFUSED, SIGNALS, part
from wire import PATIENCE_S, submit, until

pytestmark = pytest.mark.skipif(not zmq.has("curve"), reason="this pyzmq has no CURVE")
GOOD = b'{"kind":"identify"}'


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    made = Site(tmp_path_factory.mktemp("site"), "connections = 300\n")
    yield made
    assert made.daemon.process.poll() is None
    made.end()


@pytest.fixture()
def evil(site):
    made = site.hand("wes", name="evil")
    yield made
    made.close()
    until(lambda: site.elsewhere() == 0, "its connection stayed")


@pytest.fixture()
def ann(site):
    return site.client("ann")


def text(value):
    """{"text": t, "times": n} anywhere in it is t, n times."""
    if not isinstance(value, dict):
        return value
    if set(value) == {"text", "times"}:
        return value["text"] * value["times"]
    return {key: text(item) for key, item in value.items()}


def send(evil, of, messages):
    for verb, members, bodies in messages:
        evil.say(verb, [b"A" * n for n in bodies], **{**of, **text(members)})


def end_of(evil, ann, *messages):
    """The document of a job of which EVIL says MESSAGES: [verb, members, [bytes of each frame]]."""
    job = submit(ann, max_attempts=1, fresh=True)["job"]
    send(evil, evil.run()[1], messages)
    return ann.ask("WAIT", job=job, timeout_s=200, result=True)


def others_are_served(site, ann):
    """A worker that behaves gets a job, and its user the result."""
    honest = site.hand("wim", name="honest")
    job = submit(ann, fresh=True)["job"]
    honest.done(honest.run()[1], GOOD)
    answer = ann.ask("WAIT", job=job, timeout_s=200, result=True)
    honest.close()
    return answer["state"] == "done" and answer.body[0] == GOOD


def faults(site):
    return site.daemon.text().count("event=worker_protocol")


OF_ELSEWHERE = {
    "last words of more than 64 KiB": [["STDERR", {}, [65537]]],
    "last words of two frames": [["STDERR", {}, [10, 10]]],
    "last words without any": [["STDERR", {}, []]],
    "a piece before the first byte": [["INPUT", {"offset": -1, "length": 1}, []]],
    "a piece of nothing": [["INPUT", {"offset": 0, "length": 0}, []]],
    "a piece of more than there is": [["INPUT", {"offset": 0, "length": 1 << 40}, []]],
    "a piece at the end of numbers": [["INPUT", {"offset": (1 << 53) - 1, "length": 1}, []]],
    "a piece of no number": [["INPUT", {"offset": "0", "length": None}, []]],
}


@pytest.mark.parametrize("messages", [*REFUSED.values(), *OF_ELSEWHERE.values()],
                         ids=[*REFUSED, *OF_ELSEWHERE])
def test_what_does_not_fit_stops_the_worker_and_nothing_else(site, evil, ann, messages):
    before = faults(site)
    end = end_of(evil, ann, *messages)
    assert end["state"] == "dead" and end["error"]["code"] == "worker_died"
    evil.hear("STOP")
    evil.say("READY")
    evil.say("DONE", [GOOD], job=end["job"], attempt=1)
    assert faults(site) == before + 1 and site.daemon.process.poll() is None
    assert others_are_served(site, ann)
    assert ann.ask("STATUS", job=end["job"])["state"] == "dead"


def test_an_error_is_cut_to_what_an_error_may_be(evil, ann):
    error = {"code": "bad_input", "message": "ö" * 3000, "field": "é" * 3000,
             "detail": {"x": "y" * 900000}}
    end = end_of(evil, ann, ["FAILED", {"cpu_s": 0.1, "error": error}, []])
    assert end["state"] == "failed" and "detail" not in end["error"]
    assert len(json.dumps(end.header)) < 8192


@pytest.mark.parametrize("error", [{"code": "ok", "message": "x"}, {"code": "none such"}, [], None])
def test_a_failure_without_a_code_of_this_protocol_is_internal(evil, ann, error):
    end = end_of(evil, ann, ["FAILED", {"error": error, "cpu_s": -1}, []])
    assert end["state"] == "failed" and end["error"]["code"] == "internal"


@pytest.mark.parametrize("claimed", [1e9, -1e9, 1e300])
def test_no_more_time_is_booked_than_the_cores_can_have_given(evil, ann, claimed):
    used = ann.ask("WHOAMI")["used"]["cpu_s_day"]
    end = end_of(evil, ann, ["DONE", {"cpu_s": claimed}, [7]])
    assert end["state"] == "done" and 0 <= ann.ask("WHOAMI")["used"]["cpu_s_day"] - used < 60


def test_a_document_is_the_bytes_that_came_whatever_they_are(evil, ann):
    job = submit(ann, fresh=True)["job"]
    _, of = evil.run()
    evil.say("DONE", [b"\x00\xff not json"], **of)
    assert ann.ask("WAIT", job=job, timeout_s=200)["state"] == "done"
    assert ann.ask("RESULT", job=job, part="document").body[0] == b"\x00\xff not json"


def test_a_flood_of_progress_neither_fills_memory_nor_starves_others(site, evil, ann):
    peer = site.client("eva")
    flood = [["PROGRESS", {"progress": {"a": "z" * 4000}}, []]] * 20000
    job = submit(ann, max_attempts=1, fresh=True)["job"]
    _, of = evil.run()
    send(evil, of, flood)
    assert peer.ask("STATS")["workers"]["elsewhere"] == 1
    evil.say("DONE", [GOOD], **of)
    assert ann.ask("WAIT", job=job, timeout_s=200)["state"] == "done"
    assert len(json.dumps(ann.ask("STATUS", job=job).header)) < 8192


def test_no_line_of_the_log_is_a_workers_own(site, evil, ann):
    forged = 'a\n" level=notice event=audit user=admin what=forged'
    batch = {**SIGNALS, forged: 1}
    end_of(evil, ann, part(0, 128, 8, part="batch", batch=batch), DONE)
    other = Hand(site, "wim", False)
    assert other.join(name=forged)["error"]["code"] == "bad_input"
    assert other.join(node="n\n1")["error"]["code"] == "bad_input"
    other.say(forged)
    other.say("STDERR", [forged.encode()])
    other.close()
    assert others_are_served(site, ann)
    assert all(line.startswith("time=") for line in site.daemon.text().splitlines())


def test_words_with_ends_of_lines_and_quotes_are_one_field_of_one_line(site, evil, ann):
    job = submit(ann, max_attempts=1, fresh=True)["job"]
    evil.run()
    evil.end_saying(b'x" status=0\nlevel=crit event=forged\x1b[2J')
    assert ann.ask("WAIT", job=job, timeout_s=200)["state"] == "dead"
    lines = [line for line in site.daemon.text().splitlines() if "event=forged" in line]
    assert len(lines) == 1 and "event=worker_exit" in lines[0] and "\x1b" not in lines[0]
    assert 'x" status=0' not in lines[0]


def test_who_joins_again_and_again_is_one_worker(site, evil, ann):
    for i in range(300):
        evil.say("JOIN", version=VERSION, name=f"n{i}", node="n", memory_bytes=1)
    until(lambda: site.elsewhere() <= 1)
    assert others_are_served(site, ann)


# ---- on the wire ---------------------------------------------------------------------------------

def dealer(site, **options):
    peer = zmq.Context.instance().socket(zmq.DEALER)
    peer.linger, peer.sndtimeo = 0, 1000
    public, secret = site.pairs["wes"]
    peer.curve_serverkey = site.server[0]
    peer.curve_publickey, peer.curve_secretkey = public, secret
    for name, value in options.items():
        setattr(peer, name, value)
    peer.connect(site.port)
    return peer


def push(peer, frames, times):
    """As often as it takes them within a second."""
    try:
        for _ in range(times):
            peer.send_multipart(frames)
    except zmq.Again:
        pass


BEAT = [b"MODALW1", b"BEAT", b"{}"]
JOIN = [b"MODALW1", b"JOIN", json.dumps({"version": VERSION, "name": "x", "node": "n",
                                         "memory_bytes": 1}).encode()]


@pytest.mark.parametrize("first", [BEAT, JOIN], ids=["stranger", "joined"])
def test_who_pipelines_reads_nothing_and_hangs_up_ends_nothing(site, ann, first):
    for count in (1, 20, 900, 900):
        peers = [dealer(site, rcvhwm=1) for _ in range(5)]
        for peer in peers:
            push(peer, first, 1)
            push(peer, [b"MODALW1", b"INPUT", b'{"job":"x","attempt":1}'], count)
        for peer in peers:
            peer.close()
    until(lambda: site.elsewhere() == 0)
    assert others_are_served(site, ann) and site.daemon.process.poll() is None


def test_a_routing_id_of_a_workers_own_is_not_used(site, ann):
    first, second = (dealer(site, routing_id=b"same") for _ in range(2))
    for peer in (first, second):
        push(peer, JOIN, 1)
    for peer in (first, second):
        assert peer.poll(1000 * PATIENCE_S) and peer.recv_multipart()[1] == b"WELCOME"
    until(lambda: site.elsewhere() == 2)              # who served others may not have gone yet
    push(second, [b"MODALW1", b"BEAT", b"x" * 100], 900)
    second.close()
    first.close()
    until(lambda: site.elsewhere() == 0)
    assert others_are_served(site, ann)


@pytest.mark.parametrize("frames", [
    [b"MODALW1", b"BEAT", b"{}"] + [b"x"] * 200_001, [b"x" * (3 << 20)],
    [b"MODALW1", b"BEAT", b"[" * 100_000], [b"MODALW1", b"BEAT", b'{"job":' * 9000],
    [b"MODALW2", b"JOIN", b"{}"], [b"", b"", b""], [b"MODALW1"], [b"\xff" * 60000] * 3],
    ids=["a bomb of parts", "a large frame", "deep", "deeper", "another protocol", "nothing",
         "one frame", "noise"])
@pytest.mark.parametrize("joined", [False, True])
def test_a_message_that_is_none_ends_who_sends_it_at_most(site, ann, frames, joined):
    peer = dealer(site)
    if joined:
        push(peer, JOIN, 1)
        assert peer.poll(1000 * PATIENCE_S) and peer.recv_multipart()[1] == b"WELCOME"
    push(peer, frames, 3)
    assert others_are_served(site, ann)
    peer.close()
    until(lambda: site.elsewhere() == 0)


def test_what_is_no_message_at_all_stands_in_nobodys_way(site, ann):
    host, port = site.port.removeprefix("tcp://").split(":")
    held = []
    for i in range(100):
        one = socket.create_connection((host, int(port)))
        one.sendall(os.urandom(1 + i * 7) if i % 2 else b"\xff" + bytes(8) + b"\x7f\x03\x00NULL")
        held.append(one)
    assert others_are_served(site, ann)
    for one in held:
        one.close()
