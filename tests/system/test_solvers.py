"""Other people's solvers, as their users couple them: what they print, piped into
`modalctl stream -`, or three calls in their loop.
"""
import json
import os
import re
import shutil
import signal
import subprocess
import threading

import numpy as np
import pytest
from conftest import BUILD, PATIENCE, environment

EXAMPLES = BUILD / "examples"
SOURCES = os.path.join(os.path.dirname(__file__), "..", "..", "clients", "c", "examples")

# The way OpenFAST begins an .out file: what wrote it, a description, names, units.
OPENFAST = """
Predictions were generated on 23-Nov-2026 at 06:40:12 using OpenFAST, compiled as 64-bit
 linked with NWTC Subroutine Library; ElastoDyn; InflowWind; AeroDyn; ServoDyn

Description from the FAST input file: a tower that was left to itself

Time\tTTDspFA\tTTDspSS
(s)\t(m)\t(m)
"""


def tower(first, last, dt=0.0125):
    t = dt * np.arange(first, last)
    x = np.exp(-0.02 * t) * np.cos(2 * np.pi * 1.6 * t)
    y = np.exp(-0.03 * t) * np.sin(2 * np.pi * 2.3 * t)
    return "".join(f"{a:10.4f}\t{b:10.3E}\t{c:10.3E}\n" for a, b, c in zip(t, x, y))


def follow(path, *words):
    return subprocess.Popen(["tail", "-n", "+1", "-F", *words, str(path)], stdout=subprocess.PIPE,
                            stderr=subprocess.DEVNULL)


def stream_of(pipe, daemon, *words):
    return subprocess.Popen([str(BUILD / "bin" / "modalctl"), "--server", daemon.endpoint, "--json",
                             "stream", "-", *map(str, words)], stdin=pipe, stdout=subprocess.PIPE,
                            stderr=subprocess.PIPE, text=True, env=environment())


def windows(lines):
    return [line for line in lines if line.get("event") == "modes"]


def ended(run, patience=PATIENCE):
    """What it said, ended in good time or stopped."""
    timer = threading.Timer(patience, run.kill)
    timer.start()
    out, err = run.communicate()
    timer.cancel()
    return [json.loads(line) for line in out.splitlines()], err


# -- rows as they come ---------------------------------------------------------------------------

def test_openfasts_output_by_tail_is_a_stream_with_names_and_its_own_step(daemon, ctl, tmp_path):
    """The file grows while it is read, and one line is written in two pieces."""
    path = tmp_path / "tower.out"
    path.write_text(OPENFAST + tower(0, 50))
    with follow(path) as tail:
        run = stream_of(tail.stdout, daemon, "--name", "tower", "--window", 400, "--hop", 100)
        timer = threading.Timer(PATIENCE, run.kill)
        timer.start()
        rest = tower(50, 500)
        with open(path, "a", encoding="utf-8") as more:
            for piece in (rest[:1017], rest[1017:]):
                more.write(piece)
                more.flush()
        # Windows are said though no more rows come.
        seen = [json.loads(run.stdout.readline())]
        while not any(line.get("sample") == 499 for line in seen):
            seen.append(json.loads(run.stdout.readline()))
        tail.send_signal(signal.SIGTERM)
        lines, err = ended(run)
        timer.cancel()
    assert run.returncode == 0, err
    assert lines[-1]["acknowledged"] == 500 and lines[-1]["dropped"] == 0
    modes = sorted(mode["frequency_hz"] for mode in windows(seen)[-1]["modes"])
    assert modes == pytest.approx([1.6, 2.3], rel=2e-3)
    assert ctl("export", "stream:tower", "-O", tmp_path / "tower.csv", server=daemon).status == 0
    names = (tmp_path / "tower.csv").read_text().splitlines()[0].split(",")
    assert names[-2:] == ["TTDspFA", "TTDspSS"]


@pytest.mark.parametrize("text, words, field, said", [
    ("t,x\n" + "".join(f"{0.1 * k:.1f},{k}\n" for k in range(80)) + "8.3,1\n", [], "time",
     "line 82: 0.4 s after the row before it"),
    ("t,x\n0,1\n0.1,2\n0.2,3\n", ["--dt", "0.2"], "dt", "its column of time says 0.1 s"),
    ("t,x\n0,1\n0.1,2\n0.3,3\n", [], "time", "uneven"),
    ("x,y\n1,2\n3,4\n", [], "dt", "--dt SECONDS"),
    ("x,y\n1,2\n3,4,5\n", ["--dt", "1"], "signals", "line 3 has more than 2 columns"),
    ("x,y\n1,2\n3,four\n", ["--dt", "1"], "signals", "line 3, column 2: \"four\" is not a number"),
    ("one\ntwo\nthree\n", ["--dt", "1"], "signals", "is not a number"),
    ("a\0b\n", ["--dt", "1"], "signals", "not text"),
    ("no number\n" * 200000, [], "signals", "no row of numbers in its first"),
], ids=["a step missed", "another step given", "uneven", "no step", "a column more", "a word",
        "words", "not text", "words without end"])
def test_a_pipe_that_is_no_table_is_refused_by_its_line(text, words, field, said, daemon, ctl):
    answer = ctl("stream", "-", *words, server=daemon, stdin=text)
    error = answer.document["error"]
    assert answer.status == 2 and error["code"] in ("bad_input", "too_large")
    assert error["field"] == field
    assert said in error["message"]


def test_rows_whose_time_is_to_be_ignored_are_taken_as_even(daemon, ctl):
    answer = ctl("stream", "-", "--dt", "0.5", "--ignore-time", server=daemon, one=False,
                 stdin="t;x\n0;1\n0,1;2\n7;3\n1;4\n")
    assert answer.status == 0 and answer.lines[-1]["acknowledged"] == 4


