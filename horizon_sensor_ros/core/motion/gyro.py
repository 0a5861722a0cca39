"""Angular rates, integrated to the rotation between two times."""

from __future__ import annotations

import bisect
from collections import deque
from itertools import islice

import numpy as np

from horizon_sensor_ros.core.mathematics.attitude import require_vector
from horizon_sensor_ros.core.mathematics.rigid import rotation_from_vector
from horizon_sensor_ros.core.seconds import s_from_ns

_MOST_SAMPLES = 5000
_FOR_A_RATE = 3  # samples


class RateHistory:
    """The last angular rates of a frame, rad/s in its own axes, by their stamps in nanoseconds.

    max_gap_ns : where neighbouring samples lie farther apart the rotation is not known. Raises
    ValueError when that is not positive.
    """

    def __init__(self, max_gap_ns: int) -> None:
        if max_gap_ns <= 0:
            raise ValueError(f"max_gap_ns must be positive, got {max_gap_ns}")
        self.max_gap_ns = max_gap_ns
        self._stamps: deque[int] = deque(maxlen=_MOST_SAMPLES)
        self._rates: deque[np.ndarray] = deque(maxlen=_MOST_SAMPLES)

    def __len__(self) -> int:
        return len(self._stamps)

    def add(self, stamp: int, rate: np.ndarray) -> bool:
        """Add a rate (3,); returns False, and adds nothing, if the stamp repeats the last one's.

        A stamp before the last one's starts a new history: time has jumped. Raises ValueError for a
        rate that is not (3,) and finite.
        """
        rate = require_vector(rate, "rate", "rad/s")
        if self._stamps and stamp == self._stamps[-1]:
            return False
        if self._stamps and stamp < self._stamps[-1]:
            self._stamps.clear()
            self._rates.clear()
        self._stamps.append(stamp)
        self._rates.append(rate)
        return True

    def rotation(self, start: int, end: int) -> np.ndarray | None:
        """rot_end_from_start (3, 3) of the frame, or None where a gap leaves it open.

        It takes the components of a vector that does not turn from the frame at `start` to the
        frame at `end`. Between samples the rate changes evenly; before the first and after the last
        it is held, for no longer than the largest gap. As in `rate` later samples do not count.
        """
        known_yet = bisect.bisect_right(self._stamps, end)
        if end < start or known_yet == 0:
            return None
        stamps = np.fromiter(islice(self._stamps, known_yet), np.int64, known_yet)
        # Exact differences: as floats, stamps would be good to a quarter of a microsecond only.
        times = np.concatenate(([start], stamps[(stamps > start) & (stamps < end)], [end])) - start
        before = np.searchsorted(stamps, start, side="right") - 1
        after = np.searchsorted(stamps, end, side="left")
        needed = stamps[max(before, 0) : after + 1]
        edges = np.concatenate(([min(start, needed[0])], needed, [max(end, needed[-1])]))
        if np.diff(edges).max() > self.max_gap_ns:
            return None
        known = (stamps - start).astype(float)
        rates = np.array(list(islice(self._rates, known_yet)))
        at = np.stack([np.interp(times, known, rates[:, axis]) for axis in range(3)], axis=1)
        turn = 0.5 * (at[1:] + at[:-1]) * s_from_ns(np.diff(times))[:, None]
        rotation = np.eye(3)
        for step in rotation_from_vector(-turn):
            rotation = step @ rotation
        return rotation

    def rate(self, stamp: int) -> tuple[np.ndarray, float] | None:
        """The rate (3,) last told up to a stamp, and what it may have changed by since, as fast as
        the last ones changed; None where there are too few of them, or the last is longer ago than
        the largest gap.

        It is their median: a single one may be a glitch. Later ones do not count, though they may
        be known: whether they are depends on who is faster.
        """
        end = bisect.bisect_right(self._stamps, stamp)
        first = end - _FOR_A_RATE
        if first < 0 or stamp - self._stamps[end - 1] > self.max_gap_ns:
            return None
        if stamp - self._stamps[first] > _FOR_A_RATE * self.max_gap_ns:
            return None
        last = np.array([self._rates[i] for i in range(first, end)])
        # The median is as old as the one in the middle.
        middle = self._stamps[first + _FOR_A_RATE // 2]
        age = (stamp - middle) / max(self._stamps[end - 1] - self._stamps[first], 1)
        return np.median(last, axis=0), max(age, 0.5) * float(np.ptp(last, axis=0).max())

    def off_ns(self, stamp: int) -> int:
        """How far the sample nearest to a stamp lies after it, or, less than zero, before it; 0
        where there are none.
        """
        at = bisect.bisect_left(self._stamps, stamp)
        beside = list(islice(self._stamps, max(at - 1, 0), at + 1))
        return min((sampled - stamp for sampled in beside), key=abs, default=0)

    def forget_before(self, stamp: int) -> None:
        """Drop what no rotation from `stamp` on, and no rate at it, needs."""
        while len(self._stamps) > _FOR_A_RATE and self._stamps[_FOR_A_RATE] <= stamp:
            self._stamps.popleft()
            self._rates.popleft()
