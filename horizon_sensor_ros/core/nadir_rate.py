"""How fast nadir moves in the base frame, from the last fixes.

A turn about nadir moves a limb along itself, so that this is all that a limb tells of the craft's
turning, and all that matters to one that is read out row by row.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.judgement import nadir_sigma_rad
from horizon_sensor_ros.core.turn_rate import TurnRate

# Over how long the rate is taken at most, where sets come as fast: longer is more even, and older.
# Between sets that are farther apart than the second a craft may do anything.
_WINDOW_S, _MOST_S = 0.3, 2.0
# One sigma of what rates change by in a second, over the rate, and of the slowest ones.
_CHANGE_PER_S, _LEAST_RAD_S = 0.7, math.radians(0.05)
_SURE = 5.0  # times the sigma of both: rates so far apart are not the same


class _Fix(NamedTuple):
    """What was found at a time, counted from the first fix."""

    time_s: float
    fit: HorizonFit


class NadirRate:
    """The rate by the fixes of successive sets of frames."""

    def __init__(self) -> None:
        self._fixes: deque[_Fix] = deque()

    def reset(self) -> None:
        """Forget all fixes."""
        self._fixes.clear()

    def add(self, fit: HorizonFit, since_last_s: float | None) -> None:
        """Take a fit, or one without an answer. since_last_s : since the set before; None: it is
        not known, and what was before does not count.
        """
        if since_last_s is None or since_last_s > _MOST_S or not fit.ok:
            self._fixes.clear()
        if not fit.ok:
            return
        time_s = 0.0
        if self._fixes and since_last_s is not None:
            time_s = self._fixes[-1].time_s + since_last_s
            # The last one always counts, however long ago it was.
            while len(self._fixes) > 1 and time_s - self._fixes[0].time_s > _WINDOW_S:
                self._fixes.popleft()
        self._fixes.append(_Fix(time_s, fit))

    def now(self, known_rad_s: float) -> TurnRate | None:
        """The rate at the last fix; None where fewer than two are known, or tell no more of it than
        what is known without them, one sigma.
        """
        if len(self._fixes) < 2:
            return None
        *earlier, last = self._fixes
        sigma_rad = nadir_sigma_rad(last.fit)
        rates = [_rate(fix, last, sigma_rad) for fix in earlier]
        # Of a fast craft what is recent is surest, of a slow one what is even.
        surest = min(rates, key=lambda rate: rate.sigma_rad_s)
        return surest if surest.sigma_rad_s < known_rad_s else None


def contradicted(rate: TurnRate, by_fixes: TurnRate) -> bool:
    """Whether a rate is not the fixes', but for a turn about nadir, which they do not tell."""
    off = rate.rate_base_rad_s - by_fixes.rate_base_rad_s
    about = by_fixes.nadir_base
    if about is not None:
        off = off - (off @ about) * about
    return float(np.linalg.norm(off)) > _SURE * math.hypot(rate.sigma_rad_s, by_fixes.sigma_rad_s)


def _rate(before: _Fix, last: _Fix, sigma_rad: float) -> TurnRate:
    """The rate from one fix to the last, by that one's sigma."""
    span_s = last.time_s - before.time_s
    # Nadir stands still outside, so that in the base frame it moves by -rate x nadir.
    axis = np.cross(last.fit.nadir_base, before.fit.nadir_base)
    sine = float(np.linalg.norm(axis))
    angle = math.atan2(sine, float(last.fit.nadir_base @ before.fit.nadir_base))
    rate = axis * (angle / (span_s * sine)) if sine > 0.0 else axis
    # A fix of which no rate was known is far off, and says so.
    noise = math.hypot(sigma_rad, nadir_sigma_rad(before.fit)) / span_s
    sigma = math.hypot(noise, _CHANGE_PER_S * angle, _LEAST_RAD_S)
    return TurnRate(rate, sigma, last.fit.nadir_base)
