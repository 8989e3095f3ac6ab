"""--plot and its Python kin: a picture a kind of result, with what the kind must show."""
import json
import subprocess
import xml.etree.ElementTree as tree

import numpy as np
import pytest

from conftest import BUILD, decay, watched, write_batch
from wire import Daemon, crc32c, until

SVG = "{http://www.w3.org/2000/svg}"
DUFFING = {"structure": {"type": "chain", "masses": [1], "springs": [1, 0], "dampers": [0.1, 0]},
           "effects": [{"type": "cubic_spring", "dof": "x1", "coefficient": 0.5}],
           "excitation": [{"dof": "x1", "k": 1, "cos": 0.5}],
           "omega": 1.2, "steady": {"harmonics": 7}}


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    path = tmp_path_factory.mktemp("scene") / "duffing.json"
    path.write_text(json.dumps(DUFFING))
    return path


def drawn(path):
    root = tree.parse(path).getroot()
    dashed = [e for e in root.iter(SVG + "path") if e.get("stroke-dasharray")]
    return root, list(root.iter(SVG + "circle")), dashed, " ".join(e.text or ""
                                                                   for e in root.iter(SVG + "text"))


def test_identify_draws_modes_orders_and_the_reconstruction(ctl, tmp_path):
    path = write_batch(tmp_path / "a.h5", decay(400))
    assert ctl("identify", path, "-o", "rank.fixed=4", "--plot", tmp_path / "a.svg").status == 0
    _, dots, dashed, words = drawn(tmp_path / "a.svg")
    assert len(dots) >= 2 + 2 and len(dashed) == 1 and "damping ratio" in words and "order" in words


def test_the_picture_of_orders_shows_every_pole_of_the_result_and_no_other(ctl, tmp_path):
    """Poles of a mode are filled; beside them stand the modes of the first panel, filled too."""
    path = write_batch(tmp_path / "a.h5", decay(400))
    result = ctl("identify", path, "--plot", tmp_path / "a.svg").document
    poles = result["stabilisation"]
    _, dots, _, _ = drawn(tmp_path / "a.svg")
    filled = [e for e in dots if e.get("fill") not in (None, "white")]
    assert len(poles) > 4 and len(dots) == len(result["modes"]) + len(poles)
    assert len(filled) == len(result["modes"]) + sum(p["mode"] is not None for p in poles)


def test_a_response_curve_is_dashed_where_it_is_unstable(ctl, scene, tmp_path):
    said = ctl("steady", scene, "--continue", "omega=0.5:2.5", "--plot", tmp_path / "a.svg")
    assert said.status == 0 and len(said.document["folds"]) == 2
    _, _, dashed, words = drawn(tmp_path / "a.svg")
    assert len(dashed) == 1 and "omega" in words


def test_a_curve_over_another_number_of_the_scene_has_that_number_on_its_axis(ctl, scene, tmp_path):
    said = ctl("steady", scene, "--sweep", "excitation[0].cos=0.1:0.3:3", "--plot",
               tmp_path / "a.svg")
    assert said.status == 0 and "excitation[0].cos" in drawn(tmp_path / "a.svg")[3]
    shown = subprocess.run([BUILD / "bin" / "modalctl", "--local", "steady", scene, "--sweep",
                            "excitation[0].cos=0.1:0.3:3"], capture_output=True, text=True)
    assert [line.split()[0] for line in shown.stdout.splitlines()[1:4]] == ["0.1", "0.2", "0.3"]


def test_a_nonlinear_mode_is_drawn_and_shown_over_its_amplitude(ctl, scene, tmp_path):
    words = [scene, "-o", "backbone=1:0.1:2:5"]
    said = ctl("steady", *words, "--plot", tmp_path / "a.svg")
    assert (said.status == 0 and said.document["plan"]["effects"][0]["active"]
            and said.document["plan"]["effects"][0]["evaluations"] > 100)
    assert all(label in drawn(tmp_path / "a.svg")[3]
               for label in ("amplitude", "omega, rad/s", "damping ratio"))
    shown = subprocess.run([BUILD / "bin" / "modalctl", "--local", "steady", *words],
                           capture_output=True, text=True)
    assert (shown.returncode == 0 and [line.split()[0] for line in shown.stdout.splitlines()[2:7]]
            == ["0.1", "0.211474", "0.447214", "0.945742", "2"])


def test_a_steady_state_has_spectrum_and_orbit(ctl, scene, tmp_path):
    assert ctl("steady", scene, "--plot", tmp_path / "a.svg").status == 0
    _, dots, _, words = drawn(tmp_path / "a.svg")
    assert len(dots) >= 4 and "harmonic k" in words and "its velocity" in words


