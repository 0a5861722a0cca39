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
from horizon_sensor_ros.core.horizon.judgement import nadir_sigma_rad
from horizon_sensor_ros.core.mathematics.attitude import shortest_turn
from horizon_sensor_ros.core.motion.turn_rate import TurnRate

# Over how long the rate is taken at most, where sets come as fast: longer is more even, and older.
# Between sets that are farther apart than the second a craft may do anything.
_WINDOW_S, _MOST_S = 0.3, 2.0
# One sigma of what rates change by in a second, over the rate, and of the slowest ones.
_CHANGE_PER_S, _LEAST_RAD_S = 0.7, math.radians(0.05)


class _Fix(NamedTuple):
    """What was found at a time, counted from the first fix."""

    time_s: float
    fit: HorizonFit


class NadirRate:
    """The rate by the fixes of successive sets of frames."""

    def __init__(self) -> None:
        self._fixes: deque[_Fix] = deque()

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
            # The last one always counts, however long ago it was, and one more tells how the rate
            # changes.
            while len(self._fixes) > 2 and time_s - self._fixes[1].time_s > _WINDOW_S:
                self._fixes.popleft()
        self._fixes.append(_Fix(time_s, fit))

    def now(self, known_rad_s: float) -> TurnRate | None:
        """The rate at the last fix; None where fewer than two are known, or tell no more of it than
        what is known without them, one sigma.
        """
        if len(self._fixes) < 2:
            return None
        *earlier, last = self._fixes
        since_s = [last.time_s - fix.time_s for fix in earlier]
        change = self._change_rad_s2()
        recent = [
            (fix, span_s)
            for fix, span_s in zip(earlier, since_s, strict=True)
            if span_s <= _WINDOW_S or fix is earlier[-1]
        ]
        # Of a fast craft what is recent is surest, of a slow one what is even. A mean rate is that
        # of the middle of its time, and is asked for after its end.
        rates = [_rate(fix, last, change * (0.5 * span_s + since_s[-1])) for fix, span_s in recent]
        best = min(range(len(rates)), key=lambda i: rates[i].sigma_rad_s)
        # What changes fast is still better told by the fixes than not at all.
        steady = _rate(recent[best][0], last)
        return rates[best] if steady.sigma_rad_s < known_rad_s else None

    def _change_rad_s2(self) -> float:
        """By how much the rate changes in a second, beyond what the fixes' own errors make of it;
        0 where fewer than three are known.

        A craft that swings is slow where it turns back, and its rate changes fastest there.
        """
        first, *inner, last = self._fixes
        if not inner:
            return 0.0
        middle_s = 0.5 * (first.time_s + last.time_s)
        middle = min(inner, key=lambda fix: abs(fix.time_s - middle_s))
        before, after = _rate(first, middle), _rate(middle, last)
        change = float(np.linalg.norm(after.rate_base_rad_s - before.rate_base_rad_s))
        noise = math.hypot(_noise_rad_s(first, middle), _noise_rad_s(middle, last))
        return math.sqrt(max(change**2 - noise**2, 0.0)) / (0.5 * (last.time_s - first.time_s))


def _noise_rad_s(before: _Fix, last: _Fix) -> float:
    """What the fixes' own errors make of the rate between them."""
    # A fix of which no rate was known is far off, and says so.
    noise_rad = math.hypot(nadir_sigma_rad(last.fit), nadir_sigma_rad(before.fit))
    return noise_rad / (last.time_s - before.time_s)


def _rate(before: _Fix, last: _Fix, late_rad_s: float = 0.0) -> TurnRate:
    """The rate from one fix to another. late_rad_s : one sigma of what it has changed by since."""
    span_s = last.time_s - before.time_s
    # Nadir stands still outside, so that in the base frame it moves by -rate x nadir.
    turn = shortest_turn(last.fit.nadir_base, before.fit.nadir_base)
    noise = _noise_rad_s(before, last)
    changed = _CHANGE_PER_S * float(np.linalg.norm(turn))
    sigma = math.hypot(noise, changed, _LEAST_RAD_S, late_rad_s)
    return TurnRate(turn / span_s, sigma, last.fit.nadir_base)
