"""Workers of other hosts (PROTOCOL.md, section 13): who may be one, what is believed of them, how
they come, leave and are lost. Real workers and ones that speak by hand, over TCP with keys.
"""
# Tests as well: elsewhere.c keyfile.c pull.c words.c
import contextlib
import json
import os
import pathlib
import re
import signal
import socket
import subprocess
import sys
import threading
import time

import jsonschema
import numpy as np
import pytest
import zmq

import sanitized
from lab import FAKE, Lab
from wire import BUILD, PATIENCE_S, Client, Reply, crc32c, identity, scene_job, submit, until

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "clients" / "python"))
import modald  # noqa: E402

pytestmark = pytest.mark.skipif(not zmq.has("curve"), reason="this pyzmq has no CURVE")
PROTO = pathlib.Path(__file__).resolve().parents[2] / "proto"
WORKER = str(BUILD / "bin" / "modald-worker")
VERSION = subprocess.run([WORKER, "--version"], capture_output=True,
                         text=True).stdout.split()[1]
USERS = {"ann": "ann submit", "eva": "eva admin", "wes": "wes worker", "wim": "wim worker",
         "rob": "rob read"}


def free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


class Site(Lab):
    """A daemon without workers of its own, unless told, and an endpoint for those elsewhere."""

    def __init__(self, folder, config="", **options):
        self.port = f"tcp://127.0.0.1:{free_port()}"
        super().__init__(folder, USERS, config=config + f"worker_bind = {self.port}\n",
                         **{"workers": 0, **options})
        self.processes, self.spoken = [], []

    def keyfile(self, name):
        public, secret = self.pairs[name]
        path = self.folder / f"{name}.key"
        self.write(path, f'public-key = "{public.decode()}"\nsecret-key = "{secret.decode()}"\n'
                         f'server-key = "{self.server[0].decode()}"\n')
        return str(path)

    def worker(self, *words, name="wes", env=None):
        """A real one."""
        said = open(self.folder / f"worker{len(self.processes)}", "wb")
        self.processes.append(subprocess.Popen(
            [WORKER, "--connect", self.port, "--keyfile", self.keyfile(name), *map(str, words)],
            stderr=said, env={**os.environ, **(env or {})}))
        said.close()
        return self.processes[-1]

    def said(self, worker):
        return (self.folder / f"worker{self.processes.index(worker)}").read_text()

    def hand(self, key="wes", ready=True, beats=True, **join):
        """One that speaks by hand, but for its heart."""
        made = Hand(self, key, beats)
        self.spoken.append(made)
        if ready:
            assert made.join(**join).verb == "WELCOME"
            made.say("READY")
        return made

    def elsewhere(self):
        return self.client("eva").ask("STATS")["workers"]["elsewhere"]

    def end(self):
        for process in self.processes:
            process.kill()
            process.wait()
        for one in self.spoken:
            one.close()
        self.daemon.__exit__()


class Hand:
    def __init__(self, site, name, beats):
        self.lock, self.closed = threading.Lock(), threading.Event()
        self.socket = zmq.Context.instance().socket(zmq.DEALER)
        self.socket.linger = 0
        self.socket.rcvtimeo = 1000 * PATIENCE_S
        public, secret = site.pairs[name]
        self.socket.curve_serverkey = site.server[0]
        self.socket.curve_publickey, self.socket.curve_secretkey = public, secret
        self.socket.connect(site.port)
        self.heart = threading.Thread(target=self.beat, daemon=True) if beats else None

    def beat(self):
        while not self.closed.wait(0.5):
            self.say("BEAT")

    def close(self):
        self.closed.set()
        with self.lock:
            self.socket.close()

    def end_saying(self, words):
        """Its connection ends once its last words are on their way."""
        self.socket.linger = 1000 * PATIENCE_S
        self.say("STDERR", [words])
        self.close()

    def say(self, verb, body=(), **header):
        with self.lock:
            if not self.socket.closed:
                self.socket.send_multipart([b"MODALW1", verb.encode(), json.dumps(header).encode(),
                                            *body])

    def receive(self):
        end = time.monotonic() + PATIENCE_S
        while time.monotonic() < end:
            with self.lock:
                if self.socket.poll(0):
                    return Reply(self.socket.recv_multipart())
            time.sleep(0.001)
        raise AssertionError("nothing came")

    def hear(self, verb=None):
        """The next message; of VERB, those before it passed over."""
        while (reply := self.receive()).verb != verb and verb is not None:
            pass
        return reply

    def join(self, **more):
        self.say("JOIN", **{"version": VERSION, "name": "hand", "node": "n1",
                            "memory_bytes": 1 << 30, **more})
        answer = self.hear()
        if self.heart is not None and answer.verb == "WELCOME" and not self.heart.is_alive():
            self.heart.start()
        return answer

    def run(self):
        """The next RUN, and what names its job."""
        run = self.hear("RUN")
        return run, {"job": run["job"], "attempt": run["attempt"]}

    def done(self, of, document=b'{"kind":"identify"}'):
        self.say("DONE", [document], cpu_s=0.01, **of)
        self.say("READY")


