"""Frames, checksums and identities of proto/PROTOCOL.md (sections 2, 4 and 7)."""
from __future__ import annotations

import hashlib
import json
import math
import struct
from typing import Any, Mapping, NoReturn, Sequence

import numpy as np

from .values import csr, plain

VERSION = b"MODALD1"
FRAMES_MOST, HEADER_MOST, BODY_MOST = 8, 65536, 1048576
INLINE_MOST, CHUNK_MOST, SCENE_MOST = 65536, 262144, 16777216
DOCUMENT_MOST = 67108864


def _table() -> tuple[int, ...]:
    def row(i: int) -> int:
        for _ in range(8):
            i = (i >> 1) ^ (0x82F63B78 if i & 1 else 0)
        return i
    return tuple(row(i) for i in range(256))


_TABLE = _table()


def _shift(crc: int, zeros: int) -> int:
    """The CRC register after `zeros` more zero bytes: x^(8 zeros) times it in the field."""
    def times(a: int, b: int) -> int:
        product = 0
        while b:
            if b & 0x80000000:
                product ^= a
            a = (a >> 1) ^ (0x82F63B78 if a & 1 else 0)
            b = (b << 1) & 0xFFFFFFFF
        return product
    power, square = 0x80000000, 0x00800000          # x^0 and x^8, the highest bit being x^0
    while zeros:
        if zeros & 1:
            power = times(power, square)
        square = times(square, square)
        zeros >>= 1
    return times(crc, power)


def crc32c(data: bytes | memoryview) -> int:
    """CRC-32C (Castagnoli) of `data`: `crc32c(b"123456789") == 3808858755`."""
    if len(data) < 4096:
        crc = 0xFFFFFFFF
        for byte in data:
            crc = (crc >> 8) ^ _TABLE[(crc ^ byte) & 0xFF]
        return crc ^ 0xFFFFFFFF
    return _crc32c_lanes(data)


def _crc32c_lanes(data: bytes | memoryview) -> int:
    """Equal lanes side by side by numpy, joined: CRC(a b) = shift(CRC(a), len b) + CRC(b)."""
    table = np.array(_TABLE, dtype=np.uint32)
    lanes = 1024
    length = len(data) // lanes
    block = np.frombuffer(data, dtype=np.uint8, count=lanes * length).reshape(lanes, length).T
    crc = np.zeros(lanes, dtype=np.uint32)
    crc[0] = 0xFFFFFFFF
    for column in block:
        crc = (crc >> np.uint32(8)) ^ table[(crc ^ column) & np.uint32(0xFF)]
    total = int(crc[0])
    step = _shift_table(length)
    for value in crc[1:].tolist():
        total = (step[0][total & 0xFF] ^ step[1][total >> 8 & 0xFF]
                 ^ step[2][total >> 16 & 0xFF] ^ step[3][total >> 24] ^ value)
    for byte in data[lanes * length:]:
        total = (total >> 8) ^ _TABLE[(total ^ byte) & 0xFF]
    return total ^ 0xFFFFFFFF


_SHIFTS: dict[int, list[list[int]]] = {}


def _shift_table(zeros: int) -> list[list[int]]:
    if zeros not in _SHIFTS:
        bits = [_shift(1 << i, zeros) for i in range(32)]

        def row(first: int, byte: int) -> int:
            out = 0
            for i in range(8):
                if byte >> i & 1:
                    out ^= bits[first + i]
            return out
        _SHIFTS[zeros] = [[row(8 * k, byte) for byte in range(256)] for k in range(4)]
    return _SHIFTS[zeros]


def _text(value: str) -> bytes:
    raw = value.encode()
    return struct.pack("<I", len(raw)) + raw


def batch_identity(data: bytes | memoryview, samples: int, channels: int, dt: float,
                   period: float = 0.0, units: str = "",
                   names: Sequence[str] | None = None) -> str:
    """SHA-256 of a batch: its canonical header, then its samples."""
    head = b"modald/batch/1\0" + struct.pack("<QQdd", samples, channels, dt, period) + _text(units
                                                                                             or "")
    head += b"".join(_text(name) for name in (names or [f"ch{i}" for i in range(channels)]))
    digest = hashlib.sha256(head)
    digest.update(data)
    return digest.hexdigest()


