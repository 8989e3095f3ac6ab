"""`modalctl top`: a live screen that gives the terminal back, and one picture where there is
none."""
# Tests as well: top.c screen.c streams.c job_line.c progress.c
import contextlib
import fcntl
import json
import os
import re
import signal
import struct
import subprocess
import termios

import pytest
from conftest import BUILD, PATIENCE, environment, terminal

ENTERED, LEFT = b"\033[?1049h", b"\033[?1049l"


def resize(terminal, columns, rows):
    fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))


class Screen:
    """top on a terminal of its own; what it wrote so far is `seen`."""

    def __init__(self, endpoint, columns=130, rows=30):
        self.mine, self.theirs = terminal()
        resize(self.mine, columns, rows)
        self.before = termios.tcgetattr(self.theirs)
        self.seen = b""
        self.process = subprocess.Popen([str(BUILD / "bin" / "modalctl"), "top"], stdin=self.theirs,
                                        stdout=self.theirs, stderr=subprocess.PIPE,
                                        start_new_session=True,
                                        env=environment(MODALD_URL=endpoint))

    def until(self, what):
        while what not in self.seen:
            self.seen += os.read(self.mine, 65536)

    def picture(self):
        """The next whole one, as lines."""
        self.seen = self.seen[self.seen.rfind(b"\033[J"):]
        at = len(self.seen)
        while b"\033[J" not in self.seen[at:]:
            self.seen += os.read(self.mine, 65536)
        text = self.seen[at:].rsplit(b"\033[J", 1)[0].rsplit(b"\033[H", 1)[1].decode()
        return [re.sub(r"\033\[[?0-9]*[A-Za-z]|\r", "", line) for line in text.split("\n")]

    def ended(self):
        self.until(LEFT)
        return self.process.wait(PATIENCE)

    def close(self):
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        self.process.stderr.close()
        os.close(self.mine)
        os.close(self.theirs)


@pytest.fixture
def screen(daemon):
    with contextlib.closing(Screen(daemon.endpoint)) as made:
        made.until(b"\033[J")
        yield made


def test_top_shows_queue_workers_streams_and_jobs_and_q_ends_it(screen):
    assert screen.seen.startswith(ENTERED)
    lines = screen.picture()
    assert lines[1].startswith("queue: 0 queued") and lines[2].startswith("workers: 0 of 2 busy")
    assert any(line.startswith("name ") and line.endswith("age") for line in lines)
    assert any(line.startswith("job ") for line in lines)
    os.write(screen.mine, b"xq")
    assert screen.ended() == 0
    assert termios.tcgetattr(screen.theirs) == screen.before


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT,
                                    signal.SIGABRT])
def test_a_signal_ends_top_with_the_terminal_as_it_was(screen, number):
    assert termios.tcgetattr(screen.theirs) != screen.before
    screen.process.send_signal(number)
    assert screen.ended() == -number
    assert termios.tcgetattr(screen.theirs) == screen.before


def test_a_smaller_terminal_gets_a_smaller_picture_at_once(screen):
    assert max(map(len, screen.picture())) > 40
    resize(screen.mine, 40, 7)
    screen.process.send_signal(signal.SIGWINCH)
    while max(map(len, lines := screen.picture())) > 40:
        pass
    assert len(lines) <= 7 and lines[0].startswith("modald up ")


def test_top_prints_one_picture_into_a_pipe(daemon, client):
    client.ask("STREAM", {"op": "open", "name": "rig7", "channels": 2, "dt": 0.01})
    words = [str(BUILD / "bin" / "modalctl"), "top"]
    where = environment(MODALD_URL=daemon.endpoint)
    said = subprocess.run(words, capture_output=True, text=True, check=True, env=where,
                          timeout=PATIENCE).stdout
    assert "\033" not in said and re.search(r"^rig7 +local +open +2 +100 ", said, re.M)
    said = subprocess.run([*words, "--json"], capture_output=True, text=True, check=True, env=where,
                          timeout=PATIENCE).stdout
    document = json.loads(said)
    assert document["streams"][0]["name"] == "rig7" and document["stats"]["workers"]["total"] == 2


def test_top_without_a_daemon_is_no_server_and_leaves_the_terminal_alone(tmp_path):
    with contextlib.closing(Screen(f"ipc://{tmp_path}/none.ipc")) as screen:
        assert screen.process.wait(PATIENCE) == 3
        assert termios.tcgetattr(screen.theirs) == screen.before
