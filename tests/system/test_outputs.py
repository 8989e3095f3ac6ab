"""What modalctl writes: whole, where it was asked to, and over nothing else."""
# Tests as well: whole_file.c output.c
import errno
import json
import os
import pathlib
import re
import resource
import signal
import socket
import subprocess
import tempfile
import time

import pytest

import modald
from conftest import BUILD, PATIENCE, decay, environment, write_batch


CTL = str(BUILD / "bin" / "modalctl")
SCENE = {"structure": {"type": "chain", "masses": [1], "springs": [100, 0], "dampers": [0.4, 0]},
         "excitation": [{"dof": "x1", "k": 1, "cos": 1}], "omega": 5}


@pytest.fixture()
def folder(tmp_path, monkeypatch):
    write_batch(tmp_path / "in.h5", decay(100))
    (tmp_path / "scene.json").write_text(json.dumps(SCENE))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def words(out):
    """modalctl's that write OUT."""
    if out.name == "result.h5":
        return ["steady", "scene.json", "-O", str(out)]
    return ["identify", "in.h5", "--plot", str(out)] if out.suffix == ".svg" else [
        "export", "in.h5", "-O", str(out)]


def write(out, **how):
    done = subprocess.run([CTL, "--local", "--json", *words(out)], capture_output=True, text=True,
                          env=environment(), timeout=PATIENCE, **how)
    return done.returncode, json.loads(done.stdout)


NOBODY = 65534
PERSON = {"user": NOBODY, "group": NOBODY, "extra_groups": []} if os.geteuid() == 0 else {}


@pytest.fixture()
def home(monkeypatch):
    """A folder of a PERSON who is not root."""
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        write_batch(folder / "in.h5", decay(100))
        (folder / "scene.json").write_text(json.dumps(SCENE))
        for path in (folder, *folder.iterdir()):
            path.chmod(0o755)
            if PERSON:
                os.chown(path, NOBODY, NOBODY)
        monkeypatch.chdir(folder)
        try:
            subprocess.run([CTL, "--version"], check=True, stdout=subprocess.DEVNULL, **PERSON)
        except PermissionError:
            pytest.skip("the build cannot be read by others")
        yield folder


OUTPUTS = ["a.csv", "a.h5", "result.h5", "a.svg"]


@pytest.mark.parametrize("name", OUTPUTS)
def test_no_file_beside_an_output_is_touched(name, folder):
    """Of the names that are written to first before they are moved, or were."""
    for end in ("new", "tmp", "part"):
        (folder / f"{name}.{end}").write_text("another's")
    before = set(folder.iterdir())
    assert write(folder / name)[0] == 0
    assert set(folder.iterdir()) == before | {folder / name}
    assert all((folder / f"{name}.{end}").read_text() == "another's"
               for end in ("new", "tmp", "part"))


@pytest.mark.parametrize("name", OUTPUTS)
def test_an_output_that_is_a_link_is_written_where_it_leads_with_the_mode_that_was_there(
        name, folder):
    there = folder / "elsewhere"
    there.mkdir()
    (there / "file").write_text("old")
    (there / "file").chmod(0o600)
    (folder / name).symlink_to(there / "file")
    assert write(folder / name)[0] == 0
    assert (folder / name).is_symlink() and (there / "file").read_bytes() != b"old"
    assert (there / "file").stat().st_mode & 0o777 == 0o600
    assert [f.name for f in there.iterdir()] == ["file"]


@pytest.mark.parametrize("name", ["a.csv", "a.h5"])
def test_a_file_that_may_not_be_written_is_replaced_where_its_folder_may(name, home):
    (home / name).write_text("old")
    (home / name).chmod(0o444)
    if PERSON:
        os.chown(home / name, NOBODY, NOBODY)
    status, said = write(home / name, **PERSON)
    assert status == 0, said
    assert (home / name).read_bytes() != b"old"
    assert (home / name).stat().st_mode & 0o777 == 0o444


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give files to others")
@pytest.mark.parametrize("name", ["a.csv", "a.h5"])
def test_whose_a_file_was_it_stays(name, home):
    (home / name).write_text("old")
    (home / name).chmod(0o640)
    os.chown(home / name, NOBODY, 1)
    assert write(home / name)[0] == 0
    now = (home / name).stat()
    assert (now.st_uid, now.st_gid, now.st_mode & 0o777) == (NOBODY, 1, 0o640)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give files to others")
