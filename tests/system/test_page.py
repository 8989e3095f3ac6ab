"""modald-web: what a browser is given, what it is refused, and the page in a real one."""
# Tests as well: places.c
import base64
import concurrent.futures
import contextlib
import hashlib
import http.client
import json
import os
import pathlib
import random
import re
import resource
import signal
import socket
import subprocess
import threading
import time
import xml.etree.ElementTree

import numpy as np
import pytest
import zmq

import browser
import modald
import sanitized
from conftest import BUILD, TOP, decay, environment
from lab import FAKE, Lab
from wire import PATIENCE_S, Client, crc32c, until

PROGRAM = BUILD / "bin" / "modald-web"
pytestmark = pytest.mark.skipif(not PROGRAM.exists(),
                                reason="modald-web is not built: no libmicrohttpd")
LONG = bool(os.environ.get("MODALD_LONG"))
SCRIPT = "<script>document.title='taken'</script>\"'&"
BATCH = modald.Batch(decay(), 0.05)


class Page:
    """A modald-web of one test's own."""

    def __init__(self, folder, endpoint, *words, env=None):
        self.log = folder / f"web-{time.monotonic_ns()}"
        with open(self.log, "w", encoding="utf-8") as log:
            self.process = subprocess.Popen(
                [str(PROGRAM), "--bind", "127.0.0.1:0", "--server", endpoint, *map(str, words)],
                stderr=log, env=environment(**(env or {})))
        until(lambda: "event=listening" in self.said() or self.process.poll() is not None)
        found = re.search(r"at=http://127.0.0.1:(\d+)/", self.said())
        assert found, self.said()
        self.port = int(found[1])

    def said(self):
        return self.log.read_text()

    def ready(self):
        until(lambda: self.get("/").status != 503, "the page does not find its daemon")
        return self

    def ask(self, method, path, headers=None, body=None, whole=True):
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE_S)
        connection.request(method, path, body=body, headers=headers or {})
        answer = connection.getresponse()
        if whole:
            answer.text = answer.read().decode()
            connection.close()
        return answer

    def get(self, path, **headers):
        return self.ask("GET", path, headers)

    def events(self, path="/events", last=None):
        """Read on: (id or None, type, data) of each."""
        answer = self.ask("GET", path, {} if last is None else {"Last-Event-ID": str(last)},
                          whole=False)
        assert answer.status == 200, answer.read()
        assert answer.readline() == b"retry: 1000\n"
        return self.read_on(answer)

    @staticmethod
    def read_on(answer):
        number, kind = None, "message"
        while True:
            line = answer.readline().decode().rstrip("\n")
            if line.startswith("id: "):
                number = int(line[4:])
            elif line.startswith("event: "):
                kind = line[7:]
            elif line.startswith("data: "):
                yield number, kind, line[6:]
                number, kind = None, "message"

    def raw(self, data):
        """What comes for these bytes, until it hangs up or is silent for a while."""
        with socket.create_connection(("127.0.0.1", self.port), timeout=PATIENCE_S) as s:
            with contextlib.suppress(OSError):                 # it may have hung up already
                s.sendall(data)
                s.shutdown(socket.SHUT_WR)
            got = b""
            with contextlib.suppress(OSError):
                while more := s.recv(65536):
                    got += more
            return got

    def memory_kb(self):
        status = pathlib.Path(f"/proc/{self.process.pid}/status").read_text()
        return int(re.search(r"VmRSS:\s+(\d+)", status)[1])

    def close(self):
        self.process.send_signal(signal.SIGTERM)
        status = self.process.wait(PATIENCE_S)
        sanitized.hear(self.said())
        assert status == 0, (status, self.said())


@pytest.fixture(scope="module")
def page(daemon, tmp_path_factory):
    made = Page(tmp_path_factory.mktemp("page"), daemon.endpoint).ready()
    yield made
    made.close()


@pytest.fixture
def own_page(tmp_path):
    made = []

    def make(endpoint, *words, **more):
        made.append(Page(tmp_path, endpoint, *words, **more))
        return made[-1]
    yield make
    for one in made:
        one.close()


@pytest.fixture(scope="module")
def job(daemon):
    """A done job whose key is a script."""
    with daemon.client() as client:
        made = client.submit("identify", BATCH, key=SCRIPT)
        made.result()
        return made.id


class Stream:
    """A stream of two modes; `tell(n)`: n windows more, each once the one before was told."""

    WINDOW, HOP = 400, 100

    def __init__(self, daemon, name):
        self.client, self.ear = Client(daemon.endpoint), Client(daemon.endpoint)
        assert self.ear.ask("EVENTS", stream=name, kinds=["modes"]).ok
        opened = self.client.ask("STREAM", op="open", name=name, channels=2, dt=0.05,
                                 window={"samples": self.WINDOW, "hop": self.HOP})
        assert opened.ok, opened
        self.id, self.epoch, self.sent = opened["stream"], opened["epoch"], 0
        self.signals = decay(4000) + 1e-4 * np.random.default_rng(1).standard_normal((4000, 2))

    def tell(self, windows):
        for _ in range(windows):
            count = self.HOP if self.sent else self.WINDOW
            body = self.signals[self.sent:self.sent + count].tobytes()
            pushed = self.client.ask("STREAM", [body], op="push", stream=self.id, count=count,
                                     epoch=self.epoch, first=self.sent, crc32c=crc32c(body))
            assert pushed.ok, pushed
            self.sent += count
            event = self.ear.receive()
            assert event["event"] == "modes" and event["to"] == self.sent - 1, event
        return self

    def close(self):
        assert self.client.ask("STREAM", op="close", stream=self.id).ok
        self.client.close()
        self.ear.close()


