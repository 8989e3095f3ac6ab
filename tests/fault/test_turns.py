"""Whatever one user asks, nobody else's requests wait behind all of it (PROTOCOL.md, P6)."""
# Tests as well: hold.c
import math
import pathlib
import re
import struct
import sys

import pytest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "system"))
import sanitized  # noqa: E402
from lab import FAKE, Lab  # noqa: E402
from wire import BUILD, Daemon, crc32c, ring_down, until  # noqa: E402

SAMPLES = 8192                          # of 64 kB, the largest input that comes with its SUBMIT
WAVE = b"".join(struct.pack("<d", math.sin(0.01 * k)) for k in range(SAMPLES))
EACH, CONNECTIONS = 60, 8               # 31 MB: less than what may wait


# A disk whose syncs take 0.2 s: 30 of these submissions each, 480 in 3 s, however slow their
# sender.
SLOW_DISK = {"LD_PRELOAD": str(BUILD / "fault" / "libslow.so"), "SYNC_US": "200000"}


def flood(clients, other, each=EACH):
    """Each of CLIENTS submits EACH inputs, as many as wait; OTHER sees some before the ledger."""
    for number, client in enumerate(clients):
        for k in range(each):
            client.send("SUBMIT", [struct.pack("<d", number * 1e6 + k) + WAVE[8:]], kind="identify",
                        options={}, input={"content": "batch", "samples": SAMPLES, "channels": 1,
                                           "dt": 0.01})
    until(lambda: other.ask("STATS")["ledger"]["waiting"] >= 16)


def begins(client):
    reply = client.ask("UPLOAD", op="begin", content="batch", samples=100, channels=1, dt=0.01)
    assert reply.ok, reply


def groups(client, what="seconds_count"):
    """How many groups of commits there were; WHAT transactions_sum: and what was in them."""
    text = client.ask("METRICS").body[0].decode()
    return int(float(re.search(rf"^modald_commit_{what} (\S+)$", text, re.MULTILINE)[1]))


def syncs_of_a_begin(client):
    """How many groups of commits come to their end while `UPLOAD begin` is answered; of five the
    least: on a busy machine more of them end while a question is on its way."""
    taken = []
    for _ in range(5):
        before = groups(client)
        begins(client)
        taken.append(groups(client) - before)
    return min(taken)


def submits(client, k):
    data, described = ring_down()
    assert client.ask("SUBMIT", [struct.pack("<d", k) + data[8:]], kind="identify", options={},
                      input=described).ok


def opened(folder, keys, env=None):
    """A daemon, the connections of who floods, and that of somebody else."""
    if keys:
        lab = Lab(folder, {"one": "one submit", "other": "other submit"}, workers=0, env=env)
        return lab.daemon, [lab.client("one") for _ in range(CONNECTIONS)], lab.client("other")
    daemon = Daemon(folder=folder, workers=0, config=FAKE, env=env)
    return daemon, [daemon.client() for _ in range(CONNECTIONS)], daemon.client()


@pytest.mark.skipif(sanitized.SANITIZED, reason="no library is loaded before the sanitizer's")
@pytest.mark.parametrize("keys", [True, False])
def test_anothers_begin_waits_for_a_few_of_a_flood_of_large_submissions(tmp_path, keys):
    daemon, many, other = opened(tmp_path, keys, SLOW_DISK)
    with daemon:
        assert syncs_of_a_begin(other) == 1
        flood(many, other)
        begins(other)
        decided = other.ask("STATS")["jobs"]["queued"]
        print(f"\nturns: {decided} of {EACH * CONNECTIONS} submissions went before another's begin")
        assert decided < EACH * CONNECTIONS * 3 / 4
        # the one under way, and the next, which is his: half of his requests a second alone
        assert syncs_of_a_begin(other) <= 2
        # nothing is lost
        for client in many:
            for k in range(1, EACH + 1):
                assert client.answer(k).ok


@pytest.mark.skipif(sanitized.SANITIZED, reason="no library is loaded before the sanitizer's")
@pytest.mark.parametrize("keys", [True, False])
def test_who_asks_one_thing_after_the_other_has_half_of_the_ledgers_time_beside_a_flood(tmp_path,
                                                                                        keys):
    """Of 4 MiB before the ledger one who floods has a half, 31 of these submissions, and eight have
    eight ninths, 56.  As many went with each sync, and somebody else's request waited for one and a
    half to two of these; where half of the time is his it waits for less than one."""
    daemon, many, other = opened(tmp_path, keys, SLOW_DISK)
    with daemon:
        flood(many, other, 2 * EACH)
        submits(other, 0)
        before, asked = groups(other, "transactions_sum"), 12
        for k in range(1, asked + 1):
            submits(other, k)
        beside = groups(other, "transactions_sum") - before - asked
        print(f"\nturns: {asked} asked one after the other, and {beside} of a flood beside")
        assert 0 < beside <= (31 if keys else 56) * asked
        for client in many:
            for k in range(1, 2 * EACH + 1):
                assert client.answer(k).ok


@pytest.mark.parametrize("keys", [True, False])
def test_a_flood_is_not_read_while_it_waits_and_all_of_it_is_taken_in(tmp_path, keys):
    """128 MB of submissions from 8 connections, of which 64 MiB may wait: their senders wait, and
    none hears `busy`."""
    each = 256
    daemon, many, other = opened(tmp_path, keys)
    with daemon:
        for number, client in enumerate(many):
            for k in range(each):
                client.send("SUBMIT", [struct.pack("<d", number * 1e6 + k) + WAVE[8:]],
                            kind="identify", options={},
                            input={"content": "batch", "samples": SAMPLES, "channels": 1,
                                   "dt": 0.01})
        begins(other)
        said = [client.answer(k) for client in many for k in range(1, each + 1)]
        assert all(reply.ok for reply in said), next(r for r in said if not r.ok)


def test_who_hangs_up_while_he_is_not_read_is_forgotten(tmp_path):
    daemon, many, other = opened(tmp_path, False)
    with daemon:
        for number, client in enumerate(many):
            for k in range(128):
                client.send("SUBMIT", [struct.pack("<d", number * 1e6 + k) + WAVE[8:]],
                            kind="identify", options={},
                            input={"content": "batch", "samples": SAMPLES, "channels": 1,
                                   "dt": 0.01})
        until(lambda: other.ask("STATS")["jobs"]["queued"] > 0)
        for client in many:
            client.close()
        until(lambda: re.search(r"^modald_connections 1$", other.ask("METRICS").body[0].decode(),
                                re.MULTILINE))
        begins(other)


@pytest.mark.skipif(sanitized.SANITIZED, reason="no library is loaded before the sanitizer\'s")
def test_the_pushes_of_one_message_are_one_group_of_commits(tmp_path):
    """A hundred streams.  Once the first of them was a group of its own, which the others waited
    for."""
    with Daemon(folder=tmp_path, workers=0, env=SLOW_DISK) as daemon:
        client, other = daemon.client(), daemon.client()
        asked = [client.send("STREAM", op="open", name=f"s{k}", channels=1, dt=0.01)
                 for k in range(100)]
        idents = [client.answer(number)["stream"] for number in asked]
        before = groups(other)
        parts = [[ident, 0, 0, 8, crc32c(WAVE[:8])] for ident in idents]
        assert client.ask("STREAM", [WAVE[:8] * 100], op="pushes", parts=parts)["count"] == 100
        assert groups(other) - before == 1
        client.close()
        other.close()