@pytest.fixture()
def site(tmp_path):
    with contextlib.ExitStack() as stack:
        def make(**options):
            made = Site(tmp_path, **options)
            stack.callback(made.end)
            return made
        yield make


def batch(samples, channels, seed=1):
    t = np.arange(samples) * 0.01
    shapes = np.random.default_rng(seed).standard_normal((3, channels))
    y = sum(np.outer(np.exp(-d * t) * np.cos(2 * np.pi * f * t), s)
            for f, d, s in zip((2.0, 3.1, 7.7), (0.3, 0.2, 0.5), shapes))
    return modald.Batch(y + 1e-4 * np.random.default_rng(seed).standard_normal(y.shape), 0.01)


def user(site, name="ann"):
    return modald.connect(site.daemon.endpoint, keyfile=site.keyfile(name), timeout=PATIENCE_S)


def state(client, job):
    return client.ask("STATUS", job=job)


def same(result):
    """Without what tells of times and the machine they were taken on."""
    kept = {k: v for k, v in result.items() if k not in ("cost", "ladder", "provenance")}
    return json.loads(json.dumps(kept))


# ---- who may be one ------------------------------------------------------------------------------

@pytest.mark.parametrize("lines, told", [
    ("worker_bind = tcp://127.0.0.1:7418\n", "without keys everyone who reaches the port"),
    ("worker_bind = ipc:///tmp/w.ipc\n", "accepted: tcp://HOST:PORT")])
def test_worker_bind_is_refused_without_keys_and_off_tcp(tmp_path, lines, told):
    (tmp_path / "c").write_text(lines)
    done = subprocess.run([str(BUILD / "bin" / "modald"), "--data", str(tmp_path / "d"), "--bind",
                           f"ipc://{tmp_path}/s", "--config", str(tmp_path / "c")],
                          capture_output=True, text=True)
    assert done.returncode == 2 and told in done.stderr


FAILED = (zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL
          | zmq.EVENT_HANDSHAKE_FAILED_AUTH)


@pytest.mark.parametrize("name, where", [("wes", "clients"), ("ann", "workers"),
                                         ("eva", "workers")])
def test_a_workers_key_is_admitted_where_workers_are_and_no_other_there(site, name, where):
    it = site()
    public, secret = it.pairs[name]
    made = Client(it.daemon.endpoint if where == "clients" else it.port,
                  keys=(it.server[0], public, secret))
    monitor = made.socket.get_monitor_socket(FAILED)
    made.raw(b"MODALW1", b"JOIN", b"{}")
    assert monitor.poll(1000 * PATIENCE_S), "no handshake failed"
    made.socket.disable_monitor()
    made.close()
    assert it.elsewhere() == 0


def test_a_worker_can_ask_nothing_that_a_client_can(site):
    it = site()
    job = submit(it.client("ann"))["job"]
    hand = it.hand(ready=False)
    for verb in ("LIST", "STATUS", "RESULT", "SUBMIT", "STATS", "HELLO"):
        hand.socket.send_multipart([b"MODALD1", verb.encode(),
                                    json.dumps({"id": 1, "job": job}).encode()])
        hand.say(verb, id=1, job=job)
    assert hand.join().verb == "WELCOME"            # and nothing came before it


