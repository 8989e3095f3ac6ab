"""Steady states with a law at each of many dofs: the equations of motion hold, by forces sampled
and transformed here, in numpy.
"""
import json
import os
import pathlib
import subprocess
import sys

import numpy
import pytest
import scipy.integrate
import scipy.io

TOP = pathlib.Path(__file__).resolve().parents[2]
CTL = pathlib.Path(os.environ.get("MODALD_BUILD", TOP / "build")) / "bin" / "modalctl"
sys.path.insert(0, str(TOP / "tests" / "bench"))
from lap_joint import lap_joint  # noqa: E402

night = pytest.mark.night
pytestmark = pytest.mark.skipif(not CTL.exists(), reason=f"no {CTL}: build first")

OMEGA, LOAD = 0.3, 0.5
LAWS = {"friction": {"type": "friction", "stiffness": 0.3, "limit": 0.05},
        "cubic": {"type": "cubic_spring", "coefficient": 0.1},
        "gap": {"type": "gap", "stiffness": 1.0, "clearance": 0.3}}


def run(tmp_path, scene, *args):
    path = tmp_path / "scene.json"
    path.write_text(json.dumps(scene))
    done = subprocess.run([CTL, "--local", "--json", "steady", path, "-o", "stability=false",
                           *args], capture_output=True, text=True,
                          timeout=300)
    assert done.returncode == 0, done.stdout[:400] + done.stderr[:400]
    return json.loads(done.stdout)


def effect(law, i, n):
    """The law at dof i; a contact's friction acts on the next one."""
    if law != "contact":
        return {**LAWS[law], "dof": f"x{i + 1}"}
    return {"type": "contact_friction", "normal": f"x{i + 1}", "tangential": f"x{(i + 1) % n + 1}",
            "normal_stiffness": 1.0, "preload": 0.1, "tangential_stiffness": 0.5, "mu": 0.3}


def scene_of(K, C, law, harmonics=7, loaded=0):
    n = len(K)
    return {"structure": {"type": "matrices", "M": numpy.eye(n).tolist(), "C": C.tolist(),
                          "K": K.tolist()}, "omega": OMEGA,
            "effects": [effect(law, i, n) for i in range(n)],
            "excitation": [{"dof": f"x{loaded + 1}", "k": 1, "cos": LOAD}],
            "steady": {"harmonics": harmonics}}


def chain(n):
    return 2 * numpy.eye(n) - numpy.eye(n, k=1) - numpy.eye(n, k=-1)


def force(law, x):
    """Of displacements x, a dof a row, over one period; a slider's place is what two periods leave
    of it.
    """
    if law == "cubic":
        return 0.1 * x**3
    if law == "gap":
        return numpy.maximum(x - 0.3, 0)
    if law == "contact":
        pressed, along = numpy.maximum(0.1 + x, 0), numpy.roll(x, -1, axis=0)
        return pressed + numpy.roll(slid(along, 0.5, 0.3 * pressed), 1, axis=0)
    return slid(x, 0.3 if law == "friction" else law, 0.05 + 0 * x)


def slid(x, stiffness, limit):
    """Forces of sliders."""
    f, z, reach = numpy.empty_like(x), numpy.zeros(len(x)), limit / stiffness
    for j in list(range(x.shape[1])) * 2:
        z = numpy.clip(z, x[:, j] - reach[:, j], x[:, j] + reach[:, j])
        f[:, j] = stiffness * (x[:, j] - z)
    return f


def residual(answer, K, C, law, loaded=0, samples=1 << 14):
    """The largest harmonic of what is left of the equation of motion, over the largest of the
    forces that act.
    """
    n, k = len(K), numpy.array(answer["harmonics"][0]["k"])
    X = numpy.zeros((n, len(k)), complex)
    for motion in answer["harmonics"]:
        X[int(motion["dof"][1:]) - 1] = numpy.array(motion["re"]) + 1j * numpy.array(motion["im"])
    rotation = numpy.exp(2j * numpy.pi * numpy.outer(k, numpy.arange(samples)) / samples)
    F = numpy.fft.rfft(force(law, (X @ rotation).real), axis=1)[:, :len(k)] / samples
    F[:, 1:] *= 2
    P = numpy.zeros_like(F)
    P[loaded, 1] = LOAD
    left = K @ X + 1j * OMEGA * k * (C @ X) - (OMEGA * k) ** 2 * X + F - P
    return abs(left).max() / max(abs(F).max(), LOAD)


