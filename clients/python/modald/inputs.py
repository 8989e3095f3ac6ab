"""What a job is of: signals in memory or a scene, checked where they are given."""
from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any, Mapping, Sequence, Union

import numpy as np
import numpy.typing as npt

from . import wire
from .link import Error

Document = dict[str, Any]


def seconds(value: Any, field: str) -> float:
    """A number of seconds; Error with `field` where it is none."""
    try:
        return float(value)
    except (TypeError, ValueError) as why:
        raise Error("bad_input", f"{field} is {value!r}; accepted: a positive number of seconds",
                    field) from why


def as_array(value: Any) -> npt.NDArray[Any]:
    """Signals as an array; Error "signals" where they are not of one shape."""
    try:
        return np.asarray(value)
    except (TypeError, ValueError) as why:
        raise Error("bad_input", f"signals are not numbers of one shape: {why}",
                    "signals") from why


def scene_text(scene: Any) -> bytes:
    """A scene as it is sent and hashed; Error "scene" where it is no JSON."""
    try:
        return wire.scene_bytes(scene)
    except (TypeError, ValueError) as why:
        raise Error("bad_input", f"the scene is no JSON: {why}", "scene") from why


def _plain(value: Any) -> Any:
    """An attribute of HDF5 as JSON has it: numbers, text (there bytes of a fixed length), lists."""
    value = value.tolist() if hasattr(value, "tolist") else value
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    return [_plain(v) for v in value] if isinstance(value, list) else value


def _one(value: Any) -> Any:
    return value[0] if isinstance(value, list) and len(value) == 1 else value


def same_step(given: float | None, own: float, whose: str) -> float:
    """The step that a file or batch has; one given beside it must be the same, to 1e-9 of it."""
    if given is not None and not abs(seconds(given, "dt") - own) <= 1e-9 * own:
        why = f"dt is {given!r} s, but {whose} says {own!r} s; accepted: that, or no dt"
        raise Error("bad_input", why, "dt")
    return own


@dataclass
class Batch:
    """Signals at equal steps: `signals` float64, shape (samples, channels), `dt` [s] between
    samples, `period` [s] of a periodic system, `names` of the channels, their `units`, and whatever
    else a file says in `attributes`.
    """

    signals: npt.NDArray[np.float64]
    dt: float
    period: float | None = None
    names: Sequence[str] | None = None
    units: str | None = None
    attributes: Document | None = None

    def __post_init__(self) -> None:
        if getattr(self.signals, "dtype", None) is not None and np.iscomplexobj(self.signals):
            raise Error("bad_input", "signals are complex; accepted: real numbers, real and "
                        "imaginary parts as two channels", "signals")
        try:
            signals = np.asarray(self.signals, dtype="<f8")
        except (TypeError, ValueError) as why:
            raise Error("bad_input", f"signals are not numbers of one shape: {why}",
                        "signals") from why
        self.dt = seconds(self.dt, "dt")
        self.period = None if self.period is None else seconds(self.period, "period")
        self.signals = np.ascontiguousarray(signals[:, None] if signals.ndim == 1 else signals)
        if self.signals.ndim != 2:
            raise Error("bad_input", "signals must have one or two dimensions", "signals")

    @classmethod
    def read(cls, path: str | os.PathLike[str], dt: float | None = None) -> "Batch":
        """A batch of the usual layout from an HDF5 file (needs h5py); `modald.read` reads others.

        `dt` [s] where the file does not say, never against it.
        """
        try:
            import h5py
        except ImportError as why:
            raise Error("bad_input", "reading files needs h5py (Debian package python3-h5py)",
                        "file") from why
        try:
            file = h5py.File(path)
        except OSError as why:
            raise Error("bad_input", f"{path}: {why}", "file") from why
        with file:
            if not isinstance(file.get("signals"), h5py.Dataset):
                raise Error("bad_input", f"{path}: no dataset signals", "signals")
            data = file["signals"]
            found = {key: _plain(value) for key, value in {**file.attrs, **data.attrs}.items()}
            if "dt" not in found and dt is None:
                raise Error("bad_input", f"{path}: no attribute dt on signals or the root; give dt",
                            "dt")
            step = same_step(dt, seconds(_one(found["dt"]), "dt"), f"{path}: its attribute dt"
                              ) if "dt" in found else seconds(dt, "dt")
            names = found.pop("channels", None)
            units = found.pop("units", None)
            rest = {key: value for key, value in found.items() if key not in ("dt", "period")}
            return cls(data[...], step, _one(found["period"]) if "period" in found else None,
                       [str(n) for n in names] if names is not None else None,
                       str(units) if units is not None else None, rest or None)

    def description(self) -> Document:
        """As UPLOAD and SUBMIT describe it."""
        samples, channels = self.signals.shape
        out: Document = {"content": "batch", "samples": samples, "channels": channels,
                         "dt": self.dt}
        if self.period:
            out["period"] = self.period
        if self.names is not None:
            out["names"] = list(self.names)
        if self.units:
            out["units"] = self.units
        if self.attributes:
            out["attributes"] = self.attributes
        return out

    def bytes(self) -> memoryview:
        """The samples as they are sent: float64, little-endian, sample by sample."""
        flat = memoryview(self.signals.reshape(-1).data)
        return flat.cast("B") if self.signals.size else memoryview(b"")

    def sha256(self) -> str:
        """Its identity, 64 hexadecimal digits."""
        samples, channels = self.signals.shape
        return wire.batch_identity(self.bytes(), samples, channels, self.dt, self.period or 0.0,
                                   self.units or "", self.names)


Scene = Mapping[str, Any]
Input = Union[Batch, Scene, str]        # a str: "stream:NAME", the latest record of a stream


def as_sent(value: Input) -> tuple[Document, memoryview, str]:
    """Description, bytes and identity."""
    if isinstance(value, Batch):
        return value.description(), value.bytes(), value.sha256()
    if not isinstance(value, Mapping):
        raise Error("bad_input", f"a {type(value).__name__} is no input; accepted: a Batch, or "
                    "a scene as a dictionary", "input")
    text = scene_text(value)
    return {"content": "scene"}, memoryview(text), wire.scene_identity(text)
