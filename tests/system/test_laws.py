"""The manual page of scenes alone is enough: each effect is built from its keys and examples there,
and moves as its printed law says.

Nothing is read here but modald-scene(5): structures, effects, their keys, what is needed, examples,
laws.  A law of two dofs is translated into arithmetic and evaluated along the motion that
`simulate` gives: the masses' accelerations are the force, with its sign, on one, and its opposite
on the other.  Laws of whole structures are held against closed forms of the same words.
"""
import json
import math
import re

import h5py
import numpy as np
import pytest
from local_scene import run
from scene_page import EFFECTS, FUNCTIONS, STRUCTURES, arithmetic


def pairs():
    for effect in EFFECTS.values():
        for structure in effect.structures or [s for s in STRUCTURES if s in ("chain", "beam")]:
            yield pytest.param(effect, STRUCTURES[structure], id=f"{effect.type} on {structure}")


@pytest.mark.parametrize("effect, structure", pairs())
def test_a_scene_made_of_the_examples_of_the_page_runs(effect, structure, tmp_path):
    body = structure.build()
    plain = {"structure": body, "omega": 3.0, "time": {"dt": 1e-4, "duration": 1e-3}}
    dofs = run(tmp_path, "simulate", plain, "-O", tmp_path / "x.h5")["channels"]
    names = dict(zip(("dof", "normal", "tangential"), (dofs[0], dofs[0], dofs[1])))
    made = effect.build(**{key.name: names[key.name] for key in effect.keys if key.name in names})
    # within its members the example's dofs
    if "dof" not in made:
        made = json.loads(json.dumps(made).replace('"x1"',
                                                   f'"{dofs[0]}"').replace('"x2"', f'"{dofs[1]}"'))
    answer = run(tmp_path, "simulate", {**plain, "effects": [made]}, "-O", tmp_path / "x.h5")
    assert [e["type"] for e in answer["plan"]["effects"]] == [effect.type]


# ---- laws between two dofs ----

MASSES, SPRING, STEP = (2.0, 3.0), 400.0, 4e-5
OMEGA = 7.0


def step_of(effect):
    """Of a law with a memory 64 steps make one: a tenth of the samples is enough."""
    return 10 * STEP if effect.type == "lua" else STEP


def motion(effect, tmp_path, **given):
    """t, displacements, velocities and the effect's forces on both masses, which a spring between
    them makes turn back."""
    scene = {"structure": {"type": "chain", "masses": list(MASSES), "springs": [0, SPRING, 0]},
             "omega": OMEGA, "effects": [effect.build(**given)],
             "initial": {"x": {"x1": 0.03, "x2": -0.012}, "v": {"x1": 0.8, "x2": -0.5}},
             "time": {"dt": step_of(effect), "duration": 0.4},
             "sensors": [{"dof": dof, "derivative": n} for n in range(3) for dof in ("x1", "x2")]}
    run(tmp_path, "simulate", scene, "-O", tmp_path / "x.h5")
    with h5py.File(tmp_path / "x.h5") as file:
        y = file["signals"][:]
    held = SPRING * (y[:, 0] - y[:, 1])
    return (np.arange(len(y)) * step_of(effect), y[:, 0:2], y[:, 2:4],
            y[:, 4:6] * MASSES + np.column_stack([held, -held]))


def value(text, keys, **at):
    """TEXT of a law, its keys and quantities given; "the sum of X[i] ..." runs over the list X."""
    total = re.match(r"the sum of (\w+)\[i\] (.*)", text)
    names = {**FUNCTIONS, "force_of": lambda t, x, v, memory: lua(keys["source"], x, v),
             "memory": None, "omega": OMEGA, **keys, **at}
    if total:
        return sum(c * eval(arithmetic(total[2]), {}, {**names, "i": i}) for i,
                   c in enumerate(keys[total[1]]))
    return eval(arithmetic(text), {}, names)


def lua(source, x, v):
    return eval(re.search(r"return (.*?) end", source)[1], {}, {"x": x, "v": v})


