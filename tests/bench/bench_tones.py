#!/usr/bin/python3
"""Random scenes under two and three tones: answers against a march, those that are wrong or late.

    MODALCTL=build/bin/modalctl tests/bench/bench_tones.py [count] [seed] [only]

Each scene: 1 to 4 masses (one in eight free), 1 to 3 laws (cubic, gap, slider, x^2 x' and tanh
dampers), tones of ratio golden, sqrt 2, 1.01, p/q, at resonance, 1e-9 apart, one a thousandth of
the other, or anything; one in five loads is 0; kilogram, second and metre scaled by up to 1e8.
The reference begins where the answer is at 0, sliders having followed it, and marches on
(march_tones.c): what it leaves the answer by is over its stated error where that is wrong, or where
the motion is unstable.
"""
import json
import math
import os
import pathlib
import subprocess
import sys
import tempfile
import time
import numpy as np

CTL = os.environ.get("MODALCTL", "modalctl")
HERE = pathlib.Path(__file__).parent
KINDS = ["cubic_spring", "gap", "friction", "polynomial_damper", "regularised_coulomb"]
LATE = 5                  # s
BEFORE, AFTER = 100, 100  # turns of the fastest tone: what sliders follow, what is compared
HIGHEST = 4e6             # steps of a march
OWN = 1e-6                # of the amplitude: its error
EPSILON = 2.0 ** -52      # of a number: what a march's sums and the phases of lines are rounded by


def build(folder):
    binary = pathlib.Path(folder) / "march"
    subprocess.run(["cc", "-O2", "-o", binary, HERE / "march_tones.c", "-lm"], check=True)
    return binary


def random_tones(rng, modes, pathological):
    first = math.exp(rng.uniform(math.log(0.3 * modes[0]), math.log(1.5 * modes[-1])))
    ratio = rng.choice(["golden", "root", "near", "small", "any", "resonance"])
    ratio = {"golden": (1 + 5 ** 0.5) / 2, "root": 2 ** 0.5, "near": 1.01,
             "small": rng.integers(2, 6) / rng.integers(1, 4), "any": rng.uniform(1.05, 3),
             "resonance": rng.choice(modes) / first}[str(ratio)]
    if pathological == "twins":
        ratio = 1 + 10 ** rng.uniform(-9, -4)
    if pathological == "slow":
        ratio = 1e-3 * math.sqrt(2)
    tones = [first, first * ratio * (1 if ratio != 1 else 1.1)]
    if pathological == "three":
        tones.append(first * math.sqrt(3))
    return tones


def random_scene(seed):
    rng = np.random.default_rng([20, seed])
    n = int(rng.integers(1, 5))
    free = n > 1 and rng.random() < 0.125
    m = 10 ** rng.uniform(-0.5, 0.5, n)
    k = 10 ** rng.uniform(-0.5, 0.7, n + 1)
    k[-1] = 0
    if free:
        k[0] = 0
    K = np.diag(k[:-1] + k[1:]) - np.diag(k[1:-1], 1) - np.diag(k[1:-1], -1)
    w2 = np.linalg.eigvals(K / m[:, None]).real
    modes = np.sqrt(np.sort(w2[w2 > 1e-9]))
    C = 2 * 10 ** rng.uniform(-2, -0.8) * (0.5 * K / modes[-1] + 0.5 * modes[0] * np.diag(m))
    pathological = rng.choice(["", "", "", "", "twins", "slow", "three"])
    tones = random_tones(rng, modes, pathological)
    force = k.max() * 10 ** rng.uniform(-1.5, 0)
    loads = [[int(rng.integers(n)), [int(i == j) for i in range(len(tones))],
              force * rng.uniform(0.3, 1) * (rng.random() > 0.2 * (j > 0)),
              force * rng.uniform(-1, 1) * (rng.random() > 0.5)] for j in range(len(tones))]
    loads[1][2:] = [0, 0] if rng.random() < 0.1 else loads[1][2:]
    size = force / k.max() * 3                       # of a motion, about
    laws = []
    for _ in range(int(rng.integers(1, 4))):
        kind, at = int(rng.choice(5, p=[.25, .25, .3, .1, .1])), int(rng.integers(n))
        to = int(rng.integers(-1, n)) if rng.random() < 0.5 else -1
        to = -1 if to == at else to
        stiff, damp = k.max() * 10 ** rng.uniform(-1, 0.7), modes[0] * m[at]
        p, q = {0: (stiff / size ** 2 * 10 ** rng.uniform(-1, 0), 0),
                1: (stiff, size * rng.uniform(-0.1, 0.7)),
                2: (stiff, force * 10 ** rng.uniform(-1.5, 0.3)),
                3: (damp / size ** 2 * 10 ** rng.uniform(-2, 0), 0),
                4: (force * 10 ** rng.uniform(-2, -0.3), size * modes[0] * rng.uniform(.1, 1))
                }[kind]
        laws.append([kind, at, to, p, q])
    kg, s, metre = 10.0 ** rng.uniform(-8, 8, 3) if rng.random() < 0.3 else (1, 1, 1)
    newton = kg * metre / s ** 2
    M, C, K = np.diag(m) * kg, C * kg / s, K * kg / s ** 2
    for law in laws:
        units = [(newton / metre ** 3, 1), (newton / metre, metre), (newton / metre, newton),
                 (newton * s / metre ** 3, 1), (newton, metre / s)][law[0]]
        law[3], law[4] = law[3] * units[0], law[4] * units[1]
    for load in loads:
        load[2], load[3] = load[2] * newton, load[3] * newton
    return dict(n=n, M=M, C=C, K=K, laws=laws, loads=loads, tones=[w / s for w in tones],
                free=free, pathological=str(pathological))


