"""Points of curves over a law's number, and over omega, on membranes given by sparse matrices, ten
cubic springs on them, through a daemon of its own: processor time of a point after the first,
beside one sparse factorization of the linear part by scipy.

One JSON line a figure; `ratio` is the factorization's time over the point's.  A point's time is the
solve stage of six points less that of two, over four; lowering, the same for every scene, is told
apart.  A point must be what its scene has alone, to 1e-9, before a figure is told.  Over omega it
is the solve stage of forty points less that of twenty in the same band, over twenty, and to 1e-8;
and that of the twenty, the first too, over their number; both with errors and all.
The sides of the membranes are the arguments, 100 and 316 without any.
"""
import sys
import time

import modald
import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as sl

OMEGA, CONTACTS = 0.31, 10
SLOW, BAND, POINTS = 3.0, 1.2, 20     # omega over pi / side, its range, and the points in it
PATH, FROM, TO = "effects[0].coefficient", 0.3, 0.4


def membrane(side):
    along = sp.diags([np.full(side, 2.0), -np.ones(side - 1), -np.ones(side - 1)], [0, 1, -1])
    random = np.random.RandomState(7)
    K = (sp.kron(sp.eye(side), along) + sp.kron(along, sp.eye(side))).tocsr()
    M = sp.diags(1 + 0.3 * random.rand(side * side)).tocsr()
    return M, K, 0.02 * K + 0.01 * M, random.permutation(side * side)[:CONTACTS + 1]


def scene_of(M, K, C, dofs):
    return {"structure": {"type": "matrices", "M": M, "K": K, "C": C}, "omega": OMEGA,
            "effects": [{"type": "cubic_spring", "dof": f"x{dof + 1}", "coefficient": TO}
                        for dof in dofs[1:]],
            "excitation": [{"dof": f"x{dofs[0] + 1}", "k": 1, "cos": 3.0}],
            "steady": {"harmonics": 3, "stability": False}}


def over_omega(client, scene, side):
    """Seconds a point of a curve over omega, after the first and of all; None where its last is
    not what it is alone."""
    slow = SLOW * np.pi / side
    curves = [client.steady(scene, {"sweep": f"omega={slow}:{BAND * slow}:{n}"})
              for n in (POINTS, 2 * POINTS)]
    alone = client.steady({**scene, "omega": BAND * slow})
    few, many = [curve["cost"]["stages"]["solve"] / POINTS for curve in curves]
    return (many - few, few) if all(same(c["points"][-1], alone, 1e-8) for c in curves) else None


def same(point, alone, within=1e-9):
    a, b = [np.array([[row["re"], row["im"]] for row in of["harmonics"]]) for of in (point, alone)]
    return abs(a - b).max() < within * abs(b).max()


def figure(case, value, peer, n):
    print(modald.wire.dumps({"bench": "sparse", "case": case, "value": round(value, 4), "unit": "s",
                             "peer": "one scipy splu", "ratio": round(peer / value, 3),
                             "n": n}).decode(), flush=True)


def main():
    sides = [int(word) for word in sys.argv[1:]] or [100, 316]
    with modald.local() as client:
        for side in sides:
            M, K, C, dofs = membrane(side)
            scene = scene_of(M, K, C, dofs)
            L = sp.csc_matrix(K + 1j * OMEGA * C - OMEGA**2 * M)
            begun = time.process_time()
            sl.splu(L)
            factored = time.process_time() - begun
            two, six = [client.steady(scene, {"sweep": f"{PATH}={FROM}:{TO}:{n}"}) for n in (2, 6)]
            if not same(six["points"][-1], client.steady(scene)):
                print(f"bench_sparse: {side} x {side} moves otherwise", file=sys.stderr)
                continue
            for stage, case in (("solve", "a point after the first"), ("lower", "its lowering")):
                spent = (six["cost"]["stages"][stage] - two["cost"]["stages"][stage]) / 4
                figure(f"steady, membrane, {case}", max(spent, 1e-6), factored, side * side)
            figure("steady, membrane, the first two points", two["cost"]["stages"]["solve"],
                   factored, side * side)
            spent = over_omega(client, scene, side)
            if spent is None:
                print(f"bench_sparse: {side} x {side} moves otherwise over omega", file=sys.stderr)
            else:
                figure("steady, membrane, a point over omega after the first", max(spent[0], 1e-6),
                       factored, side * side)
                figure("steady, membrane, a point over omega", spent[1], factored, side * side)


if __name__ == "__main__":
    main()
