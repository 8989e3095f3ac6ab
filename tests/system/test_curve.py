"""A response curve with friction, a gap and a cubic spring together, through the daemon by the
Python client: events, folds, a picture.
"""
import pytest
from conftest import PATIENCE

SCENE = {"structure": {"type": "chain", "masses": [1, 1, 1], "springs": [1, 1, 1, 0],
                       "dampers": [0.02, 0.02, 0.02, 0]}, "omega": 0.53,
         "effects": [{"type": "friction", "dof": "x1", "stiffness": 0.4, "limit": 0.1},
                     {"type": "gap", "dof": "x3", "clearance": 0.9, "stiffness": 1.5},
                     {"type": "cubic_spring", "dof": "x2", "to": "x3", "coefficient": 0.15}],
         "excitation": [{"dof": "x3", "k": 1, "cos": 0.12}], "steady": {"harmonics": 9}}


def test_a_curve_with_three_laws_comes_with_events_folds_and_a_picture(client, tmp_path):
    plots = pytest.importorskip("modald.plots")
    job = client.submit("steady", SCENE, {"continue": "omega=0.53:0.58"})
    told = []
    for event in client.events(start=0, job=job.id, timeout=PATIENCE):
        told.append(event.header)
        if event.header.get("state") in ("done", "failed"):
            break
    curve = job.result(PATIENCE)
    assert (curve["kind"] == "curve" and all(p["converged"] for p in curve["points"])
            and all(e["active"] for e in curve["plan"]["effects"]))

    progress = [e["progress"] for e in told if e.get("event") == "progress"]
    assert (len(progress) > 1 and all(e["parameter"] == "omega" and 0.53 <= e["value"] <= 0.58
                                      and e["converged"] for e in progress))
    seen = [p["omega"] for p in curve["points"]]
    assert all(min(abs(e["value"] - w) for w in seen) < 1e-12 for e in progress)

    # The gap stiffens: the branch bends to the right, is unstable between its two folds, and ends
    # where it was told to.
    up, down = (f["omega"] for f in curve["folds"])
    assert 0.58 > up > down > 0.53 and abs(curve["points"][-1]["omega"] - 0.58) < 1e-12
    between = [p for a, p, b in zip(curve["points"], curve["points"][1:], curve["points"][2:])
               if a["omega"] > p["omega"] > b["omega"]]
    assert (len(between) > 5 and sum(p["stability"]["stable"] is False for p in between) > 0.8
            * len(between))
    assert not [b for b in curve["bifurcations"] if b["type"] == "branch_point"]

    plots.use("agg")
    plots.curve(curve).savefig(tmp_path / "curve.png")
    assert (tmp_path / "curve.png").stat().st_size > 5000