def scene_of(a):
    dofs = [f"x{i}" for i in range(a["n"])]
    names = [("coefficient",), ("stiffness", "clearance"), ("stiffness", "limit"),
             ("coefficients",), ("limit", "velocity")]
    effects = []
    for kind, at, to, p, q in a["laws"]:
        e = {"type": KINDS[kind], "dof": dofs[at], "to": dofs[to] if to >= 0 else "ground",
             **dict(zip(names[kind], (p, q)))}
        if kind == 3:
            e["coefficients"] = [0, 0, p]
        effects.append(e)
    return {"structure": {"type": "matrices", "M": a["M"].tolist(), "C": a["C"].tolist(),
                          "K": a["K"].tolist(), "dofs": dofs},
            "effects": effects, "steady": {"tones": a["tones"]},
            "excitation": [{"dof": dofs[i], "k": k, "cos": c, "sin": s}
                           for i, k, c, s in a["loads"]]}


def answer(scene, folder, *options):
    path = pathlib.Path(folder) / "scene.json"
    path.write_text(json.dumps(scene))
    begun = time.time()
    done = subprocess.run([CTL, "--local", "--json", "steady", path, *options],
                          capture_output=True, text=True)
    return json.loads(done.stdout), done.returncode, time.time() - begun


def record(a, march, steps, turns, per):
    """x [sample][dof] from rest, STEPS a turn of the fastest tone, PER of them."""
    numbers = [a["n"], *a["M"].ravel(), *a["C"].ravel(), *a["K"].ravel(), len(a["laws"])]
    for law in a["laws"]:
        numbers += law
    numbers.append(len(a["loads"]))
    for i, k, c, s in a["loads"]:
        numbers += [i, float(np.dot(k, a["tones"])), c, s]
    numbers += [0, 2 * math.pi / max(a["tones"]) / steps, 0, steps * turns, steps // per]
    out = subprocess.run([march], input="\n".join(repr(float(v)) for v in numbers).encode(),
                         capture_output=True, check=True).stdout
    return np.frombuffer(out).reshape(-1, a["n"] + 1)[:, 1:]


def lines_of(result):
    rows = result["harmonics"]
    w = np.array(rows[0]["k"]) @ np.array(result["tones"])
    return w, np.array([r["re"] for r in rows]) + 1j * np.array([r["im"] for r in rows])


def turns_to_settle(a, result):
    """Twice as many as the slowest disturbance takes to a thousandth, of which the second half is
    looked at: what the march begins with is as rough as the rates of the lines told, and sliders
    that follow many lines for a part of a beat only begin where that part leaves them."""
    slowest = max(result["stability"]["exponents"], default=0)
    turns = 2 * math.log(1e3) / -slowest * max(a["tones"]) / (2 * math.pi) if slowest < 0 else 0
    return int(min(max(4 * AFTER, turns), 40 * AFTER))


def leaves(a, result, march, finer=1, after=AFTER, highest=HIGHEST):
    """max |x - march| over the second half of AFTER turns, the largest motion, and the part of it
    that rounding alone may come to: of as many sums, at random, and of phases."""
    w, X = lines_of(result)
    keep = np.argsort(-np.abs(X).max(0))[:8000]
    fastest = max(max(a["tones"]), math.sqrt(np.linalg.eigvals(
        np.linalg.solve(a["M"], a["K"])).real.max()) / 2)
    stiff = max([law[3] for law in a["laws"] if law[0] in (1, 2)] or [0])
    fastest = max(fastest, math.sqrt(stiff / a["M"].diagonal().min()) / 2)
    turn = 2 * math.pi / max(a["tones"])
    per = int(400 * finer * max(1, fastest / max(a["tones"])))
    steps = int(min(after * per, highest))
    h = turn / per
    numbers = [a["n"], *a["M"].ravel(), *a["C"].ravel(), *a["K"].ravel(), len(a["laws"])]
    for law in a["laws"]:
        numbers += law
    numbers.append(len(a["loads"]))
    for i, k, c, s in a["loads"]:
        numbers += [i, float(np.dot(k, a["tones"])), c, s]
    numbers.append(len(keep))
    for m in keep:
        numbers += [w[m], *[f(x) for x in X[:, m] for f in (np.real, np.imag)]]
    before = int(min(BEFORE * per, 2e8 / len(keep) / per * 20))
    every = max(1, steps // 2000)
    numbers += [h, before if any(law[0] == 2 for law in a["laws"]) else 0, steps, every]
    out = subprocess.run([march], input="\n".join(repr(float(v)) for v in numbers).encode(),
                         capture_output=True, check=True).stdout
    rows = np.frombuffer(out).reshape(-1, a["n"] + 1)
    told = (np.exp(1j * np.outer(rows[:, 0], w)) @ X.T).real
    settled = rows[:, 0] > rows[-1, 0] / 2          # the rates of a march's lines are rougher
    off = rows[settled, 1:] - told[settled]
    if "undetermined_mean" in [d["code"] for d in result["diagnostics"]]:
        off -= off.mean(0)                          # it follows from history
    rounding = EPSILON * (math.sqrt(steps) + w.max() * rows[-1, 0])
    return np.abs(off).max(), np.abs(told).max(), rounding


def judge(seed, folder, march):
    a = random_scene(seed)
    result, status, took = answer(scene_of(a), folder)
    said = dict(seed=seed, n=a["n"], laws="".join("cgfdt"[law[0]] for law in a["laws"]),
                free=a["free"], what=a["pathological"], took=took, status=status)
    if "error" in result:
        return dict(said, verdict="refused", message=result["error"]["message"])
    said.update(method=result["method"], lines=len(result["harmonics"][0]["k"]),
                cpu=result["cost"]["cpu_s"],
                codes=[d["code"] for d in result["diagnostics"]])
    if not result["converged"]:
        return dict(said, verdict="none", message=result["diagnostics"][0]["message"])
    off, most, rounding = leaves(a, result, march)
    stated = result["total_error"]
    if off > 3 * stated:                             # the reference's own error is a part of it
        # a slider that alone holds a body has its place moved by a march's own error, turn by
        # turn: of the long ones none may be as rough as the first
        for finer, after in ((16, AFTER), (4, turns_to_settle(a, result)), (16, 4 * AFTER)):
            again = leaves(a, result, march, finer, after, 4 * HIGHEST)
            off, rounding = (again[0], again[2]) if again[0] < off else (off, rounding)
    said.update(true=off / most if most > 0 else off, stated=stated / most if most > 0 else stated,
                stable=result["stability"]["stable"], rounding=rounding)
    limit = 3 * stated + OWN * most
    said["verdict"] = "right" if off <= limit else "wrong"
    if said["verdict"] == "wrong" and said["stable"] is False:
        said["verdict"] = "unstable"
    return said


def print_errors(said):
    """Of right answers whose true error rounding does not explain: how it stands to the stated."""
    told = [(s["true"], s["stated"]) for s in said
            if s["verdict"] in ("right", "wrong") and s["true"] > s["rounding"]]
    if told:
        true, stated = np.array(told).T
        print(f"of {len(told)} (of {sum('true' in s for s in said)}; the others are rounding or "
              f"unstable) true <= 3 stated: {np.mean(true <= 3 * stated):.3f}, median stated / "
              f"true: {np.median(stated / true):.3g}")


def main():
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 300
    first = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    tally, all_said = {}, []
    with tempfile.TemporaryDirectory() as folder:
        march = build(folder)
        for seed in range(first, first + count):
            said = judge(seed, folder, march)
            all_said.append(said)
            tally.setdefault(said["verdict"], []).append(seed)
            late = said.get("cpu", said["took"]) > LATE
            if late:
                tally.setdefault("late", []).append(seed)
            if "-v" in sys.argv or late or said["verdict"] != "right":
                print({k: float(f"{v:.3g}") if isinstance(v, float) else v
                       for k, v in said.items()}, flush=True)
    print({k: (len(v), v if k != "right" else "") for k, v in tally.items()})
    print_errors(all_said)


if __name__ == "__main__":
    main()
