"""A node's state in its log: what `ros2 run` shows to who does not look at /diagnostics."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node

from horizon_sensor_ros.ros.diagnostics.diagnostics import ERROR, OK
from horizon_sensor_ros.ros.messages.message_types import type_name
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

    def on_report(self, status: DiagnosticStatus, unheard: Callable[[], str]) -> None:
        """Take note of a report, and write its state where that is news.

        unheard : returns why topics are not heard, as `why_unheard`; a change of it is news.
        """
        state = _state(status)
        line = "; ".join([f"now {state}: {status.message}", *_of_no_avail(status)])
        why = unheard() if state in _WANTING else ""
        if why:
            line += f"; {why}"
        key = (*_key(status), why)
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


def why_unheard(node: Node, sources: Mapping[str, type]) -> str:
    """Which topics of a node nobody publishes, or only as another type, as far as it knows; empty
    where all are published.

    sources : types of the topics, by their names in the code.
    """
    missing, others = [], []
    for name, kind in sources.items():
        topic = node.resolve_topic_name(name)
        wanted = type_name(kind)
        types = {info.topic_type for info in node.get_publishers_info_by_topic(name)}
        if not types:
            compressed = node.count_publishers(f"{topic}/compressed")
            missing.append(f"{topic} (only compressed)" if compressed else topic)
        elif wanted not in types:
            others.append(f"{topic} is {', '.join(sorted(types))}, not {wanted}")
    nobody = [f"nobody publishes {', '.join(missing)}"] if missing else []
    return "; ".join([*nobody, *others])


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
