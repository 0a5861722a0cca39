"""The gray level of white: what a frame's type and its brightest pixel tell of it."""

from __future__ import annotations

import numpy as np

# White levels of cameras: 8, 10, 12, 14, 16 bits; 8 to 14 at the top of 16, 8 at that of 12.
_WHITE = (255, 1023, 4095, 16383, 65535, 65280, 65472, 65520, 65532, 4080)
NEAR_WHITE = 0.97  # lossy coding and interpolation leave less of it


def full_scale(gray: np.ndarray) -> int:
    """Return the largest gray level that could be in a frame (H, W): 255, or for 16 bits that of
    the fewest bits that hold it, eight or more.

    Nothing in a message says how many of 16 bits a camera uses. A frame that leaves its upper bits
    unused, by its darkness, is taken for one of fewer bits.
    """
    if gray.dtype == np.uint8:
        return 255
    return (1 << max(8, int(gray.max(initial=0)).bit_length())) - 1


def saturation_level(gray: np.ndarray, sampled: np.ndarray) -> float:
    """Brightness at which a camera's frame (H, W) saturates; infinite where none of it does, or
    nothing of what is sampled from it, any shape, can.

    Not `full_scale`, which a frame need not reach.
    """
    # A pass over the whole frame costs more than all the samples.
    if sampled.max(initial=0.0) < NEAR_WHITE * _WHITE[0]:
        return np.inf
    top = float(gray.max())
    return top if top in _WHITE else np.inf
