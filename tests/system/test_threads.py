"""One Python Client in many threads: each gets its own answers, whoever else asks, gives up, fails,
forks or closes.
"""
import os
import signal
import subprocess
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import zmq

import modald
from conftest import PATIENCE, environment

THREADS, JOBS = 8, 100


def decay(k):
    t = np.arange(64) * 0.01
    return np.exp(-0.5 * t) * np.cos(2 * np.pi * (5 + 0.01 * k) * t)


def numbers_of_threads():
    return sum(t.name == "modald" for t in threading.enumerate())


def test_eight_threads_of_a_client_run_a_hundred_jobs_each(client):
    """The frequency of each tells whose it is."""
    def one(k):
        mode = client.identify(decay(k), 0.01, options={"rank.fixed": 2}, key=f"threads-{k}",
                               timeout=PATIENCE)["modes"][0]
        return mode["frequency_hz"]
    with ThreadPoolExecutor(THREADS) as pool:
        found = list(pool.map(one, range(THREADS * JOBS)))
    assert np.allclose(found,
                       [np.hypot(5 + 0.01 * k, 0.5 / (2 * np.pi)) for k in range(THREADS * JOBS)],
                       rtol=1e-6)


def test_uploads_lists_events_and_waits_of_other_threads_do_not_meet(client):
    large = np.random.default_rng(3).standard_normal((40000, 2))

    def upload(k):
        return client.upload(modald.Batch(large + k, 0.01),
                             timeout=PATIENCE) == modald.Batch(large + k, 0.01).sha256()

    def events(k):
        return len([client.submit("identify", modald.Batch(decay(k), 0.01), key=f"met-{k}")
                    for _ in range(3)]) == 3

    def listing(k):
        return all(job["state"] in ("queued", "running", "done", "failed")
                   for job in client.list(limit=50))

    def many(k):
        jobs = client.submit_many([("identify", modald.Batch(decay(i), 0.01), None,
                                    f"many-{k}-{i}") for i in range(50)], timeout=PATIENCE)
        return [job.document["key"] for job in jobs] == [f"many-{k}-{i}" for i in range(50)]
    with ThreadPoolExecutor(THREADS) as pool:
        assert all([f.result(PATIENCE) for k in range(4)
                    for f in [pool.submit(what, k) for what in (upload, events, listing, many)]])


def test_an_error_is_raised_where_it_was_asked_for_and_nowhere_else(client):
    def bad(k):
        with pytest.raises(modald.Error) as why:
            client.status(f"key:none-{k}")
        return f"none-{k}" in str(why.value) or why.value.code == "not_found"

    def good(k):
        return client.whoami()["role"] == "admin" or True
    with ThreadPoolExecutor(THREADS) as pool:
        assert all(pool.map(lambda k: (bad if k % 2 else good)(k), range(200)))


LIES = {
    "nested": [b"REPLY", b'{"id":1,"a":' + b"[" * 30000 + b"]" * 30000 + b"}"],
    "list": [b"REPLY", b"[]"],
    "number": [b"ERROR", b"7"],
    "null": [b"REPLY", b"null"],
    "listed id": [b"EVENT", b'{"id":[1]}'],
    "true id": [b"REPLY", b'{"id":true}'],
    "digits": [b"REPLY", b'{"id":' + b"9" * 5000 + b"}"],
    "kind": [b"\xff\xfe", b'{"id":1}'],
}
ERRORS = {
    "no error": [b"ERROR", b'{"id":1,"error":[]}'],
    "no document": [b"REPLY", b'{"id":1}', b"\xff"],
    "nested document": [b"REPLY", b'{"id":1}', b"[" * 30000],
}


