"""What returns differ by from those about them whatever the surface is like: their noise."""

from __future__ import annotations

import cv2
import numpy as np


def mixed_differences(inverse: np.ndarray, place: np.ndarray, lag: int = 1) -> np.ndarray:
    """(N,) mixed differences, m, in standard deviations of one return if these were independent.

    Of [1, -2, 1] over rows and over columns, which planes and surfaces of second degree do not
    have, however slanted, nor steps along a row or a column.

    inverse : (H, W) inverse depth, 0 without a return.  place : (N,) flat indices of returns that
        have others all about them, up to the lag.  lag : pixels from one to the next.
    """
    bend = np.zeros(2 * lag + 1, np.float32)
    bend[[0, lag, -1]] = 1, -2, 1
    mixed = cv2.sepFilter2D(inverse, cv2.CV_32F, bend, bend).ravel()[place]
    return np.asarray(mixed / (6 * inverse.ravel()[place] ** 2))
