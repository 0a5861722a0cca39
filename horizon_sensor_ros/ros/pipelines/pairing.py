"""Frames of several cameras, put together by their stamps."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Generic, TypeVar

Item = TypeVar("Item")

# Of a camera's last intervals the shortest counts as its frame period.
_INTERVALS = 8
# Frames of each other camera that a silent one must have missed, however slow all are.
_MISSED = 3


@dataclass(frozen=True)
class Paired(Generic[Item]):
    """What became of a pushed frame.

    sets : complete sets, oldest first, each one item a camera in the cameras' order, without those
    that are silent.
    repeated : the frame had its predecessor's stamp and was dropped. jumped : its stamp lies before
    its predecessor's; the camera has been reset. first_to_jump : no other camera was in the new
    timeline yet, so that a jump of all of them counts once.
    unpaired : how many frames left the buffers without a partner.
    """

    sets: tuple[tuple[tuple[int, Item], ...], ...] = ()
    repeated: bool = False
    jumped: bool = False
    first_to_jump: bool = False
    unpaired: int = 0


@dataclass(frozen=True)
class _Entry(Generic[Item]):
    stamp: int
    item: Item
    # The camera's frame period as far as known at this frame, ns.
    period: int | None


@dataclass
class _Stream(Generic[Item]):
    entries: deque[_Entry[Item]] = field(default_factory=deque)
    intervals: deque[int] = field(default_factory=lambda: deque(maxlen=_INTERVALS))
    last: int | None = None
    timeline: int = 0
    # Of the other cameras since this one's last frame: stamp of the first frame, how many.
    waiting_since: int | None = None
    missed: int = 0

    def heard(self) -> None:
        self.waiting_since, self.missed = None, 0

    def unheard(self, stamp: int) -> None:
        """Another camera's frame came; after a jump back the wait begins anew."""
        if self.waiting_since is None or stamp < self.waiting_since:
            self.waiting_since, self.missed = stamp, 0
        self.missed += 1


