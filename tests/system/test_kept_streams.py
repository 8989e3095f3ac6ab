"""Streams as a list (STREAMS), and the record of a closed one by its name: `stream:NAME`."""
# Tests as well: stream_list.c stored.c streams.c
import json
import sqlite3
import struct
import subprocess

import numpy as np
import pytest

import modald
from conftest import BUILD, PATIENCE, environment
from lab import FAKE, Lab
from wire import Daemon, crc32c, until

DT, ROWS = 0.01, 1200
TIME = DT * np.arange(ROWS)
DECAY = np.stack([np.exp(-0.2 * TIME) * np.cos(9 * TIME),
                  np.exp(-0.1 * TIME) * np.cos(20 * TIME)], axis=1)


def opened(client, name, **more):
    return client.ask("STREAM", op="open", name=name, channels=2, dt=DT, **more)["stream"]


def push(client, ident, first, rows):
    data = np.ascontiguousarray(rows, dtype="<f8").tobytes()
    return client.ask("STREAM", [data], op="push", stream=ident, epoch=0, first=first,
                      count=len(rows), crc32c=crc32c(data))


def close(client, ident):
    return client.ask("STREAM", op="close", stream=ident)


def page(client, **header):
    reply = client.ask("STREAMS", **header)
    assert reply.ok, reply
    listed = json.loads(reply.body[0])
    assert reply["count"] == len(listed["streams"])
    return listed


def names(listed):
    return [(one["name"], one["state"]) for one in listed["streams"]]


def test_an_open_stream_and_the_record_of_a_closed_one_are_listed_the_newest_first(tmp_path):
    with Daemon(folder=tmp_path, config=FAKE) as d:
        client = d.client()
        first = opened(client, "rig7")
        assert push(client, first, 0, DECAY)["next"] == ROWS
        sealed = close(client, first)["sha256"]
        second = opened(client, "rig7")
        push(client, second, 5, DECAY[:100])
        opened(client, "quiet")
        listed = page(client)
        assert names(listed) == [("quiet", "open"), ("rig7", "open"), ("rig7", "sealed")]
        assert listed["next"] is None
        _, live, kept = listed["streams"]
        assert (live["stream"], live["samples"], live["channels"],
                live["dt"]) == (second, 100, 2, DT)
        assert (kept["sha256"], kept["samples"]) == (sealed, ROWS)
        assert "verdict" not in live and 0 < kept["kept_s"] <= 86400
        assert names(page(client, name="quiet")) == [("quiet", "open")]


def test_pages_of_streams_leave_none_out_and_show_none_twice(tmp_path):
    with Daemon(folder=tmp_path, config=FAKE) as d:
        client = d.client()
        for i in range(7):
            ident = opened(client, f"s{i}")
            push(client, ident, 0, DECAY[:9 + i])
            if i % 2:
                assert close(client, ident)["sha256"]
        seen, after = [], {}
        while True:
            listed = page(client, limit=2, **after)
            seen += [one["name"] for one in listed["streams"]]
            if listed["next"] is None:
                break
            after = {"after": listed["next"]}
        assert sorted(seen) == [f"s{i}" for i in range(7)]
        assert client.ask("STREAMS", after="no").code == "bad_input"


def test_a_record_is_found_by_its_streams_name_after_a_restart(tmp_path):
    with Daemon(folder=tmp_path, config=FAKE) as d:
        ident = opened(d.client(), "rig7")
        push(d.client(), ident, 0, DECAY[:50])
        sealed = close(d.client(), ident)["sha256"]
    with Daemon(folder=tmp_path, config=FAKE) as d:
        assert [one["sha256"] for one in page(d.client())["streams"]] == [sealed]


