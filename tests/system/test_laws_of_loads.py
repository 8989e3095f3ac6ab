"""Loads, sensors and the laws of journals, wings and airloads do what modald-scene(5) prints.

A load acts on a free mass: its force, momentum and path are the printed law's and its integrals.
Sensors read motions that are known beforehand.  The expected values are made of the page's symbols
(scene_page.py), of Ritz's method, Duhamel's integral and lifting-line theory.
"""
import h5py
import numpy as np
import pytest
from local_scene import run
from scene_page import EFFECTS, LOADS, SENSORS, STRUCTURES, evaluate
from scipy.integrate import quad
from scipy.linalg import eig
from test_noise import bands, near


def record(tmp_path, scene, *words):
    """Channels' rows by name, and the times."""
    answer = run(tmp_path, "simulate", scene, "-O", tmp_path / "x.h5", *words)
    with h5py.File(tmp_path / "x.h5") as file:
        y = file["signals"][:]
    return np.arange(len(y)) * scene["time"]["dt"], dict(zip(answer["channels"], y.T))


# ---- loads ----

MASS, OMEGA, TONES, START = 2.0, 3.0, [3.0, 4.1], 0.1003


def free_mass(tmp_path, load, dt=0.001, duration=0.4, **scene):
    """t, force, momentum and mass times the path of a free mass under LOAD."""
    t, y = record(tmp_path, {"structure": {"type": "chain", "masses": [MASS], "springs": [0, 0]},
                             "omega": OMEGA, "excitation": [load],
                             "sensors": [{"dof": "x1", "derivative": n} for n in range(3)],
                             "time": {"dt": dt, "duration": duration}, **scene})
    return t, *(MASS * y[name] for name in ("x1_ddot", "x1_dot", "x1"))


def law_of(load, **also):
    """p(t) of the printed law, and the times where it is not smooth."""
    part = LOADS[load["type"]]
    names = {key.symbol: load[key.name] for key in part.keys if key.name in load}
    law, *window = part.law.removeprefix("p = ").split(", 0 < tau < ")
    start, last = load.get("start", 0), names.get(window[0], np.inf) if window else np.inf
    assert not window or [k for k in part.keys if k.symbol == window[0]]

    def p(t):
        tau = t - start
        return np.where(not window or (0 < tau) & (tau < last),
                        evaluate(law, t=t, tau=tau, omega=OMEGA, **{**names, **also}), 0)
    return p, [start, start + last] if window else []


def check(tmp_path, load, p, kinks, **scene):
    t, force, momentum, path = free_mass(tmp_path, load, **scene)
    size = np.abs(force).max()
    assert size > 0.1
    assert force == pytest.approx(np.array([float(p(at)) for at in t]), abs=1e-9 * size)
    points = [at for at in kinks if 0 < at < t[-1]]
    assert momentum[-1] == pytest.approx(quad(p, 0, t[-1], points=points or None)[0], rel=1e-6)
    assert path[-1] == pytest.approx(quad(lambda at: (t[-1] - at) * p(at), 0, t[-1],
                                          points=points or None)[0], rel=1e-6)


CLOSED = ["harmonic", "half_sine", "one_minus_cosine", "step"]


@pytest.mark.parametrize("name", CLOSED)
def test_a_free_mass_feels_the_printed_load(name, tmp_path):
    load = LOADS[name].build(dof="x1", **{} if name == "harmonic" else {"start": START})
    if name == "harmonic":
        load |= {"sin": -0.7, "k": 2}
    check(tmp_path, load, *law_of(load))


def test_a_step_with_a_duration_ends_as_printed(tmp_path):
    load = LOADS["step"].build(dof="x1", start=START, duration=0.1)
    check(tmp_path, load, *law_of(load))


def test_a_load_of_tones_has_the_printed_frequency(tmp_path):
    k, key = [2, -1], next(key for key in LOADS["harmonic"].keys if key.name == "k")
    assert "k omega is the sum of k_j W_j, W the tones of steady.tones" in key.means
    load = LOADS["harmonic"].build(dof="x1", k=k) | {"sin": 0.4}
    summed = float(np.dot(k, TONES))
    check(tmp_path, load, *law_of(load, k=summed / OMEGA), steady={"tones": TONES})


