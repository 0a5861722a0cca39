"""How the target moves while a cloud is measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from horizon_sensor_ros.core.mathematics.rigid import (
    cross,
    inverse_left_jacobian,
    inverse_pose,
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
        them, about the sensor's axes."""
        motion = now @ inverse_pose(before)
        turn = vector_from_rotation(motion[:3, :3])
        shift = inverse_left_jacobian(turn) @ motion[:3, 3]
        return cls(turn / duration_s, shift / duration_s, covariance / duration_s**2)

    def differs_by_m_s(self, other: Velocity, centre_m: np.ndarray, size_m: float) -> float:
        """How fast points move apart, as either says, that lie so far from a centre (3,)."""
        turn = self.turn_rad_s - other.turn_rad_s
        shift = self.shift_m_s - other.shift_m_s + np.cross(turn, centre_m)
        return size_m * float(np.linalg.norm(turn)) + float(np.linalg.norm(shift))

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


def rotated(covariance: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """A covariance (6, 6) of turn and shift about other axes."""
    turn = np.kron(np.eye(2), rotation)
    return turn @ covariance @ turn.T
