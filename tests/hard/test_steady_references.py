"""Steady states against references computed by other means (tests/data/steady): spectra, multipliers, folds, counts, refusals."""
import csv
import json
import math
import os
import pathlib
import subprocess

import pytest

TOP = pathlib.Path(__file__).resolve().parents[2]
DATA = TOP / "tests" / "data" / "steady"
CTL = pathlib.Path(os.environ.get("MODALD_BUILD", TOP / "build")) / "bin" / "modalctl"
pytestmark = pytest.mark.skipif(not CTL.exists(), reason=f"no {CTL}: build first")


def load(name):
    return json.loads((DATA / f"{name}.json").read_text())


def run(tmp_path, scene, *args, status=0):
    path = tmp_path / "scene.json"
    path.write_text(json.dumps(scene))
    done = subprocess.run([CTL, "--local", "--json", "steady", path, *args], capture_output=True, text=True, timeout=120)
    assert done.returncode == status, done.stdout[:400] + done.stderr[:400]
    return json.loads(done.stdout)


def oscillator(omega, effects, m=1, c=0, k=1, cos=0, loads=None, **steady):
    return {"structure": {"type": "matrices", "M": [[m]], "C": [[c]], "K": [[k]]}, "omega": omega, "effects": effects,
            "excitation": loads if loads is not None else [{"dof": "x1", "k": 1, "cos": cos}], "steady": steady}


def cubic(g, dof="x1", **more):
    return {"type": "cubic_spring", "dof": dof, "coefficient": g, **more}


def friction(k, limit, dof="x1"):
    return {"type": "friction", "dof": dof, "stiffness": k, "limit": limit}


def near(solution, *ks):
    """A start from some of a reference's own harmonics: which of several solutions is meant."""
    return {"x1": {"k": list(ks), "re": [solution["a"][k] for k in ks], "im": [-solution["b"][k] for k in ks]}}


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
                    loads=[{"dof": "x1", "k": 2, "sin": 0.75}, {"dof": "x1", "k": 3, "sin": 0.5}, {"dof": "x1", "k": 4, "sin": 0.375}])


def damper_waveform():
    with open(DATA / "friction_damper_time_1024.csv") as file:
        return [float(row["x"]) for row in csv.DictReader(file)]


def test_the_friction_dampers_spectrum_is_within_1e_9_at_512_harmonics(tmp_path):
    r = run(tmp_path, DAMPER, "-o", "harmonics=512")
    want = [complex(float(x["re"]), float(x["im"])) * (2 if x["k"] else 1) for x in load("friction_damper")["X_first"]]
    assert r["converged"] and max(abs(a - b) for a, b in zip(spectrum(r), want)) < 1e-9
    assert multipliers_off(r, [[float(m), 0] for m in load("friction_damper")["poincare_map_eigenvalues_xv"]]) < 1e-8


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
        assert run(tmp_path, scene, "-o", "harmonics=32", "-o", "stability=false")["converged"], (level, scale)


@pytest.mark.parametrize("row", load("direct_iteration_diverges")["rows"], ids=lambda r: f"{r['level']}-{r['frequency_scale']}")
def test_where_direct_iteration_diverges_auto_is_right(tmp_path, row):
    scene = json.loads(json.dumps(DAMPER))
    scene["omega"] *= row["frequency_scale"]
    for load_ in scene["excitation"]:
        load_["sin"] *= row["level"]
    r = run(tmp_path, scene, "-o", "harmonics=128")
    solution = {"a": [x * (2 if k else 1) for k, x in enumerate(row["X_re"])], "b": [-2 * x for x in row["X_im"]]}
    assert r["converged"] and off(r, solution, first=1 if row["stuck_all_period"] else 0) < 2e-7


