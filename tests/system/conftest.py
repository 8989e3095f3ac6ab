"""A private daemon on ipc in a temporary folder, ended by its pid; and modalctl to speak to it.
Waits are for events.
"""
import contextlib
import json
import os
import pathlib
import pty
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time

import numpy as np
import pytest

TOP = pathlib.Path(__file__).resolve().parents[2]
BUILD = pathlib.Path(os.environ.get("MODALD_BUILD", TOP / "build")).resolve()
os.environ["MODALD_BUILD"] = str(BUILD)
sys.path.insert(0, str(TOP / "clients" / "python"))

import modald  # noqa: E402
import sanitized  # noqa: E402

# workers are nice: three spinners beside leave them a fifteenth of a processor
PATIENCE = 1200 if sanitized.SANITIZED else 600


# Files that ask whole programs for numbers: all of tests/unit runs the same code under sanitizers.
NUMBERS = {"ambient", "ambient_periodic", "column", "contact_bed", "coupling", "curve",
           "directions", "forced", "laws", "laws_of_loads", "leading", "noise", "scaled_units",
           "settle", "slips", "solvers", "sparse_scenes", "stiff_stability", "sweep", "tones"}


def pytest_collection_modifyitems(items):
    """Under sanitizers one in four of those, all with --long: they were half of CI's stage."""
    if not sanitized.SANITIZED or os.environ.get("MODALD_LONG"):
        return
    slow = [item for item in items if item.path.stem.removeprefix("test_") in NUMBERS]
    for place, item in enumerate(slow):
        if place % 4:
            item.add_marker(pytest.mark.skip(reason="one in four of its file under sanitizers"))


def pytest_configure():
    sanitized.begin()


def pytest_unconfigure():
    sanitized.end()


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_teardown(item):
    """Daemons of a module end with its last test, and their leaks are known only then."""
    done = yield
    done.get_result()
    found = sanitized.reports()
    assert not found, f"sanitizers in {item.name}:\n" + "\n".join(found)


# of hosts whose daemon is too slow for them; gone with the tests
spills = tempfile.TemporaryDirectory(prefix="spills-")


def terminal():
    """Both ends of a new terminal."""
    try:
        return pty.openpty()
    except OSError as none:
        pytest.skip(f"no terminals here (/dev/pts is not mounted?): {none}")


def environment(**more):
    """Ours, without what would lead a client to another daemon."""
    kept = {k: v for k, v in os.environ.items() if not k.startswith("MODALD_")
            or k == "MODALD_BUILD"}
    kept.pop("XDG_RUNTIME_DIR", None)
    return {**kept, "MODALD_SPILL": spills.name, **{k: str(v) for k, v in more.items()}}


class Daemon:
    def __init__(self, workers=2, config=()):
        self.folder = tempfile.mkdtemp(prefix="modald-")
        self.endpoint = f"ipc://{self.folder}/modald.ipc"
        self.data = f"{self.folder}/data"
        self.workers, self.config, self.process = workers, config, None
        self.start()

    def start(self):
        arguments = [str(BUILD / "bin" / "modald"), "--data", self.data, "--bind", self.endpoint,
                     "--workers", str(self.workers)]
        if self.config:
            path = pathlib.Path(self.folder, "modald.conf")
            path.write_text("".join(f"{line}\n" for line in self.config))
            arguments += ["--config", str(path)]
        self.log = open(f"{self.folder}/log", "ab")
        self.process = subprocess.Popen(arguments, stderr=self.log, env=environment())
        end = time.monotonic() + PATIENCE
        while True:                                     # the first HELLO that is answered
            assert self.process.poll() is None, self.said()
            try:
                with modald.connect(self.endpoint, timeout=2) as client:
                    client.hello()
                    return
            except modald.Error as why:
                assert time.monotonic() < end, (why, self.said())

    def said(self):
        return pathlib.Path(self.folder, "log").read_text()

    def client(self, **more):
        return modald.connect(self.endpoint, **more)

    def workers_now(self):
        """Pids of our own workers, by their parent's chain."""
        parents = {}
        for stat in pathlib.Path("/proc").glob("[0-9]*/stat"):
            try:
                text = stat.read_text()
            except OSError:
                continue
            name = text[text.index("(") + 1:text.rindex(")")]
            parents[int(stat.parent.name)] = (name, int(text[text.rindex(")") + 2:].split()[1]))

        def ours(pid):
            while pid in parents and pid > 1:
                pid = parents[pid][1]
                if pid == self.process.pid:
                    return True
            return False
        return [pid for pid, (name,
                              _) in parents.items() if name.startswith("modald-worker") and ours(
            pid)]

    def kill(self):
        self.process.kill()
        self.process.wait()
        self.log.close()

    def stop(self):
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
            try:
                self.process.wait(PATIENCE)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()
        self.log.close()
        return self.process.returncode

    def remove(self):
        self.stop()
        sanitized.hear(self.said())
        shutil.rmtree(self.folder, ignore_errors=True)


