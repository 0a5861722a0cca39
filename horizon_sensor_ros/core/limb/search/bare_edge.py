"""Edges above which nothing glows although stars show there: by night the ground's limb has the
airglow above it.

Seen along its length the layer is as bright as a star of the fourth to sixth magnitude spread over
one pixel of a camera of 0.1 deg a pixel and less. An exposure that shows stars by the dozen shows
it too, so that where the sky begins at the edge itself that edge is the layer's own; how its light
fades may not tell, where it is overexposed, or lamps and moonlit clouds show through from below.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.cameras.white_level import NEAR_WHITE, saturation_level
from horizon_sensor_ros.core.limb.search.columns import (
    COLUMNS,
    CREST_M,
    DEPTHS_M,
    FALL,
    FEW,
    depths_rad,
    layer_above_rad,
    levels,
    rays_below,
)
from horizon_sensor_ros.core.limb.search.evenly import evenly
from horizon_sensor_ros.core.limb.search.selection import Consensus, RayCandidates
from horizon_sensor_ros.core.limb.search.stars import NIGHT_STARS, spread_stars
from horizon_sensor_ros.core.limb.search.working_image import WorkingImage
from horizon_sensor_ros.core.planet import Planet

# Depths, negative since above the edge, at which a layer above the ground glows, air by day no
# longer, and from which on there is none.
_GLOW_M = -np.array([45e3, 60e3, 75e3, 90e3])
_SKY_M = -np.array([170e3, 190e3, 210e3, 230e3])
# Of a pixel's noise, by which it is brighter than the sky: by 3.5 and more above the ground in
# frames that others drew, above the layer's own edge by .6 at most.
_GLOWS = 1.5
# Scatter of brightness along a limb, over its mean: of layers that others drew .14 at most, mostly
# what the lens fades; of clouds .17 and more.
_UNEVEN = 0.2


def bare_by_night(
    views: Sequence[CameraView],
    images: Sequence[np.ndarray],
    working: Sequence[WorkingImage],
    edge: RayCandidates,
    consensus: Consensus,
    planet: Planet,
) -> bool:
    """Whether stars show above an edge, nothing glows between in any frame that shows them, and
    light falls off behind it, or may do so where it is white; all along alike, as no clouds are.

    images : (H, W), one a view. edge : inliers of the consensus. False where no frame shows both
    stars and enough of what is above.
    """
    layer_rad = layer_above_rad(consensus, planet)
    beyond = consensus.nadir_base, consensus.rho_rad + layer_rad
    falls = False
    for i, (view, image, seen) in enumerate(zip(views, images, working, strict=True)):
        rays = edge.rays[edge.camera == i]
        # Another frame's stars do not tell how long this one was exposed.
        if len(rays) == 0 or spread_stars(image, view, seen, *beyond) < NIGHT_STARS:
            continue
        rays = rays[evenly(len(rays), COLUMNS)]
        above, far_above, below = (
            levels(view, seen, rays_below(rays, consensus, depths_rad(layer_rad, at_m)))
            for at_m in (_GLOW_M, _SKY_M, DEPTHS_M)
        )
        glow, sky, behind = _usual(above), _usual(far_above), _usual(below)
        if not all(np.isfinite(usual).any() for usual in (glow, sky, behind[DEPTHS_M <= CREST_M])):
            continue
        if np.nanmedian(glow) - np.nanmedian(sky) > _GLOWS * seen.noise:
            return False
        falls |= _is_even(below) and _falls(behind, seen.space_level, image)
    return falls


def _is_even(level: np.ndarray) -> bool:
    """Whether light (N, D) down to the crest is as bright all along the limb."""
    near = level[:, (DEPTHS_M > 0.0) & (DEPTHS_M <= CREST_M)]
    crests = near[np.isfinite(near).all(axis=1)].mean(axis=1)
    return len(crests) >= FEW and bool(crests.std() < _UNEVEN * crests.mean())


def _falls(behind: np.ndarray, space_level: float, image: np.ndarray) -> bool:
    """Whether light (D,) above the level of space falls again behind its crest, as a layer's does
    before ground begins, and ground that begins at the edge does not; or may do so where it is
    white.
    """
    crest = np.nanmax(np.where(DEPTHS_M <= CREST_M, behind, -np.inf))
    after = np.fmax.accumulate(behind) >= crest
    white = NEAR_WHITE * saturation_level(image, np.atleast_1d(crest + space_level))
    return bool(np.nanmin(behind[after]) < FALL * crest or crest + space_level >= white)


def _usual(level: np.ndarray) -> np.ndarray:
    """Median (D,) of columns (N, D) at each depth; NaN where the frame shows too few."""
    shown = np.count_nonzero(np.isfinite(level), axis=0) >= FEW
    usual = np.full(level.shape[1], np.nan)
    if shown.any():
        usual[shown] = np.nanmedian(level[:, shown], axis=0)
    return usual
