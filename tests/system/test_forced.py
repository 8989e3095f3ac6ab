"""identify -o response=forced against scipy's simulation: its errors against the Cramer-Rao bound,
computed here from derivatives of that simulation; what it says of records that are none; what it
refuses.
"""
import json

import numpy as np
import pytest
import sanitized

from conftest import decay, write_batch

signal = pytest.importorskip("scipy.signal")
DT, SAMPLES = 0.01, 600
FORCED = ("-o", "response=forced", "-o", "inputs=force")


class System:
    """Two modes, two responses to one force, on exact steps of a force that is straight between
    samples.

    p: two frequencies, two damping ratios, the responses' weights of displacement and velocity of
    each mode (complex shapes, of which the system's own are the real ones), the initial state, the
    direct terms.
    """

    def __init__(self, seed, noise=0.03):
        rng = np.random.default_rng(seed)
        self.p = np.concatenate([[6, 6 * rng.uniform(1.02, 3)], 10 ** rng.uniform(-2.3, -1.3, 2),
                                 (rng.standard_normal((4, 1)) * [1, 0]).ravel(),
                                 rng.standard_normal(4) * 0.05,
                                 rng.standard_normal(2)])
        t = np.arange(SAMPLES) * DT
        kind = seed % 3
        if kind == 0:
            self.u = rng.standard_normal(SAMPLES)
        elif kind == 1:
            self.u = signal.chirp(t, 1, t[-1], 30)
        else:
            self.u = np.zeros(SAMPLES)
            for hit in rng.integers(0, SAMPLES - 100, 4):
                self.u[hit:hit + 3] += [3, 9, 4]
        self.clean = self.simulate(self.p)
        self.sigma = noise * self.clean.std(0)
        self.y = self.clean + rng.standard_normal(self.clean.shape) * self.sigma

    def matrices(self, p):
        w, z, C, x0, D = 2 * np.pi * p[:2], p[2:4], p[4:12].reshape(2, 4), p[12:16], p[16:18]
        A, B = np.zeros((4, 4)), np.zeros((4, 1))
        for j in range(2):
            A[2 * j:2 * j + 2, 2 * j:2 * j + 2] = [[0, w[j]], [-w[j], -2 * z[j] * w[j]]]
            B[2 * j + 1] = w[j]
        return A, B, C, D[:, None], x0

    def simulate(self, p):
        *system, x0 = self.matrices(p)
        return signal.lsim(system, self.u, np.arange(SAMPLES) * DT, X0=x0)[1]

    def bound(self):
        """Of both frequencies and both damping ratios; an offset in each response is unknown
        too."""
        columns = []
        for j in range(len(self.p)):
            step = 1e-6 * max(1, abs(self.p[j]))
            d = np.zeros_like(self.p)
            d[j] = step
            columns.append(((self.simulate(self.p + d) - self.simulate(self.p - d)) / (2 * step)
                            / self.sigma).T.ravel())
        for i in range(2):
            columns.append(np.repeat(np.eye(2)[i], SAMPLES))
        J = np.array(columns).T
        size = np.linalg.norm(J, axis=0)
        return (np.sqrt(np.diag(np.linalg.inv((J / size).T @ (J / size)))) / size)[:4]

    def write(self, path):
        return write_batch(path, np.column_stack([self.u, self.y]), dt=DT,
                           channels=["force", "a", "b"])


def test_frequency_and_damping_are_at_the_bound_with_errors_that_cover(ctl, tmp_path):
    """Of 30 records with 4 values each the mean square over the bound has a standard deviation of
    0.13."""
    ratios, within = [], []
    for seed in range(30):
        s = System(seed)
        said = ctl("identify", s.write(tmp_path / "a.h5"), *FORCED)
        assert (said.status == 0 and said.document["response"] == "forced"
                and len(said.document["modes"]) == 2)
        modes = sorted(said.document["modes"], key=lambda m: m["frequency_hz"])
        got = [m["frequency_hz"] for m in modes] + [m["damping_ratio"] for m in modes]
        std = [m["std"]["frequency_hz"] for m in modes] + [m["std"]["damping_ratio"] for m in modes]
        error = np.array(got) - s.p[:4]
        ratios.append((error / s.bound()) ** 2)
        within.append(np.abs(error) < 1.96 * np.array(std))
    assert 0.6 < np.mean(ratios) < 1.4 and np.mean(within) > 0.88