def slider(d, stiffness, limit):
    """stiffness (d - z), z moved so that its modulus is at most limit, sample by sample."""
    force, z = np.empty_like(d), 0.0
    for i, (at, most) in enumerate(zip(d, np.broadcast_to(limit, d.shape))):
        reach = most / stiffness
        z = min(max(z, at - reach), at + reach)
        force[i] = stiffness * (at - z)
    return force


def printed(effect, keys, t, d, v):
    """The force that the law takes from dof, and how near samples can be to it."""
    law = re.sub(r"^minus ", "", effect.law.split(" on dof")[0])
    where = re.search(r"where d > (\w+), else 0", effect.law)
    if "z the slider's place, moved so that |force| <= limit" in effect.law:
        assert law == "stiffness (d - z)"
        return slider(d, keys["stiffness"], keys["limit"])
    if law.startswith("the sum over i of a friction element"):
        a, b = re.match(r"the sum over i of a friction element of (\w+)\[i\], (\w+)\[i\]",
                        law).groups()
        return sum(slider(d, stiffness, limit) for stiffness, limit in zip(keys[a], keys[b]))
    f = value(law, keys, t=t, d=d, v=v)
    return np.where(d > keys[where[1]], f, 0) if where else f


BETWEEN = [name for name, e in EFFECTS.items() if any(k.name == "dof" for k in e.keys)]


@pytest.mark.parametrize("name", BETWEEN)
def test_the_motion_obeys_the_printed_law_and_its_sign(name, tmp_path):
    effect = EFFECTS[name]
    stiff = {"stiffness": 400.0} if name == "gap" else {}               # its example is a wall
    keys = effect.build(dof="x1", to="x2", **stiff)
    t, x, v, force = motion(effect, tmp_path, dof="x1", to="x2", **stiff)
    d, rate = x[:, 0] - x[:, 1], v[:, 0] - v[:, 1]
    f = printed(effect, keys, t, d, rate)
    assert np.ptp(f) > 0                                                # it acts
    size, look = np.abs(f).max(), slice(None)
    if "at d' = 0" in effect.law:
        # what holds at the very start is not in the record
        look = (np.abs(rate) > 1e-3) & (t > 0)
        assert look.sum() > 10 and np.ptp(f[look]) > 0
    # sliders are followed by samples, whose turning points lie between them: acceleration times the
    # step's square
    near = 1e-3 if "slider" in effect.law or "friction element" in effect.law else 1e-9
    assert force[look, 0] == pytest.approx(-f[look], abs=near * size)
    assert force[look, 1] == pytest.approx(f[look], abs=near * size)


def test_contact_and_its_friction_obey_the_printed_law(tmp_path):
    effect = EFFECTS["contact_friction"]
    keys = effect.build(normal="x1", tangential="x2")
    normal, tangential = effect.law.split("; on tangential ")
    n = re.fullmatch(r"minus N = (.*) on normal", normal)[1].replace("d_n", "d")
    stiffness, bound = re.fullmatch(r"minus a friction element of (\w+) whose limit is (\w+) N",
                                    tangential).groups()
    t, x, _, force = motion(effect, tmp_path, normal="x1", tangential="x2")
    N = value(n, keys, d=x[:, 0])
    assert N.min() == 0 < N.max()                                       # it opens and closes
    assert force[:, 0] == pytest.approx(-N, abs=1e-9 * N.max())
    f = slider(x[:, 1], keys[stiffness], keys[bound] * N)
    assert force[:, 1] == pytest.approx(-f, abs=1e-3 * np.abs(f).max())


