"""What a frame says for or against a fitted limb, beside the limb points themselves.

A wrong fit draws its disc through cloud and ground: then the would-be sky is bright, or patterned,
or the frame shows edges along little of the limb that it should show. All of this is looked at in
the reduced image of the search.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from horizon_sensor_ros.core.camera import CameraView
from horizon_sensor_ros.core.limb.curve import limb_curve

_SKY_STEPS_PX = np.array([5.0, 7.0, 10.0, 14.0])  # outwards from the limb, working pixels
_GROUND_STEPS_PX = np.array([-2.0, -4.0, -7.0])
_GRID_STEP = 4  # working pixels
_SKY_MARGIN_PX = 8.0  # air glow above the limb is left out
_MASK_CLEARANCE_PX = 11.0  # nearer to a mask, pixels of the full image, no limb is looked for


@dataclass(frozen=True)
class SkyEvidence:
    """One camera's evidence about a fitted limb.

    limb_px : length of the predicted limb in the frame, where not masked. bright_sky : share of it
    whose outer side is bright.
    lit_limb : share of it whose inner side is brighter than space. clear_sky : share of the frame
    outside the disc that is at the level of space; NaN when less than 1 % of the frame lies
    outside. contrast : gray levels from space to the planet beside the limb, over the noise.
    """

    limb_px: float
    bright_sky: float
    lit_limb: float
    clear_sky: float
    contrast: float


def sky_evidence(
    small: np.ndarray,
    factor: int,
    space_level: float,
    noise: float,
    view: CameraView,
    nadir_base: np.ndarray,
    rho_rad: float,
) -> SkyEvidence:
    """Look at both sides of a fitted limb in a reduced image.

    small : (h, w) float32, reduced by `factor`. space_level, noise : of that image.
    """
    spacing_px = 3.0 * factor
    curve = limb_curve(view, nadir_base, rho_rad, spacing_px=spacing_px)
    shown = np.ones(len(curve), dtype=bool)
    if view.mask is not None:
        shown = view.mask.clear(curve.px, _MASK_CLEARANCE_PX)
    if not shown.any():
        return SkyEvidence(0.0, 0.0, 0.0, np.nan, 0.0)
    limb_px = spacing_px * int(np.count_nonzero(shown))
    steps = np.concatenate([_GROUND_STEPS_PX, _SKY_STEPS_PX]) * factor
    px = curve.px[shown, None, :] + steps[None, :, None] * curve.normal_px[shown, None, :]
    grid = np.floor((px + 0.5) / factor).astype(np.intp)
    height, width = small.shape
    known = (grid[..., 0] >= 0) & (grid[..., 0] < width)
    known &= (grid[..., 1] >= 0) & (grid[..., 1] < height)
    x, y = np.clip(grid[..., 0], 0, width - 1), np.clip(grid[..., 1], 0, height - 1)
    if view.mask is not None:
        known &= view.mask.reduced(factor)[y, x]
    level = small[y, x]
    level = np.where(known, level - space_level, np.nan)
    num_ground = len(_GROUND_STEPS_PX)
    with np.errstate(all="ignore"):
        ground = np.nanmax(np.where(known, level, -np.inf)[:, :num_ground], axis=1)
        sky = np.nanmin(np.where(known, level, np.inf)[:, num_ground:], axis=1)
    ground, sky = ground[np.isfinite(ground)], sky[np.isfinite(sky)]
    if len(ground) == 0 or len(sky) == 0:
        return SkyEvidence(limb_px, 0.0, 0.0, np.nan, 0.0)
    contrast = float(np.percentile(ground, 75))
    bright_sky = float(np.mean(sky > max(0.35 * contrast, 6.0 * noise)))
    lit_limb = float(np.mean(ground > max(0.1 * contrast, 5.0 * noise)))
    return SkyEvidence(
        limb_px,
        bright_sky,
        lit_limb,
        _clear_sky(small, factor, space_level, noise, contrast, view, nadir_base, rho_rad),
        contrast / noise,
    )


def _clear_sky(
    small: np.ndarray,
    factor: int,
    space_level: float,
    noise: float,
    contrast: float,
    view: CameraView,
    nadir_base: np.ndarray,
    rho_rad: float,
) -> float:
    x, y = np.meshgrid(
        np.arange(0, small.shape[1], _GRID_STEP), np.arange(0, small.shape[0], _GRID_STEP)
    )
    px = (np.stack([x.ravel(), y.ravel()], axis=1) + 0.5) * factor - 0.5
    rays = view.camera.rays(px)
    with np.errstate(invalid="ignore"):
        angle = np.arccos(np.clip(rays @ (view.rot_base_from_cam.T @ nadir_base), -1.0, 1.0))
        pitch = factor / np.sqrt(view.camera.fx * view.camera.fy)
        outside = angle > rho_rad + _SKY_MARGIN_PX * pitch
    if view.mask is not None:
        outside &= view.mask.reduced(factor)[y.ravel(), x.ravel()]
    if outside.mean() < 0.01:
        return np.nan
    level = np.abs(small[y.ravel(), x.ravel()][outside] - space_level)
    return float(np.mean(level < max(0.1 * contrast, 6.0 * noise)))
