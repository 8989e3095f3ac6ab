"""Random free responses that were once answered wrongly, drawn by bench_identify_random.py and
judged by its truth: every mode there, none besides.
"""
import os
import pathlib
import sys

import pytest

BUILD = pathlib.Path(os.environ.get("MODALD_BUILD", pathlib.Path(__file__).parents[2] / "build"))
sys.path.insert(0, str(pathlib.Path(__file__).parents[1] / "bench"))
import bench_identify_random as drawn


@pytest.mark.parametrize("seed", [777119],
                         ids=["14 modes in 244 rows: a crowd with shapes of its own"])
def test_each_mode_is_found_and_no_other(seed, monkeypatch):
    monkeypatch.setattr(drawn, "CTL", str(BUILD / "bin" / "modalctl"))
    r = drawn.record(seed)
    document, _ = drawn.identify(r["y"], r["dt"])
    pairs = drawn.match(document["modes"], r["exponents"], len(r["y"]) * r["dt"])
    assert len(pairs) == len(r["exponents"]) == len(document["modes"])
    assert not any(d["code"] == "amplitude_dependent" for d in document["diagnostics"])


def test_a_search_that_does_not_settle_is_not_left_for_one_that_explains_far_less(monkeypatch):
    """13 modes in 317 rows, five of them within a beat of each other, at 72 dB: the eight others
    are found; the search by rising order ends at six modes, which leave a quarter of the signals.
    """
    monkeypatch.setattr(drawn, "CTL", str(BUILD / "bin" / "modalctl"))
    r = drawn.record(790217, 8, 14)
    document, _ = drawn.identify(r["y"], r["dt"])
    found = [complex(*mode["exponent"]) for mode in document["modes"]]
    record = len(r["y"]) * r["dt"]
    apart = [z for z in r["exponents"] if z.imag * record > 30]
    assert len(apart) == 8
    assert all(min(abs(f - z) for f in found) * record < 0.1 for z in apart)
    assert document["stability"]["stable"] is None