# -- MuJoCo ---------------------------------------------------------------------------------------

@pytest.mark.skipif(not (EXAMPLES / "example_pendulum").exists(),
                    reason="example_pendulum was not built: Debian package libmujoco-dev")
def test_mujocos_pendulum_has_the_modes_of_mujocos_own_linearisation(daemon, ctl):
    """Its mjd_transitionFD gives the matrix of one step; frequencies and damping agree to 1e-6."""
    done = subprocess.run([str(EXAMPLES / "example_pendulum"), "mujoco", "12000"],
                          capture_output=True, text=True, timeout=PATIENCE,
                          env=environment(MODALD_URL=daemon.endpoint))
    assert done.returncode == 0, done.stderr
    step, *matrix = np.array(done.stdout.split(), float)
    poles = np.log(np.linalg.eigvals(np.array(matrix).reshape(6, 6)).astype(complex)) / step
    poles = sorted((p for p in poles if p.imag > 0), key=lambda p: p.imag)
    said = ctl("identify", "stream:mujoco", server=daemon)
    found = np.array([complex(*mode["exponent"]) for mode in said.document["modes"]])
    assert len(poles) == 3
    for pole in poles:
        mode = found[np.argmin(abs(found - pole))]
        assert abs(mode) == pytest.approx(abs(pole), rel=1e-6)
        assert mode.real / abs(mode) == pytest.approx(pole.real / abs(pole), abs=1e-6)


# -- CalculiX -------------------------------------------------------------------------------------

STEP = 5e-4
ALPHA, BETA = 1.5, 1e-6             # Rayleigh's


def beam(analysis):
    """Four elements of a cantilever of 1 m, 16 x 20 mm, of steel, in mm, t and s."""
    nodes = "".join(f"{i + 1},{125 * i},0,0\n" for i in range(9))
    elements = "".join(f"{e + 1},{2 * e + 1},{2 * e + 2},{2 * e + 3}\n" for e in range(4))
    return (f"*NODE,NSET=ALL\n{nodes}*ELEMENT,TYPE=B32R,ELSET=E\n{elements}*NSET,NSET=OUT\n5,9\n"
            "*NSET,NSET=TIP\n9\n*BOUNDARY\n1,1,6\n*MATERIAL,NAME=STEEL\n*ELASTIC\n210000,0.3\n"
            f"*DENSITY\n7.85E-9\n*DAMPING,ALPHA={ALPHA},BETA={BETA}\n"
            "*BEAM SECTION,MATERIAL=STEEL,ELSET=E,SECTION=RECT\n16,20\n0,0,-1\n"
            f"{analysis}*END STEP\n")


KNOCK = ("*AMPLITUDE,NAME=A\n0,0,0.001,1,0.002,0,100,0\n*STEP,INC=100000\n"
         f"*DYNAMIC,DIRECT,ALPHA=0\n{STEP},0.2\n*CLOAD,AMPLITUDE=A\nTIP,2,5\nTIP,3,3.5\n"
         "*NODE PRINT,NSET=OUT,FREQUENCY=1\nU\n*EL PRINT,ELSET=E,FREQUENCY=1,TOTALS=ONLY\nELSE\n")


def ccx(folder, name, text):
    (folder / f"{name}.inp").write_text(text)
    return subprocess.Popen(["ccx", "-i", name], cwd=folder, stdout=subprocess.DEVNULL,
                            env={**os.environ, "OMP_NUM_THREADS": "1"})


def by_the_trapezoidal_rule(pole):
    """What a pole becomes by steps of z = (1 + pole h / 2) / (1 - pole h / 2)."""
    return 2 / STEP * np.arctanh(pole * STEP / 2)


@pytest.mark.skipif(shutil.which("ccx") is None,
                    reason="ccx is not there: Debian package calculix-ccx")
def test_calculixs_growing_output_shows_rayleighs_damping_and_the_integrators_period(daemon,
                                                                                     tmp_path):
    """CalculiX's own eigenvalues, with Rayleigh's damping, moved by its integrator as theory says,
    are what the stream shows.
    """
    assert ccx(tmp_path, "modes", beam("*STEP\n*FREQUENCY\n4\n")).wait(PATIENCE) == 0
    table = re.findall(r"^ +\d+ +\S+ +\S+ +(0\.\d+E[+-]\d+) +0\.0",
                       (tmp_path / "modes.dat").read_text(), re.M)
    omega = 2 * np.pi * np.array(table[:4], float)
    zeta = ALPHA / (2 * omega) + BETA * omega / 2
    poles = by_the_trapezoidal_rule(omega * (-zeta + 1j * np.sqrt(1 - zeta ** 2)))
    solver = ccx(tmp_path, "knock", beam(KNOCK))
    with follow(tmp_path / "knock.dat", f"--pid={solver.pid}", "-s", "0.1") as tail, \
            subprocess.Popen(["awk", "-f", os.path.join(SOURCES, "calculix.awk")],
                             stdin=tail.stdout, stdout=subprocess.PIPE) as rows:
        run = stream_of(rows.stdout, daemon, "--name", "beam", "--window", 300, "--hop", 50)
        solver.wait(PATIENCE)
        lines, err = ended(run)
    assert run.returncode == 0, err
    assert lines[-1]["acknowledged"] == 400 and lines[-1]["dropped"] == 0
    modes = windows(lines)[-1]["modes"]
    for pole in poles:
        found = min(modes, key=lambda mode: abs(mode["frequency_hz"] - abs(pole) / (2 * np.pi)))
        assert found["frequency_hz"] == pytest.approx(abs(pole) / (2 * np.pi), rel=1e-3)
        assert found["damping_ratio"] == pytest.approx(-pole.real / abs(pole), rel=5e-3)
