"""What modalctl writes: whole, where it was asked to, and over nothing else."""
# Tests as well: whole_file.c output.c
import json
import os
import socket
import subprocess

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


def write(out):
    done = subprocess.run([CTL, "--local", "--json", *words(out)], capture_output=True, text=True,
                          env=environment(), timeout=PATIENCE)
    return done.returncode, json.loads(done.stdout)


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


@pytest.mark.parametrize("kind", ["fifo", "folder", "link", "socket"])
@pytest.mark.parametrize("name", ["a.csv", "a.h5", "result.h5", "a.svg", "modes.prom"])
def test_nothing_but_a_file_is_replaced(kind, name, folder):
    """Root's -O /dev/null took the machine its /dev/null."""
    make(kind, folder / name)
    before = (folder / name).lstat()
    if name == "modes.prom":
        done = subprocess.run([CTL, "--json", "--server", f"ipc://{folder}/nobody", "watch", "x",
                               "--prometheus", name], capture_output=True, timeout=PATIENCE)
        status, said = done.returncode, json.loads(done.stdout)
    else:
        status, said = write(folder / name)
    assert status == 2 and said["error"]["field"] in ("output", "plot", "prometheus"), said
    assert (folder / name).lstat() == before


def test_python_reads_a_file_whose_name_is_like_an_option(folder):
    (folder / "in.h5").rename("--help")
    assert modald.read("--help").signals.shape[0] == 100
    with pytest.raises(modald.Error):
        modald.read("in\0.h5")