def test_no_group_is_given_what_another_had(home):
    """Who is in it not cannot give a file to a group."""
    (home / "a.csv").write_text("old")
    (home / "a.csv").chmod(0o664)
    os.chown(home / "a.csv", NOBODY, 1)
    assert write(home / "a.csv", **PERSON)[0] == 0
    now = (home / "a.csv").stat()
    assert (now.st_gid, now.st_mode & 0o777) == (NOBODY, 0o604)


def refused(out, **how):
    """What is said of OUT before anything is read."""
    (out.parent / "in.h5").unlink()
    status, said = write(out, **how)
    assert status == 2 and said["error"]["field"] == "output", said
    return said["error"]["message"]


def test_a_link_into_a_folder_that_cannot_be_written_is_told_before_the_work(home):
    closed = home / "closed"
    closed.mkdir()
    (closed / "file").write_text("old")
    (home / "a.csv").symlink_to(closed / "file")
    closed.chmod(0o555)
    assert os.strerror(errno.EACCES) in refused(home / "a.csv", **PERSON)


@pytest.mark.parametrize("why", [errno.EACCES, errno.ELOOP, errno.ENAMETOOLONG])
def test_why_an_output_cannot_be_is_told_before_the_work(why, home):
    out = home / "a.csv"
    if why == errno.EACCES:
        (home / "closed").mkdir()
        (home / "closed" / "file").write_text("old")
        out.symlink_to(home / "closed" / "file")
        (home / "closed").chmod(0)
    elif why == errno.ELOOP:
        out.symlink_to("a.csv")
    else:
        out = home / ("n" * 252 + ".csv")
    assert os.strerror(why) in refused(out, **PERSON)


@pytest.mark.parametrize("end", [".csv", ".h5"])
def test_an_output_s_name_can_be_as_long_as_names_are(end, folder):
    out = folder / ("n" * (255 - len(end)) + end)
    assert write(out)[0] == 0
    assert out.exists()


def few_bytes():
    resource.setrlimit(resource.RLIMIT_FSIZE, (512, 512))


@pytest.mark.parametrize("name", ["a.csv", "a.h5"])
def test_a_signal_of_the_system_s_leaves_nothing_of_an_output(name, folder):
    before = set(folder.iterdir())
    done = subprocess.run([CTL, "--local", *words(folder / name)], preexec_fn=few_bytes,
                          capture_output=True, timeout=PATIENCE, env=environment())
    assert done.returncode == -signal.SIGXFSZ, done
    assert set(folder.iterdir()) == before


