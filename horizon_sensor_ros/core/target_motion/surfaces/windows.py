"""Planes fitted by least squares in windows about every pixel.

In a pinhole image a plane n.p = d has inverse depth w = (n / d).(x/z, y/z, 1): linear in the
image. So a local least squares plane takes ten box filters over the whole image and no neighbour
search.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from horizon_sensor_ros.core.mathematics.robust import lower_quantile
from horizon_sensor_ros.core.target_motion.noise.range_noise import (
    NO_PLANE,
    least_gain,
    slant_growth,
)
from horizon_sensor_ros.core.target_motion.ranges.range_image import RangeImage

# Noise of normals to be asked of windows. These are no wider than leaves such a share of them
# whole; or narrow ones if at least the second share of those is: on slats two pixels wide none is.
_MOST_NOISE_RAD = 0.065
_WIDE, _NARROW = 0.5, 0.2
# Mean square residual of a window over the expected one, up to which it holds one plane.
_FLAT = 2.0


def window_radius(noise_px: float, seen: np.ndarray | None) -> int:
    """Smallest window (2 r + 1 wide) whose normals are good to some 3 deg; of a narrow target some
    6 deg do. Noise in pixel widths.

    seen : of an image of the sensor's own pixels. Only whole windows tell how far a curved surface
    leads its planes. Those as wide as a target's parts pass behind them by a quarter of a pixel's
    width, which nothing claims, and not so in another view whose noise came out a little smaller.
    """
    wanted, least = (
        next((r for r in (2, 3, 4, 5) if noise_px < most_rad * slope_gain(r)), 6)
        for most_rad in (_MOST_NOISE_RAD, 2 * _MOST_NOISE_RAD)
    )
    if seen is None or wanted == least:
        return wanted
    # Lone missing returns are no gap.
    whole = cv2.morphologyEx(seen.view(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    count = np.count_nonzero(whole)
    inner = 0
    for radius in range(wanted, least - 1, -1):
        inner = int(np.count_nonzero(cv2.erode(whole, np.ones((2 * radius + 1,) * 2, np.uint8))))
        if inner > _WIDE * count:
            return radius
    return least if inner > _NARROW * count else wanted


def slope_gain(radius: int) -> float:
    """By how much a window's slope (depth a pixel) is better known than one depth."""
    return float((2 * radius + 1) * np.sqrt(radius * (radius + 1) / 3))


@dataclass(frozen=True, eq=False)
class PlaneFit:
    """Windowed least squares at every pixel: inverse depth about its middle, level, slopes a pixel,
    mean square residual, returns used, where defined.
    """

    about_middle: np.ndarray
    level: np.ndarray
    slope_u: np.ndarray
    slope_v: np.ndarray
    mean_square: np.ndarray
    count: np.ndarray
    defined: np.ndarray

    def noise_m(self, guess_m: float, radius: int, gain: np.ndarray | np.float32) -> float:
        """Range noise from the flattest windows, each by its ``gain``; ``guess_m`` where they are
        few or it is the lower.
        """
        dof = (2 * radius + 1) ** 2 - 3
        full = self.defined & (self.count > dof)
        if np.count_nonzero(full) < 50:
            return guess_m
        # Of chi squared per degree of freedom a tenth lies below this (Wilson and Hilferty).
        tenth = (1 - 2 / (9 * dof) - 1.2816 * np.sqrt(2 / (9 * dof))) ** 3
        square = (self.mean_square / (gain * gain))[full] / self.level[full] ** 4
        return min(guess_m, float(np.sqrt(lower_quantile(square, 0.1) / tenth)))

    def slant_noise(
        self, image: RangeImage, radius: int, least_m: float
    ) -> tuple[float, np.ndarray | np.float32]:
        """By how much range noise grows with the slant, and each return's over that of what is seen
        squarely, which is ``least_m`` or more.
        """
        secant2, side = self._secant2(image), 2 * radius + 1
        growth = slant_growth(image.inverse_depth, secant2, side, least_m)
        return growth, least_gain(secant2, growth, side) if growth else np.float32(1)

    def _secant2(self, image: RangeImage) -> np.ndarray:
        """(H, W) squared secant of the angle between ray and normal; `NO_PLANE` where none is
        defined.
        """
        tan_u, tan_v = (tangent.astype(np.float32) for tangent in image.tangents())
        focal = np.float32(image.focal_px)
        tan_v = tan_v[:, None]
        a, b = focal * self.slope_u, focal * self.slope_v
        c = self.level - a * tan_u - b * tan_v
        secant2 = np.full(self.level.shape, NO_PLANE)
        square = (a * a + b * b + c * c) * (1 + tan_u * tan_u + tan_v * tan_v)
        np.divide(square, self.level * self.level, out=secant2, where=self.defined)
        return np.minimum(secant2, NO_PLANE)

    def flat(self, noise: np.ndarray) -> np.ndarray:
        """(H, W) bool, whether a window holds one plane, by the noise (H, W) of a return."""
        return self.defined & (self.mean_square < _FLAT * noise * noise)


def box(image: np.ndarray, kernel_u: np.ndarray, kernel_v: np.ndarray) -> np.ndarray:
    """(H, W) float32 sums over the windows, weighted by kernels along rows and columns."""
    return cv2.sepFilter2D(image, cv2.CV_32F, kernel_u, kernel_v, borderType=cv2.BORDER_CONSTANT)


def fit_windows(inverse: np.ndarray, seen: np.ndarray, middle: float, radius: int) -> PlaneFit:
    """Fit planes to an image (H, W) of inverse depth, 0 without a return, about the pixels ``seen``
    (H, W); ``middle`` : a typical inverse depth.
    """
    mask = (inverse > 0).astype(np.float32)
    # About the middle, so that single precision does for the squares.
    w = (inverse - np.float32(middle)) * mask
    one = np.ones(2 * radius + 1, np.float32)
    ramp = np.arange(-radius, radius + 1, dtype=np.float32)
    n = box(mask, one, one)
    count = np.maximum(n, 1)
    mean_u, mean_v = box(mask, ramp, one) / count, box(mask, one, ramp) / count
    mean_w = box(w, one, one) / count
    uu = box(mask, ramp * ramp, one) - n * mean_u * mean_u
    vv = box(mask, one, ramp * ramp) - n * mean_v * mean_v
    uv = box(mask, ramp, ramp) - n * mean_u * mean_v
    uw = box(w, ramp, one) - n * mean_u * mean_w
    vw = box(w, one, ramp) - n * mean_v * mean_w
    ww = box(w * w, one, one) - n * mean_w * mean_w
    full = (2 * radius + 1) ** 2
    det = uu * vv - uv * uv
    spread = full * radius * (radius + 1) / 3
    defined = seen & (n >= 0.45 * full) & (det > 0.02 * spread * spread)
    det = np.where(defined, det, np.float32(1))
    slope_u, slope_v = (vv * uw - uv * vw) / det, (uu * vw - uv * uw) / det
    rest = np.maximum(ww - slope_u * uw - slope_v * vw, 0)
    level = mean_w - slope_u * mean_u - slope_v * mean_v + np.float32(middle)
    defined &= level > 0.2 * middle
    return PlaneFit(w, level, slope_u, slope_v, rest / np.maximum(n - 3, 1), n, defined)