@pytest.mark.parametrize("seed, share", [(0, 0.7), (1, 0.7), (2, 0.7), (4, 0.7), (5, 0.7),
                                         (1, 0.5)])
def test_an_input_that_was_cut_off_is_told_and_one_that_truly_stops_there_is_not(ctl, tmp_path,
                                                                                 seed, share):
    """At such a share of its largest value, a record of noise, of a sweep and of hits that grow, by
    turns: cut off before it was recorded, or before it moved anything."""
    s = System(seed)
    noise, s.u = s.y - s.clean, s.u * np.linspace(0.4, 1.6, SAMPLES)
    s.y = s.simulate(s.p) + noise
    most = share * abs(s.u).max()
    s.u = np.clip(s.u, -most, most)
    said = ctl("identify", s.write(tmp_path / "a.h5"), *FORCED, "-o", "frf=true").document
    cut = [d for d in said["diagnostics"] if d["code"] == "clipped"]
    assert len(cut) == 1 and "force" in cut[0]["message"]
    assert said["stability"]["stable"] is None
    assert all(m["std"]["damping_ratio"] is None for m in said["modes"])
    assert all(x is None for c in said["frf"]["curves"] for x in c["std"])
    s.y = s.simulate(s.p) + noise
    said = ctl("identify", s.write(tmp_path / "a.h5"), *FORCED).document
    assert not [d for d in said["diagnostics"] if d["code"] == "clipped"]
    assert len(said["modes"]) == 2 and said["stability"]["stable"] is True


def test_hits_that_bounce_have_errors_that_cover(ctl, tmp_path):
    """A second, weaker hit a few samples after each.  Of 8 records with 4 values each the mean
    square over the standard errors has a standard deviation of 0.25."""
    squares = []
    for seed in range(2, 26, 3):
        s, rng = System(seed), np.random.default_rng(seed)
        noise, s.u = (s.y - s.clean) / s.sigma, np.zeros(SAMPLES)
        for hit in rng.integers(0, SAMPLES - 100, 3):
            s.u[hit:hit + 3] += [3, 9, 4]
            again = hit + rng.integers(4, 12)
            s.u[again:again + 3] += rng.uniform(0.2, 0.7) * np.array([3, 9, 4])
        s.clean = s.simulate(s.p)
        s.sigma = 0.03 * s.clean.std(0)
        s.y = s.clean + noise * s.sigma
        modes = ctl("identify", s.write(tmp_path / "a.h5"), *FORCED).document["modes"]
        assert len(modes) == 2, seed
        modes.sort(key=lambda m: m["frequency_hz"])
        got = [m["frequency_hz"] for m in modes] + [m["damping_ratio"] for m in modes]
        std = [m["std"]["frequency_hz"] for m in modes] + [m["std"]["damping_ratio"] for m in modes]
        squares.append(((np.array(got) - s.p[:4]) / std) ** 2)
    assert 0.4 < np.mean(squares) < 1.75


