"""A node's state in its log: what `ros2 run` shows to who does not look at /diagnostics."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node

from horizon_sensor_ros.ros.diagnostics.diagnostics import ERROR, OK
from horizon_sensor_ros.ros.pipelines.aiding_sources import OF_NO_AVAIL

# Their reasons change with what each frame shows: the state alone makes them news.
_BY_FRAME = ("ok", "degraded", "no_fix", "new_target_frame")
# Nothing comes in, or not from all.
_WANTING = ("waiting", "stale", "silent")
_NUMBER = re.compile(r"\d[\d.]*")


class StateLog:
    """Writes a line for a state that was not the last one written and is there in two reports
    running: a state that comes and goes fills no disk.
    """

    def __init__(self, logger: Any) -> None:
        self._logger = logger
        self._written: tuple[str, ...] | None = None
        self._last: tuple[str, ...] | None = None

    def on_report(self, status: DiagnosticStatus, missing: Callable[[], Sequence[str]]) -> None:
        """Take note of a report, and write its state where that is news.

        missing : returns the topics that nobody publishes; a change of them is news.
        """
        state = _state(status)
        line = "; ".join([f"now {state}: {status.message}", *_of_no_avail(status)])
        topics = ", ".join(missing()) if state in _WANTING else ""
        if topics:
            line += f"; nobody publishes {topics}"
        key = (*_key(status), topics)
        lasts, self._last = key == self._last, key
        if not lasts or key == self._written:
            return
        self._written = key
        # A call for each level: rclpy takes but one from a line of code.
        if status.level == OK:
            self._logger.info(line)
        elif status.level == ERROR:
            self._logger.error(line)
        else:
            self._logger.warning(line)


def unpublished(node: Node, topics: Sequence[str]) -> list[str]:
    """Return full names of those topics of a node that nobody publishes, as far as it knows."""
    missing = []
    for topic in map(node.resolve_topic_name, topics):
        if not node.count_publishers(topic):
            compressed = node.count_publishers(f"{topic}/compressed")
            missing.append(f"{topic} (only compressed)" if compressed else topic)
    return missing


def _state(status: DiagnosticStatus) -> str:
    return next(pair.value for pair in status.values if pair.key == "state")


def _of_no_avail(status: DiagnosticStatus) -> list[str]:
    """Topics that help, whose messages are refused or of another time, and why; all else may be
    well.
    """
    return [
        f"{pair.key} {pair.value}" for pair in status.values if pair.value.startswith(OF_NO_AVAIL)
    ]


def _key(status: DiagnosticStatus) -> tuple[str, ...]:
    state = _state(status)
    words = [] if state in _BY_FRAME else [status.message]
    return state, *(_NUMBER.sub("", each) for each in (*words, *_of_no_avail(status)))