def push(daemon, name, windows=3):
    Stream(daemon, name).tell(windows).close()


# -- what is shown --------------------------------------------------------------------------------

def assert_harmless(answer):
    """No script or style but by its file, no handler, and a policy that would stop them."""
    policy = answer.headers["Content-Security-Policy"]
    assert "default-src 'none'" in policy and "script-src 'self'" in policy
    assert "unsafe" not in policy and "frame-ancestors 'none'" in policy
    assert answer.headers["X-Content-Type-Options"] == "nosniff"
    assert not re.search(r"<script(?![^>]*\ssrc=\"/)", answer.text)
    assert not re.search(r"<style|\sstyle=|\son\w+\s*=|javascript:", answer.text)


def test_a_script_in_a_job_s_key_is_text_on_every_page(page, job):
    for path in ("/", f"/jobs/{job}", "/?state=done", "/jobs/none", f"/streams/{'%3Cscript%3E'}"):
        answer = page.get(path)
        assert_harmless(answer)
        assert SCRIPT not in answer.text
    assert "&lt;script&gt;document.title=&#39;taken&#39;&lt;/script&gt;" in page.get("/").text


def test_a_job_s_page_has_its_result_its_errors_and_its_cost(page, job):
    text = page.get(f"/jobs/{job}").text
    for word in ("done", "frequency_hz", "damping_ratio", "std.damping_ratio", "<td>2.3</td>",
                 "<td>0.005</td>", "stability", "cpu_s", "relative_error", f"/jobs/{job}.svg"):
        assert word in text, word


def test_a_job_s_picture_is_what_modalctl_draws_of_its_result(page, job, daemon, tmp_path):
    answer = page.get(f"/jobs/{job}.svg")
    assert answer.headers["Content-Type"] == "image/svg+xml"
    assert "default-src 'none'" in answer.headers["Content-Security-Policy"]
    xml.etree.ElementTree.fromstring(answer.text)
    subprocess.run([str(BUILD / "bin" / "modalctl"), "--server", daemon.endpoint, "result", job,
                    "--plot", str(tmp_path / "a.svg")], check=True, env=environment())
    assert answer.text == (tmp_path / "a.svg").read_text()


def test_a_result_that_is_too_large_for_a_page_is_named_instead(page, daemon):
    scene = {"structure": {"type": "chain", "masses": [1.0], "springs": [1.0, 0.0]},
             "effects": [{"type": "cubic_spring", "dof": "x1", "coefficient": 0.1}],
             "excitation": [{"dof": "x1", "k": 1, "cos": 0.1, "sin": 0}], "omega": 0.5,
             "steady": {"harmonics": 64, "samples": 512}}
    with daemon.client() as client:
        made = client.submit("steady", scene, {"sweep": "omega=0.5:0.9:600"})
        made.result()
        assert client.status(made.id)["bytes"] > 1048576
    text = page.get(f"/jobs/{made.id}").text
    assert f"modalctl result {made.id}" in text and "<img" not in text
    assert page.get(f"/jobs/{made.id}.svg").status == 404


def test_a_failed_job_s_page_says_why_and_has_no_picture(page, daemon):
    with daemon.client() as client:
        made = client.submit("identify", BATCH, {"rank.fixed": -1})
        until(lambda: client.status(made.id)["state"] == "failed")
    text = page.get(f"/jobs/{made.id}").text
    assert "bad_input" in text and "<img" not in text
    assert page.get(f"/jobs/{made.id}.svg").status == 404


def test_a_stream_s_page_has_each_track_with_its_errors(page, daemon):
    name = "rig <7> & söhne/2"
    push(daemon, name)
    path = "/streams/rig%20%3C7%3E%20%26%20s%C3%B6hne%2F2"
    until(lambda: page.get(path).status == 200)
    text = page.get(path).text
    assert "rig &lt;7&gt; &amp; söhne/2" in text and "<7>" not in text
    rows = re.findall(r'<tr><th scope="row">(\d+)</th><td>([\d.]+)</td><td>[\d.e-]+</td>'
                      r"<td>([\d.]+)</td>", text)
    found = {round(float(f), 2): float(z) for _, f, z in rows}
    assert abs(found[2.3] - 0.005) < 1e-3 and abs(found[1.0] - 0.01) < 1e-3, rows
    assert "stable" in page.get("/").text and path in page.get("/").text
    assert page.get("/streams/never").status == 404


def test_metrics_are_the_daemon_s_and_the_page_s(page):
    answer = page.get("/metrics")
    assert answer.headers["Content-Type"].startswith("text/plain; version=0.0.4")
    for family in ("modald_jobs", "modald_workers", "modald_web_readers",
                   "modald_web_requests_total", "modald_web_hung_up_total"):
        assert re.search(rf"^# TYPE {family} ", answer.text, re.M), family
        assert re.search(rf"^{family}[ {{]", answer.text, re.M), family


def test_the_picture_library_is_the_pinned_release(page):
    """By the figures of its release on npm: nothing was changed in it."""
    pinned = {"uPlot.iife.min.js":
              "19c8d4c6ad88929a79f4ae49d6f7161566dfd0ba3d15cc495e974f787eb78f1f",
              "uPlot.min.css": "df630c6a8d6f8eeaff264b50f73ce5b114f646ffd9a0bb74f049b0a00135fa04"}
    for name, digest in pinned.items():
        assert hashlib.sha256(page.get(f"/{name}").text.encode()).hexdigest() == digest
    assert "Leon Sorokin" in page.get("/uPlot.LICENSE").text
    assert base64.b64decode(re.search(r"sha512-(\S+?)`", (
        TOP / "clients/web/uplot/README.md").read_text())[1])


