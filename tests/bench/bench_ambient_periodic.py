#!/usr/bin/python3
"""Random systems with periodic stiffness under noise that nobody measured, against the bound of
their lifted spectrum.

    MODALD_BUILD=build tests/bench/bench_ambient_periodic.py [FIRST] [LAST] [-v]
    MODALD_BUILD=build tests/bench/bench_ambient_periodic.py wander [FIRST] [LAST] [-v]

Each record, by turns: Mathieu's oscillator, and two degrees of freedom; stiffness parts of 10 to 40
% that vary once or twice a period, damping 0.5 to 3 %, one channel, or two, 500 to 3,000 periods of
PHASES samples, white noise of 1 to 10 % on each channel; defaults and `period`.  The samples of
each period are one vector, the lifted signal, whose spectral matrix is that of a constant system:
the bound is the inverse of its Whittle likelihood's information at the truth (bench_ambient.py),
nothing of it reduced.  `wander`: the stiffness turns with an azimuth, a channel, whose speed
wanders by WANDER within 5 and 100 turns, by halves of the records, while all else keeps to time;
multipliers are those of the mean turn, and the bound is that of even turns.
"""
import sys
import numpy as np
import scipy.linalg
import scipy.signal
from scipy.optimize import linear_sum_assignment
import bench_ambient
from bench_ambient import root, say

PHASES, FINE = 12, 16
WANDER, WITHIN = 0.01, (5, 100)


def step_of(A, B, h):
    """exp(A h) and the covariance of what white noise through B adds within h [Van Loan 1978]."""
    n = len(A)
    E = scipy.linalg.expm(np.block([[-A, B @ B.T], [np.zeros((n, n)), A.T]]) * h)
    F = E[n:, n:].T
    return F, F @ E[:n, n:]


class Periodic(bench_ambient.System):
    """x' = A(t) x + B u, period 1, y = C x and white noise, PHASES samples a period: its lifted
    signal, exactly."""

    def __init__(self, A, B, C, noise, phases=PHASES):
        n, c = C.T.shape
        F, O, P = np.eye(n), [], np.zeros((n, n))
        # E Y x(t)^T of what was driven within the period
        past = np.zeros((0, n))
        E = np.zeros((0, 0))
        for j in range(phases):
            O.append(C @ F)
            new = C @ P
            E = np.block([[E, past @ C.T], [C @ past.T, new @ C.T]])
            past = np.vstack([past, new])
            for k in range(FINE):
                step, Q = step_of(A((j + (k + 0.5) / FINE) / phases), B, 1 / phases / FINE)
                F, P, past = step @ F, step @ P @ step.T + Q, past @ step.T
        self.F, self.O, self.cross = F, np.vstack(O), past
        self.mean = scipy.linalg.solve_discrete_lyapunov(F, P)
        self.drive = root(np.block([[P, past.T], [past, E]]))
        still = self.O @ self.mean @ self.O.T + E
        # nothing lasts; who draws asks for another
        if np.max(abs(np.linalg.eigvals(F))) >= 1:
            self.all = np.linalg.eigvals(F)
            return
        sigma = noise * np.sqrt(np.diag(still).reshape(-1, c).mean(0))
        self.sigma, self.channels, self.dt = np.tile(sigma, phases), c, 1.0
        mu, V = np.linalg.eig(F)
        keep = mu.imag > 0
        self.mu, self.Phi = mu[keep], (self.O @ V)[:, keep]
        self.G = np.linalg.solve(V, F @ self.mean @ self.O.T + past.T)[keep]
        self.R0 = still + np.diag(self.sigma ** 2)
        self.all = mu

    def samples(self, periods, rng):
        n = len(self.F)
        W = rng.standard_normal((periods, len(self.drive))) @ self.drive.T
        X, x = np.empty((periods, n)), root(self.mean) @ rng.standard_normal(n)
        for m in range(periods):
            X[m] = x
            x = self.F @ x + W[m, :n]
        Y = X @ self.O.T + W[:, n:] + rng.standard_normal((periods, len(self.R0))) * self.sigma
        return Y.reshape(-1, self.channels)


def random_periodic(rng, dofs, channels=None, phases=PHASES):
    """A stable system whose multipliers are pairs, and its number of periods."""
    while True:
        w = 2 * np.pi * np.sort(rng.uniform(0.2, 1.8, dofs))
        V = np.linalg.qr(rng.standard_normal((dofs, dofs)))[0]
        K = V @ np.diag(w ** 2) @ V.T
        D = V @ np.diag(2 * w * np.exp(rng.uniform(np.log(0.005), np.log(0.03), dofs))) @ V.T
        parts = []
        for k in (1, 2):
            S = rng.standard_normal((dofs, dofs))
            parts.append((S + S.T) / np.linalg.norm(S + S.T, 2) * w.mean() ** 2
                         * rng.uniform(0.1, 0.4) / k)
        phase = rng.uniform(0, 2 * np.pi, 2)

        def A(t):
            varying = sum(p * np.cos(2 * np.pi * (k + 1) * t + phase[k]) for k,
                          p in enumerate(parts))
            return np.block([[np.zeros((dofs, dofs)), np.eye(dofs)], [-K - varying, -D]])

        B = np.vstack([np.zeros((dofs, dofs)), rng.standard_normal((dofs, dofs))])
        seen = channels or rng.integers(1, dofs + 1)
        C = np.c_[rng.standard_normal((seen, dofs)), np.zeros((seen, dofs))]
        s = Periodic(A, B, C, 10 ** rng.uniform(-2, -1), phases)
        s.A, s.B, s.C = A, B, C
        if np.max(abs(s.all)) < 0.995 and np.min(abs(s.all.imag)) > 0.02:
            return s, int(np.exp(rng.uniform(np.log(500), np.log(3000))))


