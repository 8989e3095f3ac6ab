"""What commit 5412946 made, with the present programs: its data folder, its clients' requests, its
daemon's answers (tests/data/earlier).

A folder is opened and every answer is as it was then; clients of then speak with the daemon of now,
those of now with the daemon of then.
"""
import base64
import contextlib
import importlib.util
import json
import lzma
import pathlib
import re
import subprocess
import tarfile
import threading

import jsonschema
import numpy
import pytest
import zmq

from wire import BUILD, PATIENCE_S, Daemon, crc32c, identity

HERE = pathlib.Path(__file__).resolve().parent
EARLIER = HERE.parent / "data" / "earlier"
spec = importlib.util.spec_from_file_location("earlier_make", EARLIER / "make.py")
make = importlib.util.module_from_spec(spec)
spec.loader.exec_module(make)
TOLD = json.loads((EARLIER / "told.json").read_text())
SESSIONS = json.loads(lzma.decompress((EARLIER / "sessions.json.xz").read_bytes()))
SCHEMAS = json.loads(lzma.decompress((EARLIER / "schemas.json.xz").read_bytes()))


def plain(answers):
    """An answer, or a dict of them, without the numbers of its request."""
    return {k: {m: v for m, v in a.items() if m not in ("id", "position")} if isinstance(a, dict)
            else a for k, a in answers.items()}


@contextlib.contextmanager
def opened(folder, workers):
    with tarfile.open(EARLIER / "folder.tar.xz") as tar:
        tar.extractall(folder)
    for part in ("spool", "results"):
        (folder / "data" / part).mkdir(exist_ok=True)
    with Daemon(folder=folder, workers=workers, config=make.KEPT) as daemon:
        yield daemon


def test_the_folder_is_sound_and_every_answer_about_it_is_as_it_was(tmp_path):
    with opened(tmp_path, 0) as d:
        told = {"jobs": TOLD["jobs"]}
        make.ask_all(d.client(), told)
        assert (plain(told["docs"]) == plain(TOLD["docs"])
                and told["by_key"] == TOLD["by_key"] == TOLD["jobs"])
        states = {doc["state"] for doc in told["docs"].values()}
        assert states == {"done", "failed", "cancelled", "dead", "queued"}
        assert plain(told["results"]) == plain(TOLD["results"]) and len(told["results"]) == 40
        assert told["list"] == TOLD["list"] and told["events"] == TOLD["events"]
        # a gap of an open stream is charged for now, and nothing else has changed
        assert (told["used"]["bytes"] == TOLD["used"]["bytes"] + 8 * (1100 - 1024)
                and told["used"]["queued"] == TOLD["used"]["queued"])
        assert d.client().ask("STATUS", job="key:" + TOLD["expired"]).code == "expired"
        checked = subprocess.run([BUILD / "bin" / "modalctl", "fsck", d.folder / "data"],
                                 capture_output=True, text=True)
        assert checked.returncode == 0, checked.stdout


def test_what_was_open_goes_on_where_it_was(tmp_path):
    with opened(tmp_path, 1) as d:
        c = d.client()
        for key in ("queued1", "queued2"):
            assert c.ask("WAIT", job="key:" + key, timeout_s=250)["state"] == "done"
        whole = make.wave(make.SAMPLES, 5)
        begun = c.ask("UPLOAD", op="begin", content="batch", samples=make.SAMPLES, channels=1,
                      dt=0.5, key="open")
        assert (begun["state"], begun["present"]) == ("open", 2 * make.CHUNK)
        last = whole[2 * make.CHUNK:]
        assert c.ask("UPLOAD", [last], op="chunk", upload=begun["upload"], offset=2 * make.CHUNK,
                     crc32c=crc32c(last)).ok
        assert (c.ask("UPLOAD", op="seal", upload=begun["upload"],
                      sha256=identity(make.SAMPLES, 1, 0.5, whole))["state"] == "sealed")
        s = c.ask("STREAM", op="open", name="open", channels=1, dt=0.5)
        assert (s["epoch"], s["next"]) == (0, 1164)
        closed = c.ask("STREAM", op="close", stream=s["stream"])
        gap = numpy.full(1100 - 1024, numpy.nan).tobytes()
        assert closed["gaps"] == [[1024, 1100]]
        assert (closed["sha256"] == identity(1164, 1, 0.5, make.wave(1024, 2) + gap
                                             + make.wave(64, 7)))
        again = c.ask("SUBMIT", kind="identify", key="again", options={"rank.fixed": 2},
                      input={"sha256": TOLD["sealed"]})
        # samples are missing, as then
        assert again.ok and c.ask("WAIT", job=again["job"], timeout_s=250)["state"] == "failed"
        assert c.ask("RETRY", job="key:dead")["state"] in ("queued", "running")
        assert c.ask("CANCEL", job="key:dead")["state"] == "cancelled"