def test_earlier_jobs_are_a_page_further(own_daemon, own_page):
    daemon = own_daemon(workers=1)
    with daemon.client() as client:
        client.submit("identify", BATCH).result()
        client.submit_many([("identify", BATCH, None, f"k{i}") for i in range(119)])
    page = own_page(daemon.endpoint).ready()
    seen, path = [], "/?state=done"
    while path:
        text = page.get(path).text
        seen += re.findall(r'href="/jobs/([^"/]+)"', text)
        further = re.search(r'href="(/\?after=[^"]+)"', text)
        path = further and further[1].replace("&amp;", "&")
    assert len(seen) == len(set(seen)) == 120


# -- what is refused ------------------------------------------------------------------------------

@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH", "OPTIONS", "TRACE", "NONE"])
def test_other_methods_than_get_and_head_are_refused(page, job, method):
    for path in ("/", f"/jobs/{job}", f"/jobs/{job}/delete", "/events", "/metrics"):
        answer = page.ask(method, path, {"X-Modald-Token": "0" * 32}, body=b"x" * 10)
        assert answer.status == 405 and "GET" in answer.headers["Allow"]
    assert page.get(f"/jobs/{job}").status == 200


def test_head_has_the_headers_alone(page):
    answer = page.ask("HEAD", "/")
    assert answer.status == 200 and answer.text == "" and int(answer.headers["Content-Length"]) > 0


@pytest.mark.parametrize("path", [
    "/../../../../etc/passwd", "/%2e%2e/%2e%2e/etc/passwd", "/page.js/../../etc/passwd", "//etc",
    "/jobs/", "/jobs/%00", "/jobs/a%0d%0aSet-Cookie:x", "/jobs/%", "/jobs/%zz", "/jobs/%f",
    "/jobs/a/b", "/jobs/../x", "/streams/", "/streams/a/b", "/streams/%ff", "/nothing",
    "/jobs/" + 133 * "x", "/uplot/LICENSE", "/clients/web/page.js", "/.git/config"])
def test_a_path_that_is_no_page_is_not_found(page, path):
    answer = page.get(path)
    assert answer.status == 404 and "root:" not in answer.text
    assert "Set-Cookie" not in answer.headers


@pytest.mark.parametrize("host, status", [
    ("127.0.0.1", 200), ("127.0.0.1:99", 200), ("localhost:8130", 200), ("[::1]:1", 200),
    ("192.0.2.7", 200), ("lab.example.org", 200), ("LAB.example.org:443", 200),
    ("evil.example", 421), ("localhost.evil.example", 421), ("127.0.0.1.evil.example", 421),
    ("lab.example.org.evil.example", 421), ("", 421), ("127.0.0.1:x", 421), ("[::1", 421),
    (":80", 421), ("a" * 300, 421), ("127.0.0.1@evil.example", 421)])
def test_a_host_that_is_not_ours_is_refused(host_page, host, status):
    answer = host_page.get("/page.css", Host=host)
    assert answer.status == status
    if status != 200:
        assert "track0" not in answer.text


@pytest.fixture(scope="module")
def host_page(daemon, tmp_path_factory):
    made = Page(tmp_path_factory.mktemp("host"), daemon.endpoint, "--host", "lab.example.org")
    yield made
    made.close()


def test_what_is_too_long_is_refused_and_the_page_goes_on(page):
    assert page.get("/jobs/" + 2100 * "x").status == 414
    assert page.get("/jobs/" + 20000 * "x").status == 414
    assert page.raw(b"GET /" + b"x" * 100000 + b" HTTP/1.1\r\nHost: localhost\r\n\r\n"
                    )[:12] in (b"HTTP/1.1 414", b"")
    big = page.raw(b"GET / HTTP/1.1\r\nHost: localhost\r\nX: " + b"y" * 100000 + b"\r\n\r\n")
    assert big[:12] in (b"HTTP/1.1 431", b"")
    many = b"".join(b"X-%d: y\r\n" % i for i in range(20000))
    assert page.raw(b"GET / HTTP/1.1\r\nHost: localhost\r\n" + many + b"\r\n")[:12] in (
        b"HTTP/1.1 431", b"")
    assert page.get("/").status == 200


def requests_of_a_fuzzer(seed, count):
    """Requests with bytes taken out, put in and turned around."""
    dice = random.Random(seed)
    whole = [b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n",
             b"GET /jobs/key:a%20b.svg HTTP/1.1\r\nHost: [::1]:80\r\nLast-Event-ID: 7\r\n\r\n",
             b"GET /streams/%e2%82%ac?from=1&stream=x&kinds=a,b HTTP/1.1\r\nHost: localhost\r\n"
             b"\r\n",
             b"GET /events?from=99999999999999999999&job=%00 HTTP/1.0\r\nHost: localhost\r\n\r\n",
             b"POST /jobs/a/cancel HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n"
             b"\r\n5\r\nabcde\r\n0\r\n\r\n",
             b"GET /?after=%25&state=done HTTP/1.1\r\nHost: localhost\r\nContent-Length: 5\r\n\r\n"
             b"abcde"]
    for _ in range(count):
        data = bytearray(dice.choice(whole))
        for _ in range(dice.randrange(8)):
            at = dice.randrange(len(data))
            what = dice.randrange(4)
            if what == 0:
                data[at] = dice.randrange(256)
            elif what == 1:
                del data[at:at + dice.randrange(1, 9)]
            elif what == 2:
                data[at:at] = bytes([dice.randrange(256)]) * dice.randrange(1, 9)
            else:
                data[at:at] = dice.choice(whole)[:dice.randrange(1, 40)]
            data = data or bytearray(b"G")
        yield bytes(data)


