"""How fast nadir moves in the base frame, from the last fixes.

A turn about nadir moves a limb along itself, so that this is all that a limb tells of the craft's
turning, and all that matters to one that is read out row by row.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.judgement import nadir_sigma_rad
from horizon_sensor_ros.core.readout import UNKNOWN_SIGMA_RAD_S, TurnRate

# Over how long the rate is taken, where sets come as fast: longer is more even, and older. Between
# sets that are farther apart than the second a craft may do anything.
_WINDOW_S, _MOST_S = 0.3, 2.0
# One sigma of what rates change by within that time, over the rate, and of the slowest ones.
_CHANGE, _LEAST_RAD_S = 0.2, math.radians(0.05)


class _Fix(NamedTuple):
    """What was found so long ago."""

    age_s: float
    fit: HorizonFit


class NadirRate:
    """The rate by the fixes of successive sets of frames."""

    def __init__(self) -> None:
        self._fixes: list[_Fix] = []

    def reset(self) -> None:
        """Forget all fixes."""
        self._fixes = []

    def add(self, fit: HorizonFit, since_last_s: float | None) -> None:
        """Take a fit, or one without an answer. since_last_s : since the set before; None: it is
        not known, and what was before does not count.
        """
        if since_last_s is None or since_last_s > _MOST_S or not fit.ok:
            self._fixes = []
        else:
            oldest_s = max(_WINDOW_S, since_last_s)
            aged = [fix._replace(age_s=fix.age_s + since_last_s) for fix in self._fixes]
            self._fixes = [fix for fix in aged if fix.age_s <= oldest_s]
        if fit.ok:
            self._fixes.append(_Fix(0.0, fit))

    def now(self) -> TurnRate | None:
        """The rate at the last fix; None where fewer than two are known, or tell next to nothing
        of it.
        """
        if len(self._fixes) < 2:
            return None
        *earlier, last = self._fixes
        sigma_rad = nadir_sigma_rad(last.fit)

        # A fix of which no rate was known is far off, and says so.
        def noise(fix: _Fix) -> float:
            return math.hypot(sigma_rad, nadir_sigma_rad(fix.fit)) / fix.age_s

        before = min(earlier, key=noise)
        if noise(before) >= UNKNOWN_SIGMA_RAD_S:
            return None
        # Nadir stands still outside, so that in the base frame it moves by -rate x nadir.
        now, then = last.fit.nadir_base, before.fit.nadir_base
        axis = np.cross(now, then)
        sine = float(np.linalg.norm(axis))
        angle = math.atan2(sine, float(now @ then))
        rate = axis * (angle / (before.age_s * sine)) if sine > 0.0 else axis
        change = _CHANGE * max(1.0, before.age_s / _WINDOW_S) * angle / before.age_s
        return TurnRate(rate, math.hypot(noise(before), change, _LEAST_RAD_S))
