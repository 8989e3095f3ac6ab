"""Samples of a running simulation to modald, by the C library: a push is as cheap as there.

    with modald.stream("rig7", ["root", "mid", "tip"], dt) as s:
        for y in simulation:
            s.push(y)
            if s.unstable:
                break

Without $MODALD_URL every call does nothing.  An exception closes the stream too and marks it as
broken off.
"""
from __future__ import annotations

import contextlib
import ctypes
import ctypes.util
import json
import os
import pathlib
import sys
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Iterable, Mapping, Sequence

import numpy as np
import numpy.typing as npt

VERDICTS = ("unknown", "stable", "unstable", "undecided")


class _Estimate(ctypes.Structure):
    _fields_ = [(name, ctypes.c_double) for name in ("frequency_hz", "frequency_std",
                                                     "damping_ratio", "damping_std", "sample")]


class _Report(ctypes.Structure):
    _fields_ = [(name, ctypes.c_double) for name in ("pushed", "acknowledged", "dropped", "waiting",
                                                     "spilled", "resampling_error", "refused")]


def _say(text: str) -> None:
    """One line for people, where there is somebody to read it."""
    with contextlib.suppress(OSError, ValueError, AttributeError):
        sys.stderr.write(f"modald: {text}\n")


@dataclass(frozen=True)
class Estimate:
    """The least damped mode of the last window; a std below 0 is not known."""

    frequency_hz: float
    frequency_std: float
    damping_ratio: float
    damping_std: float
    sample: float


@dataclass(frozen=True)
class Report:
    """Counts of samples."""

    pushed: float
    acknowledged: float
    dropped: float
    waiting: float
    spilled: float
    resampling_error: float
    refused: float


def _numbers(found: _Estimate | _Report) -> list[float]:
    return [getattr(found, name) for name, _ in found._fields_]


def _load() -> ctypes.CDLL:
    """$MODALD_LIBRARY, a build folder's, the one beside this file's prefix, or the system's."""
    named, build = os.environ.get("MODALD_LIBRARY"), os.environ.get("MODALD_BUILD")
    prefix = pathlib.Path(__file__).resolve().parents[3]
    places = [pathlib.Path(build) / "lib"] if build else []
    places += [prefix, *sorted(prefix.glob("*-linux-gnu*"))]
    beside = next((str(p / "libmodald-stream.so.0") for p in places
                   if (p / "libmodald-stream.so.0").exists()), None)
    lib = ctypes.CDLL(named or beside or ctypes.util.find_library("modald-stream")
                      or "libmodald-stream.so.0")
    pointer, number, text = ctypes.c_void_p, ctypes.c_double, ctypes.c_char_p
    for name, result, arguments in (
            ("modald_open", pointer, [text, ctypes.c_int, number]),
            ("modald_describe", None, [pointer, ctypes.POINTER(text), text, number]),
            ("modald_window", None, [pointer, ctypes.c_long, ctypes.c_long, text]),
            ("modald_alarms", None, [pointer, text]),
            ("modald_seek", None, [pointer, number]),
            ("modald_push_block", None, [pointer, pointer, ctypes.c_size_t]),
            ("modald_push_at", None, [pointer, number, pointer]),
            ("modald_verdict", ctypes.c_int, [pointer]),
            ("modald_get_estimate", ctypes.c_int, [pointer, ctypes.POINTER(_Estimate)]),
            ("modald_get_report", None, [pointer, ctypes.POINTER(_Report)]),
            ("modald_close", None, [pointer]),
            ("modald_close_all", None, [ctypes.POINTER(pointer), ctypes.c_size_t]),
            ("modald_abandon", None, [pointer])):
        function = getattr(lib, name)
        function.restype, function.argtypes = result, arguments
    return lib


def _json(given: str | Mapping[str, Any] | None) -> bytes | None:
    """A dictionary or its JSON text, as C takes it."""
    text = json.dumps(dict(given)) if isinstance(given, Mapping) else given
    return text.encode() if text else None