def test_bytes_of_any_kind_leave_the_page_and_the_daemon_as_they_were(own_page, daemon, job):
    page = own_page(daemon.endpoint, "--actions").ready()
    for data in requests_of_a_fuzzer(int(os.environ.get("MODALD_SEED", "1")),
                                     3000 if LONG else 300):
        with socket.create_connection(("127.0.0.1", page.port), timeout=PATIENCE_S) as s:
            with contextlib.suppress(ConnectionError):
                s.sendall(data)
                s.setblocking(False)
                with contextlib.suppress(BlockingIOError):
                    s.recv(4096)
    assert page.process.poll() is None, page.said()
    assert page.get(f"/jobs/{job}").status == 200


def test_more_connections_than_there_is_room_for_take_nothing_from_who_comes_after(page):
    files = [socket.create_connection(("127.0.0.1", page.port)) for _ in range(600)]
    for s in files[:100]:
        s.sendall(b"GET / HTT")
    for s in files:
        s.close()
    assert page.get("/").status == 200


def hung_up(page):
    return float(re.search(r"^modald_web_hung_up_total (\S+)", page.get("/metrics").text, re.M)[1])


def is_closed(s):
    s.setblocking(False)
    try:
        return s.recv(1) == b""
    except BlockingIOError:
        return False
    except ConnectionError:
        return True


def test_who_asks_for_nothing_makes_room_for_who_comes_and_who_waits_keeps_his_place(page, daemon,
                                                                                   job):
    """256 places; half a request is none, an event to come is."""
    reader = page.events()
    files = [socket.create_connection(("127.0.0.1", page.port)) for _ in range(400)]
    for s in files[::2]:
        s.sendall(b"GET / HTT")
    assert page.get("/").status == 200
    assert hung_up(page) >= 400 - 256
    closed = [is_closed(s) for s in files]
    assert closed == sorted(closed, reverse=True)               # the first who came
    submit_some(daemon, ["not hung up on"])
    assert len(numbers(reader, 1)) == 1
    for s in files:
        s.close()


def room_for_files(count):
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard < count:
        pytest.skip(f"{count} files are needed; ulimit -Hn is {hard}")
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, count), hard))
    return soft, hard


