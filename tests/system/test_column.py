"""Ziegler's column by Debian's Simbody, streamed through the real daemon: unstable is said where it
is, early, and nowhere else.

MODALD_SEEDS: how many noise seeds (100).
"""
import os
import subprocess

import numpy as np
import pytest

from conftest import BUILD, PATIENCE, environment
from wire import Daemon, crc32c

EXAMPLE = BUILD / "examples" / "example_ziegler"
SEEDS = int(os.environ.get("MODALD_SEEDS", "100"))
DT, WINDOW, HOP, START = 0.1, 1200, 300, 1e-5

pytestmark = pytest.mark.skipif(not EXAMPLE.exists(),
                                reason="example_ziegler was not built: Debian package "
                                       "libsimbody-dev")


@pytest.fixture(scope="module")
def daemon():
    with Daemon(workers=1) as d:
        yield d


def column(p, steps, folder):
    """The absolute angles of both links at each step."""
    log = folder / f"{p}.log"
    with open(log, "wb") as out:
        subprocess.run([str(EXAMPLE), "column", str(p), str(steps), str(START)], check=True,
                       capture_output=True, timeout=PATIENCE, env=environment(),
                       preexec_fn=lambda: os.dup2(out.fileno(), 3), close_fds=False)
    return np.frombuffer(log.read_bytes()).reshape(-1, 2)


def verdicts(daemon, name, y):
    """Of each window, in order; every one is waited for."""
    c, said = daemon.client(), []
    subscription = c.ask("EVENTS", stream=name)["subscription"]
    s = c.ask("STREAM", op="open", name=name, channels=2, dt=DT,
              window={"samples": WINDOW, "hop": HOP})["stream"]
    for at in range(0, len(y), HOP):
        data = y[at:at + HOP].tobytes()
        assert c.ask("STREAM", [data], op="push", stream=s, epoch=0, first=at,
                     count=len(data) // 16, crc32c=crc32c(data)).ok
        while at + HOP >= WINDOW and len(said) < (at + HOP - WINDOW) // HOP + 1:
            reply = c.early.pop(0) if c.early else c.receive()
            if reply.verb == "EVENT":
                assert "error" not in reply.header, reply.header
                said.append(reply["stability"]["stable"])
    c.ask("EVENTS", op="cancel", subscription=subscription)
    c.ask("STREAM", op="close", stream=s)
    c.close()
    return said


def test_below_the_limit_no_noise_seed_is_ever_said_to_be_unstable(daemon, tmp_path):
    """p = 1.46, 0.6 % below p_d = 1.46929: noise of 0.1 to 3 % of the motion, so that windows of
    every doubt come.
    """
    y = column(1.46, 3000, tmp_path)
    wrong = []
    for seed in range(SEEDS):
        rng = np.random.default_rng(seed)
        level = 10 ** rng.uniform(-3, -1.5) * np.sqrt(np.mean(y * y))
        said = verdicts(daemon, f"stable-{seed}", y + level * rng.standard_normal(y.shape))
        assert len(said) == 7
        wrong += [(seed, i) for i, stable in enumerate(said) if stable is False]
    assert wrong == []


def test_above_the_limit_unstable_is_said_before_the_tip_exceeds_a_hundredth_of_the_length(
        daemon, tmp_path):
    y = column(1.60, 3000, tmp_path)
    tip = np.abs(np.sin(y).sum(axis=1))
    for seed in range(SEEDS):
        rng = np.random.default_rng(1000 + seed)
        said = verdicts(daemon, f"unstable-{seed}", y + 0.01 * START * rng.standard_normal(y.shape))
        first = said.index(False)
        assert tip[:WINDOW + first * HOP].max() < 0.01
