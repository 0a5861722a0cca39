"""Whether the two bytes of a frame's pixels came in the wrong order: drivers mislabel them."""

from __future__ import annotations

import numpy as np

_ROWS = 64  # of a frame, at most: noise shows in few
_FEWEST = 1000  # pixels that tell
# Times as rough. Noise alone is 1.4 times as rough as it is the other way round, at most.
_ROUGHER = 2.0


def bytes_swapped(pixels: np.ndarray) -> bool:
    """Whether pixels (H, W) uint16, gray or a Bayer pattern, are smooth in the other byte order
    only.

    In the wrong one the low byte, mostly noise, weighs more than the high one. Pixels that use one
    byte alone are the same picture either way, and those of nine bits may be smooth in both.
    """
    rows = pixels[:: 1 + (len(pixels) - 1) // _ROWS]
    if rows.size < _FEWEST:
        return False
    return _roughness(rows) > _ROUGHER * _roughness(rows.byteswap())


def _roughness(rows: np.ndarray) -> float:
    """By how much pixels differ from the next but one, which has the same colour, over how much
    all of them differ from their mean; 0 where nothing does.
    """
    level = rows.astype(np.float32)
    spread = float(np.abs(level - level.mean()).mean())
    if spread == 0.0 or level.shape[1] <= 2:
        return 0.0
    return float(np.abs(level[:, 2:] - level[:, :-2]).mean()) / spread
