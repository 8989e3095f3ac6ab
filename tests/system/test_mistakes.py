"""What a newcomer gets wrong is told as what it is, with what is accepted; nothing is read as
something else."""
# Tests as well: folder.c config.c csv.c signals.c
import json
import subprocess

import h5py
import numpy as np
import pytest
import modald
from conftest import BUILD, PATIENCE, environment
from modald.link import endpoint_fault

T = np.arange(200) * 0.01
Y = np.exp(-0.3 * T) * np.cos(31 * T)


def said(tmp_path, program, *words, status=2):
    done = subprocess.run([BUILD / "bin" / program, *map(str, words)], capture_output=True,
                          text=True, timeout=PATIENCE, env=environment(), cwd=tmp_path)
    assert done.returncode == status, done
    return done.stderr


def table(path, head, times=T, mark=b""):
    rows = "\n".join(f"{t:.9g},{y:.9g}" for t, y in zip(times, Y))
    path.write_bytes(mark + f"{head}\n{rows}\n".encode())


@pytest.mark.parametrize("head, unit", [("time_ms,a", "ms"), ("Time [ms],a", "ms"),
                                        ("t (min),a", "min"), ("t,a\n(us),(m)", "us"),
                                        ("t [\u00b5s],a", "\u00b5s")])
def test_times_in_another_unit_than_seconds_are_refused_with_the_unit(head, unit, tmp_path):
    """They were taken for seconds, and every frequency was wrong by that factor."""
    table(tmp_path / "x.csv", head)
    text = said(tmp_path, "modalctl", "--local", "identify", "x.csv")
    assert f"in {unit};" in text and "--dt SECONDS with --ignore-time" in text, text


@pytest.mark.parametrize("head", ["time_s,a", "Time [s],a", "t (sec),a", "t,a\n(s),(ms)",
                                  "time_stamp,a"])
def test_times_in_seconds_are_times_however_they_say_so(head, tmp_path):
    table(tmp_path / "x.csv", head)
    said(tmp_path, "modalctl", "--local", "identify", "x.csv", status=0)


def other_inputs(folder):
    (folder / "scene.json").write_text(' \n{"structure": {}}')
    (folder / "wide.csv").write_text("t,a\n0,1\n", encoding="utf-16")
    np.save(folder / "turned.npy", np.stack([Y, Y]))
    with h5py.File(folder / "x.h5", "w") as file:
        file["accel"] = Y[:, None]
    return {"scene.json": "steady", "wide.csv": "UTF-16", "turned.npy": "rows are samples",
            "x.h5": "`fs` [Hz]"}


def test_other_inputs_than_signals_are_called_what_they_are(tmp_path):
    for name, word in other_inputs(tmp_path).items():
        words = ["--dt", 0.01] if name == "turned.npy" else []
        text = said(tmp_path, "modalctl", "--local", "identify", name, *words)
        assert word in text, text


def test_signals_given_as_a_scene_are_no_scene_and_what_is_accepted_is_said(tmp_path):
    table(tmp_path / "x.csv", "t,a")
    np.save(tmp_path / "x.npy", Y)
    (tmp_path / "list.json").write_text("[1]")
    for name in ("x.csv", "x.npy", "list.json"):
        for verb in ("steady", "floquet"):
            text = said(tmp_path, "modalctl", "--local", verb, name)
            assert f"{name} is no scene; accepted: a JSON object" in text, text
            assert "signals with identify" in text, text


@pytest.mark.parametrize("text, fault", [(b"", "is empty"), (b" \r\n", "is empty"),
                                         ("{}".encode("utf-16"), "text in UTF-16"),
                                         (b"\xfe\xff\0{\0}", "text in UTF-16")])
def test_an_empty_scene_and_one_in_utf_16_are_called_so(text, fault, tmp_path):
    """They were taken for signals."""
    (tmp_path / "s.json").write_bytes(text)
    told = said(tmp_path, "modalctl", "--local", "steady", "s.json")
    assert fault in told and "accepted: " in told and "identify" not in told, told


def test_a_port_of_many_digits_is_their_number():
    assert endpoint_fault("tcp://h:000000005555") == ""
    assert endpoint_fault("tcp://h:" + 400 * "9") == "ends in no port of 1 to 65535"


@pytest.mark.parametrize("server, fault", [
    ("localhost:99", "begins with neither ipc:// nor tcp://"), ("/run/s", "begins with neither"),
    ("http://localhost:99", "begins with neither"), ("tcp://localhost", "ends in no port"),
    ("tcp://localhost:0", "ends in no port"), ("tcp://localhost:65545", "ends in no port"),
    ("tcp://localhost:9x", "ends in no port"), ("ipc://", "has no path")])
def test_a_server_that_is_none_is_told_what_it_lacks_by_modalctl_and_by_python(server, fault,
                                                                             tmp_path):
    """A port beyond 65535 was taken modulo 65536."""
    told = f'"{server}" {fault}'
    text = said(tmp_path, "modalctl", "--server", server, "stats")
    assert told in text and "accepted: ipc://PATH or tcp://HOST:PORT" in text, text
    with pytest.raises(modald.Error) as why:
        modald.Client(server)
    assert (why.value.code, why.value.field) == ("bad_input", "server")
    assert told in str(why.value) and "accepted: ipc://PATH or tcp://HOST:PORT" in str(why.value)


def test_words_of_another_form_are_told_with_one_that_is_accepted(tmp_path):
    table(tmp_path / "x.csv", "t,a")
    assert "SECONDS" in said(tmp_path, "modalctl", "identify", "x.csv", "--dt", "10ms")
    assert "takes none, not 1 argument" in said(tmp_path, "modalctl", "stats", "x")
    (tmp_path / "s.json").write_text(json.dumps(
        {"structure": {"type": "chain", "masses": [1], "springs": [1, 0]}, "omega": 2,
         "excitation": [{"dof": "x1", "cos": 1}]}))
    text = said(tmp_path, "modalctl", "--local", "steady", "s.json", "--sweep", "1:2:3")
    assert "such as omega=1:2:20" in text


def test_a_byte_order_mark_is_no_part_of_a_list_or_a_configuration(tmp_path):
    mark = b"\xef\xbb\xbf"
    table(tmp_path / "x.csv", "t,a", mark=mark)
    said(tmp_path, "modalctl", "--local", "identify", "x.csv", status=0)
    (tmp_path / "list").write_bytes(mark + b'{"kind": "none"}\n')
    assert "line[1].file is missing" in said(tmp_path, "modalctl", "submit", "--from", "list",
                                               "--server", "ipc://none")
    (tmp_path / "c").write_bytes(mark + b"workers = 2\n")
    said(tmp_path, "modald", "--config", "c", "--data", "d", "--bind", "ipc://s", "--check-config",
         status=0)


def test_a_data_folder_that_cannot_be_is_named_with_its_key_and_what_is_accepted(tmp_path):
    (tmp_path / "file").touch()
    (tmp_path / "link").symlink_to("nowhere")
    for path, why in {"file": "is no folder", "link": "is a link to nothing",
                      "no/such": "No such file", "file/x": "Not a directory"}.items():
        done = subprocess.run([BUILD / "bin" / "modald", "--data", path, "--bind", "ipc://s"],
                              capture_output=True, text=True, timeout=PATIENCE, cwd=tmp_path)
        assert done.returncode != 0 and 'field="data"' in done.stderr, done
        assert path in done.stderr and why in done.stderr and "accepted:" in done.stderr