@pytest.mark.parametrize("lie", [*LIES, *ERRORS])
def test_a_lie_of_the_server_ends_neither_the_client_nor_another_request(lie):
    """What is no answer is passed over; what is one and says nothing is an error of ours."""
    server = zmq.Context.instance().socket(zmq.ROUTER)
    server.linger, server.rcvtimeo = 0, PATIENCE * 1000
    port = server.bind_to_random_port("tcp://127.0.0.1")

    def serve():
        for number in (1, 2):
            who = server.recv_multipart()[0]
            if number == 1:
                server.send_multipart([who, b"MODALD1", *(LIES | ERRORS)[lie]])
            server.send_multipart([who, b"MODALD1", b"REPLY", b'{"id":%d,"true":1}' % number])

    thread = threading.Thread(target=serve)
    thread.start()
    client = modald.connect(f"tcp://127.0.0.1:{port}")
    if lie in ERRORS:
        with pytest.raises(modald.Error) as failed:
            client.stats()
        assert failed.value.code == "bad_frame"
    else:
        assert client.stats()["true"] == 1
    assert client.stats()["true"] == 1
    client.close()
    thread.join()
    server.close()


def test_who_waits_when_the_client_is_closed_is_told_so(daemon):
    c, said = daemon.client(), []
    held = daemon.client()
    job = held.submit("identify", modald.Batch(decay(1), 0.01), not_before=time.time() + 3600,
                      fresh=True, key="closed-wait")
    started = threading.Barrier(THREADS + 1)

    def hold():
        started.wait()
        try:
            c.wait(job.id)
            said.append("done")
        except modald.Error as why:
            said.append(why.message)
    threads = [threading.Thread(target=hold) for _ in range(THREADS)]
    for t in threads:
        t.start()
    started.wait()
    end = time.monotonic() + PATIENCE
    while len(c._link._asking) < THREADS:                    # all of them wait now
        assert time.monotonic() < end and not said, said
        time.sleep(0.001)
    c.close()
    for t in threads:
        t.join(PATIENCE)
    assert said == [f"{daemon.endpoint}: the client was closed"] * THREADS
    with pytest.raises(modald.Error, match="closed"):
        c.whoami()
    c.close()
    held.cancel(job.id)
    held.close()


def test_a_client_closes_though_its_thread_is_gone_before_it_is_rung_for(daemon):
    c = daemon.client()
    ring = c._link._ring

    def late():
        ring()
        c._link._thread.join()
        ring()
    c._link._ring = late
    c.close()
    with pytest.raises(modald.Error, match="closed"):
        c.whoami()


def test_a_client_that_nobody_holds_takes_its_thread_with_it(daemon):
    before = numbers_of_threads()
    for _ in range(20):
        daemon.client().whoami()
    end = time.monotonic() + PATIENCE
    while numbers_of_threads() > before:
        assert time.monotonic() < end
        time.sleep(0.01)


def test_a_timeout_of_one_leaves_the_others_and_the_client_as_they_were(client):
    job = client.submit("identify", modald.Batch(decay(2), 0.01), not_before=time.time() + 3600,
                        fresh=True, key="one-times-out")
    for _ in range(20):
        with pytest.raises(modald.Error, match="timeout"):
            client.wait(job.id, timeout=0.01)
    assert client._link._asking == {} and client.whoami()
    client.cancel(job.id)


def script(text, *words, **more):
    code = ("import os, signal, sys, threading, time\nimport modald\nc = "
            "modald.connect(sys.argv[1], timeout=300)\n" + text)
    import pathlib
    return subprocess.Popen(["/usr/bin/python3", "-c", code, *words], stdout=subprocess.PIPE,
                            stderr=subprocess.PIPE, text=True,
                            env=environment(PYTHONPATH=pathlib.Path(modald.__file__).parents[1]),
                            **more)


def test_a_child_is_told_that_it_needs_a_client_of_its_own(daemon):
    run = script("""
c.whoami()
child = os.fork()
if child == 0:
    try:
        c.whoami()
    except modald.Error as why:
        print(why.field, why.message, flush=True)
    with modald.connect(sys.argv[1]) as mine:
        print(sorted(mine.whoami())[0], flush=True)
    c.close()
    sys.exit(0)
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), sorted(c.whoami())[0], flush=True)
""", daemon.endpoint)
    out, err = run.communicate(timeout=PATIENCE)
    first, second, third = out.splitlines()
    assert (first == "client this client was made before a fork; a child makes its own"
            and third == f"0 {second}"), err
    assert run.returncode == 0 and err == ""


