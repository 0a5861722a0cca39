"""Stretches of limb, as kriging is given them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

# The part of a profile that is used, pixels from the predicted edge into the planet and into space.
INNER_PX = 6.0
OUTER_PX = 7.0
_NONE = np.zeros(1, dtype=bool)
_NONE.setflags(write=False)


@dataclass(frozen=True, eq=False)
class Stretches:
    """Mean profiles of successive stretches of limb, sampled about predicted places of the edge.

    profiles : (N, J) gray levels at d_px (J,), whole pixels outwards. noise : one sigma of each.
    psf_px : the edge's blur. length_px : of limb. px_over_radius : ground across one pixel at the
    limb, along it, over the planet's radius. base : (N, 3) how the edge moves along the normals
    with the limb's three unknowns. cornered : (N,) squares of the distances to the optical axis,
    over half the frame's diagonal. blur_open_px : one sigma of what the blur may differ by along
    the limb. corner_px : as of `Causes`.
    """

    profiles: np.ndarray
    d_px: np.ndarray
    noise: float
    psf_px: float
    length_px: float
    px_over_radius: float
    base: np.ndarray
    cornered: np.ndarray
    blur_open_px: float = 0.0
    corner_px: float | None = None


def samples_between(d_px: np.ndarray, first_px: float, last_px: float = math.inf) -> slice:
    """Samples of profiles at d_px (J,), whole pixels, from one distance to another."""
    start = float(d_px[0])
    first = max(0, math.ceil(first_px - start))
    return slice(first, None if last_px == math.inf else math.floor(last_px - start) + 1)


def with_neighbours(scaled: np.ndarray, good: np.ndarray) -> np.ndarray:
    """Each profile between the one before and the one after it (N, 3 J).

    Where only one of these is good it takes both places, and where none is the profile's own does.
    """
    first, last = _beside(len(scaled)) if good.all() else _good_beside(good)
    return np.concatenate([scaled[first], scaled, scaled[last]], axis=1)


@lru_cache(maxsize=64)
def _beside(count: int) -> tuple[np.ndarray, np.ndarray]:
    """`_good_beside` of so many that all are."""
    return _good_beside(np.ones(count, dtype=bool))


def _good_beside(good: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Numbers (N,) of the stretches that stand before and after each."""
    index = np.arange(len(good))
    before = np.concatenate([_NONE, good[:-1]])
    after = np.concatenate([good[1:], _NONE])
    first = np.where(before, index - 1, np.where(after, index + 1, index))
    last = np.where(after, index + 1, np.where(before, index - 1, index))
    return first, last
