"""Order statistics of small arrays, without what the general functions spend on their arguments;
and parts of arrays, of which such statistics are taken."""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise

import numpy as np

_FEW = 400  # values that are put in order sooner than in parts
MAD_TO_SIGMA = 1.4826  # of a Gaussian, from the median of the absolute deviations
# Tukey's biweight: 95 % efficient for Gaussian residuals, blind to those beyond this many sigma.
TUKEY_SIGMAS = 4.685


def median(values: np.ndarray) -> float:
    """Median of values (N,) without NaN; NaN of none."""
    count = len(values)
    if count == 0:
        return np.nan
    half = count // 2
    ordered = values.copy()
    if count < _FEW:
        ordered.sort()
    else:
        ordered.partition((half - 1, half))
    return float(ordered[half]) if count % 2 else 0.5 * float(ordered[half - 1] + ordered[half])


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


def medians(values: np.ndarray, count: int) -> list[float]:
    """`median` of each of the `stretches` of an array (N,) without NaN."""
    length, longer = divmod(len(values), count)
    if length == 0:
        return [median(part) for part in stretches(values, count)]
    ends = longer * (length + 1)
    blocks = values[:ends].reshape(longer, length + 1), values[ends:].reshape(-1, length)
    return [middle for block in blocks if len(block) for middle in _middles(block)]


def _middles(rows: np.ndarray) -> list[float]:
    """Medians (M,) of rows (M, N)."""
    ordered, half = np.sort(rows, axis=1), rows.shape[1] // 2
    middle = ordered[:, half]
    if rows.shape[1] % 2 == 0:
        middle = 0.5 * (ordered[:, half - 1] + middle)
    found: list[float] = middle.tolist()
    return found


def quantile(values: np.ndarray, share: float) -> float:
    """Which value a share of values (N,), N >= 1, without NaN, lies below; linear between
    neighbours.
    """
    rank = share * (len(values) - 1)
    low = int(rank)
    high = min(low + 1, len(values) - 1)
    parted = np.partition(values, (low, high))
    below, above = float(parted[low]), float(parted[high])
    return below + (rank - low) * (above - below)


def least_share(values: np.ndarray, share: float) -> float:
    """The value with that share of the others below it; several times as fast as NumPy's."""
    place = int(share * (len(values) - 1))
    return float(np.partition(values, place)[place])


def robust_sigma(values: np.ndarray) -> float:
    """Scale of residuals (N,) about zero from their median size; NaN of none."""
    return MAD_TO_SIGMA * median(np.abs(values))
