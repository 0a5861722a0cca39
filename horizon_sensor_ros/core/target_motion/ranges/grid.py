"""The grid of pixels that a cloud's points lie on, or one that is made for them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from horizon_sensor_ros.core.mathematics.robust import quantile
from horizon_sensor_ros.core.target_motion.ranges.regular import MOST_OFF, ON_GRID, grid_of

_MAX_SIDE_PX = 400
# A point of an organised cloud may lie so far from its pixel's middle; half a pixel on the next one
# begins.
_ORGANISED_OFF_PX = 0.45
# On a regular grid, square or twice as wide as high, the disc to this neighbour holds as many
# points as it has room for, within a twentieth.
_NEIGHBOURS = 12


@dataclass(frozen=True, eq=False)
class Grid:
    """Pixels of N points.

    pixel : (2, N) int, column and row.  focal_px : pixels to a unit of x/z and y/z.  origin : (2,)
        x/z and y/z of the middle of pixel (0, 0).  on : (N,) bool, which points lie on the grid.
    own : it is the points' own, not made for them.
    """

    pixel: np.ndarray
    focal_px: float
    origin: np.ndarray
    on: np.ndarray
    own: bool = True


def not_far_off(tangent: np.ndarray) -> np.ndarray:
    """(N,) bool, false for the odd point far from all others, which the grid need not reach.

    tangent : (2, N) x/z and y/z of the points.
    """
    some = tangent[:, :: max(1, tangent.shape[1] // 2000)]
    low, high = (
        np.array([quantile(axis, share) for axis in some]) for share in (1 - ON_GRID, ON_GRID)
    )
    middle = (low + high)[:, None] / 2
    return _larger(np.abs(tangent - middle)) <= 2.5 * (high - low).max()


def organised_grid(tangent: np.ndarray, place: np.ndarray, shape: tuple[int, int]) -> Grid | None:
    """Grid of a pinhole camera's cloud, or None where it is not one: columns and rows are linear in
    x/z and y/z, and pixels are square.

    tangent : (2, N) x/z and y/z of the points.  place : (N,) their flat indices in the cloud, of
        ``shape`` (rows, columns).
    """
    row, column = np.divmod(place, shape[1])
    pixel = np.stack([column, row])
    step = max(1, len(place) // 2000)
    index, some = pixel[:, ::step].astype(float), tangent[:, ::step]
    line = _lines(index, some)
    if line is not None:
        # Again without the points that lie off, which pull the lines.
        off = _larger(np.abs(some - line[0][:, None] * index - line[1][:, None]))
        good = off <= quantile(off, ON_GRID)
        line = _lines(index[:, good], some[:, good])
    if line is None:
        return None
    slope, origin = line
    if not (slope > 0).all() or abs(slope[0] / slope[1] - 1) > 0.02:
        return None
    return _square_grid(tangent, pixel, slope, origin, _ORGANISED_OFF_PX)


def plain_grid(tangent: np.ndarray, focal_px: float | None) -> Grid:
    """Grid for points in any order.

    Where the directions lie on a regular grid (a camera's cloud without its empty pixels) that
    grid is found and every point gets its own pixel; otherwise the pixels are made coarse enough
    to leave few holes.

    tangent : (2, N) x/z and y/z of the points.  focal_px : of the grid to be expected, where that
        is known.
    """
    extent = float(np.ptp(tangent, axis=1).max())
    expected = 1 / focal_px if focal_px else None
    grid = [grid_of(tangent[axis], expected, extent / _MAX_SIDE_PX) for axis in (0, 1)]
    if grid[0] is not None and grid[1] is not None:
        pitch, origin = np.transpose([grid[0], grid[1]])
        if abs(pitch[0] / pitch[1] - 1) < 0.02:
            pixel = np.rint((tangent - origin[:, None]) / pitch[:, None]).astype(np.int64)
            square = _square_grid(tangent, pixel, pitch, origin, MOST_OFF)
            if square is not None:
                return square
    distance, area = _spacing(tangent, extent)
    # Points strewn at random: some two to a pixel leave one in seven empty.
    pitch = max(2 * distance, extent / _MAX_SIDE_PX, np.sqrt(2 * area))
    origin = tangent.min(axis=1)
    pixel = np.rint((tangent - origin[:, None]) / pitch).astype(np.int64)
    return Grid(pixel, 1 / pitch, origin, np.ones(tangent.shape[1], bool), False)


def _square_grid(
    tangent: np.ndarray, pixel: np.ndarray, pitch: np.ndarray, origin: np.ndarray, most_px: float
) -> Grid | None:
    """Grid of pixels (2, N) with the mean of both pitches (2,), or None where too many points lie
    farther than that from their pixels' middles.
    """
    mean = float(pitch.mean())
    middle = pixel.mean(axis=1)
    origin = origin + (pitch - mean) * middle
    off = _larger(np.abs(tangent - mean * pixel - origin[:, None])) / mean
    if quantile(off, ON_GRID) > most_px:
        return None
    return Grid(pixel, 1 / mean, origin, off < 0.5)


def _lines(index: np.ndarray, tangent: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Slopes and values at 0 (2,) of the lines tangent (2, N) over index (2, N)."""
    mean_i, mean_t = index.mean(axis=1), tangent.mean(axis=1)
    arm = index - mean_i[:, None]
    spread = (arm * arm).sum(axis=1)
    if not (spread > 0).all():
        return None
    slope = (tangent * arm).sum(axis=1) / spread
    return slope, mean_t - slope * mean_i


def _spacing(tangent: np.ndarray, extent: float) -> tuple[float, float]:
    """Median distance of a point to its nearest other one, and the area that each has about it; of
    at most 500 of them.

    The area is that of the disc to the k-th neighbour over k. What the target leaves empty of the
    box around it (beside an antenna, between the arms of a cross) does not count.
    """
    from scipy.spatial import cKDTree  # noqa: PLC0415  a camera's clouds do without it

    cell = np.rint((tangent - tangent.min(axis=1)[:, None]) * (1e6 / extent)).astype(np.int64)
    unique = tangent.T[np.unique(cell[0] * 2_000_003 + cell[1], return_index=True)[1]]
    sample = unique[:: max(1, len(unique) // 500)]
    last = min(_NEIGHBOURS, len(unique) - 1)
    distance = np.median(cKDTree(unique).query(sample, k=[2, last + 1])[0], axis=0)
    return float(distance[0]), float(np.pi * distance[1] ** 2 / last)


def _larger(two: np.ndarray) -> np.ndarray:
    """(N,) of (2, N); faster than a reduction."""
    return np.maximum(two[0], two[1])
