"""Who is at fault where there is no connection: permissions, keys, or nobody there; modalctl, and
libmodald-client behind it, and Python say the same.
"""
import os
import pathlib
import re
import socket
import subprocess
import threading

import pytest
import zmq

import modald
from conftest import BUILD, PATIENCE, environment
from lab import Lab
from wire import until

NOBODY = 65534
CURVE = pytest.mark.skipif(not zmq.has("curve"), reason="this pyzmq has no CURVE")
AS_NOBODY = pytest.mark.skipif(os.getuid() != 0, reason="only root becomes somebody else")


def by_modalctl(url, keyfile=None, user=None):
    """Code, message and exit status."""
    words = [str(BUILD / "bin" / "modalctl"), "--json", "--server", url,
             *(["--keyfile", str(keyfile)] if keyfile else []), "whoami"]
    done = subprocess.run(words, capture_output=True, text=True, timeout=PATIENCE,
                          env=environment(), user=user, group=user, extra_groups=[] if user
                          else None)
    error = modald.wire.loads(done.stdout)["error"]
    return error["code"], error["message"], done.returncode


PYTHON = """
import sys, modald
try:
    with modald.connect(sys.argv[1], sys.argv[2] or None) as c:
        c.whoami()
except modald.Error as e:
    print(e.code)
    print(e.message)
"""


def by_python(url, keyfile=None, user=None):
    folder = pathlib.Path(modald.__file__).parents[1]
    done = subprocess.run(["/usr/bin/python3", "-c", PYTHON, url, str(keyfile or "")],
                          capture_output=True, text=True, timeout=PATIENCE,
                          env=environment(PYTHONPATH=folder), user=user, group=user,
                          extra_groups=[] if user else None)
    code, message = done.stdout.splitlines()
    return code, message, {"no_server": 3, "denied": 4}[code]


BOTH = pytest.mark.parametrize("told", [by_modalctl, by_python], ids=["modalctl", "python"])


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    it = Lab(tmp_path_factory.mktemp("keys"), {"ann": "ann submit"})
    yield it
    it.daemon.__exit__()


def key_of(lab, path, pair, server):
    lab.write(path, "".join(f'{name} = "{key.decode()}"\n'
                            for name, key in (("public-key", pair[0]), ("secret-key", pair[1]),
                                              ("server-key", server))))
    return path


@BOTH
def test_nobody_there_is_said_as_such(told, tmp_path):
    code, message, status = told(f"ipc://{tmp_path}/none")
    assert ((code, status) == ("no_server", 3)
            and message.startswith(f"no modald at ipc://{tmp_path}/none"))


@BOTH
@AS_NOBODY
def test_a_socket_of_others_is_told_with_its_mode_and_group(told, daemon, tmp_path):
    path = daemon.endpoint.removeprefix("ipc://")
    pathlib.Path(path).parent.chmod(0o755)
    os.chmod(path, 0o660)
    code, message, status = told(daemon.endpoint, user=NOBODY)
    assert (code, status) == ("denied", 4), message
    assert "permission denied" in message and "mode 660" in message and "group root" in message
    os.chmod(path, 0o666)
    assert by_nobody(daemon.endpoint)


def by_nobody(url):
    """Does that user come in?"""
    words = [str(BUILD / "bin" / "modalctl"), "--server", url, "whoami"]
    return subprocess.run(words, capture_output=True, env=environment(), user=NOBODY, group=NOBODY,
                          extra_groups=[], timeout=PATIENCE).returncode == 0


@BOTH
@AS_NOBODY
def test_a_folder_that_is_closed_to_us_is_told(told, tmp_path):
    """Of a folder that we may not enter nobody can say what is in it."""
    tmp_path.chmod(0o700)
    code, message, status = told(f"ipc://{tmp_path}/modald.ipc", user=NOBODY)
    assert ((code, status) == ("denied", 4) and "permission denied" in message
            and "folder" in message)


@BOTH
@CURVE
def test_a_missing_key_is_told(told, lab):
    """A daemon that is slow may hang up before its greeting is out, which would tell that it wants
    a key: then it may want one."""
    def clearly():
        code, message, status = told(lab.daemon.endpoint)
        assert "wants a key" in message and "MODALD_KEYFILE" in message
        return (code, status) == ("denied", 4)
    until(clearly)


