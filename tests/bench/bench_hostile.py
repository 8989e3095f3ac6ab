#!/usr/bin/python3
"""What each bad peer of tests/fault/hostile.py costs an honest client: the median time of a
question answered from memory, under attack over usual.

What a probe's own process takes of the machine is not the daemon's doing, so the usual time is that
of a daemon beside which the same probe attacks another one.  Rounds alternate; of each the best
counts, as what else runs here only adds.
"""
import json
import pathlib
import statistics
import sys
import time

HERE = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent / "system"), str(HERE.parent / "fault")]
from hostile import attack, free_port  # noqa: E402
from wire import Client, Daemon, submit  # noqa: E402

FAKE = f"worker_path = {HERE.parent / 'system' / 'fake_worker.py'}\n"
ROUNDS, ASKED = 5, 300


def median_ms(client):
    taken = []
    for _ in range(ASKED):
        begin = time.perf_counter()
        assert client.ask("STATUS", job="key:known").ok
        taken.append(time.perf_counter() - begin)
    return statistics.median(taken) * 1e3


def main():
    for probe in ("oversize", "garbage", "taken", "deaf", "malformed", "hangups", "fleeting",
                  "endless", "silent"):
        with Daemon(config=FAKE, endpoint=f"tcp://127.0.0.1:{free_port()}") as here, Daemon(
            config=FAKE, endpoint=f"tcp://127.0.0.1:{free_port()}") as there:
            client = Client(here.endpoint, identity=b"honest")
            assert submit(client, key="known").ok
            usual, attacked = [], []
            for _ in range(ROUNDS):
                for daemon, times in ((there, usual), (here, attacked)):
                    with attack(probe, daemon):
                        time.sleep(0.5)
                        times.append(median_ms(client))
            print(json.dumps({"bench": "hostile", "case": f"question under {probe}",
                              "value": round(min(attacked), 4), "unit": "ms",
                              "peer": "the same beside another daemon",
                              "ratio": round(min(attacked) / min(usual), 3), "n": ROUNDS}),
                  flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
