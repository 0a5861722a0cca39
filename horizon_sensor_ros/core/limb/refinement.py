"""Step three: the limb to a small part of a pixel, along the normal of the predicted limb."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from horizon_sensor_ros.core.camera import CameraView
from horizon_sensor_ros.core.limb.curve import limb_curve
from horizon_sensor_ros.core.limb.edge_model import normal_cdf, place_edges
from horizon_sensor_ros.core.limb.points import LimbPoints
from horizon_sensor_ros.core.limb.profiles import (
    EdgePlaces,
    ProfileGrid,
    mean_profile,
    pixel_noise,
    sample_profiles,
)
from horizon_sensor_ros.core.limb.steepest import steepest_fall
from horizon_sensor_ros.core.status import Status

_INNER_PX = 6.0  # how far a profile reaches into the planet and into space, beside the search range
_OUTER_PX = 6.0
_MIN_SIGNIFICANCE = 5.0
_MAX_MISFIT = 6.0
_MIN_PROFILES = 8
# Brightness left 2.5 px outside the edge, over the step, from which air glow is taken to be there.
_GLOW_SHARE = 0.04


@dataclass(frozen=True)
class RefinePass:
    """One pass of refinement: edges within +-reach_px on a grid, a profile every spacing_px.

    All in pixels of the image, which is reduced by `factor`.
    """

    reach_px: float
    grid_px: float
    spacing_px: float
    factor: int = 1


@dataclass(frozen=True)
class EdgeLook:
    """What the edge looks like in one image. psf_px : its blur, one sigma; glows : air glows above
    the limb.
    """

    psf_px: float
    glows: bool


def refine_limb(
    gray: np.ndarray,
    view: CameraView,
    nadir_base: np.ndarray,
    rho_rad: float,
    step: RefinePass,
    look: EdgeLook | None = None,
) -> tuple[LimbPoints, EdgeLook | None]:
    """Measure the limb near its predicted place in one image.

    gray : (H, W) uint8 or uint16, already reduced by ``step.factor``; pixels of the result are
    those of the full image. look : what the edge looks like, as returned by an earlier pass;
    without it, or with glow, the place of steepest fall is taken, else the likeliest edge under
    the model of `edge_model`. Returns the limb and the look of its edge. Too few significant
    edges: status NO_LIMB, and None.
    """
    curve = limb_curve(view, nadir_base, rho_rad, spacing_px=step.spacing_px * step.factor)
    if len(curve) < _MIN_PROFILES:
        return LimbPoints.none(Status.NO_LIMB, "the limb is not in the frame"), None
    first = -(step.reach_px + _INNER_PX)
    num = round(2 * step.reach_px + _INNER_PX + _OUTER_PX) + 1
    grid = ProfileGrid(first, num, step.reach_px, step.grid_px)
    profiles, valid = sample_profiles(gray, curve, grid.d_px, step.factor)
    if valid.sum() < _MIN_PROFILES:
        return LimbPoints.none(Status.NO_LIMB, "the limb runs along the frame's border"), None
    profiles, px, normal_px = profiles[valid], curve.px[valid], curve.normal_px[valid]
    noise = pixel_noise(profiles)
    if look is None or look.glows:
        places = steepest_fall(profiles, noise, grid)
    else:
        places = place_edges(profiles, noise, look.psf_px, grid)
    good = (
        (places.significance > _MIN_SIGNIFICANCE)
        & ~places.at_border
        & (places.misfit < _MAX_MISFIT)
    )
    if good.sum() < _MIN_PROFILES:
        reason = f"{int(good.sum())} of {len(profiles)} profiles across the limb show an edge"
        return LimbPoints.none(Status.NO_LIMB, reason), None
    places = places.take(good)
    limb = LimbPoints(
        Status.OK,
        "",
        px[good] + (places.offset_px * step.factor)[:, None] * normal_px[good],
        normal_px[good],
        places.sigma_px * step.factor,
    )
    return limb, measure_look(profiles[good], grid.d_px, places)


def measure_look(profiles: np.ndarray, d_px: np.ndarray, places: EdgePlaces) -> EdgeLook:
    """Blur and glow of the edge from the mean profile, each profile aligned at its own edge."""
    where, mean = mean_profile(profiles, d_px, places)
    just_inside = float(np.interp(-1.5, where, mean))
    glow = float(np.interp(2.5, where, mean)) / max(just_inside, 1e-6)
    near = (where > -2.5) & (where < 4.0)
    where, mean = where[near], mean[near]
    best_psf, best_cost = 0.75, np.inf
    for psf in (0.5, 0.6, 0.7, 0.75, 0.8, 0.9, 1.0, 1.2, 1.5, 1.9, 2.4):
        rise = normal_cdf(-where / psf)
        design = np.stack([np.ones_like(where), rise, rise * np.minimum(where, 0.0)], axis=1)
        solution, *_ = np.linalg.lstsq(design, mean, rcond=None)
        cost = float(np.sum((design @ solution - mean) ** 2))
        if cost < best_cost:
            best_psf, best_cost = psf, cost
    return EdgeLook(best_psf, glow > _GLOW_SHARE)
