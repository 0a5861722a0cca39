"""The night's airglow, a bright layer some 95 km above the ground, taken for the limb; and dawn.

By night the outermost edge in a frame may be the upper side of that layer. Columns of brightness,
straight down from places along the edge, tell which it is:

- **Airglow above ground**: brightness reaches a crest, falls again to a trough, and rises once more
  where the ground begins. The ground does so at the same depth all along the limb; clouds, which
  may look so too, do not.
- **Airglow alone**: no ground shows, and the layer fades alike in all columns. Air lit by day over
  dark sea looks alike, but then the sea deep below is lit as well, and stars are rarely above it.
- **Dawn**: the air is lit and the ground below is not. The lit band is thinner the farther it is
  from the Sun, so that its edge is no limb.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np

from horizon_sensor_ros.core.camera_view import CameraView
from horizon_sensor_ros.core.limb.search.selection import Consensus, RayCandidates
from horizon_sensor_ros.core.limb.search.stars import shows_stars
from horizon_sensor_ros.core.limb.search.working_image import WorkingImage
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.robust import median, quantile
from horizon_sensor_ros.core.status import Status

LAYER_M = 95e3  # height of the layer; depths below its edge are counted in this height's scale
# A column is the brightness straight down from one place of the edge.
_COLUMNS = 48  # a camera
_TOGETHER = 4  # neighbours whose mean counts as one: a faint layer is hardly more than noise
_GLANCE = 24  # columns of a first look, at fewer depths
_PERHAPS = 0.5  # share of those columns that must fall again, for a closer look
_FEW = 4  # columns, less than which of one camera decide nothing
_DEPTHS_M = np.arange(-12e3, 156e3, 6e3)  # below the edge; negative ones are above it
_ENOUGH_M = 84e3  # of the depth of a column, where the frame ends
_CREST_M = 45e3  # depth down to which a column's crest, its brightest place, is looked for
_TROUGH_M = 20e3, 110e3  # depths between which its darkest place behind that is looked for
_FALL = 0.75  # brightness of the trough over the crest's, at most
_RISE = 1.25  # brightness of the ground over the trough's, at least
_SIGMAS = 6.0  # of noise that make a difference
_SAME_DEPTH_M = 14e3  # by which the depth of ground in a column may be off the median one
# Share of the columns with ground at one depth from which the edge is a layer's; cloud's are a
# third, two thirds at most.
_SHARE = 0.7
_SHARE_BY_NIGHT = 0.6  # where stars show, and parts of the craft may hide some
# Behind its crest the layer fades in all columns alike: nearly all, or where ground shows behind it
# as many as have that, fall again.
_FALLING = 0.9
_FADES_M = 25e3, 70e3  # depths between which it does
_FADES_AT_LEAST_M = 50e3  # instead of the second, where the ground's light begins before that
_FADED = 0.85  # brightness at the deeper one over that at the other, at most
_ALIKE = 0.14  # of the crest, by which a column may differ from the median one
_MOST = 0.6  # of the columns, that must not
_CUT_OFF_M = 30e3  # down to which half of the columns must show, for what borders hide to matter
# A thin shell that emits is seen through the longer, the nearer to its edge: brightness goes with
# one over the root of the depth, from the first of these on, so well as this where it is a layer's,
# down to where the planet hides the rear half of the shell, by the last of them for sure.
_SHELL_M = 36e3, 78e3, 108e3
_ABOVE_GROUND_M = 60e3  # instead of the second, where ground shows behind, whose light begins there
_SHELL_LAW = 0.1
# Of what that law would have behind, in columns of which so large a share have less: air on the
# ground shows all of it. Lights on the ground may hide it in others.
_REAR_HIDDEN, _DARK_COLUMNS = 0.7, 0.25
# Brightness at that depth, above the edge, over the crest, which by night tells a shell:
# .11 and less above 80 simulated layers, .17 and more in air over 74 dark seas.
_ABOVE_M, _ENDS = -6e3, 0.14
# Behind a layer brightness falls short of that law, as it is down to the first depth, somewhere
# between the others: thick air takes its light, and the ground hides its rear. By at least this in
# photographs, .07 to .45, and .11 where ground deep below the edge is brighter than so much of the
# crest; in air over dark seas, simulated in two ways, by .07 at most, over so dark ones by .03.
_ABOVE_AIR_M, _BEHIND_M = 66e3, (72e3, 108e3)
_SHORT, _SHORT_OVER_DARK, _DARK = 0.09, 0.05, 0.3
# Where it does not: no less of the law than that, or ground that is so bright is never a layer's.
# Layers alone have .12 to .37, and a dark sea by day may be as dark.
_SHOWN, _LIT = 0.97, 0.38
# Beside the dawn air is lit above ground that is not: a bright band, which is thinner the farther
# it is from the Sun. Wedges of cloud beside the limb, which end nearer to the edge or less evenly,
# are like it in one of 500 frames.
_BAND_ENDS = 0.75  # of the crest: darker than this, a column is below the band
_BAND_M = 33e3, 84e3  # depth of its end where it is thinnest, more than; and thickest, more than
_NARROWS = 0.95  # rank correlation of that depth with the place along the limb, more than
_GROUND = 0.6  # brightness of dark ground over the crest's, at most
_DARK_SHARE = 0.5  # of the columns, behind which ground must be dark
_LEAST_COLUMNS = 7  # with dark ground, likewise
_REAR = (_BEHIND_M[0] <= _DEPTHS_M) & (_BEHIND_M[1] >= _DEPTHS_M)


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
    what would be the ground's limb.
    """
    if consensus.status is not Status.OK:
        return consensus
    layer_rad = _layer_rad(consensus, planet)
    depths = _DEPTHS_M * (layer_rad / LAYER_M)
    columns = _columns(views, working, found, consensus, depths)
    if not columns:
        return consensus
    places = np.concatenate([column.places for column in columns])
    level = np.concatenate([column.level for column in columns])
    noise = max(seen.noise for seen in working) / math.sqrt(_TOGETHER)
    falls, crest, trough, at_trough = _crest_and_trough(level, noise, _DEPTHS_M)
    ground = _ground_behind(level, falls, trough, at_trough, noise)
    shown = ground >= 0
    num, num_all = int(np.count_nonzero(shown)), len(level)
    dark_behind = falls.mean() > _FALLING or num >= _SHARE * num_all
    layered = dark_behind and _fades_alike(level, crest, at_trough)
    if refined and not layered:
        return consensus
    ends_above = _ends_above(level, crest)

    @cache
    def starry() -> bool:
        """Whether stars above the layer show an exposure for the night."""
        return shows_stars(views, working, consensus.nadir_base, consensus.rho_rad + layer_rad)

    @cache
    def by_night() -> bool:
        """Whether stars or the layer itself show that."""
        shows = (num > 0 and ends_above) or _is_shell(level, crest)
        return starry() or (layered and shows)

    if num > 0 and (num >= _SHARE * num_all or (num >= _SHARE_BY_NIGHT * num_all and by_night())):
        rays = _rays(found.rays[places[shown]], consensus, depths)
        cone = None
        if not refined:
            cone = _cone(rays[np.arange(len(rays)), ground[shown]], consensus, layer_rad)
        if cone is None and (starry() or _fades_as_a_shell(level, crest, _ABOVE_GROUND_M)):
            # The layer is about the same nadir, wherever the ground was found along it.
            below = float(np.median(depths[ground[shown]]))
            cone = consensus.nadir_base, consensus.rho_rad - below
        if cone is None:
            return consensus
        return replace(_moved(consensus, cone, layer_rad), by_day=consensus)
    dawns = any(
        _is_twilight(found.rays[column.places], column.level, consensus.nadir_base)
        for column in columns
    )
    if not (dawns or layered):
        return consensus
    if not by_night():
        perhaps = layered and ends_above
        return replace(consensus, perhaps_layer=True) if perhaps else consensus
    if dawns:
        return Consensus(Status.POOR_FIT, "twilight: lit air over ground that is dark")
    short, lit = _falls_short(level, crest), median(level[:, -3:].mean(axis=1) / crest)
    enough = _SHORT if lit > _DARK else _SHORT_OVER_DARK
    if short > enough or (ends_above and (num > 0 or starry())):
        cone = consensus.nadir_base, consensus.rho_rad - layer_rad
        reason = "a layer of airglow, and no ground behind it"
        return replace(_moved(consensus, cone, layer_rad), status=Status.POOR_FIT, reason=reason)
    by_day = lit > _LIT or _over_the_law(level, crest)[_REAR].min() > _SHOWN
    return consensus if by_day else replace(consensus, perhaps_layer=True)


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
    depths = _DEPTHS_M * (layer_rad / LAYER_M)
    fades = False
    for i, (view, seen) in enumerate(zip(views, working, strict=True)):
        rays = edge.rays[edge.camera == i]
        if len(rays) == 0:
            continue
        some = np.linspace(0, len(rays) - 1, _COLUMNS).astype(np.intp)
        level = _levels(view, seen, _rays(rays[some], consensus, depths))
        reach = np.isfinite(level).cumprod(axis=1).sum(axis=1)
        if np.count_nonzero(_DEPTHS_M[reach - 1] >= _ENOUGH_M) >= _FEW * _TOGETHER:
            return False
        num = int(np.median(reach))
        if num == 0 or _DEPTHS_M[num - 1] < _CUT_OFF_M:
            continue
        _, level = _bundled(some[reach >= num], level[reach >= num, :num])
        share = level / level.max(axis=1, keepdims=True)
        usual = np.median(share, axis=0)
        behind = usual.argmax()
        alike = np.abs(share - usual)[:, behind:].max(axis=1) < _ALIKE
        if not (usual[-1] < _FALL and alike.mean() > _MOST):
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


