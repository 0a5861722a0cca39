"""Registered motions of a target beside the true ones."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from horizon_sensor_ros.core.rigid import inverse_pose, vector_from_rotation
from horizon_sensor_ros.core.target.registration import Registration


def motion_nees(found: Registration, poses: Sequence[np.ndarray]) -> float:
    """Squared error of a motion from the first to the second pose (4, 4), in its own sigmas."""
    off = poses[1] @ inverse_pose(poses[0]) @ inverse_pose(found.pose_b_from_a)
    centre = np.append(found.centre_m, 1.0)
    error = np.concatenate([vector_from_rotation(off[:3, :3]), (off @ centre - centre)[:3]])
    return float(error @ np.linalg.solve(found.covariance, error))
