"""Stamps of messages as nanoseconds, and back; and of these and seconds the one as the other."""

from __future__ import annotations

from typing import Any, overload

import numpy as np
from builtin_interfaces.msg import Time

from horizon_sensor_ros.ros.messages.refusal import Refusal

NANOSECONDS = 1_000_000_000  # in a second


def ns_from_s(seconds: float) -> int:
    """Return seconds in nanoseconds, to the nearest."""
    return round(seconds * NANOSECONDS)


@overload
def s_from_ns(nanoseconds: int) -> float: ...


@overload
def s_from_ns(nanoseconds: np.ndarray) -> np.ndarray: ...


def s_from_ns(nanoseconds: int | np.ndarray) -> float | np.ndarray:
    """Return nanoseconds, of any shape, in seconds."""
    return nanoseconds * 1e-9


def ns_from_time(time: Any) -> int:
    """Nanoseconds of a `builtin_interfaces/Time`."""
    return time.sec * NANOSECONDS + time.nanosec


def stamp_ns(msg: Any) -> int | Refusal:
    """Nanoseconds of a message's header stamp."""
    sec, nanosec = int(msg.header.stamp.sec), int(msg.header.stamp.nanosec)
    if not 0 <= nanosec < NANOSECONDS:
        return Refusal("bad_stamp", f"stamp has {nanosec} nanoseconds")
    return sec * NANOSECONDS + nanosec


def repeated_stamp(stamp: int) -> Refusal:
    """Why a message with the stamp of the one before is not used."""
    why = "stamp repeats the last one's"
    if stamp == 0:
        why += ": it is zero, so nobody sets it"
    return Refusal("repeated_stamp", why)


def time_from_ns(stamp: int) -> Time:
    """Message of nanoseconds."""
    return Time(sec=stamp // NANOSECONDS, nanosec=stamp % NANOSECONDS)
