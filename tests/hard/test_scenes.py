"""Scenes against the beam reference, and what a scene does not list costing nothing: its module's
code does not run.
"""
import csv
import json
import math
import os
import pathlib
import re
import shutil
import subprocess

import pytest

TOP = pathlib.Path(__file__).resolve().parents[2]
DATA = TOP / "tests/data/beam"
CTL = pathlib.Path(os.environ.get("MODALD_BUILD", TOP / "build")) / "bin/modalctl"
EI, M = 6570.0, 3.24                        # N m^2, kg/m, of a beam of 1 m
W1, P1 = math.pi ** 2 * math.sqrt(EI / M), math.pi ** 2 * EI
EPS = {"undamped": 0.0, "eps12.57": 12.57, "eps39.50": 39.50479803045654}


def rows(name):
    with open(DATA / name) as file:
        return list(csv.DictReader(file))


def run(verb, scene, tmp_path, *options):
    file = tmp_path / "scene.json"
    file.write_text(json.dumps(scene))
    done = subprocess.run([CTL, "--local", "--json", verb, file, *options], capture_output=True,
                          text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return json.loads(done.stdout)


def multipliers(result):
    return [complex(*z) for z in result["multipliers"] if z]


def near_edge(row):
    """|rho| is square-root sensitive where the trace is near +-(1 + det)."""
    return abs(abs(float(row["trace"])) - 1 - float(row["det"])) < 1e-2


def modal_scene(omega, mu, eps):
    return {"structure": {"type": "matrices", "M": [[1]], "K": [[W1 ** 2]], "C": [[eps]]},
            "omega": 2 * omega * W1,
            "effects": [{"type": "parametric_stiffness", "dof": "x1",
                         "stiffness": -2 * mu * W1 ** 2}]}


def beam_scene(omega, mu, effects):
    return {"structure": {"type": "beam", "length": 1, "elements": 4, "EI": EI,
                          "mass_per_length": M}, "omega": 2 * omega * W1,
            "effects": [{"type": "axial_load", "amplitude": 2 * mu * P1}] + effects}


@pytest.mark.parametrize("case", EPS)
def test_modal_multipliers_match_the_reference_to_1e_9_and_1e_7_near_edges(case, tmp_path):
    for row in rows(f"modal_{case}.csv")[::4]:
        found = multipliers(run("floquet", modal_scene(float(row["omega"]), 0.15, EPS[case]),
                                tmp_path))
        for re_, im in (("rho_re", "rho_im"), ("rho2_re", "rho2_im")):
            expected = complex(float(row[re_]), float(row[im]))
            assert (min(abs(z - expected) for z in found)
                    < (1e-7 if near_edge(row) else 1e-9)), row["omega"]


@pytest.mark.parametrize("column, effects", [
    ("und", []),
    ("eps12.57", [{"type": "viscous_damping", "per_length": 12.57 * M}]),
    ("eps39.50", [{"type": "viscous_damping", "per_length": EPS["eps39.50"] * M}]),
    ("eps12.57_strainrate", [{"type": "strain_rate_damping", "mu": 12.57 / W1 ** 2}]),
    ("eps39.50_strainrate", [{"type": "strain_rate_damping", "mu": EPS["eps39.50"] / W1 ** 2}])])
def test_the_four_element_beam_matches_the_reference_to_1e_9(column, effects, tmp_path):
    for row in rows("fe4.csv")[::8]:
        result = run("floquet", beam_scene(float(row["omega"]), 0.15, effects), tmp_path, "-o",
                     "hill=false")
        expected = complex(float(row[column + "_rho_re"]), float(row[column + "_rho_im"]))
        assert min(abs(z - expected) for z in multipliers(result)) < 1e-9, row["omega"]
        assert (abs(result["stability"]["max_multiplier"] - float(row[column + "_maxabs_all"]))
                < 1e-9)


def test_hill_agrees_with_floquet_within_its_truncation(tmp_path):
    result = run("floquet",
                 beam_scene(1.0, 0.15, [{"type": "viscous_damping", "per_length": 12.57 * M}]),
                 tmp_path)
    assert result["hill"]["truncation"] < 1e-8 and result["hill"]["difference"] < 1e-8


@pytest.mark.parametrize("case", EPS)
def test_strutt_s_diagram_is_right_beside_every_reference_boundary(case, tmp_path):
    """1e-6 inside each tongue it is unstable, 1e-6 outside it is not."""
    points = []
    for row in rows(f"strutt_{case}.csv"):
        if row["omega_low"]:
            low, high = float(row["omega_low"]), float(row["omega_high"])
            if high - low > 1e-4:
                points += [(float(row["mu"]), low - 1e-6, False),
                           (float(row["mu"]), low + 1e-6, True),
                           (float(row["mu"]), high - 1e-6, True),
                           (float(row["mu"]), high + 1e-6, False)]
    assert len(points) > 50
    scene = modal_scene(1, 0.1, EPS[case])
    for mu in sorted({p[0] for p in points})[::4]:
        here = [p for p in points if p[0] == mu]
        scene["effects"][0]["stiffness"] = -2 * mu * W1 ** 2
        document = {"verb": "floquet", "scene": scene,
                    "grid": [{"path": "omega", "values": [2 * p[1] * W1 for p in here]}]}
        for (mu_, omega, unstable), point in zip(here, run("sweep", document, tmp_path)["points"]):
            assert (point["stability"]["stable"] is False) == unstable, (mu_, omega, point)


# --- what is not listed does not run --------------------------------------------------------------

LISTED = {"type": "chain", "masses": [1, 2], "springs": [3, 1, 2]}
SHAFT = {"type": "shaft", "length": 1, "elements": 2, "EI": [90, 120], "mass_per_length": 3,
         "speed": 7, "disk": {"position": 0.5, "mass": 2, "radius": 0.3}}
WING = {"type": "wing", "length": 20, "chord": 6, "elements": 1, "EI": 2.3e7, "GJ": 2.4e6,
        "mass_per_length": 0.75, "I_rho": 1.95, "x_cg": 0.6}
STRUCTURES = {              # its scene, two dofs, the files that are its own
    "chain": (LISTED, "x1", "x2", {"chain.c"}),
    "matrices": ({"type": "matrices", "M": [[2, 0], [0, 3]], "K": [[4, -1], [-1, 4]]}, "x1", "x2",
                 {"matrices.c"}),
    "beam": ({"type": "beam", "length": 1, "elements": 2, "EI": 2, "mass_per_length": 3}, "w1",
             "th1", {"beam.c"}),
    "shaft": (SHAFT, "y1", "z1", {"shaft.c"}),
    "wing": (WING, "w1", "phi3", {"wing.c", "wing_model.c"})}
# Each effect: its keys (D, E: dofs), and the modules that run for it and for none of those beyond
# its line
ANY, AIR = (*STRUCTURES,), {"type": "airloads", "speed": 300, "density": 2e-3, "x_qc": -0.5}
FIRST = {
    "spring": ({"dof": "D", "stiffness": 1}, ANY, ()),
         "friction": ({"dof": "D", "stiffness": 1, "limit": 0.1}, ANY, ("slider.c",)),
    "iwan": ({"dof": "D", "stiffnesses": [2, 3], "limits": [3, 4]}, ANY, ("slider.c",)),
    "contact_friction": ({"normal": "D", "tangential": "E", "normal_stiffness": 2, "preload": 1,
                          "tangential_stiffness": 2, "mu": 0.2}, ANY, ("slider.c",)),
    "contact_bed": ({"nodes": [{"normal": "D", "tangential": "E"}], "normal_stiffness": 2,
                     "preload": 1, "tangential_stiffness": 2, "mu": 0.2}, ANY, ("slider.c",)),
    "polynomial_coupling": ({"terms": [{"coefficient": 2, "powers": {"D": 2, "E": 1}, "on": "E"}]},
                            ANY, ("laws/coupling.c",)),
    "coulomb": ({"dof": "D", "limit": 0.1}, ANY, ("laws/dry_friction.c",)),
    "regularised_coulomb": ({"dof": "D", "limit": 0.1, "velocity": 0.1}, ANY,
                            ("laws/dry_friction.c",)),
    "rayleigh_damping": ({"alpha": 0.1}, ANY, ()), "modal_damping": ({"ratio": 0.1}, ANY, ()),
         "viscous_damping": ({"per_length": 0.2}, ("beam", "shaft", "wing"), ()),
    "bearing": ({"at": "left", "transverse": 200}, ("shaft",), ()),
         "gyroscopic": ({}, ("shaft",), ()),
    "coupling": ({"at": "left", "transverse": 200}, ("shaft",), ())}
SECOND = {
    "damper": ({"dof": "D", "coefficient": 1}, ANY, ()),
          "cubic_spring": ({"dof": "D", "coefficient": 1}, ANY, ("polynomial.c",)),
    "polynomial_spring": ({"dof": "D", "coefficients": [1, 2]}, ANY, ("polynomial.c",)),
    "polynomial_damper": ({"dof": "D", "coefficients": [1, 2]}, ANY, ("polynomial.c",)),
          "gap": ({"dof": "D", "stiffness": 1, "clearance": 0.1}, ANY, ("laws/unilateral_contact.c",
                  )),
    "parametric_stiffness": ({"dof": "D", "stiffness": 0.1}, ANY, ()),
          "lua": ({"dof": "D", "source": "function force(t, x, v, m) return x end"}, ANY,
                  ("laws/user_law.c",)),
    "strain_rate_damping": ({"mu": 1e-3}, ANY, ()),
          "axial_load": ({"mean": 0.1, "amplitude": 0.1}, ("beam",), ()),
    "rotary_inertia": ({"I_rho": 0.1}, ("shaft",), ()),
    "clearance": ({"at": "right", "gap": 1e-3, "stiffness": 1000}, ("shaft",),
                  ("laws/journal_contact.c",)),
    "airloads": ({**AIR, "inflow": "peters_2d"}, ("wing",), ("inflow.c", "peters_2d.c"))}


def module(effect):
    # bearing and coupling share one
    return f"effects/{'bearing' if effect == 'coupling' else effect}.c"


def placed(value, dofs):
    """VALUE with its D and E, as keys too, replaced by DOFS."""
    if isinstance(value, dict):
        return {dofs.get(key, key): placed(item, dofs) for key, item in value.items()}
    if isinstance(value, list):
        return [placed(item, dofs) for item in value]
    return dofs.get(value, value) if isinstance(value, str) else value


def listed(effects, structure):
    """EFFECTS that the structure takes, as a scene lists them, and the modules that are theirs."""
    tree, first, second, own = STRUCTURES[structure]
    dofs = {"D": first, "E": second}
    taken = {name: row for name, row in effects.items() if structure in row[1]}
    entries = [{"type": name, **placed(row[0], dofs)} for name, row in taken.items()]
    return entries, {module(name) for name in taken} | {file for row in taken.values()
                                                        for file in row[2]}


def functions_run(scene, tmp_path):
    """Functions that executed at least one instruction, by file and name."""
    file, out = tmp_path / "scene.json", tmp_path / "callgrind.out"
    file.write_text(json.dumps(scene))
    subprocess.run(["valgrind", "--tool=callgrind", f"--callgrind-out-file={out}",
                    "--compress-strings=no", "--compress-pos=no", CTL, "--local", "--json",
                    "simulate", file, "-O", tmp_path / "out.h5"], check=True, capture_output=True,
                   env={**os.environ, "OPENBLAS_CORETYPE": "Haswell",
                        "OPENBLAS_NUM_THREADS": "1"})
    run_, at = set(), ""
    for line in out.read_text().splitlines():
        if line.startswith(("fl=", "fi=", "fe=")):
            at = line[3:]
        elif line.startswith("fn="):
            run_.add(("/".join(pathlib.Path(at).parts[-2:]), line[3:]))
    return run_


@pytest.mark.parametrize("structure", STRUCTURES)
def test_the_lists_name_every_effect_that_a_structure_takes(structure, tmp_path):
    file = tmp_path / "scene.json"
    file.write_text(json.dumps({"structure": STRUCTURES[structure][0],
                                "effects": [{"type": "none"}]}))
    done = subprocess.run([CTL, "--local", "--json", "floquet", file], capture_output=True,
                          text=True)
    message = json.loads(done.stdout)["error"]["message"]
    assert done.returncode == 2
    assert (set(re.findall(r"\w+", message.split("accepted")[1]))
            == {name for name, row in {**FIRST, **SECOND}.items() if structure in row[1]}), message


@pytest.mark.skipif(shutil.which("valgrind") is None, reason="needs valgrind")
@pytest.mark.parametrize("structure", STRUCTURES)
def test_no_instruction_of_an_unlisted_effect_s_module_runs(structure, tmp_path):
    """Without effects no effect's module runs; with one half of them listed, all of those do and
    none of the other half.
    """
    tree, first, second, own = STRUCTURES[structure]
    every = ({module(name) for name in {**FIRST, **SECOND}}
             | {file for row in [*FIRST.values(), *SECOND.values()] for file in row[2]})
    others = set().union(*(row[3] for name, row in STRUCTURES.items() if name != structure))
    for effects in ({}, FIRST, SECOND):
        entries, modules = listed(effects, structure)
        ran = {file for file, _ in functions_run({"structure": tree, "omega": 1.3,
                                                  "effects": entries,
                                                  "initial": {"x": {first: 1e-3}},
                                                  "time": {"dt": 0.01, "duration": 0.05}},
                                                 tmp_path)}
        meets = lambda file: any(path == file or path.endswith("/" + file) for path in ran)
        assert not {file for file in modules if not meets(file)}, structure
        assert not {file for file in every - modules if meets(file)}, structure
        assert all(meets(file) for file in own) and not {file for file in others if meets(file)}
        if not entries:
            assert not {file for file in ran
                        if file.endswith(("/nonlinear_stepper.c", "/collocation.c", "/ports.c",
                                          "/regime_events.c", "/magnus.c", "/periodic_stepper.c"))}


def test_a_linear_scene_steps_at_one_product_a_sample(tmp_path):
    scene = {"structure": LISTED, "initial": {"x": {"x1": 1}}, "time": {"dt": 0.2, "duration": 200},
             "effects": [{"type": "damper", "dof": "x2", "coefficient": 0.1}]}
    result = run("simulate", scene, tmp_path, "-O", tmp_path / "out.h5")
    assert result["work"]["products"] == 1000 and result["work"]["exponentials"] == 1
    assert all(effect["evaluations"] == 0 for effect in result["plan"]["effects"])


@pytest.mark.parametrize("change, field", [
    ({"structure": {"type": "chain", "masses": [1], "springs": [1]}}, "structure.springs"),
    ({"effects": [{"type": "gap", "dof": "x9", "stiffness": 1, "clearance": 0}]}, "effects[0].dof"),
    ({"effects": [{"type": "axial_load", "mean": 1}]}, "effects[0].type"),
    ({"initial": {"x": {"w9": 1}}}, "initial.x.w9"),
    ({"time": {"dt": 0, "duration": 1}}, "time.dt"),
    ({"time": {"dt": 0.1}}, "time.duration"),
    ({"steady": {"harmonic": 3}}, "steady.harmonic"),
    ({"effects": [{"type": "parametric_stiffness", "dof": "x1", "stiffness": 1}]}, "omega")])
def test_bad_input_is_exit_2_and_names_its_path(change, field, tmp_path):
    scene = {"structure": LISTED, "time": {"dt": 0.2, "duration": 1}, **change}
    file = tmp_path / "scene.json"
    file.write_text(json.dumps(scene))
    done = subprocess.run([CTL, "--local", "--json", "simulate", file, "-O", tmp_path / "out.h5"],
                          capture_output=True, text=True)
    error = json.loads(done.stdout)["error"]
    assert done.returncode == 2 and error["code"] == "bad_input" and error["field"] == field
