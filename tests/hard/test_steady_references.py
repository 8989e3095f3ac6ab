"""Steady states against references computed by other means (tests/data/steady): spectra,
multipliers, folds, counts, refusals.
"""
# Tests as well: backbone.c monodromy.c offset.c path.c resonance.c solutions.c stability.c
import cmath
import csv
import json
import math
import os
import pathlib
import subprocess

import h5py
import numpy
import pytest
import scipy.special

TOP = pathlib.Path(__file__).resolve().parents[2]
DATA = TOP / "tests" / "data" / "steady"
CTL = pathlib.Path(os.environ.get("MODALD_BUILD", TOP / "build")) / "bin" / "modalctl"
pytestmark = pytest.mark.skipif(not CTL.exists(), reason=f"no {CTL}: build first")


def load(name):
    return json.loads((DATA / f"{name}.json").read_text())


def run(tmp_path, scene, *args, status=0):
    path = tmp_path / "scene.json"
    path.write_text(json.dumps(scene))
    done = subprocess.run([CTL, "--local", "--json", "steady", path, *args], capture_output=True,
                          text=True, timeout=600)
    assert done.returncode == status, done.stdout[:400] + done.stderr[:400]
    return json.loads(done.stdout)


def oscillator(omega, effects, m=1, c=0, k=1, cos=0, loads=None, **steady):
    return {"structure": {"type": "matrices", "M": [[m]], "C": [[c]], "K": [[k]]}, "omega": omega,
            "effects": effects,
            "excitation": loads if loads is not None else [{"dof": "x1", "k": 1, "cos": cos}],
            "steady": steady}


def cubic(g, dof="x1", **more):
    return {"type": "cubic_spring", "dof": dof, "coefficient": g, **more}


def friction(k, limit, dof="x1"):
    return {"type": "friction", "dof": dof, "stiffness": k, "limit": limit}


def near(solution, *ks):
    """A start from some of a reference's own harmonics: which of several solutions is meant."""
    return {"x1": {"k": list(ks), "re": [solution["a"][k] for k in ks],
                   "im": [-solution["b"][k] for k in ks]}}


def spectrum(result, dof=0):
    row = result["harmonics"][dof]
    return [complex(re, im) for re, im in zip(row["re"], row["im"])]


def exact(solution):
    return [complex(a, -b) for a, b in zip(solution["a"], solution["b"])]


def off(result, solution, dof=0, first=0):
    x, y = spectrum(result, dof), exact(solution)
    return max(abs(p - q) for p, q in list(zip(x, y))[first:]) / max(abs(q) for q in y)


def multipliers_off(result, expected):
    have = [complex(*m) for m in result["stability"]["multipliers"]]
    return max(min(abs(complex(*m) - h) for h in have) for m in expected)


DAMPER = oscillator(0.25, [friction(0.25, 0.25)], c=0.02, k=0.75,
                    loads=[{"dof": "x1", "k": 2, "sin": 0.75}, {"dof": "x1", "k": 3, "sin": 0.5},
                           {"dof": "x1", "k": 4, "sin": 0.375}])


def damper_waveform():
    with open(DATA / "friction_damper_time_1024.csv") as file:
        return [float(row["x"]) for row in csv.DictReader(file)]


def test_the_friction_dampers_spectrum_is_within_1e_9_at_512_harmonics(tmp_path):
    r = run(tmp_path, DAMPER, "-o", "harmonics=512")
    want = [complex(float(x["re"]), float(x["im"])) * (2 if x["k"] else 1)
            for x in load("friction_damper")["X_first"]]
    assert r["converged"] and max(abs(a - b) for a, b in zip(spectrum(r), want)) < 1e-9
    assert (multipliers_off(r,
                            [[float(m), 0] for m in load(
        "friction_damper")["poincare_map_eigenvalues_xv"]]) < 1e-8)


@pytest.mark.parametrize("harmonics", [8, 16, 32, 64, 128, 256])
def test_the_friction_dampers_error_is_estimated_within_a_factor_of_3(tmp_path, harmonics):
    r = run(tmp_path, DAMPER, "-o", f"harmonics={harmonics}", "-o", "time=1024")
    error = max(abs(a - b) for a, b in zip(r["time"]["x"]["x1"], damper_waveform()))
    assert error / 3 < r["truncation_error"] < 3 * error
    assert harmonics < 256 or error < 1e-6


@pytest.mark.parametrize("level", [0.01, 0.1, 0.25, 0.5, 1, 2, 4, 10, 100])
def test_every_cell_of_the_friction_dampers_map_is_solved(tmp_path, level):
    for scale in (0.6, 0.8, 0.9, 1.0, 1.1, 1.2, 1.4, 1.6, 2.0, 3.0):
        scene = json.loads(json.dumps(DAMPER))
        scene["omega"] *= scale
        for load_ in scene["excitation"]:
            load_["sin"] *= level
        assert run(tmp_path, scene, "-o", "harmonics=32", "-o",
                   "stability=false")["converged"], (level, scale)


@pytest.mark.parametrize("row", load("direct_iteration_diverges")["rows"],
                         ids=lambda r: f"{r['level']}-{r['frequency_scale']}")
def test_where_direct_iteration_diverges_auto_is_right(tmp_path, row):
    scene = json.loads(json.dumps(DAMPER))
    scene["omega"] *= row["frequency_scale"]
    for load_ in scene["excitation"]:
        load_["sin"] *= row["level"]
    r = run(tmp_path, scene, "-o", "harmonics=128")
    solution = {"a": [x * (2 if k else 1) for k, x in enumerate(row["X_re"])],
                "b": [-2 * x for x in row["X_im"]]}
    assert r["converged"] and off(r, solution, first=1 if row["stuck_all_period"] else 0) < 2e-7