class _Columns(NamedTuple):
    """Brightness straight down from the edge in one camera's frame.

    places : (M,) of the columns, by number among the candidates' rays. level : (M, D) gray levels
    above space at `_DEPTHS_M`.
    """

    places: np.ndarray
    level: np.ndarray


def _columns(
    views: Sequence[CameraView],
    working: Sequence[WorkingImage],
    found: RayCandidates,
    consensus: Consensus,
    depths: np.ndarray,
) -> list[_Columns]:
    """Columns of every camera that sees the edge; none where a glance at a few of one camera tells
    that no layer is there. depths : (D,) angles below the edge.
    """
    out, num_falling = [], 0
    for i, (view, seen) in enumerate(zip(views, working, strict=True)):
        of_view = np.flatnonzero(consensus.inliers & (found.camera == i))
        if len(of_view) == 0:
            continue
        for count, thin in ((_GLANCE, 3), (_COLUMNS, 1)):
            some = of_view[np.linspace(0, len(of_view) - 1, count).astype(np.intp)]
            level = _levels(view, seen, _rays(found.rays[some], consensus, depths[::thin]))
            whole, level = _as_far_as_seen(level, _DEPTHS_M[::thin])
            places, level = _bundled(some[whole], level[whole])
            if count == _GLANCE:
                noise = seen.noise / math.sqrt(_TOGETHER)
                falls = _crest_and_trough(level, noise, _DEPTHS_M[::thin])[0]
                num_falling += np.count_nonzero(falls)
                # The frame's border may hide what is below the edge.
                if len(falls) >= _FEW and np.count_nonzero(falls) < _PERHAPS * len(falls):
                    return []
        if len(places):
            out.append(_Columns(places, level))
    return out if num_falling >= _PERHAPS * _FEW else []


