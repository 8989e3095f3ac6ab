#!/usr/bin/python3
"""How the cost of a motion under tones grows: with dofs, and from two tones to three.

    MODALCTL=build/bin/modalctl tests/bench/bench_tones_size.py [most dofs] [law ..]

Chains of 2, 4, 8 .. masses, a law to the ground at each, loads of each tone along all of it, tones
of ratio golden and sqrt 2, 1e-4 asked for (friction, gap) and 1e-6 (cubic).  A row: dofs, tones,
CPU, that over half as many dofs', units of work, what found it, the stated error of a line over the
motion.
"""
import json
import os
import pathlib
import subprocess
import sys
import tempfile

CTL = os.environ.get("MODALCTL", "modalctl")
TONES = [0.8, 0.8 * (1 + 5 ** 0.5) / 2, 0.8 * 2 ** 0.5]
LAWS = {"cubic": ({"type": "cubic_spring", "coefficient": 0.3}, 1e-6),
        "friction": ({"type": "friction", "stiffness": 0.5, "limit": 0.12}, 1e-4),
        "gap": ({"type": "gap", "stiffness": 2, "clearance": 0.2}, 1e-4)}


def chain(n, tones, effect):
    dofs = [f"x{i + 1}" for i in range(n)]
    loads = [{"dof": dofs[i], "k": [int(a == j) for a in range(tones)],
              "cos": 0.15 + 0.05 * ((i + j) % 3)} for i in range(n) for j in range(tones)]
    springs, dampers = [0.4] + [1] * (n - 1) + [0], [0.3] + [0.05] * (n - 1) + [0.2]
    return {"structure": {"type": "chain", "masses": [1] * n, "springs": springs,
                          "dampers": dampers},
            "effects": [{**effect, "dof": dof} for dof in dofs],
            "excitation": loads, "steady": {"tones": TONES[:tones]}}


def answer(scene, target, folder):
    path = pathlib.Path(folder) / "scene.json"
    path.write_text(json.dumps(scene))
    done = subprocess.run([CTL, "--local", "--json", "steady", path, "-o",
                           f"target.error={target}"], capture_output=True, text=True)
    return json.loads(done.stdout)


def largest(result):
    """The largest sum of one dof's lines: a bound of the motion that needs no record of it."""
    return max(sum(abs(complex(re, im)) for re, im in zip(row["re"], row["im"]))
               for row in result["harmonics"])


def row_of(n, tones, effect, target, before, folder):
    """One row, printed; its CPU."""
    result = answer(chain(n, tones, effect), target, folder)
    if "error" in result:
        print(f"{n:5d} {tones}  {result['error']['message']}", flush=True)
        return None
    cpu, codes = result["cost"]["cpu_s"], [d["code"] for d in result["diagnostics"]]
    grown = f"{cpu / before:5.2f}" if before else "     "
    line = f"{result['line_error'] / largest(result):.1e}" if result["converged"] else "-"
    print(f"{n:5d} {tones} {cpu:8.3f} s {grown} {result['work']['spent']:9.2e}"
          f" {result['method']:7s} {line} {' '.join(codes)}", flush=True)
    return cpu


def main():
    most = int(sys.argv[1]) if len(sys.argv) > 1 else 128
    with tempfile.TemporaryDirectory() as folder:
        for law in sys.argv[2:] or LAWS:
            for tones in (2, 3):
                print(law, "under", tones, "tones")
                n, before = 2, None
                while n <= most:
                    before = row_of(n, tones, *LAWS[law], before, folder)
                    n *= 2


if __name__ == "__main__":
    main()