def test_products_of_powers_obey_the_printed_law(tmp_path):
    effect = EFFECTS["polynomial_coupling"]
    assert (effect.law
            == "minus the coefficient times the product of the powers on the dof `on` of each term")
    terms = [{"coefficient": 2e5, "powers": {"x1": 2, "x2": 1}, "on": "x1"},
             {"coefficient": -3e4, "powers": {"x1": 1, "x2": 1}, "on": "x2"},
             {"coefficient": 1e6, "powers": {"x2": 3}, "on": "x2"}]
    _, x, _, force = motion(effect, tmp_path, terms=terms)
    f = np.column_stack([-2e5 * x[:, 0]**2 * x[:, 1], 3e4 * x[:, 0] * x[:, 1] - 1e6 * x[:, 1]**3])
    assert force == pytest.approx(f, abs=1e-9 * np.abs(f).max())


def test_a_bed_of_contacts_obeys_the_printed_law(tmp_path):
    effect = EFFECTS["contact_bed"]
    normal, tangential = effect.law.split("; along each tangential ")
    n = re.fullmatch(r"at each node minus N = (.*) on normal", normal)[1].replace("d_n", "d")
    assert tangential.startswith("minus a friction element of area tangential_stiffness whose "
                                 "limit is mu N: ")
    node = {"normal": "x1", "tangential": "x2", "area": 0.03}
    keys = effect.build(nodes=[node])
    t, x, _, force = motion(effect, tmp_path, nodes=[node])
    N = value(n, {**keys, "area": node["area"]}, d=x[:, 0])
    assert N.min() == 0 < N.max()
    assert force[:, 0] == pytest.approx(-N, abs=1e-9 * N.max())
    f = slider(x[:, 1], node["area"] * keys["tangential_stiffness"], keys["mu"] * N)
    assert force[:, 1] == pytest.approx(-f, abs=1e-3 * np.abs(f).max())


# ---- laws of whole structures ----

M, K = np.diag([1.0, 2.0]), np.array([[150.0, -50.0], [-50.0, 150.0]])
CHAIN = {"type": "chain", "masses": [1, 2], "springs": [100, 50, 100]}


def exponents(tmp_path, structure, *effects):
    answer = run(tmp_path, "floquet", {"structure": structure, "effects": list(effects)}, "-o",
                 "hill=false")
    return sorted((complex(*e) for e in answer["exponents"]), key=lambda z: (z.imag, z.real))


def of_matrices(C):
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    return sorted(np.linalg.eigvals(A), key=lambda z: (z.imag, z.real))


def modal(keys):
    w2, phi = np.linalg.eigh(np.linalg.inv(np.sqrt(M)) @ K @ np.linalg.inv(np.sqrt(M)))
    phi = np.linalg.inv(np.sqrt(M)) @ phi
    return sum(2 * keys["ratio"] * math.sqrt(w) * np.outer(M @ phi[:, i], M @ phi[:, i]) for i,
               w in enumerate(w2))


WHOLE = {"rayleigh_damping": ("C gains alpha M + beta K of the structure", lambda k: k["alpha"] * M
                              + k["beta"] * K),
         "modal_damping": ("C gains sum_i 2 zeta_i w_i (M phi_i)(M phi_i)^T over the structure's "
                           "modes", modal),
         "strain_rate_damping": ("C gains mu K of the elastic members", lambda k: k["mu"] * K)}


@pytest.mark.parametrize("name", WHOLE)
def test_damping_of_a_structure_is_the_printed_matrix(name, tmp_path):
    law, matrix = WHOLE[name]
    effect = EFFECTS[name]
    keys = effect.build()
    assert effect.law == law and len(keys) > 1
    assert exponents(tmp_path, CHAIN, keys) == pytest.approx(of_matrices(matrix(keys)), rel=1e-9)


def beam(tmp_path, *effects):
    body = STRUCTURES["beam"].build()
    return body, [z for z in exponents(tmp_path, body, *effects) if z.imag > 0]


def test_viscous_damping_is_a_part_of_the_mass(tmp_path):
    effect = EFFECTS["viscous_damping"]
    assert effect.law == "C gains per_length / mass_per_length M of the structure"
    keys = effect.build()
    body, found = beam(tmp_path, keys)
    assert ([z.real for z in found]
            == pytest.approx([-keys["per_length"] / body["mass_per_length"] / 2] * len(found),
                             rel=1e-6))


