"""Stored inputs and signals that are damaged under the daemon: RESULT hands out the bytes that
came, or says `corrupt` (PROTOCOL.md, P5).
"""
import json
import math
import pathlib
import random
import struct
import sys

import pytest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "system"))
from wire import Daemon, crc32c, identity

SAMPLES, CHUNK = 60000, 65536
SCENE = {"structure": {"type": "chain", "masses": [1.0, 2.0], "springs": [100.0, 50.0, 0.0]},
         "effects": [],
         "initial": {"x": {"x1": 0.3}}, "time": {"dt": 0.01, "duration": 100.0}}


def upload(client, data, dt=0.01):
    ident = client.ask("UPLOAD", op="begin", content="batch", samples=len(data) // 8, channels=1,
                       dt=dt)["upload"]
    for at in range(0, len(data), CHUNK):
        part = data[at:at + CHUNK]
        assert client.ask("UPLOAD", [part], op="chunk", upload=ident, offset=at,
                          crc32c=crc32c(part)).ok
    assert client.ask("UPLOAD", op="seal", upload=ident,
                      sha256=identity(len(data) // 8, 1, dt, data)).ok
    return client.ask("SUBMIT", kind="identify", options={"rank.fixed": 2},
                      input={"upload": ident})["job"]


def stream(client, data, dt=0.01):
    ident = client.ask("STREAM", op="open", name="run", channels=1, dt=dt)["stream"]
    for at in range(0, len(data), CHUNK):
        part = data[at:at + CHUNK]
        assert client.ask("STREAM", [part], op="push", stream=ident, epoch=0, first=at // 8,
                          count=len(part) // 8, crc32c=crc32c(part)).ok
    sha256 = client.ask("STREAM", op="close", stream=ident)["sha256"]
    return client.ask("SUBMIT", kind="identify", options={"rank.fixed": 2},
                      input={"sha256": sha256})["job"]


def whole(client, job, part, length):
    """All of a part in pieces of LENGTH: its bytes, or None where a piece is answered `corrupt`."""
    data, total = b"", 1
    while len(data) < total:
        reply = client.ask("RESULT", job=job, part=part, offset=len(data), length=length)
        if not reply.ok:
            assert reply.code == "corrupt" and "/" not in reply["error"]["message"], reply
            return None
        assert reply["offset"] == len(data) and reply["bytes"] == len(reply.body[0]) > 0
        data, total = data + reply.body[0], reply["total"]
    return data


@pytest.fixture(scope="module")
def stored():
    """A daemon, and of an upload, a sealed stream and simulated signals: job, part, the bytes,
    their file.
    """
    with Daemon() as daemon:
        client, kinds = daemon.client(), {}
        numbers = struct.pack(f"<{SAMPLES}d",
                              *(math.exp(-1e-4 * k) * math.cos(0.3 * k) for k in range(SAMPLES)))
        again = struct.pack(f"<{SAMPLES}d",
                            *(math.exp(-1e-4 * k) * math.sin(0.2 * k) for k in range(SAMPLES)))
        kinds["upload"] = (upload(client, numbers), "input", numbers)
        kinds["stream"] = (stream(client, again), "input", again)
        job = client.ask("SUBMIT", [json.dumps(SCENE).encode()], kind="simulate",
                         input={"content": "scene"})["job"]
        assert client.ask("WAIT", job=job, timeout_s=250)["state"] == "done"
        kinds["simulate"] = (job, "batch", whole(client, job, "batch", 1 << 20))
        files = {path: path.read_bytes()
                 for path in (daemon.folder / "data" / "spool").glob("*.h5")}
        yield daemon, client, {kind: (*told,
                                      next(path for path, content in files.items()
                                           if told[2] in content)) for kind, told in kinds.items()}


@pytest.mark.parametrize("kind", ["upload", "stream", "simulate"])
def test_a_part_of_an_input_is_its_own_bytes_wherever_it_begins_and_ends(stored, kind):
    client, (job, part, data, _) = stored[1], stored[2][kind]
    dice = random.Random(5)
    for _ in range(40):
        offset, length = dice.randrange(len(data) + 100), dice.choice([1, 7, 4096, CHUNK, 1 << 20])
        reply = client.ask("RESULT", job=job, part=part, offset=offset, length=length)
        assert (reply.ok and reply.body[0] == data[offset:offset + length]
                and reply["total"] == len(data) and reply["offset"] == offset)
    assert whole(client, job, part, 100000) == data


def bit(content, at, _):
    content[at] ^= 1 << at % 8


def zero_page(content, at, _):
    content[at & ~4095:(at & ~4095) + 4096] = bytes(4096)


def cut(content, at, _):
    del content[at:]


def copied_page(content, at, end):
    other = (at + 8192) % (end - 8192) & ~4095
    content[at & ~4095:(at & ~4095) + 4096] = content[other:other + 4096]


@pytest.mark.parametrize("kind", ["upload", "stream", "simulate"])
@pytest.mark.parametrize("damage", [bit, zero_page, cut, copied_page])
def test_what_is_damaged_is_never_handed_out_as_good(stored, kind, damage):
    client, (job, part, data, path) = stored[1], stored[2][kind]
    good, dice = path.read_bytes(), random.Random(7)
    place, refused = good.index(data), 0
    for _ in range(6):
        content = bytearray(good)
        damage(content, place + dice.randrange(len(data)), len(good))
        path.write_bytes(content)
        changed = bytes(content[place:place + len(data)]) != data
        for length in (1 << 20, 50000):
            told = whole(client, job, part, length)
            assert told == data if not changed else told is None
        refused += changed
    path.write_bytes(good)
    assert refused > 3 and whole(client, job, part, 1 << 20) == data


def test_a_file_that_is_gone_is_corrupt_and_the_log_says_which_input(stored):
    daemon, client, (job, part, data, path) = stored[0], stored[1], stored[2]["upload"]
    path.rename(path.with_suffix(".away"))
    assert whole(client, job, part, 4096) is None
    assert any("code=corrupt" in line and f"id={path.stem} " in line and "missing" in line
               for line in daemon.text().splitlines())
    path.with_suffix(".away").rename(path)
    assert whole(client, job, part, 1 << 20) == data
