"""modalctl: exit statuses, one document, bad input by name, and the same numbers whichever way a
job runs."""
import csv
import json
import math
import os
import pathlib
import re
import signal
import subprocess
import wave

import h5py
import numpy as np
import pytest
from conftest import (BUILD, PATIENCE, SLOW_WORDS, TOP, decay, environment, terminal,
                      write_batch)

import modald

NUMBERS = ("modes", "stability", "rank", "reconstruction", "order", "clusters", "offset")


def numbers(result):
    """What a result says of the system; cost and host are the run's own."""
    return {key: result[key] for key in NUMBERS if key in result}


def test_a_known_batch_gives_its_modes(ctl, batch):
    said = ctl("identify", batch, "-o", "rank.fixed=4")
    assert said.status == 0
    found = sorted((m["frequency_hz"], m["damping_ratio"]) for m in said.document["modes"])
    # a clean sum of two modes is exact to the condition of its Hankel matrix times rounding: 1e-10
    # is far above it
    assert np.allclose(found, [(1.0, 0.01), (2.3, 0.005)], rtol=1e-10)


@pytest.mark.parametrize("which", ["batch", "large_batch"])
def test_the_four_ways_give_the_same_numbers_to_the_last_bit(which, ctl, daemon, client, request):
    path = request.getfixturevalue(which)
    read = modald.Batch.read(path)
    local = ctl("identify", path, "-o", "rank.fixed=4", "shapes=true").document
    served = ctl("identify", path, "-o", "rank.fixed=4", "shapes=true", server=daemon).document
    python = client.identify(read, options={"rank.fixed": 4, "shapes": True}, fresh=True)
    raw = subprocess.run([str(BUILD / "examples" / "example_identify"), str(read.signals.shape[1]),
                          repr(read.dt), '{"rank.fixed":4,"shapes":true}'],
                         input=read.signals.tobytes(), capture_output=True,
                         env=environment(MODALD_URL=daemon.endpoint), timeout=PATIENCE)
    assert raw.returncode == 0, raw.stderr
    inc = json.loads(raw.stdout)
    assert numbers(local) == numbers(served) == numbers(python)
    assert local["modes"] == inc["modes"]
    assert (local["provenance"]["input_sha256"] == served["provenance"]["input_sha256"]
            == read.sha256())


# in the request's body, and by upload
@pytest.mark.parametrize("samples", [500, 5000])
def test_files_of_equal_data_are_answered_each_with_its_own_attributes(samples, ctl, client, daemon,
                                                                       tmp_path):
    """Whatever the answer shows makes another answer; only an equal file gets the kept one."""
    signals = decay(samples)
    first = {"channels": ["a", "b"], "units": "m", "rig": "one"}

    def answer(name, more):
        path = tmp_path / f"{name}.h5"
        with h5py.File(path, "w") as f:
            f["signals"] = signals
            f["signals"].attrs.update({"dt": 0.02, **first, **more})
        said = ctl("submit", "identify", str(path), "-o", "rank.fixed=4", "--wait", server=daemon)
        assert said.status == 0
        return path, said.document
    path, doc = answer("first", {})
    for name, more in [("rig", {"rig": "two"}), ("units", {"units": "ft"}),
                       ("channels", {"channels": ["a", "c"]}),
                       ("dt", {"dt": 0.04}), ("period", {"period": 1.0}), ("added", {"note": "x"})]:
        changed, other = answer(name, more)
        assert "cached" not in other, name
        local = ctl("identify", changed, "-o", "rank.fixed=4").document["provenance"]
        served = other["result"]["provenance"]
        assert ({k: served.get(k) for k in ("input", "attributes")}
                == {k: local.get(k) for k in ("input", "attributes")}), name
    assert client.submit("identify", modald.Batch.read(path),
                         options={"rank.fixed":
                                  4}).result()["provenance"] == doc["result"]["provenance"]
    assert answer("again", {})[1]["cached"] is True


def test_without_json_a_table_is_printed(batch):
    done = subprocess.run([str(BUILD / "bin" / "modalctl"), "--local", "identify", batch, "-o",
                           "rank.fixed=4"], capture_output=True, text=True, env=environment())
    assert (done.returncode == 0 and "damping ratio" in done.stdout and "2.3" in done.stdout
            and done.stderr == "")


# -- exit statuses
# --------------------------------------------------------------------------------------------------

@pytest.mark.parametrize("words", [["--version"], ["help", "scene"], ["--local", "identify"],
                                   ["--local", "--json", "identify"]])
@pytest.mark.parametrize("lost", ["/dev/full", "closed", "nobody reads"])
def test_an_answer_that_could_not_be_written_is_no_success_unless_its_reader_had_enough(
        batch, words, lost):
    """A disk that is full, and a stdout that the shell closed (>&-), whose number a file that is
    read would have."""
    words = [str(BUILD / "bin" / "modalctl"), *words,
             *([str(batch)] if words[-1] == "identify" else [])]
    reader, writer = os.pipe()
    os.close(reader)
    with open("/dev/full", "wb") as full:
        done = subprocess.run(["sh", "-c", '"$@" >&-', "sh", *words] if lost == "closed" else words,
                              stdout={"/dev/full": full, "closed": None}.get(lost, writer),
                              stderr=subprocess.PIPE, env=environment(), timeout=PATIENCE)
    os.close(writer)
    if lost == "nobody reads" and "--json" not in words:
        assert (done.returncode, done.stderr) == (0, b"")
    elif lost != "nobody reads":
        assert done.returncode == 1 and b"stdout" in done.stderr


