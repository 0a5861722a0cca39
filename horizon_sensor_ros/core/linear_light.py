"""Pixels in proportion to light, out of those that a camera has encoded for the eye."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np


def linear_light(gray: np.ndarray, gamma: float) -> np.ndarray:
    """Undo an encoding ``value = light ** (1 / gamma)``.

    Use before limb detection: gamma encoding shifts an edge outwards by about 0.5 px.
    gray : (H, W) uint8 or uint16. Returns it as it is for a gamma of one, else (H, W) uint16, with
    the same white level over 65535. Raises ValueError for a gamma that is not positive.
    """
    if not gamma > 0.0:
        raise ValueError(f"gamma must be positive, got {gamma}")
    if gamma == 1.0:
        return gray
    if gray.dtype == np.uint8:
        return np.asarray(cv2.LUT(gray, _table(256, gamma)))
    return _table(65536, gamma)[gray]


@lru_cache(maxsize=8)
def _table(levels: int, gamma: float) -> np.ndarray:
    light = np.linspace(0.0, 1.0, levels) ** gamma
    table = np.rint(light * 65535.0).astype(np.uint16)
    table.setflags(write=False)
    return table