@pytest.mark.parametrize("i", range(14))
def test_duffing_is_exact_to_1e_12_with_its_multipliers(tmp_path, i):
    d = load("duffing")
    s = d["solutions"][i]
    r = run(tmp_path, oscillator(s["omega"], [cubic(0.1)], c=0.05, cos=0.18, harmonics=25,
                                 start=near(s, 1, 3)))
    assert r["converged"] and off(r, s) < 1e-12
    assert (multipliers_off(r, s["floquet_multipliers"]) < 1e-8
            and r["stability"]["stable"] is s["stable"])


def test_duffings_folds_are_located_to_1e_9(tmp_path):
    c = run(tmp_path, oscillator(1.2, [cubic(0.1)], c=0.05, cos=0.18, harmonics=15,
                                 stability=False), "--continue", "omega=0.5:1.6")
    folds = sorted(f["omega"] for f in c["folds"])
    assert folds == pytest.approx([1.115700251771, 1.269601955546], abs=1e-9)
    assert c["points"][0]["omega"] == 0.5 and c["points"][-1]["omega"] == 1.6


@pytest.mark.parametrize("i", range(10))
def test_jenkins_slider_is_right_and_says_when_its_offset_is_undetermined(tmp_path, i):
    s = load("jenkins_sdof")["solutions"][i]
    loads = [{"dof": "x1", "k": 1, "cos": s["P"]}] + [{"dof": "x1", "k": t[0], "cos": t[1],
                                                       "sin": t[2]} for t in s["tones"]]
    r = run(tmp_path, oscillator(s["omega"], [friction(1, 1)], c=0.02, loads=loads, harmonics=128))
    stuck = s["stable"] == "neutral"
    assert r["converged"] and off(r, s, first=1 if stuck else 0) < 1e-8
    assert multipliers_off(r, s["poincare_eigenvalues"]) < 1e-8
    assert r["plan"]["effects"][0]["active"] is not stuck
    assert ("undetermined_offset" in [d["code"] for d in r["diagnostics"]]) is stuck
    assert r["stability"]["stable"] is (None if stuck else s["stable"])


@pytest.mark.parametrize("i", range(12))
def test_one_sided_contact_is_right_stable_or_not(tmp_path, i):
    s = load("unilateral_sdof")["solutions"][i]
    gap = {"type": "gap", "dof": "x1", "stiffness": 10, "clearance": s["gap"]}
    r = run(tmp_path, oscillator(s["omega"], [gap], c=0.1, cos=s["P"], harmonics=128,
                                 start=near(s, 0, 1, 2, 3)))
    assert r["converged"] and off(r, s) < 2e-8
    assert (multipliers_off(r, s["poincare_eigenvalues"]) < 3e-8
            and r["stability"]["stable"] is s["stable"])


@pytest.mark.parametrize("i", range(6))
def test_the_forced_van_der_pol_oscillator_is_right(tmp_path, i):
    s = load("van_der_pol_forced")["solutions"][i]
    damper = {"type": "polynomial_damper", "dof": "x1", "coefficients": [-0.5, 0, 0.5]}
    r = run(tmp_path, oscillator(s["omega"], [damper], cos=1.0, harmonics=41, start=near(s, 1, 3)))
    assert r["converged"] and off(r, s) < max(1e-11, 3 * r["truncation_error"])
    assert multipliers_off(r, s["floquet_multipliers"]) < 1e-8


@pytest.mark.parametrize("i", range(5))
def test_parametric_excitation_with_a_cubic_spring_is_right(tmp_path, i):
    s = load("mathieu_duffing")["solutions"][i]
    effects = [{"type": "parametric_stiffness", "dof": "x1", "stiffness": 0.3, "k": 2}, cubic(0.2)]
    r = run(tmp_path, oscillator(s["omega"], effects, c=0.05, loads=[], harmonics=25,
                                 start=near(s, 1, 3)))
    assert (r["converged"] and off(r, s) < 1e-11
            and multipliers_off(r, s["floquet_multipliers"]) < 1e-8)


@pytest.mark.parametrize("name", ["3 solutions", "1:3 subharmonic", "superharmonic region"])
def test_all_solutions_are_found_and_none_twice(tmp_path, name):
    s = load("multiple_solutions")["sets"][name]
    k = round(s["omega"] / s["fundamental"])
    scene = oscillator(s["fundamental"], [cubic(s["gamma"])], c=s["c"],
                       loads=[{"dof": "x1", "k": k, "cos": s["P"]}], harmonics=21, solutions="all")
    found = [exact_ for exact_ in (spectrum(r) for r in run(tmp_path, scene)["solutions"])]
    assert len(found) == s["count"]
    for want in s["solutions"]:
        assert min(abs(abs(x[1]) - want["amp1"]) for x in found) < 1e-9


@pytest.mark.parametrize("row", load("near_fold")["rows"], ids=lambda r: str(r["offset_from_fold"]))
def test_near_a_fold_the_count_of_solutions_is_right(tmp_path, row):
    r = run(tmp_path, oscillator(row["omega"], [cubic(0.1)], c=0.05, cos=0.18, harmonics=21,
                                 solutions="all", stability=False))
    assert (sorted(abs(spectrum(p)[1]) for p in r["solutions"])
            == pytest.approx(sorted(row["amplitudes"]), rel=1e-8))