def test_the_vectors_of_workers_are_answered_as_they_say_and_meet_their_schemas(site):
    it = site()
    schemas = json.loads((PROTO / "schema" / "workers.json").read_text())["$defs"]
    for vector in json.loads((PROTO / "vectors" / "workers.json").read_text()):
        header = {**vector["header"]}
        if header["version"] == "@VERSION@":
            header["version"] = VERSION
        hand = it.hand(ready=False)
        hand.say(vector["verb"], **header)
        answer = hand.hear()
        assert answer.verb == vector["answer"], vector["name"]
        jsonschema.validate(answer.header, schemas[answer.verb])
        if answer.verb == "NO":
            assert (answer["error"]["code"],
                    answer["error"]["field"]) == (vector["code"], vector["field"])
        if vector.get("code") == "bad_input":
            with pytest.raises(jsonschema.ValidationError):
                jsonschema.validate(header, schemas["JOIN"])
        else:
            jsonschema.validate(header, schemas["JOIN"])


def test_a_revoked_worker_is_out_and_its_job_goes_elsewhere(site):
    it = site()
    out, other = it.hand("wes", name="out"), it.hand("wim", name="other")
    ann = it.client("ann")
    job = submit(ann, max_attempts=1)["job"]
    until(lambda: "worker" in state(ann, job).header)
    has, waits, key = ((out, other, "wes") if state(ann, job)["worker"]["name"] == "out"
                       else (other, out, "wim"))
    _, of = has.run()
    it.write_keys(leave_out=(key,))
    it.reload()
    _, again = waits.run()
    assert again == {"job": of["job"], "attempt": 2}
    has.done(of, b'{"by":"the revoked"}')
    waits.done(again, b'{"by":"the other"}')
    assert ann.ask("WAIT", job=job, timeout_s=200)["state"] == "done"
    assert ann.ask("RESULT", job=job, part="document").body[0] == b'{"by":"the other"}'
    has.say("JOIN", version=VERSION, name="again", node="n", memory_bytes=1)
    assert has.hear("NO")["error"]["code"] == "denied"


def test_a_worker_cannot_name_anothers_job_or_attempt(site):
    it = site()
    good, bad = it.hand(name="good"), it.hand(name="bad")
    ann = it.client("ann")
    jobs = [submit(ann, phase=p)["job"] for p in (0.1, 0.2)]
    (_, one), (_, two) = good.run(), bad.run()
    for of in (one, {**two, "attempt": 2}, {**one, "attempt": 2},
               {"job": "00000000", "attempt": 1}):
        bad.say("DONE", [b'{"by":"bad"}'], cpu_s=0, **of)
        bad.say("RELEASE", why="drain", **of)
        bad.say("FAILED", cpu_s=0, error={"code": "internal", "message": "bad"}, **of)
        bad.say("INPUT", offset=0, length=8, **of)
    bad.done(two, b'{"by":"two"}')
    good.done(one, b'{"by":"one"}')
    for job in jobs:
        assert ann.ask("WAIT", job=job, timeout_s=200)["attempts"] == 1
        by = ann.ask("RESULT", job=job, part="document").body[0]
        assert by == (b'{"by":"one"}' if job == one["job"] else b'{"by":"two"}')


def test_two_workers_of_one_name_are_two(site):
    it = site()
    assert it.client("rob").ask("STATS").body == []
    one, two = it.hand(name="same"), it.hand("wim", name="same")
    assert json.loads(it.client("rob").ask("STATS").body[0]) == ["same", "same"]
    with user(it, "rob") as rob:
        assert rob.stats()["workers"]["names"] == ["same", "same"]
    ann = it.client("ann")
    jobs = {submit(ann, phase=p)["job"] for p in (0.1, 0.2)}
    assert {one.run()[1]["job"], two.run()[1]["job"]} == jobs and it.elsewhere() == 2


# ---- inputs --------------------------------------------------------------------------------------

