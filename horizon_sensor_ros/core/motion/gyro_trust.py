"""Whether the rate of a gyro is that by which the horizon moves, and for how long it is not."""

from __future__ import annotations

import math

import numpy as np

from horizon_sensor_ros.core.motion.turn_rate import TurnRate

_SURE = 5.0  # times the sigma of both: rates so far apart are not the same
# For how long fixes have to bear a wrong gyro out until it is believed again: longer than a swing
# stays where it turns back, where a rate of the wrong sign, or scale, is right; and for how long it
# is not asked for where there are no fixes to ask.
_BORNE_OUT_S, _NOT_ASKED_S = 10.0, 60.0


class GyroTrust:
    """Remembers from set to set that a gyro was wrong.

    The rate by the fixes is the surer the less it changes, so that a gyro's bias is seen now and
    then only; it is there all the time.
    """

    def __init__(self) -> None:
        self._wrong = False
        self._borne_out_s = self._not_asked_s = 0.0

    def refute(self) -> None:
        """It was found to be wrong, by the rate of the fixes or by something else."""
        self._wrong = True
        self._borne_out_s = self._not_asked_s = 0.0

    def believes(
        self, gyro_rate: TurnRate, by_fixes: TurnRate | None, since_last_s: float | None
    ) -> bool:
        """Whether a gyro's rate is to be used, by what fixes tell now and told before.

        by_fixes : None where they tell nothing. since_last_s : since the set before, seconds; None:
        not known.
        """
        if by_fixes is not None and _contradicted(gyro_rate, by_fixes):
            self.refute()
        elif by_fixes is not None:
            self._borne_out_s += since_last_s or 0.0
            self._not_asked_s = 0.0
        else:
            self._not_asked_s += since_last_s or 0.0
        if self._borne_out_s > _BORNE_OUT_S or self._not_asked_s > _NOT_ASKED_S:
            self._wrong = False
        return not self._wrong


def _contradicted(rate: TurnRate, by_fixes: TurnRate) -> bool:
    """Whether a rate is not the fixes', but for a turn about nadir, which they do not tell."""
    off = rate.rate_base_rad_s - by_fixes.rate_base_rad_s
    about = by_fixes.nadir_base
    if about is not None:
        off = off - (off @ about) * about
    return float(np.linalg.norm(off)) > _SURE * math.hypot(rate.sigma_rad_s, by_fixes.sigma_rad_s)
