"""Whatever one user asks, nobody else's requests wait behind all of it (PROTOCOL.md, P6)."""
import math
import pathlib
import re
import struct
import sys

import pytest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "system"))
import sanitized  # noqa: E402
from lab import FAKE, Lab  # noqa: E402
from wire import BUILD, Daemon  # noqa: E402

SAMPLES = 8192                          # of 64 kB, the largest input that comes with its SUBMIT
WAVE = b"".join(struct.pack("<d", math.sin(0.01 * k)) for k in range(SAMPLES))
EACH, CONNECTIONS = 60, 8               # 31 MB: less than what may wait


# A disk whose syncs take 0.2 s: 30 of these submissions each, 480 in 3 s, however slow their
# sender.
SLOW_DISK = {"LD_PRELOAD": str(BUILD / "fault" / "libslow.so"), "SYNC_US": "200000"}


def flood(clients):
    """Each of CLIENTS submits EACH inputs, and hears that all of them have been taken in."""
    for number, client in enumerate(clients):
        for k in range(EACH):
            client.send("SUBMIT", [struct.pack("<d", number * 1e6 + k) + WAVE[8:]], kind="identify",
                        options={}, input={"content": "batch", "samples": SAMPLES, "channels": 1,
                                           "dt": 0.01})
    for client in clients:
        assert client.ask("HELLO", versions=["MODALD1"]).ok


def begins(client):
    reply = client.ask("UPLOAD", op="begin", content="batch", samples=100, channels=1, dt=0.01)
    assert reply.ok, reply


def syncs_of_a_begin(client):
    """How many groups of commits come to their end while `UPLOAD begin` is answered; of five the
    least: on a busy machine more of them end while a question is on its way."""
    def groups():
        text = client.ask("METRICS").body[0].decode()
        return float(re.search(r"^modald_commit_seconds_count (\S+)$", text, re.MULTILINE)[1])

    taken = []
    for _ in range(5):
        before = groups()
        begins(client)
        taken.append(groups() - before)
    return min(taken)


@pytest.mark.skipif(sanitized.SANITIZED, reason="no library is loaded before the sanitizer's")
@pytest.mark.parametrize("keys", [True, False])
def test_anothers_begin_waits_for_a_few_of_a_flood_of_large_submissions(tmp_path, keys):
    if keys:
        lab = Lab(tmp_path, {"one": "one submit", "other": "other submit"}, workers=0,
                  env=SLOW_DISK)
        daemon, many, other = lab.daemon, [lab.client("one") for _ in range(CONNECTIONS)], (
            lab.client("other"))
    else:
        daemon = Daemon(folder=tmp_path, workers=0, config=FAKE, env=SLOW_DISK)
        many, other = [daemon.client() for _ in range(CONNECTIONS)], daemon.client()
    with daemon:
        assert syncs_of_a_begin(other) == 1
        flood(many)
        begins(other)
        decided = many[0].ask("STATS")["jobs"]["queued"]
        print(f"\nturns: {decided} of {EACH * CONNECTIONS} submissions went before another's begin")
        assert decided < EACH * CONNECTIONS * 3 / 4
        # the one under way, and the next, which is his: half of his requests a second alone
        assert syncs_of_a_begin(other) <= 2
        # nothing is lost
        for client in many:
            for k in range(1, EACH + 1):
                assert client.answer(k).ok
