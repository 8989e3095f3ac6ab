"""Bodies that sliders alone hold, and motions of nothing: what is found is an orbit, what runs away
is none, and zero counts once.
"""
import json
import os
import pathlib
import subprocess

import numpy
import pytest

TOP = pathlib.Path(__file__).resolve().parents[2]
DATA = TOP / "tests" / "data" / "steady"
CTL = pathlib.Path(os.environ.get("MODALD_BUILD", TOP / "build")) / "bin" / "modalctl"
pytestmark = pytest.mark.skipif(not CTL.exists(), reason=f"no {CTL}: build first")


def run(name, *args):
    done = subprocess.run([CTL, "--local", "--json", "steady", DATA / f"{name}.json", *args],
                          capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout[:400] + done.stderr[:400]
    return json.loads(done.stdout)


def codes(answer):
    return [d["code"] for d in answer["diagnostics"]]


def march(periods, steps):
    """x'' + 0.1 x' + slider = cos t, of unit mass: the last period's displacements and what the
    mean drifted over it.
    """
    h, x, v, z = 2 * numpy.pi / steps, 0.0, 0.0, 0.0
    out = numpy.empty(steps)
    for _ in range(periods):
        begun = x
        for j in range(steps):
            out[j] = x
            v += h * (numpy.cos((j + 0.5) * h) - 0.1 * v - (x + 0.5 * h * v - z))
            x += h * v
            z = min(max(z, x - 0.3), x + 0.3)
    return out, x - begun


def test_a_free_mass_that_a_slider_alone_holds_moves_as_time_marching_says_about_a_free_mean():
    answer = run("free_mass_one_tone", "-o", "harmonics=63")
    samples, drift = march(200, 4000)
    first = 2 * numpy.mean(samples * numpy.exp(-2j * numpy.pi * numpy.arange(4000) / 4000))
    motion = answer["harmonics"][0]
    assert answer["converged"] and abs(drift) < 1e-6
    # of marching at first order
    assert abs(complex(motion["re"][1], motion["im"][1]) - first) < 5e-3 * abs(first)
    assert "undetermined_mean" in [d["code"] for d in answer["diagnostics"]]
    assert answer["total_error"] < 1e-3 * abs(first)


@pytest.mark.parametrize("name", ["free_body_61", "free_body_80"])
def test_a_structure_that_sliders_alone_hold_has_its_orbit_found(name):
    answer = run(name)
    assert (answer["converged"] and answer["residual"] < 1e-12
            and "undetermined_mean" in [d["code"] for d in answer["diagnostics"]])


def test_a_mean_that_runs_away_is_no_convergence():
    """Two tones make it a ratchet: it drifts, and has no periodic motion, however small a share of
    its place the drift is. Whether the search runs away first or meets a singular derivative is a
    matter of rounding, and so of the processor's kernels.
    """
    answer = run("free_mass_two_tones")
    assert (not answer["converged"]
            and answer["diagnostics"][0]["code"] == "not_converged"), answer["diagnostics"]


def test_of_all_solutions_rest_is_given_once():
    """Mathieu's equation beyond its threshold, stiffening: rest, and one motion twice, half a
    period apart.
    """
    answer = run("mathieu_beyond_threshold")
    sizes = sorted(max(abs(complex(a, b)) for a, b in zip(m["re"], m["im"]))
                   for s in answer["solutions"] for m in s["harmonics"])
    assert len(sizes) == 3 and sizes[0] == 0 and sizes[1] > 0.1 and abs(sizes[2] - sizes[1]) < 1e-9


def relative_motion(damping, force, periods=12, steps=256):
    """d'' + damping d' + 2 d + force(d) = 4 cos t by RK4: the last period's displacements."""
    def rate(t, y):
        return numpy.array([y[1], 4 * numpy.cos(t) - damping * y[1] - 2 * y[0] - force(y[0])])
    h, y, out = 2 * numpy.pi / steps, numpy.zeros(2), numpy.empty(steps)
    for j in range(periods * steps):
        out[j % steps] = y[0]
        a = rate(j * h, y)
        b = rate((j + 0.5) * h, y + h / 2 * a)
        c = rate((j + 0.5) * h, y + h / 2 * b)
        y = y + h / 6 * (a + 2 * b + 2 * c + rate((j + 1) * h, y + h * c))
    return out


def two_free_masses(tmp_path, effect, c, harmonics):
    """Unit masses, a spring of 1 and a damper of C between them, driven apart by 2 cos t each."""
    scene = {"structure": {"type": "matrices", "M": [[1, 0], [0, 1]],
                           "K": [[1, -1], [-1, 1]], "C": [[c, -c], [-c, c]]},
             "effects": [effect], "omega": 1.0,
             "steady": {"harmonics": harmonics, "stability": False},
             "excitation": [{"dof": "x1", "k": 1, "cos": -2.0}, {"dof": "x2", "k": 1, "cos": 2.0}]}
    (tmp_path / "free.json").write_text(json.dumps(scene))
    answer = run(tmp_path / "free")
    assert answer["converged"]
    return answer


def off(answer, motion):
    """What is between each of two free masses and its place, at most over time: half of what their
    distance is off, for their middle rests.
    """
    z = [numpy.array(h["re"]) + 1j * numpy.array(h["im"]) for h in answer["harmonics"]]
    turns = numpy.outer(numpy.arange(len(motion)) / len(motion), numpy.arange(len(z[0])))
    return abs((numpy.exp(2j * numpy.pi * turns) @ (z[1] - z[0])).real - motion).max() / 2


@pytest.mark.parametrize("law", ["cubic_spring", "gap"])
def test_two_free_masses_have_the_error_of_their_motion_about_a_mean_that_nothing_holds(
        law, tmp_path):
    effect = {"type": "cubic_spring", "dof": "x2", "to": "x1", "coefficient": 0.5}
    if law == "gap":                  # that never closes: the derivative's first row is 0
        effect = {"type": "gap", "dof": "x2", "clearance": 1e3, "stiffness": 1.0}
    answer = two_free_masses(tmp_path, effect, 0.3, 5)
    assert "undetermined_mean" in codes(answer)
    if law == "gap":
        assert answer["total_error"] < 1e-9
        return
    error = off(answer, relative_motion(0.6, lambda d: d ** 3))
    assert error < 3 * answer["total_error"] < 9 * error


def test_the_distance_of_two_free_masses_has_the_error_of_its_mean_where_their_middle_has_none(
        tmp_path):
    """Without the mean's, 4 % is missing."""
    effect = {"type": "gap", "dof": "x2", "to": "x1", "clearance": 0.2, "stiffness": 1.0}
    answer = two_free_masses(tmp_path, effect, 1.0, 2)
    error = off(answer, relative_motion(2.0, lambda d: 2 * max(d - 0.2, 0)))
    assert "undetermined_mean" in codes(answer)
    assert abs(answer["total_error"] - error) < 0.01 * error


def test_an_undamped_resonance_that_nothing_drives_is_no_mean_that_nothing_holds(tmp_path):
    scene = {"structure": {"type": "matrices", "M": [[1, 0], [0, 1]], "K": [[1, 0], [0, 2]],
                           "C": [[0, 0], [0, 0.3]]},
             "effects": [{"type": "cubic_spring", "dof": "x2", "coefficient": 0.5},
                         {"type": "gap", "dof": "x1", "clearance": 1e3, "stiffness": 1.0}],
             "omega": 1.0, "steady": {"harmonics": 5, "stability": False},
             "excitation": [{"dof": "x2", "k": 1, "cos": 2.0}]}
    (tmp_path / "resonant.json").write_text(json.dumps(scene))
    answer = run(tmp_path / "resonant")
    assert answer["converged"] and codes(answer) == ["error_unknown"]


@pytest.mark.parametrize("harmonics", [5, 8])
def test_a_mean_that_nothing_holds_is_told_of_a_motion_through_its_events_too(tmp_path, harmonics):
    effect = {"type": "gap", "dof": "x2", "to": "x1", "clearance": 0.1, "stiffness": 50.0}
    answer = two_free_masses(tmp_path, effect, 1.0, harmonics)
    assert answer["method"] == ("events" if harmonics == 8 else "newton")
    assert codes(answer) == ["undetermined_mean"]


def rigid(tmp_path, beside, *args):
    """x'' + 0.05 x' + x + 0.3 sign x' + the laws BESIDE = cos 1.1 t, 15 harmonics."""
    scene = {"structure": {"type": "matrices", "M": [[1]], "K": [[1]], "C": [[0.05]]},
             "effects": [{"type": "coulomb", "dof": "x1", "limit": 0.3}, *beside], "omega": 1.1,
             "excitation": [{"dof": "x1", "k": 1, "cos": 1}]}
    (tmp_path / "rigid.json").write_text(json.dumps(scene))
    return run(tmp_path / "rigid", "-o", "harmonics=15", *args)["reconstruction"]


def test_a_sharpened_motion_tells_what_it_leaves_of_rigid_frictions_jumps(tmp_path):
    told = rigid(tmp_path, [], "-o", "method=newton")
    k = numpy.arange(17, 2048, 2)                       # of the square wave, past 15
    rest = 4 * 0.3 / numpy.pi / k
    assert told["rms_residual"] == pytest.approx(numpy.sqrt((rest ** 2).sum() / 2), rel=0.05)
    assert told["max_residual"] == pytest.approx(rest.sum(), rel=0.05)


def test_forces_that_nobody_sampled_leave_no_residual_of_0(tmp_path):
    told = rigid(tmp_path, [{"type": "cubic_spring", "dof": "x1", "coefficient": 0.1}])
    assert told == {"rms_residual": None, "max_residual": None, "relative_residual": None}
