"""What a frame says for or against a fitted limb, beside the limb points themselves.

A wrong fit draws its disc through cloud and ground: then the would-be sky is bright, or patterned,
or the frame shows edges along little of the limb that it should show. All of this is looked at in
the reduced image of the search.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.limb.search.working_image import WorkingImage
from horizon_sensor_ros.core.limb_curve import LimbCurve, limb_curve
from horizon_sensor_ros.core.mathematics.robust import quantile, robust_sigma
from horizon_sensor_ros.core.mathematics.symmetric3 import solve

NEAREST_SKY_PX = 5.0  # outwards from the limb, working pixels, that is looked at
_SKY_STEPS_PX = np.array([NEAREST_SKY_PX, 7.0, 10.0, 14.0])  # likewise
_GROUND_STEPS_PX = np.array([-2.0, -4.0, -7.0])  # inwards, likewise
_UNEVEN_PX = 5.0  # by which an edge beyond the limb comes nearer, from where on it is no layer's
_LAYER = 1.2  # top of a layer of airglow, over its height
_LIMB_STEP_PX = 3.0  # from one look at the limb to the next, working pixels
_GRID_STEP = 6  # from one look at the sky to the next, working pixels
_SKY_MARGIN_PX = 8.0  # air glow above the limb is left out
# Sky that is as clear as this leaves nothing to explain by glare or stray light.
_SURELY_CLEAR = 0.9  # share of the sky at the level of space, at least
_HARDLY_BRIGHT = 0.1  # share of the limb beside bright sky, at most
_RING_PX = 10.0  # width of the rings about the Sun, working pixels
# What the Sun floods; a star, a lamp or the Moon is smaller.
_LEAST_SUN_PX = 120  # working pixels that are flooded near its middle, at least
_NEAR_SUN_PX = 20  # working pixels from its middle, right and down, which count as near
_LARGEST_SUN = 0.15  # share of the sky that it may flood
# Stray light rises along a plane: how high at most, over the contrast between ground and space.
_MOST_SLOPE = 0.3  # as a rule
_MOST_EVEN_SLOPE = 0.6  # where nearly all of the sky is on the plane, as no ground is
_EVEN_SIGMAS = 3.0  # of noise, within which a place of the sky is on it
_EVEN_SHARE = 0.95  # of the sky: nearly all
_SLOPE_ROUNDS = 6  # of the robust fit of that plane
_LEAST_SKY = 40  # places in the sky that it takes
_MASK_CLEARANCE_PX = 11.0  # nearer to a mask, pixels of the full image, no limb is looked for


@dataclass(frozen=True)
class SkyEvidence:
    """One camera's evidence about a fitted limb, without the Sun's glare and stray light.

    Stray light makes one side of the sky a little brighter than the other, as twilight and
    moonlight do on long exposures.

    Along the limb:
    limb_px : its length in the frame, where not masked.
    bright_sky : share of it whose outer side is bright.
    lit_limb : share of it whose inner side is brighter than space.
    ground_beyond : share of it beyond which something bright looks like ground: it ends in an edge
    whose distance from the limb changes, as that of a layer of air does not. Where that edge is out
    of sight, as a part of the craft's may be, at most as much of the limb counts again as where it
    is in sight.

    Inside:
    contrast : gray levels from space to the planet beside the limb, over the noise.
    dark_ground : behind the lit part of the limb, share of the ground that is as dark as space; it
    is large between the lamps of a night side.

    Outside:
    clear_sky : share of the frame outside the disc that is at the level of space; NaN when less
    than 1 % of the frame lies outside.
    """

    limb_px: float
    bright_sky: float
    lit_limb: float
    clear_sky: float
    contrast: float
    dark_ground: float
    ground_beyond: float = 0.0


def sky_evidence(
    working: WorkingImage,
    view: CameraView,
    nadir_base: np.ndarray,
    rho_rad: float,
    predicted: LimbCurve | None = None,
    layer_rad: float = 0.0,
) -> SkyEvidence:
    """Look at both sides of a fitted limb, the cone of nadir_base (3,) and rho_rad, in a working
    image.

    predicted : the limb as it was drawn before it was fitted; it will do where it lies near enough.
    layer_rad : how far above the limb a layer of airglow lies; the sky begins beyond it.
    """
    small, factor, noise = working.gray, working.factor, working.noise
    curve = _limb(view, nadir_base, rho_rad, factor, predicted)
    px, normal_px = curve.px, curve.normal_px
    if view.mask is not None:
        shown = view.mask.clear(px, _MASK_CLEARANCE_PX)
        px, normal_px = px[shown], normal_px[shown]
    if len(px) == 0:
        return SkyEvidence(0.0, 0.0, 0.0, np.nan, 0.0, 0.0)
    layer_px = _LAYER * layer_rad / _pitch(view.camera, factor)
    steps_px = np.concatenate([_GROUND_STEPS_PX, _SKY_STEPS_PX + layer_px])
    sides = ((px.T + 0.5) / factor)[:, None] + steps_px[:, None] * normal_px.T[:, None]
    sky = _sky(small, factor, view, nadir_base, rho_rad + _LAYER * layer_rad)
    usable = None if view.mask is None else view.mask.reduced(factor)
    limb_px = curve.spacing_px * len(px)
    evidence = _judged(working, usable, sides, sky, limb_px)
    if evidence.bright_sky < _HARDLY_BRIGHT and not evidence.clear_sky < _SURELY_CLEAR:
        return evidence
    above = small - np.float32(working.space_level)
    sky_px = _grid(view.camera, *small.shape, factor)[0][sky]
    light = glare = _glare(above, sky_px, evidence.contrast * noise)
    if light is None:
        light = _stray_light(above, sky_px, evidence.contrast * noise, noise)
    if light is None:
        return evidence
    dark = replace(working, gray=above - light, space_level=0.0)
    without = _judged(dark, usable, sides, sky, limb_px)
    # The Sun's streaks have edges of their own; what is taken for stray light, which has none, may
    # be ground.
    return replace(without, ground_beyond=0.0 if glare is not None else evidence.ground_beyond)


def _judged(
    working: WorkingImage,
    usable: np.ndarray | None,
    sides: np.ndarray,
    sky: np.ndarray,
    limb_px: float,
) -> SkyEvidence:
    """Evidence from one image.

    usable : (h, w) where it is not masked, None where nothing is. sides : (2, S, N) x and y of
    places beside the limb, in pixels from the image's corner, ground first. sky : (M,) which pixels
    of `_on_grid` lie outside the disc.
    """
    small, space_level, noise = working.gray, working.space_level, working.noise
    within = (sides >= 0.0) & (sides < np.array([[[small.shape[1]]], [[small.shape[0]]]]))
    known = within[0] & within[1]
    x, y = np.where(known, sides, 0.0).astype(np.intp)
    if usable is not None:
        known &= usable[y, x]
    level = small[y, x] - np.float32(space_level)
    num_ground = len(_GROUND_STEPS_PX)
    inner = known[:num_ground]
    brightest = np.where(inner, level[:num_ground], -np.inf).max(axis=0)
    outer = np.where(known[num_ground:], level[num_ground:], np.inf).min(axis=0)
    ground, outer = brightest[brightest > -np.inf], outer[outer < np.inf]
    if len(ground) == 0 or len(outer) == 0:
        return SkyEvidence(limb_px, 0.0, 0.0, np.nan, 0.0, 0.0)
    contrast = quantile(ground, 0.75)
    lit = max(0.1 * contrast, 5.0 * noise)
    behind = inner & (brightest > lit)
    dark = behind & (level[:num_ground] < max(0.05 * contrast, 4.0 * noise))
    clear = np.nan
    beyond = _on_grid(small).ravel()[sky]
    if len(beyond) >= 0.01 * small.size / _GRID_STEP**2:
        off = np.abs(beyond - np.float32(space_level))
        clear = _share(off < max(0.1 * contrast, 6 * noise))
    return SkyEvidence(
        limb_px,
        _share(outer > max(0.35 * contrast, 6.0 * noise)),
        _share(ground > lit),
        clear,
        contrast / noise,
        int(np.count_nonzero(dark)) / max(int(np.count_nonzero(behind)), 1),
        _ground_beyond(level[num_ground:], known[num_ground:], max(0.5 * contrast, 6.0 * noise)),
    )


def _ground_beyond(level: np.ndarray, known: np.ndarray, bright: float) -> float:
    """`SkyEvidence.ground_beyond` of levels (S, N) outside the limb, where they are known."""
    shown = known & (level > bright)
    if not shown.any():
        return 0.0
    reaches_px = (shown * _SKY_STEPS_PX[:, None]).max(axis=0)
    there = reaches_px > 0.0
    near, far = (quantile(reaches_px[there], at) for at in (0.1, 0.9))
    if far - near < _UNEVEN_PX:
        return 0.0
    ends = np.count_nonzero(there & (reaches_px < _SKY_STEPS_PX[-1]))
    seen = np.count_nonzero(known.any(axis=0))
    return min(int(np.count_nonzero(there)), 2 * int(ends)) / int(seen)


def _share(these: np.ndarray) -> float:
    return int(np.count_nonzero(these)) / len(these)


def _limb(
    view: CameraView,
    nadir_base: np.ndarray,
    rho_rad: float,
    factor: int,
    predicted: LimbCurve | None,
) -> LimbCurve:
    """The limb, with a point every few working pixels."""
    spacing_px = _LIMB_STEP_PX * factor
    if predicted is not None:
        curve = predicted.thinned(spacing_px)
        off = view.camera.rays(curve.px) @ (view.rot_base_from_cam.T @ nadir_base)
        off -= math.cos(rho_rad)
        if np.abs(off).max() < _pitch(view.camera, factor) * math.sin(rho_rad):
            return curve
    return limb_curve(view, nadir_base, rho_rad, spacing_px=spacing_px)


def _pitch(camera: Camera, factor: int) -> float:
    """Angle of a working pixel, rad."""
    return factor * camera.pixel_rad


def _sky(
    small: np.ndarray, factor: int, view: CameraView, nadir_base: np.ndarray, rho_rad: float
) -> np.ndarray:
    """Which pixels (M,) of `_on_grid` lie outside the disc, unmasked."""
    limit = math.cos(min(rho_rad + _SKY_MARGIN_PX * _pitch(view.camera, factor), math.pi))
    # A pixel without a ray is not seen outside, nor warned of.
    with np.errstate(invalid="ignore"):
        rays = _grid(view.camera, *small.shape, factor)[1]
        outside = rays @ (view.rot_base_from_cam.T @ nadir_base) < limit
    if view.mask is not None:
        outside &= _on_grid(view.mask.reduced(factor)).ravel()
    return outside


def _on_grid(small: np.ndarray) -> np.ndarray:
    """Every so many-th pixel of a working image, down and across."""
    return small[_GRID_STEP // 2 :: _GRID_STEP, _GRID_STEP // 2 :: _GRID_STEP]


@lru_cache(maxsize=8)
def _grid(camera: Camera, height: int, width: int, factor: int) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (M, 2) of `_on_grid`, x and y, and their rays (M, 3) in the camera."""
    rows, columns = (_on_grid(index) for index in np.indices((height, width)))
    px = np.stack([columns.ravel(), rows.ravel()], axis=1)
    return px, camera.rays((px + 0.5) * factor - 0.5)


