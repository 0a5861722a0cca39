"""Errors beside the covariance claimed with them: what NEES, chi-squared if claims hold, tells."""

from __future__ import annotations

import numpy as np

# 95 % of chi-squared, by degrees of freedom.
_95_PERCENT = {3: 7.81, 6: 12.59}


def nees(error: np.ndarray, covariance: np.ndarray) -> float:
    """Squared error (N,) in terms of the covariance (N, N) claimed with it; NaN where that is none:
    zeros, as of who does not know it, or otherwise not positive definite.
    """
    try:
        np.linalg.cholesky(covariance)
        return float(error @ np.linalg.solve(covariance, error))
    except np.linalg.LinAlgError:
        return float("nan")


def within_95(nees: np.ndarray, freedom: int) -> float:
    """Share of the errors within the ellipsoid that holds 95 % of them where claims hold.

    nees (N,) : normalised squared errors, of 3 or 6 degrees of freedom.
    """
    return float(np.mean(nees < _95_PERCENT[freedom]))