def test_a_singular_linear_part_is_no_obstacle_and_no_solution_is_said(tmp_path):
    d = load("singular_dynamic_stiffness")
    for row in d["duffing"]["rows"]:
        r = run(tmp_path, oscillator(1, [cubic(row["gamma"])], cos=row["P"], harmonics=25))
        assert r["converged"] and off(r, row) < 1e-11
    for row in d["jenkins"]["rows"]:
        r = run(tmp_path, oscillator(1, [friction(1, 1)], cos=row["P"], harmonics=128))
        assert r["converged"] and off(r, row, first=1) < 1e-7
    r = run(tmp_path, oscillator(1, [friction(1, 1)], cos=1.3, harmonics=31))
    assert not r["converged"] and "no_periodic_solution" in [x["code"] for x in r["diagnostics"]]
    row = d["singular_dc"]["rows"][0]
    r = run(tmp_path, oscillator(row["omega"], [cubic(row["gamma"])], c=row["c"], k=0,
                                 cos=row["P"], harmonics=25))
    assert r["converged"] and off(r, row) < 1e-11


@pytest.mark.parametrize("row", load("stuck_offset")["rows"],
                         ids=lambda r: f"{r['P']}-{r['omega']}")
def test_a_stuck_slider_is_put_at_zero(tmp_path, row):
    r = run(tmp_path, oscillator(row["omega"], [friction(1, 1)], c=0.02, cos=row["P"]))
    x = spectrum(r)
    assert (abs(x[1] - complex(row["a1"], -row["b1"])) < 1e-13 * row["amp1"] and abs(x[0]) < 1e-15
            * row["amp1"])
    assert r["plan"]["effects"][0]["active"] is False


@pytest.mark.parametrize("row", load("tiny_forcing")["rows"], ids=lambda r: r["model"].split()[0]
                         + str(r["P"]))
def test_tiny_forcing_reaches_the_linear_limit(tmp_path, row):
    effects, c = {"duffing": ([cubic(0.1)], 0.05), "jenkins": ([friction(1, 1)], 0.02),
                  "unilateral": ([{"type": "gap", "dof": "x1", "stiffness": 10, "clearance": 1}],
                                 0.1)}[row["model"].split()[0]]
    x = spectrum(run(tmp_path, oscillator(0.8, effects, c=c, cos=row["P"])))
    want = complex(row["a1"], -row["b1"])
    assert abs(x[1] - want) <= (1e-14 + 2 * row.get("relative_nonlinear_correction", 0)) * abs(want)


def test_units_do_not_matter(tmp_path):
    counts = set()
    for row in load("mixed_scales")["rows"]:
        r = run(tmp_path, oscillator(row["omega"], [cubic(row["gamma"])], m=row["m"], c=row["c"],
                                     k=row["k"], cos=row["P"], harmonics=21, start=near(row, 1)))
        assert r["converged"] and off(r, row) < 1e-12
        counts.add(r["iterations"])
    assert len(counts) == 1


@pytest.mark.parametrize("row",
                         [r for r in load("aliasing")["rows"] if r["converged"]
                          and (r["H"], r["N"]) != (3, 7)], ids=lambda r: f"{r['H']}-{r['N']}")
def test_a_coarse_grid_aliases_just_as_the_algebra_says(tmp_path, row):
    r = run(tmp_path, oscillator(0.9, [cubic(1)], c=0.05, cos=0.5, harmonics=row["H"],
                                 samples=row["N"], stability=False))
    assert abs(abs(spectrum(r)[1]) - row["amp1"]) < 1e-12


@pytest.mark.parametrize("i", range(16))
def test_the_strong_duffing_oscillator_is_exact_with_its_multipliers(tmp_path, i):
    d = load("duffing_strong")
    s = d["solutions"][i]
    r = run(tmp_path, oscillator(s["omega"], [cubic(1)], c=0.02, cos=0.5, harmonics=61,
                                 start=near(s, 1, 3, 5)))
    assert r["converged"] and off(r, s) < 1e-12
    assert (multipliers_off(r, s["floquet_multipliers"]) < 1e-9
            and r["stability"]["stable"] is s["stable"])


def test_the_strong_duffing_oscillators_four_folds_are_located(tmp_path):
    c = run(tmp_path, oscillator(1, [cubic(1)], c=0.02, cos=0.5, harmonics=41, stability=False),
            "--continue", "omega=0.35:5.5")
    assert (sorted(f["omega"] for f in c["folds"])
            == pytest.approx(sorted(f["omega"] for f in load("duffing_strong")["folds"]), abs=1e-9))


def chain(d, effect, s, **steady):
    p = d["parameters"]
    springs = [p["k"] * p["ground"][0]] + [p["k"]] * (p["n"] - 1) + [p["k"] * p["ground"][1]]
    return {"structure": {"type": "chain", "masses": [p["m"]] * p["n"], "springs": springs},
            "omega": s["omega"],
            "effects": [{"type": "rayleigh_damping", "alpha": p["alpha"], "beta": p["beta"]},
                        effect],
            "excitation": [{"dof": f"x{p['f_dof'] + 1}", "k": 1, "cos": s.get("P", p.get("P"))}],
            "steady": steady}


@pytest.mark.parametrize("i", range(9))
def test_twelve_dofs_with_a_cubic_spring_are_exact(tmp_path, i):
    d = load("chain12_cubic")
    s, p = d["solutions"][i], d["parameters"]
    start = {f"x{j + 1}": near(q, 1, 3)["x1"] for j, q in enumerate(s["dofs"])}
    r = run(tmp_path, chain(d, cubic(p["gamma"], f"x{p['nl_dof'] + 1}"), s, harmonics=42,
                            start=start))
    assert r["converged"] and max(off(r, q, j) for j, q in enumerate(s["dofs"])) < 1e-12
    assert (multipliers_off(r, s["floquet_multipliers"]) < 1e-9
            and r["stability"]["stable"] is s["stable"])


