"""Order statistics of small arrays, without what the general functions spend on their arguments."""

from __future__ import annotations

import numpy as np

from horizon_sensor_ros.core.mathematics.parts import stretches

_FEW = 400  # values that are put in order sooner than in parts
# Of a normal law with sigma 1: the median of its values' sizes, and the inverse of that.
NORMAL_MEDIAN, MAD_TO_SIGMA = 0.6745, 1.4826
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


def lower_quantile(values: np.ndarray, share: float) -> float:
    """Greatest of values (N,), N >= 1, without NaN, that no more than a share of the others lies
    below; several times as fast as NumPy's.
    """
    place = int(share * (len(values) - 1))
    return float(np.partition(values, place)[place])


def robust_sigma(values: np.ndarray) -> float:
    """Scale of residuals (N,) about zero from their median size; NaN of none."""
    return MAD_TO_SIGMA * median(np.abs(values))
