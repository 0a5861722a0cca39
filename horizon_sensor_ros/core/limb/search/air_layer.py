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
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.limb.search.columns import (
    COLUMNS,
    DEPTHS_M,
    ENOUGH_M,
    FALL,
    FEW,
    SIGMAS,
    TOGETHER,
    Columns,
    bundled,
    columns_below,
    crest_and_trough,
    depths_rad,
    layer_above_rad,
    levels,
    rays_below,
)
from horizon_sensor_ros.core.limb.search.evenly import evenly
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
from horizon_sensor_ros.core.mathematics.robust import median, quantile
from horizon_sensor_ros.core.planet import Planet
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
    candidates: RayCandidates,
    consensus: Consensus,
    planet: Planet,
    *,
    refined: bool = False,
) -> Consensus:
    """The consensus, moved to the ground's limb where it holds the airglow's edge for it.

    working : images of every view. candidates : in them. refined : its cone was fitted to edges: it
    knows nadir better than steps of depth do, and about it a layer looks alike all along.
    Where the layer is seen but no ground behind it: status POOR_FIT, and the cone and layer_rad of
    what would be the ground's limb. Where it may be one: the same consensus, with `perhaps_layer`.
    """
    if consensus.status is not Status.OK or not planet.has_air:
        return consensus
    layer_rad = layer_above_rad(consensus, planet)
    columns = columns_below(views, working, candidates, consensus, depths_rad(layer_rad))
    if not columns:
        return consensus
    # Stars above the layer show an exposure for the night.
    stars = partial(
        shows_stars, views, working, consensus.nadir_base, consensus.rho_rad + layer_rad
    )
    below = _Below.of(columns, max(seen.noise for seen in working), stars)
    if refined and not below.layered:
        return consensus
    if below.shows_ground:
        cone = _ground_cone(below, candidates, consensus, layer_rad, refined=refined)
        if cone is None:
            return consensus
        return replace(_moved(consensus, cone, layer_rad), by_day=consensus)
    dawns = any(
        is_twilight(candidates.rays[column.places], column.level, consensus.nadir_base)
        for column in columns
    )
    if not (dawns or below.layered):
        return consensus
    perhaps = replace(consensus, perhaps_layer=True)
    if not below.by_night:
        return perhaps if below.layered and below.ends_above else consensus
    if dawns:
        return Consensus(Status.POOR_FIT, "twilight: lit air over ground that is dark")
    if below.is_layer_alone:
        cone = consensus.nadir_base, consensus.rho_rad - layer_rad
        reason = "a layer of airglow, and no ground behind it"
        moved = _moved(consensus, cone, layer_rad)
        # Where light ends above as in no air on the ground there is nothing to ask.
        by_day = None if below.ends_above else consensus
        return replace(moved, status=Status.POOR_FIT, reason=reason, by_day=by_day)
    return consensus if is_air(below.level, below.crest) else perhaps


