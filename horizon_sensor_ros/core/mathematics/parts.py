"""Arrays cut into parts, one after the other."""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise

import numpy as np


def stretches(values: np.ndarray, count: int) -> list[np.ndarray]:
    """Cut an array (N,) into so many parts, one after the other; the first may be one longer."""
    ends = _ends_of_stretches(len(values), count)
    return [values[first:last] for first, last in pairwise(ends)]


@lru_cache(maxsize=256)
def starts_and_sizes(length: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """First of each of the `stretches` of an array of this length, and how many it has: (count,)
    each.
    """
    ends = np.array(_ends_of_stretches(length, count))
    return _kept(ends[:-1]), _kept(np.diff(ends))


def _ends_of_stretches(length: int, count: int) -> list[int]:
    each, longer = divmod(length, count)
    return [i * each + min(i, longer) for i in range(count + 1)]


@lru_cache(maxsize=256)
def starts_of_parts(length: int, count: int) -> np.ndarray:
    """First (count,) of each of so many parts of an array of this length, of which the longer ones
    lie between the others.
    """
    return _kept(np.arange(count) * length // count)


def _kept(values: np.ndarray) -> np.ndarray:
    values.setflags(write=False)
    return values
