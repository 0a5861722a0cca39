"""Errors beside the covariance claimed with them: what NEES, chi-squared if claims hold, tells."""

from __future__ import annotations

import numpy as np

# 95 % of chi-squared, by degrees of freedom.
_95_PERCENT = {3: 7.81, 6: 12.59}


def within_95(nees: np.ndarray, freedom: int) -> float:
    """Share of the errors within the ellipsoid that holds 95 % of them where claims hold.

    nees (N,) : normalised squared errors, of 3 or 6 degrees of freedom.
    """
    return float(np.mean(nees < _95_PERCENT[freedom]))
