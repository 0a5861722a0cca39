"""One camera's fixes to which no craft could have come from those before: of another body."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from horizon_sensor_ros.core.aiding import Aiding
from horizon_sensor_ros.core.horizon.fix import HorizonFix
from horizon_sensor_ros.core.horizon.judgement import nadir_sigma_rad
from horizon_sensor_ros.core.mathematics.attitude import angle_rad
from horizon_sensor_ros.core.mathematics.rigid import vector_from_rotation
from horizon_sensor_ros.core.motion.turn_rate import GYRO_SIGMA_RAD_S

# No craft comes nearer to a planet, or leaves it, as fast: a fall to Jupiter ends with 60 km/s.
_FASTEST_M_S = 100e3
# So many sigmas of both fixes, and of a gyro in the meantime; and what lenses and mountings that
# nobody told make of a turn.
_FIXES, _GYRO, _LEAST_RAD = 5.0, 3.0, math.radians(2.0)
_LONGEST_S = 60.0  # for which fixes are remembered, and a gyro is integrated
_BORNE_OUT = 3  # sets one after the other by which a gyro that was wrong is right again


@dataclass(frozen=True, eq=False)
class _Run:
    """Fixes that one craft may have come through: the last one, how many, and what happened since.

    turned_rad : by the gyro, all turns added up.
    """

    nadir_base: np.ndarray
    sigma_rad: float
    altitude_m: float
    altitude_sigma_m: float
    sets: int = 1
    turned_rad: float = 0.0
    time_s: float = 0.0

    @classmethod
    def of(cls, fix: HorizonFix, before: _Run | None = None) -> _Run:
        """With one more fix."""
        fit = fix.fit
        sigma_m = math.sqrt(float(fit.cov_nadir_altitude[3, 3]))
        sets = 1 if before is None else before.sets + 1
        return cls(fit.nadir_base, nadir_sigma_rad(fit), fit.altitude_m, sigma_m, sets)

    def later(self, turn: np.ndarray, since_s: float) -> _Run | None:
        """The run one set later; None where its last fix is too long ago."""
        time_s = self.time_s + since_s
        if time_s > _LONGEST_S:
            return None
        turned_rad = self.turned_rad + float(np.linalg.norm(vector_from_rotation(turn)))
        return replace(self, turned_rad=turned_rad, time_s=time_s)

    def leads_to(self, new: _Run) -> bool:
        """Whether a craft may be there now, by its altitude."""
        sigma_m = math.hypot(self.altitude_sigma_m, new.altitude_sigma_m)
        most_m = _FASTEST_M_S * self.time_s + _FIXES * sigma_m
        return abs(new.altitude_m - self.altitude_m) <= most_m

    def turns_to(self, new: _Run) -> bool:
        """Whether it may have turned so far, by the gyro.

        Less far is no contradiction: of what stands still `CraftFixed` judges, and one glitch of
        the gyro is none.
        """
        fixes_rad = _FIXES * math.hypot(self.sigma_rad, new.sigma_rad)
        more_rad = _LEAST_RAD + fixes_rad + _GYRO * GYRO_SIGMA_RAD_S * self.time_s
        return self.moved_rad(new) <= self.turned_rad + more_rad

    def moved_rad(self, new: _Run) -> float:
        """How far nadir has moved since."""
        return angle_rad(self.nadir_base, new.nadir_base)


class Leaps:
    """Remembers where the craft was, and what else was seen.

    Where the limb leaves the frame of one camera, and the Moon or a reflection comes in, only one
    thing tells which of both is the planet: what was there for longer. Fixes of the other are not
    believed until there were more sets of them, or for a minute. Fixes on which several cameras
    agree are believed at once.

    Without a gyro nothing is asked: frames of another scene are no fault then. A gyro by which the
    craft turned less than from one fix to the next, twice one right after the other, is wrong:
    until fixes bear it out again altitude alone is asked.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget all fixes."""
        self._known: _Run | None = None
        self._other: _Run | None = None
        self._last: _Run | None = None
        self._wrong, self._borne_out = 0, _BORNE_OUT

    def against(self, fix: HorizonFix, aiding: Aiding) -> str:
        """What speaks against a fix, for a person; empty where nothing does."""
        turn, since_s = aiding.rot_now_from_last, aiding.since_last_s
        if turn is None or since_s is None:
            self.reset()
        else:
            self._known, self._other, self._last = (
                run and run.later(turn, since_s) for run in (self._known, self._other, self._last)
            )
        if not fix.ok:
            return ""
        new = _Run.of(fix)
        self._ask_gyro(new)
        known, other = self._known, self._other
        if known is None or fix.of_several or self._follows(known, new):
            self._known = _Run.of(fix, known)
            return ""
        follows = other is not None and self._follows(other, new)
        self._other = other = _Run.of(fix, other if follows else None)
        if other.sets > known.sets:
            self._known, self._other = other, known
            return ""
        far = f"{known.altitude_m / 1e3:.0f} km became {new.altitude_m / 1e3:.0f}"
        if known.leads_to(new):
            moved, turned = np.degrees((known.moved_rad(new), known.turned_rad))
            far = f"nadir has moved by {moved:.0f} deg, the craft by imu by {turned:.0f}"
        return (
            f"another body, or a reflection? {far} within {known.time_s:.1f} s: not believed for "
            f"another {known.sets - other.sets + 1} sets or {_LONGEST_S - known.time_s:.0f} s"
        )

    def _follows(self, run: _Run, new: _Run) -> bool:
        return run.leads_to(new) and (self._borne_out < _BORNE_OUT or run.turns_to(new))

    def _ask_gyro(self, new: _Run) -> None:
        """Whether the gyro says of successive fixes what they say of it."""
        last, self._last = self._last, new
        if last is None:
            return
        if last.turns_to(new):
            self._wrong, self._borne_out = 0, self._borne_out + 1
            return
        self._wrong += 1
        if self._wrong > 1:
            self._borne_out = 0