def test_nobody_lists_or_reads_the_streams_of_others_but_an_admin_lists_them(tmp_path):
    users = {"ann": "ann submit", "ben": "ben submit", "root": "root admin"}
    lab = Lab(tmp_path, users)
    with lab.daemon:
        ann, ben, root = (lab.client(name) for name in users)
        ident = opened(ann, "rig7")
        push(ann, ident, 0, DECAY[:50])
        close(ann, ident)
        sealed = page(ann)["streams"][0]["upload"]
        assert names(page(ben)) == [] and names(page(ann)) == [("rig7", "sealed")]
        assert ben.ask("STREAMS", user="ann").code == "denied"
        assert ben.ask("RESULT", upload=sealed, part="input").code == "not_found"
        assert [one["user"] for one in page(root)["streams"]] == ["ann"]
        assert names(page(root, user="ann")) == [("rig7", "sealed")]
        assert names(page(root, name="rig7")) == []
        assert root.ask("STREAMS", user="nobody").code == "not_found"
        whole = ann.ask("RESULT", upload=sealed, part="input", offset=16, length=16)
        assert whole.body[0] == struct.pack("<2d", *DECAY[1])
        assert whole["total"] == 50 * 16 and whole["batch"]["samples"] == 50


@pytest.fixture(scope="module")
def rig(daemon):
    """A stream with windows, as it was listed while it was open; it is closed."""
    with modald.connect(daemon.endpoint) as client:
        talk = {"epoch": 0}
        ident = client.ask("STREAM", {"op": "open", "name": "rig7", "channels": 2, "dt": DT,
                                      "names": ["a", "b"], "units": "m",
                                      "window": {"samples": 400, "hop": 200}})[0]["stream"]
        data = np.ascontiguousarray(DECAY, dtype="<f8").tobytes()
        client.ask("STREAM", {"op": "push", "stream": ident, "first": 0, "count": ROWS,
                              "crc32c": crc32c(data), **talk}, [memoryview(data)])
        while True:                                 # until a window has been told
            live = next(client.streams("rig7"))
            if live["verdict"] is not None:
                break
            next(iter(client.events(start=0, stream="rig7")))
        client.ask("STREAM", {"op": "close", "stream": ident})
    return live


def test_a_live_stream_tells_its_verdict_and_how_far_that_is_behind(rig):
    assert rig["state"] == "open" and rig["verdict"] == "stable"
    assert rig["lag"] % 200 == 0 and 0 <= rig["lag"] <= ROWS - 400
    assert rig["skipped"] * 200 <= ROWS - 400


@pytest.fixture
def ctl(daemon):
    """modalctl as people call it, speaking to the daemon."""
    def run(*words, check=True):
        return subprocess.run([str(BUILD / "bin" / "modalctl"), *words], capture_output=True,
                              text=True, timeout=PATIENCE, check=check,
                              env=environment(MODALD_URL=daemon.endpoint))
    return run


def test_a_stream_is_identified_by_its_name_without_a_file(rig, ctl, daemon):
    result = json.loads(ctl("--json", "identify", "stream:rig7").stdout)
    found = sorted(mode["frequency_rad_s"] for mode in result["modes"])
    assert np.allclose(found, np.hypot([9, 20], [0.2, 0.1]), rtol=1e-9)
    assert result["provenance"]["input"]["attributes"]["stream"] == "rig7"
    with modald.connect(daemon.endpoint) as client:
        assert np.allclose(sorted(client.identify("stream:rig7")["modes"][i]["frequency_rad_s"]
                                  for i in range(2)), found, rtol=1e-12)
        with pytest.raises(modald.Error) as why:
            client.identify("stream:nothing")
        assert why.value.code == "not_found"


def test_of_two_streams_of_the_same_samples_the_named_one_is_meant(rig, ctl):
    ctl("stream", "stream:rig7", "--name", "again")
    for name in ("rig7", "again"):
        result = json.loads(ctl("--json", "identify", f"stream:{name}").stdout)
        assert result["provenance"]["input"]["attributes"]["stream"] == name


@pytest.mark.parametrize("words", [["tradeoff", "identify", "stream:rig7"],
                                   ["submit", "identify", "stream:rig7", "--wait"]])
def test_other_verbs_take_a_stream_where_they_take_a_file(rig, ctl, words):
    assert ctl(*words).returncode == 0


def test_a_list_of_submissions_names_streams_beside_files(rig, ctl, tmp_path):
    (tmp_path / "list.jsonl").write_text('{"kind": "identify", "file": "stream:rig7"}\n' * 3)
    done = ctl("submit", "--from", str(tmp_path / "list.jsonl"), "--wait")
    states = [json.loads(line)["state"] for line in done.stdout.splitlines()]
    assert states[-3:] == ["done"] * 3