@pytest.mark.parametrize("by", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_what_is_written_and_leaves_nothing_of_it(by, folder):
    """A list's second input is a FIFO that nobody writes to."""
    os.mkfifo(folder / "never")
    (folder / "list").write_text("".join(
        json.dumps({"kind": "identify", "file": name}) + "\n" for name in ("in.h5", "never")))
    child = subprocess.Popen([CTL, "submit", "--from", "list", "--sbatch", "out"],
                             env=environment())
    end = time.monotonic() + PATIENCE
    while not ((folder / "out").is_dir() and any((folder / "out").iterdir())):
        assert child.poll() is None and time.monotonic() < end
        time.sleep(0.005)
    child.send_signal(by)
    assert child.wait(PATIENCE) == -by
    assert not list((folder / "out").iterdir())


@pytest.fixture()
def begun(folder):
    """What `begun.pid` is writing in `out`: a list's second input is a FIFO that nobody writes to,
    so that its first file stays open."""
    os.mkfifo(folder / "never")
    (folder / "list").write_text("".join(
        json.dumps({"kind": "identify", "file": name}) + "\n" for name in ("in.h5", "never")))
    child = subprocess.Popen([CTL, "submit", "--from", "list", "--sbatch", "out"],
                             env=environment())
    out, end = folder / "out", time.monotonic() + PATIENCE
    try:
        while not (out.is_dir() and list(out.glob(".modalctl-*"))):
            assert child.poll() is None and time.monotonic() < end
            time.sleep(0.005)
        yield child
    finally:
        child.kill()
        child.wait()


def test_what_a_killed_writer_left_goes_with_the_next_and_what_is_being_written_does_not(begun,
                                                                                       folder):
    out = folder / "out"
    before = set(out.iterdir())
    for end in ("csv", "h5"):
        assert write(out / f"a.{end}")[0] == 0
    beside = {out / "a.csv", out / "a.h5"}
    assert set(out.iterdir()) == before | beside
    begun.kill()
    begun.wait()
    assert set(out.iterdir()) == before | beside
    assert write(out / "a.h5")[0] == 0
    assert set(out.iterdir()) == beside


def test_no_file_goes_but_one_that_a_killed_writer_of_this_machine_s_life_made(begun, folder):
    out = folder / "out"
    left, = (path.name for path in out.glob(".modalctl-*"))
    begun.kill()
    begun.wait()
    tag, life, space, pid, number = re.fullmatch(
        r"([.]modalctl)-([0-9a-f-]{36})-(\d+)-(\d+)-([0-9a-f]{16})", left).groups()
    others = {f"{tag}-mine.h5", f"{tag}-notes.txt", f"{tag}-{pid}-0", f"{tag}-{pid}-{number}",
              f"{left}.h5", f"{left}0", left[:-1], left[1:],
              f"{tag}-{life}-{space}-0{pid}-{number}",
              f"{tag}-{life}-{space}--{pid}-{number}", f"{tag}-{life}-{space}-{pid}-{'G' * 16}",
              f"{tag}-{life}-{int(space) + 1}-{pid}-{number}",
              f"{tag}-{life[::-1]}-{space}-{pid}-{number}"}
    for name in others:
        (out / name).write_text("a person's")
    link, fifo, inner = (f"{tag}-{life}-{space}-{pid}-{n:016x}" for n in range(3))
    (out / link).symlink_to("../in.h5")
    os.mkfifo(out / fifo)
    (out / inner).mkdir()
    before = set(out.iterdir())
    assert write(out / "a.csv")[0] == 0
    assert set(out.iterdir()) == before - {out / left} | {out / "a.csv"}


@pytest.mark.parametrize("whether", ["TRUE", "BEST_EFFORT", "FALSE"])
@pytest.mark.parametrize("name", ["a.h5", "result.h5"])
def test_an_output_is_written_whether_hdf5_locks_files_or_not(name, whether, folder, monkeypatch):
    monkeypatch.setenv("HDF5_USE_FILE_LOCKING", whether)
    assert write(folder / name)[0] == 0
    assert (folder / name).stat().st_size > 0


def make(kind, path):
    if kind == "fifo":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    elif kind == "link":
        path.symlink_to("nowhere")
    else:
        with socket.socket(socket.AF_UNIX) as s:
            s.bind(str(path))


def identity(path):
    """All but when it was looked at."""
    about = path.lstat()
    return about.st_ino, about.st_mode, about.st_size, about.st_mtime_ns


@pytest.mark.parametrize("kind", ["fifo", "folder", "link", "socket"])
@pytest.mark.parametrize("name", ["a.csv", "a.h5", "result.h5", "a.svg", "modes.prom"])
def test_nothing_but_a_file_is_replaced(kind, name, folder):
    """Root's -O /dev/null took the machine its /dev/null."""
    make(kind, folder / name)
    before = identity(folder / name)
    if name == "modes.prom":
        done = subprocess.run([CTL, "--json", "--server", f"ipc://{folder}/nobody", "watch", "x",
                               "--prometheus", name], capture_output=True, timeout=PATIENCE)
        status, said = done.returncode, json.loads(done.stdout)
    else:
        status, said = write(folder / name)
    assert status == 2 and said["error"]["field"] in ("output", "plot", "prometheus"), said
    assert identity(folder / name) == before


def test_python_reads_a_file_whose_name_is_like_an_option(folder):
    (folder / "in.h5").rename("--help")
    assert modald.read("--help").signals.shape[0] == 100
    with pytest.raises(modald.Error):
        modald.read("in\0.h5")