def _as_far_as_seen(level: np.ndarray, depths_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which columns (N, D) show enough, and their levels.

    Those that are in the frame as a whole do; where these are few, those do of which the border
    hides nothing but the end, where they are taken to go on as they were last seen.
    """
    seen = np.isfinite(level)
    whole = seen.all(axis=1)
    enough = seen[:, depths_m <= _ENOUGH_M].all(axis=1)
    if np.count_nonzero(whole) >= 0.5 * np.count_nonzero(enough):
        return whole, level
    last = np.maximum.accumulate(np.where(seen, np.arange(len(depths_m)), 0), axis=1)
    return enough, np.take_along_axis(level, last, axis=1)


def _ground_behind(
    level: np.ndarray, falls: np.ndarray, trough: np.ndarray, at_trough: np.ndarray, noise: float
) -> np.ndarray:
    """Where (N,) among `_DEPTHS_M` columns (N, D) rise again behind their troughs, at a depth that
    most of them have in common; -1 where one does not, and in all where fewer than half do at all.
    """
    bright = np.maximum(_RISE * trough, trough + _SIGMAS * noise)
    risen = (_DEPTHS_M[at_trough][:, None] < _DEPTHS_M) & (level > bright[:, None])
    rises = falls & risen.any(axis=1)
    if np.count_nonzero(rises) <= 0.5 * len(level):
        return np.full(len(level), -1)
    at = risen.argmax(axis=1)
    off_m = np.abs(_DEPTHS_M[at] - np.median(_DEPTHS_M[at[rises]]))
    return np.where(rises & (off_m <= _SAME_DEPTH_M), at, -1)


def _bundled(columns: np.ndarray, level: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Middle ones (M,) of columns (N,), `_TOGETHER` each, and means (M, D) of their levels."""
    num = len(columns) // _TOGETHER
    used = num * _TOGETHER
    means = level[:used].reshape(num, _TOGETHER, level.shape[1]).mean(axis=1)
    return columns[_TOGETHER // 2 : used : _TOGETHER], means


def _fades_alike(level: np.ndarray, crest: np.ndarray, at_trough: np.ndarray) -> bool:
    """Whether columns (N, D) fade behind their crests (N,) as a layer does, as far as their
    troughs: where pixels are coarse the light of the ground begins there.
    """
    last_m = max(_FADES_AT_LEAST_M, min(_FADES_M[1], median(_DEPTHS_M[at_trough])))
    band = (level / crest[:, None])[:, (_FADES_M[0] <= _DEPTHS_M) & (last_m >= _DEPTHS_M)]
    usual = np.median(band, axis=0)
    alike = np.abs(band - usual).max(axis=1) < _ALIKE
    return bool(usual[-1] < _FADED * usual[0] and alike.mean() > _MOST)


def _fades_as_a_shell(
    level: np.ndarray, crest: np.ndarray, last_m: float = _SHELL_M[1]
) -> float | None:
    """Brightness, over the crest's, times the root of the depth (m) where columns (N, D) with these
    crests (N,) fade as a thin shell does, down to a depth; None where they do not.
    """
    front = (_SHELL_M[0] <= _DEPTHS_M) & (last_m >= _DEPTHS_M)
    usual = np.median(level[:, front] / crest[:, None], axis=0) * np.sqrt(_DEPTHS_M[front])
    law = median(usual)
    return law if np.abs(usual - law).max() < _SHELL_LAW * law else None


def _is_shell(level: np.ndarray, crest: np.ndarray) -> bool:
    """Whether columns (N, D) with these crests (N,) fade as a thin shell does high above a planet
    that hides its rear half: an exposure for the night, whether or not it shows stars.
    """
    law = _fades_as_a_shell(level, crest)
    if law is None:
        return False
    behind = _SHELL_M[2] <= _DEPTHS_M
    each = level[:, behind] / crest[:, None] * np.sqrt(_DEPTHS_M[behind])
    return quantile(np.median(each, axis=1), _DARK_COLUMNS) < _REAR_HIDDEN * law


def _ends_above(level: np.ndarray, crest: np.ndarray) -> bool:
    """Whether columns (N, D) with these crests (N,) fade as a thin shell does, but are darker above
    their edges than the Earth's air could be.
    """
    above = np.median(level[:, _DEPTHS_M == _ABOVE_M] / crest[:, None])
    return bool(above < _ENDS) and _fades_as_a_shell(level, crest) is not None


def _falls_short(level: np.ndarray, crest: np.ndarray) -> float:
    """By how much, over the law of a thin shell, brightness behind the layer falls at most short of
    what shows above, in columns (N, D) with these crests (N,).
    """
    over_law = _over_the_law(level, crest)
    above = (_SHELL_M[0] <= _DEPTHS_M) & (_ABOVE_AIR_M >= _DEPTHS_M)
    slope, at_air = np.polyfit(_DEPTHS_M[above] - _ABOVE_AIR_M, over_law[above], 1)
    expected = at_air + min(slope, 0.0) * (_DEPTHS_M - _ABOVE_AIR_M)
    smooth = np.convolve(over_law, np.full(3, 1.0 / 3.0), mode="same")
    return float((expected - smooth)[_REAR].max())


def _over_the_law(level: np.ndarray, crest: np.ndarray) -> np.ndarray:
    """Brightness (D,) of columns (N, D) with these crests (N,), over that of a thin shell which is
    as bright above the ground.
    """
    usual = np.median(level / crest[:, None], axis=0) * np.sqrt(np.maximum(_DEPTHS_M, 0.0))
    front = (_SHELL_M[0] <= _DEPTHS_M) & (_ABOVE_GROUND_M >= _DEPTHS_M)
    return np.asarray(usual / np.median(usual[front]))


def _is_twilight(rays: np.ndarray, level: np.ndarray, nadir: np.ndarray) -> bool:
    """Whether columns (N, D) of one camera, at rays (N, 3), are of air that is lit above dark
    ground, the less of it the farther from the Sun.
    """
    crest = np.where(_DEPTHS_M <= _CREST_M, level, -np.inf).max(axis=1)
    dark = np.median(level[:, -3:], axis=1) < _GROUND * crest
    if np.count_nonzero(dark) < max(_DARK_SHARE * len(level), _LEAST_COLUMNS):
        return False
    rays, level, crest = rays[dark], level[dark], crest[dark, None]
    ends = np.maximum.accumulate(level >= crest, axis=1) & (level < _BAND_ENDS * crest)
    thick_m = _DEPTHS_M[ends.argmax(axis=1)]
    along = rays @ np.cross(nadir, rays.mean(axis=0))
    in_band = _BAND_M[0] < thick_m.min() and thick_m.max() > _BAND_M[1]
    return bool(in_band and abs(_rank_correlation(along, thick_m)) > _NARROWS)


def _rank_correlation(a: np.ndarray, b: np.ndarray) -> float:
    """Correlation of the ranks of (N,) and (N,); ties by their order."""
    first, second = (np.argsort(np.argsort(values)) for values in (a, b))
    return float(np.corrcoef(first, second)[0, 1])


def _rays(rays: np.ndarray, consensus: Consensus, depths: np.ndarray) -> np.ndarray:
    """Rays (N, D, 3) straight below the limb's, by angles of depth (D,)."""
    nadir = consensus.nadir_base
    across = rays - (rays @ nadir)[:, None] * nadir
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    angle = consensus.rho_rad - depths
    return np.cos(angle)[:, None] * nadir + np.sin(angle)[:, None] * across[:, None, :]


def _levels(view: CameraView, seen: WorkingImage, rays: np.ndarray) -> np.ndarray:
    """Gray levels (N, D) above space along rays (N, D, 3); NaN outside the frame and its mask."""
    small, factor = seen.gray, seen.factor
    px = view.camera.pixels((rays @ view.rot_base_from_cam).reshape(-1, 3))
    with np.errstate(invalid="ignore"):
        px = np.floor((px + 0.5) / factor)
        inside = (px >= 0).all(axis=1) & (px[:, 0] < small.shape[1]) & (px[:, 1] < small.shape[0])
    x, y = np.where(inside[:, None], px, 0.0).astype(np.intp).T
    if view.mask is not None:
        inside &= view.mask.reduced(factor)[y, x]
    level = np.where(inside, small[y, x] - seen.space_level, np.nan)
    return np.asarray(level.reshape(rays.shape[:2]))


def _crest_and_trough(
    level: np.ndarray, noise: float, depths_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Whether each column (N, D) falls again behind its edge; crest, trough, index of trough."""
    outer = np.where(depths_m <= _CREST_M, level, -np.inf)
    crest, at_crest = outer.max(axis=1), outer.argmax(axis=1)
    between = (depths_m >= _TROUGH_M[0]) & (depths_m <= _TROUGH_M[1])
    behind = np.arange(len(depths_m)) > at_crest[:, None]
    inner = np.where(between & behind, level, np.inf)
    trough = inner.min(axis=1)
    falls = (trough < _FALL * crest) & (crest - trough > _SIGMAS * noise)
    return falls, crest, trough, inner.argmin(axis=1)


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
