"""The local plane at each pixel of a range image."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from horizon_sensor_ros.core.mathematics.robust import lower_quantile
from horizon_sensor_ros.core.target_motion.noise.range_noise import ReturnNoise, noise_of_returns
from horizon_sensor_ros.core.target_motion.noise.smoothed_noise import (
    within_surfaces,
    without_outline,
)
from horizon_sensor_ros.core.target_motion.ranges.range_image import RangeImage
from horizon_sensor_ros.core.target_motion.surfaces.body_limb import (
    LIMB_COSINE,
    at_limb,
    limb_reach_px,
)
from horizon_sensor_ros.core.target_motion.surfaces.covered import off_middle_px
from horizon_sensor_ros.core.target_motion.surfaces.holes import without_holes
from horizon_sensor_ros.core.target_motion.surfaces.sag import sag_of_windows
from horizon_sensor_ros.core.target_motion.surfaces.windows import (
    PlaneFit,
    fit_windows,
    slope_gain,
    window_radius,
)

# A plane is trusted down to this cosine between ray and normal; a borrowed one down to the second.
_MIN_COSINE = 0.03
MIN_BORROWED_COSINE = 0.1
# So much of a pixel's width a surface may bend within a window and still count as flat.
_BEND_PX = 0.12


@dataclass(frozen=True, eq=False)
class Planes:
    """The local plane at each pixel of an image, (H, W) each.

    sigma_m : range noise of what is seen squarely.  slant_growth : k of its variance, which is
        1 + k (1 / cosine^2 - 1) times that at a slant.  footprint_m : a pixel's width at the
        target.  normal_noise_rad : of the normals.  radius_px : of the windows.
    found : bool, where there is a plane.  own : bool, where it is that of the pixel's own window,
        whole where the surface is curved; elsewhere it is borrowed from a window beside it, or of
        the part of a window that a limb leaves.  limb : bool, where that is the limb of a curved
        body and the plane leans towards the sensor.
    level, slope_u, slope_v : float32, inverse depth of the plane at the pixel, and its change from
        one pixel to the next; without a plane that of the return, and 0.
    cosine : float32, between ray and normal.  noise : float32, of one return, of inverse depth.
    off_px : (H W) float32, of where in its pixel a return lies, see `off_middle_px`.
    points, normals : (H W, 3) float32, where the ray meets the plane, and its normal towards the
        sensor; without a plane the return itself, and 0.
    """

    sigma_m: float
    slant_growth: float
    footprint_m: float
    normal_noise_rad: float
    radius_px: int
    found: np.ndarray
    own: np.ndarray
    limb: np.ndarray
    level: np.ndarray
    slope_u: np.ndarray
    slope_v: np.ndarray
    cosine: np.ndarray
    noise: np.ndarray
    off_px: np.ndarray
    points: np.ndarray
    normals: np.ndarray


def local_planes(image: RangeImage, sigma_m: float | None = None) -> Planes:
    """Fit planes to a range image whose status is OK.

    sigma_m : range noise of what is seen squarely; None: estimated from the image. By how much it
        grows with the slant always is.
    """
    inverse = image.inverse_depth
    seen = inverse > 0
    fit, known = _fit_and_noise(image, seen, sigma_m)
    sigma, footprint, radius = known.sigma_m, known.footprint_m, known.radius_px
    each = np.float32(sigma) * known.gain
    noise = each * inverse * inverse + inverse * np.float32(_BEND_PX / image.focal_px)
    flat = fit.flat(noise * known.smoothed)
    sag, bends, curved = sag_of_windows(fit, flat, each, radius)
    full = (2 * radius + 1) ** 2 - 0.5
    fit = replace(fit, level=fit.level + sag * known.sag_gain)
    # Where windows are cut off, those beside them tell whether the surface is curved.
    near = cv2.dilate(curved.view(np.uint8), np.ones((2 * radius + 1,) * 2, np.uint8)) > 0
    flat &= (fit.count > full) | ~near
    own, lending = flat.ravel(), (flat & ~bends).ravel()
    found, slope_u, slope_v, level, lender = _borrow_planes(
        fit, own, lending, seen, inverse, noise, radius
    )
    returns = np.flatnonzero(seen)
    ray = _rays(image, returns)
    some = np.flatnonzero(found[returns])
    at, (x, y, one) = returns[some], ray[:, some]
    focal = np.float32(image.focal_px)
    a, b, w = slope_u[at] * focal, slope_v[at] * focal, level[at]
    c = w - a * x - b * y
    length = np.sqrt(a * a + b * b + c * c)
    slant = w / (length * np.sqrt(one + x * x + y * y))
    good = slant > np.where(own[at], np.float32(_MIN_COSINE), np.float32(MIN_BORROWED_COSINE))
    found[at] = good
    good = np.flatnonzero(good)
    at = at[good]
    of_planes = level[at], slope_u[at], slope_v[at], slant[good]
    level = inverse.ravel().copy()
    slope_u, slope_v, cosine = np.zeros((3, inverse.size), np.float32)
    level[at], slope_u[at], slope_v[at], cosine[at] = of_planes
    points, normals = np.zeros((2, inverse.size, 3), np.float32)
    points[returns] = (ray / level[returns]).T
    normals[at] = (np.array([a, b, c]) / -length).take(good, axis=1).T
    shape = inverse.shape
    own &= found
    limb = np.zeros(inverse.size, bool)
    cut = at[(cosine[at] < LIMB_COSINE) & (fit.count.ravel()[at] < full)]
    limb[cut] = at_limb(cut, slope_u, slope_v, cosine, normals, limb_reach_px(radius), shape[1])
    # So does a plane that comes from there.
    limb |= limb[lender]
    own &= ~limb
    return Planes(
        sigma, known.slant_growth, footprint, sigma / footprint / slope_gain(radius), radius,
        found.reshape(shape), own.reshape(shape), limb.reshape(shape), level.reshape(shape),
        slope_u.reshape(shape), slope_v.reshape(shape), cosine.reshape(shape), noise,
        off_middle_px(image), points, normals,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Noise:
    """Noise of ranges, as of `Planes`, and that of each (H, W) over that of what is seen squarely,
    or 1; a pixel's width at the target; radius of the windows; how much of the noise smoothing
    has left within a window; and by how much farther than these a curved surface leads what was
    smoothed before.
    """

    sigma_m: float
    slant_growth: float
    gain: np.ndarray | np.float32
    footprint_m: float
    radius_px: int
    smoothed: float = 1.0
    sag_gain: float = 1.0


def _fit_and_noise(
    image: RangeImage, seen: np.ndarray, sigma_m: float | None
) -> tuple[PlaneFit, _Noise]:
    """Planes in windows as wide as the noise asks for, and what they tell of it."""
    middle = lower_quantile(image.inverse_depth[seen], 0.5)
    footprint = 1 / (middle * image.focal_px)
    noise = noise_of_returns(image) if sigma_m is None else ReturnNoise(sigma_m)
    least = 1e-3 * footprint
    sigma = max(noise.sigma_m, least)
    radius = window_radius(sigma / footprint, seen if image.on_grid else None)
    filled = without_holes(image.inverse_depth)
    if noise.reach_px2:
        filled = within_surfaces(filled, sigma, image.focal_px)
    elif noise.smoothed:
        filled = without_outline(filled)
    fit = fit_windows(filled, seen, middle, radius)
    if noise.stepped:
        return fit, _Noise(sigma, 0.0, np.float32(1), footprint, radius)
    growth, gain = fit.slant_noise(image, radius, max(sigma_m or 0.0, least))
    left = 1.0
    if noise.smoothed:
        left = fit.noise_m(sigma, radius, gain) / sigma
    elif sigma_m is None:
        sigma = max(fit.noise_m(sigma, radius, gain), least)
    sag_gain = 1 + noise.reach_px2 / (radius * (radius + 1) / 3)
    return fit, _Noise(sigma, growth, gain, footprint, radius, left, sag_gain)


def _rays(image: RangeImage, pixel: np.ndarray) -> np.ndarray:
    """Rays (3, N) float32, of depth 1, through flat pixel indices (N,)."""
    tan_u, tan_v = (tangent.astype(np.float32) for tangent in image.tangents())
    row, column = np.divmod(pixel, image.inverse_depth.shape[1])
    ray = np.ones((3, len(pixel)), np.float32)
    ray[0], ray[1] = tan_u[column], tan_v[row]
    return ray


def _borrow_planes(
    fit: PlaneFit,
    own: np.ndarray,
    lending: np.ndarray,
    seen: np.ndarray,
    inverse: np.ndarray,
    noise: np.ndarray,
    radius: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Where there is a plane, its slopes and level, and the pixel whose window it is of, all flat;
    where a window straddles an edge, of one beside it that does not and is ``lending``.
    """
    found, lender = own.copy(), np.arange(own.size)
    slope_u, slope_v, level = (m.ravel().copy() for m in (fit.slope_u, fit.slope_v, fit.level))
    here = np.flatnonzero(seen.ravel() & ~own)
    if not len(here):
        return found, slope_u, slope_v, level, lender
    # The image's margin is wider than a window, so that every return has all eight beside it.
    beside = np.array(
        [(u, v) for v in (-radius, 0, radius) for u in (-radius, 0, radius) if u or v]
    )
    du, dv = beside.T.astype(np.float32)[:, :, None]
    there = here + (beside @ (1, inverse.shape[1]))[:, None]
    offered = np.where(lending, level, np.float32(np.inf))
    guess = offered[there] - slope_u[there] * du - slope_v[there] * dv
    off = np.abs(guess - inverse.ravel()[here])
    best = np.argmin(off, axis=0)
    pick = best * len(here) + np.arange(len(here))
    good = np.flatnonzero(off.take(pick) < 2.5 * noise.ravel()[here])
    here, pick = here[good], pick[good]
    level[here], found[here] = guess.take(pick), True
    there = there.take(pick)
    slope_u[here], slope_v[here] = slope_u[there], slope_v[there]
    lender[here] = there
    return found, slope_u, slope_v, level, lender


def normal_noise(
    sigma_m: float,
    slant_growth: float,
    footprint_m: float,
    cosine: np.ndarray,
    tilt_rad: np.ndarray,
    off_px: np.ndarray,
) -> np.ndarray:
    """Standard deviation (m) along the normal of one measurement on a plane seen at ``cosine`` to
    its normal, of a place ``off_px`` beside the pixel's middle.

    Range noise shrinks with the cosine, unless it grows as one over that. A window that passed as
    flat bends little between its pixels; a borrowed plane (``tilt_rad`` not 0) may, the more so at
    a slant, where pixels lie wide apart.
    """
    slant = np.maximum(cosine, MIN_BORROWED_COSINE)
    bend = footprint_m * (0.05 + 0.008 * (tilt_rad > 0) / (slant * slant))
    across2 = sigma_m**2 * (cosine * cosine + slant_growth * (1 - cosine * cosine))
    aside = footprint_m * off_px
    return np.sqrt(across2 + bend * bend + aside * aside * (1 - cosine * cosine))
