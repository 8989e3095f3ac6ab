#!/usr/bin/python3
"""Random free responses with known truth: order right, modes missed, spurious ones, cover of the
errors.

    MODALCTL=build/bin/modalctl tests/bench/bench_identify_random.py [count] [seed] [least modes]
    [most modes]

Each record: 1 to 14 modes in 1 to 30 channels, 200 to 4000 samples, 10 to 80 dB of white noise or
none, some with a close pair, with growth, with an offset, all at scales from 1e-8 to 1e8.  A mode
is *detectable* where the chi-squared lost without it, the others refitted in the linear model at
the true parameters, is three times what a pair costs in the criterion (order.h).  Only records
whose modes are all detectable count for the order.  A verdict is asked of records in which a mode
grows, or all decay, by five of their Cramer-Rao bounds.  Where modes that are not detectable lie
so near that one between them pays, it is no true one, and spurious; such as take their price of
the motion without its noise are counted apart.  Told by cells of noise and modes, then all
together.
"""
import json
import math
import os
import subprocess
import sys
import tempfile
import h5py
import numpy as np

CTL = os.environ.get("MODALCTL", "modalctl")
DETECTABLE = 3


def exponents(rng, modes, dt, record):
    """Frequencies over the Nyquist band, damping log-uniform; sometimes two a fraction of 1/record
    apart, sometimes one that grows.
    """
    w = (np.exp(rng.uniform(np.log(4 * np.pi / record), np.log(0.8 * np.pi / dt), modes))
         if rng.random() < 0.5 \
        else rng.uniform(4 * np.pi / record, 0.8 * np.pi / dt, modes))
    zeta = np.exp(rng.uniform(np.log(1e-4), np.log(0.1), modes))
    sigma = np.minimum(zeta * w, 30 / record * rng.uniform(0.05, 1, modes))
    if modes > 1 and rng.random() < 0.2:
        w[1] = w[0] + 2 * np.pi * rng.uniform(0.3, 3) / record
        sigma[1] = sigma[0] * rng.uniform(0.5, 2)
    if rng.random() < 0.15:
        sigma[0] = -rng.uniform(0.2, 3) / record
    return -sigma + 1j * w


def record(seed, least=1, most=14):
    rng = np.random.default_rng(seed)
    modes, S = int(rng.integers(least, most + 1)), int(rng.integers(1, 31))
    n = int(np.exp(rng.uniform(np.log(200), np.log(4000))))
    dt = 10.0 ** rng.uniform(-4, 0)
    t = np.arange(n) * dt
    lam = exponents(rng, modes, dt, n * dt)
    shape = (rng.normal(size=(modes, S)) + 1j
             * rng.normal(size=(modes, S))) * np.exp(rng.normal(size=modes) * 0.7)[:, None]
    if rng.random() < 0.5:
        shape = shape.real * np.exp(1j * rng.uniform(0, 2 * np.pi, modes))[:, None]
    basis = np.exp(np.outer(t, lam))
    basis /= np.abs(basis).max(axis=0)
    offset = rng.random() < 0.2
    y = (basis @ shape).real + (rng.normal(size=S) if offset else 0)
    snr = None if rng.random() < 0.08 else rng.uniform(10, 80)
    noise = 0 if snr is None else np.sqrt(np.mean(y ** 2)) * 10 ** (-snr / 20)
    y = y + noise * rng.normal(size=y.shape)
    scale = 10.0 ** rng.uniform(-8, 8)
    return dict(y=y * scale, dt=dt, exponents=lam, basis=basis, shape=shape, noise=noise,
                offset=offset, snr=snr, t=t)


