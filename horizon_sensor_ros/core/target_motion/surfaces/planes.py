"""Local planes of a range image.

In a pinhole image a plane n.p = d has inverse depth w = (n / d).(x/z, y/z, 1): linear in the
image. So a local least squares plane takes ten box filters over the whole image and no neighbour
search.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from horizon_sensor_ros.core.target_motion.noise.range_noise import (
    NO_PLANE,
    ReturnNoise,
    least_gain,
    least_share,
    noise_of_returns,
    slant_growth,
)
from horizon_sensor_ros.core.target_motion.noise.smoothed_noise import (
    within_surfaces,
    without_outline,
)
from horizon_sensor_ros.core.target_motion.ranges.range_image import RangeImage
from horizon_sensor_ros.core.target_motion.surfaces.holes import without_holes

# A plane is trusted down to this cosine between ray and normal; a borrowed one down to the second.
_MIN_COSINE = 0.03
MIN_BORROWED_COSINE = 0.1
# So much of a pixel's width a surface may bend within a window and still count as flat.
_BEND_PX = 0.12
# Noise of normals to be asked of windows. These are no wider than leaves such a share of them
# whole; or narrow ones if at least the second share of those is: on slats two pixels wide none is.
_MOST_NOISE_RAD = 0.065
_WIDE, _NARROW = 0.5, 0.2
# Mean square residual of a window over the expected one, up to which it holds one plane.
_FLAT = 2.0
# Squared ratio of the mean sag of windows to its noise, beyond which a surface counts as curved:
# carried on to the pixels beside it its planes would lie off it, and those of windows cut off by
# its limb lie off it and lean, in both views alike. Three standard deviations where the noise is
# twice as large, as at a slant.
_CURVED = 36.0
# Where a surface turns edge-on at less than this cosine, and within two windows bends towards the
# sensor by an angle with a cosine between these, that is the limb of a curved body; what bends more
# is another face.
_LIMB_COSINE = 0.5
LIMB_BEND = np.cos(np.radians([10.0, 55.0]))


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
    sag, bends, curved = _sag(fit, flat, each, radius)
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
    cut = at[(cosine[at] < _LIMB_COSINE) & (fit.count.ravel()[at] < full)]
    limb[cut] = _at_limb(cut, slope_u, slope_v, cosine, normals, limb_reach_px(radius), shape[1])
    # So does a plane that comes from there.
    limb |= limb[lender]
    own &= ~limb
    return Planes(
        sigma, known.slant_growth, footprint, sigma / footprint / _slope_gain(radius), radius,
        found.reshape(shape), own.reshape(shape), limb.reshape(shape), level.reshape(shape),
        slope_u.reshape(shape), slope_v.reshape(shape), cosine.reshape(shape), noise, points,
        normals,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Noise:
    """Noise of ranges, as of `Planes`, and that of each (H, W) over that of what is seen squarely,
    or 1; a pixel's width at the target; radius of the windows; how much of the noise smoothing
    has left within a window; and by how much farther than these a curved surface leads what was
    smoothed before."""

    sigma_m: float
    slant_growth: float
    gain: np.ndarray | np.float32
    footprint_m: float
    radius_px: int
    smoothed: float = 1.0
    sag_gain: float = 1.0


def _fit_and_noise(
    image: RangeImage, seen: np.ndarray, sigma_m: float | None
) -> tuple[_PlaneFit, _Noise]:
    """Planes in windows as wide as the noise asks for, and what they tell of it."""
    middle = least_share(image.inverse_depth[seen], 0.5)
    footprint = 1 / (middle * image.focal_px)
    told = noise_of_returns(image) if sigma_m is None else ReturnNoise(sigma_m)
    least = 1e-3 * footprint
    sigma = max(told.sigma_m, least)
    radius = _window_radius(sigma / footprint, seen if image.on_grid else None)
    filled = without_holes(image.inverse_depth)
    if told.reach_px2:
        filled = within_surfaces(filled, sigma, image.focal_px)
    elif told.smoothed:
        filled = without_outline(filled)
    fit = _plane_fit(filled, seen, middle, radius)
    if told.stepped:
        return fit, _Noise(sigma, 0.0, np.float32(1), footprint, radius)
    growth, gain = fit.slant_noise(image, radius, max(sigma_m or 0.0, least))
    left = 1.0
    if told.smoothed:
        left = fit.noise_m(sigma, radius, gain) / sigma
    elif sigma_m is None:
        sigma = max(fit.noise_m(sigma, radius, gain), least)
    sag_gain = 1 + told.reach_px2 / (radius * (radius + 1) / 3)
    return fit, _Noise(sigma, growth, gain, footprint, radius, left, sag_gain)


def limb_reach_px(radius_px: int) -> int:
    """So far within its end the bend of a surface is looked for: there the windows share no return
    with those at the end."""
    return 2 * radius_px + 1


def _at_limb(
    place: np.ndarray,
    slope_u: np.ndarray,
    slope_v: np.ndarray,
    cosine: np.ndarray,
    normals: np.ndarray,
    reach_px: int,
    width: int,
) -> np.ndarray:
    """Which of the flat indices ``place`` (P,) show the limb of a curved body.

    The window of a pixel there is cut off by the limb, so that its plane is that of the surface
    farther in and leans towards the sensor: by 3 to 10 deg, in both views alike, however the body
    has turned. What tells it from a slanted face is the surface farther in, along the steepest
    slope, which has turned on towards the sensor.
    """
    steepest = np.array([slope_u[place], slope_v[place]])
    steepest *= reach_px / np.maximum(np.sqrt((steepest * steepest).sum(axis=0)), 1e-12)
    du, dv = np.rint(steepest).astype(np.int64)
    inwards = np.clip(place + dv * width + du, 0, len(cosine) - 1)
    bend = np.einsum("ij,ij->i", normals[place], normals[inwards])
    return (cosine[inwards] > cosine[place]) & (LIMB_BEND[1] < bend) & (bend < LIMB_BEND[0])


def _rays(image: RangeImage, pixel: np.ndarray) -> np.ndarray:
    """Rays (3, N) float32, of depth 1, through flat pixel indices (N,)."""
    tan_u, tan_v = (tangent.astype(np.float32) for tangent in image.tangents())
    row, column = np.divmod(pixel, image.inverse_depth.shape[1])
    ray = np.ones((3, len(pixel)), np.float32)
    ray[0], ray[1] = tan_u[column], tan_v[row]
    return ray


def _window_radius(noise_px: float, seen: np.ndarray | None) -> int:
    """Smallest window (2 r + 1 wide) whose normals are good to some 3 deg; of a narrow target some
    6 deg do. Noise in pixel widths.

    seen : of an image of the sensor's own pixels. Only whole windows tell how far a curved surface
    leads its planes. Those as wide as a target's parts pass behind them by a quarter of a pixel's
    width, which nothing claims, and not so in another view whose noise came out a little smaller.
    """
    wanted, least = (
        next((r for r in (2, 3, 4, 5) if noise_px < most_rad * _slope_gain(r)), 6)
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


def _slope_gain(radius: int) -> float:
    """By how much a window's slope (depth a pixel) is better known than one depth."""
    return float((2 * radius + 1) * np.sqrt(radius * (radius + 1) / 3))


