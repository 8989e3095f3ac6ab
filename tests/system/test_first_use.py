"""The first hour of somebody who has the packages and their manual (with MODALD_LONG, in a bare
Debian 12): first_use.sh goes through what newcomers stumbled over, a row each; what each row must
say is here."""
import json
import pathlib
import re

import h5py
import numpy as np
import pytest
import scipy.io
import scipy.sparse

import test_files
from test_packages import Root, packages, pytestmark  # noqa: F401 (a fixture and a mark)

# Row to what must stand in it, as regular expressions, in any order.
ROWS = {
    "a1": [r"\d+ mpc", r"\d+ resolved_exponent", r"\d+ clusters", r"\d+ trend",
           r"modal phase collinearity"],
    "a2": [r"--dt is 0\.02 s, but its column of time says 0\.01 s", r"exit 2"],
    "a3": [r"\n  \d +1\.(19|20)", r"\n  \d +2\.(49|50)", r"\n  \d +3\.(69|70)",
           r"not_free_decay.*response=ambient"],
    "a4": [r"(?s)(\n1\.2[0-9]*,.*){5}", r"(?s)(\n3\.(7|699999)[0-9]*,.*){5}"],
    "a5": [r"accepted: --dataset with one of accel \(4000 x 3\), weights \(3 x 3\)",
           r"\n1\.2000000"],
    "a6": [r"\n  0 +1\.(2|200000|199999)\d* ", r"\n  1 +3\.(70*|699999)\d* ", r"\nstable"],
    "a7": [r"note undamped: mode 1 \(5\.1 Hz\) keeps its amplitude"],
    "a8": [r"shape 0, mpc 1: magnitude", r"1\.0000 +0\.\d{4} +0\.\d{4}"],
    "a9": [r"\nfrequency_hz,frequency_hz_std,", r"\nk,x1_re,x1_im"],
    "a10": [r"pictures are SVG; accepted: FILE\.svg, or -", r"<svg "],
    "a11": [r"by order, filled what is a mode's"],
    "a12": [r"\n<svg"],
    "a13": [r"\n1\.2000000", r"\n3\.(7000|6999)"],
    "b1": [r"\d+ gap", r"\d+ wing", r"\d+ shaft", r"\d+ beam", r"\d+ friction",
           r"where d > clearance"],
    "b2": [r"3 of 3 points failed.*the friction is not linear", r"exit 1"],
    "b3": [r"running \d+ %", r"stopped: \d+ points are what there is", r"exit [1-9]",
           r"\nomega,converged,"],
    "b4": [r"converged, omega 10 rad/s"],
    "b5": [r"\nTrue\n"],
    "c1": [r"\nrig7 .*sealed", r"\n1\.2000000", r"rig7\.h5: 4000 samples of 3 channels"],
    "c2 c4": [r"\nstable \S"],
    "c3 c6": [r"loop\.c\n", r"loop\.f90\n", r"live\.py\n", r"exit 0\]\n[1-9]\d{3}"],
    "c5": [r"nothing of a stream \"nosuchstream\" so far", r"exit 5"],
    "d1": [r"permission denied: a folder on its way is closed to us", r"role +\"admin\""],
    "d2": [r"our key was refused", r"the daemon wants a key: --keyfile"],
    "d3 d4 d5": [r"\d+ apt", r"\d+ systemctl", r"\d+ backup", r"\nmodald-slurm\n",
                 r"\npython3-modald\n"],
    "d6": [r"storage_full:", r"\nmodald_storage_full 1\n", r"event=storage_full needed=",
           r"exit 0"],
    "d7": [r" done .*shapes", r"queue, workers and streams on a live screen"],
    "d8": [r"user=\S+ kind=\S+ .*peer=", r"wall_s=\S+ cpu_s=", r"endpoint=ipc:"],
    "e1": [r"\n40\n"],
    "e2": [r"(?s)(\"state\":\"done\".*){3}", r"3 of 3 accepted"],
    "e3": [r"(?s)\njob,frequency_hz,.*\nkey:k1,.*\nkey:k2,.*\nkey:k3,"],
    "e4 e5 e7": [r"\(3, 3\) Figure \d+", r"'plain\.csv' is no signals; accepted: an array",
                 r"shapes is no keyword here.*options=\{\"shapes\": \.\.\.\}"],
    "e6": [r"\n\[\]\n"],
}


def decays(t, rng):
    """A free response of three modes in three channels."""
    out = np.zeros((len(t), 3))
    for hz, ratio in ((1.2, 0.01), (2.5, 0.02), (3.7, 0.015)):
        w = 2 * np.pi * hz
        out += np.outer(np.exp(-ratio * w * t) * np.cos(w * np.sqrt(1 - ratio ** 2) * t),
                        rng.standard_normal(3))
    return out


