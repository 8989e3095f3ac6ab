"""A result: the document that the daemon gave, with its numbers as arrays, tables and pictures."""
from __future__ import annotations

import functools
import html
from typing import Any, Callable, Concatenate, ParamSpec, TypeVar

import numpy as np
import numpy.typing as npt

from . import picture
from .link import Error

Floats = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]
Row = dict[str, Any]


def _pair(pair: Any) -> complex:
    return complex(np.nan, np.nan) if pair is None else complex(*pair)


def _number(value: Any) -> float:
    return np.nan if value is None else float(value)


T = TypeVar("T")
P = ParamSpec("P")


def _read(read: Callable[Concatenate["Result", P], T]) -> Callable[Concatenate["Result", P], T]:
    """A member that says where the document is none of modald-result(5), whoever sent it."""
    @functools.wraps(read)
    def told(self: "Result", /, *args: P.args, **more: P.kwargs) -> T:
        try:
            return read(self, *args, **more)
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as why:
            raise Error("bad_frame", f"the result is none of modald-result(5): {why!r}") from why
    return told


class Result(dict[str, Any]):
    """A dictionary as in modald-result(5), and the same as arrays.

    Arrays of an identification have one entry a mode, in the order of `result["modes"]` (by
    amplitude); what is null in the document is NaN.
    """

    def _modes(self) -> list[Row]:
        if "modes" not in self:
            raise Error("bad_input", f"a result of {self.get('kind')} has no modes; accepted: one "
                        "of identify", "kind")
        return list(self["modes"])

    def _each(self, name: str) -> Floats:
        return np.array([_number(mode.get(name)) for mode in self._modes()], dtype=float)

    def _std(self, name: str) -> Floats:
        return np.array([_number((mode.get("std") or {}).get(name)) for mode in self._modes()],
                        dtype=float)

    def _pairs(self, of_modes: str, of_all: str) -> Complex:
        if of_all in self:
            return np.array([_pair(pair) for pair in self[of_all]], dtype=complex)
        return np.array([_pair(mode.get(of_modes)) for mode in self._modes()], dtype=complex)

    @property
    @_read
    def frequency_hz(self) -> Floats:
        """|exponent| / 2 pi of each mode, Hz; shape (modes,)."""
        return self._each("frequency_hz")

    @property
    @_read
    def damping_ratio(self) -> Floats:
        """-Re exponent / |exponent| of each mode: positive decays; shape (modes,)."""
        return self._each("damping_ratio")

    @property
    @_read
    def std_frequency_hz(self) -> Floats:
        """Standard errors of `frequency_hz`, Hz; shape (modes,), NaN where they are not known."""
        return self._std("frequency_hz")

    @property
    @_read
    def std_damping_ratio(self) -> Floats:
        """Standard errors of `damping_ratio`; shape (modes,), NaN where they are not known."""
        return self._std("damping_ratio")

    @property
    @_read
    def amplitude(self) -> Floats:
        """Rms of each mode's part of the record, channels scaled to unit rms; shape (modes,)."""
        return self._each("amplitude")

    @property
    @_read
    def residual(self) -> Floats:
        """Of each mode, as modald-result(5) says; shape (modes,)."""
        return self._each("residual")

    @property
    @_read
    def exponent(self) -> Complex:
        """Characteristic exponents, 1/s, complex: one of each pair of an identification, shape
        (modes,); all of a floquet result, shape (states,)."""
        return self._pairs("exponent", "exponents")

    @property
    @_read
    def multiplier(self) -> Complex:
        """Multipliers, complex, over one period, or one sample where there is none; shape as of
        `exponent`."""
        return self._pairs("multiplier", "multipliers")

    @property
    @_read
    def shapes(self) -> Complex:
        """Mode shapes, complex, largest component 1; shape (modes, channels).

        They are there if they were asked for: option `shapes`.
        """
        modes = self._modes()
        if any("shape" not in mode for mode in modes):
            raise Error("bad_input", "the result has no shapes; ask for them by the option "
                        "shapes=true", "shapes")
        return np.array([[_pair(pair) for pair in mode["shape"]] for mode in modes], dtype=complex)

    # -- tables and pictures ----------------------------------------------------------------------

    @_read
    def rows(self) -> list[Row]:
        """The result as a table, flat dictionaries: a mode of an identification, a harmonic of a
        dof, a point of a curve or sweep, a multiplier or exponent, a rung or an effect each."""
        return _TABLES.get(str(self.get("kind")), _nothing)(self)

    def to_pandas(self) -> Any:
        """`rows()` as a pandas.DataFrame (Error where pandas is not installed)."""
        try:
            import pandas
        except ImportError as why:
            raise Error("bad_input", "to_pandas needs pandas (Debian package python3-pandas)",
                        "pandas") from why
        return pandas.DataFrame(self.rows())

    @_read
    def svg(self) -> str:
        """A small picture, SVG text; "" where the kind of result has none."""
        return picture.draw(self)

    def _check_dof(self, dof: int) -> None:
        kind = self.get("kind")
        first = [self] if kind == "steady" else self["points"][:1] if kind == "curve" else []
        for count in (len(one["harmonics"]) for one in first):
            if not -count <= dof < count:
                raise Error("bad_input", f"no dof {dof}; accepted: 0 to {count - 1}", "dof")

    @_read
    def plot(self, dof: int = 0) -> Any:
        """A matplotlib.figure.Figure of `modald.plots`; `dof` counts those of a steady result."""
        try:
            from . import plots
        except ImportError as why:
            raise Error("bad_input", "plot needs matplotlib (Debian package python3-matplotlib)",
                        "matplotlib") from why
        self._check_dof(dof)
        return plots.of(self, dof)

    @_read
    def _repr_html_(self) -> str:
        """For notebooks: verdict, table, notes, picture."""
        table = self.rows()[:SHOWN_MOST]
        names = list(dict.fromkeys(name for row in table for name in row))
        head = "".join(f"<th>{html.escape(name)}</th>" for name in names)
        body = "".join("<tr>" + "".join(f"<td>{html.escape(_short(row.get(name)))}</td>"
                                        for name in names) + "</tr>" for row in table)
        notes = "".join(f"<li><b>{html.escape(str(note.get('code')))}</b>: "
                        f"{html.escape(str(note.get('message')))}</li>"
                        for note in self.get("diagnostics") or [])
        return (f"<div><p>{html.escape(self._headline())}</p><table><tr>{head}</tr>{body}</table>"
                f"<ul>{notes}</ul>{self.svg()}</div>")

    def _headline(self) -> str:
        verdict = self.get("stability") or {}
        words = {True: "stable", False: "unstable", None: "stability undecided"}
        said = [str(self.get("kind", "result"))]
        if "converged" in self:
            said.append("converged" if self["converged"] else "not converged")
        if "stable" in verdict:
            said.append(words[verdict["stable"]])
        return ", ".join(said)


