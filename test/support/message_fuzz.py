"""Messages gone wrong: any field of any message set to anything that its type can hold."""

from __future__ import annotations

import array
import math
import re
from collections.abc import Iterator
from typing import Any

import numpy as np
from rosidl_parser.definition import (
    AbstractString,
    Array,
    BasicType,
    BoundedSequence,
    NamespacedType,
    UnboundedSequence,
)

from horizon_sensor_ros.ros.messages.images import ENCODINGS

_SEQUENCES = (Array, BoundedSequence, UnboundedSequence)
_FLOATS = [
    *(0.0, -0.0, 1.0, -1.0, math.nan, math.inf, -math.inf),
    *(1e300, -1e300, 1e-300, 5e-324, 1e30, -1e9, 1e9, 0.5, 3.14),
]
_STRINGS = [
    *("", " ", "\n", "a" * 10_000, "/", "..", "%s%n", "\u202e", "\U0001f30d", "\x00", "camera_1"),
    *("plumb_bob", "rational_polynomial", "equidistant", "thin_prism_fisheye", "mono8; rm"),
    *("earth", "base_link", "x", "y", "z", "rgb", "32FC1", "yuv422", "8UC3", *ENCODINGS),
]
_INTEGER = re.compile(r"(u?)int(\d+)")


def leaves(msg: Any, path: str = "") -> Iterator[tuple[Any, str, Any, str]]:
    """Each settable field: its owner, its name, its type, and the path to it from the message."""
    names = type(msg).get_fields_and_field_types()
    for name, kind in zip(names, type(msg).SLOT_TYPES, strict=True):
        where = f"{path}.{name}" if path else name
        if isinstance(kind, NamespacedType):
            yield from leaves(getattr(msg, name), where)
            continue
        yield msg, name, kind, where
        if isinstance(kind, _SEQUENCES) and isinstance(kind.value_type, NamespacedType):
            for item in getattr(msg, name)[:4]:
                yield from leaves(item, where)


def corrupt(msg: Any, rng: np.random.Generator) -> list[str]:
    """Set one to three random fields to something else; return their paths."""
    changed = []
    for _ in range(rng.integers(1, 4)):
        fields = list(leaves(msg))
        owner, name, kind, where = fields[rng.integers(len(fields))]
        setattr(owner, name, _any_value(kind, getattr(owner, name), rng))
        changed.append(where)
    return changed


def _any_value(kind: Any, value: Any, rng: np.random.Generator) -> Any:
    if isinstance(kind, AbstractString):
        return _STRINGS[rng.integers(len(_STRINGS))]
    if isinstance(kind, _SEQUENCES):
        return _any_sequence(kind, value, rng)
    return _any_number(kind, rng)


def _any_number(kind: BasicType, rng: np.random.Generator) -> Any:
    if kind.typename == "boolean":
        return bool(rng.integers(2))
    found = _INTEGER.fullmatch(kind.typename)
    if kind.typename == "octet" or found is None:
        if kind.typename in ("float", "double"):
            if rng.random() < 0.7:
                return _FLOATS[rng.integers(len(_FLOATS))]
            return float(rng.normal() * 10.0 ** rng.integers(-9, 9))
        return bytes([int(rng.integers(256))])
    bits = int(found[2])
    low, high = (0, 2**bits - 1) if found[1] else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    edges = [0, 1, 2, 3, 7, 8, 64, 1000, low, high, high - 1]
    if rng.random() < 0.7:
        return edges[rng.integers(len(edges))]
    return int(rng.integers(low, high, endpoint=True, dtype=np.uint64 if found[1] else np.int64))


def _any_sequence(kind: Any, value: Any, rng: np.random.Generator) -> Any:
    items = list(value) if isinstance(kind.value_type, NamespacedType) else value
    if isinstance(kind, Array):
        changed = list(items)
        for _ in range(rng.integers(1, len(changed) + 1)):
            changed[rng.integers(len(changed))] = _any_number(kind.value_type, rng)
        return changed
    if isinstance(kind.value_type, NamespacedType):
        # Fewer, twice as many, or in another order.
        return [items[i] for i in rng.integers(0, len(items), rng.integers(2 * len(items) + 1))]
    if kind.value_type.typename == "uint8":
        return array.array("B", _any_bytes(bytes(items), rng))
    return array.array("d", [_any_number(kind.value_type, rng) for _ in range(rng.integers(15))])


def _any_bytes(data: bytes, rng: np.random.Generator) -> bytes:
    """Cut off, too long, noise, all alike, or with some bytes wrong."""
    pixels = np.frombuffer(data, np.uint8)
    match rng.integers(5):
        case 0:
            return data[: rng.integers(len(data) + 1)]
        case 1:
            return data + bytes(int(rng.integers(1, 1000)))
        case 2:
            return rng.integers(0, 256, len(data), dtype=np.uint8).tobytes()
        case 3:
            return bytes([int(rng.integers(256))]) * len(data)
        case _:
            wrong = pixels.copy()
            where = rng.integers(0, max(len(data), 1), len(data) // 100)
            wrong[where] = rng.integers(0, 256, len(where), dtype=np.uint8)
            return wrong.tobytes()
