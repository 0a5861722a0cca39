"""Values that lie on a regular grid: the lines of a camera's pixels, ranges told in whole steps."""

from __future__ import annotations

import numpy as np

from horizon_sensor_ros.core.mathematics.robust import quantile

# A grid is one that nearly all values lie on, this far from it (in steps) at most.
ON_GRID = 0.98
MOST_OFF = 0.25


def grid_of(
    values: np.ndarray, expected: float | None, smallest: float
) -> tuple[float, float] | None:
    """Pitch and origin of the regular grid that the values lie on, or None.

    expected : its pitch, where it is known.  smallest : pitch that is still taken for one.
    """
    ordered = np.sort(values)
    first = np.flatnonzero(np.concatenate([[True], np.diff(ordered) > 0.1 * smallest]))
    levels = ordered[first]
    # A line of the grid holds many points, a stray one is alone.
    shared = np.diff(first, append=len(ordered)) > 2
    if np.count_nonzero(shared) >= 4:
        levels = levels[shared]
    if len(levels) < 4:
        return None
    pitch = float(np.median(np.diff(levels))) if expected is None else expected
    if pitch < smallest:
        return None
    steps = np.diff(levels)
    steps = steps[steps > 0.5 * pitch]
    if not len(steps):
        return None
    step = float(np.median(steps[steps < 1.5 * pitch])) if (steps < 1.5 * pitch).any() else pitch
    origin = levels[0]
    half = (levels[-1] - origin) / 2
    # The pitch sharpens as more of the grid is counted right, from the first lines outwards.
    for reach in (8 * step, 32 * step, half, 4 * half):
        near = levels[levels - origin <= reach]
        count = np.rint((near - origin) / step)
        if count[-1] < 1 or len(near) < 3:
            continue
        step, origin = np.polyfit(count, near, 1)
    off = (values - origin) / step
    return (step, origin) if quantile(np.abs(off - np.rint(off)), ON_GRID) < MOST_OFF else None
