"""The night's airglow, a bright layer some 95 km above the ground, taken for the limb; and dawn.

By night the outermost edge in a frame may be the upper side of that layer. Columns of brightness,
straight down from places along the edge, tell which it is:

- **Airglow above ground**: brightness reaches a crest, falls again to a trough, and rises once more
  where the ground begins. The ground does so at the same depth all along the limb; clouds, which
  may look so too, do not.
- **Airglow alone**: no ground shows, and the layer fades alike in all columns. Air lit by day over
  dark sea looks alike, but stars are rarely above it and all of it shows, while thick air and the
  ground hide a part of a layer's light. Where nothing tells, the consensus says that it may be one.
- **Dawn**: the air is lit and the ground below is not. The lit band is thinner the farther it is
  from the Sun, so that its edge is no limb.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from horizon_sensor_ros.core.camera_view import CameraView
from horizon_sensor_ros.core.limb.search.columns import (
    COLUMNS,
    DEPTHS_M,
    ENOUGH_M,
    FALL,
    FEW,
    LAYER_M,
    SIGMAS,
    TOGETHER,
    bundled,
    columns_below,
    crest_and_trough,
    levels,
    rays_below,
)
from horizon_sensor_ros.core.limb.search.layer_light import (
    ABOVE_GROUND_M,
    ALIKE,
    MOST,
    ends_above,
    fades_alike,
    fades_as_a_shell,
    falls_short,
    is_air,
    is_shell,
    is_twilight,
)
from horizon_sensor_ros.core.limb.search.selection import Consensus, RayCandidates
from horizon_sensor_ros.core.limb.search.stars import shows_stars
from horizon_sensor_ros.core.limb.search.working_image import WorkingImage
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.robust import quantile
from horizon_sensor_ros.core.status import Status

_RISE = 1.25  # brightness of the ground over the trough's, at least
_SAME_DEPTH_M = 14e3  # by which the depth of ground in a column may be off the median one
# Share of the columns with ground at one depth from which the edge is a layer's; cloud's are a
# third, two thirds at most.
_SHARE = 0.7
_SHARE_BY_NIGHT = 0.6  # where stars show, and parts of the craft may hide some
# Behind its crest the layer fades in all columns alike: nearly all, or where ground shows behind it
# as many as have that, fall again.
_FALLING = 0.9
_CUT_OFF_M = 30e3  # down to which half of the columns must show, for what borders hide to matter


def ground_under_airglow(
    views: Sequence[CameraView],
    working: Sequence[WorkingImage],
    found: RayCandidates,
    consensus: Consensus,
    planet: Planet,
    *,
    refined: bool = False,
) -> Consensus:
    """The consensus, moved to the ground's limb where it holds the airglow's edge for it.

    working : images of every view. found : candidates in them. refined : its cone was fitted to
    edges: it knows nadir better than steps of depth do, and about it a layer looks alike all along.
    Where the layer is seen but no ground behind it: status POOR_FIT, and the cone and layer_rad of
    what would be the ground's limb. Where it may be one: the same consensus, with `perhaps_layer`.
    """
    if consensus.status is not Status.OK:
        return consensus
    layer_rad = _layer_rad(consensus, planet)
    depths = DEPTHS_M * (layer_rad / LAYER_M)
    columns = columns_below(views, working, found, consensus, depths)
    if not columns:
        return consensus
    places = np.concatenate([column.places for column in columns])
    level = np.concatenate([column.level for column in columns])
    noise = max(seen.noise for seen in working) / math.sqrt(TOGETHER)
    falls, crest, trough, at_trough = crest_and_trough(level, noise, DEPTHS_M)
    ground = _ground_behind(level, falls, trough, at_trough, noise)
    shown = ground >= 0
    num, num_all = int(np.count_nonzero(shown)), len(level)
    dark_behind = falls.mean() > _FALLING or num >= _SHARE * num_all
    layered = dark_behind and fades_alike(level, crest, at_trough)
    if refined and not layered:
        return consensus
    sharp = ends_above(level, crest)

    @cache
    def starry() -> bool:
        """Whether stars above the layer show an exposure for the night."""
        return shows_stars(views, working, consensus.nadir_base, consensus.rho_rad + layer_rad)

    @cache
    def by_night() -> bool:
        """Whether stars or the layer itself show that."""
        shows = (num > 0 and sharp) or is_shell(level, crest)
        return starry() or (layered and shows)

    if num > 0 and (num >= _SHARE * num_all or (num >= _SHARE_BY_NIGHT * num_all and by_night())):
        rays = rays_below(found.rays[places[shown]], consensus, depths)
        cone = None
        if not refined:
            cone = _cone(rays[np.arange(len(rays)), ground[shown]], consensus, layer_rad)
        if cone is None and (starry() or fades_as_a_shell(level, crest, ABOVE_GROUND_M)):
            # The layer is about the same nadir, wherever the ground was found along it.
            below = float(np.median(depths[ground[shown]]))
            cone = consensus.nadir_base, consensus.rho_rad - below
        if cone is None:
            return consensus
        return replace(_moved(consensus, cone, layer_rad), by_day=consensus)
    dawns = any(
        is_twilight(found.rays[column.places], column.level, consensus.nadir_base)
        for column in columns
    )
    if not (dawns or layered):
        return consensus
    if not by_night():
        perhaps = layered and sharp
        return replace(consensus, perhaps_layer=True) if perhaps else consensus
    if dawns:
        return Consensus(Status.POOR_FIT, "twilight: lit air over ground that is dark")
    if falls_short(level, crest) or (sharp and (num > 0 or starry())):
        cone = consensus.nadir_base, consensus.rho_rad - layer_rad
        reason = "a layer of airglow, and no ground behind it"
        return replace(_moved(consensus, cone, layer_rad), status=Status.POOR_FIT, reason=reason)
    return consensus if is_air(level, crest) else replace(consensus, perhaps_layer=True)


def may_be_cut_off(
    views: Sequence[CameraView],
    working: Sequence[WorkingImage],
    edge: RayCandidates,
    consensus: Consensus,
    planet: Planet,
) -> bool:
    """Whether an edge may be a layer's, of which frames' borders hide what would tell it from the
    ground's limb: as far as they show it, it fades behind its crest alike all along, or they show
    next to nothing of it, and stars above.

    edge : inliers of the consensus. False where any camera shows enough of what is below.
    """
    layer_rad = _layer_rad(consensus, planet)
    below_m = DEPTHS_M[DEPTHS_M >= 0.0]
    depths = below_m * (layer_rad / LAYER_M)
    fades = False
    for i, (view, seen) in enumerate(zip(views, working, strict=True)):
        rays = edge.rays[edge.camera == i]
        if len(rays) == 0:
            continue
        some = np.linspace(0, len(rays) - 1, COLUMNS).astype(np.intp)
        level = levels(view, seen, rays_below(rays[some], consensus, depths))
        reach = np.isfinite(level).cumprod(axis=1).sum(axis=1)
        if np.count_nonzero(reach > np.count_nonzero(below_m < ENOUGH_M)) >= FEW * TOGETHER:
            return False
        num = int(np.median(reach))
        if num <= np.count_nonzero(below_m < _CUT_OFF_M):
            continue
        _, level = bundled(some[reach >= num], level[reach >= num, :num])
        share = level / np.maximum(level.max(axis=1, keepdims=True), 1e-6)
        usual = np.median(share, axis=0)
        behind = usual.argmax()
        alike = np.abs(share - usual)[:, behind:].max(axis=1) < ALIKE
        if not (usual[-1] < FALL and alike.mean() > MOST):
            return False
        fades = True
    return fades or shows_stars(views, working, consensus.nadir_base, consensus.rho_rad + layer_rad)


def layer_heights_m(
    edge: RayCandidates, cone: tuple[np.ndarray, float], planet: Planet
) -> tuple[float, float, float]:
    """Heights of the layer's edge above a limb, as it is seen above that, nadir (3,) and rho: those
    that a quarter, half, and three quarters of it lie below.

    The edge's own cone would tell another nadir, and with that another height: along a short arc
    radius and nadir are hardly told apart.
    """
    nadir, rho = cone
    cosine = edge.rays @ nadir
    sine = np.sqrt(np.maximum(1.0 - cosine * cosine, 0.0))
    low, middle, high = (
        planet.radius_m * (quantile(sine, share) / math.sin(rho) - 1.0)
        for share in (0.25, 0.5, 0.75)
    )
    return low, middle, high


def _layer_rad(consensus: Consensus, planet: Planet) -> float:
    """Angle from the ground's limb up to the layer's edge, if the consensus is of that edge."""
    apparent = planet.altitude_from_rho(consensus.rho_rad)
    above_m = apparent + LAYER_M / np.sin(consensus.rho_rad)
    return consensus.rho_rad - planet.rho_from_altitude(above_m)


def _ground_behind(
    level: np.ndarray, falls: np.ndarray, trough: np.ndarray, at_trough: np.ndarray, noise: float
) -> np.ndarray:
    """Where (N,) among `DEPTHS_M` columns (N, D) rise again behind their troughs, at a depth that
    most of them have in common; -1 where one does not, and in all where fewer than half do at all.
    """
    bright = np.maximum(_RISE * trough, trough + SIGMAS * noise)
    risen = (DEPTHS_M[at_trough][:, None] < DEPTHS_M) & (level > bright[:, None])
    rises = falls & risen.any(axis=1)
    if np.count_nonzero(rises) <= 0.5 * len(level):
        return np.full(len(level), -1)
    at = risen.argmax(axis=1)
    off_m = np.abs(DEPTHS_M[at] - np.median(DEPTHS_M[at[rises]]))
    return np.where(rises & (off_m <= _SAME_DEPTH_M), at, -1)


def _cone(
    rays: np.ndarray, consensus: Consensus, depth_rad: float
) -> tuple[np.ndarray, float] | None:
    """Nadir and rho of the cone through rays (N, 3) below the consensus; None where it is not about
    the same nadir, by the depth of the layer, as by day or on a short arc.
    """
    m, *_ = np.linalg.lstsq(rays, np.ones(len(rays)), rcond=None)
    norm = float(np.linalg.norm(m))
    if not norm > 1.0:
        return None
    nadir, rho = m / norm, float(np.arccos(1.0 / norm))
    aside = float(np.linalg.norm(np.cross(nadir, consensus.nadir_base)))
    if aside > depth_rad or abs(consensus.rho_rad - depth_rad - rho) > depth_rad:
        return None
    return nadir, rho


def _moved(consensus: Consensus, cone: tuple[np.ndarray, float], depth_rad: float) -> Consensus:
    """The consensus with the ground's cone; its inliers are the layer's."""
    return replace(
        consensus,
        nadir_base=cone[0],
        rho_rad=cone[1],
        unanimous=False,
        layer_rad=depth_rad,
    )