@BOTH
@CURVE
def test_a_key_that_the_daemon_does_not_know_is_told(told, lab, tmp_path):
    code, message, status = told(lab.daemon.endpoint,
                                 key_of(lab, tmp_path / "mine", zmq.curve_keypair(), lab.server[0]))
    assert (code, status) == ("denied", 4) and "our key was refused" in message


@BOTH
@CURVE
def test_the_key_of_another_daemon_is_told(told, lab, tmp_path):
    code, message, status = told(lab.daemon.endpoint,
                                 key_of(lab, tmp_path / "mine", lab.pairs["ann"],
                                        zmq.curve_keypair()[0]))
    assert (code, status) == ("denied", 4) and "server-key" in message


@BOTH
@CURVE
def test_keys_where_none_are_wanted_are_told(told, lab, daemon, tmp_path):
    code, message, status = told(daemon.endpoint,
                                 key_of(lab, tmp_path / "mine", lab.pairs["ann"], lab.server[0]))
    assert (code, status) == ("denied", 4) and "takes no keys" in message


@BOTH
def test_somebody_else_at_the_address_is_told(told):
    """A server of another kind, which hangs up."""
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()
        threading.Thread(target=hang_up, args=(listener,), daemon=True).start()
        code, message, status = told(f"tcp://127.0.0.1:{listener.getsockname()[1]}")
        listener.shutdown(socket.SHUT_RDWR)
    assert (code, status) == ("no_server", 3) and "somebody is there" in message


def hang_up(listener):
    while True:
        try:
            listener.accept()[0].close()
        except OSError:
            return


@CURVE
def test_a_host_is_told_why_its_stream_goes_nowhere(lab, daemon, tmp_path):
    """And the run is its own.  A daemon that hangs up before its reason is read gives none; after a
    few of those the host is told what it may be.
    """
    mine, own = (key_of(lab, tmp_path / name, pair, lab.server[0])
                 for name, pair in (("mine", zmq.curve_keypair()), ("own", lab.pairs["ann"])))
    cases = {"wants a key|no handshake succeeds": (lab.daemon.endpoint, {}),
             "takes no keys|no handshake succeeds": (daemon.endpoint, {"MODALD_KEYFILE": own}),
             "refused our key": (lab.daemon.endpoint, {"MODALD_KEYFILE": mine})}
    for words, (url, keys) in cases.items():
        said = told_to_a_host(url, tmp_path, 20000, **keys)
        assert [line for line in said if re.search(words, line)], said


@CURVE
def test_a_host_reads_the_keys_of_its_file_and_not_its_comments(lab, tmp_path):
    """Each comment names a key, before the line that gives another."""
    own = key_of(lab, tmp_path / "own", lab.pairs["ann"], lab.server[0])
    text, other = own.read_text(), zmq.curve_keypair()[0].decode()
    for name in ("public-key", "secret-key", "server-key"):
        text = re.sub(f"^{name} =", f"# until May the {name} = \"{other}\"\n  {name}  =", text,
                      flags=re.M)
    own.write_text(text)
    assert text.count(other) == 3
    assert (told_to_a_host(lab.daemon.endpoint, tmp_path, 2000, MODALD_KEYFILE=own,
                           MODALD_CLOSE_WAIT=PATIENCE) == [])


def test_a_host_is_told_of_somebody_who_only_hangs_up(tmp_path):
    """Once, however often it happens."""
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()
        threading.Thread(target=hang_up, args=(listener,), daemon=True).start()
        said = told_to_a_host(f"tcp://127.0.0.1:{listener.getsockname()[1]}", tmp_path, 10000)
        listener.shutdown(socket.SHUT_RDWR)
    assert (["no handshake succeeds" in line for line in said if "somebody is there" in line]
            == [True]), said


def told_to_a_host(url, folder, steps, **keys):
    """The lines on stderr of a run of so many steps of half a millisecond."""
    run = subprocess.run([str(BUILD / "fault" / "hosts"), "plain", str(steps), "0.0005"],
                         capture_output=True, timeout=PATIENCE,
                         env=environment(**{"MODALD_URL": url, "MODALD_SPILL": folder,
                                            "MODALD_CLOSE_WAIT": "0.2", **keys}))
    assert run.returncode == 7, run.stderr
    return run.stderr.decode().splitlines()
