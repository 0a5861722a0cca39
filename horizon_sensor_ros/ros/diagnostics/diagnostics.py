"""What a sensor says about itself on /diagnostics, whatever it senses."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from horizon_sensor_ros.core.seconds import NANOSECONDS
from horizon_sensor_ros.ros.messages.stamps import time_from_ns

OK, WARN, ERROR, STALE = (
    DiagnosticStatus.OK,
    DiagnosticStatus.WARN,
    DiagnosticStatus.ERROR,
    DiagnosticStatus.STALE,
)
_LATENCIES = 100
_RATE_OVER_NS = 5 * NANOSECONDS  # the rate is that of estimates no older, or of the last two
# What a clock with `use_sim_time` shows before it has heard of any time.
_NO_TIME = 0
_NO_CLOCK = (
    "use_sim_time is set, but no time comes on /clock: silence, latency and rate cannot be told;"
    " play the bag with --clock, or set use_sim_time to false"
)

Pipeline = TypeVar("Pipeline")


@dataclass(frozen=True)
class Health:
    """State in a word, how bad it is, and why, for a person."""

    level: bytes
    state: str
    reason: str


class Pace:
    """Latency and rate of the last estimates; all times are given to it, in nanoseconds."""

    def __init__(self) -> None:
        self._latencies_ns: deque[int] = deque(maxlen=_LATENCIES)
        self._published_ns: deque[int] = deque(maxlen=_LATENCIES)

    def on_published(self, stamp: int, now: int) -> None:
        """Take note of an estimate that went out; none where the clock shows no time yet."""
        if now == _NO_TIME:
            return
        self._forget_later_than(now)
        self._latencies_ns.append(now - stamp)
        self._published_ns.append(now)

    def values(self, now: int) -> dict[str, str]:
        """Return what /diagnostics says of it; nothing while the clock shows no time."""
        values: dict[str, str] = {}
        if now == _NO_TIME:
            return values
        if self._latencies_ns:
            latencies_ms = np.array(self._latencies_ns) / 1e6
            values["latency_ms"] = f"{np.median(latencies_ms):.2f}"
            values["latency_max_ms"] = f"{latencies_ms.max():.2f}"
        return {**values, "rate_hz": f"{self._rate_hz(now):.2f}"}

    def _rate_hz(self, now: int) -> float:
        """Estimates a second, over the last ones; falls when they stop coming, and does not
        remember how long none had come before these.
        """
        self._forget_later_than(now)
        times = list(self._published_ns)
        # Slow ones are further apart than that: the last two tell.
        recent = [each for each in times[:-2] if now - each <= _RATE_OVER_NS] + times[-2:]
        if len(recent) < 2 or now == recent[0]:
            return 0.0
        return (len(recent) - 1) * NANOSECONDS / (now - recent[0])

    def _forget_later_than(self, now: int) -> None:
        """Begin anew where the clock was set back, as in a bag that is looped: all was before."""
        if self._published_ns and self._published_ns[-1] > now:
            self._published_ns.clear()
            self._latencies_ns.clear()


class Monitor(Generic[Pipeline]):
    """Follows a pipeline and says how it fares; all times are given to it, in nanoseconds.

    Times may be a node's clock or a bag's. With `live`, latency and rate are reported too, and that
    the clock shows no time: these depend on the machine and have no place in a replay.

    node : the node's full name. unsent : estimates that the middleware did not take.
    """

    def __init__(self, name: str, stale_after_ns: int, *, live: bool, node: str = "") -> None:
        self.name = name
        self._node = node
        self.stale_after_ns = stale_after_ns
        self._live = live
        self.unsent = 0
        self._pace = Pace()
        self._reported: tuple[bytes, str, str] | None = None

    def health(self, now: int) -> Health:
        """State at a time."""
        raise NotImplementedError

    def _reported_health(self, now: int) -> Health:
        """State at a time, and a live node's clock that shows none."""
        health = self.health(now)
        if not self._live or now != _NO_TIME:
            return health
        if health.level == OK:
            return Health(WARN, "no_clock", _NO_CLOCK)
        return Health(health.level, health.state, f"{health.reason}; {_NO_CLOCK}")

    def on_published(self, stamp: int, now: int) -> None:
        """Take note of an estimate that went out."""
        self._pace.on_published(stamp, now)

    def changed(self, now: int) -> bool:
        """Whether the state is another than in the last `message`."""
        return self._key(self._reported_health(now)) != self._reported

    def message(self, now: int, pipeline: Pipeline) -> DiagnosticArray:
        """Return the message for /diagnostics."""
        health = self._reported_health(now)
        self._reported = self._key(health)
        values = self._values(now, pipeline)
        if self._live:
            values.update(self._pace.values(now))
        if self.unsent:
            values["unsent"] = str(self.unsent)
        return diagnostic_message(self.name, self._node, health, values, now)

    def _key(self, health: Health) -> tuple[bytes, str, str]:
        """What makes a state another one."""
        raise NotImplementedError

    def _values(self, now: int, pipeline: Pipeline) -> dict[str, str]:
        """What is reported beside the state, latency and rate."""
        raise NotImplementedError


def rejected_values(rejected: Mapping[str, int]) -> dict[str, str]:
    """Return how many were rejected, in all and by cause."""
    values = {"rejected": str(sum(rejected.values()))}
    values.update({f"rejected_{cause}": str(count) for cause, count in sorted(rejected.items())})
    return values


def diagnostic_message(
    name: str, node: str, health: Health, values: Mapping[str, str], now: int
) -> DiagnosticArray:
    """Return a /diagnostics message with one status; `state` and `reason` come first.

    node : the node's full name, which tells the same nodes of two craft apart.
    """
    status = DiagnosticStatus(
        level=health.level, name=name, hardware_id=node, message=health.reason
    )
    pairs = {"state": health.state, "reason": health.reason, **values}
    status.values = [KeyValue(key=key, value=value) for key, value in pairs.items()]
    array = DiagnosticArray(status=[status])
    array.header.stamp = time_from_ns(now)
    return array