# H^-3 and finer of truncation: 1e-8 at 256 harmonics; a stuck slider leaves a linear chain.
@pytest.mark.parametrize("i", range(7))
def test_twenty_dofs_with_a_slider_are_right(tmp_path, i):
    d = load("chain20_jenkins")
    s, p = d["solutions"][i], d["parameters"]
    r = run(tmp_path, chain(d, friction(p["kt"], p["muN"], f"x{p['nl_dof'] + 1}"), s,
                            harmonics=256))
    stuck = s["phase_changes"] == 0
    assert (r["converged"]
            and max(off(r, q, j, 1 if stuck else 0) for j, q in enumerate(s["dofs"]))
            < (1e-11 if stuck else 2e-9))
    assert r["stability"]["stable"] is (None if stuck else True)


# From one reference motion (without stops) to another: the force is monotone in the rate, so there
# is one motion and no fold.
def test_a_curve_under_rigid_friction_has_the_exact_motions_at_its_ends(tmp_path):
    d = load("rigid_coulomb")
    first, last = d["solutions"][2], d["solutions"][0]
    c = run(tmp_path, oscillator(2,
                                 [{"type": "coulomb", "dof": "x1",
                                   "limit": d["parameters"]["muN"]}], cos=1), "--continue",
            "omega=2:1.5")
    assert (first["omega"], first["P"], last["omega"], last["P"]) == (2, 1, 1.5, 1)
    assert (c["complete"] and c["folds"] == []
            and [c["points"][i]["omega"] for i in (0, -1)] == [2, 1.5])
    assert off(c["points"][0], first) < 1e-11 and off(c["points"][-1], last) < 1e-11
    assert all(p["converged"] and p["method"] == "events" and p["total_error"] < 1e-4
               for p in c["points"])


# x = A cos 2t is made the exact motion of H = 11 harmonics: the load is the linear force and the
# reference's force.
@pytest.mark.parametrize("row", load("jenkins_describing_function")["rows"],
                         ids=lambda r: f"{r['kt']}-{r['ratio']}")
def test_a_sliders_force_harmonics_are_the_closed_form(tmp_path, row):
    A = row["amplitude"]
    loads = [{"dof": "x1", "k": k, "cos": a - (3 * A if k == 1 else 0), "sin": b}
             for k, (a, b) in enumerate(zip(row["force_a"], row["force_b"])) if k]
    scene = oscillator(2, [friction(row["kt"], row["muN"])], loads=loads,
                       harmonics=len(row["force_a"]) - 1,
                       start={"x1": {"k": [1], "re": [A], "im": [0]}})
    x = spectrum(run(tmp_path, scene))
    assert abs(x[1] - A) < 1e-12 * A and max(abs(v) for v in x[2:]) < 1e-12 * A


@pytest.mark.parametrize("i", range(7))
def test_rigid_friction_is_exact_with_stops_and_without(tmp_path, i):
    d = load("rigid_coulomb")
    s = d["solutions"][i]
    r = run(tmp_path, oscillator(s["omega"],
                                 [{"type": "coulomb", "dof": "x1",
                                   "limit": d["parameters"]["muN"]}], cos=s["P"], time=4096))
    assert r["converged"] and off(r, s) < 1e-11
    assert abs(max(r["time"]["x"]["x1"]) - s["max_abs_x"]) < 3 * r["total_error"]
    assert r["stability"]["stable"] is True
    if s["stops_per_period"] == 0:
        assert multipliers_off(r, s["poincare_eigenvalues"]) < 1e-10
    else:                                                  # a body at rest has forgotten its speed
        assert min(abs(complex(*m)) for m in r["stability"]["multipliers"]) < 1e-12


# No stops: harmonic balance with its jumps located is another way to the same motion, to H^-2 and
# extrapolated.
def test_two_bodies_rubbing_on_each_other_are_followed_as_balanced(tmp_path):
    scene = {"structure": {"type": "chain", "masses": [1, 1.3], "springs": [1, 0.7, 0.2],
                           "dampers": [0.03, 0.02, 0]}, "omega": 0.8,
             "effects": [{"type": "coulomb", "dof": "x1", "to": "x2", "limit": 0.2}],
             "excitation": [{"dof": "x1", "k": 1, "cos": 0.5}, {"dof": "x2", "k": 3, "sin": 0.2}],
             "steady": {"harmonics": 63}}
    followed, balanced = run(tmp_path, scene), run(tmp_path, scene, "-o", "method=newton")
    assert (followed["converged"] and balanced["converged"]
            and followed["method"] != balanced["method"])
    for i in range(2):
        assert max(abs(a - b) for a, b in zip(spectrum(followed, i), spectrum(balanced, i))) < 1e-7
    assert (followed["stability"]["stable"] is True
            and len(followed["stability"]["multipliers"]) == 4)


def test_a_body_that_rigid_friction_holds_is_at_rest(tmp_path):
    r = run(tmp_path, oscillator(1, [{"type": "coulomb", "dof": "x1", "limit": 0.3}], cos=0.2))
    assert (r["converged"] and max(abs(v) for v in spectrum(r)) < 1e-15
            and r["plan"]["effects"][0]["active"] is False)
    assert ("undetermined_offset" in [x["code"] for x in r["diagnostics"]]
            and r["stability"]["stable"] is None)


# Truncation falls as H^-3 only past the stick's own frequency, sqrt(kt): what is missing is what
# the estimate says.
@pytest.mark.parametrize("row", load("rigid_friction_limit")["rows"], ids=lambda r: str(r["kt"]))
def test_friction_is_right_up_to_the_rigid_limit(tmp_path, row):
    r = run(tmp_path, oscillator(1.5, [friction(row["kt"], 0.3)], cos=1, harmonics=255))
    assert r["converged"] and off(r, row) * row["amp1"] < max(2 * r["total_error"], 1e-12)