def test_a_child_that_looks_at_a_job_as_a_future_is_told_so_too(daemon):
    """The thread that watches jobs stayed with the parent: the child waited for ever."""
    run = script("""
job = c.submit("identify", modald.Batch([1.0, 2.0, 1.0] * 20, 0.01), key="forked",
               not_before=time.time() + 3600, fresh=True)
job.add_done_callback(lambda job: None)
child = os.fork()
if child == 0:
    told = threading.Event()
    job.add_done_callback(lambda job: told.set())
    print(told.wait(500), flush=True)
    os._exit(0)
os.waitpid(child, 0)
job.cancel()
""", daemon.endpoint)
    assert run.communicate(timeout=PATIENCE)[0] == "True\n"


def test_a_child_waits_for_no_lock_that_a_thread_of_its_parent_held(daemon):
    run = script("""
job = c.submit("identify", modald.Batch([1.0, 2.0, 1.0] * 20, 0.01), key="locked",
               not_before=time.time() + 3600, fresh=True)
job.add_done_callback(lambda job: None)
kinds = type(threading.Lock()), threading.Condition
locks = {id(one): one for of in (job, modald.jobs.watch_of(c), modald.jobs)
         for one in vars(of).values() if isinstance(one, kinds)}
held, forked = threading.Event(), threading.Event()
def hold():
    for lock in locks.values():
        lock.acquire()
    held.set()
    forked.wait()
    for lock in locks.values():
        lock.release()
thread = threading.Thread(target=hold)
thread.start()
held.wait()
child = os.fork()
if child == 0:
    signal.alarm(500)
    told = threading.Event()
    job.add_done_callback(lambda job: told.set())
    print(len(locks) > 1, told.wait(), flush=True)
    os._exit(0)
forked.set()
thread.join()
os.waitpid(child, 0)
job.cancel()
""", daemon.endpoint)
    assert run.communicate(timeout=PATIENCE)[0] == "True True\n"


def test_an_interrupt_ends_the_wait_and_not_the_client(daemon):
    run = script("""
job = c.submit("identify", modald.Batch([1.0, 2.0, 1.0] * 20, 0.01), key="interrupted",
               not_before=time.time() + 3600, fresh=True)
try:
    print("waits", flush=True)
    job.wait()
except KeyboardInterrupt:
    print(c.status(job.id)["state"], c.cancel(job.id)["state"], flush=True)
""", daemon.endpoint)
    assert run.stdout.readline() == "waits\n"
    time.sleep(0.2)
    run.send_signal(signal.SIGINT)
    out, err = run.communicate(timeout=PATIENCE)
    assert out.split()[1] == "cancelled" and run.returncode == 0, err


def test_an_interpreter_that_ends_with_clients_open_ends(daemon):
    run = script("c.whoami()\nthreading.Thread(target=lambda: c.whoami()).start()\nd = "
                 "modald.connect(sys.argv[1])\n", daemon.endpoint)
    out, err = run.communicate(timeout=PATIENCE)
    assert (out, err, run.returncode) == ("", "", 0)


def test_threads_go_on_over_restarts_of_the_daemon(own_daemon):
    """Every keyed job is accepted once, whenever the connection was lost."""
    daemon = own_daemon(workers=1)
    ready = threading.Event()
    with daemon.client() as c, ThreadPoolExecutor(THREADS) as pool:
        def one(k):
            if k == 40:
                ready.set()
            return c.submit("identify", modald.Batch(decay(k), 0.01), key=f"restart-{k}",
                            timeout=PATIENCE).id
        jobs = [pool.submit(one, k) for k in range(THREADS * 30)]
        ready.wait(PATIENCE)
        daemon.kill()
        daemon.start()
        ids = [job.result(PATIENCE) for job in jobs]
        assert len(set(ids)) == len(ids) == len(list(c.list(limit=1000)))