def test_without_noise_the_systems_own_numbers_come_back(ctl, tmp_path):
    for seed in range(3):
        s = System(seed, noise=0)
        said = ctl("identify", s.write(tmp_path / "a.h5"), *FORCED, "-o", "shapes=true")
        modes = sorted(said.document["modes"], key=lambda m: m["frequency_hz"])
        assert said.document["stability"]["stable"] is True
        assert np.allclose([m["frequency_hz"] for m in modes], s.p[:2], rtol=1e-8)
        assert np.allclose([m["damping_ratio"] for m in modes], s.p[2:4], rtol=1e-6)
        for j, m in enumerate(modes):
            shape = np.array(m["shape"])[:, 0]
            weights = s.p[[4 + 2 * j, 8 + 2 * j]]
            assert np.allclose(shape / shape[0], weights / weights[0], rtol=1e-6)
            # w/(s^2 + 2 z w s + w^2) w: its residue at s = lambda is w^2 / (2i Im lambda)
            lam = complex(*m["exponent"])
            residue = weights * (2 * np.pi * s.p[j]) ** 2 / (2j * lam.imag)
            assert np.allclose(np.array(m["shape"]) @ [1, 1j] * complex(*m["participation"][0]),
                               residue, rtol=1e-5)
            assert m["cycles"] == pytest.approx(m["frequency_hz"] * SAMPLES * DT)


class Hits:
    """Records of one system after the other: a hit each, an initial state and a level of its
    own."""

    def __init__(self, seed, records=4, noise=0.03):
        rng = np.random.default_rng(seed)
        first = System(3 * seed + 2, noise)
        self.each = []
        for _ in range(records):
            s = System(3 * seed + 2, noise)
            s.u = np.zeros(SAMPLES)
            at = rng.integers(5, 60)
            s.u[at:at + 3] = np.array([3, 9, 4]) * rng.uniform(0.5, 1.5)
            s.p[12:16] = rng.standard_normal(4) * 0.2
            s.sigma, s.clean = first.sigma, s.simulate(s.p)
            s.y = s.clean + rng.standard_normal(s.clean.shape) * s.sigma + rng.standard_normal(2)
            self.each.append(s)
        self.p = first.p

    def bound(self):
        """As System.bound, state and level unknown in each record; rows of records that are
        independent, so information adds."""
        n, own = len(self.each), 4 + 2
        rows = []
        for k, s in enumerate(self.each):
            J = np.zeros((2 * SAMPLES, 14 + own * n))
            for j in range(18):
                d = np.zeros(18)
                d[j] = 1e-6 * max(1, abs(s.p[j]))
                column = ((s.simulate(s.p + d) - s.simulate(s.p - d)) / (2 * d[j])
                          / s.sigma).T.ravel()
                J[:, j if j < 12 else j - 4 if j > 15 else 14 + own * k + j - 12] = column
            for i in range(2):
                J[:, 14 + own * k + 4 + i] = np.repeat(np.eye(2)[i], SAMPLES)
            rows.append(J)
        J = np.vstack(rows)
        size = np.linalg.norm(J, axis=0)
        return (np.sqrt(np.diag(np.linalg.inv((J / size).T @ (J / size)))) / size)[:4]

    def identify(self, ctl, path, *options):
        signals = np.vstack([np.column_stack([s.u, s.y]) for s in self.each])
        starts = ",".join(str(k * SAMPLES * DT) for k in range(1, len(self.each)))
        return ctl("identify", write_batch(path, signals, dt=DT, channels=["force", "a", "b"]),
                   *FORCED, "-o", "starts=" + starts, *options)


@pytest.mark.skipif(sanitized.SANITIZED, reason="a minute under sanitizers")
def test_hits_in_records_of_their_own_are_averaged_by_likelihood_to_their_common_bound(
        ctl, tmp_path):
    """Of 20 records with 4 values each the mean square over the bound has a standard deviation of
    0.16; frequencies and damping of the likelihood of all, not of a mean of quotients."""
    ratios, within = [], []
    for seed in range(20):
        h = Hits(seed)
        said = h.identify(ctl, tmp_path / "a.h5")
        assert said.status == 0 and len(said.document["modes"]) == 2, seed
        modes = sorted(said.document["modes"], key=lambda m: m["frequency_hz"])
        got = [m["frequency_hz"] for m in modes] + [m["damping_ratio"] for m in modes]
        std = [m["std"]["frequency_hz"] for m in modes] + [m["std"]["damping_ratio"] for m in modes]
        error = np.array(got) - h.p[:4]
        ratios.append((error / h.bound()) ** 2)
        within.append(np.abs(error) < 1.96 * np.array(std))
    assert 0.5 < np.mean(ratios) < 1.5 and np.mean(within) > 0.86