def test_a_large_input_is_pulled_in_pieces_with_their_checksums(site):
    it = site()
    hand = it.hand()
    data = batch(3000, 60)
    raw = np.ascontiguousarray(data.signals).tobytes()
    with user(it) as ann:
        ann.submit("identify", data)
        run, of = hand.run()
        told = run["input"]
        assert ((told["samples"], told["channels"]) == (3000, 60) and told["pull"] is True
                and "file" not in told)
        assert told["crc32c"] == crc32c(raw) and told["sha256"] == identity(3000, 60, 0.01, raw)
        got = bytearray(len(raw))
        for at in range(0, len(raw), 1 << 20):
            hand.say("INPUT", offset=at, length=min(1 << 20, len(raw) - at), **of)
            chunk = hand.hear("CHUNK")
            assert (chunk["job"], chunk["attempt"], chunk["offset"]) == (*of.values(), at)
            assert chunk["crc32c"] == crc32c(chunk.body[0])
            got[at:at + len(chunk.body[0])] = chunk.body[0]
        assert bytes(got) == raw


@pytest.mark.parametrize("pulls", [
    [{"offset": 0, "length": 0}], [{"offset": 0, "length": (1 << 20) + 1}],
    [{"offset": -1, "length": 1}],
    [{"offset": 1439993, "length": 8}], [{"offset": 2 ** 53, "length": 1 << 20}],
    [{"offset": 0.5, "length": 1}],
    [{"length": 1}], [{"offset": 0, "length": 1 << 20}] * 64])
def test_who_pulls_what_is_not_there_or_past_his_credit_is_stopped(site, pulls):
    it = site()
    hand = it.hand()
    with user(it) as ann:
        job = ann.submit("identify", batch(3000, 60))
        _, of = hand.run()
        for pull in pulls:
            hand.say("INPUT", **of, **pull)
        hand.hear("STOP")
        until(lambda: ann.status(job.id)["state"] == "queued")
    assert "event=worker_protocol" in it.daemon.text()


def test_results_from_elsewhere_are_those_of_this_host(site):
    it = site()
    it.worker()
    data = [batch(400, 1), batch(3000, 60)]                   # with the job, and pulled
    with user(it) as ann:
        results = [ann.submit("identify", one).result(PATIENCE_S) for one in data]
    for one, result in zip(data, results):
        with modald.local() as here:
            alone = here.submit("identify", one).result(PATIENCE_S)
        assert same(dict(result)) == same(dict(alone))
        assert result["provenance"]["blas_core"] == alone["provenance"]["blas_core"]


# ---- what it may have ----------------------------------------------------------------------------

def test_no_worker_has_a_batch_beyond_its_memory_and_others_pass_it_by(site):
    it = site()
    small = it.hand(name="small", memory_bytes=100000)
    with user(it) as ann:
        large = ann.submit("identify", batch(3000, 60))
        little = ann.submit("identify", batch(400, 1))
        assert small.run()[1]["job"] == little.id
        big = it.hand(name="big", memory_bytes=1440000)
        assert big.run()[1]["job"] == large.id


def test_no_worker_has_a_job_longer_than_its_time_left(site):
    it = site()
    short = it.hand(name="short", left_s=60)
    ann = it.client("ann")
    long = submit(ann, phase=0.1, run_limit_s=61)["job"]
    brief = submit(ann, phase=0.2, run_limit_s=30)["job"]
    assert short.run()[1]["job"] == brief
    assert state(ann, long)["state"] == "queued"
    assert it.hand(name="free").run()[1]["job"] == long


LARGE = (65536, 20)                     # samples and channels: 10 MiB


def pull_all(hand, run, of, pause_s):
    """The input of RUN piece by piece, PAUSE_S before each."""
    total, offset = run["input"]["samples"] * run["input"]["channels"] * 8, 0
    while offset < total:
        time.sleep(pause_s)
        hand.say("INPUT", offset=offset, length=min(1 << 20, total - offset), **of)
        assert "error" not in hand.hear("CHUNK").header
        offset += 1 << 20


