"""Noise of a cloud's ranges: how large it is, and how it grows with the slant of what is seen."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from horizon_sensor_ros.core.mathematics.robust import lower_quantile
from horizon_sensor_ros.core.target_motion.noise.mixed_differences import mixed_differences
from horizon_sensor_ros.core.target_motion.noise.repeated_returns import are_repeated
from horizon_sensor_ros.core.target_motion.noise.smoothed_noise import (
    are_smoothed,
    noise_before_smoothing,
)
from horizon_sensor_ros.core.target_motion.ranges.range_image import RangeImage

# Ranges come in steps that matter where these are above such a share of the noise.
_COARSE_STEP = 0.2
# Squared secant of the slant where no plane is known; and what noise grows up to.
NO_PLANE = np.float32(1e6)
_MOST_SECANT2 = np.float32(100)
# Returns are grouped by their slant into so many groups, of so many returns at least.
_GROUPS, _FEWEST = 12, 20
# They have returns all about them, so far, which bars have not; and in the windows about them the
# squared secant is so many times the least of them at most: more, and it is no slant but a step.
_WHOLE_PX, _ALIKE = 2, 2.0
# Where such are less than this share of all, the rest is bars, and so are some of them: of trusses
# they are a seventh at most, of bodies with faces a fifth at least.
_WITHIN = 0.2
# Noise of a group is told by this share of its squares, as edges add to the largest. Of a normal
# distribution that is at this one; and the variance of its square, relative, times the returns:
# twice that of independent ones, as neighbours share what they are made of.
_SHARE, _AT_SHARE, _SPREAD = 0.7, 1.03643**2, 2 * 3.6
# A median of 3 x 3 leaves of what neighbours differ by a sixth on surfaces seen squarely, where all
# nine may be it, and up to two thirds at slants, where but three may: noise was no more than this
# many times what is left, between these.
_BEFORE_MEDIAN = 4.0
# With less noise ranges are those of a drawing, which repeat on what it shows squarely.
_DRAWN_M = 1e-4
# Growth counts where it is so many of its standard deviations. Any up to that of one over the
# cosine is likely (one sigma), and this the most.
_SURE, _LIKELY, _MOST = 2.0, 1.0, 4.0


@dataclass(frozen=True)
class ReturnNoise:
    """Noise of single returns, before a driver smoothed them.

    sigma_m : one standard deviation.  stepped : whether it is mostly that of coarse steps.
    smoothed : whether a driver smoothed them, by a mean of neighbours or by a median: planes then
        tell no better noise.  reach_px2 : mean square reach of what took means of them; 0 of a
        median, which keeps steps and, of a slanted surface, how it bends.
    """

    sigma_m: float
    stepped: bool = False
    smoothed: bool = False
    reach_px2: float = 0.0


def noise_of_returns(image: RangeImage) -> ReturnNoise:
    """Noise of an image's returns."""
    inverse = image.inverse_depth
    seen = inverse > 0
    noise_m = _range_noise(inverse, seen)
    if image.range_step_m > _COARSE_STEP * noise_m:
        return ReturnNoise(_stepped_noise(inverse, seen, image.range_step_m), stepped=True)
    # Lines of a lidar are no neighbours.
    if not image.on_grid:
        return ReturnNoise(noise_m)
    if noise_m > _DRAWN_M and are_repeated(inverse, *image.tangents()):
        most_m = _BEFORE_MEDIAN * noise_m
        before = noise_before_smoothing(inverse)
        sigma_m = most_m if before is None else min(max(before[0], noise_m), most_m)
        return ReturnNoise(sigma_m, smoothed=True)
    before = noise_before_smoothing(inverse) if are_smoothed(inverse) else None
    if before is None:
        return ReturnNoise(noise_m)
    return ReturnNoise(max(before[0], noise_m), smoothed=True, reach_px2=before[1])


