"""Order statistics of small arrays, without what the general functions spend on their arguments."""

from __future__ import annotations

import numpy as np

MAD_TO_SIGMA = 1.4826  # of a Gaussian, from the median of the absolute deviations


def median(values: np.ndarray) -> float:
    """Median of a one-dimensional array without NaN; NaN of an empty one."""
    count = len(values)
    if count == 0:
        return np.nan
    half = count // 2
    if count % 2:
        return float(np.partition(values, half)[half])
    parted = np.partition(values, (half - 1, half))
    return 0.5 * float(parted[half - 1] + parted[half])


def robust_sigma(values: np.ndarray) -> float:
    """Scale of residuals about zero from their median size."""
    return MAD_TO_SIGMA * median(np.abs(values))
