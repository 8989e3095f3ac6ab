"""The vectors and schemas of proto/, replayed from Python against a live daemon
(tests/unit/wire/test_wire.c does it from C).
"""
import json
import pathlib

import jsonschema
import pytest

from wire import Client, Daemon, crc32c, identity, ring_down, submit

PROTO = pathlib.Path(__file__).resolve().parents[2] / "proto"
FAKE = f"worker_path = {pathlib.Path(__file__).parent / 'fake_worker.py'}\n"
REQUESTS = json.loads((PROTO / "vectors" / "requests.json").read_text())
CHECKED_BEFORE_ALL = {"bad_frame", "bad_version", "unknown_verb", "bad_input", "too_large"}


def data_of(frame):
    if "text" in frame:
        return frame["text"].encode()
    return (bytes.fromhex(frame["hex"]) if "hex" in frame else frame["repeat"].encode()
            * frame["times"])


def schema(name):
    return json.loads((PROTO / "schema" / f"{name}.json").read_text())


@pytest.fixture(scope="module")
def daemon():
    with Daemon(config=FAKE, workers=1) as d:
        yield d


@pytest.mark.parametrize("vector", [v for v in REQUESTS if v["name"] != "an oversize body frame"],
                         ids=lambda v: v["name"])
def test_a_request_vector_gets_its_code_through_the_socket(daemon, vector):
    client = daemon.client()
    client.raw(*[data_of(f) for f in vector["frames"]])
    reply = client.receive()
    # well formed: at most about something that is not there
    if vector["code"] == "ok":
        assert reply.code not in CHECKED_BEFORE_ALL or reply["error"].get("field") == "kind", reply
    else:
        assert reply.code == vector["code"], reply
        assert (reply["error"].get("field",
                                   "") == vector.get("field", reply["error"].get("field", "")))
        jsonschema.validate(reply.header, schema("error"))
    if vector["name"] == "drain":
        client.ask("UNDRAIN")
    client.close()


@pytest.mark.parametrize("vector", [v for v in REQUESTS if v["code"] == "ok"],
                         ids=lambda v: v["name"])
def test_a_good_request_meets_its_schema(vector):
    verb, header = data_of(vector["frames"][1]).decode(), json.loads(data_of(vector["frames"][2]))
    jsonschema.validate(header, schema(f"{verb.lower()}.request"))


@pytest.mark.parametrize("vector",
                         [v for v in REQUESTS if v["code"] == "bad_input"
                          and v.get("field") not in ("body", "names", None)],
                         ids=lambda v: v["name"])
def test_a_bad_request_does_not_meet_its_schema(vector):
    verb, header = data_of(vector["frames"][1]).decode(), json.loads(data_of(vector["frames"][2]))
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(header, schema(f"{verb.lower()}.request"))


def test_the_checksum_vectors_hold():
    for vector in json.loads((PROTO / "vectors" / "crc32c.json").read_text()):
        assert crc32c(data_of(vector)) == vector["crc32c"]


def test_the_daemon_knows_inputs_by_the_identity_vectors(daemon):
    client = daemon.client()
    for vector in json.loads((PROTO / "vectors" / "identity.json").read_text()):
        sha = vector.pop("sha256")
        body = (bytes.fromhex(vector.pop("data")) if "data" in vector
                else vector.pop("text").encode())
        if vector["content"] == "batch":
            assert identity(data=body, **{k: v for k, v in vector.items() if k != "content"}) == sha
        assert client.ask("SUBMIT", [body], kind="identify", input=vector).ok
        assert client.ask("SUBMIT", kind="identify", input={"sha256": sha},
                          options={"say": "by hash"}).ok


def test_every_answer_meets_its_schema(daemon):
    client = daemon.client()
    job = submit(client, key="schema", options={"progress": 0.5})
    ident = job["job"]
    asked = [("HELLO", {}), ("STATUS", {"job": ident}), ("WAIT", {"job": ident}),
             ("RESULT", {"job": ident}), ("LIST", {}), ("STATS", {}),
             ("METRICS", {}), ("WHOAMI", {}), ("EVENTS", {"from": 1}), ("CANCEL", {"job": ident}),
             ("DRAIN", {}), ("UNDRAIN", {}),
             ("UPLOAD", {"op": "begin", "content": "batch", "samples": 9, "channels": 1, "dt": 1}),
             ("DELETE", {"job": ident})]
    jsonschema.validate(job.header, schema("submit.reply"))
    for verb, header in asked:
        reply = client.ask(verb, **header)
        assert reply.ok, reply
        jsonschema.validate(reply.header, schema(f"{verb.lower()}.reply"))
        if verb == "LIST":
            page = json.loads(reply.body[0])
            for doc in page["jobs"]:
                jsonschema.validate(doc, schema("doc"))
    for event in [r for r in client.early if r.verb == "EVENT"]:
        jsonschema.validate(event.header, schema("event"))
    assert client.early, "no event came"


