"""Lone missing returns within a surface, filled from those around them."""

from __future__ import annotations

import numpy as np

# Of the four pairs of opposite neighbours of a hole, so many at least have both returns.
_FEWEST_PAIRS = 3


def without_holes(inverse_depth: np.ndarray) -> np.ndarray:
    """(H, W) the same image of inverse depth, single holes filled; the others stay 0.

    The border of the image, two pixels wide, must be empty.

    A plane or a line through the neighbours passes through the mean of two opposite ones; of
    those pairs the one that differs least is taken, which at a step in depth lies along it. What
    is filled serves the windows about it alone: one return in a hundred missing leaves less than
    half of the larger ones whole, and those that are not lean on a curved surface.
    """
    width = inverse_depth.shape[1]
    flat = inverse_depth.ravel()
    steps = (1, width - 1, width, width + 1)
    seen = flat > 0
    first, last = width + 1, flat.size - width - 1
    pairs = np.zeros(last - first, np.int8)
    for step in steps:
        pairs += seen[first + step : last + step] & seen[first - step : last - step]
    hole = first + np.flatnonzero((pairs >= _FEWEST_PAIRS) & ~seen[first:last])
    if not len(hole):
        return inverse_depth
    beside = hole + np.array([steps]).T
    one, other = flat[beside], flat[2 * hole - beside]
    apart = np.where((one > 0) & (other > 0), np.abs(one - other), np.inf)
    best = np.argmin(apart, axis=0), np.arange(len(hole))
    mended = flat.copy()
    mended[hole] = (one[best] + other[best]) / 2
    return mended.reshape(inverse_depth.shape)