@pytest.mark.parametrize("pause_s, goes", [(0.2, False), (0, True)], ids=["slower", "faster"])
def test_a_large_input_goes_elsewhere_where_the_link_is_faster_than_the_job(site, pause_s, goes):
    it = site(workers=1, config=FAKE)
    ann, gate = it.client("ann"), it.daemon.gate()
    local = submit(ann, options=gate.options)["job"]
    until(lambda: state(ann, local)["state"] == "running")
    hand = it.hand()
    with user(it) as large:
        first = large.submit("identify", batch(*LARGE), fresh=True)
        run, of = hand.run()
        begin = time.monotonic()
        pull_all(hand, run, of, pause_s)
        time.sleep(3 * (time.monotonic() - begin) if goes else 0)
        hand.done(of)
        first.result(PATIENCE_S)
        second = large.submit("identify", batch(*LARGE, seed=2), fresh=True)
        small = large.submit("identify", batch(400, 2), fresh=True)
        run, of = hand.run()
        assert (run["input"]["samples"] == LARGE[0]) == goes
        if not goes:
            assert of["job"] == small.id and state(ann, second.id)["state"] == "queued"
        hand.done(of)
        queue = it.client("rob").ask("STATS")["queue"]
        assert queue["elsewhere_s"] == (queue["cpu_s"] if goes else 0)
        assert goes or queue["cpu_s"] > 0
        assert state(ann, local)["state"] == "running"
        gate.open()
        assert "event=link slot=256 name=hand mb_s=" in it.daemon.text()


def test_without_workers_here_a_large_input_goes_by_any_link(site):
    it = site()
    hand = it.hand()
    with user(it) as large:
        for seed in (1, 2):
            job = large.submit("identify", batch(*LARGE, seed=seed), fresh=True)
            run, of = hand.run()
            pull_all(hand, run, of, 0.1)
            hand.done(of)
            job.result(PATIENCE_S)


def test_a_running_job_says_who_has_it_and_where(site):
    it = site()
    hand = it.hand(name="12_3", node="n7")
    ann = it.client("ann")
    job = submit(ann)["job"]
    until(lambda: "worker" in state(ann, job).header)
    assert state(ann, job)["worker"] == {"name": "12_3", "node": "n7"}
    listed = json.loads(ann.ask("LIST").body[0])["jobs"][0]
    assert listed["worker"] == {"name": "12_3", "node": "n7"}
    hand.done(hand.run()[1])
    assert "worker" not in ann.ask("WAIT", job=job, timeout_s=200).header


# ---- live windows
# ---------------------------------------------------------------------------------

class Rig:
    """A stream of ann's, and what is told of it."""

    def __init__(self, site, name="rig"):
        self.client, self.ear = site.client("ann"), site.client("ann")
        assert self.ear.ask("EVENTS", stream=name, kinds=["modes"]).ok
        opened = self.client.ask("STREAM", op="open", name=name, channels=2, dt=0.01,
                                 window={"samples": 400, "hop": 100})
        assert opened.ok, opened
        self.id, self.sent, self.signals = opened["stream"], 0, batch(4000, 2).signals

    def push(self):
        count = 100 if self.sent else 400
        body = self.signals[self.sent:self.sent + count].tobytes()
        assert self.client.ask("STREAM", [body], op="push", stream=self.id, count=count, epoch=0,
                               first=self.sent, crc32c=crc32c(body)).ok
        self.sent += count

    def told(self):
        event = self.ear.receive()
        assert (event["event"], event["to"]) == ("modes", self.sent - 1), event
        return event


WINDOW = b'{"kind":"identify","modes":[],"stability":{"stable":true}}'


def test_live_windows_stay_here_unless_the_configuration_lets_them_go(site):
    it = site(workers=1, config=FAKE)
    gate = it.daemon.gate()
    local = submit(it.client("ann"), options=gate.options)["job"]
    until(lambda: state(it.client("ann"), local)["state"] == "running")
    hand, rig = it.hand(), Rig(it)
    rig.push()
    little = submit(it.client("ann"), phase=0.1)["job"]  # it has waited no longer than the window
    assert hand.run()[1]["job"] == little
    gate.open()


