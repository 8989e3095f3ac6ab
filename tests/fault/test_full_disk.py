"""P8 (PROTOCOL.md, section 6) with a stream and an upload open: the disk fills under them, and is
made free again.
"""
import contextlib
import os
import pathlib
import re
import subprocess
import sys
import threading
import time

import pytest
import zmq

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "system"))
from lab import Lab  # noqa: E402
from small_disk import small_disk  # noqa: E402
from wire import BUILD, Daemon, crc32c, identity, submit, until  # noqa: E402

FAKE = f"worker_path = {HERE.parent / 'system' / 'fake_worker.py'}\n"
LOOP = BUILD / "examples" / "example_loop"
STEPS, DT, PATIENCE = 20000, 1e-3, 600
PIECE = bytes(range(256)) * 1024


@contextlib.contextmanager
def ballast(folder):
    """Another program's file that has every free block, until it is removed."""
    path = pathlib.Path(folder, "ballast")
    with open(path, "wb", buffering=0) as file, contextlib.suppress(OSError):
        while file.write(bytes(65536)) > 0:
            pass
    try:
        yield
    finally:
        path.unlink()


@contextlib.contextmanager
def greed(folder):
    """Another program that takes every block as soon as it is free, until it is ended."""
    path = pathlib.Path(folder, "greed")
    over = threading.Event()

    def take():
        with open(path, "wb", buffering=0) as file:
            while not over.is_set():
                try:
                    file.write(bytes(65536))
                except OSError:
                    time.sleep(1e-4)

    taker = threading.Thread(target=take)
    taker.start()
    try:
        yield
    finally:
        over.set()
        taker.join()
        path.unlink()


def chunk(client, upload, at):
    return client.ask("UPLOAD", [PIECE], op="chunk", upload=upload, offset=at, crc32c=crc32c(PIECE))


def push(client, stream, first, count=2048):
    body = bytes(16) * count
    return client.ask("STREAM", [body], op="push", stream=stream, epoch=0, first=first,
                      count=count, crc32c=crc32c(body))


def host_env(daemon, folder):
    kept = {k: v for k, v in os.environ.items() if not k.startswith("MODALD_")}
    return {**kept, "MODALD_URL": daemon.endpoint, "MODALD_SPILL": str(folder),
            "MODALD_CLOSE_WAIT": "120"}