def test_no_server_is_3(ctl, batch, tmp_path):
    for words in (["list"], ["identify", batch], ["submit", "identify", batch, "--wait"]):
        said = ctl(*words, server=f"ipc://{tmp_path}/nobody")
        assert said.status == 3 and said.document["error"]["code"] == "no_server"


def test_the_server_comes_from_the_environment(daemon, batch):
    done = subprocess.run([str(BUILD / "bin" / "modalctl"), "--json", "whoami"],
                          capture_output=True, text=True,
                          env=environment(MODALD_URL=daemon.endpoint))
    assert done.returncode == 0 and json.loads(done.stdout)["role"] == "admin"


def test_refusals_are_4(ctl, daemon, batch):
    for verb in ("status", "wait", "result", "cancel", "retry", "delete"):
        said = ctl(verb, "nosuchjob", server=daemon)
        assert said.status == 4 and said.document["error"]["code"] == "not_found", verb
    assert ctl("submit", "identify", batch, "--key", "taken", server=daemon).status == 0
    said = ctl("submit", "identify", batch, "--key", "taken", "-o", "rank.fixed=2", server=daemon)
    assert said.status == 4 and said.document["error"]["code"] == "conflict"


def test_not_finished_in_time_is_5_and_the_document_says_where_it_is(ctl, daemon, slow_batch):
    for seconds in (0.3, 3, 30):                    # a busy machine may take the first to submit it
        said = ctl("submit", "identify", slow_batch, *SLOW_WORDS, "--wait", "--timeout", seconds,
                   server=daemon)
        if "job" in said.document:
            break
    assert (said.status == 5 and said.document["state"] in ("queued", "running")
            and said.document["error"]["code"] == "timeout")
    job = said.document["job"]
    assert ctl("wait", job, "--timeout", "0", server=daemon).status == 5
    assert ctl("cancel", job, server=daemon).document["state"] == "cancelled"
    said = ctl("wait", job, server=daemon)
    assert (said.status == 1 and said.document["state"] == "cancelled"
            and said.document["error"]["code"] == "cancelled")


@pytest.mark.parametrize("option,status,code",
                         [("--timeout", 5, "timeout"), ("--run-limit", 1, "run_limit")])
def test_a_limit_ends_a_local_job_within_a_stage_that_asks_nobody(ctl, tmp_path, option, status,
                                                                  code):
    """1600 eigenvalues in one call of LAPACK's, which takes many times the limit: it ends as a
    daemon's job does."""
    chain = {"structure": {"type": "chain", "masses": [1] * 800, "springs": [1] * 801,
                           "dampers": [0.01] * 801}}
    (tmp_path / "chain.json").write_text(json.dumps(chain))
    said = ctl("floquet", tmp_path / "chain.json", option, "0.02")
    assert (said.status == status and said.document["error"]["code"] == code
            and "0.02 s" in said.document["error"]["message"])


def test_a_local_job_that_ends_in_time_has_its_result(ctl, batch):
    said = ctl("identify", batch, "--timeout", "1000", "--run-limit", "999")
    assert said.status == 0 and said.document["modes"]


def test_no_patience_is_enough_for_what_is_there(ctl, daemon, batch, slow_batch):
    job = ctl("submit", "identify", batch, "--wait", server=daemon).document["job"]
    for _ in range(5):
        said = ctl("wait", job, "--timeout", "0", server=daemon)
        assert said.status == 0 and said.document["result"]["modes"], said.document
    for words in (["status", job], ["result", job], ["submit", "identify", batch]):
        assert ctl(*words, "--timeout", "0", server=daemon).status == 0, words
    assert ctl("identify", slow_batch, "--timeout", "0",
               server=daemon).document["error"]["code"] == "timeout"


def test_a_job_that_fails_is_known_by_its_status_wherever_it_failed(ctl, daemon, tmp_path):
    path = write_batch(tmp_path / "nan.h5",
                       np.where(np.arange(40)[:, None] == 17, np.nan, decay(40)))
    for said in (ctl("identify", path), ctl("identify", path, server=daemon),
                 ctl("submit", "identify", path, "--wait", server=daemon)):
        assert said.status == 2
        assert (said.document["error"]["code"] == "bad_input" and said.document["error"]["field"]
                == "signals")
        assert "17" in said.document["error"]["message"]


# -- bad input
# --------------------------------------------------------------------------------------------------