@pytest.mark.parametrize("row",
                         [r for r in load("grazing_contact")["rows"]
                          if float(r.get("closure", 0)) < 1e-12],
                         ids=lambda r: str(r["gap_over_A0"]))
def test_grazing_contact_is_seen_however_short(tmp_path, row):
    gap = row["gap_over_A0"] * load("grazing_contact")["A0"]
    r = run(tmp_path, oscillator(1.2,
                                 [{"type": "gap", "dof": "x1", "stiffness": 10, "clearance": gap}],
                                 c=0.1, cos=0.3, harmonics=128))
    assert r["converged"] and abs(abs(spectrum(r)[1]) - row["amp1"]) < 1e-8 * row["amp1"]


@pytest.mark.parametrize("i", range(3))
def test_hundreds_of_harmonics_are_no_obstacle(tmp_path, i):
    s = load("many_harmonics")["rows"][i]
    r = run(tmp_path, oscillator(s["omega"], [cubic(s["gamma"])], c=s["c"], cos=s["P"],
                                 harmonics=s["H_used"], start=near(s, *range(1, 200, 2))))
    assert r["converged"] and off(r, s) < 1e-12


def hill_multipliers(omega, m, c, k, gain, damp, H=60):
    """Of m y'' + (c + damp) y' + (k + gain) y = 0, gain and damp sampled over a period: eigenvalues
    of Hill's matrix, of which those two whose vectors lie nearest harmonic 0 belong to the
    truncated problem as they do to the whole one.
    """
    G, D = (numpy.fft.fft(g) / len(g) for g in (gain, damp))
    l = numpy.arange(-H, H + 1)
    K = G[(l[:, None] - l) % len(gain)] + numpy.diag(numpy.full(2 * H + 1, k))
    C = D[(l[:, None] - l) % len(damp)] + numpy.diag(numpy.full(2 * H + 1, c))
    W = numpy.diag(1j * l * omega)
    one = numpy.eye(2 * H + 1)
    A = numpy.block([[0 * one, one], [-(K + C @ W + m * W @ W) / m, -(C + 2 * m * W) / m]])
    values, vectors = numpy.linalg.eig(A)
    weight = abs(vectors[:2 * H + 1]) ** 2
    order = numpy.argsort(abs((l[:, None] * weight).sum(0)) / weight.sum(0))
    return numpy.exp(values[order[:2]] * 2 * numpy.pi / omega)