def test_a_stream_and_an_upload_outlive_a_full_disk(tmp_path):
    """The host prints and ends as without a daemon; the record is its log; the upload goes on where
    it was.
    """
    plain = subprocess.run([str(LOOP), "host", str(STEPS), "2"], capture_output=True, check=True,
                           env={"PATH": os.environ["PATH"]}).stdout
    size = 16 * len(PIECE)
    with small_disk("size=48m") as disk, Daemon(folder=disk, config=FAKE, workers=1) as d:
        c = d.client()
        kept = submit(c, key="kept")
        assert c.ask("WAIT", job=kept["job"], timeout_s=250)["state"] == "done"
        upload = c.ask("UPLOAD", op="begin", content="batch", samples=size // 8, channels=1,
                       dt=1.0)["upload"]
        assert chunk(c, upload, 0)["present"] == len(PIECE)
        mine = c.ask("STREAM", op="open", name="mine", channels=2, dt=DT)["stream"]
        host = subprocess.Popen([str(LOOP), "host", str(STEPS), "2", "0.0002"],
                                stdout=subprocess.PIPE, env=host_env(d, tmp_path))
        with contextlib.ExitStack() as stack:
            stack.callback(host.kill)
            until(lambda: c.ask("STREAM", op="open", name="host", channels=2, dt=DT)["next"] > 0,
                  "the host pushed nothing")
            sent, at, refused_since = 0, len(PIECE), None
            with ballast(disk):
                until(lambda: submit(c, options={"n": time.monotonic()}).code == "storage_full",
                      "the disk never filled")
                # then the reserve is used up but for its last part
                while refused_since is None or time.monotonic() < refused_since + 3:
                    reply = push(c, mine, sent)
                    if reply.ok:
                        sent += 2048
                        refused_since = None
                        assert reply["next"] == sent
                        continue
                    assert (reply.code == "storage_full"
                            and reply["error"]["detail"]["retry_after_s"] > 0), reply
                    refused_since = refused_since or time.monotonic()
                    assert (push(c, mine, sent + 2048).code
                            == "storage_full"), "behind refused samples none is taken"
                    assert c.ask("STREAM", op="close", stream=mine).code == "storage_full"
                    time.sleep(0.1)
                    assert sent < 40 << 16, "pushes go on on a full disk"
                reply = chunk(c, upload, at)
                assert reply.ok or reply.code == "storage_full", reply
                at += len(PIECE) if reply.ok else 0
                assert c.ask("RESULT", job=kept["job"]).ok
                assert c.ask("DELETE", job=kept["job"]).ok, "what makes room passes"
                time.sleep(1)
            until(lambda: push(c, mine, sent).ok, "the stream did not go on")
            sent += 2048
            while at < size:
                until(lambda at=at: chunk(c, upload, at).ok, "the upload did not go on")
                at += len(PIECE)
            out = host.communicate(timeout=PATIENCE)[0]
        assert (host.returncode, out) == (0, plain)
        whole = PIECE * 16
        assert (c.ask("UPLOAD", op="seal", upload=upload,
                      sha256=identity(size // 8, 1, 1.0, whole))["state"] == "sealed")
        closed = c.ask("STREAM", op="close", stream=mine)
        assert ((closed["samples"], closed["gaps"], closed["sha256"])
                == (sent, [], identity(sent, 2, DT, bytes(16 * sent))))
        host_sha = identity(STEPS, 2, DT, plain)
        until(lambda: c.ask("SUBMIT", kind="identify", input={"sha256": host_sha}).ok,
              "the host's record is not its log")
        assert submit(c, key="after").ok
        assert d.stop() == 0
    print(f"\nP8: a stream and an upload over a full disk: {sent} samples and {size} bytes, all "
          "there")


def gauge(client):
    return re.search(r"^modald_storage_full ([01])$", client.ask("METRICS").body[0].decode(),
                     re.M)[1] == "1"


def told_full(client):
    """By STATS, which the gauge before or after it agrees with: the edge may lie between."""
    before, stats, after = gauge(client), client.ask("STATS")["storage_full"], gauge(client)
    assert stats in (before, after)
    return stats


def edges(daemon):
    return [line.split("event=")[1].split()[0] for line in daemon.text().splitlines()
            if "event=storage_" in line]


def begin(client, size):
    return client.ask("UPLOAD", op="begin", content="batch", samples=size // 8, channels=1, dt=1.0)


def test_the_gauge_and_the_log_say_that_uploads_are_refused_for_want_of_disk_and_that_it_is_over():
    """Disk that uploads have filled; the file's owner takes it away, and nobody needs to ask for
    anything.
    """
    with small_disk("size=40m") as disk, Daemon(folder=disk, config=FAKE, workers=0) as d:
        c = d.client()
        assert not told_full(c) and edges(d) == []
        with ballast(disk):
            for _ in range(50):
                reply = begin(c, 4 << 20)
                assert (reply.code == "storage_full"
                        and reply["error"]["detail"]["retry_after_s"] > 0), reply
                assert (reply["error"]["message"]
                        == "the disk is full: there is no room for 4194304 bytes")
                assert told_full(c)
            assert edges(d) == ["storage_full"], "one line at the edge, however many are refused"
        until(lambda: not told_full(c), "the gauge stays")
        assert edges(d) == ["storage_full", "storage_room"] and begin(c, 4 << 20).ok


def test_the_gauge_is_1_while_the_ledger_refuses_submissions():
    with small_disk("size=40m") as disk, Daemon(folder=disk, config=FAKE, workers=0) as d:
        c, n = d.client(), 0
        with ballast(disk):
            while n < 40000 and (reply := submit(c, options={"n": n})).ok:
                n += 1
            assert reply.code == "storage_full" and told_full(c) and edges(d)[-1] == "storage_full"
            assert str(disk) not in reply["error"]["message"]
        until(lambda: not told_full(c), "the gauge stays")
        assert edges(d)[-1] == "storage_room" and len(edges(d)) <= 8
        until(lambda: submit(c, options={"n": -1}).ok, "submissions are refused")


def test_cancels_pass_on_a_full_disk_while_uploads_ask_for_every_block_of_it():
    """Uploads may have what the reserve gives up first, and nothing of its last part, else cancels
    wait for room.
    """
    size = 1 << 18
    with small_disk("size=40m") as disk, Daemon(folder=disk, config=FAKE, workers=0) as d:
        c, waiting = d.client(), []
        asked = [c.send("SUBMIT", [bytes(800)], kind="identify", options={"n": n},
                        input={"content": "batch", "samples": 100, "channels": 1, "dt": 1.0})
                 for n in range(600)]
        jobs = [c.answer(number)["job"] for number in asked]
        with ballast(disk):
            until(lambda: submit(c, options={"n": -1}).code == "storage_full",
                  "the disk never filled")
            refused = 0
            # the reserve's first part is given up, and uploads have it
            while refused < 50:
                refused += begin(c, size).code == "storage_full"
            for job in jobs:
                cancel = c.send("CANCEL", job=job)
                uploads = [c.send("UPLOAD", op="begin", content="batch", samples=size // 16,
                                  channels=1, dt=1.0) for _ in range(5)]
                assert c.answer(cancel)["state"] == "cancelled"
                waiting += uploads
            codes = {c.answer(number).code for number in waiting}
            assert "storage_full" in codes, codes


def reserve_all(client, size):
    """Uploads of SIZE bytes, begun until one is refused; the others, and the refusal."""
    begun = []
    while (reply := begin(client, size)).ok:
        begun.append(reply["upload"])
    return begun, reply


@pytest.mark.skipif(not zmq.has("curve"), reason="this pyzmq has no CURVE")
def test_open_uploads_of_one_user_leave_others_half_of_the_room_and_count_until_they_are_filled():
    """Of 128 MiB some 110 are free: by 8 MiB one user has six, the next half of the other half.
    Another's cancels and deletes pass, what is filled, aborted or whole counts no more.
    """
    size = 8 << 20
    with small_disk("size=128m") as disk:
        lab = Lab(pathlib.Path(disk), {"ann": "ann submit", "ben": "ben submit"}, workers=0)
        with lab.daemon as d:
            ann, ben = lab.client("ann"), lab.client("ben")
            job = submit(ben)["job"]
            begun, refusal = reserve_all(ann, size)
            assert 5 <= len(begun) <= 6 and refusal.code == "storage_full"
            said = refusal["error"]["message"]
            most = int(re.search(r"accepted: at most (\d+) for now", said)[1])
            assert refusal["error"]["detail"]["retry_after_s"] > 0 and most < size
            assert not told_full(ben), "the disk is not full"
            if most >= 1 << 20:
                assert begin(ann, most - (1 << 20)).ok, "what is said to be accepted is"
            others, _ = reserve_all(ben, size)
            assert 2 <= len(others) <= 3
            assert ben.ask("CANCEL", job=job)["state"] == "cancelled"
            assert ben.ask("DELETE", job=job).ok
            assert ann.ask("UPLOAD", op="abort", upload=begun.pop())["state"] == "gone"
            # its file goes after the answer
            until(lambda: begin(ben, size).ok or begin(ann, size).ok, "what goes is free again")
            at = 0
            while at < size:
                assert chunk(ann, begun[0], at).ok, "what was begun has its room"
                at += len(PIECE)


@pytest.mark.skipif(not zmq.has("curve"), reason="this pyzmq has no CURVE")
def test_what_open_uploads_have_taken_counts_over_a_restart():
    size = 8 << 20
    with small_disk("size=128m") as disk:
        lab = Lab(pathlib.Path(disk), {"ann": "ann submit", "ben": "ben submit"}, workers=0)
        with lab.daemon as d:
            begun, _ = reserve_all(lab.client("ann"), size)
            d.kill()
            d.start()
            assert begin(lab.client("ann"), size).code == "storage_full"
            assert begin(lab.client("ben"), size).ok
            assert chunk(lab.client("ann"), begun[0], 0).ok


def test_without_keys_an_upload_may_have_more_than_half_of_the_room():
    with small_disk("size=128m") as disk, Daemon(folder=disk, config=FAKE, workers=0) as d:
        assert begin(d.client(), 80 << 20).ok


def test_an_input_larger_than_a_disk_with_room_is_refused_without_an_alarm():
    with small_disk("size=64m") as disk, Daemon(folder=disk, config=FAKE, workers=0) as d:
        c = d.client()
        assert (begin(c, 1 << 30).code == "storage_full" and not told_full(c) and edges(d) == []
                and begin(c, 1 << 20).ok)


def test_who_cancels_on_a_disk_without_any_room_is_told_so_and_room_mends_it():
    """Another program takes what the daemon's reserve gives up, and nothing is left for what must
    pass: CANCEL and DELETE are answered all the same, and are stored when there is room.
    """
    with small_disk("size=48m") as disk, Daemon(folder=disk, config=FAKE, workers=0) as d:
        c = d.client(timeout_s=60)
        jobs = [submit(c, key=f"k{k}")["job"] for k in range(3000)]
        ended = jobs.pop()
        assert c.ask("CANCEL", job=ended)["state"] == "cancelled"
        with greed(disk):
            for job in jobs:
                reply = c.ask("CANCEL", job=job)
                if reply.code == "storage_full":
                    break
                assert reply["state"] == "cancelled", reply
            assert reply.code == "storage_full" and "not stored yet" in reply["error"]["message"]
            assert c.ask("CANCEL", job=job).code == "storage_full", "asked again"
            assert c.ask("CANCEL", job=jobs[-1]).code == "storage_full", "another"
            assert c.ask("DELETE", job=ended).code == "storage_full"
            assert c.ask("STATUS", job=job)["state"] == "queued", "as it is stored"
            assert c.ask("WAIT", job=job, timeout_s=0.1)["state"] == "queued"
            assert c.ask("STATS").ok and told_full(c)
        until(lambda: c.ask("STATUS", job=job)["state"] == "cancelled", "room mends nothing")
        assert c.ask("CANCEL", job=jobs[-1])["state"] == "cancelled"
        until(lambda: c.ask("STATUS", job=ended).code == "not_found")
        until(lambda: submit(c, key="after").ok, "the daemon did not recover")
        until(lambda: not told_full(c))
        c.close()
        d.kill()
        d.start()
        c = d.client()
        assert c.ask("STATUS", job=job)["state"] == "cancelled"
        assert c.ask("STATUS", job=jobs[-1])["state"] == "cancelled"
        assert c.ask("STATUS", job=ended).code == "not_found"
