"""Whether ranges come in whole steps."""

from __future__ import annotations

import numpy as np

from horizon_sensor_ros.core.mathematics.robust import quantile
from horizon_sensor_ros.core.target_motion.ranges.regular import grid_of

# Smallest step of ranges that is still looked for, and the points it is looked for in.
_SMALLEST_STEP_M, _STEP_POINTS = 5e-4, 2000
# And of disparity, at the median depth.
_DISPARITY_STEPS_M = 1e-3


def step_of_ranges(points: np.ndarray) -> float:
    """Step (m) in which the depths or else the ranges of (3, N) points come; 0 where they do
    not.

    A stereo camera's come in steps of disparity, of inverse depth: that at the median depth, if it
    is the larger one, as depths may have been rounded since.
    """
    some = points[:, :: max(1, points.shape[1] // _STEP_POINTS)]
    unit = quantile(some[2], 0.5) ** 2
    of_disparity = grid_of(1.0 / some[2], None, _DISPARITY_STEPS_M / unit)
    step = 0.0 if of_disparity is None else unit * float(of_disparity[0])
    for values in (some[2], np.linalg.norm(some, axis=0)):
        grid = grid_of(values, None, _SMALLEST_STEP_M)
        if grid is not None:
            return max(step, float(grid[0]))
    return step