def losses(r):
    """Chi-squared lost without each mode, the others refitted: their amplitudes in every channel,
    their exponents in common.
    """
    y, t, n = r["y"], r["t"], len(r["t"])
    S, noise = y.shape[1], max(r["noise"], 1e-13)
    real = [np.column_stack([b.real, -b.imag]) for b in r["basis"].T]
    lost = []
    for j in range(len(real)):
        others = [k for k in range(len(real)) if k != j]
        phi = (np.column_stack([real[k] for k in others] + ([np.ones(n)] if r["offset"] else []))
               if others or r["offset"] else np.zeros((n, 0)))
        q = np.linalg.qr(phi)[0] if phi.shape[1] else phi
        def left(x):
            return x - q @ (q.T @ x)
        target = left((r["basis"][:, [j]] * r["shape"][j]).real)
        tangents = []
        for k in others:
            d = (t / t[-1])[:, None] * r["basis"][:, [k]] * r["shape"][k]
            tangents += [left(d.real).ravel(), left((1j * d).real).ravel()]
        x = target.ravel()
        if tangents:
            a = np.column_stack(tangents)
            x = x - a @ np.linalg.lstsq(a, x, rcond=None)[0]
        lost.append(float(x @ x) / noise ** 2)
    return lost


def pair_price(n, S):
    return (2 * S + 2 * (1 + 1 / S)) * math.log(n * S)


def identify(y, dt, options=(), timeout=300):
    """The result, or None where the time was over, and its CPU seconds."""
    import resource
    with tempfile.TemporaryDirectory() as d:
        with h5py.File(d + "/r.h5", "w") as h:
            h.create_dataset("signals", data=y).attrs["dt"] = dt
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        try:
            p = subprocess.run([CTL, "--local", "--json", "identify", d + "/r.h5", *options],
                               capture_output=True, text=True, timeout=timeout)
        except subprocess.TimeoutExpired:
            return None, timeout
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return json.loads(p.stdout), after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def match(modes, lam, record):
    """Pairs (truth, mode) nearest first, each once, within 2/record or a fifth of the damping."""
    found = [complex(*m["exponent"]) for m in modes]
    pairs = sorted((abs(f - z), i, k) for i, z in enumerate(lam) for k, f in enumerate(found)
                   if abs(f - z) < 2 / record + 0.3 * abs(z.real))
    used_i, used_k, out = set(), set(), []
    for d, i, k in pairs:
        if i not in used_i and k not in used_k:
            used_i.add(i), used_k.add(k), out.append((i, k))
    return out


def bounds(r):
    """Cramer-Rao: deviations of the real part of each exponent, all else unknown."""
    t, m = r["t"], len(r["exponents"])
    real = [np.column_stack([b.real, -b.imag]) for b in r["basis"].T]
    q = np.linalg.qr(np.column_stack(real + ([np.ones(len(t))] if r["offset"] else [])))[0]
    slope = np.hstack([b * (t / t[-1])[:, None] for b in real])
    R = np.linalg.qr(slope - q @ (q.T @ slope), "r")
    fisher, i = np.zeros((2 * m, 2 * m)), np.arange(m)
    for a in r["shape"].T:
        K = np.zeros((2 * m, 2 * m))
        K[2 * i, 2 * i] = K[2 * i + 1, 2 * i + 1] = a.real
        K[2 * i, 2 * i + 1], K[2 * i + 1, 2 * i] = -a.imag, a.imag
        fisher += (R @ K).T @ (R @ K)
    return np.sqrt(np.abs(np.diag(np.linalg.inv(fisher)))[::2]) * r["noise"] / t[-1]


def is_clear(r):
    """Whether the sign of growth is beyond five bounds: of a mode that grows, or of every mode
    where none does."""
    growth = r["exponents"].real
    bound = bounds(r)
    return (growth > 5 * bound).any() or (growth < -5 * bound).all()


def drawn(r, modes, k):
    """Chi-squared that mode K takes of the motion without its noise, beside the other MODES as they
    are."""
    y, left = (r["basis"] @ r["shape"]).real, []
    for kept in (range(len(modes)), [i for i in range(len(modes)) if i != k]):
        lam = np.array([complex(*modes[i]["exponent"]) for i in kept])
        late = np.where(lam.real > 0, r["t"][-1], 0)
        b = np.exp(lam * (r["t"][:, None] - late))
        phi = np.column_stack([b.real, b.imag, np.ones(len(y))])
        left.append(np.sum((y - phi @ np.linalg.lstsq(phi, y, rcond=None)[0]) ** 2))
    return (left[1] - left[0]) / max(r["noise"], 1e-13) ** 2


