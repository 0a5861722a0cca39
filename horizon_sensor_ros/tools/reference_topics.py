"""Nadir and altitude from other instruments' topics, or from a simulation's truth."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from horizon_sensor_ros.core.mathematics.attitude import nadir_sign
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.ros.messages.aiding import EARTH_FRAME
from horizon_sensor_ros.ros.messages.estimates import LEVEL_FRAME
from horizon_sensor_ros.ros.messages.geometry import rotation_of, xyz_of
from horizon_sensor_ros.ros.messages.message_types import IMU, POSE, POSE_WITH_COVARIANCE, VECTOR
from horizon_sensor_ros.tools.command_errors import CommandError

POSE_TYPES = (POSE, POSE_WITH_COVARIANCE)
NADIR_TYPES = (VECTOR, *POSE_TYPES, IMU)


def nadir_of(msg: Any, msgtype: str, level_z: str, base_frame: str) -> np.ndarray | None:
    """Nadir (3,) in the base frame that a message tells; None where it tells none.

    A Vector3Stamped is nadir itself. A pose is that of the base frame in the level frame
    (`level_z` says where its z points). An Imu's orientation is taken in a world frame with z up;
    without one (first covariance -1) what it feels at rest is up. Raises CommandError for a frame
    that nadir cannot be told from.
    """
    if msgtype == VECTOR:
        _require_frame(msg, base_frame, "vectors")
        return _unit(xyz_of(msg.vector))
    if msgtype == IMU:
        _require_frame(msg, base_frame, "measurements")
        if msg.orientation_covariance[0] == -1.0:
            felt = msg.linear_acceleration
            return _unit([-felt.x, -felt.y, -felt.z])
        return _down_in_base(msg.orientation, -1.0)
    _require_frame(msg, LEVEL_FRAME, "poses")
    return _down_in_base(_pose(msg).orientation, nadir_sign(level_z))


def altitude_of(msg: Any, planet: Planet) -> float | None:
    """Altitude (m) above the planet's mean radius that a pose tells; None where it tells none.

    In the level frame it is the distance along z, in the frame `earth` (ECEF, REP 105) that from
    the centre.
    """
    position = _pose(msg).position
    if msg.header.frame_id == LEVEL_FRAME:
        altitude = abs(position.z)
    elif msg.header.frame_id == EARTH_FRAME:
        altitude = float(np.linalg.norm(xyz_of(position)))
        altitude -= planet.mean_radius_m
    else:
        raise CommandError(
            f"its poses are in {msg.header.frame_id!r}, not in {LEVEL_FRAME!r} or {EARTH_FRAME!r}"
        )
    return altitude if np.isfinite(altitude) else None


class Series:
    """Values over time, to be asked for between them."""

    def __init__(self, max_gap_ns: int) -> None:
        self._max_gap = max_gap_ns
        self._rows: list[tuple[int, np.ndarray]] = []
        self._stamps: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self._rows)

    def add(self, stamp: int, value: np.ndarray | float) -> None:
        """Take a value of a time (ns)."""
        self._rows.append((stamp, np.atleast_1d(value)))
        self._stamps = None

    def at(self, stamp: int) -> np.ndarray | None:
        """Value at a time (ns), linear between two neighbours; None in a gap or outside."""
        if self._stamps is None:
            self._rows.sort(key=lambda row: row[0])
            self._stamps = np.array([row[0] for row in self._rows], dtype=np.int64)
        after = int(np.searchsorted(self._stamps, stamp))
        if after < len(self) and self._stamps[after] == stamp:
            return self._rows[after][1]
        if not 0 < after < len(self):
            return None
        (begin, early), (end, late) = self._rows[after - 1 : after + 1]
        if end - begin > self._max_gap:
            return None
        return early + (stamp - begin) / (end - begin) * (late - early)


def _require_frame(msg: Any, frame: str, what: str) -> None:
    """Refuse another frame, and none, as the nodes do."""
    if msg.header.frame_id != frame:
        raise CommandError(f"its {what} are in {msg.header.frame_id!r}, not in {frame!r}")


def _pose(msg: Any) -> Any:
    """Pose of a PoseStamped or a PoseWithCovarianceStamped."""
    return getattr(msg.pose, "pose", msg.pose)


def _down_in_base(orientation: Any, down_sign: float) -> np.ndarray | None:
    """Down in the base frame, of its orientation in a frame whose z is down_sign times down."""
    try:
        rot = rotation_of(orientation)
    except ValueError:
        return None
    return down_sign * rot[2]


def _unit(vector: Sequence[float] | np.ndarray) -> np.ndarray | None:
    v = np.array(vector, dtype=float)
    norm = float(np.linalg.norm(v))
    return v / norm if np.isfinite(norm) and norm > 0 else None
