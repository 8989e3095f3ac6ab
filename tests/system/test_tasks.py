"""What three people came for, in the commands and lines that it takes them."""
import json
import subprocess
import xml.etree.ElementTree

import numpy as np
import pytest

import test_files
from conftest import BUILD, PATIENCE, TOP, environment


def modalctl(*words, cwd):
    return subprocess.run([str(BUILD / "bin" / "modalctl"), "--local", *words], cwd=cwd,
                          capture_output=True, text=True, check=True, env=environment(),
                          timeout=PATIENCE).stdout


def test_a_hammer_file_of_matlab_becomes_a_table_of_modes_and_a_picture_by_one_command(tmp_path):
    test_files.mat(tmp_path / "hammer.mat")
    said = modalctl("identify", "hammer.mat", "--csv", "--plot", "hammer.svg", cwd=tmp_path)
    head, *rows = [line.split(",") for line in said.splitlines()]
    assert head[0] == "frequency_hz" and head[2] == "damping_ratio"
    found = sorted((float(row[0]), float(row[2])) for row in rows)
    assert np.allclose(found, [mode[:2] for mode in test_files.MODES], rtol=1e-6)
    assert xml.etree.ElementTree.parse(tmp_path / "hammer.svg").getroot().tag.endswith("svg")


def test_a_matrix_market_model_with_two_contacts_becomes_a_response_curve_by_one_command(tmp_path):
    scipy = pytest.importorskip("scipy.sparse")
    io = pytest.importorskip("scipy.io")
    n = 6
    K = scipy.diags([-900 * np.ones(n - 1), 1800 * np.ones(n), -900 * np.ones(n - 1)], [-1, 0, 1])
    io.mmwrite(tmp_path / "K.mtx", K.tocsr(), symmetry="symmetric")
    io.mmwrite(tmp_path / "M.mtx", scipy.identity(n).tocsr(), symmetry="symmetric")
    (tmp_path / "model.json").write_text(json.dumps({
        "structure": {"type": "matrices", "M": "M.mtx", "K": "K.mtx"}, "omega": 10,
        "effects": [{"type": "gap", "dof": "x3", "stiffness": 300, "clearance": 0.01},
                    {"type": "friction", "dof": "x6", "stiffness": 200, "limit": 0.5},
                    {"type": "rayleigh_damping", "alpha": 0.2, "beta": 0.001}],
        "excitation": [{"dof": "x1", "k": 1, "cos": 1.0}]}))
    modalctl("steady", "model.json", "--continue", "omega=11:15", "--plot", "curve.svg",
             "-O", "curve.csv", cwd=tmp_path)
    assert xml.etree.ElementTree.parse(tmp_path / "curve.svg").getroot().tag.endswith("svg")
    rows = (tmp_path / "curve.csv").read_text().splitlines()
    omega = [float(row.split(",")[0]) for row in rows[1:]]
    assert len(rows) > 5 and omega[0] == 11 and omega[-1] == 15


def test_a_loop_in_fortran_has_its_live_damping_by_five_lines(daemon, tmp_path):
    source = (TOP / "clients/c/examples/loop.f90").read_text().splitlines()
    ours = [line for line in source if "modald" in line and not line.lstrip().startswith("!")]
    asking = [line for line in ours if "modald_verdict" in line]    # to end the run by it
    assert len(ours) - len(asking) == 5
    program = BUILD / "examples" / "example_loop_fortran"
    if not program.exists():
        pytest.skip("no Fortran compiler")
    subprocess.run([str(program), "bench", "4000"], check=True, capture_output=True,
                   timeout=PATIENCE,
                   env=environment(MODALD_URL=daemon.endpoint, MODALD_WINDOW="1000",
                                   MODALD_CLOSE_WAIT=str(PATIENCE)))
    with daemon.client() as client:
        for event in client.events(start=1, stream="bench", timeout=PATIENCE):
            if event.header.get("modes"):
                found = event["modes"][0]["damping_ratio"]
                break
    assert found == pytest.approx(1.7 / 2 / np.sqrt(3.9e4), rel=1e-3)