class Pairing(Generic[Item]):
    """Pairs frames of N cameras whose stamps lie within `slop_ns` of each other.

    Which frames make a set depends on the stamps within each stream alone, not on how the streams
    interleave, as long as none runs ahead of another by more than `depth` frames. From the oldest
    frames on, a set is taken as soon as no closer one can follow: at once when the stamps are equal
    or less than half a frame period apart, else after the next frame of the camera that lags.
    A camera without a frame for longer than `timeout_ns` of the others' stamps is silent, and sets
    are made without it until it is heard again; 0: they wait for ever.
    """

    def __init__(
        self, cameras: Sequence[str], slop_ns: int, depth: int = 10, timeout_ns: int = 0
    ) -> None:
        if not cameras or len(set(cameras)) != len(cameras):
            raise ValueError(f"cameras must be different names, got {list(cameras)}")
        if slop_ns < 0 or depth < 2:
            raise ValueError(f"need slop_ns >= 0 and depth >= 2, got {slop_ns} and {depth}")
        if timeout_ns < 0:
            raise ValueError(f"need timeout_ns >= 0, got {timeout_ns}")
        self.slop_ns = slop_ns
        self._timeout_ns = timeout_ns
        self._depth = depth
        self._streams: dict[str, _Stream[Item]] = {name: _Stream() for name in cameras}
        self._num_heard = len(cameras)

    def go_on_from(self, other: Pairing[Item]) -> None:
        """Take the last frames of another pairing of these cameras for the last here, none of which
        waits for a partner: a stamp that repeats theirs is repeated, an earlier one a jump.
        """
        for name, stream in self._streams.items():
            stream.last = other._streams[name].last

    def nearest_ns(self, camera: str) -> int | None:
        """How far a camera's last stamp is from the nearest of the others' last ones; None where
        not both are there.
        """
        last = self._streams[camera].last
        others = (s.last for name, s in self._streams.items() if name != camera)
        apart = [abs(last - other) for other in others if last is not None and other is not None]
        return min(apart, default=None)

    def push(self, camera: str, stamp: int, item: Item) -> Paired[Item]:
        """Add a frame; stamp in nanoseconds."""
        stream = self._streams[camera]
        if stamp == stream.last:
            return Paired(repeated=True)
        unpaired = 0
        jumped = stream.last is not None and stamp < stream.last
        first_to_jump = jumped and stream.timeline == self._latest_timeline()
        if jumped:
            unpaired += self._start_new_timeline(stream)
        elif stream.last is not None:
            stream.intervals.append(stamp - stream.last)
        stream.last = stamp
        self._count_silence(stream, stamp)
        period = min(stream.intervals) if stream.intervals else None
        stream.entries.append(_Entry(stamp, item, period))
        sets = []
        heard, dropped = self._heard(stamp)
        unpaired += dropped
        while (indices := _complete_set(heard, self.slop_ns)) is not None:
            picked = []
            for other, index in zip(heard, indices, strict=True):
                unpaired += index
                for _ in range(index):
                    other.entries.popleft()
                entry = other.entries.popleft()
                picked.append((entry.stamp, entry.item))
            sets.append(tuple(picked))
            self._agree_on_timeline()
        if len(stream.entries) > self._depth:
            stream.entries.popleft()
            unpaired += 1
        return Paired(tuple(sets), jumped=jumped, first_to_jump=first_to_jump, unpaired=unpaired)

    def _count_silence(self, stream: _Stream[Item], stamp: int) -> None:
        """Take note of a frame of one stream in all of them."""
        for other in self._streams.values():
            if other is stream:
                other.heard()
            else:
                other.unheard(stamp)

    def _heard(self, now: int) -> tuple[list[_Stream[Item]], int]:
        """Streams of which sets are made at a stamp, and how many frames that waited for one that
        is silent from now on were given up: they are old.
        """
        heard = [stream for stream in self._streams.values() if not self._is_silent(stream, now)]
        dropped = 0
        if len(heard) < self._num_heard:
            for stream in heard:
                while stream.entries and stream.entries[0].stamp < now - self.slop_ns:
                    stream.entries.popleft()
                    dropped += 1
        self._num_heard = len(heard)
        return heard, dropped

    def _is_silent(self, stream: _Stream[Item], now: int) -> bool:
        """Whether sets are made without a stream at a stamp of another's."""
        return (
            self._timeout_ns > 0
            and stream.waiting_since is not None
            and now - stream.waiting_since > self._timeout_ns
            and stream.missed > _MISSED * (len(self._streams) - 1)
        )

    def _start_new_timeline(self, stream: _Stream[Item]) -> int:
        """Forget the camera's past, and what cameras that have not jumped yet had buffered."""
        dropped = len(stream.entries)
        stream.entries.clear()
        stream.intervals.clear()
        stream.timeline += 1
        for other in self._streams.values():
            if other.timeline < stream.timeline:
                dropped += len(other.entries)
                other.entries.clear()
        return dropped

    def _agree_on_timeline(self) -> None:
        # Frames that pair show that their cameras live in the same time.
        latest = self._latest_timeline()
        for stream in self._streams.values():
            stream.timeline = latest

    def _latest_timeline(self) -> int:
        return max(stream.timeline for stream in self._streams.values())


def _complete_set(streams: Sequence[_Stream[Item]], slop_ns: int) -> list[int] | None:
    """Index into each stream's buffer of the first set that is sure, or None.

    Frames that are passed over stay in the buffer until a later one is taken: a camera that has
    jumped back in time waits there for the others to follow.
    """
    indices = [0] * len(streams)
    while all(index < len(s.entries) for index, s in zip(indices, streams, strict=True)):
        heads = [s.entries[index] for index, s in zip(indices, streams, strict=True)]
        oldest = min(range(len(heads)), key=lambda i: heads[i].stamp)
        newest_stamp = max(head.stamp for head in heads)
        spread = newest_stamp - heads[oldest].stamp
        if spread <= slop_ns:
            period = heads[oldest].period
            if spread == 0 or period is None or 2 * spread < period:
                return indices
            following = indices[oldest] + 1
            if following == len(streams[oldest].entries):
                return None
            stamps = [head.stamp for head in heads]
            stamps[oldest] = streams[oldest].entries[following].stamp
            if max(stamps) - min(stamps) >= spread:
                return indices
        indices[oldest] += 1
    return None