def wander(system, periods, within, rng):
    """Samples of the system at a speed that wanders, beside them the azimuth in degrees; system.mu
    becomes that of the mean turn."""
    bound = system.bound(periods)
    fine, n = FINE * PHASES // 2, len(system.F)
    h, keep, steps = 1 / fine, np.exp(-1 / fine / within), periods * fine
    speed = 1 + scipy.signal.lfilter([WANDER * np.sqrt(1 - keep ** 2)], [1, -keep],
                                     rng.standard_normal(steps))
    angle = np.r_[0, np.cumsum(speed[:-1])] * h

    # five harmonics are all of A
    parts = np.fft.fft([system.A(k / 5) for k in range(5)], axis=0)[[3, 4, 0, 1, 2]] / 5

    def advance(at, h):
        turns = np.exp(2j * np.pi * np.outer(at, np.arange(-2, 3)))
        A = h * np.einsum("ij,jkl->ikl", turns, parts).real
        F, term = np.eye(n) + A, A
        for k in range(2, 7):
            term = A @ term / k
            F = F + term
        return F

    F, x = advance(angle + h / 2 * speed, h), root(system.mean) @ rng.standard_normal(n)
    kicks = rng.standard_normal((steps, system.B.shape[1])) @ system.B.T * np.sqrt(h)
    Y, every = np.empty((steps, n)), FINE // 2
    for k in range(steps):
        Y[k] = x
        x = F[k] @ x + kicks[k]
    mean, M = (steps - 1) * h / angle[-1], np.eye(n)
    # by steps as long, so that what they leave out is left out of both
    for step in advance((np.arange(fine) + 0.5) / fine, mean / fine):
        M = step @ M
    mu = np.linalg.eigvals(M)
    system.mu = np.array([mu[np.argmin(abs(mu - m))] for m in system.mu])
    system.bound = lambda periods: bound
    Y = Y[::every] @ system.C.T
    return np.c_[Y + rng.standard_normal(Y.shape) * system.sigma[:Y.shape[1]],
                 np.mod(angle[::every], 1) * 360]


def compare(system, periods, said):
    """Of each mode found: its bound over its decay; errors of decay and turn a period over the
    bound, over std; std over the bound; the components of the multiplier's error over half its
    variance."""
    decay, turn = system.bound(periods)
    found = np.array([complex(*m["multiplier"]) for m in said["modes"]])
    rows = []
    for i, k in zip(*linear_sum_assignment(abs(found[:, None] - system.mu))) if len(found) else ():
        std = said["modes"][i]["std"]
        if std["exponent"] is None or None in np.ravel(std["exponent"]):
            continue
        error = np.log(found[i] / system.mu[k])
        error, bar = np.array([error.real, error.imag]), np.array(std["exponent"])
        bound = np.array([decay[k], turn[k]])
        part = (found[i] - system.mu[k]) / (std["multiplier"] / np.sqrt(2))
        rows.append([decay[k] / -np.log(abs(system.mu[k])), *error / bound, *error / bar,
                     *bar / bound, part.real, part.imag])
    return rows


def many(first, last, verbose, ask):
    """ask: of a system, its number of periods and a generator, what is said."""
    rows, right, missed = [], 0, 0
    for seed in range(first, last):
        rng = np.random.default_rng(seed)
        system, periods = random_periodic(rng, 1 + seed % 2)
        said = ask(system, periods, rng, seed)
        assert ("error" not in said and said["stability"]["stable"]
                is not False), f"seed {seed}: {said}"
        own = compare(system, periods, said)
        right += len(said["modes"]) == len(system.mu)
        missed += len(system.mu) - len(own)
        rows += own
        if verbose:
            print(seed, len(system.mu), "modes,", len(said["modes"]), "found,", len(system.R0),
                  "lifted,", periods, "periods,",
                  "%.2f s" % said["cost"]["cpu_s"], np.round(own, 2).tolist(),
                  [d["code"] for d in said["diagnostics"]], flush=True)
    for name, r in (("", np.array(rows)),
                    (" (bound below 15 %)", np.array([r for r in rows if r[0] <= 0.15]))):
        for j, what in enumerate(("decay", "turn")):
            say(f"{what}: mean squared error over the bound{name}", np.mean(r[:, 1 + j] ** 2),
                n=len(r))
            say(f"{what}: covered by 1.96 std{name}", np.mean(abs(r[:, 3 + j]) < 1.96), n=len(r))
            say(f"{what}: std over the bound{name}", np.mean(r[:, 5 + j]), n=len(r))
        say(f"multiplier's components: covered by 1.96 std over sqrt(2){name}",
            np.mean(abs(r[:, 7:]) < 1.96), n=2 * len(r))
    say("as many modes as there are", right / (last - first), n=last - first)
    say("modes without errors", missed)


def ask_even(system, periods, rng, seed):
    return bench_ambient.run(system.samples(periods, rng), 1 / PHASES, "-o", "period=1")


def ask_wandering(system, periods, rng, seed):
    Y = wander(system, periods, WITHIN[seed // 2 % 2], rng)
    return bench_ambient.run(Y, 1 / PHASES, "-o", f"azimuth={Y.shape[1] - 1}")


if __name__ == "__main__":
    numbers = [int(x) for x in sys.argv[1:] if x.isdigit()]
    many(numbers[0] if numbers else 0, numbers[1] if len(numbers) > 1 else 20, "-v" in sys.argv,
         ask_wandering if "wander" in sys.argv else ask_even)
