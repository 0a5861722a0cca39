"""Ground that is brightest at its limb, since the Sun stands low behind that.

Sights just below the limb meet the ground at a distance from it that grows with the root of the
depth, and so does what the Sun loses in height there: brightness falls inwards as

    I(depth) = A max(1 - k sqrt(depth), 0)

down to nothing at the terminator, by Lambert's law and by Lommel's and Seeliger's alike. Blurred,
it is steepest outside the limb, the farther the narrower the strip of light is: by .15 px where a
quarter is lost over five pixels, and by up to 1 px where all is. A blurred step that is fitted to
it lies too far out as well. A and k are fitted all along the limb, together with the edge's place
and blur, and what the ground lacks below its limb is added before edges are placed. Derived here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from horizon_sensor_ros.core.limb.edge.near_edge import beside_and_deep
from horizon_sensor_ros.core.limb.edge.terminator import FADED
from horizon_sensor_ros.core.limb.profiles import ProfileGrid, space_mean
from horizon_sensor_ros.core.limb.texture.depth import seen_depths
from horizon_sensor_ros.core.limb.texture.fitted_limb import fitted_limb
from horizon_sensor_ros.core.mathematics.normal_law import normal_cdf
from horizon_sensor_ros.core.mathematics.parts import starts_of_parts
from horizon_sensor_ros.core.mathematics.robust import median

_STRETCHES = 12
# Brightness lost from beside the edge to farther in, over that beside it, from which on it counts:
# what is less than that edges claim as texture.
_LOST = 0.2
_RISING = np.geomspace(0.05, 0.4, 10)
_FALLS = np.concatenate([-_RISING[::-1], [0.0], np.geomspace(0.05, 1.25, 24)])  # k that are tried
_BLURS_PX = (0.42, 0.48, 0.55, 0.63, 0.72, 0.82, 0.93)
_PITCH_PX = 0.1  # between places of the edge that are tried, and of tables
_INNER_PX, _OUTER_PX = 6.0, 5.0  # the part of a profile that is fitted
_TABLE_PX = (-13.0, 12.0)  # from the edge
# Error of edges, beside the truth of 150 limbs, times the width of the strip of light, 1 / k^2.
_STRIP_PX2 = 0.1
_LEAST_SIGMA_PX = 0.03  # of an edge's place, half the pitch of those tried

_BEND = np.linalg.qr(np.vander(np.arange(12.0), 3))[0]
_SLOW = _BEND @ _BEND.T  # takes values of stretches to the parabola along the limb


@dataclass(frozen=True, eq=False)
class FallingLight:
    """Light that falls inwards from the limb, beside stretches of it.

    level, fall : (M,) A, gray levels, and k of each. limb : (3,) the limb about which it was
    fitted, moved from the predicted one, by base (M, 3) as of `Stretches`. psf_px : blur of the
    edge.
    """

    level: np.ndarray
    fall: np.ndarray
    limb: np.ndarray
    base: np.ndarray
    psf_px: float

    def about(self, limb: np.ndarray) -> FallingLight:
        """This light, where profiles are sampled about the limb moved by (3,)."""
        return replace(self, limb=self.limb - limb)

    @property
    def sigma_px(self) -> np.ndarray:
        """What edges (M,) are off by beside it: the more, the narrower the strip of light is."""
        return np.asarray(_STRIP_PX2 * np.square(self.fall))

    def faded(self, good: np.ndarray) -> np.ndarray:
        """Which edges (M,) lie where light ends, as `fading_ends`; good : (M,) that count."""
        return self.level < FADED * median(self.level[good])

    def lacking(self, d_px: np.ndarray) -> np.ndarray:
        """What the ground lacks (M, J) at places d_px (J,) across the limb."""
        x_px, root, blur = _seen(self.psf_px)
        lacks = np.minimum(self.fall[:, None] * root, 1.0) @ blur.T
        at = (d_px - (self.base @ self.limb)[:, None] - x_px[0]) / _PITCH_PX
        before = np.clip(at.astype(np.intp), 0, len(x_px) - 2)
        share = np.clip(at - before, 0.0, 1.0)
        row = np.arange(len(lacks))[:, None]
        lacking = (1.0 - share) * lacks[row, before] + share * lacks[row, before + 1]
        return np.asarray(self.level[:, None] * lacking)


def falling_light(
    profiles: np.ndarray, grid: ProfileGrid, noise: float, base: np.ndarray, good: np.ndarray
) -> FallingLight | None:
    """Light that falls inwards beside profiles (M, J); None where it does not, all along the limb.

    noise : one sigma of a sample. base : (M, 3) as of `Stretches`. good : (M,) which show an edge.
    """
    shown = profiles[good]
    if not _falls(shown, grid):
        return None
    d_px = grid.d_px
    reach_px = grid.reach_px
    used = (d_px >= -_INNER_PX) & (d_px <= _OUTER_PX)
    fits = [_costs(shown[:, used], d_px[used], reach_px, psf_px) for psf_px in _BLURS_PX]
    likely = min(range(len(fits)), key=lambda i: float(np.sum(np.sqrt(fits[i].min(axis=(1, 2))))))
    psf_px, cost = _BLURS_PX[likely], _together(fits[likely])
    freedom = np.count_nonzero(used) - 4
    variance = np.maximum(cost.min(axis=(1, 2)) / freedom, noise**2)
    share = np.exp(-0.5 * (cost - cost.min(axis=(1, 2), keepdims=True)) / variance[:, None, None])
    share /= share.sum(axis=(1, 2), keepdims=True)
    e_px = _places(reach_px)
    place = share.sum(axis=1) @ e_px
    spread = np.sqrt(share.sum(axis=1) @ e_px**2 - place**2 + _LEAST_SIGMA_PX**2)
    fall_shown = share.sum(axis=2) @ _FALLS
    limb = fitted_limb(base[good], place, spread)
    index = np.arange(len(profiles))
    fall = np.interp(index, index[good], fall_shown)
    light = FallingLight(np.ones(len(profiles)), fall, limb, base, psf_px)
    return replace(light, level=_levels(profiles, d_px, light))


def _falls(profiles: np.ndarray, grid: ProfileGrid) -> bool:
    """Whether brightness falls inwards beside profiles (N, J), evenly along the limb."""
    if len(profiles) < _STRETCHES:
        return False
    first = starts_of_parts(len(profiles), _STRETCHES)
    count = np.diff(first, append=len(profiles))
    means = np.add.reduceat(profiles.T, first, axis=1) / count
    beside, deep = beside_and_deep(grid).T @ means - space_mean(profiles)
    lost = 1.0 - deep / np.maximum(beside, 1e-9)
    # Light changes slowly along the limb, where clouds are brighter here and darker there.
    slowly = _SLOW @ lost
    off = lost - slowly
    by_chance = math.sqrt(float(off @ off) / (_STRETCHES - 3.0))
    return float(slowly.max()) - 2.0 * by_chance > _LOST


def _together(cost: np.ndarray) -> np.ndarray:
    """Mean costs (N, ...) of neighbours: light changes slowly along the limb."""
    padded = np.concatenate([cost[:1], cost, cost[-1:]])
    return np.asarray((padded[:-2] + padded[1:-1] + padded[2:]) / 3.0)


def _levels(profiles: np.ndarray, d_px: np.ndarray, light: FallingLight) -> np.ndarray:
    """Brightness (M,) at the limb, for falling light of level one: by least squares."""
    x_px = d_px - (light.base @ light.limb)[:, None]
    shape = normal_cdf(-x_px / light.psf_px) - light.lacking(d_px)
    used = (d_px >= -_INNER_PX) & (d_px <= _OUTER_PX)
    shape = shape[:, used] - shape[:, used].mean(axis=1, keepdims=True)
    level = np.einsum("ij,ij->i", shape, profiles[:, used]) / np.einsum("ij,ij->i", shape, shape)
    return np.maximum(level, 0.0)


def _costs(profiles: np.ndarray, d_px: np.ndarray, reach_px: float, psf_px: float) -> np.ndarray:
    """Squares of what is left (N, K, E) of profiles (N, J) beside each fall and place."""
    basis = _bases(tuple(d_px.tolist()), reach_px, psf_px)
    about = profiles - profiles.mean(axis=1, keepdims=True)
    explained = np.square(about @ basis.reshape(-1, basis.shape[-1]).T)
    left = np.square(about).sum(axis=1)[:, None] - explained
    return np.asarray(left.reshape(len(profiles), *basis.shape[:2]))


@lru_cache(maxsize=32)
def _bases(d_px: tuple[float, ...], reach_px: float, psf_px: float) -> np.ndarray:
    """Profiles (K, E, J) without their means, of length one."""
    table_px, root, blur = _seen(psf_px)
    edges = normal_cdf(-table_px / psf_px) - np.minimum(_FALLS[:, None] * root, 1.0) @ blur.T
    at = (np.array(d_px) - _places(reach_px)[:, None] - table_px[0]) / _PITCH_PX
    shape = edges[:, np.clip(np.rint(at).astype(np.intp), 0, len(table_px) - 1)]
    shape = shape - shape.mean(axis=-1, keepdims=True)
    return np.asarray(shape / np.linalg.norm(shape, axis=-1, keepdims=True))


def _places(reach_px: float) -> np.ndarray:
    """Places (E,) of the edge that are tried."""
    count = round(reach_px / _PITCH_PX)
    return _PITCH_PX * np.arange(-count, count + 1)


@lru_cache(maxsize=16)
def _seen(psf_px: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distances (X,) from the edge, and `seen_depths` there."""
    first, last = _TABLE_PX
    x_px = first + _PITCH_PX * np.arange(round((last - first) / _PITCH_PX) + 1)
    return x_px, *seen_depths(x_px, psf_px)