def test_live_windows_of_a_real_worker_elsewhere_are_those_of_one_here(site):
    answers = []
    for options in ({"workers": 1}, {"config": "windows_elsewhere_s = 60\n"}):
        it = site(**options)
        if options.get("workers") is None:
            it.worker()
            until(lambda: it.elsewhere() == 1)
        rig, told = Rig(it, f"of {options}"), []          # the same data folder: another stream
        for _ in range(4):
            rig.push()
            told.append(rig.told())
        answers.append([[(m["frequency_hz"], m["damping_ratio"], m["track"])
                         for m in event["modes"]]
                        for event in told])
        assert [event["update"]["updated"] for event in told] == [False, True, True, True]
        it.end()
    assert answers[0] == answers[1] and len(answers[0][0]) == 3


def test_a_window_goes_whole_to_another_worker_and_only_what_is_new_to_the_same(site):
    it = site(config="windows_elsewhere_s = 60\n")
    one, rig = it.hand(name="one"), Rig(it)
    rig.push()
    run, of = one.run()
    assert (of["job"], run["live"]["to"], run["input"]["samples"]) == ("live", 399, 400)
    assert "pull" not in run["input"] and run.body[0] == rig.signals[:400].tobytes()
    one.done(of, WINDOW)
    assert rig.told()["verdict"] == "stable"
    rig.push()
    run, of = one.run()
    assert run["input"]["samples"] == 100 and run.body[0] == rig.signals[400:500].tobytes()
    two = it.hand("wim", name="two")
    one.say("RELEASE", why="preempted", **of)
    one.hear("STOP")
    run, again = two.run()
    assert run.body[0] == rig.signals[100:500].tobytes() and again["attempt"] != of["attempt"]
    one.done(of, b'{"kind":"identify","modes":[],"stability":{"stable":false}}')
    two.done(again, WINDOW)
    assert rig.told()["verdict"] == "stable"
    assert it.client("eva").ask("STATS")["workers"]["deaths"] == 0


def test_a_window_that_loses_each_worker_elsewhere_is_left_out_and_said_so(site):
    it = site(config="windows_elsewhere_s = 60\n")
    rig = Rig(it)
    rig.push()
    for number in range(3):
        hand = it.hand(name=f"lost{number}")
        hand.run()
        hand.close()
        until(lambda: it.elsewhere() == 0)
    assert rig.told()["error"]["code"] == "worker_died"


def test_a_worker_whose_way_is_long_gets_no_more_windows_and_jobs_as_before(site):
    it = site(config="windows_elsewhere_s = 0.1\n")
    far, rig = it.hand(name="far"), Rig(it)
    rig.push()
    _, of = far.run()
    time.sleep(0.2)
    far.done(of, WINDOW)
    rig.told()
    assert "event=far slot=256 name=far way_ms=" in it.daemon.text()
    rig.push()
    job = submit(it.client("ann"))["job"]
    assert far.run()[1]["job"] == job
    near = it.hand("wim", name="near")
    assert near.run()[0]["live"]["to"] == rig.sent - 1


# ---- how they go ---------------------------------------------------------------------------------

def test_a_job_that_is_given_back_is_no_death_of_its_worker(site):
    it = site()
    ann = it.client("ann")
    job = submit(ann, max_attempts=1)["job"]
    for attempt in range(1, 4):
        hand = it.hand()
        _, of = hand.run()
        assert of["attempt"] == attempt
        hand.say("RELEASE", why="preempted", **of)
        hand.hear("STOP")
    last = it.hand()
    last.done(last.run()[1])
    assert ann.ask("WAIT", job=job, timeout_s=200)["state"] == "done"


def test_a_worker_that_is_lost_is_a_death_with_its_name_and_last_words(site):
    it = site()
    ann = it.client("ann")
    job = submit(ann, max_attempts=1)["job"]
    hand = it.hand(name="12_3", node="n7")
    hand.run()
    hand.end_saying(b"out of luck\x00\xff")
    ended = ann.ask("WAIT", job=job, timeout_s=200)
    assert ended["state"] == "dead"
    assert ended["error"]["message"] == "the worker 12_3 on n7 was lost in attempt 1"
    assert ann.ask("RESULT", job=job, part="stderr").body[0] == b"out of luck??"


