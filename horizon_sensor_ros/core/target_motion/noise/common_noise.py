"""Noise that all returns of a row of the sensor, or of a column, have in common: of its readout, or
of the lines that it scans.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from horizon_sensor_ros.core.mathematics.robust import NORMAL_MEDIAN, lower_quantile
from horizon_sensor_ros.core.target_motion.ranges.range_image import RangeImage

# Fourth differences from row to row, in standard deviations of one return if these are independent:
# surfaces of third degree have none.
_BEND = np.array([1, -4, 6, -4, 1], np.float32) / np.float32(np.sqrt(70))
# Returns with such a difference in a row for its mean to count, and in all, and rows, at least.
_IN_ROW, _FEWEST, _ROWS = 8, 100, 8
_MEDIAN_SQUARE = 0.4549  # of what is normal with sigma 1
# Of so many differences that is enough.
_SCALE_OF = 1000
# Differences count up to so many standard deviations, as steps in depth are no noise.
_MOST = 2.0
# A crease or a step along a row is alike all along it, too, but in a few rows only: means beyond so
# many standard deviations of all are left out, and those beside them; asked so often.
_BEYOND, _ROUNDS = 3.0, 4
# Returns so far apart are independent; neighbours need not be.
_APART_PX = 5
# Differences are noise where all of them are at least so many times the image's, or ranges have
# been smoothed; and of columns at most: what is beyond that is steps and bends (trusses), which may
# be alike all along a row.
_AS_NOISE = 0.5, 1.3
# Standard deviation of the logarithm of a variance that the median of a row's squares tells, times
# the root of the rows: fourth differences of neighbouring rows share most of their noise. And how
# many of these what rows have in common must be beyond, as a median's tails are wide.
_SPREAD, _SURE = 2.7, 5.0
# Surfaces bend by some of a pixel's width as well, however well that is measured.
_BENDS_PX = 0.01


@dataclass(frozen=True, eq=False)
class LineMeans:
    """Of N lines of a view, rows or columns: their numbers, squares (m^2) of what their returns'
    mean lies off those beside them, and what they would be of independent noise.
    """

    place: np.ndarray
    square: np.ndarray
    independent: np.ndarray


_NONE = LineMeans(np.empty(0, np.intp), np.empty(0), np.empty(0))


def line_means(image: RangeImage, sigma_m: float) -> tuple[LineMeans, LineMeans]:
    """What rows and what columns of an image tell of noise that they have in common; without any
    line where too little is seen, or the image's pixels are not the sensor's own.

    sigma_m : noise of single returns.
    """
    if not image.on_grid:
        return _NONE, _NONE
    inverse = image.inverse_depth
    return _of_rows(inverse, sigma_m), _of_rows(np.ascontiguousarray(inverse.T), sigma_m)


def _of_rows(inverse: np.ndarray, sigma_m: float) -> LineMeans:
    whole = cv2.erode((inverse > 0).view(np.uint8), np.ones((len(_BEND), 1), np.uint8))
    place = np.flatnonzero(whole)
    if len(place) < _FEWEST:
        return _NONE
    bend = cv2.sepFilter2D(inverse, cv2.CV_32F, np.ones(1, np.float32), _BEND)
    off = bend.ravel()[place] / inverse.ravel()[place] ** 2
    count = cv2.reduce(whole, 1, cv2.REDUCE_SUM, dtype=cv2.CV_32S)[:, 0]
    first = np.concatenate([[0], np.cumsum(count)[:-1]])
    total_m, clipped = _clipped(off)
    mean = _row_means(clipped, first, count)
    # Once more about these: steps count by what columns differ by.
    _, rest = _clipped(off - mean[place // inverse.shape[1]])
    mean += _row_means(rest, first, count)
    least, greatest = _AS_NOISE
    if total_m < least * sigma_m:
        return _NONE
    variance, each = _of_independent(rest, place, whole)
    steps = max(variance - (greatest * sigma_m) ** 2, 0.0)
    enough = np.flatnonzero(count >= _IN_ROW)
    if len(enough) < _ROWS or not each > 0:
        return _NONE
    return LineMeans(enough, mean[enough].astype(float) ** 2, each / count[enough] + steps)


def _clipped(off: np.ndarray) -> tuple[float, np.ndarray]:
    """Standard deviation by the median, and what counts of each."""
    sigma = lower_quantile(np.abs(off[:: 1 + len(off) // _SCALE_OF]), 0.5) / NORMAL_MEDIAN
    most = np.float32(_MOST * sigma)
    return sigma, np.clip(off, -most, most)


def _row_means(off: np.ndarray, first: np.ndarray, count: np.ndarray) -> np.ndarray:
    """(H,) means of the ``count`` differences of each row; 0 where there are none."""
    mean = np.zeros(len(count), np.float32)
    some = np.flatnonzero(count)
    mean[some] = np.add.reduceat(off, first[some]) / count[some]
    return mean


def _of_independent(off: np.ndarray, place: np.ndarray, whole: np.ndarray) -> tuple[float, float]:
    """Variance of differences at flat indices ``place``, from which their rows' means are taken,
    and that of such a mean, times the returns: neighbours may share some of their noise.
    """
    one, value = whole.ravel().astype(np.float32), np.zeros(whole.size, np.float32)
    value[place] = off
    # The image's margin is wider than the lags, so that a row's end does not meet the next one.
    alike = [
        float(np.vdot(value[lag:], value[:-lag])) / max(float(np.vdot(one[lag:], one[:-lag])), 1.0)
        for lag in (1, 2, 3, _APART_PX)
    ]
    variance = float(np.vdot(off, off)) / len(off) - alike[-1]
    shared = sum(alike[:-1]) - 3 * alike[-1]
    return variance, max(variance + 2 * shared, variance)


def _without_creases(lines: LineMeans) -> LineMeans:
    """Those lines that lie off no farther than the others do, nor are beside one that does."""
    if not len(lines.place):
        return lines
    ratio = lines.square / lines.independent
    kept = np.ones(len(ratio), bool)
    beyond = np.zeros(int(lines.place[-1]) + 3, bool)
    for _ in range(_ROUNDS):
        scale = max(_typical(ratio[kept]), 1.0)
        beyond[:] = False
        far = lines.place[ratio > _BEYOND**2 * scale]
        for beside in (0, 1, 2):
            beyond[far + beside] = True
        left = ~beyond[lines.place + 1]
        if not left.any() or (left == kept).all():
            break
        kept = left
    return LineMeans(lines.place[kept], lines.square[kept], lines.independent[kept])


def _typical(ratio: np.ndarray) -> float:
    """Variance of what is normal, by the median of its squares."""
    return lower_quantile(ratio, 0.5) / _MEDIAN_SQUARE


def common_variance(a: LineMeans, b: LineMeans, footprint_m: float) -> float:
    """Variance (m^2) of what all ranges of a line have in common, by two views of one sensor; 0
    where independent noise, or how surfaces bend, may be all there is.

    footprint_m : width of a pixel at the target.
    """
    for creases in (True, False):
        square = np.concatenate([a.square, b.square])
        independent = np.concatenate([a.independent, b.independent])
        if len(square) < _ROWS:
            return 0.0
        spread = _SPREAD / np.sqrt(len(square))
        if _typical(square / independent) < np.exp(_SURE * spread):
            return 0.0
        if creases:
            a, b = _without_creases(a), _without_creases(b)
    typical, variance = np.median(independent), 0.0
    for _ in range(_ROUNDS):
        ratio = _typical(square / (variance + independent))
        variance = max((variance + typical) * ratio - typical, 0.0)
    if variance < (_BENDS_PX * footprint_m) ** 2:
        return 0.0
    # One standard deviation more is as likely.
    return float(variance + spread * (variance + typical))
