"""How the target moves while a cloud is measured."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from horizon_sensor_ros.core.mathematics.rigid import (
    cross,
    inverse_left_jacobian,
    inverse_pose,
    pose_matrix,
    rotation_from_vector,
    vector_from_rotation,
)

_LEAST_TURN_RAD = 1e-9


@dataclass(frozen=True, eq=False)
class Velocity:
    """How the target moves in the sensor's frame: it turns about a line, and along it, at a steady
    rate. So does a body that turns about a point at rest, wherever its frame's origin is.

    turn_rad_s : (3,) about the sensor's axes.  shift_m_s : (3,) of what is where the sensor is.
    covariance : (6, 6) of the turn and of the target frame's origin.
    """

    turn_rad_s: np.ndarray
    shift_m_s: np.ndarray
    covariance: np.ndarray

    @classmethod
    def between(
        cls, before: np.ndarray, now: np.ndarray, duration_s: float, covariance: np.ndarray
    ) -> Velocity:
        """From two poses (4, 4) of the target frame.  covariance : (6, 6) of the motion between
        them, about the sensor's axes.
        """
        motion = now @ inverse_pose(before)
        turn = vector_from_rotation(motion[:3, :3])
        shift = inverse_left_jacobian(turn) @ motion[:3, 3]
        return cls(turn / duration_s, shift / duration_s, covariance / duration_s**2)

    def changed_on(self, earlier: Velocity, steps: float) -> Velocity:
        """As it will be, so many times as long after this as that was before it."""
        return Velocity(
            self.turn_rad_s + steps * (self.turn_rad_s - earlier.turn_rad_s),
            self.shift_m_s + steps * (self.shift_m_s - earlier.shift_m_s),
            self.covariance * ((1.0 + steps) ** 2 + steps**2),
        )

    def less_sure(self, share: float, size_m: float) -> Velocity:
        """With such a share of its turn as one more sigma of that about any axis, and of the shift
        of what lies so far off its origin.
        """
        sigma = share * float(np.linalg.norm(self.turn_rad_s)) * np.repeat([1.0, size_m], 3)
        return replace(self, covariance=self.covariance + np.diag(np.square(sigma)))

    def difference(self, other: Velocity, origin_m: np.ndarray) -> np.ndarray:
        """(6,) of the turn, and of the shift of what is at an origin (3,)."""
        turn = self.turn_rad_s - other.turn_rad_s
        shift = self.shift_m_s - other.shift_m_s + np.cross(turn, origin_m)
        return np.concatenate([turn, shift])

    def less_sure_by(self, difference: np.ndarray) -> Velocity:
        """With a difference (6,) of turn and shift as one more sigma of this one."""
        return replace(self, covariance=self.covariance + np.outer(difference, difference))

    def pose_after(self, pose: np.ndarray, time_s: float) -> np.ndarray:
        """(4, 4) what a pose (4, 4) comes to be."""
        origin = self.moved(pose[None, :3, 3], np.array([time_s]))[0]
        return pose_matrix(rotation_from_vector(time_s * self.turn_rad_s) @ pose[:3, :3], origin)

    def moved(self, points: np.ndarray, times_s: np.ndarray) -> np.ndarray:
        """(N, 3) where points (N, 3) come to be after times (N,)."""
        after_s = times_s[:, None]
        rate = float(np.linalg.norm(self.turn_rad_s))
        if rate * float(np.abs(times_s).max(initial=0.0)) < _LEAST_TURN_RAD:
            return np.asarray(points + after_s * self.shift_m_s)
        axis = self.turn_rad_s / rate
        on_axis_m = np.cross(axis, self.shift_m_s) / rate
        arm = points - on_axis_m
        aside = cross(np.broadcast_to(axis, arm.shape), arm)
        along = (arm @ axis)[:, None] * axis
        cosine, sine = np.cos(rate * after_s), np.sin(rate * after_s)
        turned = along + cosine * (arm - along) + sine * aside
        return np.asarray(turned + on_axis_m + after_s * (self.shift_m_s @ axis) * axis)


def off_m(covariance: np.ndarray, size_m: float) -> float:
    """By how much points so far from an origin are off, one sigma, by a covariance (6, 6) of turn
    and shift.
    """
    variance = np.diag(covariance)
    return float(np.sqrt((size_m**2 * variance[:3].sum() + variance[3:].sum()) / 3.0))