def test_export_gives_the_samples_of_a_stream_and_of_a_job_to_the_bit(rig, ctl, tmp_path):
    h5py = pytest.importorskip("h5py")
    job = json.loads(ctl("--json", "submit", "identify", "stream:rig7").stdout)["job"]
    for what in ("stream:rig7", job):
        path = tmp_path / "out.h5"
        ctl("export", what, "-O", str(path))
        with h5py.File(path) as file:
            assert np.array_equal(file["signals"][:], DECAY)
            assert file["signals"].attrs["dt"] == DT


@pytest.mark.parametrize("words, status, said", [
    (["identify", "stream:nothing"], 4, 'not_found: stream: no stream "nothing" of yours'),
    (["identify", "stream:rig7", "--dt", "0.1"], 2, "bad_input: dt: --dt is for files"),
    (["--local", "identify", "stream:rig7"], 2, "bad_input: local: "),
    (["export", "stream:rig7", "-O", "missing/out.h5"], 2, "bad_input: output: missing/out.h5: "),
    (["export", "stream:rig7"], 2, "bad_input: output: -O OUT.h5"),
    (["--local", "streams"], 2, "bad_input: local: streams are a daemon's"),
])
def test_what_cannot_be_had_of_a_stream_is_refused_by_its_field(rig, ctl, words, status, said):
    done = ctl(*words, check=False)
    assert done.returncode == status and said in done.stderr, done


def verdict(daemon, state):
    one, = page(daemon.client())["streams"]
    assert one["state"] == state
    return one.get("verdict")


def test_the_last_verdict_stays_with_a_stream_over_restarts_and_with_its_batch(tmp_path):
    with Daemon(folder=tmp_path) as d:
        ident = opened(d.client(), "rig7", window={"samples": 400, "hop": 400})
        push(d.client(), ident, 0, DECAY[:500])
        until(lambda: verdict(d, "open") is not None, "no window was told")
        assert verdict(d, "open") == "stable"
        lag = page(d.client())["streams"][0]["lag"]
        d.process.kill()
        d.process.wait()
    with Daemon(folder=tmp_path) as d:
        assert verdict(d, "open") == "stable"
        assert page(d.client())["streams"][0]["lag"] == lag
        assert close(d.client(), ident)["samples"] == 500
        assert verdict(d, "sealed") == "stable"
    with Daemon(folder=tmp_path, config=FAKE) as d:
        assert verdict(d, "sealed") == "stable"


def test_a_record_without_a_window_has_no_verdict_and_what_was_noted_goes_with_the_record(tmp_path):
    with Daemon(folder=tmp_path) as d:
        ident = opened(d.client(), "quiet", window={"samples": 400, "hop": 400})
        push(d.client(), ident, 0, DECAY[:50])
        close(d.client(), ident)
        assert verdict(d, "sealed") is None
        ident = opened(d.client(), "rig7", window={"samples": 400, "hop": 400})
        push(d.client(), ident, 0, DECAY[:400])
        until(lambda: page(d.client())["streams"][0]["verdict"] == "stable", "no window was told")
        close(d.client(), ident)

    def noted():
        with sqlite3.connect(tmp_path / "data" / "ledger.db") as ledger:
            return ledger.execute("SELECT topic, name FROM notes").fetchall()
    with Daemon(folder=tmp_path, config=FAKE + "input_age_s = 1\n") as d:
        until(lambda: page(d.client())["streams"] == [], "records stay")
        # a record is told no more before it is gone
        until(lambda: noted() == [], "notes stay")


def test_export_of_a_file_to_a_missing_folder_is_bad_input_by_its_field(tmp_path, ctl):
    (tmp_path / "in.csv").write_text("t,a\n" + "".join(f"{0.1 * i},{i % 3}\n" for i in range(20)))
    done = ctl("--local", "export", str(tmp_path / "in.csv"), "-O", str(tmp_path / "no/out.h5"),
               check=False)
    assert done.returncode == 2 and "bad_input: output: " in done.stderr


def test_the_table_of_streams_has_a_line_for_each(rig, ctl):
    lines = ctl("streams", "rig7").stdout.splitlines()
    assert lines[0].split()[:6] == ["rig7", "local", "sealed", "2", "100", str(ROWS)]
