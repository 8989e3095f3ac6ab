"""Results as pictures, by matplotlib: each function draws one kind of document, and gives it."""
from __future__ import annotations

from typing import Any, Callable, Mapping

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from .link import Error

Document = Mapping[str, Any]


def modes(result: Document) -> Figure:
    """Damping over frequency with their error bars."""
    figure, axes = plt.subplots()
    found = result["modes"]
    std = [m.get("std") or {} for m in found]
    axes.errorbar([m["frequency_hz"] for m in found], [m["damping_ratio"] for m in found], fmt="o",
                  capsize=3, xerr=[s.get("frequency_hz") or 0 for s in std],
                  yerr=[s.get("damping_ratio") or 0 for s in std])
    axes.axhline(0, color="grey", lw=0.8)
    axes.set(xlabel="frequency, Hz", ylabel="damping ratio")
    return figure


def tradeoff(result: Document) -> Figure:
    """Error over seconds, both logarithmic; the data's own bound as a line."""
    figure, axes = plt.subplots()
    rungs = [r for r in result["rungs"] if r["error"] and r["seconds"]]
    for best, fill in ((True, "C0"), (False, "none")):
        some = [r for r in rungs if bool(r["pareto"]) is best]
        axes.scatter([r["seconds"] for r in some], [r["error"] for r in some], facecolors=fill,
                     edgecolors="C0")
    if result.get("bound"):
        axes.axhline(result["bound"], color="C3", ls="--", label="Cramér-Rao bound of the data")
        axes.legend()
    axes.set(xscale="log", yscale="log", xlabel="seconds", ylabel="error")
    return figure


def _size(point: Document, dof: int) -> float:
    harmonics = point["harmonics"][dof]
    sizes = np.hypot(harmonics["re"], harmonics["im"])
    return float(max((s for k, s in zip(harmonics["k"], sizes) if k > 0), default=np.nan))


def curve(result: Document, dof: int = 0) -> Figure:
    """Amplitude over the parameter: stable solid, unstable dashed, folds as thin lines."""
    figure, axes = plt.subplots()
    points = result["points"]
    x = np.array([p.get("value", p["omega"]) for p in points], dtype=float)
    y = np.array([_size(p, dof) for p in points])
    unstable = np.array([(p.get("stability") or {}).get("stable") is False for p in points],
                        dtype=bool)
    start = 0
    for end in range(1, len(points) + 1):
        if end == len(points) or unstable[end] != unstable[start]:
            last = min(end + 1, len(points))
            axes.plot(x[start:last], y[start:last], "C3--" if unstable[start] else "C0-")
            start = end
    for fold in result.get("folds", []):
        axes.axvline(fold["omega"], color="grey", lw=0.6)
    axes.set(xlabel=result["parameter"], ylabel="largest |X_k|")
    return figure


def orbit(result: Document, dof: int = 0) -> Figure:
    """Spectrum and orbit of a steady state."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4))
    h = result["harmonics"][dof]
    k, x = np.array(h["k"]), np.array(h["re"]) + 1j * np.array(h["im"])
    tones = result.get("tones")
    w = k @ np.array(tones) if tones else k * result["omega"]
    left.stem(w if tones else k, np.abs(x))
    left.set(xlabel="frequency, rad/s" if tones else "harmonic k", ylabel="|X_k|", yscale="log")
    span = 16 * np.pi / min(tones) if tones else 2 * np.pi / result["omega"]
    turn = np.exp(1j * np.outer(np.linspace(0, span, 400), w))
    right.plot((turn @ x).real, (turn @ (1j * w * x)).real)
    right.set(xlabel=h["dof"], ylabel="its velocity")
    return figure


def multipliers(result: Document) -> Figure:
    """Multipliers and the unit circle."""
    figure, axes = plt.subplots()
    turn = np.linspace(0, 2 * np.pi, 200)
    axes.plot(np.cos(turn), np.sin(turn), "grey", lw=0.8)
    pairs = np.array([p for p in result["multipliers"] if p is not None], dtype=float).reshape(-1,
                                                                                               2)
    axes.plot(pairs[:, 0], pairs[:, 1], "o")
    axes.set(xlabel="Re multiplier", ylabel="Im", aspect="equal")
    return figure


def exponents(result: Document) -> Figure:
    """Exponents in their plane, and the imaginary axis."""
    figure, axes = plt.subplots()
    pairs = np.array([p for p in result["exponents"] if p is not None], dtype=float).reshape(-1, 2)
    axes.plot(pairs[:, 0], pairs[:, 1], "o")
    axes.axvline(0, color="grey", lw=0.8)
    axes.set(xlabel="Re exponent, 1/s", ylabel="Im, 1/s")
    return figure


_KINDS: dict[str, Callable[[Document], Figure]] = {
    "identify": modes, "tradeoff": tradeoff, "floquet": multipliers}


def of(result: Document, dof: int = 0) -> Figure:
    """The picture of a result of any kind that has one; `dof` counts those of a steady one."""
    kind = result.get("kind")
    if kind == "steady":
        return orbit(result, dof)
    if kind == "curve":
        return curve(result, dof)
    if kind == "floquet" and "multipliers" not in result:
        return exponents(result)
    if kind not in _KINDS:
        raise Error("bad_input", f"a result of {kind} has no picture; accepted: identify, steady, "
                    "curve, floquet, tradeoff", "kind")
    return _KINDS[kind](result)


def use(backend: str) -> None:
    """Choose matplotlib's backend, such as "agg" where there is no screen."""
    matplotlib.use(backend)
