"""Does all of a cloud move alike? A wall, a floor or a second body would hold a motion to its
own.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from horizon_sensor_ros.core.mathematics.robust import median
from horizon_sensor_ros.core.target_motion.alignment.consistency import against
from horizon_sensor_ros.core.target_motion.surfaces.surface_view import SurfaceView

# Every other column and row is looked at; planes of neighbours share most of their windows.
_STEP = 2
# Distances are averaged over a square of so many of these, of which so many must be known.
_SIDE, _LEAST = 5, 12
# Such a mean may be off by this, in range noise of both views and in pixels' widths: of single
# bodies 0.6 and 0.06 were the most (noise of 0.5 to 10 mm, pixels' widths of 7 to 30).
_NOISE, _WIDTH = 0.8, 0.06
# Stray returns fill no square of so many.
_PATCH = 3
_SLACK_PX = 0.5
_EDGE_ON = 0.2  # cosine of the sight to a normal


def part_off_m(
    a: SurfaceView, b: SurfaceView, rotation: np.ndarray, translation: np.ndarray
) -> float | None:
    """Distance (m) by which some part of the surface is off, if the target moved by
    p_b = R p_a + t; None where all parts agree.

    rotation (3, 3), translation (3,), m : R and t, in the frames of the views.

    The right motion of one rigid body leaves no patch of either view whose distances from the
    other's surface are off alike, and none that the other looks through and sees farther.
    """
    there = _one_way(a, b, rotation, translation)
    return _one_way(b, a, rotation.T, -rotation.T @ translation) if there is None else there


def _one_way(
    a: SurfaceView, b: SurfaceView, rotation: np.ndarray, translation: np.ndarray
) -> float | None:
    patches = patches_of(a, b, rotation, translation)
    worst = float(np.nanmax(np.abs(patches.off_m), initial=0.0))
    if worst > most_off_m(a, b):
        return worst
    if cv2.erode(patches.before, np.ones((_PATCH, _PATCH), np.uint8)).any():
        return patches.before_m
    return None


def most_off_m(a: SurfaceView, b: SurfaceView) -> float:
    """Distance (m) by which a patch of one rigid body may be off on the mean."""
    return float(_NOISE * np.hypot(a.sigma_m, b.sigma_m) + _WIDTH * b.footprint_m)


@dataclass(frozen=True, eq=False)
class Patches:
    """What view b says of the patches of view a, in its image of every other row and column.

    off_m : (H, W) float32, mean distance of the patch about a pixel from b's surface, towards the
        sensor; NaN where too little is known.  before : (H, W) uint8, 1 where b looks through and
        sees farther; of what b sees edge-on also in the pixels around.  before_m : by how much,
        in the median.
    """

    off_m: np.ndarray
    before: np.ndarray
    before_m: float


def patches_of(
    a: SurfaceView, b: SurfaceView, rotation: np.ndarray, translation: np.ndarray
) -> Patches:
    """Hold view a, moved by p_b = R p_a + t, against view b.

    rotation (3, 3), translation (3,), m : R and t, in the frames of the views.
    """
    width = a.image.inverse_depth.shape[1]
    some = np.ascontiguousarray(a.image.inverse_depth[::_STEP, ::_STEP])
    place = np.flatnonzero(some)
    row, column = np.divmod(place, some.shape[1])
    of_view = _STEP * (row * width + column)
    points, normals = a.point_map.take(of_view, axis=0), a.normal_map.take(of_view, axis=0)
    seen = against(a, b, points, normals, rotation[None], translation[None], _SLACK_PX)
    index, off, before = seen.index[0], seen.off_m[0], seen.before[0]
    # Borrowed planes go on where the surface need not.
    own = b.plane[index] & (b.tilt_rad[index] == 0)
    own &= a.plane[of_view] & (a.tilt_rad[of_view] == 0)
    used = seen.confirmed[0] & own
    count, total = np.zeros((2, *some.shape), np.float32)
    count.ravel()[place[used]] = 1
    total.ravel()[place[used]] = off[used]
    count, total = (
        cv2.boxFilter(each, -1, (_SIDE, _SIDE), None, (-1, -1), False, cv2.BORDER_CONSTANT)
        for each in (count, total)
    )
    mean = np.full(some.shape, np.nan, np.float32)
    np.divide(total, count, out=mean, where=count > _LEAST - 0.5)
    # A surface that b sees edge-on is a pixel wide there: beside it b sees farther.
    edge_on = normals.any(axis=1) & (-seen.sight_m[0] < _EDGE_ON * seen.depth_m[0])
    around = seen.depth_m[0] < b.closest_around[index] - np.float32(seen.tolerance_m)
    before &= around | ~edge_on
    patch = np.zeros(some.shape, np.uint8)
    patch.ravel()[place[before]] = 1
    return Patches(mean, patch, median(off[before]) if before.any() else 0.0)
