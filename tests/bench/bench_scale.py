"""Steady states and motions of chains with a law at every dof: beside a plain Newton iteration with
load steps on scipy's sparse LU, and beside scipy's DOP853 to 1e-9 (cubic) or Runge-Kutta steps of
0.02 s in numpy (gap, friction).  Multipliers of a chain with one pulsating spring: beside the whole
spectrum of a map that numpy steps, and of many dofs beside ARPACK on such a map.

One JSON line a figure; `ratio` is the peer's processor time over ours.  Ours is all of `modalctl
--local`, errors included, without stability; the peer's the iteration alone, without errors.
Amplitudes at the loaded dof must agree before a figure is told.
"""
import json, math, os, resource, subprocess, sys, tempfile, time
import h5py
import numpy as np
import scipy.integrate
import scipy.sparse as sp
import scipy.sparse.linalg as sl

MODALCTL = os.path.join(os.environ.get("MODALD_BUILD", "build"), "bin", "modalctl")
OMEGA, LOAD, DAMPING, H = 0.3, 0.5, 0.05, 7
LAWS = {"cubic": {"type": "cubic_spring", "coefficient": 0.1},
        "gap": {"type": "gap", "stiffness": 1.0, "clearance": 0.3},
        "friction": {"type": "friction", "stiffness": 0.3, "limit": 0.05}}


def ours(n, law, folder):
    scene = {"structure": {"type": "chain", "masses": [1] * n, "springs": [1] * (n + 1),
                           "dampers": [0.03] * (n + 1)}, "omega": OMEGA,
             "effects": [{"type": "rayleigh_damping", "alpha": DAMPING, "beta": 0.0}]
             + [{**LAWS[law], "dof": f"x{i + 1}"} for i in range(n)],
             "excitation": [{"dof": "x1", "k": 1, "cos": LOAD}],
             "steady": {"harmonics": H, "stability": False}}
    path = os.path.join(folder, "scene.json")
    with open(path, "w") as file:
        json.dump(scene, file)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    answer = json.loads(subprocess.run([MODALCTL, "--local", "--json", "steady", path],
                                       capture_output=True, check=True).stdout)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    first = next(m for m in answer["harmonics"] if m["dof"] == "x1")
    return (after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
            answer["converged"],
            abs(complex(first["re"][1], first["im"][1])))


def force(law, x):
    if law == "cubic":
        return 0.1 * x**3, 0.3 * x**2
    beyond = x > 0.3
    return np.where(beyond, x - 0.3, 0), 1.0 * beyond


def peer(n, law):
    samples, m = 32 * (H + 1), 2 * H + 1
    K = sp.diags([2 * np.ones(n), -np.ones(n - 1), -np.ones(n - 1)], [0, 1, -1]).tocsc()
    C = 0.03 * K + DAMPING * sp.eye(n)
    t = np.arange(samples) * 2 * np.pi / samples
    basis = np.hstack([np.ones((samples, 1))] + [f(k * t)[:, None] for k in range(1, H + 1)
                                                 for f in (np.cos, np.sin)])
    back = np.linalg.pinv(basis)
    rows = [[None] * m for _ in range(m)]
    rows[0][0] = K
    for k in range(1, H + 1):
        a, b = 2 * k - 1, 2 * k
        rows[a][a] = rows[b][b] = K - (k * OMEGA) ** 2 * sp.eye(n)
        rows[a][b], rows[b][a] = k * OMEGA * C, -k * OMEGA * C
    order = np.arange(m * n).reshape(m, n).T.ravel()
    L = sp.bmat(rows).tocsr()[order][:, order].tocsc()
    load = np.zeros(m * n)
    load[1] = LOAD
    i = np.repeat(np.arange(m * n).reshape(n, m, 1), m, axis=2)
    j = i.transpose(0, 2, 1)
    begun, X, s, step = time.process_time(), np.zeros(m * n), 0.0, 1.0
    while s < 1 and step > 1e-4:
        Y, level, ok = X.copy(), min(1, s + step), False
        for _ in range(12):
            f, slope = force(law, Y.reshape(n, m) @ basis.T)
            R = L @ Y + (f @ back.T).ravel() - level * load
            ok = np.linalg.norm(R) < 1e-10
            if ok or not np.linalg.norm(R) < 1e3:
                break
            J = np.einsum("rN,iN,Nc->irc", back, slope, basis, optimize=True)
            Y -= sl.splu(L + sp.csc_matrix((J.ravel(), (i.ravel(), j.ravel())),
                                           shape=L.shape)).solve(R)
        X, s, step = (Y, level, 1.5 * step) if ok else (X, s, step / 2)
    return time.process_time() - begun, s == 1, np.hypot(X[1], X[2])


