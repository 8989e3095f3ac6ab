"""A result as a small SVG, for notebooks, with nothing installed."""
from __future__ import annotations

import html
import math
from typing import Any, Mapping, Sequence

Document = Mapping[str, Any]
WIDTH, HEIGHT, LEFT, BELOW, EDGE = 480.0, 260.0, 70.0, 36.0, 10.0      # px
TICKS = 4
# each: x, y, half an error bar's length in y
Points = Sequence[tuple[float, float, float]]


def size(dof: Document) -> float:
    """The largest |X_k|, k > 0, of one dof's harmonics, in the unit of x; NaN without any."""
    return max((math.hypot(re, im) for k, re, im in zip(dof["k"], dof["re"], dof["im"])
                if not isinstance(k, int) or k > 0), default=math.nan)


def _scale(low: float, high: float, a: float, b: float) -> tuple[float, float]:
    """Slope and offset that take low .. high to a .. b."""
    slope = (b - a) / 2 / (high / 2 - low / 2) if high / 2 > low / 2 else 0.0
    return slope, (a if slope else (a + b) / 2) - slope * low


def _axes(points: Points, x_name: str, y_name: str, line: bool) -> str:
    points = [p for p in points if math.isfinite(p[0]) and math.isfinite(p[1])]
    if not points:
        return ""
    low = min(0.0, min(y - e for _, y, e in points)), max(0.0, max(y + e for _, y, e in points))
    side = min(x for x, _, _ in points), max(x for x, _, _ in points)
    ax, bx = _scale(*side, LEFT + EDGE, WIDTH - 2 * EDGE)
    ay, by = _scale(*low, HEIGHT - BELOW, EDGE)
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH:g}" height="{HEIGHT:g}" '
           f'font-family="sans-serif" font-size="11"><rect x="{LEFT:g}" y="{EDGE:g}" '
           f'width="{WIDTH - LEFT - EDGE:g}" height="{HEIGHT - BELOW - EDGE:g}" fill="none" '
           'stroke="#999"/>']
    for i in range(TICKS + 1):
        x, y = (span[0] * (1 - i / TICKS) + span[1] * (i / TICKS) for span in (side, low))
        out.append(f'<text x="{ax * x + bx:.1f}" y="{HEIGHT - BELOW + 13:g}" '
                   f'text-anchor="middle">{x:.4g}</text><text x="{LEFT - 4:g}" '
                   f'y="{ay * y + by + 4:.1f}" text-anchor="end">{y:.3g}</text>')
    out.append(f'<text x="{(LEFT + WIDTH) / 2:g}" y="{HEIGHT - 6:g}" text-anchor="middle">'
               f'{html.escape(x_name)}</text><text x="{LEFT + 6:g}" y="{EDGE + 13:g}">'
               f'{html.escape(y_name)}</text>')
    places = [(ax * x + bx, ay * y + by, abs(ay) * e) for x, y, e in points]
    if line:
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y, _ in places)
        out.append(f'<polyline points="{path}" fill="none" stroke="#06c"/>')
    for x, y, e in places:
        if e > 0:
            out.append(f'<path d="M{x:.1f} {y - e:.1f}V{y + e:.1f}" stroke="#06c"/>')
        out.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{2 if line else 3}" fill="#06c"/>')
    return "".join(out) + "</svg>"


def draw(result: Document) -> str:
    """Modes: damping over frequency; a steady state: |X_k| of its first dof; a curve: its largest;
    multipliers or exponents in their plane; a tradeoff: error over seconds, by powers of ten.
    "" of other kinds.
    """
    kind = result.get("kind")
    if kind == "identify":
        return _axes([(m["frequency_hz"], m["damping_ratio"],
                       (m.get("std") or {}).get("damping_ratio") or 0.0) for m in result["modes"]],
                     "frequency, Hz", "damping ratio", False)
    if kind == "steady" and result["harmonics"]:
        dof = result["harmonics"][0]
        if not all(isinstance(k, int) for k in dof["k"]):
            return ""
        return _axes([(k, math.hypot(re, im), 0.0)
                      for k, re, im in zip(dof["k"], dof["re"], dof["im"])],
                     "harmonic k", f"|X_k| of {dof['dof']}", True)
    if kind == "curve":
        found = [(p.get("value", p.get("omega")), size(p["harmonics"][0]), 0.0)
                 for p in result["points"] if p.get("harmonics")]
        return _axes(found, str(result["parameter"]), "largest |X_k| of the first dof", True)
    if kind == "floquet":
        name = "multipliers" if "multipliers" in result else "exponents"
        return _axes([(z[0], z[1], 0.0) for z in result[name] if z is not None], f"Re, {name}",
                     "Im", False)
    if kind == "tradeoff":
        return _axes([(math.log10(r["seconds"]), math.log10(r["error"]), 0.0)
                      for r in result["rungs"] if r["error"] and r["seconds"]], "lg seconds",
                     "lg error", False)
    return ""
