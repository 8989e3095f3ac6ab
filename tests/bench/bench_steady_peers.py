"""Swept responses with one friction element, and nonlinear modes and responses of NLvib's examples
05, 06, 08 and 09, beside NLvib under Octave, where $NLVIB holds its folder and octave-cli is there.

One JSON line a figure; `ratio` is the peer's processor time a point over ours, starts and parsing
left out on both sides.  Amplitudes must agree: NLvib samples the force, so that turns between
samples cost it about (2 pi / N)^2.  Of the examples each point of the peer lies on our curve,
which cubic splines join: `far` is the farthest, relative.
"""
import json, os, shutil, subprocess, sys, tempfile
import numpy as np
import scipy.interpolate
import scipy.io

HERE = os.path.dirname(os.path.abspath(__file__))
MODALCTL = os.path.join(os.environ.get("MODALD_BUILD", "build"), "bin", "modalctl")


def friction(dof, stiffness, limit):
    return {"type": "friction", "dof": dof, "stiffness": stiffness, "limit": limit}


def cantilever(dofs):
    tip = f"w{dofs // 2}"
    return {"structure": {"type": "beam", "length": 1, "elements": dofs // 2, "EI": 1,
                          "mass_per_length": 1, "supports": ["clamped", "free"]},
            "omega": 3.4, "effects": [{"type": "rayleigh_damping", "alpha": 0.02, "beta": 0.0005},
                                      friction(tip, 5, 0.5)],
            "excitation": [{"dof": tip, "k": 1, "cos": 0.3}],
            "steady": {"harmonics": 5, "samples": 128, "stability": False}}


SDOF = {"structure": {"type": "matrices", "M": [[1]], "C": [[0.02]], "K": [[1]]}, "omega": 1.1,
        "effects": [friction("x1", 1, 1)],
        "excitation": [{"dof": "x1", "k": 1, "cos": 1}],
        "steady": {"harmonics": 7, "samples": 256, "stability": False}}
CASES = {"sdof": (SDOF, "x1", "1.1:1.6:51", 256)}
CASES.update({f"cantilever{n}": (cantilever(n), f"w{n // 2}", "3.4:5:21", 128)
              for n in (10, 20, 40)})


def ours(scene, dof, sweep):
    """Milliseconds a point, the median of three runs, and |X_1| of DOF."""
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "scene.json")
        with open(path, "w") as f:
            json.dump(scene, f)
        runs = [json.loads(subprocess.run([MODALCTL, "--local", "--json", "steady", path,
                                           "--sweep", f"omega={sweep}"], capture_output=True,
                                          text=True, check=True).stdout) for _ in range(3)]
    points = runs[0]["points"]
    assert all(p["converged"] for p in points)
    ms = sorted(1e3 * r["cost"]["stages"]["solve"] / len(points) for r in runs)[1]
    spectra = [next(h for h in p["harmonics"] if h["dof"] == dof) for p in points]
    return ms, [abs(complex(h["re"][h["k"].index(1)], h["im"][h["k"].index(1)])) for h in spectra]


def coupling(a, b):
    """A mass on two springs of squared frequencies A, B at large deflections."""
    c = (a + b) / 2
    for on, rows in (("x1", ((1.5 * a, 2, 0), (b, 1, 1), (a / 2, 0, 2), (c, 3, 0), (c, 1, 2))),
                     ("x2", ((b / 2, 2, 0), (a, 1, 1), (1.5 * b, 0, 2), (c, 2, 1), (c, 0, 3)))):
        for size, p, q in rows:
            yield {"coefficient": size, "on": on,
                   "powers": {d: n for d, n in (("x1", p), ("x2", q)) if n}}


def matrices(M, C, K, effects, **more):
    return {"structure": {"type": "matrices", "M": M, "C": C, "K": K}, "omega": 1,
            "effects": effects, **more}


def examples(folder):
    """Of each: scene, options, and the dof seen, none of a mode."""
    rounded = matrices([[0.02, 0], [0, 1]], [[0, 0], [0, 0]], [[40, -40], [-40, 640]],
                       [{"type": "regularised_coulomb", "dof": "x1", "limit": 5,
                         "velocity": 0.05}])
    yield "05", rounded, ["backbone=1:0.0316227766:10", "harmonics=21", "samples=1024"], None
    terms = [{"type": "polynomial_coupling", "terms": list(coupling(1.13 ** 2, 4.0))}]
    springs = matrices([[1, 0], [0, 1]], [[2e-3 * 1.13, 0], [0, 2e-2]], [[1.13 ** 2, 0], [0, 4]],
                       terms)
    yield "06", springs, ["backbone=1:1e-3:0.71", "harmonics=7", "samples=64"], None
    for level in (3e-4, 5e-4, 1e-3, 3e-3):
        loads = [{"dof": dof, "k": 1, "cos": level} for dof in ("x1", "x2")]
        yield (f"06_{level:g}", {**springs, "omega": 1.6, "excitation": loads},
               ["continue=omega=1.6:0.8", "harmonics=7", "samples=64"], "x1")
    beam = scipy.io.loadmat(os.path.join(folder, "EXAMPLES", "08_beam_tanhDryFriction",
                                         "beam.mat"))
    M, D, K = (beam[name].tolist() for name in "MDK")
    at, tip = (f"x{int(np.flatnonzero(beam[name])[0]) + 1}" for name in ("W", "Fex1"))
    yield ("08", matrices(M, D, K, [{"type": "regularised_coulomb", "dof": at, "limit": 1.5,
                                     "velocity": 6e-7}],
                          excitation=[{"dof": tip, "k": 1, "cos": float(beam["Fex1"].max())}]),
           ["continue=omega=370:110", "harmonics=7", "samples=128"], tip)
    side = 0.014
    yield ("09", {"structure": {"type": "beam", "length": 0.7, "elements": 19,
                                "EI": 2.05e11 * side ** 4 / 12, "mass_per_length": 7800 * side ** 2,
                                "supports": ["clamped", "free"]}, "omega": 1,
                  "effects": [{"type": "cubic_spring", "dof": "w19", "coefficient": 6e9}]},
           ["backbone=1:3.9e-4:5.1e-4", "harmonics=5", "samples=64"], None)


