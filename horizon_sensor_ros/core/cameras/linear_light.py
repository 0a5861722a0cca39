"""Pixels in proportion to light, out of those that a camera has encoded for the eye."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np


def linear_light(gray: np.ndarray, gamma: float, white: int = 0) -> np.ndarray:
    """Undo an encoding ``value = light ** (1 / gamma)``.

    Use before limb detection: gamma encoding shifts an edge outwards by about 0.5 px.
    gray : (H, W) uint8 or uint16. white : its white level, where that is not its type's; 0: it is.
    Of a power law another white level is another scale alone, but few of 16 bits would come to
    next to no levels by the law of all. Returns it as it is for a gamma of one, else (H, W) uint16,
    white 65535. Raises ValueError for a gamma that is not positive, and for a white level that the
    type does not hold.
    """
    if not gamma > 0.0:
        raise ValueError(f"gamma must be positive, got {gamma}")
    most = int(np.iinfo(gray.dtype).max)
    if not 0 <= white <= most:
        raise ValueError(f"white must be from 0 to {most} for {gray.dtype}, got {white}")
    if gamma == 1.0:
        return gray
    table = _table(most + 1, white or most, gamma)
    return np.asarray(cv2.LUT(gray, table)) if gray.dtype == np.uint8 else table[gray]


@lru_cache(maxsize=8)
def _table(levels: int, white: int, gamma: float) -> np.ndarray:
    light = np.minimum(np.arange(levels) / white, 1.0) ** gamma
    table = np.rint(light * 65535.0).astype(np.uint16)
    table.setflags(write=False)
    return table
