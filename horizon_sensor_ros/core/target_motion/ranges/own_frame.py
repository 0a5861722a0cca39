"""Where the sensor of an organised cloud is that was brought into another frame."""

from __future__ import annotations

import cv2
import numpy as np

from horizon_sensor_ros.core.mathematics.robust import quantile
from horizon_sensor_ros.core.target_motion.ranges.regular import ON_GRID

# Rays are looked for in so many returns, and at least so many.
_MOST_RETURNS, _FEWEST = 2000, 50
# Returns lie on the rays of their pixels, however noisy ranges are, but for rounding: so far off
# in pixels at most.
_OFF_PX = 0.1
# Any other sensor misses by so many times as much: returns that lie on one plane would do for many.
_SURE = 100.0
# What is farther off is garbage.
MOST_M = 1e4
# Pixels are square, and their rows at right angles to their columns, within this share.
_SQUARE = 0.02


def sensor_of_returns(points: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Rotation (3, 3) from a pinhole sensor's frame (x right, y down, z forward) to that of its
    organised cloud (H, W, 3), and the sensor's place there (3,), metres; None where the returns do
    not tell.

    The rays through the pixels meet in the sensor: a linear fit of the projection (Hartley and
    Zisserman, Multiple View Geometry, 7.1). Noise moves returns along their rays, and so does no
    harm; it even helps where what is seen is flat.
    """
    place, used = _returns(points)
    if len(place) < _FEWEST:
        return None
    row, column = np.divmod(place, points.shape[1])
    pixel = np.array([column, row], float)
    projection = _projection(used, pixel)
    if projection is None:
        return None
    off = _off_px(projection, used, pixel)
    good = off <= quantile(off, ON_GRID)
    projection = _projection(used[:, good], pixel[:, good])
    if projection is None or quantile(_off_px(projection, used, pixel), ON_GRID) > _OFF_PX:
        return None
    return _taken_apart(projection, used)


def _returns(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Flat pixels (N,) of some returns, and these (3, N); without those that are the same in
    pixels side by side: what a driver fills missing ones with.
    """
    flat = points.reshape(-1, 3)
    with np.errstate(invalid="ignore"):  # signalling NaN, of garbled messages
        same = (flat[1:] == flat[:-1]).all(axis=1)
        own = (np.abs(flat) < MOST_M).all(axis=1)  # NaN is not
    own[1:] &= ~same
    own[:-1] &= ~same
    place = np.flatnonzero(own)
    place = place[:: 1 + len(place) // _MOST_RETURNS]
    return place, flat[place].T.astype(np.float64)


def _projection(points: np.ndarray, pixel: np.ndarray) -> np.ndarray | None:
    """(3, 4) matrix that takes points (3, N) to pixels (2, N), of either sign; None where others do
    nearly as well.
    """
    to_point, x = _normalised(points)
    to_pixel, (u, v, _) = _normalised(pixel)
    none = np.zeros_like(x)
    rows = np.concatenate(
        [np.concatenate([x, none, -u * x]).T, np.concatenate([none, x, -v * x]).T]
    )
    values, vectors = np.linalg.eigh(rows.T @ rows)
    rounding = np.finfo(float).eps * values[-1]
    if not values[1] > _SURE**2 * max(values[0], rounding):
        return None
    return np.linalg.solve(to_pixel, vectors[:, 0].reshape(3, 4) @ to_point)


def _normalised(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Matrix that brings homogeneous (D, N) values about 0, their spread to 1, and these (D + 1,
    N).
    """
    size = len(values)
    mean = values.mean(axis=1)
    spread = max(float(np.sqrt(np.mean((values - mean[:, None]) ** 2))), 1e-9)
    change = np.eye(size + 1) / spread
    change[:size, size] = -mean / spread
    change[size, size] = 1.0
    return change, np.vstack([(values - mean[:, None]) / spread, np.ones(values.shape[1])])


def _off_px(projection: np.ndarray, points: np.ndarray, pixel: np.ndarray) -> np.ndarray:
    """(N,) distance of returns from their pixels; infinite where they have none."""
    u, v, depth = projection[:, :3] @ points + projection[:, 3:]
    off = np.full(len(depth), np.inf)
    some = depth != 0
    off[some] = np.hypot(
        u[some] / depth[some] - pixel[0, some], v[some] / depth[some] - pixel[1, some]
    )
    return off


def _taken_apart(
    projection: np.ndarray, points: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | None:
    """Rotation and place of the sensor with that projection; None where it is no camera's with
    square pixels, in front of which the points (3, N) lie.
    """
    projection = projection * np.sign(np.linalg.det(projection[:, :3]))
    if not np.median(projection[2, :3] @ points + projection[2, 3]) > 0:
        return None
    _, inner, turn, *_ = cv2.RQDecomp3x3(projection[:, :3])
    sign = np.sign(np.diag(inner))
    inner, turn = np.asarray(inner) * sign, np.asarray(turn) * sign[:, None]
    skew, across, down = inner[0, 1], inner[0, 0], inner[1, 1]
    if not max(abs(skew), abs(across - down)) < _SQUARE * down:
        return None
    return turn.T, -np.linalg.solve(projection[:, :3], projection[:, 3])
