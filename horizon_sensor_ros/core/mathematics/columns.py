"""Products of many vectors that are the columns of an array."""

from __future__ import annotations

import numpy as np


def column_dots(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(N,) products of the columns of (K, N)."""
    return np.einsum("ij,ij->j", a, b)


def column_crosses(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(3, N) cross products of columns; several times as fast as NumPy's."""
    (ax, ay, az), (bx, by, bz) = a, b
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])
