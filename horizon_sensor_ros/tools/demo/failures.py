"""Why a demo has failed, in words for a person."""

from __future__ import annotations

from horizon_sensor_ros.tools.command_errors import CommandError


class NodeFailedError(CommandError):
    """A node did not start, ended early or badly; the message ends with what it last said."""


class LinkTimeoutError(CommandError):
    """Nodes did not come up or did not connect in time."""


class NoAnswerError(CommandError):
    """The nodes ran but published nothing."""