@pytest.mark.parametrize("i", range(14))
def test_duffing_is_exact_to_1e_12_with_its_multipliers(tmp_path, i):
    d = load("duffing")
    s = d["solutions"][i]
    r = run(tmp_path, oscillator(s["omega"], [cubic(0.1)], c=0.05, cos=0.18, harmonics=25, start=near(s, 1, 3)))
    assert r["converged"] and off(r, s) < 1e-12
    assert multipliers_off(r, s["floquet_multipliers"]) < 1e-8 and r["stability"]["stable"] is s["stable"]


def test_duffings_folds_are_located_to_1e_9(tmp_path):
    c = run(tmp_path, oscillator(1.2, [cubic(0.1)], c=0.05, cos=0.18, harmonics=15, stability=False), "--continue", "omega=0.5:1.6")
    folds = sorted(f["omega"] for f in c["folds"])
    assert folds == pytest.approx([1.115700251771, 1.269601955546], abs=1e-9)
    assert c["points"][0]["omega"] == 0.5 and c["points"][-1]["omega"] == 1.6


@pytest.mark.parametrize("i", range(10))
def test_jenkins_slider_is_right_and_says_when_its_offset_is_undetermined(tmp_path, i):
    s = load("jenkins_sdof")["solutions"][i]
    loads = [{"dof": "x1", "k": 1, "cos": s["P"]}] + [{"dof": "x1", "k": t[0], "cos": t[1], "sin": t[2]} for t in s["tones"]]
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
    r = run(tmp_path, oscillator(s["omega"], [gap], c=0.1, cos=s["P"], harmonics=128, start=near(s, 0, 1, 2, 3)))
    assert r["converged"] and off(r, s) < 2e-8
    assert multipliers_off(r, s["poincare_eigenvalues"]) < 3e-8 and r["stability"]["stable"] is s["stable"]


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
    r = run(tmp_path, oscillator(s["omega"], effects, c=0.05, loads=[], harmonics=25, start=near(s, 1, 3)))
    assert r["converged"] and off(r, s) < 1e-11 and multipliers_off(r, s["floquet_multipliers"]) < 1e-8


@pytest.mark.parametrize("name", ["3 solutions", "1:3 subharmonic", "superharmonic region"])
def test_all_solutions_are_found_and_none_twice(tmp_path, name):
    s = load("multiple_solutions")["sets"][name]
    k = round(s["omega"] / s["fundamental"])
    scene = oscillator(s["fundamental"], [cubic(s["gamma"])], c=s["c"], loads=[{"dof": "x1", "k": k, "cos": s["P"]}], harmonics=21, solutions="all")
    found = [exact_ for exact_ in (spectrum(r) for r in run(tmp_path, scene)["solutions"])]
    assert len(found) == s["count"]
    for want in s["solutions"]:
        assert min(abs(abs(x[1]) - want["amp1"]) for x in found) < 1e-9


@pytest.mark.parametrize("row", load("near_fold")["rows"], ids=lambda r: str(r["offset_from_fold"]))
def test_near_a_fold_the_count_of_solutions_is_right(tmp_path, row):
    r = run(tmp_path, oscillator(row["omega"], [cubic(0.1)], c=0.05, cos=0.18, harmonics=21, solutions="all", stability=False))
    assert sorted(abs(spectrum(p)[1]) for p in r["solutions"]) == pytest.approx(sorted(row["amplitudes"]), rel=1e-8)


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
    r = run(tmp_path, oscillator(row["omega"], [cubic(row["gamma"])], c=row["c"], k=0, cos=row["P"], harmonics=25))
    assert r["converged"] and off(r, row) < 1e-11


@pytest.mark.parametrize("row", load("stuck_offset")["rows"], ids=lambda r: f"{r['P']}-{r['omega']}")
def test_a_stuck_slider_is_put_at_zero(tmp_path, row):
    r = run(tmp_path, oscillator(row["omega"], [friction(1, 1)], c=0.02, cos=row["P"]))
    x = spectrum(r)
    assert abs(x[1] - complex(row["a1"], -row["b1"])) < 1e-13 * row["amp1"] and abs(x[0]) < 1e-15 * row["amp1"]
    assert r["plan"]["effects"][0]["active"] is False


