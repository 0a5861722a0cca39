"""Vectors, rotations and poses out of the fields of geometry_msgs."""

from __future__ import annotations

from typing import Any

import numpy as np

from horizon_sensor_ros.core.mathematics.attitude import rotation_from_quaternion
from horizon_sensor_ros.core.mathematics.rigid import pose_matrix


def xyz_of(vector: Any) -> np.ndarray:
    """(3,) of a `Vector3` or `Point`."""
    return np.array([vector.x, vector.y, vector.z])


def rotation_of(quaternion: Any) -> np.ndarray:
    """Rotation (3, 3) of a `Quaternion`; ValueError where it is none: not finite, or not of unit
    norm.
    """
    q = quaternion
    return rotation_from_quaternion(np.array([q.x, q.y, q.z, q.w]))


def pose_of(pose: Any) -> np.ndarray:
    """Pose (4, 4) of a `Pose`; ValueError as of `rotation_of`."""
    return pose_matrix(rotation_of(pose.orientation), xyz_of(pose.position))
