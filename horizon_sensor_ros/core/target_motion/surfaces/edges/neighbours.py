"""Which places at the ends of surfaces may lie on one line."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from horizon_sensor_ros.core.target_motion.surfaces.edges.places import WAYS, Places

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

_EDGE_REACH_PX = 4.6
# So far along both steps outwards may lie two places with different ones.
_SLANT_PX = 2.5


def _beside(way: int) -> np.ndarray:
    """(M, 3) steps in u and v, and of the way outwards, from a place to all those that may lie on
    one line with it; of two places the later one from the earlier one.
    """
    steps = []
    reach = range(-5, 6)
    for other, du, dv in product(range(way, 4), reach, reach):
        step = np.array([du, dv]) + 0.5 * (WAYS[other] - WAYS[way])
        both = WAYS[other] + WAYS[way]
        near = np.hypot(*step) <= _EDGE_REACH_PX and (other > way or (dv, du) > (0, 0))
        # On slanted lines a pixel thin: not the other side.
        if near and both.any() and (other == way or abs(step @ both) < _SLANT_PX):
            steps.append((du, dv, other - way))
    return np.array(steps)


_BESIDE = [_beside(way) for way in range(4)]


def neighbours(places: Places, shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Indices i, in order, and j of all places that may lie on the same line, each pair once.

    All are looked up in an image of the places for each way outwards; those of opposite ways are
    both sides of a part.
    """
    size, width = shape[0] * shape[1], shape[1]
    slot = np.full(4 * size, -1, np.int32)
    at = places.way * size + places.pixel
    slot[at] = np.arange(len(at), dtype=np.int32)
    ends = np.searchsorted(places.way, np.arange(5))
    pairs = []
    for way, beside in enumerate(_BESIDE):
        start = int(ends[way])
        there = slot[at[start : ends[way + 1], None] + beside @ (1, width, size)].ravel()
        hit = np.flatnonzero(there >= 0)
        pairs.append((start + hit // len(beside), there[hit]))
    i, j = (np.concatenate(part) for part in zip(*pairs, strict=True))
    return i, j


def graph(i: np.ndarray, j: np.ndarray, size: int) -> csr_matrix:
    """(size, size) matrix of ones at the pairs (i, j), i in order."""
    from scipy.sparse import csr_matrix  # noqa: PLC0415  heavy to import, and only used here

    first = np.zeros(size + 1, np.int32)
    np.cumsum(np.bincount(i, minlength=size), out=first[1:])
    return csr_matrix((np.ones(len(j)), j, first), shape=(size, size))