def scene_identity(text: bytes) -> str:
    """SHA-256 of a scene: its kind and length, then its text and what stands behind that."""
    digest = hashlib.sha256(b"modald/scene/1\0" + struct.pack("<Q", len(text)))
    digest.update(text)
    return digest.hexdigest()


def _refuse(constant: str) -> NoReturn:
    raise ValueError(f"{constant} is no JSON")


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    out = dict(pairs)
    if len(out) != len(pairs):
        raise ValueError("a key stands twice")
    return out


def loads(text: bytes | str) -> Any:
    """Strict JSON: no duplicate keys, NaN, Infinity, or numbers beyond a double."""
    def number(s: str) -> float:
        value = float(s)
        if not math.isfinite(value):
            raise ValueError(f"{s} is beyond a double")
        return value

    def whole(s: str) -> int:
        number(s)
        return int(s)
    try:
        return json.loads(text, object_pairs_hook=_unique, parse_constant=_refuse,
                          parse_float=number, parse_int=whole)
    except RecursionError as why:
        raise ValueError("nested too deeply") from why


def dumps(value: Any) -> bytes:
    """Strict JSON, without blanks; arrays and sparse matrices as `values.plain` has them."""
    return json.dumps(value, separators=(",", ":"), allow_nan=False, ensure_ascii=False,
                      default=plain).encode()


def scene_bytes(scene: Any) -> bytes:
    """A scene, a sweep of one, or a list with some, as it is sent: strict JSON and, where matrices
    of its structure are scipy.sparse, a zero byte and their arrays.
    """
    behind = bytearray()

    def placed(matrix: Any) -> dict[str, Any]:
        shape, arrays = csr(matrix)
        place = {"shape": list(shape), "entries": len(arrays[2]), "offset": len(behind)}
        for array in arrays:
            behind.extend(array.tobytes())
        return place

    def with_places(one: Any) -> Any:
        structure = one.get("structure") if isinstance(one, Mapping) else None
        if isinstance(structure, Mapping):
            one = {**one, "structure": {key: placed(value) if hasattr(value, "tocsr") else value
                                        for key, value in structure.items()}}
        elif isinstance(one, Mapping) and "scene" in one:
            one = {**one, "scene": with_places(one["scene"])}
        return one

    text = dumps([with_places(one) for one in scene] if isinstance(scene, list)
                 else with_places(scene))
    return text + b"\0" + behind if behind else text


def scene_lengths(data: memoryview) -> dict[str, int]:
    """Bytes of its text, as many as are looked at, and of what stands behind."""
    text = bytes(data[:SCENE_MOST + 1]).find(b"\0")
    return {"bytes": text, "arrays": len(data) - text} if text >= 0 else {"bytes": len(data)}


def encode(verb: str, header: dict[str, Any],
           *body: bytes | memoryview) -> list[bytes | memoryview]:
    """The frames of a request."""
    frames: list[bytes | memoryview] = [VERSION, verb.encode(), dumps(header), *body]
    if len(frames[2]) > HEADER_MOST or len(frames) > FRAMES_MOST or any(len(b) > BODY_MOST
                                                                        for b in body):
        raise ValueError("the message is larger than the protocol allows")
    return frames


def decode(frames: Sequence[bytes]) -> tuple[str, dict[str, Any], list[bytes]]:
    """Kind (REPLY, ERROR, EVENT), header and body of an answer."""
    if len(frames) < 3 or frames[0] != VERSION:
        raise ValueError("not a message of MODALD1")
    header = loads(frames[2])
    if not isinstance(header, dict) or type(header.get("id", 0)) not in (int, type(None)):
        raise ValueError("not a header of MODALD1")
    return frames[1].decode(), header, list(frames[3:])