@dataclass(frozen=True, eq=False)
class _PlaneFit:
    """Windowed least squares at every pixel: inverse depth about its middle, level, slopes a pixel,
    mean square residual, returns used, where defined."""

    about_middle: np.ndarray
    level: np.ndarray
    slope_u: np.ndarray
    slope_v: np.ndarray
    mean_square: np.ndarray
    count: np.ndarray
    defined: np.ndarray

    def noise_m(self, guess_m: float, radius: int, gain: np.ndarray | np.float32) -> float:
        """Range noise from the flattest windows, each by its ``gain``; ``guess_m`` where they are
        few or it is the lower."""
        dof = (2 * radius + 1) ** 2 - 3
        full = self.defined & (self.count > dof)
        if np.count_nonzero(full) < 50:
            return guess_m
        # Of chi squared per degree of freedom a tenth lies below this (Wilson and Hilferty).
        tenth = (1 - 2 / (9 * dof) - 1.2816 * np.sqrt(2 / (9 * dof))) ** 3
        square = (self.mean_square / (gain * gain))[full] / self.level[full] ** 4
        return min(guess_m, float(np.sqrt(least_share(square, 0.1) / tenth)))

    def slant_noise(
        self, image: RangeImage, radius: int, least_m: float
    ) -> tuple[float, np.ndarray | np.float32]:
        """By how much range noise grows with the slant, and each return's over that of what is seen
        squarely, which is ``least_m`` or more."""
        secant2, side = self._secant2(image), 2 * radius + 1
        growth = slant_growth(image.inverse_depth, secant2, side, least_m)
        return growth, least_gain(secant2, growth, side) if growth else np.float32(1)

    def _secant2(self, image: RangeImage) -> np.ndarray:
        """(H, W) squared secant of the angle between ray and normal; `NO_PLANE` where none is
        defined."""
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
        return self.defined & (self.mean_square < _FLAT * noise * noise)


def _box(image: np.ndarray, kernel_u: np.ndarray, kernel_v: np.ndarray) -> np.ndarray:
    return cv2.sepFilter2D(image, cv2.CV_32F, kernel_u, kernel_v, borderType=cv2.BORDER_CONSTANT)


