"""Results in other forms than the table: CSV, pictures of earlier ones, shapes compared; and sweeps
of which points fail."""
import csv
import io
import json
import subprocess

import numpy as np
import pytest
from conftest import BUILD, PATIENCE, environment

CTL = BUILD / "bin" / "modalctl"
HEADER = ["frequency_hz", "frequency_hz_std", "damping_ratio", "damping_ratio_std", "re", "im",
          "amplitude", "residual", "k"]


def plain(*words, server=None):
    """As a person sees it: no --json."""
    where = ["--server", server.endpoint] if server else ["--local"]
    done = subprocess.run([CTL, *where, *map(str, words)], capture_output=True, text=True,
                          timeout=PATIENCE, env=environment())
    return done.returncode, done.stdout, done.stderr


def write(path, *, shapes=((1, 0.6), (1, -1)), names="a,b"):
    """Two modes, lambda = -0.05 + 6i and -0.1 + 15i, of these shapes."""
    t = np.arange(600) * 0.02
    parts = np.column_stack([np.exp(-0.05 * t) * np.cos(6 * t),
                             0.5 * np.exp(-0.1 * t) * np.cos(15 * t)])
    np.savetxt(path, np.column_stack([t, parts @ np.array(shapes)]), delimiter=",",
               header="t," + names, comments="")
    return path


def table(text):
    rows = list(csv.reader(io.StringIO(text)))
    return rows[0], rows[1:]


def test_csv_is_a_line_a_mode_below_the_names_of_its_columns(ctl, tmp_path):
    path = write(tmp_path / "y.csv")
    status, out, _ = plain("identify", path, "--csv")
    names, rows = table(out)
    modes = ctl("identify", path).document["modes"]
    assert status == 0 and names == HEADER and len(rows) == len(modes) == 2
    for row, mode in zip(rows, modes):
        got = dict(zip(names, row))
        assert float(got["frequency_hz"]) == pytest.approx(mode["frequency_hz"], rel=1e-12)
        assert [float(got["re"]), float(got["im"])] == pytest.approx(mode["exponent"], rel=1e-9)
        assert float(got["damping_ratio_std"]) >= 0 and got["k"] == ""
    periodic = table(plain("identify", path, "--csv", "-o", "period=1.0471975511965976")[1])[1]
    assert all(int(row[-1]) == float(row[-1]) for row in periodic)


def test_what_goes_to_stdout_is_one_thing(tmp_path):
    path = write(tmp_path / "y.csv")
    for words, field in ((["--csv", "--json"], "csv"), (["--csv", "--plot", "-"], "plot"),
                         (["--json", "--plot", "-"], "plot")):
        status, out, err = plain("identify", path, *words)
        assert status == 2 and f"{field}:" in err or f'"field":"{field}"' in out, (words, out, err)


def test_shapes_stand_in_the_table_where_they_are_asked_for(tmp_path):
    path = write(tmp_path / "y.csv")
    assert "shape" not in plain("identify", path)[1]
    lines = plain("identify", path, "-o", "shapes=true")[1].splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith("shape 0, mpc "))
    assert float(lines[first].split()[3].rstrip(":")) == pytest.approx(1, abs=1e-9)
    (a, one, _), (b, other, phase) = (line.split() for line in lines[first + 1:first + 3])
    assert ((a, b) == ("a", "b") and float(one) == 1 and float(other)
            == pytest.approx(0.6, abs=1e-3) and abs(float(phase)) < 0.1)
    assert abs(float(lines[first + 5].split()[2])) == pytest.approx(180, abs=0.1)


# |1 - 0.6|^2 / (1.36 * 2) and |1 + 0.6|^2 / (1.36 * 2) of the shapes above, by hand
ACROSS, OTHER = 0.16 / 2.72, 2.56 / 2.72


