#!/usr/bin/python3
"""Random systems under noise that nobody measured, against the bound; and the price of a record.

    MODALD_BUILD=build [PYOMA2=FOLDER] tests/bench/bench_ambient.py [FIRST] [LAST] [-v]
    MODALD_BUILD=build tests/bench/bench_ambient.py crowd [MODES] [CHANNELS]

Each record: 3 to 10 modes (every second with a pair 2 % apart), damping 0.2 to 5 %, 3 to 12
channels, 300 to 3,000 cycles of the slowest mode, white noise of 1 to 10 % on each channel; order
unknown, defaults.  The bound is the inverse of the Whittle likelihood's information at the truth,
by numpy.  A mode is detectable where its bound is at most 30 % of its damping; pooled are those of
at most 15 %; of the others what 1.96 std cover is told as well.  Last, 100,000 samples of 5
channels: processor time beside numpy's subspaces from the data, order given, without errors; and
beside pyOMA2's, of all its orders with their errors, where its folder is given (that holds
pyoma2/).  A crowd: so many modes (80 in 10 channels), damping 0.5 to 1.5 %, in 30,000 samples,
with overlap.
"""
import json
import os
import subprocess
import sys
import tempfile
import time
import types
import h5py
import numpy as np
import scipy.linalg
import scipy.signal
from scipy.optimize import linear_sum_assignment

CTL = os.path.join(os.environ.get("MODALD_BUILD", "build"), "bin", "modalctl")
DETECTABLE, POOLED = 0.3, 0.15


def run(Y, dt, *options):
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "ambient.h5")
        with h5py.File(path, "w") as f:
            f.create_dataset("signals", data=Y).attrs["dt"] = dt
        done = subprocess.run([CTL, "--local", "--json", "identify", path, "-o", "response=ambient",
                               *options],
                              capture_output=True, text=True)
    return json.loads(done.stdout)


def root(P):
    w, V = np.linalg.eigh(P)
    return V * np.sqrt(np.maximum(w, 0))