@pytest.fixture(scope="module")
def daemon():
    made = Daemon()
    yield made
    made.remove()


@pytest.fixture
def own_daemon():
    """One that a test may kill; `own_daemon(workers=1, config=[...])`."""
    made = []

    def make(**more):
        made.append(Daemon(**more))
        return made[-1]
    yield make
    for one in made:
        one.remove()


@pytest.fixture
def client(daemon):
    with contextlib.closing(daemon.client()) as made:
        yield made


class Said:
    """What modalctl said: its exit status, its one document (or lines of them), its stderr."""

    def __init__(self, done, one=True):
        self.status, self.out, self.err = done.returncode, done.stdout, done.stderr
        sanitized.hear(done.stderr)
        self.lines = [json.loads(line) for line in self.out.splitlines()]
        if one:
            assert len(self.lines) == 1, (self.out, self.err)
            self.document = self.lines[0]


@pytest.fixture(scope="session")
def ctl():
    """`ctl("identify", path, "-o", "rank.fixed=6", server=daemon)`; without a server --local.
    Always --json.
    """
    def run(*words, server=None, one=True, timeout=PATIENCE, env=None, stdin=None):
        where = (["--server", server if isinstance(server, str) else server.endpoint] if server
                 else ["--local"])
        done = subprocess.run([str(BUILD / "bin" / "modalctl"), *where, "--json",
                               *map(str, words)], capture_output=True, text=True,
                              timeout=timeout, env=environment(**(env or {})), input=stdin)
        return Said(done, one)
    return run


def watched(daemon, *words, until):
    """What `modalctl watch WORDS` has said when UNTIL of its lines is true; it would go on for
    ever.
    """
    run = subprocess.Popen([str(BUILD / "bin" / "modalctl"), "--server", daemon.endpoint, "--json",
                            "watch", *map(str, words)], stdout=subprocess.PIPE,
                           text=True, env=environment())
    patience = threading.Timer(PATIENCE, run.kill)
    patience.start()
    lines = []
    while not until(lines):
        line = run.stdout.readline()
        assert line, f"{lines} and then no more"
        lines.append(json.loads(line))
    patience.cancel()
    run.kill()
    run.communicate()
    return lines


def decay(samples=400, dt=0.05, modes=((2.3, 0.005, 1.0), (1.0, 0.01, 0.7)), channels=2):
    """Sums of damped cosines: frequency [Hz], damping ratio, amplitude, with other phases in other
    channels.
    """
    t = np.arange(samples) * dt
    out = np.zeros((samples, channels))
    for f, z, a in modes:
        w = 2 * np.pi * f
        for c in range(channels):
            out[:, c] += a * np.exp(-z * w * t) * np.cos(w * np.sqrt(1 - z * z) * t + 0.7 * c * f)
    return out


def write_batch(path, signals, dt=0.05, **attributes):
    import h5py
    with h5py.File(path, "w") as file:
        data = file.create_dataset("signals", data=signals)
        if dt is not None:
            data.attrs["dt"] = dt
        for key, value in attributes.items():
            data.attrs[key] = value
    return str(path)


@pytest.fixture(scope="session")
def batch(tmp_path_factory):
    """Two known modes in two channels, 400 samples: 6.4 kB, which travels inside SUBMIT."""
    return write_batch(tmp_path_factory.mktemp("batch") / "small.h5", decay())


@pytest.fixture(scope="session")
def large_batch(tmp_path_factory):
    """The same, longer: 640 kB, which is uploaded in chunks."""
    return write_batch(tmp_path_factory.mktemp("batch") / "large.h5",
                       decay(10000, 0.01, channels=8), 0.01, units="m",
                       channels=[f"c{i}" for i in range(8)])


@pytest.fixture(scope="session")
def slow_batch(tmp_path_factory):
    """Noise, and with SLOW a dense decomposition of tens of seconds."""
    return write_batch(tmp_path_factory.mktemp("batch") / "slow.h5",
                       np.random.default_rng(7).standard_normal((8000, 1)))


SLOW = {"rows": 3900, "columns": 4000, "rank.fixed": 300}
SLOW_WORDS = [word for key, value in SLOW.items() for word in ("-o", f"{key}={value}")]


@pytest.fixture(scope="session")
def reference():
    """The reference signals."""
    return TOP / "tests" / "data" / "reference" / "signals"
