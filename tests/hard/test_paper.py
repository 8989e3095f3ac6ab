"""tests/paper/run regenerates what it says: a study or two of it, on its coarse grids, against the
reference's numbers.
"""
import json
import os
import pathlib
import subprocess

import pytest

TOP = pathlib.Path(__file__).resolve().parents[2]
BUILD = pathlib.Path(os.environ.get("MODALD_BUILD", TOP / "build"))
pytestmark = pytest.mark.skipif(not (BUILD / "bin/modalctl").exists(),
                                reason=f"no {BUILD}/bin/modalctl: build first")


def regenerate(folder, *studies):
    done = subprocess.run([TOP / "tests/paper/run", "--quick", "--out", folder, "--only",
                           *studies], capture_output=True, text=True,
                          env={**os.environ, "MODALD_BUILD": str(BUILD)}, timeout=600)
    assert done.returncode == 0, done.stderr
    return json.loads((folder / "results.json").read_text())


def test_table_1_has_the_harmonics_of_the_reference(tmp_path):
    """|g_1| = 0.4451, |g_-1| = 0.1312 mm, alike in u2 and u3 (reference/rotor:
    table1_coefficients.csv, set C).
    """
    tables = regenerate(tmp_path, "signals")
    rows = next(t for name, t in tables.items() if name.startswith("Table 1"))["rows"]
    g = {int(k): (float(a), float(b)) for k, _, a, b in rows}
    for channel in (0, 1):
        assert g[1][channel] == pytest.approx(0.4451, abs=1e-4)
        assert g[-1][channel] == pytest.approx(0.1312, abs=1e-4)
        assert max(g[k][channel] for k in g if abs(k) != 1) < 2e-4
    assert (tmp_path / "fig07_signals.svg").exists() and (tmp_path / "tables.md").exists()


def test_both_cases_of_the_wing_give_one_flutter_speed(tmp_path):
    """585.600 exactly, 585.615 identified from points 5 ft/s apart (reference/wing): here by
    bisection, to 0.1 ft/s.
    """
    tables = regenerate(tmp_path, "flutter")
    rows = tables["Figure 10: flutter speed [ft/s]"]["rows"]
    assert float(rows[0][2]) == pytest.approx(585.600, abs=0.01)
    assert float(rows[1][2]) == pytest.approx(585.600, abs=0.1)
    assert float(rows[2][2]) == pytest.approx(585.600, abs=0.1)
    assert all(float(r[4]) < 1e-9
               for r in tables["Four matrices at 590 ft/s: the flutter exponent"]["rows"])


def test_the_friction_dampers_error_falls_as_its_series_does(tmp_path):
    """A force with corners: k^-4 in the motion's spectrum, so N^-3 in its largest error; corners
    between samples leave N^-2.
    """
    rows = {r[0]: r[2]
            for r in regenerate(tmp_path, "friction_damper")["Cameron and Griffin's friction "
                                                             "damper: figures 4 to 6"]["rows"]}
    assert float(rows["the same with reversals located"]) == pytest.approx(-3, abs=0.15)
    assert -2.5 < float(rows["exponent of the error, N = 64 to 256, sampled (10)"]) < -1.5
    assert (tmp_path / "friction_damper.svg").exists()