def test_mac_is_one_of_a_shape_with_itself_and_by_hand_of_two(ctl, daemon, tmp_path):
    doc = ctl("identify", write(tmp_path / "y.csv"), "-o", "shapes=true").document
    (tmp_path / "a.json").write_text(json.dumps(doc))
    said = ctl("submit", "identify", write(tmp_path / "z.csv", shapes=((2, 2), (2, -2))), "-o",
               "shapes=true", "--wait", server=daemon).document
    (tmp_path / "said.json").write_text(json.dumps(said))
    alone = ctl("mac", tmp_path / "a.json", tmp_path / "a.json").document
    assert (alone["kind"] == "mac" and alone["a"] == alone["b"]
            == [m["frequency_hz"] for m in doc["modes"]])
    assert np.array(alone["mac"]) == pytest.approx(np.array([[1, ACROSS], [ACROSS, 1]]), abs=1e-9)
    for other in (said["job"], tmp_path / "said.json"):
        got = ctl("mac", tmp_path / "a.json", other, server=daemon).document
        order = np.argsort(got["b"])
        assert np.array(got["mac"])[:, order] == pytest.approx(np.array([[OTHER, ACROSS], [0, 1]]),
                                                               abs=1e-9)
    status, out, _ = plain("mac", tmp_path / "a.json", tmp_path / "a.json")
    assert status == 0 and out.splitlines()[1].split()[1:] == ["1.0000", f"{ACROSS:.4f}"]


def test_mac_wants_shapes_of_the_same_channels(ctl, tmp_path):
    (tmp_path / "a.json").write_text(json.dumps(ctl("identify", write(tmp_path / "y.csv"), "-o",
                                                    "shapes=true").document))
    (tmp_path / "none.json").write_text(json.dumps(ctl("identify",
                                                       write(tmp_path / "y.csv")).document))
    (tmp_path / "three.json").write_text(json.dumps(ctl("identify",
                                                        write(tmp_path / "3.csv",
                                                              shapes=((1, 1, 1), (1, 2, 3)),
                                                              names="a,b,c"), "-o",
                                                        "shapes=true").document))
    (tmp_path / "swapped.json").write_text(json.dumps(
        ctl("identify", write(tmp_path / "s.csv", names="b,a"), "-o", "shapes=true").document))
    assert "accepted: a result of identify -o shapes=true" in plain("mac", tmp_path / "a.json",
                                                                    tmp_path / "none.json")[2]
    status, _, err = plain("mac", tmp_path / "a.json", tmp_path / "three.json")
    assert status == 2 and "shapes of 2 channels" in err and "of 3;" in err
    status, _, err = plain("mac", tmp_path / "a.json", tmp_path / "swapped.json")
    assert status == 0 and 'channel 0 is "a"' in err and "by their order" in err
    assert plain("mac", tmp_path / "a.json", "no-such-job")[0] == 3


SCENE = {"structure": {"type": "chain", "masses": [2], "springs": [8, 0], "dampers": [0.5, 0]},
         "omega": 3.0, "excitation": [{"dof": "x1", "cos": 1.0}]}


@pytest.mark.parametrize("more", [[], ["--sweep", "omega=1:3:5"]], ids=["one state", "a curve"])
def test_an_earlier_result_is_drawn_and_shown(ctl, daemon, tmp_path, more):
    (tmp_path / "s.json").write_text(json.dumps(SCENE))
    job = ctl("submit", "steady", tmp_path / "s.json", *more, "--wait",
              server=daemon).document["job"]
    status, svg, err = plain("result", job, "--plot", "-", server=daemon)
    assert (status == 0 and svg.startswith("<svg")
            and svg.rstrip().endswith("</svg>")), (svg[:100], err)
    assert plain("result", job, "--plot", tmp_path / "p.svg",
                 server=daemon)[0] == 0 and (tmp_path / "p.svg").read_text() == svg
    assert "|X_" in plain("result", job, server=daemon)[1]
    status, _, err = plain("result", job, "--plot", tmp_path / "p.png", server=daemon)
    assert status == 2 and "plot:" in err and not (tmp_path / "p.png").exists()


def test_an_earlier_identification_is_drawn_and_put_into_a_table(ctl, daemon, tmp_path):
    path = write(tmp_path / "y.csv")
    job = ctl("submit", "identify", path, "--wait", server=daemon).document["job"]
    assert plain("result", job, "--plot", "-", server=daemon)[1].startswith("<svg")
    assert table(plain("result", job, "--csv", server=daemon)[1])[0] == HEADER
    (tmp_path / "s.json").write_text(json.dumps(SCENE))
    job = ctl("submit", "steady", tmp_path / "s.json", "--wait", server=daemon).document["job"]
    status, out, err = plain("result", job, "--csv", server=daemon)
    assert (status, out) == (2, "") and "accepted: identify, sweep" in err


