#!/usr/bin/python3
"""Error against processor time of one rod with ten gaps on its length, as finer and finer chains:
`tradeoff steady`, whose rungs are harmonics, a Krylov basis' tolerance, modes of a reduction, a
cutoff of each dof's harmonics and forces by samples whose events are not located. JSON lines.

The numbers of dofs are the arguments, 100 to 100,000 without any; SVG=FILE draws them.
"""
import json
import os
import subprocess
import sys
import tempfile

MODALCTL = os.environ.get("MODALCTL", "build/bin/modalctl")
SECONDS, GAPS = 20, 10
# by the first of them that a rung has
KINDS = ("krylov", "reduce", "cutoff", "samples", "harmonics")
MARKS = dict(zip(KINDS, ("s:", "v:", "^:", "x", "o-")))   # samples grow beside harmonics


def rod(n):
    """Of unit length, mass and wave speed, held at one end, driven between two resonances."""
    at = [1 + round((n - 1) * (i + 0.5) / GAPS) for i in range(GAPS)]
    return {"structure": {"type": "chain", "masses": [1 / n] * n, "springs": [n] * n + [0],
                          "dampers": [0.003 * n] * n + [0]}, "omega": 7.0,
            "effects": [{"type": "gap", "dof": f"x{dof}", "stiffness": 5.0, "clearance": 0.05}
                        for dof in at],
            "excitation": [{"dof": f"x{at[-1]}", "k": 1, "cos": 1.5}]}


def rungs(n, folder):
    path = os.path.join(folder, "rod.json")
    with open(path, "w") as file:
        json.dump(rod(n), file)
    answer = subprocess.run([MODALCTL, "--local", "--json", "tradeoff", "steady", path, "-o",
                             "repetitions=1", "-o", f"target.seconds={SECONDS}"],
                            capture_output=True, check=True).stdout
    return [r for r in json.loads(answer)["rungs"] if r["error"]]


def draw(found, path):
    import matplotlib
    matplotlib.use("svg")
    matplotlib.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "rod"})
    import matplotlib.pyplot as plt
    fig, ax = plt.subplots(figsize=(6.4, 4.4))
    for n, all_of in found.items():
        color = None
        for kind in reversed(KINDS):
            of = [r for r in all_of if kind == next(k for k in KINDS if k in r["settings"])]
            line = ax.loglog([r["seconds"] for r in of], [r["error"] for r in of], MARKS[kind],
                             color=color, markersize=4, linewidth=1,
                             label=f"{n:,} dofs" if kind == "harmonics" else None)
            color = line[0].get_color()
    for kind in KINDS:
        ax.plot([], [], "k" + MARKS[kind][0], markersize=4, label=kind)
    ax.set_xlabel("CPU, s")
    ax.set_ylabel("error over the largest motion")
    # above the axes: no corner is free of points
    ax.legend(fontsize=7, ncol=5, loc="lower center", bbox_to_anchor=(0.5, 1))
    fig.tight_layout()
    fig.savefig(path, metadata={"Date": None})


def main():
    words = [word for word in sys.argv[1:] if not word.startswith("SVG=")]
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        for n in [int(word) for word in words] or [100, 1000, 10000, 100000]:
            found[n] = rungs(n, folder)
            for r in found[n]:
                print(json.dumps({"bench": "tradeoff_sizes", "case": str(r["settings"]), "n": n,
                                  "value": round(r["seconds"], 4), "unit": "s", "peer": "none",
                                  "ratio": None, "error": r["error"]}), flush=True)
    for word in sys.argv[1:]:
        if word.startswith("SVG="):
            draw(found, word[4:])


if __name__ == "__main__":
    main()
