"""Which of the coarse poses that came counts for a set of frames."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from horizon_sensor_ros.core.aiding import CoarsePose

# That wait for a set to count for; the first one kept may have counted for the last set.
_MOST = 10


@dataclass(frozen=True)
class Chosen:
    """The pose for a set: age_ns : by the stamps, negative where the pose is of later.
    of_another_time : how many came beside it, near no set by their stamps, and were not told yet.
    """

    age_ns: int
    pose: CoarsePose
    of_another_time: int = 0


@dataclass(frozen=True)
class _Dated:
    stamp: int
    pose: CoarsePose
    told: bool = False  # that it is of another time


class CoarsePoses:
    """Keeps, in the order in which they came, the poses that may count for the next set of frames.

    The one whose stamp is nearest to the set's counts, and of equals the last that came: one that
    was held up on its way takes no fresher one's place, and neither does one of another time. That
    waits until a later one counts, since time may jump to it.
    """

    def __init__(self) -> None:
        self._poses: list[_Dated] = []

    def add(self, stamp: int, pose: CoarsePose) -> None:
        """Take a pose and its stamp, ns."""
        self._poses.append(_Dated(stamp, pose))
        if len(self._poses) > 1 + _MOST:
            del self._poses[1]

    def of_set(self, stamp: int, max_age_ns: int) -> Chosen | None:
        """Return what counts for a set; where no pose is within `max_age_ns` of it, the latest one.
        None where there is none at all.
        """
        if not self._poses:
            return None
        near = [abs(stamp - each.stamp) <= max_age_ns for each in self._poses]
        if not any(near):
            return Chosen(stamp - self._poses[-1].stamp, self._poses[-1].pose)
        counts = min(
            (i for i, is_near in enumerate(near) if is_near),
            key=lambda i: (abs(stamp - self._poses[i].stamp), -i),
        )
        new = 0
        for index, each in enumerate(self._poses):
            if not (near[index] or each.told):
                self._poses[index] = replace(each, told=True)
                # One that counted before has only grown old.
                new += index > 0
        chosen = self._poses[counts]
        # Of those that came before it one of later may yet be the nearest.
        before = zip(self._poses[:counts], near, strict=False)
        later = [each for each, is_near in before if is_near and each.stamp > chosen.stamp]
        self._poses = [chosen, *later, *self._poses[counts + 1 :]]
        return Chosen(stamp - chosen.stamp, chosen.pose, new)

    def drop(self, is_of_before: Callable[[int], bool]) -> None:
        """Drop poses by their stamps."""
        self._poses = [each for each in self._poses if not is_of_before(each.stamp)]

    def with_sigmas(self, position_m: float, rotation_rad: float) -> CoarsePoses:
        """Return the same poses with other sigmas."""
        other = CoarsePoses()
        for each in self._poses:
            pose = replace(each.pose, position_sigma_m=position_m, rotation_sigma_rad=rotation_rad)
            other._poses.append(replace(each, pose=pose))
        return other