def sweep(values, verb="steady"):
    return {"verb": verb, "scene": SCENE,
            "grid": [{"path": "structure.springs[0]", "values": values},
                     {"path": "omega", "values": [1, 3]}]}


def amplitude(k, w):
    """Of 2 x'' + 0.5 x' + k x = cos(w t)."""
    return 1 / abs(k - 2 * w * w + 0.5j * w)


def test_a_sweep_of_steady_states_shows_their_amplitudes_and_whose(tmp_path):
    (tmp_path / "sweep.json").write_text(json.dumps(sweep([5, 8])))
    status, out, err = plain("sweep", tmp_path / "sweep.json")
    head, *lines = out.splitlines()
    assert (status, err) == (0, "") and head.split()[-2:] == ["amplitude", "of"]
    rows = [line.split() for line in lines[:4]]
    assert [float(r[-2]) for r in rows] == pytest.approx([amplitude(float(r[0]), float(r[1]))
                                                          for r in rows], rel=1e-5)
    assert all(r[-1] == "x1" for r in rows)
    names, cells = table(plain("sweep", tmp_path / "sweep.json", "--csv")[1])
    assert names == ["structure.springs[0]", "omega", "stable", "max_multiplier", "margin",
                     "amplitude", "dof", "error"]
    assert [float(c[5]) for c in cells] == pytest.approx([amplitude(float(c[0]), float(c[1]))
                                                          for c in cells], rel=1e-12)


def test_a_sweep_of_which_points_failed_is_1_and_says_how_many_and_why(ctl, daemon, tmp_path):
    document = sweep([5, 8])
    document["grid"][1]["values"] = [1, -3]
    (tmp_path / "sweep.json").write_text(json.dumps(document))
    for server in (None, daemon):
        status, out, err = plain("sweep", tmp_path / "sweep.json", *(["--wait"] if server else []),
                                 server=server)
        assert (status == 1
                and "2 of 4 points failed, the first at structure.springs[0] = 5 omega = -3: omega "
                    "is -3" in err), err
        assert len([line for line in out.splitlines() if "omega is -3" in line]) == 2
    for words in ([], ["--wait"]):
        said = ctl("sweep", tmp_path / "sweep.json", *words, server=daemon if words else None)
        assert (said.status == 1 and "error" in said.document["points"][1]
                and "error" not in said.document["points"][0])


def test_the_results_of_a_list_are_a_line_each_or_one_table(ctl, own_daemon, tmp_path):
    daemon = own_daemon(workers=1)
    good, bad = write(tmp_path / "y.csv"), {"kind": "identify", "file": str(tmp_path / "y.csv"),
                                            "options": {"rank.fixed": -1}}
    lines = [{"kind": "identify", "file": str(good)}, {**bad, "key": "bad"},
             {"kind": "identify", "file": str(good), "key": "named", "options": {"shapes": True}}]
    (tmp_path / "list.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    sent = ctl("submit", "--from", tmp_path / "list.jsonl", "--wait", server=daemon, one=False)
    (tmp_path / "said.jsonl").write_text(sent.out)
    got = ctl("results", "--from", tmp_path / "list.jsonl", server=daemon, one=False)
    assert got.status == 2 and [line["line"] for line in got.lines] == [1, 2, 3]
    assert [("result" in line, "error" in line)
            for line in got.lines] == [(True, False), (False, True), (True, False)]
    assert (len(got.lines[0]["result"]["modes"]) == 2
            and "shape" in got.lines[2]["result"]["modes"][0])
    status, out, err = plain("results", "--from", tmp_path / "list.jsonl", "--csv", server=daemon)
    names, rows = table(out)
    assert (status == 2 and names == ["job", *HEADER] and len(rows) == 4 and {r[0] for r in rows}
            == {got.lines[0]["job"], "key:named"})
    assert "line 2, key:bad: " in err
    assert ({line["result"]["kind"] for line in ctl("results", "--from", tmp_path / "said.jsonl",
                                                    server=daemon, one=False).lines
             if "result" in line} == {"identify"})
    assert plain("results", server=daemon)[0] == plain("results", "--from",
                                                       tmp_path / "list.jsonl")[0] == 2
