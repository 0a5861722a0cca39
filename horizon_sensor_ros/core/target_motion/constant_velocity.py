"""What constant velocity lets expect of the next pose, and whether one is too far off that."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from horizon_sensor_ros.core.mathematics.rigid import (
    inverse_pose,
    pose_matrix,
    rotation_from_vector,
    vector_from_rotation,
)
from horizon_sensor_ros.core.target_motion.known_view import KnownView
from horizon_sensor_ros.core.target_motion.registration import Registration

# A turn may be off what constant velocity predicts by half a side of a prism of eight: farther off
# a turn by a side less or more, which looks the same, is the likelier one. After one that was
# refused for that, by no more than a prior may be off: what looks the same may come to lie nearer
# as the prediction goes on.
_UNSTEADY_RAD, _STRAYED_RAD = np.radians([22.0, 10.0])
# And by no more than some times the turn that is predicted, where that is more than a few degrees:
# what little holds the roll of a slow target may leave the view.
_STEADY_RAD, _STEADY = np.radians(5.0), 3.0
# It may be moved so far from what is predicted, rms radii of what is seen and shares of the range
# (as if the sensor had turned): farther off it is another bay of a truss, or rung, or panel.
_ASIDE, _ASIDE_RAD = 0.3, np.radians(3.0)
# A velocity is carried on for so many times what it was taken over, where enough fixes are kept,
# and never for more than the second: of stamps as clouds arrive two may lie close together.
_CARRIED_ON, _MOST_CARRIED_ON = 4, 20


def predict(
    last: KnownView, path: Sequence[tuple[int, np.ndarray]], stamp_ns: int
) -> np.ndarray | None:
    """Pose (4, 4) from the last one and constant velocity; None before there is a velocity.

    path : stamps and poses of fixes before the last one, the latest first.
    """
    if not path:
        return None
    gap_ns = stamp_ns - last.stamp_ns
    far = (each for each in path if _CARRIED_ON * (last.stamp_ns - each[0]) >= gap_ns)
    before_ns, before = next(far, path[-1])
    ratio = gap_ns / (last.stamp_ns - before_ns)
    if ratio > _MOST_CARRIED_ON:
        return None
    delta = inverse_pose(before) @ last.pose
    turn = rotation_from_vector(vector_from_rotation(delta[:3, :3]) * ratio)
    return last.pose @ pose_matrix(turn, delta[:3, 3] * ratio)


def turned_off(last: np.ndarray, pose: np.ndarray, predicted: np.ndarray, strayed: bool) -> str:
    """Why a pose (4, 4) is turned too far from the one predicted; empty where it is not.

    last : (4, 4) pose of the last fix.  strayed : whether a cloud since then was refused for that.
    """
    off, turn = turn_between(pose, predicted), turn_between(last, predicted)
    most = _STRAYED_RAD if strayed else _UNSTEADY_RAD
    most = min(most, max(_STEADY_RAD, _STEADY * turn))
    if off <= most:
        return ""
    return (
        f"turned {np.degrees(off):.0f} deg away from the {np.degrees(turn):.0f} deg that"
        f" constant velocity predicts, {np.degrees(most):.0f} allowed"
    )


def moved_off(
    found: Registration, keyframe: KnownView, pose: np.ndarray, predicted: np.ndarray
) -> str:
    """Why what a keyframe shows is, by a pose (4, 4), too far from where it is predicted; empty
    where it is not.
    """
    assert keyframe.view.surface is not None
    centre = np.append(found.centre_m, 1.0)
    before = predicted @ inverse_pose(pose) @ centre
    off_m = float(np.linalg.norm(centre - before))
    range_m = float(np.linalg.norm(found.centre_m))
    most_m = _ASIDE * keyframe.view.surface.size_m + _ASIDE_RAD * range_m
    if off_m <= most_m:
        return ""
    return f"{off_m:.2f} m away from where constant velocity predicts it, {most_m:.2f} allowed"


def turn_between(pose_a: np.ndarray, pose_b: np.ndarray) -> float:
    """Angle (rad) by which two poses (4, 4) differ."""
    return float(np.linalg.norm(vector_from_rotation(pose_a[:3, :3].T @ pose_b[:3, :3])))
