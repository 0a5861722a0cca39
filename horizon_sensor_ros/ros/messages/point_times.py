"""When each point of a PointCloud2 was measured, where the driver tells."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from horizon_sensor_ros.core.seconds import nearest_s_from_ns
from horizon_sensor_ros.ros.messages.data_bytes import bytes_of
from horizon_sensor_ros.ros.messages.refusal import Refusal

# What drivers call it: Ouster, Velodyne and others, Livox, Hesai and RoboSense.
NAMES = ("t", "time", "offset_time", "time_offset", "timestamp")
# sensor_msgs/PointField: INT32, UINT32, of nanoseconds; FLOAT32, FLOAT64, of seconds.
_KINDS = {5: "i4", 6: "u4", 7: "f4", 8: "f8"}
# A cloud takes less, and nearly all of its points were measured so near its stamp.
_MOST_S, _SHARE = 2.0, 0.99


@dataclass(frozen=True)
class PointTimes:
    """times_s : seconds from the stamp, NaN where they cannot be; None where they are not used.
    told : by which field, or why they are not used, for a person.
    """

    times_s: np.ndarray | None
    told: str


def point_times(msg: Any, points: np.ndarray, stamp: int) -> PointTimes:
    """Times of the points (H, W, 3) or (N, 3) of a cloud that could be read, in their shape.

    stamp : of the message, ns. Whole numbers are nanoseconds from it; others are seconds from it,
    or since the epoch that it counts from, or nanoseconds since then.
    """
    fields = {str(field.name): field for field in msg.fields}
    name = next((name for name in NAMES if name in fields), None)
    if name is None:
        return PointTimes(None, "points do not tell theirs")
    values = _values(msg, fields[name])
    if isinstance(values, str):
        return PointTimes(None, f"field {name} {values}: not used")
    values = values.reshape(points.shape[:-1])
    with np.errstate(invalid="ignore"):  # signalling NaN, of garbled messages
        returned = np.isfinite(points).all(axis=-1) & points.any(axis=-1)
    if not returned.any():
        return PointTimes(None, f"field {name}: no point")
    for times_s in _readings(values, stamp):
        near = np.abs(times_s) < _MOST_S
        if np.count_nonzero(near & returned) >= _SHARE * np.count_nonzero(returned):
            return PointTimes(np.where(near, times_s, np.nan), f"field {name}")
    first = values[returned][0]
    why = f"{first:g} is no time within {_MOST_S:g} s of the stamp"
    return PointTimes(None, f"field {name}: {why}: not used")


def _values(msg: Any, field: Any) -> np.ndarray | str:
    """(H, W) as they are; or what is wrong with the field."""
    kind = _KINDS.get(int(field.datatype))
    if kind is None:
        return f"is of datatype {int(field.datatype)}"
    dtype = np.dtype((">" if msg.is_bigendian else "<") + kind)
    point_step, row_step = int(msg.point_step), int(msg.row_step)
    if int(field.count) != 1 or int(field.offset) + dtype.itemsize > point_step:
        return "is not one value in a point"
    shape = int(msg.height), int(msg.width)
    data = bytes_of(msg, "cloud", "row_step", row_step * shape[0])
    if isinstance(data, Refusal):
        return data.reason
    return np.ndarray(shape, dtype, data, int(field.offset), (row_step, point_step))


def _readings(values: np.ndarray, stamp: int) -> list[np.ndarray]:
    """What values may mean, seconds from the stamp, the likeliest first."""
    with np.errstate(invalid="ignore", over="ignore"):
        if values.dtype.kind in "iu":
            return [nearest_s_from_ns(values)]
        told = values.astype(np.float64)
        return [told, told - nearest_s_from_ns(stamp), nearest_s_from_ns(told - stamp)]