def _plane_fit(inverse: np.ndarray, seen: np.ndarray, middle: float, radius: int) -> _PlaneFit:
    mask = (inverse > 0).astype(np.float32)
    # About the middle, so that single precision does for the squares.
    w = (inverse - np.float32(middle)) * mask
    one = np.ones(2 * radius + 1, np.float32)
    ramp = np.arange(-radius, radius + 1, dtype=np.float32)
    n = _box(mask, one, one)
    count = np.maximum(n, 1)
    mean_u, mean_v = _box(mask, ramp, one) / count, _box(mask, one, ramp) / count
    mean_w = _box(w, one, one) / count
    uu = _box(mask, ramp * ramp, one) - n * mean_u * mean_u
    vv = _box(mask, one, ramp * ramp) - n * mean_v * mean_v
    uv = _box(mask, ramp, ramp) - n * mean_u * mean_v
    uw = _box(w, ramp, one) - n * mean_u * mean_w
    vw = _box(w, one, ramp) - n * mean_v * mean_w
    ww = _box(w * w, one, one) - n * mean_w * mean_w
    full = (2 * radius + 1) ** 2
    det = uu * vv - uv * uv
    spread = full * radius * (radius + 1) / 3
    defined = seen & (n >= 0.45 * full) & (det > 0.02 * spread * spread)
    det = np.where(defined, det, np.float32(1))
    slope_u, slope_v = (vv * uw - uv * vw) / det, (uu * vw - uv * uw) / det
    rest = np.maximum(ww - slope_u * uw - slope_v * vw, 0)
    level = mean_w - slope_u * mean_u - slope_v * mean_v + np.float32(middle)
    defined &= level > 0.2 * middle
    return _PlaneFit(w, level, slope_u, slope_v, rest / np.maximum(n - 3, 1), n, defined)


def _sag(
    fit: _PlaneFit, flat: np.ndarray, sigma_m: np.ndarray | np.float32, radius: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """By how much a curved surface leads the planes fitted to it, where it bends, and where it is
    curved: bends alike from window to window.

    The plane of a window passes behind the middle of a dome, the farther the more slanted the dome
    is seen: two views of it would differ, all over the surface alike. What a fit of second degree
    adds in the middle of full windows is noise one by one, so they are averaged over a
    neighbourhood; not where it differs from window to window, as about an edge.
    """
    side = 2 * radius + 1
    one = np.ones(side, np.float32)
    square = np.arange(-radius, radius + 1, dtype=np.float32) ** 2
    bump = square - square.mean()
    gain = -square.mean() / (side * float(bump @ bump))
    full = (flat & (fit.count > side * side - 0.5)).astype(np.float32)
    lead = full * gain * (_box(fit.about_middle, bump, one) + _box(fit.about_middle, one, bump))
    noise = np.float32(abs(gain) * np.sqrt(2 * side * float(bump @ bump))) * sigma_m * fit.level**2
    count = _box(full, one, one)
    some = np.maximum(count, 1)
    mean = _box(lead, one, one) / some
    square_m, square_n = mean * mean, noise * noise
    enough = count > 0.5 * side * side
    alike = _box(lead * lead, one, one) / some - square_m < 4 * square_n + 0.25 * square_m
    # On the surface's border a window may have neighbours on another one only.
    alike &= (full == 0) | (np.abs(lead - mean) < 4 * noise + 0.5 * np.abs(mean))
    # The mean of windows that overlap, over as many about them, is as much surer.
    sums = [np.convolve(each, one / side) for each in (bump, one)]
    surer = np.float32(bump @ bump * side / np.prod([each @ each for each in sums]))
    share = count / (side * side)
    bends = square_m * (1 + (surer - 1) * share * share) > _CURVED * square_n
    bends &= share > 0.15
    return np.where(enough & alike & flat, mean, np.float32(0)), bends, bends & alike


def _borrow_planes(
    fit: _PlaneFit,
    own: np.ndarray,
    lending: np.ndarray,
    seen: np.ndarray,
    inverse: np.ndarray,
    noise: np.ndarray,
    radius: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Where there is a plane, its slopes and level, and the pixel whose window it is of, all flat;
    where a window straddles an edge, of one beside it that does not and is ``lending``."""
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
) -> np.ndarray:
    """Standard deviation (m) along the normal of one measurement on a plane seen at ``cosine`` to
    its normal.

    Range noise shrinks with the cosine, unless it grows as one over that. A window that passed as
    flat bends little between its pixels; a borrowed plane (``tilt_rad`` not 0) may, the more so at
    a slant, where pixels lie wide apart.
    """
    slant = np.maximum(cosine, MIN_BORROWED_COSINE)
    bend = footprint_m * (0.05 + 0.008 * (tilt_rad > 0) / (slant * slant))
    across2 = sigma_m**2 * (cosine * cosine + slant_growth * (1 - cosine * cosine))
    return np.sqrt(across2 + bend * bend)