def close(law, samples=1 << 14):
    """What sampling here leaves: an event between two samples moves a harmonic by the square of a
    step at most; where a contact's slider sticks is read off a turn of its bound, which the
    seventh harmonic bends by 49 such squares.
    """
    bend = {"cubic": 0, "contact": 49}.get(law, 1)
    return max(1e-13, bend * (2 * numpy.pi / samples) ** 2)


@pytest.mark.parametrize("law", LAWS)
def test_a_chain_of_sixty_laws_is_in_balance_and_so_is_the_same_chain_badly_numbered(tmp_path, law):
    K = chain(60)
    C = 0.03 * K + 0.05 * numpy.eye(60)
    answer = run(tmp_path, scene_of(K, C, law))
    assert answer["converged"] and residual(answer, K, C, law) < close(law)
    order = numpy.random.default_rng(7).permutation(60)
    mixed = numpy.ix_(order, order)
    loaded = int(numpy.flatnonzero(order == 0)[0])
    other = run(tmp_path, scene_of(K[mixed], C[mixed], law, loaded=loaded))
    assert other["converged"] and residual(other, K[mixed], C[mixed], law, loaded) < close(law)
    first = [abs(complex(m["re"][1], m["im"][1])) for m in answer["harmonics"]]
    again = [abs(complex(m["re"][1], m["im"][1])) for m in other["harmonics"]]
    assert numpy.allclose([first[i] for i in order], again, rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("law,n,weak", [("contact", 100, 0.05), ("cubic", 200, 0),
                                        # folds in the dampers, too
                                        ("contact", 50, 0),
                                        pytest.param("cubic", 300, 0, marks=night)])
def test_dampers_that_are_taken_away_lead_to_what_no_load_leads_to(tmp_path, law, n, weak):
    K = chain(n)
    C = 0.03 * K + weak * numpy.eye(n)
    answer = run(tmp_path, scene_of(K, C, law))
    assert answer["converged"] and residual(answer, K, C, law) < close(law)


def test_what_newtons_method_comes_to_with_nothing_between_is_not_looked_for_again(tmp_path):
    """By [D04, theorem 2.2]; six steps, where a ramp of the load took 24 in all."""
    K = chain(60)
    C = 0.03 * K + 0.05 * numpy.eye(60)
    answer = run(tmp_path, scene_of(K, C, "cubic"))
    assert answer["method"] == "newton" and answer["iterations"] < 10
    assert residual(answer, K, C, "cubic") < close("cubic")


def test_a_membrane_with_a_contact_at_every_node_is_in_balance(tmp_path):
    side = 9
    K = numpy.kron(chain(side), numpy.eye(side)) + numpy.kron(numpy.eye(side), chain(side))
    C = 0.02 * K + 0.05 * numpy.eye(side**2)
    middle = side**2 // 2
    answer = run(tmp_path, scene_of(K, C, "gap", loaded=middle))
    assert answer["converged"] and residual(answer, K, C, "gap", middle) < close("gap")


def membrane_of_contacts(side):
    K = numpy.kron(chain(side), numpy.eye(side)) + numpy.kron(numpy.eye(side), chain(side))
    C = 0.02 * K + 0.05 * numpy.eye(side**2)
    return scene_of(K, C, "contact", loaded=side**2 // 2 + side // 4), K, C


def test_a_membrane_with_friction_at_every_node_is_in_balance(tmp_path):
    # 15^2 nodes; each harmonic apart has an eighth of the factors' work of all
    side = 15
    scene, K, C = membrane_of_contacts(side)
    answer = run(tmp_path, scene)
    assert answer["converged"]
    assert residual(answer, K, C, "contact", side**2 // 2 + side // 4) < close("contact")


def test_ten_times_the_contacts_are_at_most_twenty_times_the_work(tmp_path):
    work = []
    for n in (100, 1000):
        scene = {"structure": {"type": "chain", "masses": [1] * n, "springs": [1] * (n + 1),
                               "dampers": [0.03] * (n + 1)}, "omega": OMEGA,
                 "effects": [{"type": "rayleigh_damping", "alpha": 0.05, "beta": 0.0}]
                 + [effect("contact", i, n) for i in range(n)],
                 "excitation": [{"dof": "x1", "k": 1, "cos": LOAD}], "steady": {"harmonics": 7}}
        answer = run(tmp_path, scene)
        assert answer["converged"]
        work.append(answer["work"]["spent"])
    assert work[1] < 20 * work[0]


def left_of_joint(answer, K, M, C, scene, samples=1 << 12):
    """As residual(), of all dofs of a lap joint."""
    k, n = numpy.array(answer["harmonics"][0]["k"]), K.shape[0]
    X = numpy.array([numpy.array(m["re"]) + 1j * numpy.array(m["im"])
                     for m in answer["harmonics"]])
    rotation = numpy.exp(2j * numpy.pi * numpy.outer(k, numpy.arange(samples)) / samples)
    F, P, bed = numpy.zeros_like(X), numpy.zeros_like(X), scene["effects"][0]

    def rows(ends):
        return [(int(name[1:]) - 1, weight) for name, weight in ends.items()]

    def moved(ends):
        return sum(weight * X[i] for i, weight in rows(ends)) @ rotation
    for node in bed["nodes"]:
        pressed = node["area"] * numpy.maximum(
            bed["preload"] + bed["normal_stiffness"] * moved(node["normal"]).real, 0)
        forces = [(node["normal"], pressed)]
        for along in node["tangential"]:
            slides = slid(moved(along).real[None], node["area"] * bed["tangential_stiffness"],
                          bed["mu"] * pressed[None])
            forces.append((along, slides[0]))
        for ends, f in forces:
            spectrum = numpy.fft.rfft(f)[:len(k)] / samples
            spectrum[1:] *= 2
            for i, weight in rows(ends):
                F[i] += weight * spectrum
    for load in scene["excitation"]:
        P[int(load["dof"][1:]) - 1, load["k"]] += load["cos"]
    w = scene["omega"] * k
    left = K @ X + 1j * (C @ X) * w - (M @ X) * w**2 + F - P
    return abs(left).max() / max(abs(F).max(), abs(P).max()), X.shape[0] == n


def joint_answer(tmp_path, patch, harmonics, load):
    """Of all dofs, and its matrices and scene."""
    K, M, C, scene = lap_joint(patch, harmonics, load=load)
    for name, matrix in (("K", K), ("M", M), ("C", C)):
        scipy.io.mmwrite(tmp_path / f"{name}.mtx", matrix.tocoo(), precision=17,
                         symmetry="symmetric")
    scene["steady"]["dofs"] = [f"x{i + 1}" for i in range(K.shape[0])]
    scene["structure"] = {"type": "matrices", **{name: f"{name}.mtx" for name in "KMC"}}
    return run(tmp_path, scene), K, M, C, scene


@night
def test_contacts_that_slide_are_in_balance_at_21_harmonics(tmp_path):
    """36, and a hundred in the nightly run."""
    answer, *joint = joint_answer(tmp_path, 10 if os.environ.get("MODALD_LONG") else 6, 21, 0.0035)
    left, whole = left_of_joint(answer, *joint, samples=1 << 13)
    assert answer["converged"] and whole
    assert left < 21**2 * (2 * numpy.pi / 8192) ** 2     # as close(), of the last harmonic


def test_a_joint_that_sticks_states_no_more_error_than_rounding(tmp_path):
    """It is linear: 5 x 5 contacts of which none slides, some dofs at rest by symmetry."""
    answer, *_ = joint_answer(tmp_path, 5, 21, 0.0025)
    largest = max(numpy.hypot(m["re"], m["im"]).max() for m in answer["harmonics"])
    assert answer["converged"] and 0 < answer["total_error"] < 1e-9 * largest


@night
def test_a_joint_that_slides_states_the_error_that_twice_the_harmonics_show(tmp_path):
    """5 x 5 contacts; by a third too little or 30 times too much at most."""
    few, many = (joint_answer(tmp_path, 5, harmonics, 0.0035)[0] for harmonics in (21, 42))
    wave = numpy.exp(2j * numpy.pi * numpy.outer(numpy.arange(43), numpy.arange(512)) / 512)
    low, high = (numpy.array([m["re"] for m in a["harmonics"]])
                 + 1j * numpy.array([m["im"] for m in a["harmonics"]]) for a in (few, many))
    high[:, :22] -= low
    true = abs((high @ wave).real).max()
    assert few["converged"] and many["converged"]
    assert true / 3 < few["total_error"] < 30 * true


def test_a_lap_joint_that_slides_is_in_balance(tmp_path):
    """A patch of 5 x 5 contacts; the load is above what friction holds."""
    answer, K, M, C, scene = joint_answer(tmp_path, 5, 3, 0.005)
    left, whole = left_of_joint(answer, K, M, C, scene)
    assert answer["converged"] and whole
    assert left < 9 * (2 * numpy.pi / 4096) ** 2     # as close(), of the third harmonic


def test_springs_that_push_back_less_than_they_are_pushed_leave_the_balance_as_good(tmp_path):
    # not symmetric, nor is its pattern
    K = chain(40) + 0.2 * numpy.eye(40, k=1) - 0.1 * numpy.eye(40, k=-2)
    C = 0.03 * chain(40) + 0.1 * numpy.eye(40)
    answer = run(tmp_path, scene_of(K, C, "friction"))
    assert answer["converged"] and residual(answer, K, C, "friction") < close("friction")


def test_a_thousand_sliders_are_in_balance(tmp_path):
    n = 1000
    scene = {"structure": {"type": "chain", "masses": [1] * n, "springs": [1] * (n + 1),
                           "dampers": [0.03] * (n + 1)}, "omega": OMEGA,
             "effects": [{**LAWS["friction"], "dof": f"x{i + 1}"} for i in range(n)],
             "excitation": [{"dof": "x1", "k": 1, "cos": LOAD}], "steady": {"harmonics": 7}}
    answer = run(tmp_path, scene)
    assert (answer["converged"] and residual(answer, chain(n), 0.03 * chain(n), "friction",
                                             samples=1 << 12) < close("friction", 1 << 12))
    told = [d["message"] for d in answer["diagnostics"] if d["code"] == "undetermined_offset"]
    # one line, not one a slider
    assert len(told) == 1 and " sliders of 1000 never slip" in told[0]


def test_twenty_rigid_sliders_push_with_their_limit_where_they_move_and_never_with_more(tmp_path):
    n, limit = 20, 0.05
    scene = scene_of(chain(n), 0.03 * chain(n), "friction")
    scene["effects"] = [{"type": "coulomb", "dof": f"x{i + 1}", "limit": limit} for i in range(n)]
    del scene["steady"]
    answer = run(tmp_path, scene)
    assert answer["converged"]
    X = numpy.array([row["re"] + 1j * numpy.array(row["im"]) for row in answer["harmonics"]])
    k = numpy.arange(X.shape[1]) * OMEGA
    P = numpy.zeros_like(X)
    P[0, 1] = LOAD

    def of_time(series):
        return numpy.fft.irfft(numpy.pad(series, ((0, 0), (0, 1024))) * 2048, 4096)
    F = P - chain(n) @ X * (1 + 0.03j * k) + k**2 * X
    force, rate = [of_time(series * numpy.where(k > 0, 1, 2)) for series in (F, 1j * k * X)]
    moving = abs(rate) > 0.02 * abs(rate).max()
    # a jump's series is off beside it: in the mean of squares
    assert numpy.sqrt((numpy.clip(abs(force) - limit, 0, None)**2).mean()) < 0.01 * limit
    assert numpy.sqrt(((force - limit * numpy.sign(rate))[moving]**2).mean()) < 0.1 * limit


def test_a_thousand_open_gaps_are_told_with_the_digits_that_their_cost_has(tmp_path):
    n = 1000
    answer = run(tmp_path, {
        "structure": {"type": "chain", "masses": [1] * n, "springs": [1] * (n + 1),
                      "dampers": [0.03] * (n + 1)}, "omega": OMEGA,
        "effects": [{**LAWS["gap"], "clearance": 30 * LOAD, "dof": f"x{i + 1}"} for i in range(n)],
        "excitation": [{"dof": "x1", "k": 1, "cos": LOAD}], "steady": {"stability": False}})
    told = answer["plan"]["effects"]
    assert answer["converged"] and len(told) == n and not any(e["active"] for e in told)
    assert all(e["evaluations"] > 0 and e["seconds"] == float(f"{e['seconds']:.3g}") > 0
               for e in told)


@pytest.mark.parametrize("law, held", [({"type": "gap", "stiffness": 50.0, "clearance": 9.0}, 0),
                                       ({"type": "gap", "stiffness": 0.3, "clearance": -9.0}, 0),
                                       ({"type": "friction", "stiffness": 0.3, "limit": 9.0}, 1)])
def test_the_verdict_where_all_laws_rest_is_of_a_linear_scene_and_costs_what_it_does(tmp_path, law,
                                                                                 held):
    """Gaps that stay open, or closed, sliders that stick: disturbances see springs at most, and
    what each slider holds stays.  Beside numpy's eigenvalues, and the CPU of the scene without
    laws, of which 300 gaps took twenty times as much."""
    n = 300
    scene = scene_of(chain(n) + 0.1 * numpy.eye(n), 0.05 * numpy.eye(n), "gap")
    without = {**scene, "effects": []}
    scene["effects"] = [{**law, "dof": f"x{i + 1}"} for i in range(n)]
    answer, linear = (run(tmp_path, each, "-o", "stability=true") for each in (scene, without))
    closed = 0.3 if law.get("clearance", 0) < 0 or held else 0.0
    stiff = numpy.linalg.eigvalsh(chain(n) + (0.1 + closed) * numpy.eye(n))
    slow = numpy.sqrt(stiff - 0.025 ** 2)                       # C = 0.05 M: all decay alike
    turn = numpy.exp((-0.025 + 1j * slow) * 2 * numpy.pi / OMEGA)
    expected = numpy.sort_complex(numpy.r_[turn, turn.conj(), numpy.ones(held * n)])
    got = numpy.array([complex(*z) for z in answer["stability"]["multipliers"]])
    far = numpy.abs(got[:, None] - expected[None, :])
    assert len(got) == len(expected)
    assert max(far.min(0).max(), far.min(1).max()) < 1e-9
    assert answer["stability"]["stable"] is (None if held else True)
    assert answer["cost"]["cpu_s"] < 3 * linear["cost"]["cpu_s"]


def test_multipliers_of_one_modulus_are_as_sure_as_others(tmp_path):
    """Damping of mass alone: multipliers pair to e^(-alpha T), and on their circle all have that
    modulus' root, so that their order is rounding's.  The errors were twice the modulus, and the
    verdict null."""
    n, alpha = 20, 0.05
    scene = scene_of(chain(n), alpha * numpy.eye(n), "cubic")
    told = run(tmp_path, scene, "-o", "stability=true")["stability"]
    modulus = numpy.exp(-alpha * numpy.pi / OMEGA)
    assert told["stable"] is True and told["error"] < 1e-8
    assert len(told["multipliers"]) == 2 * n
    assert all(abs(abs(complex(*z)) - modulus) < 1e-8 for z in told["multipliers"])


def test_gaps_that_rest_leaves_open_are_not_sought_twice_from_the_motion_without_them(tmp_path):
    """Newton's first step from rest leads there; the same nine steps from there were taken again,
    39 in all.
    """
    scene = scene_of(chain(100), 0.03 * chain(100) + 0.05 * numpy.eye(100), "gap")
    answer = run(tmp_path, scene)
    assert answer["converged"] and answer["iterations"] < 35


def test_contacts_are_reached_by_stepping_the_load_up_before_any_path_is_walked(tmp_path):
    K = chain(20)
    answer = run(tmp_path, scene_of(K, 0.03 * K + 0.05 * numpy.eye(20), "gap"))
    assert (answer["converged"] and answer["method"] == "newton-ramped"
            and answer["work"]["spent"] < 0.1 * answer["work"]["allowed"])


def test_stiff_contacts_are_in_balance_as_far_as_rounding_lets_them(tmp_path):
    """Forty, of 10^4 times the chain's stiffness, some of which slip: what rounding of motions is
    in forces ends Newton's method before its steps are short for what hardly moves.
    """
    n, stiffness = 40, 1e4
    springs = [1] * n + [0] + [1] * n            # one chain along the normals, one along the other
    scene = {"structure": {"type": "chain", "masses": [1] * (2 * n), "springs": springs,
                           "dampers": [0.03 * k for k in springs]}, "omega": OMEGA,
             "effects": [{"type": "rayleigh_damping", "alpha": 0.05, "beta": 0.0}]
             + [{"type": "contact_friction", "normal": f"x{i + 1}", "tangential": f"x{n + i + 1}",
                 "normal_stiffness": stiffness, "preload": 1.0, "mu": 0.3,
                 "tangential_stiffness": stiffness} for i in range(n)],
             "excitation": [{"dof": f"x{i + 1}", "k": 0, "cos": 1.0} for i in range(n)]
             + [{"dof": f"x{n + 1}", "k": 1, "cos": LOAD}, {"dof": "x1", "k": 1, "cos": 0.2}],
             "steady": {"harmonics": 7}}
    answer = run(tmp_path, scene)
    assert (answer["converged"] and answer["work"]["spent"] < 0.1 * answer["work"]["allowed"]
            and answer["residual"] < 15 * 2.3e-16 * stiffness)


def test_many_harmonics_that_are_asked_for_are_found_from_fewer(tmp_path):
    """From rest with all of them each of many steps costs the cube of their number."""
    K = chain(20)
    C = 0.03 * K + 0.05 * numpy.eye(20)
    answer = run(tmp_path, scene_of(K, C, "contact", harmonics=128))
    assert answer["converged"] and answer["work"]["spent"] < 1e9
    assert residual(answer, K, C, "contact") < 128**2 * (2 * numpy.pi / (1 << 14))**2


@pytest.mark.parametrize("name,converges", [("47", None), ("73", True), ("74", True), ("75", True),
                                            ("109", True)])
def test_a_random_scene_of_few_dofs_is_answered_within_the_work_allowed(tmp_path, name, converges):
    """They took 6 to 180 s: as much work as is allowed is a second or two, the last step and the
    error's estimate beyond it.
    """
    scene = json.loads((TOP / "tests" / "data" / "steady"
                        / f"random_scene_{name}.json").read_text())
    answer = run(tmp_path, scene, "-o", "stability=true")
    assert (answer["work"]["spent"] < 1.5 * answer["work"]["allowed"]
            and answer["work"]["allowed"] < 1.5e10)
    assert converges is None or answer["converged"]
    assert answer["converged"] or answer["diagnostics"]
    if answer["converged"]:
        largest = max(abs(complex(a, b)) for m in answer["harmonics"]
                      for a, b in zip(m["re"], m["im"]))
        assert answer["residual"] < 1e-9 and answer["total_error"] < 1e-2 * largest


def marched(scene, periods, x, v):
    """The scene's motion from (x, v) after so many periods, by an order-8 code of others."""
    s = scene["structure"]
    M, C, K = (numpy.array(s[name]) for name in "MCK")
    dof = {f"x{i + 1}": i for i in range(len(M))}
    n, omega = len(M), scene["omega"]
    back = numpy.linalg.inv(M)

    def slope(t, y):
        f = -K @ y[:n] - C @ y[n:]
        for load in scene["excitation"]:
            f[dof[load["dof"]]] += (load.get("cos", 0) * numpy.cos(load["k"] * omega * t)
                                    + load.get("sin", 0) * numpy.sin(load["k"] * omega * t))
        for e in scene["effects"]:
            to = dof[e["to"]] if "to" in e else None
            d = y[dof[e["dof"]]] - (y[to] if to is not None else 0)
            g = (e["coefficient"] * d**3 if e["type"] == "cubic_spring"
                 else e["stiffness"] * max(d - e["clearance"], 0))
            f[dof[e["dof"]]] -= g
            if to is not None:
                f[to] += g
        return numpy.concatenate([y[n:], back @ f])
    end = scipy.integrate.solve_ivp(slope, (0, periods * 2 * numpy.pi / omega),
                                    numpy.concatenate([x, v]), "DOP853", rtol=1e-9, atol=1e-13)
    return end.y[:n, -1], end.y[n:, -1]


def test_a_stable_orbit_beside_an_unstable_one_is_given_where_stability_is_asked(tmp_path):
    """Two orbits: an unstable one, and one that stays where it is for 20 periods when marched.
    With few harmonics both are found; from 16 of them to 256 at once Newton's method does not lead.
    """
    scene = json.loads((TOP / "tests" / "data" / "steady" / "random_scene_109.json").read_text())
    answer = run(tmp_path, scene, "-o", "stability=true")
    assert answer["converged"] and answer["stability"]["stable"] is True
    assert answer["work"]["spent"] <= 1.05 * answer["work"]["allowed"]     # the last step
    X = numpy.array([numpy.array(h["re"]) + 1j * numpy.array(h["im"])
                     for h in answer["harmonics"]])
    k = numpy.arange(X.shape[1])
    x, v = X.sum(axis=1).real, (1j * k * scene["omega"] * X).sum(axis=1).real
    end, _ = marched(scene, 20, x, v)
    assert abs(end - x).max() <= 1e-3 * abs(X).sum(axis=1).max()


@pytest.mark.parametrize("n", [1, 2, 5])
def test_sliders_a_hundred_million_times_as_stiff_as_the_chain_move_as_rigid_ones(tmp_path, n):
    """All of them slip; rounding leaves 1e-8 of the forces.  Rigid friction is another method's."""
    scene = {"structure": {"type": "chain", "masses": [1] * n, "springs": [1] * (n + 1),
                           "dampers": [0.03] * (n + 1)}, "omega": OMEGA,
             "effects": [{"type": "friction", "dof": f"x{i + 1}", "stiffness": 1e8, "limit": 0.05}
                         for i in range(n)],
             "excitation": [{"dof": "x1", "k": 1, "cos": LOAD}], "steady": {"stability": False}}
    stiff = run(tmp_path, {**scene, "steady": {"stability": False, "harmonics": 7}})
    rigid = run(tmp_path, {**scene, "effects": [{"type": "coulomb", "dof": f"x{i + 1}",
                                                 "limit": 0.05} for i in range(n)]})
    assert stiff["converged"] and rigid["converged"] and stiff["residual"] < 1e-7
    for ours, theirs in zip(stiff["harmonics"], rigid["harmonics"]):
        a, b = (complex(h["re"][1], h["im"][1]) for h in (ours, theirs))
        assert abs(a - b) < stiff["total_error"] + rigid["total_error"]


def test_twenty_sliders_a_hundred_million_times_as_stiff_as_the_chain_are_in_balance(tmp_path):
    """Some never slip.  Newton's method comes there from softer ones alone."""
    K, stiffness = chain(20), 1e8
    scene = scene_of(K, 0.05 * numpy.eye(20), "friction")
    for e in scene["effects"]:
        e["stiffness"] = stiffness
    answer = run(tmp_path, scene)
    assert answer["converged"] and answer["method"] == "newton-ramped"
    assert answer["residual"] < 15 * 2.3e-16 * stiffness
    # a jump falls between two samples
    assert residual(answer, K, 0.05 * numpy.eye(20), stiffness, samples=1 << 12) < 1e-3


def test_a_slider_on_what_has_no_stiffness_is_not_come_to_by_softer_ones(tmp_path):
    """What holds x1 through x2 is 0, at rest and at omega: of no stiffness no level begins, and a
    ramp whose levels are no numbers takes all its 60, of 4 iterations each.
    """
    scene = {"structure": {"type": "matrices", "M": [[1, 0], [0, 1]], "K": [[2, -2], [-2, 2]],
                           "C": [[1, 0], [0, 0]]},
             "effects": [{"type": "friction", "dof": "x1", "limit": 0.5, "stiffness": 1e3}],
             "omega": 2.0, "steady": {"harmonics": 3, "max_iterations": 4},
             "excitation": [{"dof": "x1", "k": 1, "cos": 2.0}]}
    assert run(tmp_path, scene)["iterations"] < 60 * 4