def test_records_without_noise_have_the_systems_own_numbers_whatever_their_levels_and_states(
        ctl, tmp_path):
    h = Hits(4, noise=0)
    said = h.identify(ctl, tmp_path / "a.h5").document
    modes = sorted(said["modes"], key=lambda m: m["frequency_hz"])
    assert np.allclose([m["frequency_hz"] for m in modes], h.p[:2], rtol=1e-8)
    assert np.allclose([m["damping_ratio"] for m in modes], h.p[2:4], rtol=1e-6)
    assert said["provenance"]["options"]["starts"] == [6, 12, 18]
    late = h.identify(ctl, tmp_path / "a.h5", "-o", "window=6,24").document
    assert np.allclose(sorted(m["frequency_hz"] for m in late["modes"]), h.p[:2], rtol=1e-8)


def test_a_lag_of_first_order_is_one_real_exponent_beside_the_mode(ctl, tmp_path):
    """1/(0.05 s + 1) + 1/(s^2/400 + s/1000 + 1): the exponent is -20, and the mode is not
    disturbed."""
    rng = np.random.default_rng(2)
    t, u = np.arange(2000) * DT, rng.standard_normal(2000)
    y = sum(signal.lsim(signal.TransferFunction([1], below), u, t)[1]
            for below in ([0.05, 1], [1 / 400, 1 / 1000, 1]))
    y += rng.standard_normal(2000) * 0.02
    said = ctl("identify", write_batch(tmp_path / "a.h5", np.column_stack([u, y]), dt=DT,
                                       channels=["force", "a"]), *FORCED, "-o",
               "shapes=true").document
    mode, lag = said["modes"]
    assert (said["stability"]["stable"] is True and [d["code"] for d in said["diagnostics"]]
            == ["broad_poles"])
    part = complex(*lag["participation"][0])
    # 20/(s + 20)
    assert abs(part.real - 20) < 1 and part.imag == 0 and lag["shape"] == [[1, 0]]
    assert (lag["exponent"][1] == 0 and abs(lag["exponent"][0] + 20) < 4 * lag["std"]["exponent"][0]
            < 1)
    assert abs(mode["frequency_hz"] - 10 / np.pi) < 4 * mode["std"]["frequency_hz"]
    assert abs(mode["damping_ratio"] - 0.01) < 4 * mode["std"]["damping_ratio"]


def test_an_unstable_system_that_is_driven_is_unstable(ctl, tmp_path):
    rng = np.random.default_rng(4)
    t, u = np.arange(2000) * DT, rng.standard_normal(2000)
    y = signal.lsim(signal.TransferFunction([100], [1, -0.1, 100]), u, t)[1]
    y += rng.standard_normal(2000) * 0.01 * y.std()
    said = ctl("identify", write_batch(tmp_path / "a.h5", np.column_stack([u, y]), dt=DT,
                                       channels=["force", "a"]), *FORCED).document
    assert (said["stability"]["stable"] is False and said["modes"][0]["damping_ratio"]
            == pytest.approx(-0.005, rel=0.01))


def test_frequency_responses_are_scipys_within_errors_that_cover(ctl, tmp_path):
    """Of a complex error, over the standard deviation of its modulus, the mean square is 1 whatever
    its shape is; 20 records of four curves are 40 or so independent numbers.  The truth is that of
    the samples: steps of a force that is straight.
    """
    squares = []
    for seed in range(20):
        s = System(seed)
        frf = ctl("identify", s.write(tmp_path / "a.h5"), *FORCED, "-o", "frf=true").document["frf"]
        assert [(c["input"], c["name"]) for c in frf["curves"]] == [("force", "a"), ("force", "b")]
        hertz = np.array(frf["frequency_hz"])
        assert np.all(np.diff(hertz) > 0) and np.min(np.abs(hertz - s.p[0])) < 0.01 * s.p[0]
        discrete = signal.cont2discrete(s.matrices(s.p)[:4], DT, method="foh")
        truth = np.array([discrete[2] @ np.linalg.solve(z * np.eye(4) - discrete[0], discrete[1])
                          + discrete[3]
                          for z in np.exp(2j * np.pi * hertz * DT)])[:, :, 0]
        within = hertz < 25 if seed % 3 == 1 else hertz > 0                 # where the sweep was
        for i, curve in enumerate(frf["curves"]):
            error = np.abs(np.array(curve["value"]) @ [1, 1j]
                           - truth[:, i]) / np.array(curve["std"])
            squares.append(np.mean(error[within] ** 2))
    assert 0.6 < np.mean(squares) < 1.5