@pytest.mark.parametrize("row", load("tiny_forcing")["rows"], ids=lambda r: r["model"].split()[0] + str(r["P"]))
def test_tiny_forcing_reaches_the_linear_limit(tmp_path, row):
    effects, c = {"duffing": ([cubic(0.1)], 0.05), "jenkins": ([friction(1, 1)], 0.02),
                  "unilateral": ([{"type": "gap", "dof": "x1", "stiffness": 10, "clearance": 1}], 0.1)}[row["model"].split()[0]]
    x = spectrum(run(tmp_path, oscillator(0.8, effects, c=c, cos=row["P"])))
    want = complex(row["a1"], -row["b1"])
    assert abs(x[1] - want) <= (1e-14 + 2 * row.get("relative_nonlinear_correction", 0)) * abs(want)


def test_units_do_not_matter(tmp_path):
    counts = set()
    for row in load("mixed_scales")["rows"]:
        r = run(tmp_path, oscillator(row["omega"], [cubic(row["gamma"])], m=row["m"], c=row["c"], k=row["k"], cos=row["P"], harmonics=21, start=near(row, 1)))
        assert r["converged"] and off(r, row) < 1e-12
        counts.add(r["iterations"])
    assert len(counts) == 1


@pytest.mark.parametrize("row", [r for r in load("aliasing")["rows"] if r["converged"] and (r["H"], r["N"]) != (3, 7)], ids=lambda r: f"{r['H']}-{r['N']}")
def test_a_coarse_grid_aliases_just_as_the_algebra_says(tmp_path, row):
    r = run(tmp_path, oscillator(0.9, [cubic(1)], c=0.05, cos=0.5, harmonics=row["H"], samples=row["N"], stability=False))
    assert abs(abs(spectrum(r)[1]) - row["amp1"]) < 1e-12


@pytest.mark.parametrize("i", range(16))
def test_the_strong_duffing_oscillator_is_exact_with_its_multipliers(tmp_path, i):
    d = load("duffing_strong")
    s = d["solutions"][i]
    r = run(tmp_path, oscillator(s["omega"], [cubic(1)], c=0.02, cos=0.5, harmonics=61, start=near(s, 1, 3, 5)))
    assert r["converged"] and off(r, s) < 1e-12
    assert multipliers_off(r, s["floquet_multipliers"]) < 1e-9 and r["stability"]["stable"] is s["stable"]


def test_the_strong_duffing_oscillators_four_folds_are_located(tmp_path):
    c = run(tmp_path, oscillator(1, [cubic(1)], c=0.02, cos=0.5, harmonics=41, stability=False), "--continue", "omega=0.35:5.5")
    assert sorted(f["omega"] for f in c["folds"]) == pytest.approx(sorted(f["omega"] for f in load("duffing_strong")["folds"]), abs=1e-9)


def chain(d, effect, s, **steady):
    p = d["parameters"]
    springs = [p["k"] * p["ground"][0]] + [p["k"]] * (p["n"] - 1) + [p["k"] * p["ground"][1]]
    return {"structure": {"type": "chain", "masses": [p["m"]] * p["n"], "springs": springs}, "omega": s["omega"],
            "effects": [{"type": "rayleigh_damping", "alpha": p["alpha"], "beta": p["beta"]}, effect],
            "excitation": [{"dof": f"x{p['f_dof'] + 1}", "k": 1, "cos": s.get("P", p.get("P"))}], "steady": steady}


@pytest.mark.parametrize("i", range(9))
def test_twelve_dofs_with_a_cubic_spring_are_exact(tmp_path, i):
    d = load("chain12_cubic")
    s, p = d["solutions"][i], d["parameters"]
    start = {f"x{j + 1}": near(q, 1, 3)["x1"] for j, q in enumerate(s["dofs"])}
    r = run(tmp_path, chain(d, cubic(p["gamma"], f"x{p['nl_dof'] + 1}"), s, harmonics=42, start=start))
    assert r["converged"] and max(off(r, q, j) for j, q in enumerate(s["dofs"])) < 1e-12
    assert multipliers_off(r, s["floquet_multipliers"]) < 1e-9 and r["stability"]["stable"] is s["stable"]


