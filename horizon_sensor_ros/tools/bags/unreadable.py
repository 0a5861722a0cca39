"""A bag's messages that cannot be read, counted for a person."""

from __future__ import annotations

from collections import defaultdict

from horizon_sensor_ros.tools.bags.replay_tally import MOST_REASONS
from horizon_sensor_ros.tools.reasons import ReasonCounts


class Unreadable:
    """How many of which topic, and why."""

    def __init__(self) -> None:
        self._why: defaultdict[str, ReasonCounts] = defaultdict(ReasonCounts)

    def add(self, topic: str, why: str, times: int = 1) -> None:
        """Count messages of a topic."""
        self._why[topic].add(why, times)

    def lines(self) -> list[str]:
        """What a person is told; nothing where all were read."""
        lines = []
        for topic, why in sorted(self._why.items()):
            lines.append(f"unreadable messages skipped on {topic}: {why.total}")
            lines += [f"  {line}" for line in why.lines(MOST_REASONS)]
        return lines