def signals(folder):
    rng = np.random.default_rng(5)
    t = np.arange(4000) * 0.01

    def table(name, t, y, head=True):
        names = "t," + ",".join(f"a{i}" for i in range(y.shape[1]))
        np.savetxt(folder / name, np.column_stack((t, y)), delimiter=",", comments="", fmt="%.9g",
                   header=names if head else "")
    free = decays(t, rng) + 1e-5 * rng.standard_normal((4000, 3))
    table("plain.csv", t, free)
    table("bare.csv", t, free[:, :1], False)
    table("hammer.csv", t,
          np.vstack((np.zeros((300, 3)), free[:-300])) + 1e-4 * rng.standard_normal((4000, 3)))
    table("forced.csv", t, free + np.outer(np.sin(2 * np.pi * 5.1 * t), [0.3, 0.2, 0.1]))
    noise, kernels = rng.standard_normal(33999), decays(np.arange(4000) * 0.03, rng)
    ambient = np.column_stack([np.convolve(noise, kernel, "valid") for kernel in kernels.T])
    table("ambient.csv", np.arange(30000) * 0.03, ambient + 0.3 * rng.standard_normal((30000, 3)))
    test_files.mat(folder / "v5.mat")
    test_files.mat_73(folder / "v73.mat")
    test_files.npy(folder / "a.npy")
    test_files.uff(folder / "a.uff")
    test_files.openfast_out(folder / "a.out")
    with h5py.File(folder / "own.h5", "w") as file:
        file.attrs["fs"] = 100.0
        file["accel"], file["weights"] = free, np.ones((3, 3))


def scenes(folder):
    def chain(n):
        return {"type": "chain", "masses": [1.0] * n, "springs": [1.0] * n + [0.0],
                "dampers": [0.1] * n + [0.0]}

    load = [{"dof": "x1", "k": 1, "cos": 0.3}]
    rub = {"structure": chain(1), "omega": 0.8, "excitation": load, "effects": [
        {"type": "friction", "dof": "x1", "stiffness": 5, "limit": 0.1}]}
    cubic = [{"type": "cubic_spring", "dof": "x1", "coefficient": 0.5}]
    joint = [{"type": kind, "dof": f"x{i + 1}", **law} for i in range(60) for kind, law in
             (("friction", {"stiffness": 1, "limit": 0.1}),
              ("gap", {"stiffness": 2, "clearance": 0.1}))]
    market = {"type": "matrices", "M": "M.mtx", "K": "K.mtx"}
    for name, scene in (
            ("duffing.json", {**rub, "effects": cubic}),
            ("joint.json", {**rub, "structure": chain(60), "effects": joint}),
            ("sweep.json", {"scene": rub,
                            "grid": [{"path": "effects[0].limit", "values": [0.1, 0.2, 0.4]}]}),
            ("market.json", {"structure": market, "omega": 10, "excitation": load, "effects": [
                {"type": "rayleigh_damping", "alpha": 0.2, "beta": 0.001}]})):
        (folder / name).write_text(json.dumps(scene))
    scipy.io.mmwrite(folder / "K.mtx", scipy.sparse.diags([900.0] * 3).tocsr(),
                     symmetry="symmetric")
    scipy.io.mmwrite(folder / "M.mtx", scipy.sparse.identity(3).tocsr(), symmetry="symmetric")


@pytest.fixture(scope="module")
def said(packages, tmp_path_factory):  # noqa: F811
    root = Root(tmp_path_factory.mktemp("first"))
    use = root.path / "root/use"
    use.mkdir()
    signals(use)
    scenes(use)
    for deb in packages.glob("*.deb"):
        (use / deb.name).write_bytes(deb.read_bytes())
    script = pathlib.Path(__file__).with_name("first_use.sh")
    (use / script.name).write_bytes(script.read_bytes())
    root.run("apt-get update -qq; apt-get install -y -qq --no-install-recommends /root/use/*.deb "
             "python3-h5py python3-scipy python3-matplotlib man-db groff pkg-config gcc libc6-dev "
             ">/dev/null")
    text = root.run("cd /root/use; set +eu; bash first_use.sh 2>&1")
    print(text)
    return {re.match(r"((?:[a-e]\d+ )+)", part)[1].strip(): part
            for part in re.split(r"^== ", text, flags=re.M)[1:]}


@pytest.mark.parametrize("row", ROWS)
def test_what_newcomers_stumbled_over_does_what_it_says(row, said):
    for wanted in ROWS[row]:
        assert re.search(wanted, said[row]), f"{wanted}\nis not in\n{said[row]}"


def test_each_row_that_is_tried_says_what_it_must(said):
    assert set(said) == set(ROWS)
