"""What textures do along the limb: how they change brightness, and what errors neighbours share."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from horizon_sensor_ros.core.limb.texture import ground_texture
from horizon_sensor_ros.core.limb_points import STRETCHES, SharedError

_LAG = 0.06  # over the planet's radius; brightness is compared along so much limb
_STEP_VARIANCE = 0.5  # over that of a pixel of a profile: two of them are beside the edge
# What neighbours share of texture's variance, over what its covariance says: as measured, of rough
# texture and of smooth.
_SHARED = ground_texture.by_kind(0.75, 2.4)
# Rough texture that changes brightness by nearly as much as there is of it moves all of a limb by
# more than to first order: as measured.
_BY_CONTRAST = 5.0  # growth of that move with the contrast: deviation of brightness over its median
_MOST_CONTRAST = 0.7  # from where on it grows no more


def level_evidence(step: np.ndarray, ground: float) -> np.ndarray:
    """Log likelihood (N, S) of each texture by how brightness changes along the limb.

    step : (N,) over the noise, of stretches of a length of ``ground``.
    """
    lag = min(max(1, round(_LAG / ground)), len(step) - 1)
    change2 = 0.5 * np.square(step[lag:] - step[:-lag])
    ahead, behind = _around(len(step), lag)
    change2 = 0.5 * (change2[ahead] + change2[behind])
    expected = _STEP_VARIANCE + _variogram(lag, ground)
    # Changes over stretches in common are one.
    return -0.5 * (change2[:, None] / expected + np.log(expected)) / lag


def shared_error(variance: np.ndarray, count: int, ground: float, contrast: float) -> SharedError:
    """What edges have in common: so much of each texture's variance (S,) as it is alike.

    count : stretches of limb, of a length of ``ground``. contrast : one sigma of their brightness,
    over its median.
    """
    shared = variance * _SHARED
    more = 1.0 + _BY_CONTRAST * min(contrast, _MOST_CONTRAST)
    part2 = shared @ _alike(max(1, round(count / STRETCHES)), ground)
    whole2, rough2 = shared @ _alike(count, ground), shared @ _alike_if_rough(count, ground)
    return SharedError(math.sqrt(part2), math.sqrt(whole2 + (more * more - 1.0) * rough2))


def rounded(ground: float) -> float:
    """A length of ground to two digits: near enough for how alike texture is, and often the same as
    in the last frame.
    """
    return float(f"{ground:.2g}")


@lru_cache(maxsize=64)
def _around(count: int, lag: int) -> tuple[np.ndarray, np.ndarray]:
    """Numbers (N,) of the changes, over so many stretches, that begin and end at each of `count`;
    those next to it at the ends.
    """
    index = np.arange(count)
    return np.minimum(index, count - lag - 1), np.maximum(index - lag, 0)


@lru_cache(maxsize=64)
def _variogram(lag: int, ground: float) -> np.ndarray:
    return ground_texture.variogram(lag * ground)


@lru_cache(maxsize=64)
def _alike(count: int, ground: float) -> np.ndarray:
    """Mean correlation (S,) of each texture over all pairs of so many stretches."""
    away = np.arange(count)
    pairs = np.where(away > 0, 2.0, 1.0) * (count - away) / count**2
    return ground_texture.correlation(away * ground) @ pairs


@lru_cache(maxsize=64)
def _alike_if_rough(count: int, ground: float) -> np.ndarray:
    """`_alike` (S,) of rough textures, 0 of smooth ones."""
    return _alike(count, ground) * ground_texture.by_kind(1.0, 0.0)