@dataclass(frozen=True, eq=False)
class _Below:
    """What the columns below an edge tell of what it is.

    places (N,) : of the columns, by number among the candidates' rays. level (N, D) : at
    `DEPTHS_M`. crest (N,), at_trough (N,), falls (N,) : as of `crest_and_trough`. ground (N,) : as
    of `_ground_behind`. stars : whether there are any above the layer; it costs a look.
    """

    places: np.ndarray
    level: np.ndarray
    crest: np.ndarray
    at_trough: np.ndarray
    falls: np.ndarray
    ground: np.ndarray
    stars: Callable[[], bool]

    @classmethod
    def of(cls, columns: Sequence[Columns], noise: float, stars: Callable[[], bool]) -> _Below:
        """Of the columns of all cameras; noise : of a pixel."""
        places = np.concatenate([column.places for column in columns])
        level = np.concatenate([column.level for column in columns])
        noise /= math.sqrt(TOGETHER)
        falls, crest, trough, at_trough = crest_and_trough(level, noise, DEPTHS_M)
        ground = _ground_behind(level, falls, trough, at_trough, noise)
        return cls(places, level, crest, at_trough, falls, ground, stars)

    @cached_property
    def shown(self) -> np.ndarray:
        """Columns (N,) that show ground at the depth which they have in common."""
        return self.ground >= 0

    @cached_property
    def share(self) -> float:
        """Of the columns, those that do."""
        return int(np.count_nonzero(self.shown)) / len(self.shown)

    @cached_property
    def layered(self) -> bool:
        """Whether light fades behind the edge as in a layer, wherever ground is or is not."""
        dark_behind = self.falls.mean() > _FALLING or self.share >= _SHARE
        return bool(dark_behind) and fades_alike(self.level, self.crest, self.at_trough)

    @cached_property
    def ends_above(self) -> bool:
        """`layer_light.ends_above`."""
        return ends_above(self.level, self.crest)

    @cached_property
    def starry(self) -> bool:
        """Whether stars show above the layer."""
        return self.stars()

    @cached_property
    def by_night(self) -> bool:
        """Whether stars or the layer itself show an exposure for the night."""
        shows = (self.share > 0.0 and self.ends_above) or is_shell(self.level, self.crest)
        return self.starry or (self.layered and shows)

    @property
    def shows_ground(self) -> bool:
        """Whether so many columns show ground that the edge is a layer's above it."""
        # Stars alone show no night: they are in frames of the sky beside a planet by day too.
        by_night = self.share >= _SHARE_BY_NIGHT and self.layered and self.by_night
        return self.share >= _SHARE or by_night

    @property
    def is_layer_alone(self) -> bool:
        """Whether light by night tells a layer, without ground, from air."""
        sharp = self.ends_above and (self.share > 0.0 or self.starry)
        return falls_short(self.level, self.crest) or sharp


def _ground_cone(
    below: _Below,
    candidates: RayCandidates,
    consensus: Consensus,
    layer_rad: float,
    *,
    refined: bool,
) -> tuple[np.ndarray, float] | None:
    """Nadir and rho of the limb of the ground that columns show; None where that is no limb, and
    nothing else tells that there is one. refined : as of `ground_under_airglow`.
    """
    at, depths = below.ground[below.shown], depths_rad(layer_rad)
    if not refined:
        rays = rays_below(candidates.rays[below.places[below.shown]], consensus, depths)
        cone = _cone(rays[np.arange(len(rays)), at], consensus, layer_rad)
        if cone is not None:
            return cone
    if not (below.starry or fades_as_a_shell(below.level, below.crest, ABOVE_GROUND_M)):
        return None
    # The layer is about the same nadir, wherever the ground was found along it.
    return consensus.nadir_base, consensus.rho_rad - median(depths[at])


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
    layer_rad = layer_above_rad(consensus, planet)
    below = DEPTHS_M >= 0.0
    below_m, depths = DEPTHS_M[below], depths_rad(layer_rad)[below]
    enough, cut_off = (np.count_nonzero(below_m < most_m) for most_m in (ENOUGH_M, _CUT_OFF_M))
    fades = False
    for i, (view, seen) in enumerate(zip(views, working, strict=True)):
        rays = edge.rays[edge.camera == i]
        if len(rays) == 0:
            continue
        some = evenly(len(rays), COLUMNS)
        level = levels(view, seen, rays_below(rays[some], consensus, depths))
        reach = np.isfinite(level).cumprod(axis=1).sum(axis=1)
        if np.count_nonzero(reach > enough) >= FEW * TOGETHER:
            return False
        num = int(median(reach))
        if num <= cut_off:
            continue
        _, level = bundled(some[reach >= num], level[reach >= num, :num])
        if len(level) < FEW:
            continue
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
    off_m = np.abs(DEPTHS_M[at] - median(DEPTHS_M[at[rises]]))
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
