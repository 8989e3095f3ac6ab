"""What the page costs its daemon: processor time of the daemon for 1,000 jobs, with modald-web and
50 readers who hear all of it, and without (the peer), in turns; one JSON line.

What each reader heard is checked, and the page's memory is told beside.
"""
import json
import pathlib
import statistics
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "system"))
from conftest import Daemon, decay  # noqa: E402
from test_page import Page, modald, numbers  # noqa: E402

TURNS, JOBS, READERS = 5, 1000, 50


def cpu_s(pid):
    """Of all its threads, by the scheduler's own count of nanoseconds."""
    stats = pathlib.Path(f"/proc/{pid}/task").glob("*/schedstat")
    return sum(int(stat.read_text().split()[0]) for stat in stats) / 1e9


def turn(seed, watched):
    """Seconds of the daemon, and kB of the page; each job is a computation: no two are alike."""
    daemon, page, readers = Daemon(workers=1), None, []
    try:
        with tempfile.TemporaryDirectory() as folder:
            if watched:
                page = Page(pathlib.Path(folder), daemon.endpoint).ready()
                readers = [page.events("/events?from=0&kinds=state") for _ in range(READERS)]
            with daemon.client() as client:
                before = cpu_s(daemon.process.pid)
                jobs = client.submit_many([("identify",
                                            modald.Batch(decay() * (1 + i + JOBS * seed), 0.05),
                                            None, f"k{i}")
                                           for i in range(JOBS)])
                for job in jobs:
                    job.result()
                for reader in readers:
                    assert len(numbers(reader, 3 * JOBS)) == 3 * JOBS      # queued, running, done
                used = cpu_s(daemon.process.pid) - before
            memory = page.memory_kb() if watched else None
            if watched:
                page.close()
            return used, memory
    finally:
        daemon.stop()


def main():
    pairs = [(turn(seed, True), turn(seed, False)) for seed in range(TURNS)]
    value, peer = (statistics.median(pair[i][0] for pair in pairs) for i in (0, 1))
    print(json.dumps({"bench": "page", "case": f"the daemon's CPU, {JOBS} jobs and {READERS} "
                                               "readers", "value": round(value, 3),
                      "unit": "s", "peer": round(peer, 3), "ratio": round(value / peer, 3),
                      "n": TURNS}), flush=True)
    print(json.dumps({"bench": "page", "case": "memory of the page",
                      "value": max(pair[0][1] for pair in pairs),
                      "unit": "kB", "peer": None, "ratio": None, "n": TURNS}), flush=True)


if __name__ == "__main__":
    main()
