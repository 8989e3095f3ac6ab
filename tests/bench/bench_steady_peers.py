"""Swept responses with one friction element beside NLvib under Octave, where $NLVIB holds its
folder and octave-cli is there.

One JSON line a figure; `ratio` is the peer's processor time a point over ours, starts and parsing
left out on both sides.  Amplitudes must agree: NLvib samples the force, so that turns between
samples cost it about (2 pi / N)^2.
"""
import json, os, shutil, subprocess, sys, tempfile

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


def main():
    if not os.environ.get("NLVIB") or shutil.which("octave-cli") is None:
        print("bench_steady_peers: no $NLVIB or no octave-cli: left out", file=sys.stderr)
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


main()