NO_MEMORY = b"modald-worker: no memory for a document\n"


def test_a_job_whose_worker_elsewhere_had_no_memory_is_tried_on_a_host_that_may_have_it(site):
    """One of the daemon's own would have none again; of a job that no host has memory for the last
    words tell why it is dead."""
    it = site()
    ann = it.client("ann")
    job = submit(ann, max_attempts=2)["job"]
    for attempt in (1, 2):
        small = it.hand(name=f"small{attempt}")
        run, of = small.run()
        assert of == {"job": job, "attempt": attempt}
        small.end_saying(NO_MEMORY)
    assert ann.ask("WAIT", job=job, timeout_s=200)["state"] == "dead"
    assert ann.ask("RESULT", job=job, part="stderr").body[0] == NO_MEMORY
    assert ann.ask("RETRY", job=job).ok
    large = it.hand(name="large")
    large.done(large.run()[1])
    assert ann.ask("WAIT", job=job, timeout_s=200)["state"] == "done"


unwatched = pytest.mark.skipif(b"__asan_init" in pathlib.Path(WORKER).read_bytes(),
                               reason="a sanitizer's report is its own last word")


@unwatched
def test_the_last_words_of_a_real_worker_reach_the_daemon_whatever_ends_it(site):
    it = site()
    ann = it.client("ann")
    job = scene_job(ann, seconds=20, max_attempts=1)["job"]
    worker = it.worker("--memory", 2 << 30)
    until(lambda: state(ann, job)["state"] == "running")
    with open(f"/proc/{worker.pid}/fd/2", "w", encoding="utf-8") as said:
        said.write("x" * 200_000 + 'the pool said "no"\n\x1b[31mred\n')
    os.kill(worker.pid, signal.SIGABRT)
    ended = ann.ask("WAIT", job=job, timeout_s=200)
    assert ended["state"] == "dead" and worker.wait(PATIENCE_S) == -signal.SIGABRT
    words = ann.ask("RESULT", job=job, part="stderr").body[0].decode()
    assert len(words) == 65536 and words.startswith("xxx")
    assert words.endswith('the pool said "no"\n?[31mred\nmodald-worker: ended by signal 06\n')
    line = next(line for line in it.daemon.text().splitlines() if "event=worker_exit" in line)
    assert len(line) < 1300 and "ended by signal 06" in line and "\x1b" not in line
    assert (it.said(worker).endswith("ended by signal 06\n") and it.said(worker).count("x")
            >= 200_000)


@unwatched
def test_what_a_worker_said_before_stands_ahead_of_what_it_dies_of(site):
    it = site()
    ann = it.client("ann")
    job = scene_job(ann, seconds=20, max_attempts=1)["job"]
    worker = it.worker()
    until(lambda: state(ann, job)["state"] == "running")
    with open(f"/proc/{worker.pid}/fd/2", "w", encoding="utf-8") as said:
        said.write("a warning of long ago\n")
    until(lambda: "a warning" in it.said(worker))
    os.kill(worker.pid, signal.SIGSEGV)
    assert ann.ask("WAIT", job=job, timeout_s=200)["state"] == "dead"
    words = ann.ask("RESULT", job=job, part="stderr").body[0].decode()
    assert words == "a warning of long ago\nmodald-worker: ended by signal 11\n"


def test_a_silent_worker_is_lost_after_three_seconds_and_what_it_says_later_is_not_believed(site):
    it = site()
    ann = it.client("ann")
    hand = it.hand(beats=False)
    job = submit(ann)["job"]
    _, of = hand.run()
    until(lambda: "event=lease slot=256 " in it.daemon.text())
    silent = re.search(r"event=lease slot=256 silent_s=([0-9.]+)", it.daemon.text())
    assert float(silent[1]) >= 3.0
    other = it.hand()
    _, again = other.run()
    assert again["attempt"] == 2
    hand.done(of, b'{"by":"the silent"}')
    other.done(again, b'{"by":"the other"}')
    ann.ask("WAIT", job=job, timeout_s=200)
    assert ann.ask("RESULT", job=job, part="document").body[0] == b'{"by":"the other"}'


