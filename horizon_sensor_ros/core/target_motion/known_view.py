"""A view of the target whose pose is known, and how well the step from one to another is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from horizon_sensor_ros.core.mathematics.rigid import (
    inverse_pose,
    skew,
)
from horizon_sensor_ros.core.target_motion.target_view import TargetView


@dataclass(frozen=True, eq=False)
class KnownView:
    """A view whose pose is known: how it was found, and its covariance in parts.

    covariance : of its pose, by noise; by_bias : (6,) its error by what is wrong with all ranges,
        one sigma, which is the same in all poses.
    keyframe_ns : stamp of the view it was registered to; None for the first one. No more than the
        stamp, as a reference would keep every view since the first one alive.
    """

    view: TargetView
    stamp_ns: int
    pose: np.ndarray
    covariance: np.ndarray
    by_bias: np.ndarray
    keyframe_ns: int | None
    step_covariance: np.ndarray


def delta_covariance(last: KnownView, now: KnownView) -> np.ndarray:
    """(6, 6) covariance of inv(pose_last) pose_now about the axes of the last target frame.

    Both poses' errors enter as far as they are not the same: against one keyframe its noise, half
    of each registration's variance, is shared; against the last view itself there is but one
    registration; otherwise both count in full. What is the same, the error of the target frame that
    has grown since it was set, turns the axes in which the step is told. What is wrong with all
    ranges is in both poses, each in its own way.
    """
    apart = now.pose[:3, 3] - last.pose[:3, 3]
    move = np.eye(6)
    move[3:, :3] = -skew(apart)
    if now.keyframe_ns == last.stamp_ns:
        total = now.step_covariance
    elif now.keyframe_ns == last.keyframe_ns:
        total = (now.step_covariance + move @ last.step_covariance @ move.T) / 2
    else:
        total = now.covariance + move @ last.covariance @ move.T
    back = np.kron(np.eye(2), last.pose[:3, :3].T)
    covariance = back @ total @ back.T
    if now.keyframe_ns in (last.stamp_ns, last.keyframe_ns):
        delta = inverse_pose(last.pose) @ now.pose
        turned = np.kron(np.eye(2), delta[:3, :3] - np.eye(3))
        turned[3:, :3] = skew(delta[:3, 3])
        turned = turned @ back
        covariance += turned @ last.covariance @ turned.T
    by_bias = back @ (now.by_bias - move @ last.by_bias)
    covariance += np.outer(by_bias, by_bias)
    return (covariance + covariance.T) / 2
