"""What constant velocity lets expect of the next pose, and whether one is too far off that."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from horizon_sensor_ros.core.mathematics.rigid import (
    inverse_pose,
    pose_matrix,
    rotated_covariance,
    rotation_from_vector,
    vector_from_rotation,
)
from horizon_sensor_ros.core.seconds import s_from_ns
from horizon_sensor_ros.core.target_motion.known_view import KnownView, delta_covariance
from horizon_sensor_ros.core.target_motion.registration import Registration
from horizon_sensor_ros.core.target_motion.sweeps.velocity import Velocity

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
# A velocity of now is taken over a turn so large at most, and over fixes that agree with one
# motion: each within this Mahalanobis distance, squared, which 5 % of six unknowns are beyond. What
# it may have changed by unseen is as much again as what noise leaves of it.
_STEADY_OVER_RAD, _AGREE, _UNSEEN = np.radians(20.0), 12.6, 2.0
_UNKNOWNS = 6
_MOST_STEPS = 2.0  # for which a change of it goes on
# A body that tumbles turns its axis by about as much as it turns itself. Until a third view tells,
# the velocity may change in a step by so much of what it would at most, one sigma.
_TUMBLES = 0.3


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


def velocity_of(
    now: KnownView, last: KnownView, path: Sequence[tuple[int, np.ndarray]], ahead_s: float
) -> Velocity:
    """How the target moves some time after a new view, by that and those before it: as over as many
    of them as show one motion; where not even the last two steps do it changes on.

    last, path : as of `predict`.
    """
    covariance = rotated_covariance(delta_covariance(last, now), last.pose[:3, :3])
    step_s = s_from_ns(now.stamp_ns - last.stamp_ns)
    found = Velocity.between(last.pose, now.pose, step_s, covariance)
    if not path:
        return found.less_sure(_TUMBLES * turn_between(last.pose, now.pose), now.size_m)
    passed = [(step_s, last.pose)]
    for stamp_ns, pose in path:
        over_s = s_from_ns(now.stamp_ns - stamp_ns)
        longer = Velocity.between(pose, now.pose, over_s, _UNSEEN**2 * covariance)
        off = _off(longer, now, passed)
        if off > _AGREE and len(passed) == 1:
            earlier = Velocity.between(pose, last.pose, over_s - step_s, covariance)
            steps = min(max((step_s + 2.0 * ahead_s) / over_s, 0.0), _MOST_STEPS)
            # As much of the change as is not noise.
            return found.changed_on(earlier, steps * (1.0 - _UNKNOWNS / off))
        if off > _AGREE or turn_between(pose, now.pose) > _STEADY_OVER_RAD:
            break
        # Over two steps that is no better known than over one.
        found = longer if over_s > _UNSEEN * step_s else found
        passed.append((over_s, pose))
    return found


def _off(velocity: Velocity, now: KnownView, passed: Sequence[tuple[float, np.ndarray]]) -> float:
    """Squared Mahalanobis distance, the largest, of poses so long ago from those that a velocity
    leads from to a view's.
    """
    information = np.linalg.inv(2.0 * now.step_covariance)
    largest = 0.0
    for ago_s, pose in passed:
        expected = velocity.pose_after(now.pose, -ago_s)
        turn = vector_from_rotation(pose[:3, :3] @ expected[:3, :3].T)
        off = np.concatenate([turn, pose[:3, 3] - expected[:3, 3]])
        largest = max(largest, float(off @ information @ off))
    return largest


def unexpected(
    found: Registration,
    keyframe: KnownView,
    last: np.ndarray,
    predicted: np.ndarray,
    strayed: bool,
) -> str:
    """Why the target would have turned or moved otherwise than is predicted, by the motion found
    from a keyframe; empty where it has not.

    last, predicted : (4, 4) poses.  strayed : whether a cloud since the last fix was refused for
    that.
    What a prior does not lead to is searched for about no turn, and on a nearly symmetric target a
    turn by a side less, or by a right angle, agrees as well; on a truss a shift by a bay.
    """
    now = found.pose_b_from_a @ keyframe.pose
    return _turned_off(last, now, predicted, strayed) or _moved_off(found, keyframe, now, predicted)


def _turned_off(last: np.ndarray, pose: np.ndarray, predicted: np.ndarray, strayed: bool) -> str:
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


def _moved_off(
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
