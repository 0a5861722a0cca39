"""Registered motions of a target beside the true ones."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from horizon_sensor_ros.core.mathematics.rigid import (
    inverse_pose,
    pose_matrix,
    rotation_from_vector,
    vector_from_rotation,
)
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.core.target_motion.registration import Registration, register
from horizon_sensor_ros.core.target_motion.target_view import TargetView


def motion_nees(found: Registration, poses: Sequence[np.ndarray]) -> float:
    """Squared error of a motion from the first to the second pose (4, 4), in its own sigmas."""
    off = poses[1] @ inverse_pose(poses[0]) @ inverse_pose(found.pose_b_from_a)
    centre = np.append(found.centre_m, 1.0)
    error = np.concatenate([vector_from_rotation(off[:3, :3]), (off @ centre - centre)[:3]])
    return float(error @ np.linalg.solve(found.covariance, error))


def pose_of(rng: np.random.Generator, distance_m: float = 5.0) -> np.ndarray:
    """A target's pose (4, 4) in front of the sensor, turned at random."""
    turn = rotation_from_vector(rng.normal(size=3) * 2.0)
    return pose_matrix(turn, np.array([0.0, 0.0, distance_m]))


def nees_of_steps(
    view_of: Callable[[np.ndarray, np.random.Generator], TargetView],
    seeds: Iterable[int],
    *,
    distance_m: float = 5.0,
    turn_deg: float = 6.0,
    shift_m: float = 0.05,
) -> list[float]:
    """`motion_nees` of those motions that were let through, a random step a seed.

    view_of : of a target's pose. turn_deg, shift_m : one sigma about and along each axis.
    """
    squares = []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        before = pose_of(rng, distance_m)
        turn = rotation_from_vector(rng.normal(size=3) * np.radians(turn_deg)) @ before[:3, :3]
        poses = before, pose_matrix(turn, before[:3, 3] + rng.normal(size=3) * shift_m)
        found = register(*(view_of(pose, rng) for pose in poses))
        if found.status is Status.OK:
            squares.append(motion_nees(found, poses))
    return squares