# H^-3 and finer of truncation: 1e-8 at 256 harmonics; a stuck slider leaves a linear chain.
@pytest.mark.parametrize("i", range(7))
def test_twenty_dofs_with_a_slider_are_right(tmp_path, i):
    d = load("chain20_jenkins")
    s, p = d["solutions"][i], d["parameters"]
    r = run(tmp_path, chain(d, friction(p["kt"], p["muN"], f"x{p['nl_dof'] + 1}"), s, harmonics=256))
    stuck = s["phase_changes"] == 0
    assert r["converged"] and max(off(r, q, j, 1 if stuck else 0) for j, q in enumerate(s["dofs"])) < (1e-11 if stuck else 2e-9)
    assert r["stability"]["stable"] is (None if stuck else True)


# x = A cos 2t is made the exact motion of H = 11 harmonics: the load is the linear force and the reference's force.
@pytest.mark.parametrize("row", load("jenkins_describing_function")["rows"], ids=lambda r: f"{r['kt']}-{r['ratio']}")
def test_a_sliders_force_harmonics_are_the_closed_form(tmp_path, row):
    A = row["amplitude"]
    loads = [{"dof": "x1", "k": k, "cos": a - (3 * A if k == 1 else 0), "sin": b} for k, (a, b) in enumerate(zip(row["force_a"], row["force_b"])) if k]
    scene = oscillator(2, [friction(row["kt"], row["muN"])], loads=loads, harmonics=len(row["force_a"]) - 1,
                       start={"x1": {"k": [1], "re": [A], "im": [0]}})
    x = spectrum(run(tmp_path, scene))
    assert abs(x[1] - A) < 1e-12 * A and max(abs(v) for v in x[2:]) < 1e-12 * A


@pytest.mark.parametrize("i", range(7))
def test_rigid_friction_is_exact_with_stops_and_without(tmp_path, i):
    d = load("rigid_coulomb")
    s = d["solutions"][i]
    r = run(tmp_path, oscillator(s["omega"], [{"type": "coulomb", "dof": "x1", "limit": d["parameters"]["muN"]}], cos=s["P"], time=4096))
    assert r["converged"] and off(r, s) < 1e-11
    assert abs(max(r["time"]["x"]["x1"]) - s["max_abs_x"]) < 3 * r["error"]
    assert r["stability"]["stable"] is True
    if s["stops_per_period"] == 0:
        assert multipliers_off(r, s["poincare_eigenvalues"]) < 1e-10
    else:                                                  # a body at rest has forgotten its speed
        assert min(abs(complex(*m)) for m in r["stability"]["multipliers"]) < 1e-12


def test_a_body_that_rigid_friction_holds_is_at_rest(tmp_path):
    r = run(tmp_path, oscillator(1, [{"type": "coulomb", "dof": "x1", "limit": 0.3}], cos=0.2))
    assert r["converged"] and max(abs(v) for v in spectrum(r)) < 1e-15 and r["plan"]["effects"][0]["active"] is False
    assert "undetermined_offset" in [x["code"] for x in r["diagnostics"]] and r["stability"]["stable"] is None


# Truncation falls as H^-3 only past the stick's own frequency, sqrt(kt): what is missing is what the estimate says.
@pytest.mark.parametrize("row", load("rigid_friction_limit")["rows"], ids=lambda r: str(r["kt"]))
def test_friction_is_right_up_to_the_rigid_limit(tmp_path, row):
    r = run(tmp_path, oscillator(1.5, [friction(row["kt"], 0.3)], cos=1, harmonics=255))
    assert r["converged"] and off(r, row) * row["amp1"] < max(2 * r["error"], 1e-12)