def bad_files(folder):
    good = decay(100)
    (folder / "text.h5").write_text("this is no HDF5\n")
    whole = pathlib.Path(write_batch(folder / "whole.h5", decay(4000))).read_bytes()
    (folder / "cut.h5").write_bytes(whole[:len(whole) // 2])
    with h5py.File(folder / "words.h5", "w") as file:
        file.create_dataset("signals", data=np.array([[b"a", b"b"]] * 20)).attrs["dt"] = 0.1
    write_batch(folder / "cube.h5", np.zeros((20, 2, 2)))
    with h5py.File(folder / "other.h5", "w") as file:
        file.create_dataset("data", data=good).attrs["dt"] = 0.1
        file["more"] = good
    write_batch(folder / "short.h5", good[:5])
    write_batch(folder / "flat.h5", np.ones((100, 2)))
    write_batch(folder / "period.h5", good, period=4.0)
    write_batch(folder / "good.h5", good)
    (folder / "uneven.csv").write_text("t,y\n" + "".join(f"{0.1 * k * k},{k}\n" for k in range(20)))
    (folder / "back.csv").write_text("t,y\n" + "".join(f"{9 - k},{k}\n" for k in range(20)))
    (folder / "hex.csv").write_text("t,y\n" + "".join(f"{k},{k:#x}\n" for k in range(20)))
    write_batch(folder / "tiny.h5", good, dt=1e-300)
    (folder / "row.csv").write_text("y\n1\nx\n")
    (folder / "notime.csv").write_text("y\n1\n2\n3\n")


@pytest.mark.parametrize("name, options, field", [
    ("absent.h5", [], "file"), (".", [], "file"), ("text.h5", [], None), ("cut.h5", [], None),
    ("words.h5", [], "signals"), ("cube.h5", [], "signals"),
    ("other.h5", [], "dataset"), ("short.h5", [], "signals"), ("flat.h5", [], "signals"),
    ("period.h5", [], "period"),
    ("good.h5", ["no.such=1"], "no.such"), ("good.h5", ["rank.fixed=-1"], "rank.fixed"),
    ("good.h5", ["rank.fixed=1e999"], "rank.fixed"),
    ("good.h5", ["rank.fixed=many"], "rank.fixed"), ("good.h5", ["method=magic"], "method"),
    ("good.h5", ["rows=200"], "rows"),
    ("good.h5", ["columns=5000"], "columns"), ("good.h5", ["band=5"], "band"),
    ("good.h5", ["window=9,1"], "window"), ("good.h5", ["band=-1,5"], "band"),
    ("good.h5", ["period=1000"], "period"),
    ("uneven.csv", [], "time"), ("back.csv", [], "time"), ("hex.csv", [], "signals"),
    ("row.csv", [], "signals"), ("notime.csv", [], "dt"), ("tiny.h5", [], "dt"),
])
def test_bad_input_names_its_field(name, options, field, ctl, daemon, tmp_path):
    bad_files(tmp_path)
    words = [word for option in options for word in ("-o", option)]
    for server in (None, daemon):
        said = ctl("identify", tmp_path / name, *words, server=server)
        error = said.document["error"]
        assert said.status == 2 and error["code"] == "bad_input", said.document
        assert error["field"] and (field is None or error["field"] == field), error


def piped(path, name):
    done = subprocess.run(f"cat {path} | {BUILD}/bin/modalctl --local --json identify {name}",
                          shell=True, capture_output=True, timeout=PATIENCE, env=environment())
    return done.returncode, json.loads(done.stdout)


@pytest.mark.parametrize("name", ["-", "/dev/stdin"])
def test_text_may_come_by_a_pipe_and_hdf5_says_that_it_may_not(name, tmp_path):
    # as Fortran prints
    rows = "".join(f"{k / 100:.2f}D0,{y:.15e}\n".replace("e", "D") for k,
                   y in enumerate(decay(60)[:, 0]))
    (tmp_path / "x.csv").write_text("t,a\n" + rows)
    status, result = piped(tmp_path / "x.csv", name)
    assert status == 0 and abs(result["provenance"]["input"]["dt"] - 0.01) < 1e-12, result
    status, result = piped(write_batch(tmp_path / "x.h5", decay(400)), name)
    assert status == 2 and result["error"]["field"] == "file", result


def test_a_step_that_an_hdf5_file_does_not_say_is_given_by_dt(ctl, tmp_path):
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file.create_dataset("signals", data=decay(400))
    assert ctl("identify", tmp_path / "x.h5").document["error"]["field"] == "dt"
    assert ctl("identify", tmp_path / "x.h5", "--dt",
               "0.125").document["provenance"]["input"]["dt"] == 0.125


@pytest.mark.parametrize("kind", ["text", "bare", "hdf5", "wav"])
def test_a_step_that_differs_from_the_files_own_is_refused_and_the_files_own_is_not(ctl, tmp_path,
                                                                                    kind):
    """Half a unit of the last digit over 399 steps of 0.01 s, printed to 1e-4: 1.25e-7 s; binary
    numbers: 1e-9 of the step."""
    y, path = decay(400), tmp_path / f"x.{kind}"
    if kind == "hdf5":
        write_batch(path, y)
        with h5py.File(path) as file:
            dt = float(file["signals"].attrs["dt"])
    elif kind == "wav":
        dt = 1 / 8000
        with wave.open(str(path), "wb") as file:
            file.setparams((1, 2, 8000, 0, "NONE", ""))
            file.writeframes((20000 * y[:, 0] / abs(y).max()).astype("<i2").tobytes())
    else:
        dt = 0.01
        rows = "".join(f"{k / 100:.4f} {v:.9e}\n" for k, v in enumerate(y[:, 0]))
        path.write_text(rows if kind == "bare" else "t a\n" + rows)
    near = 1 + (1e-5 if kind in ("text", "bare") else 5e-10)
    for given in (dt, dt * near):
        got = ctl("identify", path, "--dt", f"{given:.17g}")
        assert got.status == 0 and got.document["provenance"]["input"]["dt"] == given, got.document
        assert got.document["provenance"]["input"]["channels"] == (2 if kind == "hdf5" else 1)
    for given in (2 * dt, dt * (1 + 3e-5 if kind in ("text", "bare") else 1 + 2e-9)):
        got = ctl("identify", path, "--dt", f"{given:.17g}")
        error = got.document["error"]
        assert (got.status == 2 and error["code"] == "bad_input" and error["field"]
                == "dt"), got.document
        assert ("--dt is" in error["message"] and "says" in error["message"]
                and "--ignore-time" in error["message"])
    got = ctl("identify", path, "--dt", f"{2 * dt:.17g}", "--ignore-time")
    assert got.status == 0 and got.document["provenance"]["input"]["dt"] == 2 * dt
    assert ctl("identify", path, "--ignore-time").document["error"]["field"] == "dt"


def test_a_batch_read_by_python_keeps_its_own_step(client, tmp_path):
    path = write_batch(tmp_path / "x.h5", decay(400))
    own = modald.Batch.read(path).dt
    assert modald.Batch.read(path, dt=own * (1 + 5e-10)).dt == own
    for refused in (lambda: modald.Batch.read(path, dt=2 * own),
                    lambda: client.identify(modald.Batch.read(path), 2 * own)):
        with pytest.raises(modald.Error) as caught:
            refused()
        assert (caught.value.code, caught.value.field) == ("bad_input", "dt")
    with h5py.File(tmp_path / "y.h5", "w") as file:
        file.create_dataset("signals", data=decay(400))
    assert modald.Batch.read(tmp_path / "y.h5", dt=0.125).dt == 0.125


def said_in_words(*words, cwd):
    done = subprocess.run([str(BUILD / "bin" / "modalctl"), "--local", *map(str, words)],
                          capture_output=True, text=True, cwd=cwd)
    return done.returncode, done.stdout, done.stderr


def test_a_message_that_names_its_field_is_not_prefixed_with_it_again(tmp_path):
    path = write_batch(tmp_path / "x.h5", decay(400))
    status, _, words = said_in_words("identify", path, "-o", "signals=nose", cwd=tmp_path)
    assert (status == 2
            and words.startswith('modalctl: bad_input: signals: no channel "nose"')), words
    status, _, words = said_in_words("identify", path, "-o", "shape=true", cwd=tmp_path)
    assert (status == 2
            and words.startswith('modalctl: bad_input: shape: unknown key "shape"; did you mean '
                                 'shapes?')), words


def test_a_sweeps_table_says_why_a_cell_is_empty(tmp_path):
    friction = {"structure": {"type": "chain", "masses": [1], "springs": [1, 0]}, "omega": 1.0,
                "effects": [{"type": "friction", "dof": "x1", "stiffness": 0.25, "limit": 0.25}]}
    (tmp_path / "s.json").write_text(json.dumps({"verb": "floquet", "scene": friction,
                                                 "grid": [{"path": "effects[0].limit",
                                                           "values": [0.1, 0.2]}]}))
    status, table, _ = said_in_words("sweep", "s.json", cwd=tmp_path)
    rows = [line for line in table.splitlines() if line.strip().startswith(("0.1", "0.2"))]
    assert len(rows) == 2 and all("bad_input: " in row for row in rows), (status, table)


def test_a_target_that_is_not_met_says_by_how_much(ctl, tmp_path):
    """A slider's corners make a spectrum that falls slowly: no number of harmonics reaches
    1e-12."""
    (tmp_path / "s.json").write_text(json.dumps({
        "structure": {"type": "chain", "masses": [1], "springs": [1, 0], "dampers": [0.05, 0]},
        "omega": 0.5,
        "effects": [{"type": "friction", "dof": "x1", "stiffness": 0.5, "limit": 0.1}],
        "excitation": [{"dof": "x1", "k": 1, "cos": 0.5}]}))
    notes = ctl("steady", tmp_path / "s.json", "-o", "target.error=1e-12", "-o",
                "stability=false").document["diagnostics"]
    text = next(n["message"] for n in notes if n["code"] == "target_not_met")
    found = re.search(r"is ([0-9.e+-]+) of the amplitude, ([0-9.e+-]+) times target.error 1e-12",
                      text)
    assert found and abs(float(found[1]) / 1e-12 / float(found[2]) - 1) < 0.01, text


def rows_of(path):
    """A header and numbers, as any reader of CSV has them; an empty cell is None."""
    with open(path, newline="") as file:
        head, *rows = csv.reader(file)
    return head, [[float(cell) if cell else None for cell in row] for row in rows]


CSV_SCENE = {"structure": {"type": "matrices", "M": [[1, 0], [0, 1]], "C": [[0.02, 0], [0, 0.02]],
                           "K": [[0.75, -0.1], [-0.1, 1]],
                           "dofs": ["x", "hub, \"left\""]},
             "effects": [{"type": "cubic_spring", "dof": "x", "coefficient": 0.3}], "omega": 0.25,
             "initial": {"x": {"x": 1}},
             "excitation": [{"dof": "x", "k": 1, "cos": 0.2}], "time": {"dt": 0.1, "duration": 5},
             "steady": {"harmonics": 3}}


def test_a_csv_holds_what_the_hdf5_file_holds(ctl, tmp_path):
    (tmp_path / "s.json").write_text(json.dumps(CSV_SCENE))
    dofs = CSV_SCENE["structure"]["dofs"]
    for name in ("x.csv", "x.h5"):
        assert ctl("simulate", tmp_path / "s.json", "-O", tmp_path / name).status == 0
    head, rows = rows_of(tmp_path / "x.csv")
    with h5py.File(tmp_path / "x.h5") as file:
        assert head == ["t", *dofs] and np.array_equal(np.array(rows)[:, 1:], file["signals"][...])
    assert np.allclose(np.array(rows)[:, 0], 0.1 * np.arange(51), rtol=1e-15, atol=0)
    said = ctl("steady", tmp_path / "s.json", "-O", tmp_path / "k.csv").document
    head, rows = rows_of(tmp_path / "k.csv")
    assert head == ["k", "x_re", "x_im", dofs[1] + "_re", dofs[1] + "_im"]
    assert np.array_equal(np.array(rows).T,
                          np.array([said["harmonics"][0]["k"]]
                                   + [d[p] for d in said["harmonics"] for p in ("re", "im")]))
    said = ctl("steady", tmp_path / "s.json", "-o", "time=16", "-O", tmp_path / "t.csv").document
    head, rows = rows_of(tmp_path / "t.csv")
    assert (head == ["t", *dofs]
            and np.array_equal(np.array(rows).T,
                               np.array([said["time"]["t"], *said["time"]["x"].values()])))
    said = ctl("steady", tmp_path / "s.json", "--sweep", "omega=0.2:0.4:3", "-O",
               tmp_path / "c.csv").document
    head, rows = rows_of(tmp_path / "c.csv")
    assert head[:6] == ["omega", "converged", "stable", "total_error", "x_re_0",
                        "x_im_0"] and len(head) == 4 + 2 * 2 * 4
    for row, point in zip(rows, said["points"], strict=True):
        assert row[0] == point["omega"] and row[1] == point["converged"]
        assert row[6:8] == [point["harmonics"][0]["re"][1], point["harmonics"][0]["im"][1]]


@pytest.mark.parametrize("verb", ["steady", "simulate"])
def test_an_output_of_another_suffix_is_refused_before_the_work(ctl, tmp_path, verb):
    (tmp_path / "s.json").write_text(json.dumps(CSV_SCENE))
    said = ctl(verb, tmp_path / "s.json", "-O", tmp_path / "x.mat")
    assert (said.status == 2 and said.document["error"]["field"] == "output"
            and "FILE.csv" in said.document["error"]["message"])
    assert not (tmp_path / "x.mat").exists()


def test_the_stages_of_the_contract_are_in_every_cost(ctl, tmp_path):
    noise = np.random.default_rng(7).standard_normal((300, 2))
    for x, options in ((decay(400), []), (decay(400), ["refine=false"]),
                       (decay(400), ["rank.fixed=2"]), (noise, [])):
        path = write_batch(tmp_path / "x.h5", x)
        cost = ctl("identify", path,
                   *(word for o in options for word in ("-o", o))).document["cost"]
        assert {"read", "pod", "svd", "eig", "synthesis"} <= cost["stages"].keys(), cost
        assert sum(cost["stages"].values()) <= cost["cpu_s"] * 1.001 + 1e-4


def test_two_periods_of_noise_are_said_to_be_too_few(ctl, tmp_path):
    noise = np.random.default_rng(1).normal(size=(400, 2))
    codes = [d["code"] for d in ctl("identify", write_batch(tmp_path / "x.h5", noise, period=10.0))
             .document["diagnostics"]]
    assert "too_many_unknowns" in codes and "no_modes" in codes, codes


def test_what_two_periods_are_too_few_for_is_found_by_its_lines(ctl, tmp_path):
    path = write_batch(tmp_path / "x.h5", decay(400), period=10.0)
    of_periods, of_none = (ctl("identify", path, *more).document
                           for more in ([], ["-o", "period=0"]))
    for document in (of_periods, of_none):
        found = sorted(-mode["exponent"][0] for mode in document["modes"])
        # 0.01 and 0.005 of 2 pi times 1 and 2.3 Hz
        assert np.allclose(found, 2 * np.pi * np.array([0.01, 0.0115]), rtol=1e-9), found


def test_a_steady_state_that_is_not_there_has_the_fields_of_one_that_is(ctl, tmp_path):
    scene = {"structure": {"type": "chain", "masses": [2.0], "springs": [8.0, 0.0],
                           "dampers": [0.1, 0.0]}, "omega": 2.0,
             "excitation": [{"dof": "x1", "k": 1, "cos": 1.0}]}
    (tmp_path / "a.json").write_text(json.dumps(scene))
    there = ctl("steady", tmp_path / "a.json").document
    del scene["structure"]["dampers"]                       # omega^2 = 8 / 2: undamped resonance
    (tmp_path / "b.json").write_text(json.dumps(scene))
    absent = ctl("steady", tmp_path / "b.json").document
    assert there["converged"] and not absent["converged"] and there.keys() == absent.keys()
    assert "error" not in there                             # which is what a failed job has
    assert absent["stability"] == {"stable": None, "max_multiplier": None, "multipliers": []}


def test_one_dof_is_named_as_a_list_of_one(ctl, tmp_path):
    scene = {"structure": {"type": "chain", "masses": [2.0, 1.0], "springs": [8.0, 3.0, 1.0]},
             "omega": 1.0, "excitation": [{"dof": "x1", "k": 1, "cos": 1.0}]}
    # with the mark that editors put before UTF-8
    (tmp_path / "a.json").write_text("\ufeff" + json.dumps(scene))
    alone = ctl("steady", tmp_path / "a.json", "-o", "dofs=x2").document
    assert [h["dof"] for h in alone["harmonics"]] == ["x2"]
    assert ctl("steady", tmp_path / "a.json", "-o", "dofs=x3").document["error"]["field"] == "dofs"
    assert ctl("steady", tmp_path / "a.json", "-o",
               "dofs=x2,x3").document["error"]["field"] == "dofs[1]"


def test_a_force_that_fails_names_its_place_in_the_scene(ctl, tmp_path):
    springs = [{"type": "spring", "dof": "x1", "stiffness": 1.0}] * 2
    scene = {"structure": {"type": "chain", "masses": [1.0], "springs": [2.0, 0.0]}, "omega": 1.3,
             "excitation": [{"dof": "x1", "k": 1, "cos": 1.0}],
             "effects": springs + [{"type": "lua", "dof": "x1",
                                    "source": "function force(t, x, v, memory)\n return x.y\nend"}]}
    (tmp_path / "a.json").write_text(json.dumps(scene))
    said = ctl("steady", tmp_path / "a.json")
    assert (said.status == 1 and said.document["error"]["code"] == "element_failed"
            and said.document["error"]["field"] == "effects[2].source")
    assert "source:2" in said.document["error"]["message"]


@pytest.mark.parametrize("text, field", [
    ('{"structure": {"type": "chain", "masses": [1], "springs": [1, 0], "mases": 3}, "effects": '
     '[]}', "structure.mases"),
    ('{"structure": {"type": "cube"}}', "structure.type"),
    ('{"structure": {"type": "chain", "masses": [1], "masses": [2], "springs": [1, 0]}}',
     "structure.masses"),
    ('{"structure": {"type": "chain", "masses": [NaN], "springs": [1, 0]}}', "structure.masses[0]"),
    ('{"structure": {"type": "chain", "masses": [1e999], "springs": [1, 0]}}', None),
    ('{"structure": {"type": "matrices", "file": "absent.h5"}}', "structure.file"),
    ("[1, 2]", "scene"), ("", "scene"), ('{"structure": ' + "[" * 40 + "]" * 40 + "}", None),
])
def test_a_bad_scene_names_its_path(text, field, ctl, tmp_path):
    path = tmp_path / "scene.json"
    path.write_text(text)
    said = ctl("floquet", path)
    error = said.document["error"]
    assert said.status == 2 and error["code"] == "bad_input"
    assert error["field"] and (field is None or error["field"] == field), error


@pytest.mark.parametrize("words, field", [
    ([], "verb"), (["identfy", "x.h5"], "verb"), (["identify"], "arguments"),
    (["identify", "a", "b"], "arguments"), (["tradeoff", "modes", "x.h5"], "of"),
    (["simulate", "x.json", "-O", "/no/such/folder/x.h5"], "output"),
    (["list", "--priority", "3"], "priority"),
    (["submit", "identify", "x", "--priority", "256"], "priority"),
    (["submit", "identify", "x", "--priority", "1.5"], "priority"),
    (["identify", "x", "--nonsense"], "--nonsense"), (["identify", "x", "-o"], "option"),
    (["identify", "x", "--timeout", "soon"], "timeout"),
    (["simulate", "x.json"], "output"),
    (["steady", "x.json", "--sweep", "omega=1:2:3", "--continue", "omega=1:2"], "continue"),
    (["list"], "local"),
    (["submit", "nosuchkind", "x"], "kind"),
])
def test_wrong_usage_is_2_and_named(words, field, ctl):
    said = ctl(*words)
    assert (said.status == 2 and said.document["error"]["code"] == "bad_input"
            and said.document["error"]["field"] == field)


def test_each_bad_reference_file_gets_its_error(ctl, daemon, reference):
    files = sorted(reference.glob("bad_*.h5"))
    assert len(files) >= 13
    for path in files:
        for server in (None, daemon):
            said = ctl("identify", path, server=server)
            assert (said.status == 2 and said.document["error"]["code"] == "bad_input"
                    and said.document["error"]["field"]), path
            assert "result" not in said.document and "modes" not in said.document


def test_good_reference_files_are_the_same_served_and_local(ctl, daemon, reference):
    for path in sorted(reference.glob("*.h5")):
        if path.name.startswith("bad_"):
            continue
        with h5py.File(path) as file:
            order = json.loads(file.attrs["truth"])["order"]
        local, served = (ctl("identify", path, "-o", f"rank.fixed={order}", server=server)
                         for server in (None, daemon))
        assert local.status == served.status
        assert numbers(local.document) == numbers(served.document), path.name


# -- other forms of input
# ----------------------------------------------------------------------------------------------

def test_csv_sound_and_hdf5_of_one_motion_agree(ctl, tmp_path):
    import struct
    x, rate = decay(2000, 1 / 400, ((37.0, 0.01, 0.5), (90.0, 0.003, 0.4))), 400
    rows = "".join(f"{k / rate!r};{a!r};{b!r}\n" for k,
                   (a, b) in enumerate(x.tolist())).replace(".", ",")
    (tmp_path / "a.csv").write_text("Zeit;links;rechts\n" + rows)
    data = x.astype("<f4").tobytes()                       # WAV of 32-bit floats
    head = (b"RIFF" + struct.pack("<I", 50 - 8 + len(data)) + b"WAVEfmt "
            + struct.pack("<IHHIIHH", 16, 3, 2, rate, rate * 8, 8, 32))
    (tmp_path / "a.wav").write_bytes(head + b"data" + struct.pack("<I", len(data)) + data)
    write_batch(tmp_path / "a.h5", x, 1 / rate)
    found = {}
    for name in ("a.csv", "a.wav", "a.h5"):
        said = ctl("identify", tmp_path / name, "-o", "rank.fixed=4")
        assert said.status == 0, said.document
        found[name] = sorted((m["frequency_hz"], m["damping_ratio"])
                             for m in said.document["modes"])
    assert np.allclose(found["a.csv"], found["a.h5"], rtol=1e-9)
    # 24 bits of a float: 6e-8 a sample, times the amplification of damping
    assert np.allclose(found["a.wav"], found["a.h5"], rtol=1e-4)
    assert np.allclose(found["a.h5"], [(37, 0.01), (90, 0.003)], rtol=1e-9)


def test_matrices_may_lie_in_a_file_dense_or_by_rows(ctl, tmp_path):
    m, k = np.diag([2.0, 3.0]), np.array([[700.0, -300.0], [-300.0, 300.0]])
    with h5py.File(tmp_path / "dense.h5", "w") as file:
        file["M"], file["K"] = m, k
    with h5py.File(tmp_path / "rows.h5", "w") as file:
        file["M"] = m
        file["K/data"], file["K/indices"], file["K/indptr"] = k.ravel(), np.array(
            [0, 1, 0, 1]), np.array([0, 2, 4])
    answers = []
    for structure in ({"M": m.tolist(), "K": k.tolist()}, {"file": "dense.h5"},
                      {"file": "rows.h5"}):
        (tmp_path / "scene.json").write_text(
            json.dumps({"structure": {"type": "matrices", **structure}, "effects": []}))
        said = ctl("floquet", tmp_path / "scene.json")
        assert said.status == 0, said.document
        answers.append(said.document["exponents"])
    assert answers[0] == answers[1] == answers[2]
    # |lambda|^2 are the eigenvalues of M^-1 K
    squares = np.sort(np.linalg.eigvals(np.linalg.solve(m, k)).real)
    assert np.allclose(np.unique(np.round([re * re + im * im for re, im in answers[0]], 6)),
                       squares, rtol=1e-8)


def test_a_simulated_batch_can_be_identified(ctl, daemon, tmp_path):
    scene = {"structure": {"type": "chain", "masses": [1.0], "springs": [400.0, 0],
                           "dampers": [0.8, 0]}, "effects": [],
             "initial": {"x": {"x1": 1.0}}, "time": {"dt": 0.01, "duration": 4.0}}
    (tmp_path / "scene.json").write_text(json.dumps(scene))
    for server, name in ((None, "a.h5"), (daemon, "b.h5")):
        assert ctl("simulate", tmp_path / "scene.json", "-O", tmp_path / name,
                   server=server).status == 0
        modes = ctl("identify", tmp_path / name, "-o", "rank.fixed=2").document["modes"]
        assert (abs(modes[0]["damping_ratio"] - 0.02) < 1e-6
                and abs(modes[0]["frequency_rad_s"] - 20) < 1e-4)
    with h5py.File(tmp_path / "a.h5") as a, h5py.File(tmp_path / "b.h5") as b:
        assert np.array_equal(a["signals"], b["signals"]) and len(a["signals"]) == 401


@pytest.mark.parametrize("curve", [["--sweep", "omega=0.5:2:4"], ["--continue", "omega=0.5:2"]])
def test_a_response_curve_is_the_same_served_and_local_and_has_each_key_once(curve, ctl, daemon,
                                                                             tmp_path):
    scene = {"structure": {"type": "chain", "masses": [1], "springs": [1, 0], "dampers": [0.1, 0]},
             "effects": [{"type": "cubic_spring", "dof": "x1", "coefficient": 0.5}],
             "excitation": [{"dof": "x1", "k": 1, "cos": 0.5}],
             "omega": 1.2, "steady": {"harmonics": 5}}
    (tmp_path / "scene.json").write_text(json.dumps(scene))
    local, served = (ctl("steady", tmp_path / "scene.json", *curve, server=server)
                     for server in (None, daemon))
    assert local.status == served.status == 0, served.document
    modald.wire.loads(local.out)                            # strict: no key twice
    for key in ("points", "folds", "bifurcations"):
        assert local.document[key] == served.document[key]
    assert (local.document["points"][0]["omega"] == 0.5 and local.document["points"][-1]["omega"]
            == 2)


SCENE = ('{"structure": {"type": "chain", "masses": [1], "springs": [1, 0]}, "omega": 0.5, '
         '"excitation": [], "time": {"dt": 0.1, "duration": 1}}')
ROWS = "t,y\n" + "".join(f"{k},{k % 3}\n" for k in range(20))


def test_the_result_of_a_steady_job_is_written_as_the_local_one_is(daemon, ctl, tmp_path):
    scene = {"structure": {"type": "matrices", "M": [[1]], "C": [[0.1]], "K": [[1]]}, "omega": 0.8,
             "excitation": [{"dof": "x1", "k": 1, "cos": 1}],
             "effects": [{"type": "friction", "dof": "x1", "stiffness": 0.5, "limit": 0.2}]}
    (tmp_path / "scene.json").write_text(json.dumps(scene))
    options = ("-o", "harmonics=32", "-o", "time=64")
    assert ctl("steady", tmp_path / "scene.json", *options, "-O", tmp_path / "local.h5").status == 0
    job = ctl("submit", "steady", tmp_path / "scene.json", *options, "--key", "motion", "--wait",
              server=daemon)
    assert job.status == 0, job.document
    said = ctl("result", "key:motion", "-O", tmp_path / "served.h5", server=daemon)
    assert said.status == 0, said.document
    with h5py.File(tmp_path / "local.h5") as local, h5py.File(tmp_path / "served.h5") as served:
        assert set(local) == set(served) and {"t", "x", "re", "im", "omega", "dofs"} <= set(served)
        for name in ("t", "x", "re", "im", "omega"):
            assert np.array_equal(local[name][()], served[name][()]), name
        theta = 0.8 * served["t"][()]
        spectrum = served["re"][0, 0] + 1j * served["im"][0, 0]
        assert np.allclose(served["x"][0], np.real(np.exp(1j * np.outer(theta, range(33)))
                                                   @ spectrum), rtol=0, atol=1e-12)


@pytest.mark.parametrize("verb, text", [("identify", ROWS), ("steady", SCENE), ("floquet", SCENE),
                                        ("simulate", SCENE)])
def test_the_help_and_the_manual_have_every_option_of_a_job(verb, text, ctl, tmp_path):
    (tmp_path / "in").write_text(text)
    error = ctl(verb, tmp_path / "in", "-o", "no.such=1",
                *(["-O", tmp_path / "out.h5"] if verb == "simulate" else [])).document["error"]
    accepted = [key for key in error["message"].partition("accepted: ")[2].split(", ")
                if key not in ("sweep", "continue")]
    assert len(accepted) >= 4
    said = subprocess.run([BUILD / "bin" / "modalctl", verb, "--help"], capture_output=True,
                          text=True, check=True).stdout
    manual = (TOP / "clients" / "ctl" / "modalctl.1").read_text().replace("\\-", "-")
    for key in accepted:
        assert f"\n  {key}=" in said and f"\n.B {key}=" in manual, key


def test_names_the_wire_cannot_carry_are_an_answer_not_a_wait(ctl, daemon, tmp_path):
    rows = "".join(f"{0.1 * k},{np.cos(k):.17g}\n" for k in range(40))
    (tmp_path / "latin.csv").write_bytes("t,Schläge\n".encode("latin-1") + rows.encode())
    said = ctl("identify", tmp_path / "latin.csv", server=daemon)
    assert said.status == 0 and said.document["reconstruction"]["signals"][0]["name"] == "Schläge"
    write_batch(tmp_path / "long.h5", np.cos(np.arange(40.0))[:, None], first="x" * 40000,
                second="x" * 40000)
    said = ctl("identify", tmp_path / "long.h5", server=daemon)
    assert said.status == 2 and said.document["error"]["code"] == "too_large"
    with pytest.raises(modald.Error) as why, daemon.client() as client:
        client.status("key:\udcff")
    assert why.value.code == "bad_input"


def test_python_reads_what_h5py_writes_and_fails_by_its_own_error(ctl, tmp_path):
    with h5py.File(tmp_path / "x.h5", "w") as file:
        data = file.create_dataset("signals", data=decay(60))
        file.attrs["dt"], file.attrs["units"], file.attrs["rig"] = (np.array([0.125]),
                                                                    np.bytes_(b"mm"),
                                                                    np.array([b"a", b"bc"]))
        # text of a fixed length
        data.attrs["channels"] = np.array([b"root", b"tip"])
    read = modald.Batch.read(tmp_path / "x.h5")
    assert (read.dt, read.units, read.names,
            read.attributes) == (0.125, "mm", ["root", "tip"], {"rig": ["a", "bc"]})
    assert read.sha256() == ctl("identify",
                                tmp_path / "x.h5").document["provenance"]["input_sha256"]
    (tmp_path / "y.h5").write_text("no HDF5")
    for make, field in ((lambda: modald.Batch.read(tmp_path / "y.h5"), "file"),
                        (lambda: modald.Batch.read(tmp_path / "absent.h5"), "file"),
                        (lambda: modald.Batch(decay(60) * 1j, 0.1), "signals"),
                        (lambda: modald.Batch(decay(60), "soon"), "dt"),
                        (lambda: modald.Batch(decay(60), 0.1, period=[]), "period"),
                        (lambda: modald.Batch([[1, 2], [3]], 0.1), "signals")):
        with pytest.raises(modald.Error) as why:
            make()
        assert why.value.code == "bad_input" and why.value.field == field


LONG = {"structure": {"type": "chain", "masses": [1] * 20, "springs": [1] * 20 + [0]}, "omega": 0.3,
        "effects": [{"type": "rayleigh_damping", "alpha": 0.01, "beta": 0.01},
                    {"type": "friction", "dof": "x5", "stiffness": 0.4, "limit": 0.1},
                    {"type": "gap", "dof": "x20", "clearance": 0.9, "stiffness": 1.5}],
        "excitation": [{"dof": "x20", "k": 1, "cos": 0.2}], "steady": {"harmonics": 15}}


@pytest.mark.parametrize("way", [["--continue", "omega=0.3:200"],
                                 ["--sweep", "omega=0.3:2:5000"]])
def test_an_interrupted_curve_is_the_points_it_has(tmp_path, way):
    """A terminal is told the progress of each point: so one is there when the interrupt comes."""
    (tmp_path / "long.json").write_text(json.dumps(LONG))
    mine, theirs = terminal()
    with subprocess.Popen([str(BUILD / "bin" / "modalctl"), "--local", "--json", "steady",
                           "long.json", *way], cwd=tmp_path, stdout=subprocess.PIPE, stderr=theirs,
                          env=environment()) as running:
        os.close(theirs)
        told = b""
        while b"running" not in told:
            told += os.read(mine, 4096)
        running.send_signal(signal.SIGINT)
        curve = json.loads(running.stdout.read())
        assert running.wait(PATIENCE) == 1
    os.close(mine)
    assert curve["points"] and curve["complete"] is False
    assert curve["reason"] == "stopped before its end"


def test_a_curve_without_time_for_a_point_has_timed_out(tmp_path):
    (tmp_path / "long.json").write_text(json.dumps(LONG))
    done = subprocess.run([str(BUILD / "bin" / "modalctl"), "--local", "steady", "long.json",
                           "--continue", "omega=0.3:200", "--timeout", "0"], cwd=tmp_path,
                          capture_output=True, text=True, env=environment(), timeout=PATIENCE)
    assert done.returncode == 5


HOSTILE = "x\x1b]0;title\x07\x9b31m\u202ey\r"


def test_nothing_that_others_wrote_commands_the_terminal(tmp_path):
    """Names of channels, of whoever made the file, to stdout; words to stderr: ESC, U+009B and what
    turns text around are shown, not obeyed."""
    table = tmp_path / "x.csv"
    rows = [f"{0.01 * k},{math.exp(-0.008 * k) * math.cos(0.31 * k)}" for k in range(400)]
    table.write_text(f't,"{HOSTILE[:-1]}"\n' + "\n".join(rows) + "\n")
    for words in (["--local", "identify", str(table)], ["--local", HOSTILE]):
        mine, theirs = terminal()
        process = subprocess.Popen([str(BUILD / "bin" / "modalctl"), *words], stdin=theirs,
                                   stdout=theirs, stderr=theirs, env=environment())
        process.wait(PATIENCE)
        said = os.read(mine, 65536).decode()
        os.close(mine)
        os.close(theirs)
        assert "\\u001b]0;title\\u0007\\u009b31m\\u202ey" in said, said
        assert not re.search("[\x1b\x07\x9b\u202e]", said), said