def points_of(name, scene, options, seen):
    """Milliseconds a point; of each amplitude, omega, damping ratio of a mode, where the amplitude
    is that of all harmonics as NLvib counts it; or omega, |X_1| of SEEN."""
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "scene.json")
        with open(path, "w") as f:
            json.dump({**scene, "steady": {"stability": False}} if seen else scene, f)
        words = [w for o in options for w in ("-o", o)]
        answer = json.loads(subprocess.run([MODALCTL, "--local", "--json", "steady", path, *words],
                                           capture_output=True, text=True, check=True).stdout)
    points = [p for p in answer["points"] if p["converged"]]
    assert len(points) > 0.98 * len(answer["points"]), name
    ms, rows = 1e3 * answer["cost"]["stages"]["solve"] / len(points), []
    for p in points:
        X = {h["dof"]: np.array(h["re"]) + 1j * np.array(h["im"]) for h in p["harmonics"]}
        if seen:
            rows.append((p["omega"], abs(X[seen][1]), 0))
            continue
        X = np.array(list(X.values()))
        mass = np.array(scene["structure"]["M"]) if "M" in scene["structure"] else beam_mass(scene)
        square = np.einsum("ik,ij,jk", X.conj(), mass, X).real
        rows.append((np.sqrt(square), p["omega"], p["damping_ratio"]))
    return ms, np.array(rows)


def beam_mass(scene):
    s = scene["structure"]
    l, n = s["length"] / s["elements"], s["elements"]
    m = s["mass_per_length"] * l / 420 * np.array(
        [[156, 22 * l, 54, -13 * l], [22 * l, 4 * l * l, 13 * l, -3 * l * l],
         [54, 13 * l, 156, -22 * l], [-13 * l, -3 * l * l, -22 * l, 4 * l * l]])
    M = np.zeros((2 * n + 2, 2 * n + 2))
    for e in range(n):
        M[2 * e:2 * e + 4, 2 * e:2 * e + 4] += m
    return M[2:, 2:]


def far(ours, theirs):
    """The farthest of THEIRS from the curve through OURS; each column in units of its range."""
    size = np.ptp(ours, axis=0) + 1e-300
    size[2] = max(size[2], 1e-3)
    x, y = ours / size, theirs / size
    x = x[np.append(True, np.abs(np.diff(x, axis=0)).max(axis=1) > 1e-12)]
    s = np.append(0, np.cumsum(np.linalg.norm(np.diff(x, axis=0), axis=1)))
    fine = scipy.interpolate.CubicSpline(s, x)(np.linspace(0, s[-1], 200000))
    y = y[(y[:, 0] >= x[:, 0].min()) & (y[:, 0] <= x[:, 0].max())]
    return max(np.linalg.norm(fine - p, axis=1).min() for p in y), len(y)


def run_examples(folder):
    out = subprocess.run(["octave-cli", "--norc", "-q", os.path.join(HERE, "nlvib_modes.m")],
                         capture_output=True, text=True).stdout
    peers = {line.split()[0]: [float(v) for v in line.split()[1:]] for line in out.splitlines()}
    for name, scene, options, seen in examples(folder):
        ms, mine = points_of(name, scene, options, seen)
        if name not in peers:
            print(f"bench_steady_peers: example {name} ended in Octave", file=sys.stderr)
            continue
        away, n = far(mine, np.array(peers[name][1:]).reshape(-1, 3))
        print(json.dumps({"bench": "steady", "case": f"NLvib's example {name}, a point of the "
                          + ("response" if seen else "mode"), "value": ms, "unit": "ms/point",
                          "peer": "NLvib under Octave", "ratio": peers[name][0] / ms,
                          "n": n, "far": away}), flush=True)


def missing():
    """What of the peer is not here; nothing where all is."""
    folder = os.environ.get("NLVIB")
    if not folder:
        return "$NLVIB is not set; it names the folder that holds NLvib's SRC and EXAMPLES"
    for name in ("SRC", "EXAMPLES"):
        if not os.path.isdir(os.path.join(folder, name)):
            return f"$NLVIB is {folder}, which holds no folder {name}"
    return "there is no octave-cli" if shutil.which("octave-cli") is None else ""


def main():
    if missing():
        print(f"bench_steady_peers: left out: {missing()}", file=sys.stderr)
        return
    out = subprocess.run(["octave-cli", "--norc", "-q", os.path.join(HERE, "nlvib_path.m")],
                         capture_output=True, text=True).stdout
    peers = {line.split()[0]: [float(v) for v in line.split()[1:]] for line in out.splitlines()}
    for name, (scene, dof, sweep, samples) in CASES.items():
        ms, amplitude = ours(scene, dof, sweep)
        theirs = peers[name]
        far = max(abs(a - b) / b for a, b in zip(amplitude, theirs[1:], strict=True))
        assert far < 20 * (6.2832 / samples) ** 2, f"{name}: amplitudes differ by {far}"
        print(json.dumps({"bench": "steady", "case": f"{name} friction, a swept point, "
                                                     f"H={scene['steady']['harmonics']} "
                                                     f"N={samples}", "value": ms,
                          "unit": "ms/point", "peer": "NLvib under Octave", "ratio": theirs[0] / ms,
                          "n": len(amplitude)}), flush=True)
    run_examples(os.environ["NLVIB"])


main()
