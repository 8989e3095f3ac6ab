"""What was acknowledged survives: kill -9 under load, at the n-th system call, failing syncs, a
full disk (PROTOCOL.md, section 6).

The workers are tests/system/fake_worker.py, so that the daemon, not the numerics, is what is under
load.  MODALD_KILLS and MODALD_JOBS enlarge the runs.
"""
import contextlib
import json
import os
import pathlib
import random
import shutil
import signal
import subprocess
import sys
import threading
import time

import pytest
import zmq

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "system"))
from small_disk import small_disk  # noqa: E402
from wire import PATIENCE_S, Client, Daemon, crc32c, ring_down, submit, until  # noqa: E402

FAKE = f"worker_path = {HERE.parent / 'system' / 'fake_worker.py'}\n"
KILLS = int(os.environ.get("MODALD_KILLS", 20))
JOBS = int(os.environ.get("MODALD_JOBS", 2000))
CLIENTS = 8
needs_strace = pytest.mark.skipif(shutil.which("strace") is None, reason="strace is not installed")


def patiently(client, verb, body=(), **header):
    """Ask until there is an answer that is not `try again`: what section 10 tells a client to do.
    Each time that none came it is waited for twice as long: else a machine that is slower than the
    client's patience never answers it.
    """
    end, patience_ms = time.monotonic() + PATIENCE_S, client.socket.rcvtimeo
    try:
        while time.monotonic() < end:
            try:
                reply = client.ask(verb, body, **header)
            except zmq.Again:
                client.early.clear()
                client.socket.rcvtimeo = min(2 * client.socket.rcvtimeo, PATIENCE_S * 100)
                continue
            if reply.code not in ("busy", "draining", "storage_full"):
                return reply
            time.sleep(reply["error"]["detail"]["retry_after_s"] / 20)
    finally:
        client.socket.rcvtimeo = patience_ms
    raise AssertionError(f"no answer to {verb}")


def ended(client, job):
    """The end of a job, whenever it comes."""
    while (doc := patiently(client, "WAIT", job=job,
                            timeout_s=1))["state"] in ("queued", "running"):
        pass
    return doc


class Submitter(threading.Thread):
    """Submits keys of its own, one by one or, where its number is odd, five in a message, and
    writes down what was acknowledged.
    """

    def __init__(self, daemon, number, count):
        super().__init__(daemon=True)
        self.endpoint, self.number, self.count, self.acks, self.error = (daemon.endpoint, number,
                                                                         count, {}, None)

    def run(self):
        client = Client(self.endpoint, timeout_s=0.7)
        try:
            together = 5 if self.number % 2 == 1 else 1
            for first in range(0, self.count, together):
                self.submit(client, range(first, min(first + together, self.count)))
        except BaseException as error:
            self.error = error
        finally:
            client.close()

    def submit(self, client, which):
        keys = [f"c{self.number}-{i}" for i in which]
        inputs = [ring_down(samples=16, phase=self.number + i * 1e-3) for i in which]
        jobs = [{"kind": "identify", "options": {"n": [self.number, i]}, "input": described,
                 "key": key} for i, key, (_, described) in zip(which, keys, inputs)]
        body = b"".join(data for data, _ in inputs)
        if len(jobs) == 1:
            reply = patiently(client, "SUBMIT", [body], **jobs[0])
            assert reply.ok, reply
            answers = [reply]
        else:
            answers = [{}]
            # a part may be refused for now
            while not all("job" in answer for answer in answers):
                answers = json.loads(patiently(client, "SUBMITS", [body],
                                               jobs=jobs).body[0])["jobs"]
                refused = {answer["error"]["code"] for answer in answers if "job" not in answer}
                assert refused <= {"busy", "draining", "storage_full"}, answers
                time.sleep(0.05 if refused else 0)
        for key, answer in zip(keys, answers):
            self.acks[key] = answer["job"]


def all_docs(client):
    docs, after = [], None
    while True:
        page = json.loads(patiently(client, "LIST", limit=1000,
                                    **({"after": after} if after else {})).body[0])
        docs += page["jobs"]
        after = page["next"]
        if after is None:
            return docs