def test_an_axial_load_softens_where_it_compresses(tmp_path):
    """Of a pinned beam w_1^2 falls by mean / (pi^2 EI / L^2), Euler's load."""
    effect = EFFECTS["axial_load"]
    assert (effect.law.startswith("K gains -(mean + amplitude cos(omega t)) G")
            and "compression softens" in effect.law)
    body, free = beam(tmp_path)
    keys = {**effect.build(), "amplitude": 0}
    loaded = beam(tmp_path, keys)[1]
    euler = math.pi ** 2 * body["EI"] / body["length"] ** 2
    assert keys["mean"] > 0
    assert (loaded[0].imag / free[0].imag) ** 2 == pytest.approx(1 - keys["mean"] / euler, abs=1e-5)


# ---- a stiff shaft moves as a rigid body ----

LENGTH, LINEAR, DISK, RADIUS = 0.8, 0.5, 4.0, 0.3
INERTIA, POLAR, TOTAL = (LINEAR * LENGTH ** 3 / 12 + DISK * RADIUS ** 2 / 4, DISK * RADIUS ** 2 / 2,
                         LINEAR * LENGTH + DISK)
# N/m, N m/rad, N s/m at each end
HELD, TURNED, LOST = 9e3, 40.0, 11.0


def rigid(tmp_path, speed, *effects):
    """Exponents of translation and rotation, of positive frequency: bending lies far above them."""
    shaft = {"type": "shaft", "frame": "rotating", "length": LENGTH, "elements": 2,
             "EI": [3e7, 3e7], "mass_per_length": LINEAR,
             "speed": speed, "disk": {"position": 0.5, "mass": DISK, "radius": RADIUS}}
    return [z for z in exponents(tmp_path, shaft, *effects) if 0 < z.imag < 1e3]


def bearings(**more):
    return [{"type": "bearing", "at": end, "transverse": HELD, **more} for end in ("left", "right")]


def planes(*polynomials, turning=0.0):
    """Roots s of complex motions y + i z in fixed axes, seen by axes that turn: s - i speed, and
    conjugates."""
    roots = np.concatenate([np.roots(p) for p in polynomials]) - 1j * turning
    return sorted((z for z in np.concatenate([roots, roots.conj()]) if z.imag > 0),
                  key=lambda z: (z.imag, z.real))


def test_bearings_hold_and_damp_a_rigid_shaft_as_printed(tmp_path):
    assert (EFFECTS["bearing"].law
            == "minus transverse u - damping u' and minus rotational slope, in series with a "
               "coupling")
    arm = (LENGTH / 2) ** 2
    expected = planes([TOTAL, 2 * LOST, 2 * HELD],
                      [INERTIA, 2 * LOST * arm, 2 * HELD * arm + 2 * TURNED])
    found = rigid(tmp_path, 0, *bearings(rotational=TURNED, damping=LOST))
    assert found == pytest.approx(expected, rel=1e-3)


def test_a_coupling_is_in_series_with_the_bearing_of_its_end_as_printed(tmp_path):
    assert (EFFECTS["coupling"].law
            == "minus transverse u and minus rotational slope, in series with a bearing")
    soft = 5e3
    both = 1 / (1 / HELD + 1 / soft)
    # each end is held alike: half of the sum moves, half of it turns
    expected = planes([TOTAL, 0, 2 * both], [INERTIA, 0, 2 * both * (LENGTH / 2) ** 2])
    found = rigid(tmp_path, 0, *bearings(), *({"type": "coupling", "at": end, "transverse": soft}
                                              for end in ("left", "right")))
    assert found == pytest.approx(expected, rel=1e-3)


