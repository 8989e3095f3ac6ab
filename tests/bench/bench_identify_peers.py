"""Identification beside its peers on the same matrix in the same run: scipy's svds, harminv, and
PyDMD where $PYDMD holds its folder.

One JSON line a figure; `ratio` is the peer's processor time over ours.  Ours is `modalctl --local`,
the whole job without reading the file.  A peer that is not at hand is left out.
"""
import json, os, shutil, subprocess, sys, tempfile, time
import h5py
import numpy as np

MODALCTL = os.path.join(os.environ.get("MODALD_BUILD", "build"), "bin", "modalctl")


# records; times our own error over them, which is about the bound: what counts as accurate
DRAWS, NEAR = 7, 1.5


def poles(f, z):
    w = 2 * np.pi * np.asarray(f)
    return -np.asarray(z) * w + 1j * w * np.sqrt(1 - np.asarray(z) ** 2)


def decay(rng, lam, channels, samples, dt, snr):
    t = np.arange(samples) * dt
    b = rng.standard_normal((len(lam), channels)) + 1j * rng.standard_normal((len(lam), channels))
    y = (np.exp(np.outer(t, lam)) @ b).real
    return y + np.sqrt(np.mean(y ** 2) * 10 ** (-snr / 10)) * rng.standard_normal(y.shape)


def error(found, lam):
    return max(min(abs(z - l) / abs(l) for z in found) for l in lam)


def ours(y, dt, lam, runs):
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "batch.h5")
        with h5py.File(path, "w") as f:
            f.create_dataset("signals", data=y).attrs["dt"] = dt
        seconds = []
        for _ in range(runs):
            out = subprocess.run([MODALCTL, "--local", "--json", "identify", path],
                                 capture_output=True, text=True, check=True)
            doc = json.loads(out.stdout)
            seconds.append(doc["cost"]["cpu_s"])
        wrong = error([complex(*m["exponent"]) for m in doc["modes"]], lam)
        assert wrong < 1e-2, f"identify is wrong by {wrong}"
        return sorted(seconds)[runs // 2], wrong


def timed(call, runs):
    seconds = []
    for _ in range(runs):
        start = time.process_time()
        value = call()
        seconds.append(time.process_time() - start)
    return sorted(seconds)[runs // 2], value


def line(case, value, peer, theirs, n, **more):
    print(json.dumps({"bench": "identify_peers", "case": case, "value": value, "unit": "s CPU",
                      "peer": peer, "ratio": theirs / value, "n": n, **more}), flush=True)


def svds(y, k):
    from scipy.sparse.linalg import svds as leading
    return leading(y, k=k)[1]


def pydmd(y, dt, delays, rank):
    from pydmd import HankelDMD
    dmd = HankelDMD(svd_rank=rank, d=delays, opt=False).fit(y.T)
    return np.log(dmd.eigs.astype(complex)) / dt


def delayed(y, d):
    """d delays of every channel, rows, by time, columns."""
    return np.vstack([np.lib.stride_tricks.sliding_window_view(y[:, c], len(y) - d + 1)[:d]
                      for c in range(y.shape[1])])


def bopdmd(y, dt, delays, rank):
    from pydmd import BOPDMD
    x = delayed(y, delays) if delays > 1 else y.T
    dmd = BOPDMD(svd_rank=rank, num_trials=0,
                 eig_constraints={"conjugate_pairs"}).fit(x, np.arange(x.shape[1]) * dt)
    return dmd.eigs.astype(complex)


def best_accurate(settings, draws, lam, near):
    """Of (name, call) the fastest whose error over the draws, root mean square, is no more than
    `near`: name, seconds, error; None where none is.
    """
    best = None
    for name, call in settings:
        try:
            runs = [timed(lambda: call(y), 1) for y in draws]
        except (ValueError, FloatingPointError, np.linalg.LinAlgError):
            continue
        seconds, wrong = float(np.median([t for t, _ in runs])), float(
            np.sqrt(np.mean([error(found, lam) ** 2 for _, found in runs])))
        if wrong <= near and (best is None or seconds < best[1]):
            best = name, seconds, wrong
    return best


def harminv(y, dt):
    text = "\n".join(repr(float(v)) for v in y[:, 0])
    return subprocess.run(["harminv", "-t", str(dt), "0.3-6"], input=text, capture_output=True,
                          text=True, check=True).stdout


def child_seconds(call):
    before = os.times()
    call()
    after = os.times()
    return (after.children_user + after.children_system - before.children_user
            - before.children_system)


def main():
    rng, dt = np.random.default_rng(20261121), 0.05
    if os.environ.get("PYDMD"):
        sys.path.insert(0, os.environ["PYDMD"])
    lam = poles([1.0, 2.3, 4.1], [0.01, 0.005, 0.02])
    y = decay(rng, lam, 3, 1200, dt, 40)
    own, wrong = ours(y, dt, lam, 9)
    m = 600
    h = np.vstack([np.lib.stride_tricks.sliding_window_view(y[:, c], 1200 - m + 1)[:m]
                   for c in range(3)])
    line("3 x 1200, 6 poles, 40 dB", own, "scipy svds on the Hankel matrix",
         timed(lambda: svds(h, 6), 5)[0], 5, error=wrong)
    if shutil.which("harminv"):
        line("3 x 1200, 6 poles, 40 dB", own, "harminv, one channel",
             child_seconds(lambda: harminv(y, dt)), 1, error=wrong)
    try:
        settings = [(f"PyDMD HankelDMD d={d}", lambda y, d=d: pydmd(y, dt, d, 6))
                    for d in (20, 60, 200, 400, 600)]
        settings += [(f"PyDMD BOPDMD on {d} delays", lambda y, d=d: bopdmd(y, dt, d, 6))
                     for d in (5, 10, 20, 40)]
        draws = [decay(rng, lam, 3, 1200, dt, 40) for _ in range(DRAWS)]
        wrong = float(np.sqrt(np.mean([ours(y, dt, lam, 1)[1] ** 2 for y in draws])))
        best = best_accurate(settings, draws, lam, NEAR * wrong)
        if best is not None:
            line("3 x 1200, 6 poles, 40 dB", own, best[0] + ", its fastest accurate setting",
                 best[1], DRAWS, error=wrong, peer_error=best[2])
    except ImportError:
        pass
    lam = poles([0.6, 1.1, 1.9, 2.7, 3.6, 4.8], [0.01, 0.02, 0.005, 0.015, 0.01, 0.008])
    y = decay(rng, lam, 20000, 1000, dt, 60)
    own, wrong = ours(y, dt, lam, 3)
    line("20000 x 1000, 12 poles, 60 dB", own, "scipy svds, 12 triplets alone",
         timed(lambda: svds(y, 12), 3)[0], 3, error=wrong)
    try:
        theirs, found = timed(lambda: pydmd(y, dt, 4, 12), 1)
        line("20000 x 1000, 12 poles, 60 dB", own, "PyDMD HankelDMD d=4", theirs, 1, error=wrong,
             peer_error=error(found, lam))
    except ImportError:
        pass


if __name__ == "__main__":
    main()