def test_an_impulse_is_the_printed_jump_of_momentum(tmp_path):
    assert LOADS["impulse"].law == "momentum jumps by amplitude at start"
    load = LOADS["impulse"].build(dof="x1", start=START)
    t, _, momentum, path = free_mass(tmp_path, load)
    after = np.where(t > START, load["amplitude"], 0)
    assert momentum == pytest.approx(after, abs=1e-12)
    assert path == pytest.approx(after * (t - START), abs=1e-12)


@pytest.mark.parametrize("lists", [False, True])
def test_a_table_is_linear_between_its_points_and_0_outside(lists, tmp_path):
    part = LOADS["table"]
    assert part.law == "p = amplitude force(tau), linear between its points, 0 outside"
    points = [[-0.05, 3], [0.0204, 1], [0.11, -2.5], [0.2, 4]]
    time, forces = ([at for at, _ in points], [f for _, f in points])
    given = {"time": time, "force": forces} if lists else {"points": points}
    load = {"type": "table", "dof": "x1", "start": START, "amplitude": 2} | given
    check(tmp_path, load, lambda t: 2 * np.interp(t - START, time, forces, 0, 0),
          [START + at for at in time])


def test_noise_has_the_printed_density_and_is_linear_between_its_values(tmp_path):
    part, dt = LOADS["noise"], 0.01
    density, = (text.removeprefix("of density ")
                for text in part.law.replace("; ", ", ").split(", ")
                if text.startswith("of density"))
    assert "linear between values each dt" in part.law
    load = part.build(dof="x1", corner=20, start=0)
    _, force, momentum, path = free_mass(tmp_path, load, dt=dt, duration=400.0)
    for f, got, lines in bands(force, dt, 30):
        assert near(got, evaluate(density, f=f, psd=load["psd"], corner=load["corner"]), lines)
    left, right = force[:-1], force[1:]
    near_by = 1e-9 * np.abs(momentum).max()
    assert np.diff(momentum) == pytest.approx(dt * (left + right) / 2, abs=near_by)
    assert np.diff(path) - dt * momentum[:-1] == pytest.approx(dt**2 * (2 * left + right) / 6,
                                                               abs=1e-9 * np.abs(path).max())


def test_no_load_of_the_page_is_without_a_check():
    assert set(LOADS) == set(CLOSED) | {"impulse", "table", "noise"}


# ---- a shaft's momentum, journals ----

LENGTH, ELEMENTS, LINEAR, DISK, SPEED = 0.6, 2, 0.8, 5.0, 24.0
SHAFT = {"type": "shaft", "length": LENGTH, "elements": ELEMENTS, "EI": [3e3, 3e3],
         "mass_per_length": LINEAR, "disk": {"position": 0.5, "mass": DISK}}


NODES = range(ELEMENTS + 1)


def accelerations(frame):
    return [{"dof": f"{c}{i}", "derivative": 2, "frame": frame, "name": f"{c}{i}''"}
            for c in ("y", "sy", "z", "sz") for i in NODES]