def test_rotary_inertia_adds_half_of_the_polar_one_to_the_slopes(tmp_path):
    assert (EFFECTS["rotary_inertia"].law
            == "M gains I_rho / 2 of the slopes in each plane, along the length")
    along = 0.2
    expected = planes([TOTAL, 0, 2 * HELD],
                      [INERTIA + along / 2 * LENGTH, 0, 2 * HELD * (LENGTH / 2) ** 2])
    found = rigid(tmp_path, 0, *bearings(), {"type": "rotary_inertia", "I_rho": along})
    assert found == pytest.approx(expected, rel=1e-3)


def test_a_gyroscope_turns_one_slope_into_the_other_as_printed(tmp_path):
    """In fixed axes the complex slope s obeys I s'' - i speed Ip s' + k s = 0: forward whirl is the
    faster."""
    assert EFFECTS["gyroscopic"].law.startswith("C gains -speed Mg J, Mg the polar inertia of disk "
                                                "and sections")
    speed, hold = 13.0, 2 * HELD * (LENGTH / 2) ** 2
    expected = planes([TOTAL, 0, 2 * HELD], [INERTIA, -1j * speed * POLAR, hold], turning=speed)
    found = rigid(tmp_path, speed, *bearings(), {"type": "gyroscopic"})
    assert found == pytest.approx(expected, rel=1e-3)
    assert found != pytest.approx(planes([TOTAL, 0, 2 * HELD], [INERTIA, 0, hold], turning=speed),
                                  rel=1e-3)


RIGID = {"bearing", "coupling", "rotary_inertia", "gyroscopic"}

# by test_laws_of_loads.py: the scenes of its shafts and wings
ELSEWHERE = {"clearance", "airloads"}
OF_SEVERAL = {"contact_friction", "contact_bed", "polynomial_coupling"}


def test_every_law_of_the_page_is_held_against_something():
    assert (set(EFFECTS) == set(BETWEEN) | set(WHOLE) | OF_SEVERAL
            | {"viscous_damping", "axial_load"} | RIGID | ELSEWHERE)


# ---- structures ----

def test_matrices_and_a_chain_have_the_exponents_of_their_printed_equations(tmp_path):
    assert STRUCTURES["matrices"].law == "M x'' + (C + speed G) x' + K x = p"
    keys = STRUCTURES["matrices"].build() | {"C": [[0.4, 0.1], [0.3, 0.2]], "G": [[0, 1], [-1, 0]],
                                             "speed": 2}
    mass, C, G, stiffness = (np.array(keys[name], float) for name in ("M", "C", "G", "K"))
    A = np.block([[np.zeros((2, 2)), np.eye(2)],
                  [-np.linalg.solve(mass, stiffness), -np.linalg.solve(mass, C + 2 * G)]])
    assert (exponents(tmp_path, keys)
            == pytest.approx(sorted(np.linalg.eigvals(A), key=lambda z: (z.imag, z.real)),
                             rel=1e-9))
    assert (STRUCTURES["chain"].law
            == "m_i x_i'' + the forces of springs and dampers i and i + 1 = p_i")
    c = [0.5, 0.3, 0.8]
    C = np.array([[c[0] + c[1], -c[1]], [-c[1], c[1] + c[2]]])
    assert exponents(tmp_path, {**CHAIN, "dampers": c}) == pytest.approx(of_matrices(C), rel=1e-9)


def test_a_pinned_beam_has_the_frequencies_of_its_printed_equation(tmp_path):
    assert STRUCTURES["beam"].law.startswith("mass_per_length w_tt + EI w_xxxx = p")
    body = STRUCTURES["beam"].build(elements=24)
    found = [z for z in exponents(tmp_path, body) if z.imag > 0]
    waves = np.arange(1, 4) * math.pi / body["length"]
    expected = np.sqrt(body["EI"] / body["mass_per_length"]) * waves**2
    assert np.imag(found[:3]) == pytest.approx(expected, rel=1e-4)


def test_every_structure_of_the_page_is_held_against_something():
    """A shaft by its rigid motions above, a wing by test_laws_of_loads.py."""
    assert set(STRUCTURES) == {"matrices", "chain", "beam", "shaft", "wing"}