def check_everything(client, acks):
    """Each acknowledged key names one job with one result; no key has two jobs; no two edges into
    an end.
    """
    end = time.monotonic() + PATIENCE_S
    while True:
        docs = all_docs(client)
        if all(d["state"] == "done" for d in docs) or time.monotonic() > end:
            break
        time.sleep(0.2)
    by_key = {}
    for doc in docs:
        assert doc["key"] not in by_key, f"two jobs under {doc['key']}"
        by_key[doc["key"]] = doc
    lost = [key for key, job in acks.items() if by_key.get(key, {}).get("job") != job]
    assert not lost, f"{len(lost)} acknowledged jobs are lost, such as {lost[:3]}"
    assert [d for d in docs if d["state"] != "done"] == []
    assert patiently(client, "EVENTS", **{"from": 1}).ok
    ends = {}
    while len(ends) < len(docs):
        event = client.receive()
        if event.verb == "EVENT" and event.get("event") == "state" and event["state"] == "done":
            assert event["job"] not in ends, f"two results of {event['job']}"
            ends[event["job"]] = event["number"]


def test_8_clients_lose_and_double_nothing_while_the_daemon_is_killed_20_times():
    dice = random.Random(20)
    with Daemon(config=FAKE, workers=2) as d:
        submitters = [Submitter(d, n, JOBS // CLIENTS) for n in range(CLIENTS)]
        for s in submitters:
            s.start()
        for _ in range(KILLS):
            time.sleep(dice.uniform(0.05, 0.5))
            d.kill()
            d.start()
        for s in submitters:
            s.join(PATIENCE_S)
            assert s.error is None and not s.is_alive(), s.error
        acks = {key: job for s in submitters for key, job in s.acks.items()}
        assert len(acks) == JOBS // CLIENTS * CLIENTS
        client = d.client()
        check_everything(client, acks)
        for key in random.Random(1).sample(sorted(acks), 50):
            number, i = key[1:].split("-")
            data, described = ring_down(samples=16, phase=int(number) + int(i) * 1e-3)
            again = patiently(client, "SUBMIT", [data], kind="identify",
                              options={"n": [int(number), int(i)]}, input=described, key=key)
            assert again["job"] == acks[key] and again["duplicate"] is True
        print(f"\nP1 P2 P3 P4: {KILLS} kills, {len(acks)} acknowledged jobs, 0 violations")


def end_and_start(d, how):
    """One way in which a daemon's life ends, or goes on."""
    if how == "reload":
        d.process.send_signal(signal.SIGHUP)
        return
    if how == "kill":
        d.kill()
    else:
        d.process.send_signal(signal.SIGTERM)
        if how == "terminate twice":
            time.sleep(0.01)
            d.process.send_signal(signal.SIGTERM)
        assert d.process.wait(PATIENCE_S) == 0, d.text()[-500:]
        d.log.close()
    if how == "terminate while starting":
        d.start(ready=False)
        time.sleep(0.02)
        d.stop()
    d.start()


def test_restarts_of_every_kind_under_load_lose_and_double_nothing():
    """F17, F18: reloads, drains, drains cut short, kills, and ends during the replay, while 4
    clients do nothing but repeat themselves.
    """
    dice, counts = random.Random(17), dict.fromkeys(["reload", "terminate", "terminate twice",
                                                     "kill", "terminate while starting"], 0)
    with Daemon(config=FAKE, workers=2) as d:
        submitters = [Submitter(d, n, 400) for n in range(4)]
        for s in submitters:
            s.start()
        while any(s.is_alive() for s in submitters) or 0 in counts.values():
            how = dice.choice(list(counts))
            end_and_start(d, how)
            counts[how] += 1
            time.sleep(dice.uniform(0.05, 0.4))
        for s in submitters:
            s.join(PATIENCE_S)
            assert s.error is None and not s.is_alive(), s.error
        acks = {key: job for s in submitters for key, job in s.acks.items()}
        check_everything(d.client(), acks)
        print(f"\nP1 P2 P3 P4 P9: {counts}, {len(acks)} acknowledged jobs, 0 violations")


def test_a_thousand_reloads_under_load_end_no_daemon():
    """Its threads read the data folder's path while a reload takes the settings anew."""
    with Daemon(config=FAKE, workers=2) as d:
        submitters = [Submitter(d, n, 200) for n in range(4)]
        for s in submitters:
            s.start()
        for _ in range(1000):
            assert d.process.poll() is None, d.text()[-500:]
            d.process.send_signal(signal.SIGHUP)
            time.sleep(0.0005)
        for s in submitters:
            s.join(PATIENCE_S)
            assert s.error is None and not s.is_alive(), s.error
        assert "level=error" not in d.text()
        check_everything(d.client(), {key: job for s in submitters for key, job in s.acks.items()})


class UntilItDies(Client):
    """Waits for an answer as long as the daemon D lives, and no longer; one that lives and does not
    answer for PATIENCE_S has lost what it was asked.
    """

    def __init__(self, d):
        super().__init__(d.endpoint, timeout_s=0.1)
        self.process = d.process

    def receive(self):
        end = time.monotonic() + PATIENCE_S
        while self.process.poll() is None:
            assert time.monotonic() < end, "the daemon lives and does not answer"
            with contextlib.suppress(zmq.Again):
                return super().receive()
        raise ProcessLookupError


def load(d, acks, uploads):
    """Submissions and one upload, until the daemon dies; what was acknowledged goes to ACKS and
    UPLOADS.
    """
    client = UntilItDies(d)
    try:
        data = bytes(800000)
        begun = client.ask("UPLOAD", op="begin", content="batch", samples=100000, channels=1, dt=1,
                           key="load")
        at = begun["present"]
        first = len(acks)
        for i in range(first, first + 30):
            if begun.ok and at < len(data):
                piece = data[at:at + 65536]
                if client.ask("UPLOAD", [piece], op="chunk", upload=begun["upload"], offset=at,
                              crc32c=crc32c(piece)).ok:
                    at += len(piece)
                    uploads["present"] = at
            reply = submit(client, key=f"s{i}", phase=i * 1e-3)
            if reply.ok:
                acks[f"s{i}"] = reply["job"]
    except (ProcessLookupError, KeyError):
        pass
    finally:
        client.close()


@needs_strace
@pytest.mark.parametrize("call", ["write", "pwrite64", "fdatasync", "fsync", "rename", "ftruncate"])
def test_a_kill_at_the_nth_call_loses_nothing_acknowledged(call, tmp_path):
    points = int(os.environ.get("MODALD_KILL_POINTS", 6))
    acks, uploads, killed = {}, {"present": 0}, 0
    for n in [1 + (i * (i + 1)) // 2 * 2 for i in range(points)]:
        wrap = ["strace", "-f", "-qq", "-o", "/dev/null", "-e", f"trace={call}", "-e",
                f"inject={call}:signal=SIGKILL:when={n}"]
        try:
            d = Daemon(folder=tmp_path, config=FAKE, workers=1, wrap=wrap)
        except RuntimeError:
            # at the start: nothing was acknowledged in this life
            killed += 1
            continue
        load(d, acks, uploads)
        killed += d.process.poll() is not None
        d.__exit__()
    with Daemon(folder=tmp_path, config=FAKE, workers=2) as d:
        c = d.client()
        present = c.ask("UPLOAD", op="begin", content="batch", samples=100000, channels=1, dt=1,
                        key="load")
        assert present.ok and present["present"] >= uploads["present"]
        for key, job in acks.items():
            done = c.ask("WAIT", job=f"key:{key}", timeout_s=250)
            assert done.ok and done["job"] == job and done["state"] == "done", (key, job, done)
    print(f"\nP1 P5: {call}: {killed} kills, {len(acks)} jobs and {uploads['present']} bytes "
          "acknowledged, 0 violations")


@needs_strace
@pytest.mark.parametrize("call", ["fdatasync", "fsync"])
def test_a_failed_sync_ends_the_daemon_and_acknowledges_nothing_more(call, tmp_path):
    """P7: EIO from the n-th sync; every acknowledgement before it holds after the restart."""
    ended, acks = 0, {}
    for n in (3, 9):
        wrap = ["strace", "-f", "-qq", "-o", "/dev/null", "-e", f"trace={call}", "-e",
                f"inject={call}:error=EIO:when={n}+"]
        try:
            d = Daemon(folder=tmp_path, config=FAKE, workers=1, wrap=wrap)
        except RuntimeError:
            ended += 1
            continue
        load(d, acks, {"present": 0})
        try:
            status = d.process.wait(PATIENCE_S if call == "fdatasync" else 10)
            ended += 1
            assert status != 0
            assert "event=storage" in d.text()
        except subprocess.TimeoutExpired:
            pass                                     # this call is not used so often
        d.__exit__()
    with Daemon(folder=tmp_path, config=FAKE, workers=2) as d:
        c = d.client()
        for key, job in acks.items():
            assert c.ask("WAIT", job=f"key:{key}", timeout_s=250)["job"] == job
    if call == "fdatasync" or ended:
        assert ended > 0, "no sync was ever reached"
    print(f"\nP7: {call}: {ended} failing syncs, {len(acks)} acknowledged jobs, 0 violations")


def test_a_full_disk_refuses_submits_and_recovers_without_a_hand():
    """P8: the reserve of 16 MiB is inside the 40 MiB; documents of 200 kB fill the rest."""
    with small_disk("size=40m") as disk, Daemon(folder=disk, config=FAKE, workers=2) as d:
        c = d.client()
        acks, full = {}, 0
        for i in range(400):
            reply = submit(c, key=f"f{i}", options={"document": 200000}, phase=i * 1e-3)
            if reply.code == "storage_full":
                assert reply["error"]["detail"]["retry_after_s"] > 0
                full += 1
                break
            assert reply.ok, reply
            acks[f"f{i}"] = reply["job"]
            done = c.ask("WAIT", job=reply["job"], timeout_s=250)
            assert done["state"] == "done" or done["error"]["code"] == "storage_full", done
            full += done["state"] == "failed"
            if full >= 3:
                break
        assert full, "the disk never filled"
        assert c.ask("STATUS", job="key:f0").ok and c.ask("RESULT", job="key:f0", length=100).ok
        for key in list(acks)[: len(acks) // 2]:
            assert c.ask("DELETE", job=f"key:{key}").ok
        until(lambda: submit(c, key="after", options={"say": "again"}).ok)
        assert c.ask("WAIT", job="key:after", timeout_s=250)["state"] == "done"
        d.kill()
        d.start()                                # what is left is whole
        c = d.client()
        assert c.ask("RESULT", job=f"key:{list(acks)[len(acks) // 2]}", length=10).ok
        print(f"\nP8: full after {len(acks)} jobs, 0 violations")


def test_deletes_pass_on_a_full_disk_however_many_results_were_tried_there():
    """P8: submissions and results may use up the reserve but for its last part, which is for
    deletes and edges.
    """
    with small_disk("size=40m") as disk, Daemon(folder=disk, config=FAKE, workers=2) as d:
        c = d.client()
        done, refused = [], 0
        for i in range(450):
            reply = submit(c, key=f"m{i}", options={"document": 200000 if i % 3 else 20000},
                           phase=i * 1e-3)
            if reply.code == "storage_full":
                refused += 1
                time.sleep(0.02)
            elif c.ask("WAIT", job=reply["job"], timeout_s=250)["state"] == "done":
                done.append(f"m{i}")
        assert refused > 50, "the disk never filled"
        for key in done[: len(done) // 2]:
            assert c.ask("DELETE", job=f"key:{key}").ok
        until(lambda: submit(c, key="after", options={"say": "again"}).ok)


def rss_mb(pid):
    with open(f"/proc/{pid}/status") as f:
        return next(int(line.split()[1]) for line in f if line.startswith("VmRSS")) / 1024


def test_10_clients_uploading_at_once_keep_the_daemon_under_200_mb():
    """Each sends MODALD_UPLOAD_MB (64; nightly 1000) as fast as credit allows."""
    size = int(os.environ.get("MODALD_UPLOAD_MB", 64)) << 20
    piece = bytes(262144)
    crc = crc32c(piece)
    peak, errors = [0.0], []

    def feed(d, n):
        c = Client(d.endpoint)
        try:
            begun = c.ask("UPLOAD", op="begin", content="batch", samples=size // 8, channels=1,
                          dt=1, key=f"u{n}")
            credit, at, acked, waiting = begun["credit"], 0, 0, []
            while acked < size:
                while at < size and (not waiting or at - acked + len(piece) <= credit):
                    waiting.append(c.send("UPLOAD", [piece], op="chunk", upload=begun["upload"],
                                          offset=at, crc32c=crc))
                    at += len(piece)
                reply = c.answer(waiting.pop(0))
                assert reply.ok, reply
                acked, credit = reply["present"], reply["credit"]
            assert c.ask("UPLOAD", op="abort", upload=begun["upload"]).ok
        except BaseException as error:
            errors.append(error)
        finally:
            c.close()

    with Daemon(config=FAKE, workers=1) as d:
        threads = [threading.Thread(target=feed, args=(d, n), daemon=True) for n in range(10)]
        for t in threads:
            t.start()
        while any(t.is_alive() for t in threads):
            peak[0] = max(peak[0], rss_mb(d.pid))
            time.sleep(0.05)
        assert not errors, errors[0]
        print(f"\nP6: 10 uploads of {size >> 20} MB at once: RSS at most {peak[0]:.0f} MB")
        assert peak[0] < 200