def test_a_damaged_batch_of_then_is_corrupt_though_its_parts_had_no_checksums(tmp_path):
    """A sealed stream of then has one checksum in all; once it was read its parts have theirs."""
    with opened(tmp_path, 0) as d:
        c = d.client()
        reply = c.ask("RESULT", job="key:stream", part="input", offset=16, length=160)
        good = c.ask("RESULT", job="key:stream", part="input").body[0]
        assert reply.body[0] == good[16:176]
        path = next(p for p in (tmp_path / "data" / "spool").glob("*.h5") if good in p.read_bytes())
        content = path.read_bytes()
        at = content.index(good)
        for restart in (False, True):
            path.write_bytes(content[:at + 40] + bytes([content[at + 40] ^ 8]) + content[at + 41:])
            if restart:
                d.kill()
                d.start()
                c = d.client()
            assert (c.ask("RESULT", job="key:stream", part="input", offset=16, length=160).code
                    == "corrupt")
            path.write_bytes(content)
            assert c.ask("RESULT", job="key:stream", part="input").body[0] == good


# ---- clients of then, a daemon of now ------------------------------------------------------------


def decoded(frames):
    return [base64.b64decode(frame) for frame in frames]


EXACT = {"id", "verb", "version", "versions", "code", "field", "offset", "present", "samples",
         "epoch", "next", "count", "sha256", "kind", "part",
         "gaps", "role", "duplicate", "name", "channels", "dt"}


def same_shape(then, now, path):
    """All that a client of then could rely on: the members, their types, and the values that are
    not one run's own.
    """
    if not isinstance(then, dict):
        numbers = (int, float)
        assert (type(then) is type(now)
                or (isinstance(then, numbers)
                    and isinstance(now, numbers))), f"{path}: {then} then, {now} now"
        return
    assert isinstance(now, dict), path
    for key, value in then.items():
        assert key in now, f"{path}.{key} is no longer told"
        assert key not in EXACT or value == now[key], f"{path}.{key}: {value} then, {now[key]} now"
        same_shape(value, now[key], f"{path}.{key}")


def replay(client, kept):
    """Every request of KEPT with the identifiers of this run in it; every answer held against that
    of then.
    """
    idents, waiting, compared = {}, {}, 0
    for what, frames in kept:
        frames = decoded(frames)
        if what == "request":
            header = frames[2].decode()
            for then, now in idents.items():
                header = header.replace(f'"{then}"', f'"{now}"')
            client.raw(frames[0], frames[1], header.encode(), *frames[3:])
            continue
        header = json.loads(frames[2])
        if frames[1] == b"EVENT":
            continue
        while header["id"] not in waiting:
            reply = client.receive()
            waiting[reply.get("id")] = reply
        reply = waiting.pop(header["id"])
        assert reply.verb == frames[1].decode(), f"{header} then, {reply} now"
        same_shape(header, reply.header, header["verb"])
        assert len(reply.body) == len(frames) - 3
        if header["verb"] == "SUBMITS":
            then, now = json.loads(frames[3])["jobs"], json.loads(reply.body[0])["jobs"]
            idents.update({a["job"]: b["job"] for a, b in zip(then, now)})
            assert len(then) == len(now)
        idents.update({header[k]: reply[k] for k in ("job", "upload", "stream")
                       if isinstance(header.get(k), str)})
        compared += 1
    return compared


@pytest.mark.parametrize("session", ["day", "simulation"])
def test_the_clients_of_then_get_from_the_daemon_of_now_what_they_got(session):
    with Daemon(workers=1) as d:
        assert (replay(d.client(), SESSIONS[session])
                == sum(what == "answer" for what, _ in SESSIONS[session]))


# ---- a daemon of then, clients of now ------------------------------------------------------------