class System:
    """q' = lam q + B u with white u, y = 2 Re Phi q and white noise: its exact samples and their
    spectra."""

    def __init__(self, lam, Phi, B, dt, noise):
        self.lam, self.Phi, self.dt = lam, Phi, dt
        p = len(lam)
        both, drive, C = np.r_[lam, lam.conj()], np.r_[B, B.conj()], np.c_[Phi, Phi.conj()]
        sums = np.add.outer(both, both.conj())
        P = drive @ drive.conj().T * (-1 / sums)
        T = np.block([[np.eye(p) / 2, np.eye(p) / 2], [np.eye(p) / 2j, -np.eye(p) / 2j]])
        self.step = root((T @ (P * (1 - np.exp(sums * dt))) @ T.conj().T).real)
        self.start = root((T @ P @ T.conj().T).real)
        still = (C @ P @ C.conj().T).real
        self.sigma = noise * np.sqrt(np.diag(still))
        self.mu = np.exp(lam * dt)
        self.G = (np.exp(both * dt)[:, None] * P @ C.conj().T)[:p]
        self.R0 = still + np.diag(self.sigma ** 2)

    def samples(self, N, rng):
        p = len(self.lam)
        W, x = (rng.standard_normal((N, 2 * p)) @ self.step.T,
                self.start @ rng.standard_normal(2 * p))
        Y = rng.standard_normal((N, len(self.R0))) * self.sigma
        for k in range(p):
            first = np.array([self.mu[k] * (x[k] + 1j * x[p + k])])
            q = scipy.signal.lfilter([1], [1, -self.mu[k]], W[:, k] + 1j * W[:, p + k], zi=first)[0]
            Y += 2 * (q[:, None] * self.Phi[:, k]).real
        return Y

    def bins(self, N):
        """Middles and numbers of lines of bins that are a sixth as wide as the nearest pole is
        far."""
        w, lam = 2 * np.pi * np.arange(1, (N - 1) // 2 + 1) / N, np.log(self.mu)
        near = np.min(np.hypot(lam.real, w[:, None] - lam.imag), 1) / 6 * N / (2 * np.pi)
        width, edge = np.clip(near.astype(int), 1, len(w) // 100 + 1), [0]
        while edge[-1] < len(w):
            edge.append(min(edge[-1] + width[edge[-1]], len(w)))
        edge = np.array(edge)
        return (w[edge[:-1]] + w[edge[1:] - 1]) / 2, np.diff(edge)

    def bound(self, N):
        """Standard deviations of the decay and the turn of each pole a sample, of N samples."""
        (w, n), l, p = self.bins(N), len(self.R0), len(self.mu)
        z, scale, rows = np.exp(1j * w), 1 / np.sqrt(np.diag(self.R0)), []
        Phi, G, R0 = self.Phi * scale[:, None], self.G * scale, self.R0 * np.outer(scale, scale)
        balance = np.sqrt(np.linalg.norm(G, axis=1) / np.linalg.norm(Phi, axis=0))
        Phi, G = Phi * balance, G / balance[:, None]
        f, h = 1 / (z[:, None] - self.mu), 1 / (z[:, None] - self.mu.conj())

        def pair(a, b, R):
            return a[:, None, None] * R + b[:, None, None] * R.conj()

        X = sum(pair(f[:, k], h[:, k], np.outer(Phi[:, k], G[k])) for k in range(p))
        white = np.linalg.inv(np.linalg.cholesky(R0 + X + X.conj().transpose(0, 2, 1)))

        def add(X):
            M = white @ (X + X.conj().transpose(0, 2, 1)) @ white.conj().transpose(0, 2, 1)
            M *= np.sqrt(n)[:, None, None]
            rows.append(np.r_[M.real.ravel(), M.imag.ravel()])

        for k in range(p):
            R, m = np.outer(Phi[:, k], G[k]), self.mu[k]
            a, b = m * f[:, k] ** 2, m.conj() * h[:, k] ** 2
            add(pair(a, b, R))
            add(pair(1j * a, -1j * b, R))
        for k in range(p):
            for i in range(l):
                for c in (1, 1j):
                    unit = c * np.eye(l)[i]
                    if i != np.argmax(abs(Phi[:, k])):
                        add(pair(f[:, k], h[:, k], np.outer(unit, G[k])))
                    add(pair(f[:, k], h[:, k], np.outer(Phi[:, k], unit)))
        for i in range(l):
            for j in range(i + 1):
                unit = np.zeros((l, l), complex)
                unit[i, j] = unit[j, i] = 0.5
                add(np.broadcast_to(unit, (len(z), l, l)))
        J = np.array(rows) @ np.array(rows).T
        d = 1 / np.sqrt(np.diag(J))
        V = np.diag(np.linalg.inv(J * np.outer(d, d))) * d ** 2
        return np.sqrt(V[0:2 * p:2]), np.sqrt(V[1:2 * p:2])


def random_system(rng):
    """The system and its number of samples."""
    p, l = rng.integers(3, 11), rng.integers(3, 13)
    f = np.sort(np.exp(rng.uniform(0, np.log(10), p)))
    for k in range(1, p):
        f[k] = max(f[k], f[k - 1] * 1.06)
    if rng.random() < 0.5:
        k = rng.integers(1, p)
        f[k] = f[k - 1] * 1.02
    f, zeta = np.sort(f), np.exp(rng.uniform(np.log(0.002), np.log(0.05), p))
    w = 2 * np.pi * f
    Phi, B = (rng.standard_normal((l, p)),
              rng.standard_normal((p, max(2, p))) / (2j * np.sqrt(1 - zeta ** 2))[:, None])
    cycles = np.exp(rng.uniform(np.log(300), np.log(3000)))
    rate, noise = f.max() * rng.uniform(2.5, 6), 10 ** rng.uniform(-2, -1)
    return System(-zeta * w + 1j * w * np.sqrt(1 - zeta ** 2), Phi, B, 1 / rate,
                  noise), int(cycles / f.min() * rate)


def compare(system, N, said):
    """Of each mode found: its bound over its damping; errors over the bound, over std; std over the
    bound."""
    decay, turn = system.bound(N)
    found = np.array([complex(*m["exponent"]) for m in said["modes"]])
    rows = []
    for i, k in zip(*linear_sum_assignment(abs(found[:, None] - system.lam))) if len(found) else ():
        std, lam = said["modes"][i]["std"], system.lam[k]
        if std["frequency_hz"] is None:
            continue
        relative = decay[k] / -np.log(system.mu[k]).real
        zeta = -lam.real / abs(lam)
        error = (abs(found[i]) - abs(lam)) / (2 * np.pi), -found[i].real / abs(found[i]) - zeta
        bound, bar = (turn[k] / system.dt / (2 * np.pi),
                      relative * zeta), (std["frequency_hz"], std["damping_ratio"])
        rows.append([relative, *np.divide(error, bound), *np.divide(error, bar),
                     *np.divide(bar, bound)])
    return rows


def say(case, value, unit="1", **more):
    print(json.dumps({"bench": "ambient", "case": case, "value": float(value), "unit": unit,
                      **more}), flush=True)


def many(first, last, verbose):
    rows, right, told, cpu = [], 0, 0, []
    for seed in range(first, last):
        rng = np.random.default_rng(seed)
        system, N = random_system(rng)
        said = run(system.samples(N, rng), system.dt)
        assert ("error" not in said and said["stability"]["stable"]
                is not False), f"seed {seed}: {said}"
        detectable = np.all(system.bound(N)[0] < -DETECTABLE * np.log(system.mu).real)
        told += detectable
        right += detectable and len(said["modes"]) == len(system.lam)
        cpu.append(said["cost"]["cpu_s"])
        rows += compare(system, N, said)
        if verbose:
            print(seed, len(system.lam), "modes,", len(said["modes"]), "found,", len(system.R0),
                  "channels,", N, "samples,",
                  cpu[-1], "s", flush=True)
    few = np.array([row for row in rows if row[0] > POOLED]).reshape(-1, 7)
    r = np.array([row for row in rows if row[0] <= POOLED])
    for j, name in enumerate(("frequency", "damping")):
        say(f"{name}: mean squared error over the bound", np.mean(r[:, 1 + j] ** 2), n=len(r))
        say(f"{name}: covered by 1.96 std", np.mean(abs(r[:, 3 + j]) < 1.96), n=len(r))
        say(f"{name}: std over the bound", np.mean(r[:, 5 + j]), n=len(r))
    say("damping: covered by 1.96 std where the bound is over 15 % of it",
        np.mean(abs(few[:, 4]) < 1.96) if len(few) else np.nan, n=len(few))
    say("order right where all are detectable", right / max(told, 1), n=int(told))
    say("processor time, median", np.median(cpu), "s", n=len(cpu))


def crowd(p=80, l=10):
    rng = np.random.default_rng(1000 * p + l)
    f = np.sort(np.linspace(1, 1 + 0.25 * p, p) * (1 + 0.02 * rng.standard_normal(p)))
    zeta, w = rng.uniform(0.005, 0.015, p), 2 * np.pi * f
    system = System(w * (-zeta + 1j * np.sqrt(1 - zeta ** 2)), rng.standard_normal((l, p)),
                    rng.standard_normal((p, p)) / 1j, 1 / (2.5 * f.max()), 0.02)
    said = run(system.samples(30000, rng), system.dt)
    found, off = np.array([complex(*m["exponent"]) for m in said["modes"]]), []
    for i, k in zip(*linear_sum_assignment(abs(found[:, None] - system.lam))):
        std, lam = said["modes"][i]["std"]["frequency_hz"], system.lam[k]
        if std is not None and abs(found[i] - lam) < -lam.real:
            off.append((abs(found[i]) - abs(lam)) / (2 * np.pi * std))
    case = f"{p} modes in {l} channels: "
    say(case + "modes", len(found))
    say(case + "within half a width, with errors", len(off))
    say(case + "frequency: rms of errors over std", np.sqrt(np.mean(np.square(off))))
    say(case + "processor time", said["cost"]["cpu_s"], "s")


def subspaces(Y, lags=30, order=10):
    """Exponents a sample from the data: the future's projection on the past, by an LQ decomposition
    of both; no errors."""
    l, N = Y.shape[1], len(Y) - 2 * lags
    H = np.vstack([Y[k:k + N].T for k in range(2 * lags)])
    R = np.linalg.qr(H.T, mode="r").T
    U, s, _ = np.linalg.svd(R[lags * l:, :lags * l])
    O = U[:, :order] * np.sqrt(s[:order])
    return np.log(np.linalg.eigvals(scipy.linalg.lstsq(O[:-l], O[l:])[0]).astype(complex))


def pyoma(Y, dt, errors):
    """Its SSIdat at its example's settings: 30 block rows, orders to 50 by 2; bars of 100 blocks.
    Neither pandas nor tqdm does anything there."""
    sys.path[:0] = [os.environ["PYOMA2"]]
    for name in ("pandas", "tqdm"):
        module = sys.modules.setdefault(name, types.ModuleType(name))
        module.DataFrame = object
        module.tqdm, module.trange = (lambda x, **more: x), (lambda *x, **more: range(*x))
    from pyoma2.functions import ssi
    H, T = ssi.build_hank(Y.T, Y.T, 30, "dat", calc_unc=errors, nb=100)
    O, A, C, _ = ssi.SSI_fast(H, 30, 50, step=2)
    return ssi.SSI_poles(O, A, C, 50, dt, step=2, calc_unc=errors, H=H, T=T)


def price():
    w, rng = 2 * np.pi * np.array([0.9, 2.6, 4.1, 5.25, 6.0]), np.random.default_rng(0)
    system = System(w * (-0.02 + 1j * np.sqrt(1 - 0.02 ** 2)), rng.standard_normal((5, 5)),
                    rng.standard_normal((5, 5)) / 1j, 0.01, 0.05)
    Y = system.samples(100000, rng)
    own = run(Y, 0.01)
    assert len(own["modes"]) == 5, own
    before = time.process_time()
    subspaces(Y)
    say("100,000 x 5: processor time", own["cost"]["cpu_s"], "s")
    say("100,000 x 5: numpy's subspaces from the data, processor time over that",
        (time.process_time() - before) / own["cost"]["cpu_s"])
    for errors in (False, True) if "PYOMA2" in os.environ else ():
        before = time.process_time()
        pyoma(Y, 0.01, errors)
        say("100,000 x 5: pyOMA2's subspaces from the data, with%s errors, processor time over that"
            % ("" if errors else "out"), (time.process_time() - before) / own["cost"]["cpu_s"])


if __name__ == "__main__":
    numbers = [int(x) for x in sys.argv[1:] if x.isdigit()]
    if "crowd" in sys.argv:
        crowd(*numbers)
    else:
        many(numbers[0] if numbers else 0, numbers[1] if len(numbers) > 1 else 20, "-v" in sys.argv)
        price()
