"""Messages as rows of a table: columns with their units, by type of message."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from horizon_sensor_ros.ros.messages.message_types import (
    IMU,
    ORIENTATION,
    POSE,
    POSE_WITH_COVARIANCE,
    TWIST,
    TWIST_WITH_COVARIANCE,
    VECTOR,
)
from horizon_sensor_ros.ros.messages.stamps import ns_from_time
from horizon_sensor_ros.tools.bags.frame_files import stamp_text

_STAMP = ("stamp_s", "frame_id")
_LEAST_LEVEL = 1e-8  # cosine of a pitch: below it rounding decides on roll and yaw
_LEVELS = ("ok", "warn", "error", "stale")


@dataclass(frozen=True)
class MessageTable:
    """columns : names, each with its unit as a suffix. rows : a message's, one value a column."""

    columns: tuple[str, ...]
    rows: Callable[[Any], list[Sequence[Any]]]


def _vector(prefix: str, unit: str) -> tuple[str, ...]:
    return tuple(f"{prefix}{axis}{unit}" for axis in "xyz")


def _covariance(names: Sequence[str], units: Sequence[str]) -> tuple[str, ...]:
    """Names of the upper triangle's elements: cov_x_z_m2, cov_z_rot_x_m_rad."""
    found = []
    for i, (one, unit) in enumerate(zip(names, units, strict=True)):
        for other, other_unit in zip(names[i:], units[i:], strict=True):
            product = f"{unit}2" if unit == other_unit else f"{unit}_{other_unit}"
            found.append(f"cov_{one}_{other}_{product}")
    return tuple(found)


_POSE_COLUMNS = (
    *_vector("", "_m"), "qx", "qy", "qz", "qw", "roll_deg", "pitch_deg", "yaw_deg",
)  # fmt: skip
_TWIST_COLUMNS = (*_vector("v", "_m_s"), *_vector("w", "_rad_s"))
_ROTATIONS = tuple(f"rot_{axis}" for axis in "xyz")
_POSE_COVARIANCE = _covariance((*"xyz", *_ROTATIONS), ("m",) * 3 + ("rad",) * 3)
_TWIST_COVARIANCE = _covariance(("vx", "vy", "vz", "wx", "wy", "wz"), ("m_s",) * 3 + ("rad_s",) * 3)


def _xyz(vector: Any) -> tuple[float, float, float]:
    return vector.x, vector.y, vector.z


def _orientation(q: Any) -> tuple[float, ...]:
    """Quaternion, and the angles (deg) of Rz(yaw) Ry(pitch) Rx(roll); NaN where it is none. At a
    pitch of +-90 deg, where yaw and roll are the same turn, roll is 0.
    """
    values = (q.x, q.y, q.z, q.w)
    norm = float(np.linalg.norm(values))
    if not 0.99 < norm < 1.01:
        return (*values, np.nan, np.nan, np.nan)
    x, y, z, w = (value / norm for value in values)
    side, up = 2 * (w * x + y * z), 1 - 2 * (x * x + y * y)
    nose, level = 2 * (w * y - z * x), np.hypot(side, up)
    if level < _LEAST_LEVEL:
        roll, pitch = 0.0, np.copysign(np.pi / 2, nose)
        yaw = np.arctan2(2 * (w * z - x * y), 1 - 2 * (x * x + z * z))
    else:
        roll, pitch = np.arctan2(side, up), np.arctan2(nose, level)
        yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return (*values, *(float(angle) for angle in np.degrees([roll, pitch, yaw])))


def _pose(pose: Any) -> tuple[float, ...]:
    return (*_xyz(pose.position), *_orientation(pose.orientation))


def _twist(twist: Any) -> tuple[float, ...]:
    return (*_xyz(twist.linear), *_xyz(twist.angular))


def _upper(covariance: Any) -> list[float]:
    matrix = np.asarray(covariance, dtype=float)
    size = round(matrix.size**0.5)
    return [float(v) for v in matrix.reshape(size, size)[np.triu_indices(size)]]


def _stamped(columns: Sequence[str], values: Callable[[Any], Sequence[Any]]) -> MessageTable:
    def rows(msg: Any) -> list[Sequence[Any]]:
        stamp = msg.header.stamp
        start = (stamp_text(ns_from_time(stamp)), msg.header.frame_id)
        return [(*start, *values(msg))]

    return MessageTable((*_STAMP, *columns), rows)


_IMU_ROTATION = _covariance(("rot_x", "rot_y", "rot_z"), ("rad",) * 3)
_IMU_RATE = _covariance(("wx", "wy", "wz"), ("rad_s",) * 3)
_IMU_ACCELERATION = _covariance(("ax", "ay", "az"), ("m_s2",) * 3)

# Of the types that the nodes publish, and of references that are compared with them.
TABLES = {
    VECTOR: _stamped("xyz", lambda m: _xyz(m.vector)),
    POSE: _stamped(_POSE_COLUMNS, lambda m: _pose(m.pose)),
    POSE_WITH_COVARIANCE: _stamped(
        (*_POSE_COLUMNS, *_POSE_COVARIANCE),
        lambda m: (*_pose(m.pose.pose), *_upper(m.pose.covariance)),
    ),
    ORIENTATION: _stamped(_POSE_COLUMNS[3:], lambda m: _orientation(m.quaternion)),
    TWIST: _stamped(_TWIST_COLUMNS, lambda m: _twist(m.twist)),
    TWIST_WITH_COVARIANCE: _stamped(
        (*_TWIST_COLUMNS, *_TWIST_COVARIANCE),
        lambda m: (*_twist(m.twist.twist), *_upper(m.twist.covariance)),
    ),
    IMU: _stamped(
        (
            *_POSE_COLUMNS[3:],
            *_vector("w", "_rad_s"),
            *_vector("a", "_m_s2"),
            *(*_IMU_ROTATION, *_IMU_RATE, *_IMU_ACCELERATION),
        ),
        lambda m: (
            *_orientation(m.orientation),
            *(*_xyz(m.angular_velocity), *_xyz(m.linear_acceleration)),
            *_upper(m.orientation_covariance),
            *_upper(m.angular_velocity_covariance),
            *_upper(m.linear_acceleration_covariance),
        ),
    ),
}


def diagnostics_table(keys: Sequence[str]) -> MessageTable:
    """Table of diagnostics: a row a status, a column a key. Nodes of two craft have one name there,
    and their full names as hardware_id.
    """

    def rows(msg: Any) -> list[Sequence[Any]]:
        stamp = stamp_text(ns_from_time(msg.header.stamp))
        found: list[Sequence[Any]] = []
        for status in msg.status:
            # rclpy has a byte here, rosbags a number.
            level = ord(status.level) if isinstance(status.level, bytes) else int(status.level)
            values = {pair.key: pair.value for pair in status.values}
            word = _LEVELS[level] if level < len(_LEVELS) else str(level)
            of_all = (stamp, status.name, status.hardware_id, word, status.message)
            found.append((*of_all, *(values.get(key, "") for key in keys)))
        return found

    return MessageTable(("stamp_s", "name", "hardware_id", "level", "message", *keys), rows)
