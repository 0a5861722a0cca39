"""What a pixel shows of several returns that lie anywhere in it: the depth in its middle."""

from __future__ import annotations

import numpy as np

# Offsets of returns from their pixels' middles that make no difference.
_CENTRED_PX = 0.01
# Neighbours of a pixel's slope, and what holds it to none where they are few, square pixels.
_REACH_PX = 2
_RIDGE_PX2 = 0.5


def depth_in_middles(
    inverse_depth: np.ndarray,
    index: np.ndarray,
    offset_px: np.ndarray,
    shape: tuple[int, int],
    step_per_px: float,
) -> np.ndarray:
    """Inverse depth (H, W) float32 in the middles of pixels, 0 without a return.

    inverse_depth : (N,) of returns.  index : (N,) of the flat pixel of each, none of them within
        two pixels of the border.  offset_px : (2, N) right and down from its middle.
    step_per_px : relative change of inverse depth from one pixel to the next, up to which two
        returns may lie on one surface.
    A pixel that holds several surfaces shows the nearest one; its returns count by their mean.
    """
    size = shape[0] * shape[1]
    nearest = np.zeros(size)
    np.maximum.at(nearest, index, inverse_depth)
    front = inverse_depth >= nearest[index] * (1 - step_per_px)
    index, inverse_depth, offset_px = index[front], inverse_depth[front], offset_px[:, front]
    count = np.maximum(np.bincount(index, minlength=size), 1)
    level = np.bincount(index, inverse_depth, size) / count
    if np.abs(offset_px).max(initial=0) > _CENTRED_PX:
        u, v = (np.bincount(index, offset, size) / count for offset in offset_px)
        seen = np.flatnonzero(level)
        slope_u, slope_v = _slopes(level, u, v, seen, shape[1], step_per_px)
        level[seen] -= slope_u * u[seen] + slope_v * v[seen]
    return level.astype(np.float32).reshape(shape)


def _slopes(
    level: np.ndarray, u: np.ndarray, v: np.ndarray, seen: np.ndarray, width: int, step: float
) -> np.ndarray:
    """(2, N) change of inverse depth a pixel about those ``seen``, from neighbours on the same
    surface.
    """
    reach = np.arange(-_REACH_PX, _REACH_PX + 1)
    du, dv = (each.ravel() for each in np.meshgrid(reach, reach))
    beside = seen[:, None] + (dv * width + du)
    there, here = level[beside], level[seen, None]
    room = here * step * np.maximum(np.hypot(du, dv), 1)
    mine = (there > 0) & (np.abs(there - here) < room)
    number = mine.sum(axis=1, keepdims=True)
    x, y, w = (
        mine * (each - (mine * each).sum(axis=1, keepdims=True) / number)
        for each in (du + u[beside], dv + v[beside], there)
    )
    xx, xy, yy, xw, yw = (
        np.einsum("ij,ij->i", one, two) for one, two in ((x, x), (x, y), (y, y), (x, w), (y, w))
    )
    xx, yy = xx + _RIDGE_PX2, yy + _RIDGE_PX2
    return np.array([yy * xw - xy * yw, xx * yw - xy * xw]) / (xx * yy - xy * xy)