class Checked(Client):
    """Holds every answer, and every request that was not refused, against its schema."""

    def __init__(self, *words, **options):
        super().__init__(*words, **options)
        self.asked, self.checked = {}, set()

    def check(self, name, header):
        jsonschema.validate(header, schema(name))
        self.checked.add(name)

    def send(self, verb, body=(), **header):
        number = super().send(verb, body, **header)
        self.asked[number] = verb.lower(), {"id": number, **header}
        return number

    def receive(self):
        reply = super().receive()
        if reply.verb == "EVENT":
            self.check("event", reply.header)
        elif reply.verb == "ERROR":
            self.check("error", reply.header)
        else:
            verb, header = self.asked[reply["id"]]
            assert reply["verb"] == verb.upper()
            self.check(f"{verb}.reply", reply.header)
            self.check(f"{verb}.request", header)
        return reply


def test_messages_of_whole_lives_meet_their_schemas():
    """With real workers: jobs to each end, an upload and its abort, a batch as a result, a stream
    with live modes and a gap.
    """
    data, described = ring_down(samples=400)
    scene = json.dumps({"structure": {"type": "chain", "masses": [1.0], "springs": [100.0, 0.0]},
                        "initial": {"x": {"x1": 0.3}},
                        "time": {"dt": 0.01, "duration": 1.0}}).encode()
    with Daemon(workers=1) as d:
        c = Checked(d.endpoint)
        c.ask("EVENTS", **{"from": 1})
        described.update(names=["a"], units="m", attributes={"rig": "one"})
        begun = c.ask("UPLOAD", op="begin", key="u", **described)
        c.ask("UPLOAD", [data], op="chunk", upload=begun["upload"], offset=0, crc32c=crc32c(data))
        sha = identity(400, 1, 0.01, data, units="m", names=["a"])
        c.ask("UPLOAD", op="seal", upload=begun["upload"], sha256=sha)
        c.ask("UPLOAD", op="abort",
              upload=c.ask("UPLOAD", op="begin", key="v", **described)["upload"])
        ends = {}
        for name, options, given, body, kind in [("done", {"rank.fixed": 2},
                                                  {"upload": begun["upload"]}, [], "identify"),
                                                 ("failed", {"rank.fixed": -1}, {"sha256": sha},
                                                  [], "identify"),
                                                 ("batch", {}, {"content": "scene"}, [scene],
                                                  "simulate")]:
            job = c.ask("SUBMIT", body, kind=kind, options=options, input=given, key=name,
                        priority=5, run_limit_s=60.5, deadline_s=90, max_attempts=2)
            ends[name] = c.ask("WAIT", job=job["job"], timeout_s=250, result=True)["state"]
        assert ends == {"done": "done", "failed": "failed", "batch": "done"}
        assert c.ask("RESULT", job="key:failed").code == "bad_input"
        for part in ({"part": "batch", "length": 80}, {"part": "input"},
                     {"part": "document", "offset": 1}):
            assert c.ask("RESULT", job="key:batch", **part).ok, part
        assert c.ask("RETRY", job="key:done").code == "conflict"
        late = c.ask("SUBMIT", kind="identify", input={"sha256": sha}, key="late", not_before=4e9,
                     fresh=True)
        assert c.ask("CANCEL", job=late["job"])["state"] == "cancelled"
        stream = c.ask("STREAM", op="open", name="live", channels=1, dt=0.01,
                       window={"samples": 300, "hop": 100, "options": {"rank.fixed": 2}})
        c.ask("EVENTS", stream="live")
        c.ask("STREAM", [data], op="push", stream=stream["stream"], epoch=0, first=0, count=400,
              crc32c=crc32c(data))
        while not any(r.verb == "EVENT" and r["event"] == "modes" for r in c.early):
            c.early.append(c.receive())
        c.ask("STREAM", [data], op="push", stream=stream["stream"], epoch=0, first=500, count=400,
              crc32c=crc32c(data))
        assert c.ask("STREAM", op="close", stream=stream["stream"])["gaps"] == [[400, 500]]
        for verb in ("STATS", "WHOAMI", "METRICS", "LIST", "STREAMS"):
            assert c.ask(verb).ok
        page = json.loads(c.ask("STREAMS", name="live").body[0])
        jsonschema.validate(page, schema("streams.page"))
        assert c.ask("RESULT", upload=page["streams"][0]["upload"], part="input", length=80).ok
        assert ({"event", "error", "upload.request", "stream.reply", "result.reply",
                 "submit.request"} <= c.checked)
        c.close()