def waveform(x, N=512):
    return numpy.fft.irfft(numpy.array([x[0]] + [v / 2 for v in x[1:]] + [0]
                                       * (N // 2 + 1 - len(x))), N) * N


@pytest.mark.parametrize("i", range(14))
def test_hills_method_agrees_with_duffings_multipliers(tmp_path, i):
    s = load("duffing")["solutions"][i]
    r = run(tmp_path, oscillator(s["omega"], [cubic(0.1)], c=0.05, cos=0.18, harmonics=25,
                                 start=near(s, 1, 3)))
    x = waveform(spectrum(r))
    for m in hill_multipliers(s["omega"], 1, 0.05, 1, 0.3 * x ** 2, 0 * x):
        assert min(abs(m - complex(*h)) for h in r["stability"]["multipliers"]) < 1e-8


@pytest.mark.parametrize("i", range(6))
def test_hills_method_agrees_with_van_der_pols_multipliers(tmp_path, i):
    s = load("van_der_pol_forced")["solutions"][i]
    damper = {"type": "polynomial_damper", "dof": "x1", "coefficients": [-0.5, 0, 0.5]}
    r = run(tmp_path, oscillator(s["omega"], [damper], cos=1.0, harmonics=41, start=near(s, 1, 3)))
    x = spectrum(r)
    rate = waveform([1j * k * s["omega"] * v for k, v in enumerate(x)])
    for m in hill_multipliers(s["omega"], 1, 0, 1, waveform(x) * rate,
                              0.5 * (waveform(x) ** 2 - 1)):
        assert min(abs(m - complex(*h)) for h in r["stability"]["multipliers"]) < 1e-8


# Where det M = 1 and det(M + 1) = 0, M the monodromy matrix of an orbit closed by shooting: DOP853
# with the variational equation at rtol 1e-13, Newton on the period map to 1e-12, Brent's method
# over the parameter to 1e-13.
def test_entrainment_is_lost_to_a_torus_where_shooting_says(tmp_path):
    damper = {"type": "polynomial_damper", "dof": "x1", "coefficients": [-0.5, 0, 0.5]}
    scene = oscillator(1, [damper], cos=1.5, harmonics=31,
                       start={"x1": {"k": [1], "re": [0], "im": [-2]}})
    c = run(tmp_path, scene, "--continue", "omega=1.0:1.7")
    assert [b["type"] for b in c["bifurcations"]] == ["neimark_sacker"]
    assert c["bifurcations"][0]["omega"] == pytest.approx(1.4117959625669958, abs=1e-9)


def test_the_period_doubles_where_shooting_says(tmp_path):
    scene = oscillator(1.2, [cubic(1)], c=0.3, k=-1, cos=0.1, harmonics=31,
                       start={"x1": {"k": [0, 1], "re": [1, 0], "im": [0, 0]}})
    c = run(tmp_path, scene, "--continue", "excitation[0].cos=0.05:0.3")
    assert [b["type"] for b in c["bifurcations"]] == ["period_doubling"]
    assert c["bifurcations"][0]["excitation[0].cos"] == pytest.approx(0.26558178605562716, abs=1e-9)


def test_a_users_laws_multipliers_are_the_built_in_ones(tmp_path):
    s = load("duffing")["solutions"][3]
    scene = oscillator(s["omega"],
                       [{"type": "lua", "dof": "x1",
                         "source": "function force(t, x, v, memory) return 0.1 * x^3 end"}],
                       c=0.05, cos=0.18, harmonics=15, start=near(s, 1, 3))
    r = run(tmp_path, scene)
    assert (multipliers_off(r, s["floquet_multipliers"]) < 1e-9
            and r["stability"]["stable"] is s["stable"])
    scene["effects"][0]["source"] = (
        "function force(t, x, v, memory) memory.last = x return 0.1 * x^3 end")
    assert run(tmp_path, scene)["stability"]["stable"] is None


# With a spring too weak to matter (1e-3 of 1e-8 m squared beside 1e5 N/m) the scene is the linear
# one, whose multipliers floquet has.
def test_linear_states_of_effects_are_in_the_multipliers(tmp_path):
    scene = {"structure": {"type": "wing", "length": 6.0, "chord": 1.0, "elements": 3,
                           "EI": 9.77e6, "GJ": 0.987e6, "mass_per_length": 35.7,
                           "I_rho": 8.64, "x_cg": 0.18}, "omega": 40.0,
             "effects": [{"type": "airloads", "speed": 60.0, "density": 1.2, "lift_slope": 6.28,
                          "x_qc": -0.33, "stations": 3,
                          "inflow": "peters_2d", "inflow_states": 6}]}
    path = tmp_path / "linear.json"
    path.write_text(json.dumps(scene))
    linear = json.loads(subprocess.run([CTL, "--local", "--json", "floquet", path],
                                       capture_output=True, text=True, check=True).stdout)
    scene["effects"].append(cubic(1e-3, "w3"))
    scene["excitation"] = [{"dof": "w3", "k": 1, "cos": 100.0}]
    r = run(tmp_path, {**scene, "steady": {"harmonics": 3}})
    want = [cmath.exp(complex(*e) * 2 * math.pi / 40) for e in linear["exponents"]]
    assert len(r["stability"]["multipliers"]) == len(want) == 48
    assert (max(min(abs(w - complex(*m)) for m in r["stability"]["multipliers"]) for w in want)
            < 1e-7)


# x'' + (3/2) x + (7/20) x^3 = 0: omega = pi sqrt(k + g A^2) / (2 K(m)), m = g A^2 / (2 (k + g
# A^2)), and its energy.
def test_duffings_backbone_is_the_elliptic_functions(tmp_path):
    scene = {"structure": {"type": "matrices", "M": [[2.0]], "K": [[3.0]]}, "effects": [cubic(0.7)]}
    r = run(tmp_path, scene, "-o", "backbone=1:0.01:5:12", "-o", "harmonics=41")
    assert (len(r["points"]) == 12
            and r["linear"]["omega"] == pytest.approx(math.sqrt(1.5), rel=1e-14))
    for p in r["points"]:
        A = sum(p["harmonics"][0]["re"])
        stiff = 1.5 + 0.35 * A * A
        omega = math.pi * math.sqrt(stiff) / (2 * scipy.special.ellipk(0.35 * A * A / (2 * stiff)))
        assert p["omega"] == pytest.approx(omega, rel=1e-13) and abs(p["damping_ratio"]) < 1e-14
        assert p["energy"] == pytest.approx(1.5 * A * A + 0.175 * A ** 4, rel=1e-12)


# One harmonic: omega^2 = 1 + Re k(A), 2 zeta omega^2 = c omega + Im k(A), k the slider's closed
# form.
def test_friction_damps_its_mode_as_the_describing_function_says(tmp_path):
    scene = {"structure": {"type": "matrices", "M": [[1.0]], "C": [[0.02]], "K": [[1.0]]},
             "effects": [friction(0.5, 0.3)]}
    r = run(tmp_path, scene, "-o", "backbone=1:0.1:10:10", "-o", "harmonics=1")
    assert len(r["points"]) == 10
    for p in r["points"]:
        ratio, k = p["amplitude"] * 0.5 / 0.3, complex(0.5, 0)
        if ratio > 1:
            theta = math.acos(1 - 2 / ratio)
            k = complex(0.5 / math.pi * (theta - math.sin(2 * theta) / 2),
                        2 / (math.pi * ratio) * (1 - 1 / ratio))
        omega = math.sqrt(1 + k.real)
        assert p["omega"] == pytest.approx(omega, rel=1e-12)
        assert (p["damping_ratio"] == pytest.approx(k.imag / (2 * omega ** 2) + 0.02 / (2 * omega),
                                                    rel=1e-10))


@pytest.mark.parametrize("effect",
                         [{"type": "coulomb", "dof": "x1", "limit": 1},
                          {"type": "parametric_stiffness", "dof": "x1", "stiffness": 1, "k": 1}])
def test_a_backbone_is_refused_where_there_is_none(tmp_path, effect):
    assert (run(tmp_path, oscillator(1, [effect]), "-o", "backbone=1:0.1:1",
                status=2)["error"]["field"] == "backbone")


@pytest.mark.parametrize("text", ["2:0.1:1", "1:0:1", "1:0.1", "1:0.1:1:1", "x", "1:0.1:1:9:9"])
def test_a_backbones_range_is_checked(tmp_path, text):
    assert (run(tmp_path, oscillator(1, [cubic(1)]), "-o", f"backbone={text}",
                status=2)["error"]["field"] == "backbone")


# Reversals between samples: N^-2 beside the truncation's H^-3, told apart, and their sum within a
# factor 3 of the truth.
@pytest.mark.parametrize("samples", [128, 512, 4096])
def test_sampling_and_truncation_are_told_apart(tmp_path, samples):
    r = run(tmp_path, DAMPER, "-o", "harmonics=32", "-o", "located=false", "-o",
            f"samples={samples}", "-o", "time=1024")
    error = max(abs(a - b) for a, b in zip(r["time"]["x"]["x1"], damper_waveform()))
    exact_ = run(tmp_path, DAMPER, "-o", "harmonics=32")
    assert error / 3 < r["total_error"] < 3 * error
    assert exact_["truncation_error"] / 2 < r["truncation_error"] < 2 * exact_["truncation_error"]
    assert exact_["sampling_error"] < 1e-8 < r["sampling_error"]


def test_a_linear_scene_costs_no_evaluation_and_no_transform(tmp_path):
    r = run(tmp_path, oscillator(1.37, [], m=2.385, c=0.31, k=7.7,
                                 loads=[{"dof": "x1", "k": 2, "cos": 0.75, "sin": -1.9}]))
    want = complex(0.75, 1.9) / (7.7 - 2.74 ** 2 * 2.385 + 1j * 2.74 * 0.31)
    assert abs(spectrum(r)[2] - want) < 1e-13 * abs(want)
    assert (r["plan"]["ffts"] == r["iterations"] == 0
            and all(e["evaluations"] == 0 for e in r["plan"]["effects"]))


@pytest.mark.parametrize("change,field", [
    ({"omega": 0}, "omega"), ({"omega": -1}, "omega"),
                                          ({"steady": {"harmonics": 0}}, "steady.harmonics"),
    ({"steady": {"harmonics": 20, "samples": 40}}, "steady.samples"),
                                          ({"steady": {"method": "magic"}}, "steady.method"),
    ({"steady": {"start": {"x9": {"k": [1], "re": [1], "im": [0]}}}}, "steady.start.x9"),
                                          ({"steady": {"dofs": ["q"]}}, "steady.dofs[0]"),
    ({"effects": [{"type": "friction", "dof": "x1", "stiffness": 1, "limit": -1}]},
     "effects[0].limit")])
def test_bad_input_is_refused_by_name(tmp_path, change, field):
    scene = {**oscillator(1, [friction(1, 1)], c=0.1, cos=1), **change}
    assert run(tmp_path, scene, status=2)["error"]["field"] == field


@pytest.mark.parametrize("source,words", [
    ("function force(t, x, v, memory)\n while true do end\nend", "instructions"),
    ("function force(t, x, v, memory)\n local a = {}\n for i = 1, 1e7 do a[i] = i end\n return 0\n"
     "end", ""),
    ("function force(t, x, v, memory)\n return 'soft'\nend", "number"),
    ("function force(t, x, v, memory)\n return os.time()\nend", "2")])
def test_a_users_law_that_misbehaves_fails_by_itself(tmp_path, source, words):
    r = run(tmp_path, oscillator(1, [{"type": "lua", "dof": "x1", "source": source}], c=0.1, cos=1,
                                 harmonics=5), status=1)
    assert r["error"]["code"] == "element_failed" and words in r["error"]["message"]


def test_a_users_cubic_spring_is_the_built_in_one(tmp_path):
    source = "function force(t, x, v, memory) return 0.1 * x^3 end"
    mine = run(tmp_path, oscillator(1.0, [{"type": "lua", "dof": "x1", "source": source}], c=0.05,
                                    cos=0.18, harmonics=9))
    ours = run(tmp_path, oscillator(1.0, [cubic(0.1)], c=0.05, cos=0.18, harmonics=9))
    assert (mine["converged"] and max(abs(a - b) for a, b in zip(spectrum(mine), spectrum(ours)))
            < 1e-10)


# On the way to the motion Newton's method tries some of 1e250 m, whose cube is no number: tried,
# and not taken, as it is with the springs that are built in.
def test_four_users_cubic_springs_are_the_built_in_ones_though_trials_overflow(tmp_path):
    def answer(effect):
        return run(tmp_path, {"omega": 1.0,
                              "structure": {"type": "chain", "masses": [1] * 4, "springs": [1] * 5,
                                            "dampers": [0.02] * 5},
                              "effects": [effect | {"dof": f"x{i}"} for i in (1, 2, 3, 4)],
                              "excitation": [{"dof": "x1", "cos": 1.0}],
                              "steady": {"stability": False}})
    mine = answer({"type": "lua",
                   "source": "function force(t, x, v, memory) return 0.5 * x^3 end"})
    ours = answer({"type": "cubic_spring", "coefficient": 0.5})
    assert mine["converged"] and ours["converged"]
    for a, b in zip(mine["harmonics"], ours["harmonics"]):
        assert max(abs(x - y) for part in ("re", "im") for x, y in zip(a[part], b[part])) < 1e-9


# Stiff and soft friction beside a preloaded contact take 128 harmonics and more on three dofs; what
# looks further (errors, events for the multipliers) takes thousands of harmonics there, which is no
# reason to refuse.
def test_many_harmonics_on_three_dofs_are_judged_like_few(tmp_path):
    scene = {"structure": {"type": "chain", "masses": [1, 1, 1], "springs": [1.46, 1.89, 1.09, 0],
                           "dampers": [0.105, 0.118, 0.126, 0.13]},
             "omega": 0.858, "effects": [friction(2.1, 0.76) | {"dof": "x2", "to": "x1"},
                                         friction(136, 0.67),
                                         {"type": "gap", "dof": "x2", "to": "x3", "stiffness": 3.2,
                                          "clearance": -0.04}],
             "excitation": [{"dof": "x3", "k": 1, "cos": -0.4, "sin": -0.53}],
             "steady": {"harmonics": 160}}
    r = run(tmp_path, scene)
    assert (r["converged"] and len(r["stability"]["multipliers"]) >= 6
            and 0 < r["total_error"] < 1e-4)


def test_results_as_hdf5_hold_spectra_and_waveform(tmp_path):
    out = tmp_path / "out.h5"
    r = run(tmp_path, DAMPER, "-o", "harmonics=16", "-o", "time=64", "-O", out)
    with h5py.File(out) as f:
        assert (list(f["dofs"].asstr()) == ["x1"] and f.attrs["kind"] == "steady"
                and f["points"].attrs["parameter"] == "omega")
        assert ((f["re"][0, 0] + 1j * f["im"][0, 0] == spectrum(r)).all()
                and f["total_error"][0] == r["total_error"] and f["stable"][0] == 1)
        assert (f["x"][0] == r["time"]["x"]["x1"]).all() and (f["t"][...] == r["time"]["t"]).all()
    c = run(tmp_path, oscillator(1, [cubic(0.1)], c=0.05, cos=0.18, harmonics=7), "--continue",
            "omega=1.0:1.3", "-O", out)
    with h5py.File(out) as f:
        assert ((f["points"][...] == [p["omega"] for p in c["points"]]).all()
                and f["re"].shape == (len(c["points"]), 1, 8))
        assert (list(f["stable"]) == [{True: 1, False: 0, None: -1}[p["stability"]["stable"]]
                                      for p in c["points"]])
    assert (run(tmp_path, DAMPER, "-O", tmp_path / "no" / "where.h5", status=2)["error"]["field"]
            == "output")


# The reference's findings: 256 points of either differ by 1.4e-3 at most, and the spectrum's
# octaves fall as k^-4.10.
def test_the_papers_figures_are_drawn_beside_runge_kutta(tmp_path):
    subprocess.run([TOP / "tests" / "paper" / "friction_damper", "--out", tmp_path], check=True,
                   timeout=600, capture_output=True)
    drawn = json.loads((tmp_path / "friction_damper.json").read_text())
    assert drawn["difference"] < 2e-3 and drawn["slope"] == pytest.approx(-4.10, abs=0.02)
    assert {"rk4", "balance, sampled", "balance, reversals located"} <= set(drawn["errors"])
    assert (tmp_path / "friction_damper.png").stat().st_size > 10000


@pytest.mark.parametrize("row", load("contact_friction")["rows"],
                         ids=lambda r: str(len(r["regimes"])) + "_regimes")
def test_contact_with_friction_moves_as_its_regimes_followed_one_by_one(tmp_path, row):
    expected = numpy.array([row["x1"], row["x2"]])
    assert {"open", "stick"} < {regime for _, regime
                                in row["regimes"]}, "the scene parts, closes, sticks and slips"
    r = run(tmp_path, row["scene"], "-o", "harmonics=400")
    theta = 2 * math.pi * numpy.arange(expected.shape[1]) / expected.shape[1]
    waveform = [numpy.real(numpy.exp(1j * numpy.outer(theta, range(401))) @ spectrum(r, dof))
                for dof in range(2)]
    assert r["converged"] and r["total_error"] < 2e-8
    assert abs(numpy.array(waveform) - expected).max() < r["total_error"] + 5e-12
    assert r["stability"]["stable"]


def test_disturbances_that_overflow_are_given_up_where_they_do(tmp_path):
    """A dof of 1e30 N/m grows past every number in the first step; the whole period, at all steps
    up to 16384, would take 10,000 times as long.
    """
    effects = [{"type": "gap", "dof": "x1", "stiffness": 10, "clearance": 0.5}, cubic(1, "x2"),
               {"type": "gap", "dof": "x1", "stiffness": 1, "clearance": 1}]
    scene = {"structure": {"type": "matrices", "M": [[1, 0], [0, 1]], "C": [[0.1, 0], [0, 0.1]],
                           "K": [[1e30, -1], [-1, 0]]},
             "omega": 2, "effects": effects,
             "excitation": [{"dof": "x1", "k": 1, "cos": 1}, {"dof": "x2", "k": 2, "sin": 1}],
             "steady": {"harmonics": 5, "max_iterations": 20}}
    r = run(tmp_path, scene)
    assert r["converged"] and r["stability"]["stable"] is None
    assert any(d["code"] == "stability_unknown" and "overflow" in d["message"]
               for d in r["diagnostics"])
    assert r["cost"]["stages"]["stability"] < 0.2           # seconds of CPU; it is 30 us


@pytest.mark.parametrize("model,frame,most",
                         [("massless", "rotating", 128), ("finite_elements", "fixed", 16)])
def test_a_journal_that_rattles_beyond_the_harmonics_is_given_up_in_seconds(tmp_path, model, frame,
                                                                            most):
    """Contact rings at sqrt(15e6 / 0.05) = 17 krad/s, the 866th harmonic: of H and 2H that fail, 4H
    is not tried at eight times the work.  Where eight harmonics balance nonetheless, their error is
    larger than the motion, which is no answer.
    """
    effects = [{"type": "bearing", "at": "left", "transverse": 2e4, "damping": 3},
               {"type": "coupling", "at": "left", "transverse": 1e8, "rotational": 10},
               {"type": "gyroscopic"},
               {"type": "clearance", "at": "right", "gap": 0.8e-3, "stiffness": 15e6,
                "dissipation": 1e-3, "journal_mass": 0.05}]
    scene = {"structure": {"type": "shaft", "length": 1, "elements": 6, "EI": [98.9, 175],
                           "disk": {"position": 0.5, "mass": 5, "radius": 0.18},
                           "speed": 20, "model": model, "frame": frame, "mass_per_length": 0.00475},
             "omega": 20, "effects": effects, "excitation": [{"dof": "y3", "k": 1, "cos": 2.5}]}
    r = run(tmp_path, scene)
    assert (not r["converged"] and r["H"] <= most
            and any(d["code"] == "not_converged" for d in r["diagnostics"]))
    # 3 and 6 s of CPU; 12 and 28 by every way round at every order
    assert r["iterations"] <= 3200
