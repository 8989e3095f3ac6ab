"""modalctl loads a library at the first call into it: what a verb does not need is not loaded, what
it needs is, and a package knows of all of them.
"""
import json
import math
import os
import re
import subprocess
import wave

import numpy as np
import pytest
import sanitized
from conftest import BUILD, environment, write_batch

CALLS = BUILD / "clients" / "ctl" / "lazy_calls.S"
pytestmark = pytest.mark.skipif(not CALLS.exists(),
                                reason="lazy.S has no jumps for this processor: "
                                                           "modalctl is linked with its libraries")
NUMERICS = {"libopenblas.so.0", "liblapacke.so.3"}
FFTW, HDF5, SQLITE = "libfftw3.so.3", "libhdf5_serial.so.103", "libsqlite3.so.0"
SPARSE = {"libumfpack.so.5", "libcholmod.so.3"}     # the first needs the second
ZMQ, CRYPTO, SNDFILE = "libzmq.so.5", "libcrypto.so.3", "libsndfile.so.1"
ALL = NUMERICS | SPARSE | {FFTW, HDF5, SQLITE, ZMQ, CRYPTO, SNDFILE}
T = np.arange(400) * 0.01
Y = np.column_stack([np.exp(-0.2 * T) * np.cos(7 * T), np.exp(-0.2 * T) * np.sin(7 * T)])


def modalctl(folder, *words, **more):
    return subprocess.run([str(BUILD / "bin" / "modalctl"), *map(str, words)], capture_output=True,
                          text=True,
                          check=False, cwd=folder, env=environment(**more))


def loaded(folder, *words):
    """What modalctl says, and the libraries whose constructors the dynamic linker called in it."""
    done = modalctl(folder, *words, LD_DEBUG="files", LD_DEBUG_OUTPUT=folder / "ld")
    assert done.returncode == 0, done.stderr
    (said,) = folder.glob("ld.*")
    found = {os.path.basename(path)
             for path in re.findall(r"calling init: (\S+)", said.read_text())}
    said.unlink()
    assert "libc.so.6" in found
    return done.stdout, found


@pytest.mark.parametrize("words", [["--version"], ["--help"], ["identify", "--help"],
                                   ["help", "scene"],
                                   ["--json", "help", "result"]])
def test_what_only_prints_loads_no_library_of_weight(tmp_path, words):
    _, found = loaded(tmp_path, *words)
    assert not found & ALL and not any("curl" in name for name in found)


def csv(folder):
    np.savetxt(folder / "y.csv", np.column_stack([T, Y]), delimiter=",", header="t,a,b",
               comments="")
    return ["--local", "--json", "identify", "y.csv"]


def hdf5(folder):
    write_batch(folder / "y.h5", Y, 0.01)
    return ["--local", "--json", "identify", "y.h5"]


def sound(folder):
    with wave.open(str(folder / "y.wav"), "wb") as file:
        file.setparams((2, 2, 100, len(Y), "NONE", ""))
        file.writeframes((Y * 32767).astype("<i2").tobytes())
    return ["--local", "--json", "identify", "y.wav"]


@pytest.mark.parametrize("file, more", [(csv, set()), (hdf5, {HDF5}), (sound, {SNDFILE})])
def test_a_file_of_signals_loads_the_numerics_and_its_reader(tmp_path, file, more):
    out, found = loaded(tmp_path, *file(tmp_path))
    assert found & ALL == NUMERICS | {FFTW, CRYPTO} | more
    mode = json.loads(out)["modes"][0]
    assert abs(mode["exponent"][0] + 0.2) < 1e-3 and abs(mode["exponent"][1] - 7) < 1e-3


def test_a_law_on_a_beam_loads_the_sparse_factors_and_no_reader(tmp_path):
    """At the middle of a pinned beam: F (tan(b L / 2) - tanh(b L / 2)) / (4 EI b^3), b^4 = m w^2 /
    EI."""
    mass, omega, stiffness = 3.24, 100, 6570
    (tmp_path / "beam.json").write_text(json.dumps({
        "structure": {"type": "beam", "length": 1, "elements": 20, "EI": stiffness,
                      "mass_per_length": mass}, "omega": omega,
        "excitation": [{"dof": "w10", "k": 1, "cos": 1}],
        "effects": [{"type": "cubic_spring", "dof": "w10", "coefficient": 1e-3}]}))
    out, found = loaded(tmp_path, "--local", "--json", "steady", "beam.json")
    assert found & ALL == NUMERICS | SPARSE | {FFTW, CRYPTO}
    middle = next(h for h in json.loads(out)["harmonics"] if h["dof"] == "w10")
    b = (mass * omega ** 2 / stiffness) ** 0.25
    assert middle["re"][1] == pytest.approx((math.tan(b / 2) - math.tanh(b / 2))
                                            / (4 * stiffness * b ** 3), rel=1e-6)


@pytest.mark.skipif(sanitized.SANITIZED, reason="LeakSanitizer does not work under strace")
@pytest.mark.parametrize("threads", [1, 2])
def test_a_job_has_the_threads_that_it_asks_for_and_no_others(tmp_path, threads):
    words = [*csv(tmp_path), "-o", f"threads={threads}"]
    subprocess.run(["strace", "-f", "-qq", "-e", "trace=clone,clone3", "-o", "made",
                    str(BUILD / "bin" / "modalctl"), *words],
                   cwd=tmp_path, check=True, capture_output=True, env=environment())
    made = re.findall(r"CLONE_THREAD", (tmp_path / "made").read_text())
    assert len(made) == threads - 1


def test_a_pair_of_keys_loads_libzmq_alone(tmp_path):
    _, found = loaded(tmp_path, "keygen", "mine.key")
    assert found & ALL == {ZMQ}
    assert (tmp_path / "mine.key").exists()


def test_a_library_that_is_missing_ends_only_what_needs_it(tmp_path):
    words = csv(tmp_path)
    hdf5(tmp_path)
    broken = tmp_path / "libraries"
    broken.mkdir()
    (broken / HDF5).write_text("no library")
    done = modalctl(tmp_path, *words, LD_LIBRARY_PATH=broken)
    assert done.returncode == 0 and json.loads(done.stdout)["modes"]
    done = modalctl(tmp_path, *words[:-1], "y.h5", LD_LIBRARY_PATH=broken)
    assert done.returncode == 127 and done.stdout == ""
    assert done.stderr.startswith(f"modalctl: {broken}/{HDF5}: ") and done.stderr.count("\n") == 1


def test_what_is_loaded_is_what_a_package_is_told_that_modalctl_needs():
    needed = subprocess.run(["objdump", "-p", str(BUILD / "lib" / "lazy_needs.so")],
                            capture_output=True, text=True,
                            check=True).stdout
    lines = CALLS.read_text().splitlines()
    files = {name for line in lines if line.startswith("library ")
             for name in re.findall(r'"(\S+)"', line)}
    assert files == ALL <= set(re.findall(r"NEEDED\s+(\S+)", needed))
