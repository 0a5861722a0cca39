"""Towards the terminator: whether a limb reaches it, which part the Sun lights, and how brightly.

The glow's brightness falls by a law that is not known (`brightness.further_powers`), and the ground
darkens with the air.
"""

from __future__ import annotations

import math

import numpy as np

from horizon_sensor_ros.core.limb.glow.brightness import powers
from horizon_sensor_ros.core.mathematics.robust import median, quantile

# By how much the logarithm of glow falls along the part of a limb that is looked at: what is darker
# tells hardly more, and less of it follows any law.
_MOST_FADING = 2.0
_AROUND = 2  # stretches to either side, of which the median counts
_DARKEST = 0.05  # ground, over the brightest
_BRIGHT = 0.95  # share of the stretches that are darker than what counts as the brightest
_ENDS = 6  # an end is so many-th of a limb


def lit_part(glow: np.ndarray) -> tuple[float, float] | None:
    """Ends, 0 to 1 along the limb, of what is lit around the brightest glow of stretches (M,); None
    if nothing glows.
    """
    beside = np.pad(glow, _AROUND, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(beside, 2 * _AROUND + 1)
    smooth = np.median(windows, axis=1)
    top = int(np.argmax(smooth))
    if not smooth[top] > 0.0:
        return None
    dark = np.flatnonzero(smooth < math.exp(-_MOST_FADING) * smooth[top])
    first = max(dark[dark < top] + 1, default=0)
    last = min(dark[dark > top], default=len(glow))
    return float(first) / len(glow), float(last) / len(glow)


def darker_end(level: np.ndarray) -> tuple[float, float]:
    """Level of the ground at the darker end of a limb, and where it is brightest; of levels (K,)
    along it.
    """
    size = max(len(level) // _ENDS, 1)
    return min(median(level[:size]), median(level[-size:])), quantile(level, _BRIGHT)


def lit_shares(along: np.ndarray, level: np.ndarray) -> np.ndarray:
    """How brightly ground with levels (K,) is lit at places along the limb, over where it is lit
    most.
    """
    shape = powers(along)
    smooth = shape @ np.linalg.lstsq(shape, level, rcond=None)[0]
    brightest = float(smooth.max())
    if not brightest > 0.0:
        return np.ones(len(along))
    return np.clip(smooth / brightest, _DARKEST, 1.0)
