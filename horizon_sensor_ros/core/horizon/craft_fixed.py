"""A limb that stands still while the craft turns: a part of the craft, and no horizon."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from horizon_sensor_ros.core.aiding import Aiding
from horizon_sensor_ros.core.horizon.fix import HorizonFix
from horizon_sensor_ros.core.horizon.judgement import nadir_sigma_rad
from horizon_sensor_ros.core.mathematics.attitude import angle_rad
from horizon_sensor_ros.core.motion.turn_rate import (
    GYRO_SIGMA_RAD_S,
    NOT_TURNED,
    SURE,
    surely_turns,
)

# By the gyro nadir has to have moved by so much, and `SURE` times what a gyro may be off by, before
# its standing still means anything; in more than one glitch of it; and within a time.
_MOVES_RAD, _SETS, _LONGEST_S = math.radians(2.0), 3, 60.0
# What was found to stand still is forgotten after so long without having been found so again: a
# gyro may have been wrong for a while; where several cameras agree on a horizon it was.
_FORGOTTEN_S, _REFUTED_S = 600.0, 5.0
# It stands still if it has moved by less than this share of that.
_SHARE = 0.1
# A part of the craft is found in one place, to so much: farther away is something else.
_ELSEWHERE_RAD = math.radians(1.0)


@dataclass(frozen=True, eq=False)
class _Since:
    """A fix, and what happened since, or since it was last found to stand still: the gyro's turn,
    over which time, and in how many sets it was one. stood_rad : by how much nadir should have
    moved when it was; 0: it was not.
    """

    nadir_base: np.ndarray
    sigma_rad: float
    rot_now_from_then: np.ndarray = field(default_factory=lambda: NOT_TURNED)
    time_s: float = 0.0
    turning: int = 0
    stood_rad: float = 0.0

    @classmethod
    def of(cls, fix: HorizonFix) -> _Since:
        """From this fix on."""
        return cls(fix.fit.nadir_base, nadir_sigma_rad(fix.fit))

    def later(self, aiding: Aiding) -> _Since | None:
        """The fix one set later; None where it is too long ago, or the turn is not known."""
        turn, since_s, rate = aiding.rot_now_from_last, aiding.since_last_s, aiding.rate_base_rad_s
        stood = self.stood_rad > 0.0
        if self.time_s > (_FORGOTTEN_S if stood else _LONGEST_S):
            return None
        if turn is None or since_s is None or rate is None:
            return replace(self, time_s=self.time_s + (since_s or 0.0)) if stood else None
        turns = surely_turns(rate)
        return replace(
            self,
            rot_now_from_then=turn @ self.rot_now_from_then,
            time_s=self.time_s + since_s,
            turning=self.turning + turns,
        )

    @property
    def expected_rad(self) -> float:
        """How far from where it was the gyro says nadir is."""
        return angle_rad(self.rot_now_from_then @ self.nadir_base, self.nadir_base)

    @property
    def tells(self) -> bool:
        """Whether that is far enough to be seen."""
        sure_rad = _MOVES_RAD + SURE * (GYRO_SIGMA_RAD_S * self.time_s + self.sigma_rad)
        return self.turning >= _SETS and self.expected_rad > sure_rad


class CraftFixed:
    """Remembers where nadir was in the base frame, and how far the craft has turned since.

    A lens's hood, a dish, a window's frame or a bright body beside dark sky may have an edge as
    round and even as a limb. One camera cannot tell; a gyro can, once the craft turns.
    """

    def __init__(self) -> None:
        self._since: _Since | None = None

    def against(self, fix: HorizonFix, aiding: Aiding) -> str:
        """What speaks against a fix as of the horizon, for a person; empty where nothing does."""
        since = self._since = None if self._since is None else self._since.later(aiding)
        if not fix.ok:
            return ""
        if since is None:
            self._since = _Since.of(fix)
            return ""
        moved_rad = angle_rad(fix.fit.nadir_base, since.nadir_base)
        stands = since.tells and moved_rad < _SHARE * since.expected_rad
        if stands:
            kept = _Since(since.nadir_base, since.sigma_rad, stood_rad=since.expected_rad)
            since = self._since = kept
        elif since.stood_rad > 0.0:
            refuted = fix.of_several and since.time_s > _REFUTED_S
            stands = moved_rad < _ELSEWHERE_RAD and not refuted
        elif not since.tells:
            return ""
        if not stands:
            self._since = _Since.of(fix)
            return ""
        return (
            "what shows as the limb stands still, though by imu the craft has turned it by "
            f"{math.degrees(since.stood_rad):.0f} deg: is it a part of the craft, which a mask "
            "would leave out, or is the rate wrong?"
        )
