"""Stamps of messages as nanoseconds, and back."""

from __future__ import annotations

from typing import Any

from builtin_interfaces.msg import Time

from horizon_sensor_ros.core.seconds import NANOSECONDS
from horizon_sensor_ros.ros.messages.refusal import Refusal


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
