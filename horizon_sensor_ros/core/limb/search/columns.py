"""Columns of brightness: straight down from places along an edge, by height above the ground."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.limb.search.evenly import evenly
from horizon_sensor_ros.core.limb.search.selection import Consensus, RayCandidates
from horizon_sensor_ros.core.limb.search.working_image import WorkingImage
from horizon_sensor_ros.core.planet import Planet

LAYER_M = 95e3  # height of the layer; depths below its edge are counted in this height's scale
# A column is the brightness straight down from one place of the edge.
COLUMNS = 48  # a camera
TOGETHER = 4  # neighbours whose mean counts as one: a faint layer is hardly more than noise
_GLANCE = 24  # columns of a first look, at fewer depths
_PERHAPS = 0.5  # share of those columns that must fall again, for a closer look
FEW = 4  # columns, less than which of one camera decide nothing
DEPTHS_M = np.arange(-12e3, 156e3, 6e3)  # below the edge; negative ones are above it
ENOUGH_M = 84e3  # of the depth of a column, where the frame ends
CREST_M = 45e3  # depth down to which a column's crest, its brightest place, is looked for
_TROUGH_M = 20e3, 110e3  # depths between which its darkest place behind that is looked for
FALL = 0.75  # brightness of the trough over the crest's, at most
SIGMAS = 6.0  # of noise that make a difference


class Columns(NamedTuple):
    """Brightness straight down from the edge in one camera's frame.

    places : (M,) of the columns, by number among the candidates' rays. level : (M, D) gray levels
    above space at `DEPTHS_M`.
    """

    places: np.ndarray
    level: np.ndarray


def layer_above_rad(consensus: Consensus, planet: Planet) -> float:
    """Angle from the ground's limb up to the layer's edge, if the consensus is of that edge."""
    apparent = planet.altitude_from_rho(consensus.rho_rad)
    above_m = apparent + LAYER_M / np.sin(consensus.rho_rad)
    return consensus.rho_rad - planet.rho_from_altitude(above_m)


def depths_rad(layer_rad: float, depths_m: np.ndarray = DEPTHS_M) -> np.ndarray:
    """Angles (D,) below the edge of a layer at depths (D,) below it."""
    return depths_m * (layer_rad / LAYER_M)


def columns_below(
    views: Sequence[CameraView],
    working: Sequence[WorkingImage],
    candidates: RayCandidates,
    consensus: Consensus,
    depths: np.ndarray,
) -> list[Columns]:
    """Columns of every camera that sees the edge; none where a glance at a few of one camera tells
    that no layer is there. depths : (D,) angles below the edge.
    """
    out, num_falling = [], 0
    for i, (view, seen) in enumerate(zip(views, working, strict=True)):
        of_view = np.flatnonzero(consensus.inliers & (candidates.camera == i))
        if len(of_view) == 0:
            continue
        for count, thin in ((_GLANCE, 3), (COLUMNS, 1)):
            some = of_view[evenly(len(of_view), count)]
            level = levels(view, seen, rays_below(candidates.rays[some], consensus, depths[::thin]))
            whole, level = _as_far_as_seen(level, DEPTHS_M[::thin])
            places, level = bundled(some[whole], level[whole])
            if count == _GLANCE:
                noise = seen.noise / math.sqrt(TOGETHER)
                falls = crest_and_trough(level, noise, DEPTHS_M[::thin])[0]
                num_falling += np.count_nonzero(falls)
                # The frame's border may hide what is below the edge.
                if len(falls) >= FEW and np.count_nonzero(falls) < _PERHAPS * len(falls):
                    return []
        if len(places):
            out.append(Columns(places, level))
    return out if num_falling >= _PERHAPS * FEW else []


def _as_far_as_seen(level: np.ndarray, depths_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which columns (N, D) show enough, and their levels.

    Those that are in the frame as a whole do; where these are few, those do of which the border
    hides nothing but the end, where they are taken to go on as they were last seen.
    """
    seen = np.isfinite(level)
    whole = seen.all(axis=1)
    enough = seen[:, depths_m <= ENOUGH_M].all(axis=1)
    if np.count_nonzero(whole) >= 0.5 * np.count_nonzero(enough):
        return whole, level
    last = np.maximum.accumulate(np.where(seen, np.arange(len(depths_m)), 0), axis=1)
    return enough, np.take_along_axis(level, last, axis=1)


def bundled(columns: np.ndarray, level: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Middle ones (M,) of columns (N,), `TOGETHER` each, and means (M, D) of their levels."""
    num = len(columns) // TOGETHER
    used = num * TOGETHER
    means = level[:used].reshape(num, TOGETHER, level.shape[1]).mean(axis=1)
    return columns[TOGETHER // 2 : used : TOGETHER], means


def rays_below(rays: np.ndarray, consensus: Consensus, depths: np.ndarray) -> np.ndarray:
    """Rays (N, D, 3) straight below the limb's, by angles of depth (D,)."""
    nadir = consensus.nadir_base
    across = rays - (rays @ nadir)[:, None] * nadir
    across /= np.sqrt(np.einsum("ij,ij->i", across, across))[:, None]
    angle = consensus.rho_rad - depths
    return np.cos(angle)[:, None] * nadir + np.sin(angle)[:, None] * across[:, None, :]


def levels(view: CameraView, seen: WorkingImage, rays: np.ndarray) -> np.ndarray:
    """Gray levels (N, D) above space along rays (N, D, 3); NaN outside the frame and its mask."""
    small, factor = seen.gray, seen.factor
    px = view.camera.pixels(rays.reshape(-1, 3) @ view.rot_base_from_cam)
    with np.errstate(invalid="ignore"):
        x, y = at = np.floor((px.T + 0.5) / factor)
        inside = (x >= 0) & (y >= 0) & (x < small.shape[1]) & (y < small.shape[0])
    x, y = np.where(inside, at, 0.0).astype(np.intp)
    if view.mask is not None:
        inside &= view.mask.reduced(factor)[y, x]
    level = np.where(inside, small[y, x] - seen.space_level, np.nan)
    return np.asarray(level.reshape(rays.shape[:2]))


def crest_and_trough(
    level: np.ndarray, noise: float, depths_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Whether each column (N, D) falls again behind its edge; crest, trough, index of trough."""
    outer = np.where(depths_m <= CREST_M, level, -np.inf)
    crest, at_crest = outer.max(axis=1), outer.argmax(axis=1)
    between = (depths_m >= _TROUGH_M[0]) & (depths_m <= _TROUGH_M[1])
    behind = np.arange(len(depths_m)) > at_crest[:, None]
    inner = np.where(between & behind, level, np.inf)
    trough = inner.min(axis=1)
    falls = (trough < FALL * crest) & (crest - trough > SIGMAS * noise)
    return falls, crest, trough, inner.argmin(axis=1)