def test_twice_the_record_halves_the_variance(ctl, tmp_path):
    mode = ctl("identify", System(0).write(tmp_path / "a.h5"), *FORCED).document["modes"][0]
    for key in ("frequency_hz", "damping_ratio"):
        assert mode["bound_at_2x"][key] == pytest.approx(mode["std"][key] / np.sqrt(2))


def test_a_free_response_says_so_and_counts_no_cycles(ctl, tmp_path):
    said = ctl("identify", write_batch(tmp_path / "a.h5", decay(400))).document
    assert said["response"] == "free" and "cycles" not in said["modes"][0]


@pytest.mark.parametrize("options, field, words", [
    (["response=forced"], "inputs", "needs the channels that hold the measured excitation"),
    (["inputs=force"], "inputs", "accepted with response=forced"),
    (["frf=true"], "frf", "accepted with response=forced"),
    (["starts=2"], "starts", "accepted with response=forced"),
    (["response=forced", "inputs=force", "starts=4,2"], "starts", "times that rise"),
    (["response=forced", "inputs=force", "starts=2,90"], "starts", "behind the last sample"),
    (["response=forced", "inputs=force", "starts=2,2.02"], "starts", "8 samples and more"),
    (["response=forced", "inputs=force", "starts=-1"], "starts", "0 and above"),
    (["response=forced", "inputs=force", "starts=2", "detrend=linear"], "detrend", "none, mean"),
    (["response=forced", "inputs=forse"], "inputs", 'no channel "forse"'),
    (["response=forced", "inputs=force,force"], "inputs", "named twice"),
    (["response=forced", "inputs=force,a,b"], "inputs", "at least one must be a response"),
    (["response=forced", "inputs=force", "signals=force,a"], "signals", "is an input too"),
    (["response=forced", "inputs=force", "rank.fixed=3"], "rank.fixed", "two a pair"),
    (["response=forced", "inputs=force", "target.error=0.1"], "target.error",
     "says nothing of response=forced"),
    (["response=forced", "inputs=force", "window=auto"], "window",
     "accepted with response=forced: T0,T1"),
])
def test_what_cannot_be_asked_is_refused_with_what_can(ctl, tmp_path, options, field, words):
    more = [word for option in options for word in ("-o", option)]
    said = ctl("identify", System(0).write(tmp_path / "a.h5"), *more)
    assert (said.status == 2 and said.document["error"]["field"] == field
            and words in said.document["error"]["message"])


def test_a_tradeoff_of_forced_responses_says_what_half_of_the_record_is_worth(ctl, tmp_path):
    """Random forces throughout: the bound falls as one over the root of the record, to its
    transients, of which 600 samples hold two damping times."""
    said = ctl("tradeoff", "identify", System(0).write(tmp_path / "a.h5"), *FORCED).document
    whole, half = (next(r for r in said["rungs"] if r["settings"].get("window") == window
                        and "rank.fixed" not in r["settings"])
                   for window in (None, [0, (SAMPLES - 1) * DT / 2]))
    assert 1.2 < half["bound"] / whole["bound"] < 2 and half["unmatched"] == 0
    assert said["bound_at_2x"] == pytest.approx(said["bound"] / np.sqrt(2))
    assert all("pod.rank" not in r["settings"] for r in said["rungs"])