def slant_growth(inverse: np.ndarray, secant2: np.ndarray, side: int, least_m: float) -> float:
    """By how much the noise's variance grows with the slant: k in sigma^2 (1 + k (secant^2 - 1)), 1
    where noise is as one over the cosine; 0 where it is even, or too little is seen to tell.

    inverse : (H, W) inverse depth, 0 without a return.  secant2 : (H, W) float32, squared secant of
        the angle between ray and normal, `NO_PLANE` where that is not known, of windows ``side``
        wide.  least_m : noise of what is seen squarely is at least this.
    """
    place, steep = _alike(inverse, secant2, side)
    size = len(place) // _GROUPS
    if size < _FEWEST or len(place) < _WITHIN * np.count_nonzero(inverse):
        return 0.0
    square = mixed_differences(inverse, place) ** 2
    order = np.argsort(steep)[-size * _GROUPS :].reshape(_GROUPS, size)
    rank = int(_SHARE * size)
    variance = np.partition(square[order], rank, axis=1)[:, rank].astype(float) / _AT_SHARE
    rows = np.array([np.ones(_GROUPS), steep[order].mean(axis=1)])
    model = np.full(_GROUPS, max(np.median(variance), least_m**2))
    for _ in range(3):
        weight = size / (_SPREAD * model**2)
        known = np.linalg.inv((rows * weight) @ rows.T)
        even, growth = known @ (rows @ (weight * variance))
        model = np.maximum(even + growth * rows[1], model / 4)
    # What does not follow the line is no slant's noise.
    misfit = weight @ (variance - even - growth * rows[1]) ** 2 / (_GROUPS - 2)
    sigma2 = known[1, 1] * max(misfit, 1.0)
    if not growth > _SURE * np.sqrt(sigma2):
        return 0.0
    squarely = max(even, variance[0] / (1 + _MOST * rows[1, 0]), least_m**2)
    return float(min(growth / (squarely + sigma2 / (squarely * _LIKELY**2)), _MOST))


def _alike(inverse: np.ndarray, secant2: np.ndarray, side: int) -> tuple[np.ndarray, np.ndarray]:
    """Flat indices (N,) of returns within one surface, as of `slant_growth`, and the square of
    their slant's tangent (N,), the mean of the windows about them.
    """
    window = np.ones((side, side), np.uint8)
    known = secant2 < NO_PLANE
    of_known = np.where(known, secant2, np.float32(0))
    whole = cv2.erode((inverse > 0).view(np.uint8), np.ones((2 * _WHOLE_PX + 1,) * 2, np.uint8))
    one_surface = cv2.dilate(of_known, window) < _ALIKE * cv2.erode(secant2, window)
    place = np.flatnonzero((whole > 0) & known & one_surface)
    total = cv2.boxFilter(of_known, -1, (side, side), normalize=False).ravel()[place]
    count = cv2.boxFilter(known.astype(np.float32), -1, (side, side), normalize=False)
    return place, total / count.ravel()[place] - 1


def least_gain(secant2: np.ndarray, growth: float, side: int) -> np.ndarray:
    """(H, W) float32 noise of each return over that of what is seen squarely, as of `slant_growth`.

    By the least slant of the windows about it, as one across a step in depth slants as well.
    """
    least = cv2.erode(secant2, np.ones((side, side), np.uint8))
    steep = np.where(least < NO_PLANE, np.minimum(least, _MOST_SECANT2), np.float32(1)) - 1
    return np.sqrt(1 + np.float32(growth) * steep)


def _range_noise(inverse: np.ndarray, seen: np.ndarray) -> float:
    """Standard deviation (m) from second differences along the rows, which planes do not have."""
    three = seen[:, :-2] & seen[:, 1:-1] & seen[:, 2:]
    bend = np.abs(inverse[:, :-2] - 2 * inverse[:, 1:-1] + inverse[:, 2:])[three]
    if not bend.size:
        return 0.0
    # The lower quarter, as edges and thin parts bend as well: 0.319 standard deviations of a
    # normal distribution.
    return lower_quantile(bend / inverse[:, 1:-1][three] ** 2, 0.25) / (0.3186 * np.sqrt(6))


def _stepped_noise(inverse: np.ndarray, seen: np.ndarray, step_m: float) -> float:
    """Standard deviation (m) of ranges that come in whole steps, rounding included.

    Steps make many neighbours equal, as if there were no noise; spread over the step they came
    from, they show it again.
    """
    spread = np.random.default_rng(0).uniform(-step_m / 2, step_m / 2, inverse.shape)
    square = _range_noise(inverse + (spread * inverse * inverse).astype(np.float32), seen) ** 2
    rounding = step_m * step_m / 12
    return float(np.sqrt(max(square - rounding, rounding)))
