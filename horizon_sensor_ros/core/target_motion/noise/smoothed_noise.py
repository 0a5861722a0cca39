"""Ranges that the sensor's driver has smoothed: neighbours share their noise and tell too little of
it, and at the ends of a surface they are off.
"""

from __future__ import annotations

import cv2
import numpy as np

from horizon_sensor_ros.core.mathematics.robust import NORMAL_MEDIAN, quantile
from horizon_sensor_ros.core.target_motion.noise.mixed_differences import mixed_differences

# Lags, in pixels, at which returns are held against each other; and returns that have others all
# about them so far, at least, for a lag to count.
_FIRST, _LAGS, _FEWEST = 2, 4, 150
# Of all returns so many do at the first lag; of trusses and of plates seen nearly edge on fewer,
# and they bend where they do. Of 1600 clouds whose noise was independent 25 with less than .66 were
# taken for smoothed, and none with more.
_WITHIN = 0.7
# Noise at the first lag over that of neighbours, from which it is smoothed: in the lower quarter,
# and where it is least in squares of so many pixels. By any filter of 3 x 3 pixels these are 2.4
# and 1.9; of independent returns both are one, but creases and bends add to the former, on bodies
# of many parts up to 2.1.
_SMOOTHED, _SMOOTHED_WHERE_LEAST = 2.2, 1.7
_SIDE_PX, _LEAST, _KNOWN = 9, 0.3, 0.4
# There it is so much less than all over (simulated boxes and satellites, 10 mm).
_THERE = 0.87
# A surface ends or bends where a return lies off the middle of those beside it by so many pixels'
# widths and standard deviations.
_BEND_PX, _BEND_SIGMAS = 2.0, 1.0


def are_smoothed(inverse: np.ndarray) -> bool:
    """Whether it shows that ranges were smoothed: neighbours differ by less than returns farther
    apart; not where too few returns tell.

    inverse : (H, W) inverse depth, 0 without a return.
    """
    mixed = _mixed(inverse, _FIRST)
    if mixed is None or not _within_and_smoothed(inverse, *mixed):
        return False
    noise = _where_least(inverse.shape, *mixed)
    return noise is not None and noise[-1] > _SMOOTHED_WHERE_LEAST * noise[0]


def noise_before_smoothing(inverse: np.ndarray) -> tuple[float, float] | None:
    """Standard deviation (m) of single returns before they were smoothed, as they are known to be,
    and the mean square reach (px^2) of what smoothed them, along rows or columns; None where too
    few returns tell, or ranges are exact.

    inverse : (H, W) inverse depth, 0 without a return.

    Smoothing takes from what neighbours differ by, and nothing from what a whole window is off by:
    that is as if the noise were independent, and as large as before.
    """
    mixed = _mixed(inverse, _FIRST)
    noise = mixed and _where_least(inverse.shape, *mixed)
    # Of exact ranges all are nothing.
    if noise is None or not noise[-1] > 0:
        return None
    for lags in range(_FIRST + 1, _LAGS + 1):
        mixed = _mixed(inverse, lags)
        noise = (mixed and _where_least(inverse.shape, *mixed)) or noise
    # Along one way [1, -2, 1] of lag L has the variance 6 - 8 r(L) + 2 r(2 L), with the correlation
    # r of returns so far apart, and over both ways it is the square of that.
    each = max(noise)
    alike = np.zeros(2 * len(noise) + 1)
    for lag in range(len(noise), 0, -1):
        alike[lag] = max((6 - 6 * noise[lag - 1] / each + 2 * alike[2 * lag]) / 8, 0.0)
    total = 1 + 2 * alike.sum()
    # Returns are alike as far as two filters reach.
    reach = np.arange(len(alike)) ** 2 @ alike / total
    return float(each * total / _THERE), float(reach)


def _within_and_smoothed(inverse: np.ndarray, place: np.ndarray, mixed: list[np.ndarray]) -> bool:
    """Whether enough of the returns lie within surfaces, and neighbours differ by less than
    others.
    """
    if len(place) < _WITHIN * np.count_nonzero(inverse):
        return False
    near, far = (quantile(np.abs(each), 0.25) for each in mixed)
    # Of exact ranges both are nothing.
    return far > _SMOOTHED * near


def _mixed(inverse: np.ndarray, lags: int) -> tuple[np.ndarray, list[np.ndarray]] | None:
    """Flat indices (N,) of returns that have others all about them, and their `mixed_differences`
    (N,) at each lag; None where such are too few.
    """
    whole = cv2.erode((inverse > 0).view(np.uint8), np.ones((2 * lags + 1,) * 2, np.uint8))
    place = np.flatnonzero(whole)
    if len(place) < _FEWEST:
        return None
    return place, [mixed_differences(inverse, place, lag) for lag in range(1, lags + 1)]


def _where_least(
    shape: tuple[int, ...], place: np.ndarray, mixed: list[np.ndarray]
) -> list[float] | None:
    """Standard deviation (m) of single returns by each lag, in the squares of pixels where that of
    the last one is least, as creases add to it; None where such are too few.
    """
    square, known = np.zeros((2, *shape), np.float32)
    square.ravel()[place], known.ravel()[place] = mixed[-1] ** 2, 1
    total, count = (
        cv2.boxFilter(each, -1, (_SIDE_PX, _SIDE_PX), normalize=False).ravel()[place]
        for each in (square, known)
    )
    some = np.flatnonzero(count > _KNOWN * _SIDE_PX**2)
    if len(some) < _FEWEST:
        return None
    mean = total[some] / count[some]
    some = some[mean <= quantile(mean, _LEAST)]
    return [quantile(np.abs(each[some]), 0.5) / NORMAL_MEDIAN for each in mixed]


def without_outline(inverse: np.ndarray) -> np.ndarray:
    """(H, W) the same image of inverse depth without the returns that miss one beside them.

    A median there is that of a half window, which lies farther in.
    """
    inner = cv2.erode((inverse > 0).view(np.uint8), np.ones((3, 3), np.uint8)) > 0
    return np.where(inner, inverse, np.float32(0))


def within_surfaces(inverse: np.ndarray, sigma_m: float, focal_px: float) -> np.ndarray:
    """(H, W) the same image of inverse depth without the returns at the ends of surfaces.

    What a filter finds there is the mean of what lies farther in, in all views alike, and on a
    slanted face nearer or farther.
    """
    bend, one = np.array([1, -2, 1], np.float32), np.ones(1, np.float32)
    off = np.maximum(
        *(
            np.abs(cv2.sepFilter2D(inverse, cv2.CV_32F, *each))
            for each in ((bend, one), (one, bend))
        )
    )
    most = inverse * np.float32(_BEND_PX / focal_px)
    most += np.float32(_BEND_SIGMAS * sigma_m) * inverse * inverse
    return np.where(off < most, without_outline(inverse), np.float32(0))