def net_force(y, plane):
    """What acts from outside: the rate of momentum of a cubic on each element, and of the disk."""
    u, slope = (np.array([y[f"{c}{i}''"] for i in NODES]) for c in (plane, f"s{plane}"))
    h = LENGTH / ELEMENTS
    shaft = (h / 2 * (u[1:] + u[:-1]) + h**2 / 12 * (slope[:-1] - slope[1:])).sum(0)
    return LINEAR * shaft + DISK * u[ELEMENTS // 2]


@pytest.mark.parametrize("frame", ["fixed", "rotating"])
def test_a_load_on_a_shaft_keeps_its_direction_on_the_axes_it_names(frame, tmp_path):
    load = LOADS["half_sine"].build(dof="y1", start=0.01, frame=frame)
    t, y = record(tmp_path, {"structure": {**SHAFT, "speed": SPEED}, "excitation": [load],
                             "sensors": accelerations("fixed"),
                             "time": {"dt": 5e-4, "duration": 0.1}})
    p, turned = law_of(load)[0](t), SPEED * t * (frame == "rotating")
    assert net_force(y, "y") == pytest.approx(p * np.cos(turned), abs=1e-7 * p.max())
    assert net_force(y, "z") == pytest.approx(p * np.sin(turned), abs=1e-7 * p.max())


# what both ends of a shaft stand on: contact left, a spring right
GAP, CONTACT, MU, JOURNAL, HELD = 1e-3, 2e5, 0.6, 0.05, 3e4


def spring(at):
    return {"type": "bearing", "at": at, "transverse": HELD}


def journal(y, gap=GAP, stiffness=CONTACT, dissipation=MU):
    """Force on the journal by the printed law, and its parts' sizes."""
    law = "minus stiffness a (1 + dissipation a') radially on the journal where a = |d| - gap > 0"
    assert EFFECTS["clearance"].law == law
    d, v = np.array([y["y0"], y["z0"]]), np.array([y["y0'"], y["z0'"]])
    length = np.maximum(np.hypot(*d), 1e-300)                            # at 0 nothing touches
    a, rate = length - gap, (d * v).sum(0) / length
    N = evaluate("stiffness a (1 + dissipation rate)", stiffness=stiffness, a=a,
                 dissipation=dissipation, rate=rate)
    pulling = (a > 0) & (N < 0)
    return -d / length * np.where((a > 0) & (N > 0), N, 0), a > 0, pulling


@pytest.mark.parametrize("frame, speed", [("rotating", 0.0), ("fixed", SPEED)])
def test_a_journal_in_its_race_feels_the_printed_force_and_is_never_pulled(frame, speed, tmp_path):
    ends = [EFFECTS["clearance"].build(at="left", gap=GAP, stiffness=CONTACT, dissipation=MU,
                                       journal_mass=JOURNAL),
            spring("right")]
    assert {k.name for k in EFFECTS["clearance"].keys} == {"type", *ends[0]}
    shaft = {**SHAFT, "frame": frame, "speed": speed}
    read = [{"dof": f"{c}0", "derivative": 1, "name": f"{c}0'"} for c in "yz"]
    read += [{"dof": f"{c}{i}", "name": f"{c}{i}"} for c in "yz" for i in NODES]
    start = {"x": {"y0": 3e-3, "z0": -2e-3}, "v": {"y0": -4.0, "z0": 1.0, "y1": -0.3}}
    t, y = record(tmp_path, {"structure": shaft, "effects": ends, "initial": start,
                             "sensors": read + accelerations(frame),
                             "time": {"dt": 2e-5, "duration": 0.08}}, "-o", "tolerance=1e-10")
    force, touching, pulling = journal(y)
    assert touching.any() and not touching.all() and pulling.any()
    size = np.abs(force).max()
    for plane, f in zip("yz", force):
        outside = net_force(y, plane) + JOURNAL * y[f"{plane}0''"] + HELD * y[f"{plane}{ELEMENTS}"]
        assert outside == pytest.approx(f, abs=1e-7 * size)


def test_a_journal_without_mass_balances_the_printed_force(tmp_path):
    """The disk alone has mass: what accelerates it is the race left and the bearing right."""
    ends = [EFFECTS["clearance"].build(at="left", gap=GAP, stiffness=CONTACT),
            spring("right")]
    shaft = {"type": "shaft", "model": "massless", "length": LENGTH, "elements": 2,
             "EI": [3e3, 5e3], "disk": {"position": 0.5, "mass": DISK, "radius": 0.1}}
    read = [{"dof": f"{c}{i}", "name": f"{c}{i}"} for c in "yz" for i in NODES]
    read += [{"dof": f"{c}1", "derivative": 2, "name": f"{c}1''"} for c in "yz"]
    t, y = record(tmp_path, {"structure": shaft, "effects": ends, "sensors": read,
                             "initial": {"v": {"y1": 0.8, "z1": 0.3}},
                             "time": {"dt": 1e-4, "duration": 0.2}}, "-o", "tolerance=1e-10")
    still = {**y, "y0'": 0 * t, "z0'": 0 * t}
    force, touching, _ = journal(still, dissipation=0)
    # at rest within the race the journal is where the bent shaft has its end
    assert touching.any() and not touching.all()
    size = np.abs(force).max()
    for plane, f in zip("yz", force):
        outside = DISK * y[f"{plane}1''"] + HELD * y[f"{plane}{ELEMENTS}"]
        assert outside == pytest.approx(f, abs=1e-6 * size)


# ---- sensors ----

def test_a_sensor_reads_a_dof_and_its_rates_and_names_its_channel(tmp_path):
    assert SENSORS["any by dof"].law == "x, x' or x'' of a dof"
    w, x0, v0 = 11.0, 0.3, -2.0
    body = {"type": "chain", "masses": [MASS], "springs": [MASS * w**2, 0]}
    read = [{"dof": "x1", "derivative": n}
            for n in (1, 2)] + [{"dof": "x1"}, {"dof": "x1", "name": "gauge"}]
    t, y = record(tmp_path, {"structure": body, "initial": {"x": {"x1": x0}, "v": {"x1": v0}},
                             "sensors": read, "time": {"dt": 0.003, "duration": 2}})
    x = x0 * np.cos(w * t) + v0 / w * np.sin(w * t)
    rate = v0 * np.cos(w * t) - w * x0 * np.sin(w * t)
    for name, want in {"x1": x, "gauge": x, "x1_dot": rate, "x1_ddot": -w**2 * x}.items():
        assert y[name] == pytest.approx(want, abs=1e-10 * np.abs(want).max())


@pytest.mark.parametrize("own, frames", [("rotating", ["rotating", "fixed"]), ("fixed", ["fixed"])])
def test_a_sensor_on_a_shaft_reads_on_the_axes_it_names(own, frames, tmp_path):
    """A free shaft flies straight on fixed axes; e2, e3 turn from e2 to e3."""
    assert (SENSORS["shaft by dof"].law
            == "a dof or a coordinate without mass, on turning or on fixed axes")
    place, velocity = np.array([0.02, -0.01]), np.array([0.5, 0.7])
    relative = velocity - (own == "rotating") * SPEED * np.array([-place[1], place[0]])
    start = {key: {f"{c}{i}": float(u) for c, u in zip("yz", of) for i in NODES}
             for key, of in (("x", place), ("v", relative))}
    read = [{"dof": f"{c}2", "derivative": n, "frame": frame, "name": f"{c}{n} {frame}"}
            for c in "yz" for n in range(3) for frame in frames]
    t, y = record(tmp_path, {"structure": {**SHAFT, "frame": own, "speed": SPEED}, "initial": start,
                             "sensors": read, "time": {"dt": 1e-3, "duration": 0.2}})
    line = complex(*place) + complex(*velocity) * t
    turn = np.exp(-1j * SPEED * t)
    seen = {"fixed": [line, 0 * t + complex(*velocity), 0j * t],
            "rotating": [line * turn, (complex(*velocity) - 1j * SPEED * line) * turn,
                         (-2j * SPEED * complex(*velocity) - SPEED**2 * line) * turn]}
    for frame in frames:
        for n in range(3):
            found = y[f"y{n} {frame}"] + 1j * y[f"z{n} {frame}"]
            assert found == pytest.approx(seen[frame][n], abs=1e-7 * SPEED**n * np.abs(line).max())


def test_a_sensor_reads_an_end_without_mass(tmp_path):
    """Half of the force of a beam bent by its middle, 48 EI / L^3, is each bearing's."""
    ends = [spring("left"), spring("right")]
    shaft = {"type": "shaft", "model": "massless", "length": LENGTH, "elements": 2,
             "EI": [3e3, 3e3], "disk": {"position": 0.5, "mass": DISK}}
    read = [{"dof": f"y{i}"} for i in NODES]
    t, y = record(tmp_path, {"structure": shaft, "effects": ends, "sensors": read,
                             "initial": {"x": {"y1": 1e-3}}, "time": {"dt": 1e-3, "duration": 0.2}})
    bent = 48 * 3e3 / LENGTH**3
    for end in ("y0", "y2"):
        assert y[end] == pytest.approx(y["y1"] * bent / (bent + 2 * HELD), abs=1e-12)
    assert np.ptp(y["y1"]) > 1e-3


# ---- a wing and its air ----

WING = STRUCTURES["wing"].build() | {"elements": 6}
AIR = EFFECTS["airloads"].build() | {"stations": 9, "inflow": "none"}


def stations(count=AIR["stations"]):
    at, weight = np.polynomial.legendre.leggauss(count)
    return WING["length"] * (at + 1) / 2, WING["length"] * weight / 2


def bent(tmp_path, w, phi):
    """Node values of w(y), a cubic from y^2 on, and phi(y), one from y on, by dof."""
    dofs = run(tmp_path, "simulate", {"structure": WING, "time": {"dt": 1, "duration": 0}},
               "-O", tmp_path / "x.h5")["channels"]
    n, place = WING["elements"], np.polynomial.Polynomial
    w, phi = place([0, 0, *w]), place([0, *phi])
    values = {f"w{i}": w(i * WING["length"] / n) for i in range(1, n + 1)}
    values |= {f"wp{i}": w.deriv()(i * WING["length"] / n) for i in range(1, n + 1)}
    values |= {f"phi{i}": phi(i * WING["length"] / n / 3) for i in range(1, 3 * n + 1)}
    assert set(values) == set(dofs)
    return {dof: float(value) for dof, value in values.items()}, w, phi


BEND, TWIST = ((0.01, 0.002), (0.02, -0.004, 0.0003)), ((0.5, -0.03), (-0.3, 0.1, 0.02))


def flown(tmp_path, air, dt=1e-4, duration=0.05):
    """The record at every station: lift, moment, w, phi and their rates, arrays station by time."""
    x, v = (bent(tmp_path, *of)[0] for of in (BEND, TWIST))
    read = [{"station": s, "quantity": q} for q in ("lift", "moment")
            for s in range(len(stations()[0]))]
    read += [{"position": y, "quantity": q, "derivative": n, "name": f"{q}{n} {s}"}
             for q in ("w", "phi") for n in range(3) for s, y in enumerate(stations()[0])]
    t, y = record(tmp_path, {"structure": WING, "effects": [air], "sensors": read,
                             "initial": {"x": x, "v": v}, "time": {"dt": dt, "duration": duration}})
    rows = {f"{q}{n}": np.array([y[f"{q}{n} {s}"] for s in range(len(stations()[0]))])
            for q in ("w", "phi") for n in range(3)}
    for q in ("lift", "moment"):
        rows[q] = np.array([y[f"{q}_{s}"] for s in range(len(stations()[0]))])
    return t, rows


def symbols(air):
    """The page's letters: of the keys, and those that the law itself defines."""
    law = EFFECTS["airloads"].law.split("; ")
    assert law[0].startswith("per length up ") and law[1].startswith("nose-up ")
    names = {"U": air["speed"], "rho": air["density"], "chord": WING["chord"], "x_qc": air["x_qc"],
             "a0": air.get("lift_slope", 2 * np.pi)}
    defined = dict(text.split(" = ") for text in law[2].split(", "))
    for name in ("b", "e", "h", "A"):
        names[name] = evaluate(defined[name], **names)
    return (law[0].removeprefix("per length up "), law[1].removeprefix("nose-up "), defined["Lc"],
            names)


def wash(rows, names, law):
    """What Lc takes a0 rho U b of, but for the inflow."""
    inside = law.removeprefix("a0 rho U b (").removesuffix(" - inflow)")
    return evaluate(inside, **names, phi=rows["phi0"], w_t=rows["w1"], phi_t=rows["phi1"])


def expected_loads(air, rows, Lc):
    lift, moment, _, names = symbols(air)
    at = {"w_tt": rows["w2"], "phi_t": rows["phi1"], "phi_tt": rows["phi2"], "Lc": Lc, **names}
    return evaluate(lift, **at), evaluate(moment, **at)


def circulatory(air, rows):
    """Lc as the two sensors have it: of the lift, and of the moment through x_qc."""
    _, _, _, names = symbols(air)
    lift, moment = expected_loads(air, rows, 0)
    Lc = rows["lift"] - lift
    assert rows["moment"] - moment == pytest.approx(-air["x_qc"] * Lc,
                                                    abs=1e-9 * np.abs(rows["moment"]).max())
    return Lc, names["a0"] * names["rho"] * names["U"] * names["b"]


def test_the_wing_is_read_at_a_place_along_the_span(tmp_path):
    """Its shape at the start is a cubic, which the elements hold exactly."""
    assert SENSORS["wing by position"].law == "the elastic axis at a place along the span"
    places = [0.0, 0.31, 2.2, 4.999, WING["length"]]
    read = [{"position": y, "quantity": q, "derivative": n, "name": f"{q}{n} {y}"}
            for y in places for q in ("w", "phi") for n in range(3)]
    (x, *at0), (v, *rates) = (bent(tmp_path, *of) for of in (BEND, TWIST))
    dt = 1e-7
    t, y = record(tmp_path, {"structure": WING, "initial": {"x": x, "v": v}, "sensors": read,
                             "time": {"dt": dt, "duration": 4 * dt}})
    for q, shape, rate in zip(("w", "phi"), at0, rates):
        for place in places:
            assert y[f"{q}0 {place}"][0] == pytest.approx(shape(place), abs=1e-12)
            assert y[f"{q}1 {place}"][0] == pytest.approx(rate(place), abs=1e-12)
            slope = np.diff(y[f"{q}1 {place}"])[1:3].mean() / dt         # about the third sample
            assert y[f"{q}2 {place}"][2] == pytest.approx(slope, rel=1e-4, abs=1e-3)


def test_a_station_reads_the_printed_lift_and_moment(tmp_path):
    assert (SENSORS["wing by station"].law
            == "what the airloads put on a station, a Gauss point of the span")
    t, rows = flown(tmp_path, AIR)
    _, _, law, names = symbols(AIR)
    Lc = names["a0"] * names["rho"] * names["U"] * names["b"] * wash(rows, names, law)
    for q, want in zip(("lift", "moment"), expected_loads(AIR, rows, Lc)):
        assert np.ptp(want) > 0.1
        assert rows[q] == pytest.approx(want, abs=1e-9 * np.abs(want).max())


def ritz(air, count=8):
    """M, C, K of polynomials over the span, of the printed T and V; the air's added at its
    stations."""
    L, series = WING["length"], np.polynomial.Legendre
    legendre, up = [series.basis(i, [0, L]) for i in range(count)], series([0.5, 0.5], [0, L])
    w, phi = [up * up * p for p in legendre], [up * p for p in legendre]
    m, x_cg = WING["mass_per_length"], WING["x_cg"]

    def over(f, g):
        return np.array([[(a * b).integ(lbnd=0)(L) for b in g] for a in f])

    second, first = [p.deriv(2) for p in w], [p.deriv() for p in phi]
    none = np.zeros((count, count))
    M = np.block([[m * over(w, w), -m * x_cg * over(w, phi)],
                  [-m * x_cg * over(phi, w), WING["I_rho"] * over(phi, phi)]])
    K = np.block([[WING["EI"] * over(second, second), none],
                  [none, WING["GJ"] * over(first, first)]])
    C = np.zeros_like(M)
    if air is None:
        return M, C, K
    _, _, law, names = symbols(air)
    steady = names["a0"] * names["rho"] * names["U"] * names["b"]
    for y, weight in zip(*stations(air["stations"])):
        rw, rp = (np.array([p(y) for p in w] + [0] * count),
                  np.array([0] * count + [p(y) for p in phi]))
        for n, matrix in enumerate((K, C, M)):
            zero = np.zeros(2 * count)
            rows = {f"{q}{k}": (r if k == n else zero) for q, r in (("w", rw), ("phi", rp))
                    for k in range(3)}
            lift, moment = expected_loads(air, rows, steady * wash(rows, names, law))
            matrix -= weight * (np.outer(rw, lift) + np.outer(rp, moment))
    return M, C, K


# so many stations that they are the integral along the span to either shape
@pytest.mark.parametrize("air", [None, AIR | {"stations": 64}], ids=["still", "stream"])
def test_a_wing_has_the_exponents_of_the_printed_energies_and_airloads(air, tmp_path):
    answer = run(tmp_path, "floquet",
                 {"structure": {**WING, "elements": 24}, "effects": [air] if air else []},
                 "-o", "hill=false")
    M, C, K = ritz(air)
    none, one = np.zeros_like(M), np.eye(len(M))
    values = eig(np.block([[none, one], [-K, -C]]), np.block([[one, none], [none, M]]), right=False)

    def lowest(of):
        return np.array(sorted((z for z in of if z.imag > 0), key=abs)[:5])
    assert lowest(complex(*z)
                  for z in answer["exponents"]) == pytest.approx(lowest(values), rel=1e-4)


def wagner(air):
    """The printed function of s, and the time that is 1 s."""
    means = next(key for key in EFFECTS["airloads"].keys if key.name == "inflow").means
    text, scale = means.split("jones: of Wagner's ")[1].split("; ")[0].split(", s = ")
    names = symbols(air)[3]
    return lambda t: evaluate(text, s=evaluate(scale, t=t, **names))


def delayed(air, t, v):
    """Duhamel's integral of the printed function, rates of v constant over a step."""
    law = wagner(air)
    middle = law((t[:-1] + t[1:]) / 2)
    return np.array([row[0] * law(t)
                     + np.concatenate([[0], np.convolve(np.diff(row), middle)[:len(t) - 1]])
                     for row in v])


def test_jones_inflow_is_the_printed_function_of_wagner(tmp_path):
    air = AIR | {"inflow": "jones"}
    t, rows = flown(tmp_path, air, duration=0.15, dt=5e-5)
    Lc, steady = circulatory(air, rows)
    v = wash(rows, symbols(air)[3], symbols(air)[2])
    want = steady * delayed(air, t, v)
    assert Lc == pytest.approx(want, abs=3e-4 * np.abs(want).max())
    assert np.abs(Lc - steady * v).max() > 0.1 * np.abs(want).max()      # it delays


@pytest.mark.parametrize("states", [6, 10])
def test_peters_inflow_of_a_section_is_near_wagners(states, tmp_path):
    """Another approximation of the same function, Jones' own within 2 % of it."""
    air = AIR | {"inflow": "peters_2d", "inflow_states": states}
    t, rows = flown(tmp_path, air, duration=0.4, dt=2e-4)
    Lc, steady = circulatory(air, rows)
    v = wash(rows, symbols(air)[3], symbols(air)[2])
    # states at 0 are 0: what v was before counts as old, what it gains is delayed
    want = steady * (delayed(air, t, v) + v[:, :1] * (1 - wagner(air)(t)))
    assert Lc == pytest.approx(want, abs=0.03 * np.abs(want).max())


def lifting_line(air, twist, terms=40):
    """Glauert's series of the wing and its mirror image: the lift of one half for angles
    twist(y)."""
    names = symbols(air)[3]
    span, theta = 2 * WING["length"], np.arange(1, terms + 1) * np.pi / (2 * terms)
    n, mu = np.arange(1, 2 * terms, 2), WING["chord"] * names["a0"] / (4 * 2 * WING["length"])
    A = np.linalg.solve(np.sin(np.outer(theta, n)) * (n * mu + np.sin(theta)[:, None]),
                        mu * twist(span / 2 * np.cos(theta)) * np.sin(theta))
    return names["rho"] * names["U"]**2 * span**2 * np.pi / 4 * A[0]


def test_peters_and_he_inflow_settles_at_the_lift_of_a_lifting_line(tmp_path):
    """A wing so heavy that it stays as it is twisted, until the inflow has settled."""
    air = AIR | {"inflow": "peters_he", "stations": 9}
    heavy = {key: WING[key] * 1e9 for key in ("mass_per_length", "I_rho")} | {"EI": 1.0, "GJ": 1.0}
    x = bent(tmp_path, (0, 0), (0.01, 0, 0))[0]
    still = {"structure": {**WING, **heavy},
             "effects": [air], "initial": {"x": x}, "time": {"dt": 0.5, "duration": 20},
             "sensors": [{"station": s, "quantity": "lift"} for s in range(9)]}
    t, y = record(tmp_path, still)
    lift = sum(weight * y[f"lift_{s}"] for s, weight in enumerate(stations()[1]))
    want = lifting_line(air, lambda y: 0.01 * y)
    assert lift[0] > 1.3 * want                                          # before any inflow
    assert lift[-1] == pytest.approx(want, rel=0.02)


INFLOW = {"none", "jones", "peters_2d", "peters_he"}                     # checked above


def test_no_sensor_and_no_inflow_of_the_page_is_without_a_check():
    assert set(SENSORS) == {"any by dof", "shaft by dof", "wing by station", "wing by position"}
    inflow = next(key for key in EFFECTS["airloads"].keys if key.name == "inflow")
    assert set(inflow.words) == INFLOW
