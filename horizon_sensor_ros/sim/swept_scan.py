"""A lidar that looks at one row after the other, as its mirror nods, while the target moves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from horizon_sensor_ros.sim.shapes import TriangleMesh
from horizon_sensor_ros.sim.tof_camera import ToFCamera


@dataclass(frozen=True, eq=False)
class SweptScan:
    """points : (H, W, 3) float32, metres, optical frame; NaN: no return.  times_s : (H, W) float32,
    when each was measured, after the first row."""

    points: np.ndarray
    times_s: np.ndarray


def swept_scan(
    camera: ToFCamera,
    mesh: TriangleMesh,
    pose_at: Callable[[float], np.ndarray],
    duration_s: float,
    rng: np.random.Generator | None = None,
    strips: int = 32,
) -> SweptScan:
    """Sweep the frame from its top to its bottom, so many strips of rows of one moment each.

    pose_at : (4, 4) pose_cam_from_target so many seconds after the first strip.
    """
    points = np.empty((camera.height, camera.width, 3), np.float32)
    times_s = np.empty((camera.height, camera.width), np.float32)
    for number, rows in enumerate(np.array_split(np.arange(camera.height), strips)):
        time_s = duration_s * number / strips
        points[rows] = camera.scan(mesh, pose_at(time_s), rng).points[rows]
        times_s[rows] = time_s
    return SweptScan(points, times_s)
