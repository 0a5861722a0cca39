"""A lidar that looks at one row after the other, as its mirror nods, while the target moves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from horizon_sensor_ros.core.mathematics.rigid import pose_matrix, rotation_from_vector
from horizon_sensor_ros.sim.shapes import TriangleMesh
from horizon_sensor_ros.sim.tof_camera import ToFCamera


@dataclass(frozen=True, eq=False)
class SweptScan:
    """points : (H, W, 3) float32, metres, optical frame, NaN without a return, or (N, 3) of those
    that returned.  times_s : (H, W) or (N,) float32, when each was measured, after the first row.
    """

    points: np.ndarray
    times_s: np.ndarray


def swept_scan(
    camera: ToFCamera,
    mesh: TriangleMesh,
    pose_at: Callable[[float], np.ndarray],
    start_s: float,
    duration_s: float,
    rng: np.random.Generator | None = None,
    *,
    roll_rad: float = 0.0,
    strips: int = 32,
) -> SweptScan:
    """Sweep the frame from its top to its bottom, so many strips of rows of one moment each.

    pose_at : (4, 4) pose_cam_from_target at a time, seconds.  start_s : of the first strip.
    roll_rad : of the sensor about its optical axis; points are turned back then, lie on no grid,
    and come as (N, 3).
    """
    roll = pose_matrix(rotation_from_vector(np.array([0.0, 0.0, roll_rad])), np.zeros(3))
    points = np.empty((camera.height, camera.width, 3), np.float32)
    times_s = np.empty((camera.height, camera.width), np.float32)
    for number, rows in enumerate(np.array_split(np.arange(camera.height), strips)):
        time_s = duration_s * number / strips
        points[rows] = camera.scan(mesh, roll @ pose_at(start_s + time_s), rng).points[rows]
        times_s[rows] = time_s
    if not roll_rad:
        return SweptScan(points, times_s)
    seen = np.isfinite(points[..., 2])
    return SweptScan(points[seen] @ roll[:3, :3], times_s[seen])