def motion(n, law, folder):
    """200 s from rest, samples each 0.1 s: seconds of processor, x1."""
    scene = {"structure": {"type": "chain", "masses": [1] * n, "springs": [1] * (n + 1),
                           "dampers": [0.03] * (n + 1)}, "omega": OMEGA,
             "effects": [{**LAWS[law], "dof": f"x{i + 1}"} for i in range(n)],
             "excitation": [{"dof": "x1", "k": 1, "cos": LOAD}],
             "time": {"duration": 200, "dt": 0.1}, "sensors": [{"dof": "x1"}]}
    path, out = os.path.join(folder, "scene.json"), os.path.join(folder, "motion.h5")
    with open(path, "w") as file:
        json.dump(scene, file)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([MODALCTL, "--local", "simulate", "-O", out, path], capture_output=True,
                   check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    with h5py.File(out) as file:
        x = file["signals"][:].ravel()
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, x


def pull(x, v):
    f = 2 * x + 0.06 * v
    f[1:] -= x[:-1] + 0.03 * v[:-1]
    f[:-1] -= x[1:] + 0.03 * v[1:]
    return -f


def motion_of_scipy(n, law):
    """DOP853 of what is smooth: rtol 1e-9."""
    def slope(t, y):
        a = pull(y[:n], y[n:]) - 0.1 * y[:n]**3
        a[0] += LOAD * np.cos(OMEGA * t)
        return np.concatenate([y[n:], a])
    begun = time.process_time()
    s = scipy.integrate.solve_ivp(slope, (0, 200), np.zeros(2 * n), "DOP853", rtol=1e-9,
                                  atol=1e-12, t_eval=np.arange(2001) * 0.1)
    return time.process_time() - begun, s.y[0]


def motion_of_numpy(n, law):
    """Classical Runge-Kutta; a slider moves once a step."""
    dt, x, v, z, kept = 0.02, np.zeros(n), np.zeros(n), np.zeros(n), []

    def slope(t, x, v):
        a = pull(x, v) - (0.3 * (x - z) if law == "friction" else np.maximum(x - 0.3, 0))
        a[0] += LOAD * np.cos(OMEGA * t)
        return a
    begun = time.process_time()
    for i in range(10001):
        t = i * dt
        if i % 5 == 0:
            kept.append(x[0])
        k1 = slope(t, x, v)
        v2 = v + dt / 2 * k1
        k2 = slope(t + dt / 2, x + dt / 2 * v, v2)
        v3 = v + dt / 2 * k2
        k3 = slope(t + dt / 2, x + dt / 2 * v2, v3)
        k4 = slope(t + dt, x + dt * v3, v + dt * k3)
        x = x + dt * v + dt * dt / 6 * (k1 + k2 + k3)
        v = v + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        if law == "friction":
            z = x - np.clip(x - z, -0.05 / 0.3, 0.05 / 0.3)
    return time.process_time() - begun, np.array(kept)


def motions(folder):
    for law in LAWS:
        for n in (100, 200, 400, 800, 2000):
            spent, x = motion(n, law, folder)
            peer = motion_of_scipy if law == "cubic" else motion_of_numpy
            theirs, y = peer(n, law)
            # a Runge-Kutta step with a kink in it is off by some 1e-3
            if np.abs(x - y).max() > (1e-6 if law == "cubic" else 1e-2) * np.abs(y).max():
                print(f"bench_scale: {law} on {n} dofs moves otherwise", file=sys.stderr)
                continue
            print(json.dumps({"bench": "scale", "case": f"simulate, {law} at every dof",
                              "value": round(spent, 4), "unit": "s",
                              "peer": "scipy DOP853" if law == "cubic" else "numpy RK4",
                              "ratio": round(theirs / spent, 3), "n": n}), flush=True)


def pulsating(n, springs):
    """Dofs whose springs pulsate, from end to end."""
    return [i * ((n - 1) // max(springs - 1, 1)) for i in range(springs)]


def multipliers(n, folder, springs=1):
    """Ten of largest modulus, dampers 0.01."""
    scene = {"structure": {"type": "chain", "masses": [1] * n, "springs": [1] * (n + 1),
                           "dampers": [0.01] * (n + 1)}, "omega": 1.3,
             "effects": [{"type": "parametric_stiffness", "dof": f"x{dof + 1}", "stiffness": 0.2,
                          "k": 1} for dof in pulsating(n, springs)]}
    path = os.path.join(folder, "scene.json")
    with open(path, "w") as file:
        json.dump(scene, file)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    answer = json.loads(subprocess.run([MODALCTL, "--local", "--json", "floquet", path, "-o",
                                        "multipliers=10"], capture_output=True, check=True).stdout)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return (after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
            np.array([complex(*m) for m in answer["multipliers"]]))


def multipliers_of_numpy(n):
    """Classical Runge-Kutta, 200 steps a period, of all columns at once; all eigenvalues."""
    K = sp.diags([2 * np.ones(n), -np.ones(n - 1), -np.ones(n - 1)], [0, 1, -1]).tocsr()
    steps, period, Y = 200, 2 * np.pi / 1.3, np.eye(2 * n)

    def slope(t, Y):
        a = -(K @ (Y[:n] + 0.01 * Y[n:]))
        a[0] -= 0.2 * np.cos(1.3 * t) * Y[0]
        return np.vstack([Y[n:], a])
    begun, h = time.process_time(), period / steps
    for i in range(steps):
        k1 = slope(i * h, Y)
        k2 = slope((i + 0.5) * h, Y + h / 2 * k1)
        k3 = slope((i + 0.5) * h, Y + h / 2 * k2)
        Y = Y + h / 6 * (k1 + 2 * k2 + 2 * k3 + slope((i + 1) * h, Y + h * k3))
    w = np.linalg.eigvals(Y)
    return time.process_time() - begun, w[np.argsort(-np.abs(w))]


def leading_of_scipy(n, springs=1, vectors=60):
    """ARPACK's ten of largest modulus: of the same steps, of one vector."""
    K = sp.diags([2 * np.ones(n), -np.ones(n - 1), -np.ones(n - 1)], [0, 1, -1]).tocsr()
    steps, period, at = 200, 2 * np.pi / 1.3, pulsating(n, springs)
    h = period / steps

    def slope(t, y):
        a = -(K @ (y[:n] + 0.01 * y[n:]))
        a[at] -= 0.2 * np.cos(1.3 * t) * y[at]
        return np.concatenate([y[n:], a])

    def carry(y):
        for i in range(steps):
            k1 = slope(i * h, y)
            k2 = slope((i + 0.5) * h, y + h / 2 * k1)
            k3 = slope((i + 0.5) * h, y + h / 2 * k2)
            y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + slope((i + 1) * h, y + h * k3))
        return y
    begun = time.process_time()
    try:
        w = sl.eigs(sl.LinearOperator((2 * n, 2 * n), matvec=carry, dtype=float), k=10, which="LM",
                    ncv=vectors, tol=1e-9, maxiter=30, return_eigenvectors=False)
    except sl.ArpackNoConvergence as some:
        w = some.eigenvalues
    return time.process_time() - begun, w


def large_spectra(folder):
    """`settled`: how many of the peer's ten have; those must be among ours where ours are
    leading."""
    for n in (400, 1000, 5000):
        spent, ours = multipliers(n, folder)
        theirs, w = leading_of_scipy(n) if n <= 1000 else (math.nan, [])
        print(json.dumps({"bench": "scale", "case": "floquet, ten leading multipliers of many",
                          "value": round(spent, 4), "unit": "s", "peer": "scipy ARPACK",
                          "ratio": round(theirs / spent, 3) if n <= 1000 else None, "n": n,
                          "settled": len(w), "moduli": [float(abs(m)) for m in ours[:2]]}),
              flush=True)


def pulsating_in_ten(folder, n=1000):
    """With fewer vectors ARPACK's ten do not settle."""
    spent, ours = multipliers(n, folder, 10)
    theirs, w = leading_of_scipy(n, 10, 700)
    if len(w) < 10 or max(np.abs(ours - m).min() for m in w) > 1e-5:
        print(f"bench_scale: ten springs of {n} dofs differ", file=sys.stderr)
        return
    print(json.dumps({"bench": "scale", "case": "floquet, ten leading, ten springs",
                      "value": round(spent, 4), "unit": "s", "peer": "scipy ARPACK",
                      "ratio": round(theirs / spent, 3), "n": n}), flush=True)


def spectra(folder):
    for n in (50, 100, 200, 400):
        spent, ours = multipliers(n, folder)
        theirs, w = multipliers_of_numpy(n)
        # a step is off by (2 h)^5 / 120, of the slow motions that last by far less
        if max(np.abs(w - m).min() for m in ours) > 1e-6:
            print(f"bench_scale: multipliers of {n} dofs differ", file=sys.stderr)
            continue
        print(json.dumps({"bench": "scale", "case": "floquet, ten leading multipliers",
                          "value": round(spent, 4), "unit": "s", "peer": "numpy eigvals",
                          "ratio": round(theirs / spent, 3), "n": n}), flush=True)


def main():
    with tempfile.TemporaryDirectory() as folder:
        motions(folder)
        spectra(folder)
        large_spectra(folder)
        pulsating_in_ten(folder)
        for law in LAWS:
            for n in (20, 50, 100, 200, 500, 1000):
                spent, converged, amplitude = ours(n, law, folder)
                theirs = peer(n, law) if law != "friction" else (0, False, 0)
                if not converged or (theirs[1] and abs(theirs[2] - amplitude) > 1e-2 * amplitude):
                    print(f"bench_scale: {law} on {n} dofs is {amplitude} for {theirs[2]}",
                          file=sys.stderr)
                    continue
                print(json.dumps({"bench": "scale", "case": f"steady, {law} at every dof",
                                  "value": round(spent, 4), "unit": "s",
                                  "peer": "scipy splu" if theirs[1] else "none",
                                  "ratio": round(theirs[0] / spent, 3), "n": n}), flush=True)


if __name__ == "__main__":
    main()
