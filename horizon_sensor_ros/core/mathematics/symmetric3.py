"""Symmetric 3 x 3 matrices in closed form: NumPy's general functions take longer to be called."""

from __future__ import annotations

import math

import numpy as np

_Factors = tuple[float, float, float, float, float, float]


def _factors(matrix: np.ndarray) -> _Factors | None:
    """Return L's (21, 31, 32) and D's (1, 2, 3) of ``L D L^T``; None unless it is positive."""
    (a, b, c), (_, d, e), (_, _, f) = matrix.tolist()
    if not 0.0 < a < math.inf:
        return None
    l21, l31 = b / a, c / a
    d2, e = d - b * l21, e - c * l21
    if not 0.0 < d2 < math.inf:
        return None
    l32 = e / d2
    d3 = f - c * l31 - e * l32
    return (l21, l31, l32, a, d2, d3) if 0.0 < d3 < math.inf else None


def is_positive(matrix: np.ndarray) -> bool:
    """Whether a symmetric matrix (3, 3) is positive definite; not when it is not finite."""
    return _factors(matrix) is not None


def solve(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solution (3,) of a positive definite system; NaN when it is not positive definite."""
    factors = _factors(matrix)
    if factors is None:
        return np.full(3, np.nan)
    l21, l31, l32, d1, d2, d3 = factors
    x, y, z = right.tolist()
    y -= l21 * x
    z = (z - l31 * x - l32 * y) / d3
    y = y / d2 - l32 * z
    return np.array([x / d1 - l21 * y - l31 * z, y, z])


def inverse(matrix: np.ndarray) -> np.ndarray:
    """Inverse (3, 3) of a positive definite matrix; NaN when it is not positive definite."""
    factors = _factors(matrix)
    if factors is None:
        return np.full((3, 3), np.nan)
    l21, l31, l32, d1, d2, d3 = factors
    m = l21 * l32 - l31
    xy, xz, yz = -l21 / d2 - m * l32 / d3, m / d3, -l32 / d3
    xx = 1.0 / d1 + l21 * l21 / d2 + m * m / d3
    return np.array([[xx, xy, xz], [xy, 1.0 / d2 + l32 * l32 / d3, yz], [xz, yz, 1.0 / d3]])


def largest_eigenvalue(matrix: np.ndarray) -> float:
    """Largest eigenvalue of a matrix (3, 3) that is positive semi-definite and singular."""
    (a, b, c), (_, d, e), (_, _, f) = matrix.tolist()
    half = 0.5 * (a + d + f)
    minors = a * d - b * b + a * f - c * c + d * f - e * e
    return half + math.sqrt(max(half * half - minors, 0.0))