SHOWN_MOST = 50             # rows of a table in a notebook: a page


def _short(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else "" if value is None else str(value)


def _modes(result: Result) -> list[Row]:
    rows = []
    for mode in result["modes"]:
        std, exponent = mode.get("std") or {}, _pair(mode.get("exponent"))
        rows.append({"frequency_hz": mode["frequency_hz"],
                     "frequency_hz_std": std.get("frequency_hz"),
                     "damping_ratio": mode["damping_ratio"],
                     "damping_ratio_std": std.get("damping_ratio"),
                     "re": exponent.real, "im": exponent.imag, "amplitude": mode.get("amplitude"),
                     "residual": mode.get("residual"), "k": mode.get("resolved_k")})
    return rows


def _harmonics(result: Result) -> list[Row]:
    return [{"dof": dof["dof"], "k": k, "re": re, "im": im, "magnitude": float(np.hypot(re, im))}
            for dof in result["harmonics"]
            for k, re, im in zip(dof["k"], dof["re"], dof["im"])]


def _points(result: Result) -> list[Row]:
    rows = []
    for point in result["points"]:
        row: Row = {result["parameter"]: point.get("value", point.get("omega")),
                    "converged": point.get("converged"),
                    "stable": (point.get("stability") or {}).get("stable")}
        row.update({dof["dof"]: picture.size(dof) for dof in point.get("harmonics") or []})
        rows.append(row)
    return rows


def _shares(result: Result) -> list[Row]:
    return [{**{f"index{i}": value for i, value in enumerate(point.get("index") or [])},
             **{name: value for name, value in point.items()
                if isinstance(value, (int, float, str, bool))},
             "stable": (point.get("stability") or {}).get("stable")} for point in result["points"]]


def _spectrum(result: Result) -> list[Row]:
    name = "multiplier" if "multipliers" in result else "exponent"
    found = result.multiplier if name == "multiplier" else result.exponent
    return [{"of": name, "re": z.real, "im": z.imag, "magnitude": abs(z)} for z in found.tolist()]


def _rungs(result: Result) -> list[Row]:
    return [{"settings": ", ".join(f"{k}={v}" for k, v in (rung.get("settings") or {}).items()),
             "error": rung["error"], "seconds": rung["seconds"], "pareto": rung["pareto"]}
            for rung in result["rungs"]]


def _effects(result: Result) -> list[Row]:
    return [{"type": effect["type"], "seconds": effect["seconds"], **(effect.get("change") or {})}
            for effect in result["effects"]]


def _nothing(result: Result) -> list[Row]:
    return []


_TABLES: dict[str, Callable[[Result], list[Row]]] = {
    "identify": _modes, "steady": _harmonics, "curve": _points, "sweep": _shares,
    "floquet": _spectrum, "tradeoff": _rungs, "ablate": _effects}