def test_a_run_that_meets_a_leave_comes_back_and_who_left_gets_no_more(site):
    it = site()
    hand = it.hand()
    ann = it.client("ann")
    job = submit(ann)["job"]
    hand.say("LEAVE")                     # the RUN is on its way, or the worker is gone already
    while (said := hand.hear()).verb != "STOP":
        assert said.verb == "RUN"
        hand.say("RELEASE", job=said["job"], attempt=said["attempt"], why="drain")
    until(lambda: state(ann, job)["state"] == "queued")
    assert it.elsewhere() == 0


def test_a_cancelled_job_stops_its_worker_at_once(site):
    it = site()
    worker = it.worker()
    ann = it.client("ann")
    job = scene_job(ann)["job"]
    until(lambda: state(ann, job)["state"] == "running" and it.elsewhere() == 1)
    assert ann.ask("CANCEL", job=job).ok
    assert worker.wait(PATIENCE_S) == 1
    assert ann.ask("WAIT", job=job, timeout_s=200)["state"] == "cancelled"


def test_sigterm_ends_an_idle_worker_and_idleness_and_the_end_of_its_time_do(site):
    it = site()
    asked, idle, over = it.worker(), it.worker("--idle", 1), it.worker("--until", 1)
    assert idle.wait(PATIENCE_S) == 0 and over.wait(PATIENCE_S) == 0
    until(lambda: it.elsewhere() == 1)
    asked.terminate()
    assert asked.wait(PATIENCE_S) == 0
    until(lambda: it.elsewhere() == 0)


def test_sigterm_lets_a_job_finish_within_the_grace_and_gives_it_back_after(site):
    it = site()
    ann = it.client("ann")
    kind = it.worker("--grace", 1000)
    job = scene_job(ann, seconds=0.1)["job"]
    until(lambda: state(ann, job).get("progress") or state(ann, job)["state"] == "done")
    kind.terminate()
    assert kind.wait(PATIENCE_S) == 0
    done = ann.ask("WAIT", job=job, timeout_s=200)
    assert (done["state"], done["attempts"]) == ("done", 1)
    hasty = it.worker("--grace", 0)
    job = scene_job(ann, seconds=29, max_attempts=1)["job"]
    until(lambda: state(ann, job)["state"] == "running")
    hasty.terminate()
    assert hasty.wait(PATIENCE_S) == 0
    until(lambda: state(ann, job)["state"] == "queued")


def test_a_daemon_killed_takes_nothing_with_it(site):
    it = site()
    worker = it.worker()
    ann = it.client("ann")
    job = scene_job(ann, seconds=0.2)["job"]
    until(lambda: state(ann, job)["attempts"] == 1)       # it runs, or a fast machine has done it
    it.daemon.kill()
    assert worker.wait(PATIENCE_S) == 1
    it.daemon.start()
    it.worker()
    ann = it.client("ann")
    assert ann.ask("WAIT", job=job, timeout_s=250)["state"] == "done"


def test_a_key_that_is_none_of_a_workers_is_told_so_and_not_tried_again(site):
    it = site()
    worker = it.worker(name="ann")
    assert worker.wait(PATIENCE_S) == 2
    assert "a key of role worker is wanted" in it.said(worker)


def test_a_key_file_that_others_can_read_is_no_key_file(site):
    it = site()
    path = pathlib.Path(it.keyfile("wes"))
    path.chmod(0o644)
    done = subprocess.run([WORKER, "--connect", it.port, "--keyfile", str(path)],
                          capture_output=True,
                          text=True)
    assert done.returncode == 2 and "0600" in done.stderr


@pytest.mark.skipif(sanitized.SANITIZED, reason="sanitizers make calls of their own: no filter")
def test_a_worker_elsewhere_has_the_walls_of_one_here(site):
    it = site()
    worker = it.worker()
    until(lambda: it.elsewhere() == 1)
    # it has joined before the last wall, which stands before it is ready for a job
    status = pathlib.Path(f"/proc/{worker.pid}/status")
    until(lambda: "Seccomp:\t2" in status.read_text())
    assert "NoNewPrivs:\t1" in status.read_text()
