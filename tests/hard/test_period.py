# Tests as well: identify_slip.c
"""Records of periodic systems whose turns are not those of the period that was given."""
import os
import pathlib
import sys

import numpy as np
import pytest

BUILD = pathlib.Path(os.environ.get("MODALD_BUILD", pathlib.Path(__file__).parents[2] / "build"))
sys.path.insert(0, str(pathlib.Path(__file__).parents[1] / "bench"))
import bench_identify_periodic as turning

EXPONENTS = np.array([-.031 + 1.13j, -.052 + 2.37j])


def motion(rng, turn, decibel):
    """Two multipliers, each with three lines, at what has turned by each sample."""
    y = np.zeros((len(turn), 2))
    for k in range(-1, 2):
        shape = (rng.normal(size=(2, 2)) + 1j * rng.normal(size=(2, 2))) * 0.5 ** abs(k)
        y += (np.exp(np.outer(turn, EXPONENTS + 2j * np.pi * k)) @ shape).real
    return y + y.std() * 10 ** (-decibel / 20) * rng.normal(size=y.shape)


def answer(y, each, monkeypatch):
    monkeypatch.setattr(turning, "CTL", str(BUILD / "bin" / "modalctl"))
    document = turning.identify({"y": y, "p": each})
    codes = {d["code"] for d in document["diagnostics"]} - {"aliases", "near_tie"}
    return document, codes


def check_modes(document, factor):
    """Exponents in turns, as many a second as FACTOR."""
    found = [complex(*m["exponent"]) for m in document["modes"]]
    assert len(found) == 2
    for z in EXPONENTS * factor:
        near = min(range(2), key=lambda i: abs(found[i] - z))
        std = document["modes"][near]["std"]["exponent"]
        assert abs(found[near].real - z.real) < 5 * std[0]
        assert abs(found[near].imag - z.imag) < 5 * std[1]
    assert document["stability"]["stable"] is True


@pytest.mark.parametrize("share", [0.001, 0.003, 0.01])
def test_a_speed_that_changes_is_told_and_makes_no_motion_grow(share, monkeypatch):
    """Ten of twelve such records were unstable or undecided, of 3 to 8 multipliers for two."""
    rng = np.random.default_rng([14, round(1000 * share)])
    for _ in range(4):
        t = np.arange(45 * 20) / 20
        turn = t * (1 + share * t / 45)
        document, codes = answer(motion(rng, turn, 40), 20, monkeypatch)
        assert codes == {"period_drifts"}
        check_modes(document, turn[-1] / t[-1])


@pytest.mark.parametrize("held", [False, True])
def test_a_speed_that_changes_is_told_beside_a_spike_and_samples_that_are_held(held, monkeypatch):
    """What slips is not taken for wild samples: these had 8 or 9 multipliers for two."""
    rng = np.random.default_rng(1416)
    t = np.arange(60 * 32) / 32
    for _ in range(3):
        y = motion(rng, t * (1 + 0.004 * t / 60), 45)
        y[rng.integers(100, 1800), 0] += 8 * y.std()
        if held:
            y[-8:] = y[-8]
        document, codes = answer(y, 32, monkeypatch)
        assert codes == {"period_drifts", "wild_samples"}
        assert len(document["modes"]) == 2 and document["stability"]["stable"] is True


@pytest.mark.parametrize("each", [20, 20.37])
@pytest.mark.parametrize("wrong", [0.002, -0.02])
def test_a_period_that_is_not_the_records_is_told_and_the_records_is_taken(wrong, each,
                                                                         monkeypatch):
    rng = np.random.default_rng(14)
    for _ in range(3):
        y = motion(rng, np.arange(int(45 * each)) / each, 40)
        document, codes = answer(y, each * (1 + wrong), monkeypatch)
        assert codes == {"wrong_period"}
        # in the unit of turning.identify(): the period given is one
        period = document["provenance"]["options"]["period"]
        assert period * (1 + wrong) == pytest.approx(1, abs=1e-4)
        check_modes(document, 1 + wrong)


def test_a_constant_system_keeps_any_period(monkeypatch):
    """No line of any mode tells of a period."""
    rng = np.random.default_rng(7)
    for _ in range(3):
        t = np.arange(45 * 20) / 20
        y = np.zeros((len(t), 2))
        for z in (-.03 + 1.13j, -.05 + 2.37j, -.04 + 9.2j):
            y += np.outer(np.exp(z * t), rng.normal(size=2) + 1j * rng.normal(size=2)).real
        y += 0.01 * y.std() * rng.normal(size=y.shape)
        document, codes = answer(y, 20, monkeypatch)
        assert not codes and len(document["modes"]) == 3
