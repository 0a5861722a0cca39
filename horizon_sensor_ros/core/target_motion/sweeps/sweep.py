"""Clouds whose points were not all measured at once: a lidar sweeps its field, and the target has
moved on meanwhile.

With the target's velocity every point is brought to where it was at the cloud's stamp.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from horizon_sensor_ros.core.target_motion.ranges.cropped import with_cropped
from horizon_sensor_ros.core.target_motion.ranges.own_frame import MOST_M
from horizon_sensor_ros.core.target_motion.ranges.range_image import RangeImage, range_image
from horizon_sensor_ros.core.target_motion.sweeps.stilled_image import stilled_image
from horizon_sensor_ros.core.target_motion.sweeps.velocity import Velocity

_LEAST_S = 1e-6  # times so near the stamp are the stamp


@dataclass(frozen=True, eq=False)
class Sweep:
    """Returns (N, 3) of a cloud, metres, sensor frame, and when each was measured (N,), seconds
    from the cloud's stamp; the image of the cloud as it came, and the returns (M, 3) that were
    cropped from it.
    """

    points: np.ndarray
    times_s: np.ndarray
    image: RangeImage
    cropped: np.ndarray

    @property
    def rms_s(self) -> float:
        """How far from the stamp points were measured."""
        return float(np.sqrt(np.mean(np.square(self.times_s))))

    @property
    def mean_s(self) -> float:
        """When they were measured in the mean, after the stamp."""
        return float(self.times_s.mean())

    @property
    def spread_s(self) -> float:
        """How far from each other."""
        return float(self.times_s.std())

    def stilled(
        self, velocity: Velocity, focal_px: float | None = None, min_points: int = 100
    ) -> RangeImage:
        """Image of the points where they were at the stamp; focal_px, min_points : as of
        `range_image`.
        """
        if self.image.on_grid:
            return stilled_image(self.image, self.points, self.times_s, velocity, min_points)
        moved = velocity.moved(self.points, -self.times_s)
        # What is no target does not move as one.
        return with_cropped(range_image(moved, focal_px, min_points), self.cropped)

    def error_by(self, velocity: Velocity) -> np.ndarray:
        """(6, 6) covariance of the pose of a cloud that was stilled, by that of the velocity."""
        return self.rms_s**2 * velocity.covariance

    def same_as(self, other: Sweep) -> bool:
        """Whether both are of the same returns, to the last bit."""
        return np.array_equal(self.points, other.points)


def sweep_of(
    points: np.ndarray,
    times_s: np.ndarray,
    focal_px: float | None = None,
    min_points: int = 100,
    cropped: np.ndarray | None = None,
) -> Sweep | None:
    """Return the returns of a cloud with their times; None where these are all the stamp, none is
    known, or the cloud is of no use.

    points : (H, W, 3) or (N, 3); focal_px, min_points : as of `range_image`.  times_s : (H, W) or
    (N,) seconds from the stamp; a point whose time is not finite is left out. cropped : (M, 3)
    returns that were taken out of the cloud.
    Raises ValueError for times of another shape.
    """
    times_s = np.asarray(times_s)
    if times_s.shape != points.shape[:-1]:
        raise ValueError(f"times_s must be {points.shape[:-1]}, got {times_s.shape}")
    flat, times = points.reshape(-1, 3), times_s.reshape(-1)
    with np.errstate(invalid="ignore"):  # signalling NaN, of garbled messages
        used = np.isfinite(times) & (np.abs(flat) < MOST_M).all(axis=1) & flat.any(axis=1)
    if not used.any():
        return None
    flat, times = flat[used].astype(np.float64), times[used].astype(np.float64)
    if float(np.abs(times).max()) <= _LEAST_S:
        return None
    cropped = np.empty((0, 3)) if cropped is None else cropped
    image = with_cropped(range_image(points, focal_px, min_points), cropped)
    return Sweep(flat, times, image, cropped) if image.num_used else None