class Stream:
    """See the module.  `channels`: how many, or their names."""

    def __init__(self, name: str, channels: int | Sequence[str], dt: float, *,
                 units: str | None = None, period: float = 0.0,
                 window: int | None = None, hop: int | None = None,
                 options: str | Mapping[str, Any] | None = None,
                 alarms: str | Mapping[str, Any] | None = None):
        """As `stream`."""
        names = None if isinstance(channels, int) else list(channels)
        self.channels = channels if isinstance(channels, int) else len(channels)
        self._handle: int | None = None
        self._name, self._told = name, False
        self._last: tuple[str, Estimate | None, Report] = ("unknown", None, Report(*[0.0] * 7))
        if not os.environ.get("MODALD_URL"):
            return
        try:
            self._lib = _load()
        except OSError as why:
            _say(f"stream {name}: {why}; the run goes on without it")
            return
        self._handle = self._lib.modald_open(name.encode(errors="replace"), self.channels, dt)
        if self._handle and (names or units or period):
            array = (ctypes.c_char_p * self.channels)(*(n.encode(errors="replace")
                                                        for n in names)) if names else None
            self._lib.modald_describe(self._handle, array, units.encode() if units else None,
                                      period)
        if self._handle and window:
            self._lib.modald_window(self._handle, window, hop or window, _json(options))
        if self._handle and alarms:
            self._lib.modald_alarms(self._handle, _json(alarms))

    def _samples(self, y: npt.ArrayLike, one: bool = False) -> npt.NDArray[np.float64]:
        """Whole samples, or ONE of them, or none and a word on stderr.

        What would not end a run without a daemon does not end it with one.
        """
        try:
            rows = np.ascontiguousarray(y, dtype=np.float64)
            wrong = rows.size != self.channels if one else rows.size % self.channels
            what = "sample" if one else "samples"
            why = f"{rows.size} values are no {what} of {self.channels} channels" if wrong else ""
        except (TypeError, ValueError) as error:
            why = str(error)
        if why and not self._told:
            _say(f"stream {self._name}: {why}; they are left out")
            self._told = True
        return rows if not why else np.empty(0)

    def push(self, y: npt.ArrayLike) -> None:
        """One sample of all channels, or several: an array of rows."""
        if not self._handle:
            return
        rows = self._samples(y)
        if rows.size > 0:
            self._lib.modald_push_block(self._handle, rows.ctypes.data, rows.size // self.channels)

    def push_at(self, t: float, y: npt.ArrayLike) -> None:
        """A sample at its own time; the stream has it at multiples of dt."""
        if not self._handle:
            return
        row = self._samples(y, one=True)
        if row.size > 0:
            self._lib.modald_push_at(self._handle, t, row.ctypes.data)

    def seek(self, index: int) -> None:
        """The index of the next push, for a run that goes on from a checkpoint."""
        if self._handle:
            self._lib.modald_seek(self._handle, float(index))

    def _state(self) -> tuple[str, Estimate | None, Report]:
        """Verdict, estimate and counts now; after the end those of then."""
        if self._handle:
            estimate, report = _Estimate(), _Report()
            known = self._lib.modald_get_estimate(self._handle, ctypes.byref(estimate))
            self._lib.modald_get_report(self._handle, ctypes.byref(report))
            self._last = (VERDICTS[self._lib.modald_verdict(self._handle)],
                          Estimate(*_numbers(estimate)) if known else None,
                          Report(*_numbers(report)))
        return self._last

    @property
    def verdict(self) -> str:
        """Of the last window: stable, unstable, undecided, or unknown before there is one."""
        return self._state()[0]

    @property
    def unstable(self) -> bool:
        """Whether the last window was found to grow."""
        return self.verdict == "unstable"

    @property
    def estimate(self) -> Estimate | None:
        """The least damped mode of the last window, or None."""
        return self._state()[1]

    @property
    def report(self) -> Report:
        """Counts of samples; after the end those of just before it."""
        return self._state()[2]

    def close(self) -> None:
        """End the stream; verdict, estimate and report stay as they are."""
        self._state()
        if self._handle:
            self._lib.modald_close(self._handle)
        self._handle = None

    def abandon(self) -> None:
        """Close a run that was broken off; the record says so."""
        self._state()
        if self._handle:
            self._lib.modald_abandon(self._handle)
        self._handle = None

    def __enter__(self) -> "Stream":
        """Itself; `with` closes it, and an exception marks it as broken off."""
        return self

    def __exit__(self, kind: type[BaseException] | None, value: BaseException | None,
                 trace: TracebackType | None) -> None:
        """Close, or abandon after an exception."""
        if kind is None:
            self.close()
        else:
            self.abandon()


def close_all(streams: Iterable[Stream]) -> None:
    """End many streams at once: they are sent and sealed together, and waited for together."""
    ended = [s for s in dict.fromkeys(streams) if s._handle]
    for s in ended:
        s._state()
    if ended:
        handles = (ctypes.c_void_p * len(ended))(*(s._handle for s in ended))
        ended[0]._lib.modald_close_all(handles, len(ended))
    for s in ended:
        s._handle = None


def stream(name: str, channels: int | Sequence[str], dt: float, *, units: str | None = None,
           period: float = 0.0, window: int | None = None, hop: int | None = None,
           options: str | Mapping[str, Any] | None = None,
           alarms: str | Mapping[str, Any] | None = None) -> Stream:
    """Open a stream: `with modald.stream(name, channels, dt) as s`.

    `channels`: how many, or their names; `dt` [s] between samples, `period` [s] of a periodic
    system; windows of `window` samples each `hop` samples, identified with `options`,
    a dictionary or its JSON text; `alarms`, likewise, are rules over the windows' modes, such as
    {"damping_below": 0.02}.
    """
    return Stream(name, channels, dt, units=units, period=period, window=window, hop=hop,
                  options=options, alarms=alarms)
