"""A view of the target whose pose is known, and how well the step from one to another is."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from horizon_sensor_ros.core.mathematics.rigid import (
    inverse_pose,
    rotated_covariance,
    skew,
    turn_and_shift,
)
from horizon_sensor_ros.core.target_motion.config import RegistrationConfig
from horizon_sensor_ros.core.target_motion.registration import Registration
from horizon_sensor_ros.core.target_motion.target_view import TargetView


@dataclass(frozen=True, eq=False)
class KnownView:
    """A view whose pose is known: how it was found, and its covariance in parts.

    pose : (4, 4) the target frame in the sensor frame.
    covariance : (6, 6) of its pose, by noise, as of `TargetFix`; by_bias : (6,) its error by what
        is wrong with all ranges, one sigma, which is the same in all poses.
    step_covariance : (6, 6) of the motion since the view that it was registered to, by noise, in
        the same terms; 0 of the first one.
    keyframe_ns : stamp of the view it was registered to; None for the first one. No more than the
        stamp, as a reference would keep every view since the first one alive.
    of_sweep : (6, 6) covariance of what is wrong with the view itself, of a cloud that took time,
        as if its pose were: by the velocity. It is in none of the others.
    """

    view: TargetView
    stamp_ns: int
    pose: np.ndarray
    covariance: np.ndarray
    by_bias: np.ndarray
    keyframe_ns: int | None
    step_covariance: np.ndarray
    of_sweep: np.ndarray = field(default_factory=lambda: np.zeros((6, 6)))

    @classmethod
    def found(
        cls, view: TargetView, stamp_ns: int, keyframe: KnownView, motion: Registration
    ) -> KnownView:
        """A view whose pose the motion from a keyframe tells."""
        pose = motion.pose_b_from_a @ keyframe.pose
        by_bias = motion.by_bias_at(pose[:3, 3])
        step = motion.covariance_at(pose[:3, 3]) - np.outer(by_bias, by_bias)
        rotation = motion.pose_b_from_a[:3, :3]
        covariance = step + rotated_covariance(keyframe.covariance, rotation)
        by_bias = by_bias + turn_and_shift(rotation) @ keyframe.by_bias
        return cls(view, stamp_ns, pose, covariance, by_bias, keyframe.stamp_ns, step)

    @property
    def size_m(self) -> float:
        """RMS radius of what is seen."""
        assert self.view.surface is not None
        return self.view.surface.size_m

    def uncertain(self, of_sweep: np.ndarray, config: RegistrationConfig) -> str:
        """Why the last step is not known well enough, with what is wrong with the two views
        themselves, (6, 6) of each, as clouds that took time; empty where it is.
        """
        known = self.step_covariance + 2.0 * of_sweep
        turn_rad, shift_m = (
            float(np.sqrt(np.linalg.eigvalsh(known[part, part])[-1]))
            for part in (slice(None, 3), slice(3, None))
        )
        if turn_rad <= config.max_rotation_sigma_rad and shift_m <= config.max_shift_sigma_m:
            return ""
        return (
            "by how the target moved while the cloud was measured the motion is known to"
            f" {np.degrees(turn_rad):.2f} deg and {1e3 * shift_m:.1f} mm only"
        )


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
    back = turn_and_shift(last.pose[:3, :3].T)
    covariance = back @ total @ back.T
    if now.keyframe_ns in (last.stamp_ns, last.keyframe_ns):
        delta = inverse_pose(last.pose) @ now.pose
        turned = turn_and_shift(delta[:3, :3] - np.eye(3))
        turned[3:, :3] = skew(delta[:3, 3])
        turned = turned @ back
        covariance += turned @ last.covariance @ turned.T
    by_bias = back @ (now.by_bias - move @ last.by_bias)
    covariance += np.outer(by_bias, by_bias)
    return (covariance + covariance.T) / 2
