"""Free responses of many lightly damped modes, the order found by itself, beside ESPRIT in numpy
that is told the order.

One JSON line a figure; `ratio` is the peer's processor time over ours.  Ours is all of `modalctl
--local`, errors included; the peer's one eigendecomposition of the Gram matrix of a block Hankel
matrix and one of the shift, without errors, amplitudes or refinement.  A mode counts where its
bound on frequency is below a third of the distance to the next; it is hit within three bounds in
both parts of the exponent, and a mode of ours that is nearest to none of the truth is spurious.
"""
import json, os, resource, subprocess, sys, tempfile, time
import h5py
import numpy as np

MODALCTL = os.path.join(os.environ.get("MODALD_BUILD", "build"), "bin", "modalctl")
DT = 0.01
SIZES = [(16000, 10, m, 60) for m in (20, 50, 100, 200, 300)]


def record(n, channels, modes, snr, seed):
    """Random spacings, the least 0.3 of their mean."""
    random = np.random.default_rng(seed)
    gaps = 0.3 + 0.7 * random.exponential(size=modes + 1)
    omega = 2 * np.pi * (1 + (0.45 / DT - 1) * np.cumsum(gaps)[:modes] / gaps.sum())
    zeta = random.uniform(1e-4, 1e-3, modes)
    poles = -zeta * omega + 1j * omega * np.sqrt(1 - zeta**2)
    shapes = random.normal(size=(modes, channels)) + 1j * random.normal(size=(modes, channels))
    y = (np.exp(np.outer(np.arange(n) * DT, poles)) @ shapes).real
    noise = y.std() * 10 ** (-snr / 20)
    return y + noise * random.normal(size=y.shape), poles, shapes, noise


def bounds(poles, shapes, noise, n):
    """Cramer-Rao: deviations of the parts of each exponent, all modes and amplitudes unknown."""
    m, t = len(poles), (np.arange(n) * DT)[:, None]
    centre = 1 / np.maximum(2 / (n * DT), -poles.real)
    E = np.exp(t * poles)
    D = E * t / centre
    basis = (np.stack([E.real, -E.imag], 2).reshape(n, 2 * m),
             np.stack([D.real, -D.imag], 2).reshape(n, 2 * m))
    R = np.linalg.qr(np.hstack(basis), "r")[2 * m:, 2 * m:]
    normal, i = R.T @ R, np.arange(m)
    fisher = np.zeros((2 * m, 2 * m))
    for b in shapes.T:
        K = np.zeros((2 * m, 2 * m))
        K[2 * i, 2 * i] = K[2 * i + 1, 2 * i + 1] = b.real
        K[2 * i + 1, 2 * i], K[2 * i, 2 * i + 1] = b.imag, -b.imag
        fisher += K.T @ normal @ K
    deviations = noise * np.sqrt(np.diag(np.linalg.inv(fisher)))
    return deviations[0::2] / centre, deviations[1::2] / centre


def ours(y, folder):
    path = os.path.join(folder, "record.h5")
    with h5py.File(path, "w") as file:
        file.create_dataset("signals", data=y).attrs["dt"] = DT
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    answer = json.loads(subprocess.run([MODALCTL, "--local", "--json", "identify", path],
                                       capture_output=True, check=True).stdout)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    found = np.array([complex(*mode["exponent"]) for mode in answer["modes"]])
    return found, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def esprit(y, modes):
    """Rows for twice the exponents."""
    before, channels = time.process_time(), y.shape[1]
    rows = 4 * modes // channels + 2
    windows = np.lib.stride_tricks.sliding_window_view(y, rows, axis=0)
    H = windows.transpose(2, 1, 0).reshape(rows * channels, -1)
    U = np.linalg.eigh(H @ H.T)[1][:, -2 * modes:]
    shift = np.linalg.lstsq(U[:-channels], U[channels:], rcond=None)[0]
    poles = np.log(np.linalg.eigvals(shift)) / DT
    return poles[poles.imag > 0], time.process_time() - before


def score(found, poles, bound):
    """Modes that count, hits among them, spurious."""
    gap = np.abs(np.subtract.outer(poles.imag, poles.imag)) + np.diag(np.full(len(poles), np.inf))
    counts = bound[1] < gap.min(1) / 3
    off = np.maximum(np.abs(np.subtract.outer(poles.real, found.real)) / bound[0][:, None],
                     np.abs(np.subtract.outer(poles.imag, found.imag)) / bound[1][:, None])
    near = np.unique(np.abs(np.subtract.outer(poles, found)).argmin(1)) if len(found) else []
    hits = int((off[counts].min(1) <= 3).sum()) if len(found) else 0
    return int(counts.sum()), hits, len(found) - len(near)


def main():
    seed = int(sys.argv[1]) if len(sys.argv) > 1 else 0
    with tempfile.TemporaryDirectory() as folder:
        for n, channels, modes, snr in SIZES:
            y, poles, shapes, noise = record(n, channels, modes, snr, seed)
            bound = bounds(poles, shapes, noise, n)
            found, seconds = ours(y, folder)
            told, peer_seconds = esprit(y, modes)
            counts, hits, spurious = score(found, poles, bound)
            case = f"{n} x {channels}, {modes} modes, {snr} dB"
            for what, value, peer in (("modes that count", counts, counts),
                                      ("hits", hits, score(told, poles, bound)[1]),
                                      ("spurious", spurious, score(told, poles, bound)[2])):
                print(json.dumps({"bench": "many_modes", "case": f"{case}: {what}", "value": value,
                                  "unit": "modes", "peer": peer,
                                  "ratio": None, "n": 1}))
            print(json.dumps({"bench": "many_modes", "case": case, "value": round(seconds, 3),
                              "unit": "s", "peer": round(peer_seconds, 3),
                              "ratio": round(peer_seconds / seconds, 3), "n": 1}), flush=True)


main()
