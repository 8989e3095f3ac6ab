"""A batch larger than the memory limit is identified where it lies in its file: what is resident at
a time stays below the limit.
"""
import json
import resource
import subprocess

import h5py
import numpy as np
import pytest
import sanitized
from conftest import BUILD, environment

SAMPLES, CHANNELS, DT = 5200, 5000, 0.02
LIMIT = 160 << 20                # of 208 MB of samples
FREQUENCY, DAMPING = np.array([0.7, 2.1, 5.2]), np.array([0.002, 0.003, 0.001])
NOISE = 1e-3

pytestmark = pytest.mark.skipif(sanitized.SANITIZED,
                                reason="a sanitizer's own memory is larger than the limit")


@pytest.fixture(scope="module")
def large(tmp_path_factory):
    """Written part by part, so that the test needs no more memory than what it tests."""
    path, rng = tmp_path_factory.mktemp("large") / "large.h5", np.random.default_rng(3)
    w = 2 * np.pi * FREQUENCY
    poles = w * (-DAMPING + 1j * np.sqrt(1 - DAMPING**2))
    shape = rng.standard_normal((3, CHANNELS)) + 1j * rng.standard_normal((3, CHANNELS))
    with h5py.File(path, "w") as f:
        signals = f.create_dataset("signals", (SAMPLES, CHANNELS), "f8")
        signals.attrs["dt"] = DT
        for k in range(0, SAMPLES, 200):
            e = np.exp(np.outer(DT * np.arange(k, k + 200), poles))
            signals[k:k + 200] = (e @ shape).real + NOISE * rng.standard_normal((200, CHANNELS))
    return path


def test_a_batch_larger_than_the_memory_limit_stays_below_it(large):
    run = subprocess.run([str(BUILD / "bin" / "modalctl"), "--local", "--json", "identify",
                          str(large)], capture_output=True, timeout=300,
                         env=environment(OPENBLAS_NUM_THREADS=1),
                         preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_DATA,
                                                               (LIMIT, LIMIT)))
    assert run.returncode == 0, run.stderr
    result = json.loads(run.stdout)
    assert result["cost"]["peak_bytes"] < LIMIT
    found = np.array(sorted((m["frequency_hz"], m["damping_ratio"]) for m in result["modes"]))
    assert found.shape == (3, 2)
    # an undamped line in L S samples is known to sqrt(6) NOISE / (amplitude pi T sqrt(L S)) = 2e-9
    # Hz; decay and 5 sigma are well within 100 times that
    assert np.allclose(found[:, 0], FREQUENCY, rtol=0, atol=2e-7)
    assert np.allclose(found[:, 1], DAMPING, rtol=0, atol=4e-7)
