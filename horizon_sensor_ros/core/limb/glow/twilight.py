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
# A limb that was fitted to how its glow fades: slope and bend of the logarithm of that at first
# sight that the fit has evened out, from where on it has moved the limb by some three times what it
# claims; less air in front of the ground than the half of it that lies on this side; and a cost
# over the degrees of freedom that one of four limbs exceeds.
_EVENED, _LEAST_SHARE, _POOR = 0.2, 0.48, 0.7


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


def taken_for_limb(evened: float, share: float, misfit: float) -> bool:
    """Whether a fit by daylight has taken glow that fades along the limb for a lower limb.

    By daylight glow is known to be nearly even: where it is dimmer its contour is lower, and a fit
    lowers the limb. Glow that goes on down to there would be brighter than what is seen, so that
    air in front of the ground seems to be missing, and profiles fit badly. evened : by how much the
    slope and bend of log A have changed since first sight, of edges that were found one by one.
    share, misfit : as of `Air` and of the median stretch.
    """
    return evened > _EVENED and lacks_air(share) and misfit > _POOR


def lacks_air(share: float) -> bool:
    """Whether less air seems to be in front of the ground than there is. share : as of `Air`."""
    return share < _LEAST_SHARE


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