class DaemonOfThen:
    """Answers as the daemon of then did to the same verb about the same thing; what it would have
    refused is noted.
    """

    def __init__(self, folder, kept):
        self.endpoint, self.refused, self.over = f"ipc://{folder}/then", [], threading.Event()
        asked, self.answers = {}, []
        for what, frames in kept:
            frames = decoded(frames)
            header = json.loads(frames[2])
            if what == "request":
                asked[header["id"]] = (frames[1].decode(), header)
            else:
                self.answers.append([*asked[header["id"]], frames, False])
        self.thread = threading.Thread(target=self.serve)

    def __enter__(self):
        self.socket = zmq.Context.instance().socket(zmq.ROUTER)
        self.socket.bind(self.endpoint)
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.over.set()
        self.thread.join()
        self.socket.close(0)

    def find(self, verb, header):
        def likeness(entry):
            same = sum(entry[1].get(k) == header.get(k)
                       for k in ("op", "job", "part", "upload", "key", "kind"))
            return (same, not entry[3])
        entries = [entry for entry in self.answers if entry[0] == verb]
        best = max(entries, key=likeness, default=None)
        if best is not None:
            best[3] = True
        return best

    def serve(self):
        while not self.over.is_set():
            if not self.socket.poll(20):
                continue
            peer, version, verb, header, *_ = self.socket.recv_multipart()
            verb, header = verb.decode(), json.loads(header)
            try:
                assert version == b"MODALD1" and verb.lower() in SCHEMAS, verb
                jsonschema.validate(header, SCHEMAS[verb.lower()])
            except (AssertionError, jsonschema.ValidationError) as error:
                self.refused.append((verb, header, str(error)[:200]))
            found = self.find(verb, header)
            if found is not None:
                answer = {**json.loads(found[2][2]), "id": header["id"]}
                self.socket.send_multipart([peer, found[2][0], found[2][1],
                                            json.dumps(answer).encode(), *found[2][3:]])


def test_the_python_client_of_now_has_its_day_with_the_daemon_of_then(tmp_path):
    modald = pytest.importorskip("modald")
    with (DaemonOfThen(tmp_path, SESSIONS["day"]) as then,
          modald.connect(then.endpoint, timeout=PATIENCE_S) as client):
        told = make.day(modald, numpy, client)
        assert then.refused == [] and json.loads(json.dumps(told)) == SESSIONS["told"]


def test_modalctl_of_now_reads_the_daemon_of_then(tmp_path):
    job = next(json.loads(decoded(frames)[2])["job"] for what, frames in SESSIONS["day"]
               if what == "answer" and b'"verb":"WAIT"' in decoded(frames)[2])
    with DaemonOfThen(tmp_path, SESSIONS["day"]) as then:
        for arguments in (["whoami"], ["stats"], ["status", "key:again"], ["result", job]):
            done = subprocess.run([BUILD / "bin" / "modalctl", "--server", then.endpoint, "--json",
                                   *arguments], capture_output=True, text=True, timeout=PATIENCE_S)
            document = json.loads(done.stdout)
            assert document.get("error", {}).get("code") in (None, "expired"), done
            assert done.returncode == (0 if "error" not in document else done.returncode)
        assert then.refused == []


def test_the_streaming_client_of_now_speaks_with_the_daemon_of_then(tmp_path):
    loop = BUILD / "examples" / "example_loop"
    with DaemonOfThen(tmp_path, SESSIONS["simulation"]) as then:
        env = {"PATH": "/usr/bin:/bin", "MODALD_URL": then.endpoint, "MODALD_SPILL": str(tmp_path),
               "MODALD_CLOSE_WAIT": str(PATIENCE_S)}
        done = subprocess.run([loop, "host", "300", "2"], env=env, capture_output=True,
                              timeout=2 * PATIENCE_S)
        assert done.returncode == 0 and then.refused == []
        assert ({(entry[0], entry[1].get("op")) for entry in then.answers if entry[3]}
                >= {("STREAM", "open"), ("STREAM", "push"), ("STREAM", "close")})
        assert not re.search(rb"refused|kept|lost", done.stderr), done.stderr


def test_a_client_of_another_major_version_is_told_which_are_spoken():
    with Daemon(workers=0) as d:
        c = d.client()
        c.raw(b"MODALD0", b"HELLO", b'{"id":1}')
        reply = c.receive()
        assert (reply.code == "bad_version" and reply["error"]["detail"]["versions"] == ["MODALD1"]
                and reply.version == b"MODALD1")