def one(seed, least, most):
    r = record(seed, least, most)
    n, S = r["y"].shape
    seen = [x >= DETECTABLE * pair_price(n, S) for x in losses(r)]
    d, cpu = identify(r["y"], r["dt"])
    out = dict(seed=seed, snr=r["snr"], modes=len(seen), seen=sum(seen), cpu=cpu, lost=0, more=0,
               inside=0, errors=0, refused=d is None or "modes" not in d, false=False)
    if out["refused"]:
        return out
    pairs = match(d["modes"], r["exponents"], n * r["dt"])
    hit, stable = {i for i, _ in pairs}, d["stability"]["stable"]
    out["lost"] = sum(1 for i, v in enumerate(seen) if v and i not in hit)
    extra = set(range(len(d["modes"]))) - {k for _, k in pairs}
    out["more"] = len(extra)
    out["drawn"] = all(drawn(r, d["modes"], k) >= pair_price(n, S) for k in extra)
    out["clear"] = r["noise"] > 0 and is_clear(r)
    out["decided"] = stable is not None
    out["false"] = stable is not None and stable != (r["exponents"].real.max() < 0)
    for i, k in pairs if r["noise"] > 0 else []:
        m = d["modes"][k]
        if seen[i] and m["std"]["exponent"][0] is not None:
            e = np.array(m["exponent"]) - [r["exponents"][i].real, r["exponents"][i].imag]
            out["inside"] += int(sum(np.abs(e) <= 1.96 * np.array(m["std"]["exponent"])))
            out["errors"] += 2
    if out["lost"] or out["more"] or out["false"] or (out["clear"] and not out["decided"]):
        print(seed, f"{len(seen)} modes {sum(seen)} detectable, {S} ch x {n}, "
              f"{r['snr'] and round(r['snr'])} dB: missed {out['lost']} spurious {out['more']} "
              f"stable {stable}", [x["code"] for x in d["diagnostics"]], flush=True)
    return out


def tell(name, rows):
    total = {k: sum(x.get(k, 0) for x in rows)
             for k in ("seen", "lost", "inside", "errors", "refused", "false", "clear", "cpu")}
    judged = [x for x in rows if x["seen"] == x["modes"]]
    print(f"{name}: {len(rows)} records, order right "
          f"{sum(not x['lost'] and not x['more'] for x in judged)} of {len(judged)} with every "
          f"mode detectable, missed {total['lost']} of {total['seen']} detectable modes, "
          f"{sum(x['more'] > 0 for x in rows)} records with a spurious mode "
          f"({sum(x['more'] > 0 and x['drawn'] for x in rows)} where it draws motion of modes "
          f"that none could tell), {total['refused']} "
          f"refused, {total['inside'] / max(total['errors'], 1):.3f} of {total['errors']} "
          f"components within 1.96 std, verdicts: {total['false']} false, decided "
          f"{sum(x.get('clear', 0) and x['decided'] for x in rows)} of {total['clear']} beyond "
          f"five bounds, {total['cpu']:.1f} s CPU")


SNR = ((10, 25), (25, 45), (45, 65), (65, 81))
ORDER = ((1, 3), (4, 6), (7, 10), (11, 99))


def main():
    count, seed = (int(x) if len(sys.argv) > i + 1 else v
                   for i, (x, v) in enumerate(zip((sys.argv + [0, 0])[1:3], (100, 1))))
    least, most = (int(sys.argv[3]), int(sys.argv[4])) if len(sys.argv) > 4 else (1, 14)
    rows = [one(s, least, most) for s in range(seed, seed + count)]
    for low, high in SNR:
        for few, many in ORDER:
            cell = [x for x in rows if x["snr"] is not None and low <= x["snr"] < high
                    and few <= x["modes"] <= many]
            if cell:
                tell(f"{low} to {high} dB, {few} to {many} modes", cell)
    tell("no noise", [x for x in rows if x["snr"] is None])
    tell(f"all from seed {seed}", rows)


if __name__ == "__main__":
    main()