@pytest.mark.parametrize("row", [r for r in load("grazing_contact")["rows"] if float(r.get("closure", 0)) < 1e-12], ids=lambda r: str(r["gap_over_A0"]))
def test_grazing_contact_is_seen_however_short(tmp_path, row):
    gap = row["gap_over_A0"] * load("grazing_contact")["A0"]
    r = run(tmp_path, oscillator(1.2, [{"type": "gap", "dof": "x1", "stiffness": 10, "clearance": gap}], c=0.1, cos=0.3, harmonics=128))
    assert r["converged"] and abs(abs(spectrum(r)[1]) - row["amp1"]) < 1e-8 * row["amp1"]


@pytest.mark.parametrize("i", range(3))
def test_hundreds_of_harmonics_are_no_obstacle(tmp_path, i):
    s = load("many_harmonics")["rows"][i]
    r = run(tmp_path, oscillator(s["omega"], [cubic(s["gamma"])], c=s["c"], cos=s["P"], harmonics=s["H_used"], start=near(s, *range(1, 200, 2))))
    assert r["converged"] and off(r, s) < 1e-12


def test_a_linear_scene_costs_no_evaluation_and_no_transform(tmp_path):
    r = run(tmp_path, oscillator(1.37, [], m=2.385, c=0.31, k=7.7, loads=[{"dof": "x1", "k": 2, "cos": 0.75, "sin": -1.9}]))
    want = complex(0.75, 1.9) / (7.7 - 2.74 ** 2 * 2.385 + 1j * 2.74 * 0.31)
    assert abs(spectrum(r)[2] - want) < 1e-13 * abs(want)
    assert r["plan"]["ffts"] == r["iterations"] == 0 and all(e["evaluations"] == 0 for e in r["plan"]["effects"])


@pytest.mark.parametrize("change,field", [
    ({"omega": 0}, "omega"), ({"omega": -1}, "omega"), ({"steady": {"harmonics": 0}}, "steady.harmonics"),
    ({"steady": {"harmonics": 20, "samples": 40}}, "steady.samples"), ({"steady": {"method": "magic"}}, "steady.method"),
    ({"steady": {"start": {"x9": {"k": [1], "re": [1], "im": [0]}}}}, "steady.start.x9"), ({"steady": {"dofs": ["q"]}}, "steady.dofs[0]"),
    ({"effects": [{"type": "friction", "dof": "x1", "stiffness": 1, "limit": -1}]}, "effects[0].limit")])
def test_bad_input_is_refused_by_name(tmp_path, change, field):
    scene = {**oscillator(1, [friction(1, 1)], c=0.1, cos=1), **change}
    assert run(tmp_path, scene, status=2)["error"]["field"] == field


@pytest.mark.parametrize("source,words", [
    ("function force(t, x, v, memory)\n while true do end\nend", "instructions"),
    ("function force(t, x, v, memory)\n local a = {}\n for i = 1, 1e7 do a[i] = i end\n return 0\nend", ""),
    ("function force(t, x, v, memory)\n return 'soft'\nend", "number"),
    ("function force(t, x, v, memory)\n return os.time()\nend", "2")])
def test_a_users_law_that_misbehaves_fails_by_itself(tmp_path, source, words):
    r = run(tmp_path, oscillator(1, [{"type": "lua", "dof": "x1", "source": source}], c=0.1, cos=1, harmonics=5), status=1)
    assert r["error"]["code"] == "element_failed" and words in r["error"]["message"]


def test_a_users_cubic_spring_is_the_built_in_one(tmp_path):
    source = "function force(t, x, v, memory) return 0.1 * x^3 end"
    mine = run(tmp_path, oscillator(1.0, [{"type": "lua", "dof": "x1", "source": source}], c=0.05, cos=0.18, harmonics=9))
    ours = run(tmp_path, oscillator(1.0, [cubic(0.1)], c=0.05, cos=0.18, harmonics=9))
    assert mine["converged"] and max(abs(a - b) for a, b in zip(spectrum(mine), spectrum(ours))) < 1e-10