@pytest.mark.skipif(not LONG, reason="10,000 connections: with MODALD_LONG=1")
def test_ten_thousand_connections_hold_up_nobody_and_take_no_memory(own_daemon, own_page):
    """Half-open ones, idle ones, and requests whose answers nobody takes."""
    limits = room_for_files(10400)
    daemon = own_daemon(workers=1)
    page = own_page(daemon.endpoint).ready()
    files, grown = [], []
    try:
        for round_ in range(10):
            for i in range(1000):
                files.append(socket.create_connection(("127.0.0.1", page.port),
                                                      timeout=PATIENCE_S))
                with contextlib.suppress(ConnectionError):
                    files[-1].sendall((b"", b"GET / HTT", b"GET / HTTP/1.1\r\nHost: x\r\n",
                                       b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n")[i % 4])
            assert page.get("/").status == 200
            grown.append(page.memory_kb())
        assert hung_up(page) >= 5000
        open_files = len(list(pathlib.Path(f"/proc/{page.process.pid}/fd").iterdir()))
        assert open_files < 256 + 40
    finally:
        for s in files:
            s.close()
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)
    assert grown[-1] - grown[4] < 1024, grown                   # kB: no more with more of them
    with daemon.client() as client:
        client.submit("identify", BATCH).result()
    assert page.get("/").status == 200


def test_readers_beyond_the_limit_are_told_to_come_again(own_page, daemon):
    page = own_page(daemon.endpoint).ready()
    readers = [page.ask("GET", "/events", whole=False) for _ in range(128)]
    assert all(r.status == 200 for r in readers)
    refused = page.get("/events")
    assert refused.status == 503 and int(refused.headers["Retry-After"]) > 0
    assert page.get("/").status == 200
    for r in readers:
        r.close()


# -- events ---------------------------------------------------------------------------------------

def numbers(events, count):
    return [number for number, kind, _ in
            [next(events) for _ in range(count)] if kind == "message"]


def submit_some(daemon, keys):
    """Jobs that are answered from one result: an event each."""
    with daemon.client() as client:
        client.submit_many([("identify", BATCH, None, key) for key in keys])


def test_a_reader_goes_on_after_the_last_event_that_he_had(page, daemon, job):
    live = page.events()
    submit_some(daemon, [f"replay{i}" for i in range(20)])
    first = numbers(live, 20)
    assert first == sorted(first)
    again = page.events(last=first[4])
    assert numbers(again, 15) == first[5:]
    assert numbers(page.events(f"/events?from={first[3]}"), 3) == first[3:6]
    submit_some(daemon, ["replay-more"])
    assert numbers(again, 1)[0] > first[-1]


def test_a_reader_hears_what_he_asked_for_alone(page, daemon, job):
    of_stream = page.events("/events?stream=only&kinds=modes")
    of_job = page.events(f"/events?job={job}&from=0")
    push(daemon, "other")
    push(daemon, "only")
    events = [json.loads(next(of_stream)[2]) for _ in range(2)]
    assert {(e["event"], e["stream"]) for e in events} == {("modes", "only")}
    assert all("track" in mode for e in events for mode in e["modes"])
    states = [json.loads(next(of_job)[2]) for _ in range(3)]
    assert [e["state"] for e in states] == ["queued", "running", "done"]


def test_a_place_before_what_is_kept_or_beyond_what_was_told_is_said_to_be_lost(own_daemon,
                                                                               own_page):
    daemon = own_daemon(workers=1)
    with daemon.client() as client:
        client.submit("identify", BATCH).result()
    submit_some(daemon, [f"k{i}" for i in range(4200)])
    page = own_page(daemon.endpoint).ready()
    lost = json.loads(next(page.events(last=0))[2])
    assert lost["event"] == "lost" and lost["number"] > 1
    number, _, data = next(page.events(last=lost["number"] - 1))
    assert number == lost["number"] and json.loads(data)["event"] == "state"
    assert json.loads(next(page.events(last=10 ** 9))[2])["event"] == "lost"


def test_who_does_not_read_holds_up_nobody(page, daemon, job):
    slow = socket.create_connection(("127.0.0.1", page.port))
    slow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
    slow.sendall(b"GET /events HTTP/1.1\r\nHost: localhost\r\n\r\n")
    live = page.events()
    submit_some(daemon, [f"slow{i}" for i in range(2000)])
    assert len(numbers(live, 2000)) == 2000
    slow.close()


@pytest.mark.skipif(not LONG, reason="takes a minute: with MODALD_LONG=1")
def test_who_takes_nothing_is_hung_up_on(page, daemon, job):
    slow = socket.socket()
    slow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
    slow.connect(("127.0.0.1", page.port))
    slow.sendall(b"GET /events HTTP/1.1\r\nHost: localhost\r\n\r\n")
    until(lambda: "modald_web_readers 1\n" in page.get("/metrics").text)
    for burst in range(40):
        submit_some(daemon, [f"hung{burst}-{i}" for i in range(1000)])
    until(lambda: "modald_web_readers 0\n" in page.get("/metrics").text)
    slow.close()


def test_the_daemon_is_asked_ten_times_a_second_however_many_look(page, client):
    def replies():
        return float(re.search(r"^modald_replies_total (\S+)", client.metrics(), re.M)[1])
    before, begun = replies(), time.monotonic()
    with concurrent.futures.ThreadPoolExecutor(40) as many:
        assert {answer.status for answer in many.map(page.get, 200 * ["/"])} == {200}
    taken = time.monotonic() - begun
    assert replies() - before <= 3 * (10 * taken + 1) + 1


# -- a daemon that comes and goes -----------------------------------------------------------------

def test_the_page_is_503_while_the_daemon_is_away_and_goes_on_by_itself(own_daemon, own_page):
    daemon = own_daemon(workers=1)
    page = own_page(daemon.endpoint).ready()
    with daemon.client() as client:
        client.submit("identify", BATCH, key="before").result()
    live = page.events("/events?from=0")
    before = numbers(live, 3)
    daemon.kill()
    until(lambda: page.get("/").status == 503)
    for path in ("/", "/jobs/x", "/streams/x", "/events", "/metrics", "/jobs/x.svg"):
        answer = page.get(path)
        assert answer.status == 503 and int(answer.headers["Retry-After"]) > 0, path
        assert_harmless(answer)
    assert page.get("/page.js").status == 200
    daemon.start()
    until(lambda: page.get("/").status == 200)
    assert next(live)[1:] == ("daemon", "away") and next(live)[1:] == ("daemon", "here")
    with daemon.client() as client:
        client.submit("identify", BATCH, {"rank.fixed": 4}, key="after").result()
    after = numbers(live, 3)
    assert after[0] > before[-1]
    assert numbers(page.events(last=before[-1]), 3) == after
    assert "after" in page.get("/").text


def test_a_page_begun_before_its_daemon_waits_for_it(own_daemon, own_page, tmp_path):
    page = own_page(f"ipc://{tmp_path}/nobody")
    assert page.get("/").status == 503
    assert page.get("/page.css").status == 200


def test_a_daemon_that_does_not_answer_is_away_too(own_daemon, own_page):
    daemon = own_daemon(workers=1)
    page = own_page(daemon.endpoint).ready()
    os.kill(daemon.process.pid, signal.SIGSTOP)
    try:
        assert page.get("/jobs/x").status == 503
    finally:
        os.kill(daemon.process.pid, signal.SIGCONT)
    until(lambda: page.get("/").status == 200)


# -- actions and keys -----------------------------------------------------------------------------

def token_of(page, path):
    found = re.search(r'data-token="([0-9a-f]{32})"', page.get(path).text)
    return found and found[1]


def test_an_action_is_taken_from_the_page_s_own_buttons_alone(own_page, daemon):
    with daemon.client() as client:
        made = client.submit("identify", BATCH, key="to be deleted")
        made.result()
        page = own_page(daemon.endpoint, "--actions").ready()
        path = f"/jobs/{made.id}/delete"
        token = token_of(page, f"/jobs/{made.id}")
        same = {"Sec-Fetch-Site": "same-origin"}
        for headers in ({}, same, {"X-Modald-Token": token}, {"X-Modald-Token": "0" * 32, **same},
                        {"X-Modald-Token": token, "Sec-Fetch-Site": "cross-site"},
                        {"X-Modald-Token": token, "Sec-Fetch-Site": "same-site"},
                        {"X-Modald-Token": token, "Origin": "http://evil.example"},
                        {"X-Modald-Token": token, "Origin": "null"}):
            assert page.ask("POST", path, headers).status == 403, headers
        assert page.ask("GET", path, {"X-Modald-Token": token, **same}).status == 405
        assert client.status(made.id)["state"] == "done"
        done = page.ask("POST", path, {"X-Modald-Token": token,
                                       "Origin": f"http://127.0.0.1:{page.port}"})
        assert done.status == 200 and json.loads(done.text)["deleted"] is True
        assert page.ask("POST", path, {"X-Modald-Token": token, **same}).status in (404, 410)


def key_file(it, name, path):
    public, secret = (k.decode() for k in it.pairs[name])
    it.write(path, f'public-key = "{public}"\nsecret-key = "{secret}"\n'
             f'server-key = "{it.server[0].decode()}"\n')
    return path


def test_a_key_of_role_read_shows_and_does_nothing_and_one_of_role_submit_does(tmp_path, own_page):
    it = Lab(tmp_path, {"eye": "ann read", "hand": "ann submit", "stranger": "bob read"},
             config=FAKE)
    try:
        hand = it.client("hand")
        made = hand.ask("SUBMIT", [decay().tobytes()], kind="identify", key="ann's own",
                        input={"content": "batch", "samples": 400, "channels": 2, "dt": 0.05},
                        options={})
        assert made.ok, made
        pages = {name: own_page(it.daemon.endpoint, "--actions", "--keyfile",
                                key_file(it, name, tmp_path / f"{name}.key")).ready()
                 for name in ("eye", "hand", "stranger")}
        job = made["job"]
        assert "ann&#39;s own" in pages["eye"].get("/").text
        assert token_of(pages["eye"], f"/jobs/{job}") is None
        assert pages["eye"].ask("POST", f"/jobs/{job}/cancel",
                                {"Sec-Fetch-Site": "same-origin"}).status == 405
        assert token_of(pages["hand"], f"/jobs/{job}")
        assert "ann" not in pages["stranger"].get("/").text
        assert pages["stranger"].get(f"/jobs/{job}").status == 404
        hand.close()
    finally:
        it.daemon.stop()


def test_a_key_file_that_others_may_read_is_refused_and_nothing_of_it_is_said(tmp_path):
    path = tmp_path / "open.key"
    path.write_text('public-key = "x"\nsecret-key = "sesame"\n')
    path.chmod(0o644)
    done = subprocess.run([str(PROGRAM), "--keyfile", str(path), "--bind", "127.0.0.1:0"],
                          capture_output=True, text=True, env=environment(), check=False)
    assert done.returncode == 2 and "keyfile" in done.stderr and "sesame" not in done.stderr


@pytest.mark.parametrize("words, said", [
    (["--bind", "nowhere"], "accepted: ADDRESS:PORT"), (["--bind", "127.0.0.1:70000"], "accepted"),
    (["--bind", ":80"], "accepted"), (["--bind"], "needs a value"), (["--acts"], "--actions"),
    (["more"], "unknown argument"), (["--bind", "192.0.2.1:1"], "cannot listen there")])
def test_what_is_wrong_with_the_arguments_is_said(words, said):
    done = subprocess.run([str(PROGRAM), *words], capture_output=True, text=True,
                          env=environment(), check=False)
    assert done.returncode == 2 and said.lstrip("-") in done.stderr, done.stderr


# -- as much as a lab has -------------------------------------------------------------------------

@pytest.mark.skipif(sanitized.SANITIZED, reason="sanitizers take memory of their own")
def test_a_thousand_jobs_and_fifty_readers_take_less_than_30_mb(own_daemon, own_page):
    daemon = own_daemon(workers=1)
    page = own_page(daemon.endpoint).ready()
    with daemon.client() as client:
        job = client.submit("identify", BATCH)
        job.result()
    readers = [page.events("/events?from=0") for _ in range(50)]
    for reader in readers:
        next(reader)
    submit_some(daemon, [f"many{i}" for i in range(1000)])
    push(daemon, "rig7", 10)
    for reader in readers:
        numbers(reader, 1000)
    for _ in range(20):
        assert page.get("/").status == page.get(f"/jobs/{job.id}").status == 200
    assert page.memory_kb() < 30000


class Past:
    """A stand-in for a daemon: it tells a window of a real one again and again, as fast as it is
    taken."""

    def __init__(self, folder, event):
        self.endpoint, self.event, self.number = f"ipc://{folder}/past.ipc", event, 0
        self.told = dict.fromkeys(("rig", "other"), 0)
        self.to, self.lock, self.ended = None, threading.Lock(), threading.Event()
        self.context = zmq.Context()
        self.router = self.context.socket(zmq.ROUTER)
        self.router.sndhwm = self.router.linger = 0
        self.router.bind(self.endpoint)
        self.thread = threading.Thread(target=self.serve)
        self.thread.start()

    def serve(self):
        while not self.ended.wait(0.005):
            with self.lock:
                while self.router.poll(0):
                    self.answer(*self.router.recv_multipart()[:4])

    def answer(self, peer, version, verb, header):
        header = json.loads(header)
        reply = {"id": header["id"], "verb": verb.decode()}
        if verb == b"HELLO":
            reply.update(store="past", server="past", user="local", role="read")
        elif verb == b"EVENTS" and header["op"] == "subscribe":
            reply.update(subscription="1", next=self.number + 1)
            self.to = peer
        elif verb != b"EVENTS":
            reply.update(code="busy", message="a stand-in has no answer")
        kind = b"ERROR" if "code" in reply else b"REPLY"
        self.router.send_multipart([peer, version, kind, json.dumps(reply).encode()])

    def tell(self, windows):
        """So many of each stream, two seconds from one to the next."""
        for _ in range(windows):
            for name in self.told:
                self.number += 1
                self.told[name] += 1
                to = 200 * self.told[name]
                event = {**self.event, "subscription": "1", "number": self.number, "stream": name,
                         "dt": 0.01, "from": to - 400, "to": to}
                with self.lock:
                    self.router.send_multipart([self.to, b"MODALD1", b"EVENT",
                                                json.dumps(event).encode()])

    def close(self):
        self.ended.set()
        self.thread.join()
        self.context.destroy(linger=0)


def heap(window):
    window.do("HeapProfiler.collectGarbage")
    return window.do("Runtime.getHeapUsage")["usedSize"]


@pytest.mark.skipif(not LONG, reason="a day's 86,400 windows: with MODALD_LONG=1")
def test_a_day_of_windows_leaves_memory_as_it_is_after_half_of_it(page, daemon, own_page, tmp_path,
                                                                  request):
    """Of the page's process, and of a browser that shows a stream."""
    push(daemon, "past")
    # behind many jobs the first that is told is what was lost
    told = page.events("/events?stream=past&kinds=modes&from=0")
    event = next(e for e in (json.loads(data) for _, _, data in told) if e["event"] == "modes")
    past = Past(tmp_path, event)
    ours, sizes, heaps = own_page(past.endpoint), [], []
    try:
        until(lambda: ours.get("/streams/rig").status != 503 and past.to, "no subscription")
        window = None if browser.PROGRAM is None else request.getfixturevalue("window")
        reader = ours.events("/events?stream=rig&kinds=modes")
        past.tell(3)
        numbers(reader, 3)                                      # before them it has no page
        if window is not None:
            window.go(f"http://127.0.0.1:{ours.port}/streams/rig")
            window.wait("document.getElementById('damping').dataset.windows >= 3")
        for _ in range(24):
            for _ in range(3):                              # 600 windows of each: 20 minutes
                past.tell(600)
                assert len(numbers(reader, 600)) == 600
            if window is not None:
                last = 2 * past.told["rig"]
                window.wait(f"document.getElementById('damping').dataset.last >= {last}")
                heaps.append(heap(window))
            sizes.append(ours.memory_kb())
    finally:
        past.close()
    assert past.number == 2 * (24 * 1800 + 3)
    if not sanitized.SANITIZED:
        # kB; the least that is lost, 32 bytes of each event, is 1350 in half a day
        assert np.median(sizes[12:]) - np.median(sizes[:12]) < 1024, sizes
        assert sizes[-1] < 30000
    if heaps:
        assert max(heaps[12:]) < 1.1 * max(heaps[:12]), heaps


# -- in a browser ---------------------------------------------------------------------------------

@pytest.fixture
def window(tmp_path):
    if browser.PROGRAM is None:
        pytest.skip("no chromium")
    if sanitized.SANITIZED:
        pytest.skip("a browser is enough of a load with the build that is shipped")
    made = browser.Browser(tmp_path)
    yield made
    made.close()
    assert not made.errors, made.errors


def test_a_browser_shows_every_page_and_complains_of_nothing(window, page, daemon, job):
    push(daemon, "shown")
    at = f"http://127.0.0.1:{page.port}"
    window.go(f"{at}/")
    window.wait("document.getElementById('live').textContent === 'live'")
    submit_some(daemon, [SCRIPT + " again"])
    window.wait("document.getElementById('queue').innerText.includes('</script>')")
    assert window.ask("document.title") == "At a glance - modald"
    window.wait("document.getElementById('streams').innerText.includes('shown')")
    window.go(f"{at}/jobs/{job}")
    assert window.wait("document.querySelector('img').naturalWidth") > 500
    assert SCRIPT in window.ask("document.body.innerText")
    window.go(f"{at}/streams/shown")
    window.wait("document.querySelectorAll('#damping canvas, #frequency canvas').length === 2")
    window.wait("Number(document.getElementById('damping').dataset.windows) >= 3")


def test_a_browser_s_pages_move_by_themselves(window, page, daemon, job):
    """A new job, and new windows of a stream, without a hand's turn; by keyboard from the first
    page to the job."""
    at = f"http://127.0.0.1:{page.port}"
    stream = Stream(daemon, "moves").tell(3)
    window.go(f"{at}/streams/moves")
    window.wait("document.getElementById('damping').dataset.windows >= 3")
    before = window.ask("performance.timeOrigin")
    drawn = window.ask("document.querySelector('#damping canvas').toDataURL()")
    stream.tell(4).close()
    window.wait("document.getElementById('damping').dataset.windows >= 7")
    window.wait(f"document.querySelector('#damping canvas').toDataURL() !== {json.dumps(drawn)}")
    assert window.ask("performance.timeOrigin") == before       # it was not loaded again
    window.go(f"{at}/")
    submit_some(daemon, ["seen to come"])
    window.wait("document.getElementById('queue').innerText.includes('seen to come')")
    for _ in range(40):
        window.key("Tab", 9)
        if "/jobs/" in (window.ask("document.activeElement.getAttribute('href')") or ""):
            break
    window.key("Enter", 13)
    window.wait("location.pathname.startsWith('/jobs/') && document.querySelector('h1') !== null")
    for width in (360, 1400):                                   # a phone, a screen
        window.do("Emulation.setDeviceMetricsOverride", width=width, height=700,
                  deviceScaleFactor=1, mobile=width < 500)
        assert window.ask("document.documentElement.scrollWidth") <= width


OSCILLATOR = {"structure": {"type": "chain", "masses": [1.0], "springs": [1.0, 0.0],
                            "dampers": [0.1, 0.0]}}
DRIVEN = {**OSCILLATOR, "excitation": [{"dof": "x1", "k": 1, "cos": 0.1, "sin": 0}], "omega": 0.5,
          "effects": [{"type": "cubic_spring", "dof": "x1", "coefficient": 0.1}]}
FREE = {**OSCILLATOR, "initial": {"x": {"x1": 1.0}},
        "time": {"dt": 0.05, "duration": 20}}
SWEPT = {"verb": "floquet", "scene": {**OSCILLATOR, "omega": 1.0},
         "grid": [{"path": "structure.springs[0]", "values": [1.0, 2.0, 3.0]}]}


@pytest.mark.parametrize("kind, given, options, drawn, shown", [
    ("steady", DRIVEN, None, True, "harmonics"), ("floquet", OSCILLATOR, None, True, "exponents"),
    ("steady", DRIVEN, {"sweep": "omega=0.5:0.9:5"}, True, "points"),
    ("steady", DRIVEN, {"continue": "omega=0.5:1.5"}, True, "points"),
    ("simulate", FREE, None, False, "integrator"), ("sweep", SWEPT, None, True, "stability"),
    ("tradeoff", DRIVEN, None, True, "error"),
    ("identify", BATCH, {"rank.fixed": -1}, False, "bad_input")])
def test_a_browser_shows_what_each_kind_of_job_gave(window, page, daemon, kind, given, options,
                                                    drawn, shown):
    with daemon.client() as client:
        made = client.submit(kind, given, options)
        until(lambda: client.status(made.id)["state"] in ("done", "failed"))
        assert (client.status(made.id)["state"] == "done") == (shown != "bad_input")
    window.go(f"http://127.0.0.1:{page.port}/jobs/{made.id}")
    assert shown in window.ask("document.getElementById('main').innerText")
    assert window.ask("document.querySelectorAll('img').length") == int(drawn)
    if drawn:
        assert window.wait("document.querySelector('img').naturalWidth") > 300


def tab_to(window, wanted):
    """By keyboard alone: on, until WANTED holds of what has the focus, which can be seen."""
    for _ in range(80):
        window.key("Tab", 9)
        if window.ask(f"(e => {wanted})(document.activeElement)"):
            break
    else:
        raise AssertionError(f"no way by keyboard to {wanted}")
    assert window.ask("parseFloat(getComputedStyle(document.activeElement).outlineWidth)") >= 2


def follow(window, href):
    tab_to(window, f"(e.getAttribute('href') ?? '') === {json.dumps(href)}")
    window.key("Enter", 13)
    window.wait(f"location.pathname === {json.dumps(href)} && document.querySelector('h1') !== "
                "null")


def test_by_keyboard_alone_one_goes_to_each_page_and_back_and_deletes_a_job(own_page, window,
                                                                            daemon):
    """By what has the focus and Enter, without a pointer or an address typed."""
    page = own_page(daemon.endpoint, "--actions").ready()
    stream = Stream(daemon, "typed").tell(3)
    with daemon.client() as client:
        made = client.submit("identify", BATCH, key="typed")
        made.result()
        window.go(f"http://127.0.0.1:{page.port}/")
        window.wait("document.getElementById('streams').innerText.includes('typed')")
        follow(window, "/streams/typed")
        window.wait("document.querySelectorAll('#damping canvas').length === 1")
        follow(window, "/")
        follow(window, f"/jobs/{made.id}")
        tab_to(window, "e.dataset.action === 'delete'")
        window.key("Enter", 13)
        window.wait("location.pathname === '/'")
        with pytest.raises(modald.Error):
            client.status(made.id)
    stream.close()


CONTRAST = """(() => {
  const light = c => { const v = c.match(/[0-9.]+/g).slice(0, 3).map(x => x / 255)
    .map(x => x <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4);
    return 0.2126 * v[0] + 0.7152 * v[1] + 0.0722 * v[2]; };
  const ground = light(getComputedStyle(document.documentElement).backgroundColor);
  return [...document.querySelectorAll('h1, h2, p, a, td, th, dt, dd, #live')]
    .filter(e => e.innerText && !e.closest('.alarm'))
    .map(e => light(getComputedStyle(e).color))
    .map(c => (Math.max(c, ground) + 0.05) / (Math.min(c, ground) + 0.05))
    .reduce((a, b) => Math.min(a, b)); })()"""


@pytest.mark.parametrize("scheme, dark", [("light", False), ("dark", True)])
def test_text_stands_out_from_its_ground_in_the_light_and_in_the_dark(window, page, daemon, job,
                                                                     scheme, dark):
    """By at least 4.5, as WCAG 2.1 asks of text (1.4.3)."""
    window.do("Emulation.setEmulatedMedia",
              features=[{"name": "prefers-color-scheme", "value": scheme}])
    for path in ("/", f"/jobs/{job}"):
        window.go(f"http://127.0.0.1:{page.port}{path}")
        assert window.ask(CONTRAST) >= 4.5
    ground = window.ask("getComputedStyle(document.documentElement).backgroundColor")
    assert (max(map(int, re.findall(r"\d+", ground)[:3])) < 64) == dark


def test_a_browser_outlives_the_daemon(window, own_daemon, own_page):
    daemon = own_daemon(workers=1)
    page = own_page(daemon.endpoint).ready()
    window.go(f"http://127.0.0.1:{page.port}/")
    window.wait("document.getElementById('live').textContent === 'live'")
    daemon.kill()
    window.wait("document.getElementById('live').textContent.includes('away')")
    daemon.start()
    with daemon.client() as client:
        client.submit("identify", BATCH, key="after the restart").result()
    window.wait("document.getElementById('queue').innerText.includes('after the restart')")
    window.wait("document.getElementById('live').textContent === 'live'")
    window.go("about:blank")
    window.errors = [e for e in window.errors if "503" not in e]   # said of what was away