def test_tradeoff_draws_its_rungs(ctl, tmp_path):
    path = write_batch(tmp_path / "a.h5", decay(300))
    said = ctl("tradeoff", "identify", path, "--plot", tmp_path / "a.svg")
    assert said.status == 0
    _, dots, _, words = drawn(tmp_path / "a.svg")
    rungs = [r for r in said.document["rungs"] if r["error"] and r["seconds"]]
    assert len(dots) == len(rungs) and "seconds" in words


def test_what_has_no_picture_says_so(ctl, batch, tmp_path):
    said = ctl("identify", batch, "-o", "rank.fixed=4", "--plot", tmp_path / "no" / "a.svg")
    assert said.status == 2 and said.document["error"]["field"] == "plot"


@pytest.mark.parametrize("name", ["a.png", "a", "a.svg.pdf"])
def test_a_picture_is_svg_and_another_suffix_is_refused_before_the_work(ctl, batch, tmp_path, name):
    said = ctl("identify", batch, "--plot", tmp_path / name)
    assert (said.status == 2 and said.document["error"]["field"] == "plot"
            and ".svg" in said.document["error"]["message"])
    assert not (tmp_path / name).exists()


def test_a_picture_alone_goes_to_stdout(ctl, batch, tmp_path):
    program = [str(BUILD / "bin" / "modalctl"), "--local"]
    done = subprocess.run([*program, "identify", str(batch), "-o", "rank.fixed=4", "--plot", "-"],
                          capture_output=True, cwd=tmp_path)
    assert done.returncode == 0 and list(tmp_path.iterdir()) == []
    assert tree.fromstring(done.stdout).tag == SVG + "svg"
    # --json has stdout
    assert ctl("identify", batch, "--plot", "-").document["error"]["field"] == "plot"
    for name in ("a.png", "-"):                       # drawn anew with every window
        done = subprocess.run([program[0], "--server", "ipc:///no/daemon", "--json", "watch", "x",
                               "--plot", name], capture_output=True)
        assert done.returncode == 2 and json.loads(done.stdout)["error"]["field"] == "plot"


def test_python_draws_them_too(ctl, scene, tmp_path):
    plots = pytest.importorskip("modald.plots")
    plots.use("agg")
    path = write_batch(tmp_path / "a.h5", decay(300))
    for draw, said in ((plots.modes, ctl("identify", path, "-o", "rank.fixed=4")),
                       (plots.tradeoff, ctl("tradeoff", "identify", path)),
                       (plots.curve, ctl("steady", scene, "--continue", "omega=0.5:2.5")),
                       (plots.orbit, ctl("steady", scene))):
        draw(said.document).savefig(tmp_path / "a.png")
        assert (tmp_path / "a.png").stat().st_size > 5000


def pictured(daemon, path, windows, dots):
    """Watch until all windows have come and the picture, which is replaced whole, has so many dots.
    """
    def complete(lines):
        if len(lines) < windows:
            return False
        until(lambda: path.exists() and len(drawn(path)[1]) == dots)
        return True
    watched(daemon, "seen", "--after", "0", "--plot", path, until=complete)


def test_a_watched_stream_has_a_picture_of_frequency_and_damping_window_by_window(ctl, tmp_path):
    """0.3 Hz at zeta 0.01, 600 samples: five windows of 200 every 100, a dot in each panel for
    each; then an epoch from 590 on, of two windows.
    """
    with Daemon(workers=1) as d:
        c, t = d.client(), np.arange(600) * 0.1
        y = (np.exp(-0.01 * 2 * np.pi * 0.3 * t) * np.cos(2 * np.pi * 0.3 * t)).reshape(-1, 1)
        c.ask("EVENTS", stream="seen")
        s = c.ask("STREAM", op="open", name="seen", channels=1, dt=0.1,
                  window={"samples": 200, "hop": 100, "options": {"rank.fixed": 2}})["stream"]
        told = 0
        for at in range(0, 600, 100):
            data = y[at:at + 100].tobytes()
            assert c.ask("STREAM", [data], op="push", stream=s, epoch=0, first=at, count=100,
                         crc32c=crc32c(data)).ok
            while at >= 100 and told < at // 100:
                told += (c.early.pop(0) if c.early else c.receive()).verb == "EVENT"
        pictured(d, tmp_path / "a.svg", 5, 10)
        for at, count in ((0, 200), (200, 100)):
            data = (2 * y[at:at + count]).tobytes()
            assert (c.ask("STREAM", [data], op="push", stream=s, epoch=0, first=590 + at,
                          count=count, crc32c=crc32c(data))["epoch"] == 1)
            assert (c.early.pop(0) if c.early else c.receive()).header["epoch"] == 1
        pictured(d, tmp_path / "anew.svg", 7, 4)
    root, dots, _, words = drawn(tmp_path / "a.svg")
    assert (len(dots) == 10 and "frequency, Hz" in words and "damping ratio" in words
            and "seen" in words)
    assert len(drawn(tmp_path / "anew.svg")[1]) == 4
    assert not list(tmp_path.glob(".modalctl-*"))