def _glare(above: np.ndarray, sky: np.ndarray, contrast: float) -> np.ndarray | None:
    """Gray levels (h, w) of the Sun's glare: even around it, fading outwards; None without a Sun.

    Only what is small, in the sky, and brighter than the planet beside the limb is taken for it.
    """
    if len(sky) == 0:
        return None
    level = above[sky[:, 1], sky[:, 0]]
    brightest = max(0.9 * float(level.max()), contrast)
    sun = level > brightest
    if not 0 < np.count_nonzero(sun) < _LARGEST_SUN * len(sky):
        return None
    centre = np.median(sky[sun], axis=0)
    left, top = np.maximum(centre.astype(np.intp) - _NEAR_SUN_PX, 0)
    near = above[top : top + 2 * _NEAR_SUN_PX, left : left + 2 * _NEAR_SUN_PX]
    if np.count_nonzero(near > brightest) < _LEAST_SUN_PX:
        return None
    ring = (np.hypot(*(sky - centre).T) / _RING_PX).astype(np.intp)
    # The darker part of a ring is free of streaks, and of a planet that is taken for sky.
    around = np.full(int(ring.max()) + 1, np.inf)
    for i in np.unique(ring):
        around[i] = np.percentile(level[ring == i], 30)
    fading = np.minimum.accumulate(around)
    if fading[0] < 0.5 * contrast:
        return None
    x, y = np.arange(above.shape[1]) - centre[0], np.arange(above.shape[0]) - centre[1]
    distance = np.hypot(x, y[:, None]) / _RING_PX - 0.5
    return np.interp(distance, np.arange(len(fading)), fading).astype(np.float32)


def _stray_light(
    above: np.ndarray, sky: np.ndarray, contrast: float, noise: float
) -> np.ndarray | None:
    """Gray levels (h, w) of light that rises evenly across the sky; None where it rises too far.

    A planet that is taken for sky is no plane, and brighter.
    """
    if len(sky) < _LEAST_SKY:
        return None
    place = np.column_stack([sky, np.ones(len(sky))])
    level = above[sky[:, 1], sky[:, 0]].astype(np.float64)
    weight = np.ones(len(sky))
    for _ in range(_SLOPE_ROUNDS):
        weighted = place * weight[:, None]
        plane = solve(weighted.T @ place, weighted.T @ level)
        off = level - place @ plane
        weight = 1.0 / (1.0 + np.square(off / (2.0 * max(robust_sigma(off), 1e-3))))
    height, width = above.shape
    light = plane[0] * np.arange(width) + plane[1] * np.arange(height)[:, None] + plane[2]
    even = _share(np.abs(off) < _EVEN_SIGMAS * noise) > _EVEN_SHARE
    most = (_MOST_EVEN_SLOPE if even else _MOST_SLOPE) * contrast
    if not (place @ plane).max() < most:
        return None
    return light.astype(np.float32)
