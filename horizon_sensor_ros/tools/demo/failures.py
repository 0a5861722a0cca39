"""Why a demo has failed, in words for a person."""

from __future__ import annotations


class DemoError(RuntimeError):
    """The demo could not be flown to its end."""


class NodeFailedError(DemoError):
    """A node did not start, ended early or badly; the message ends with what it last said."""


class LinkTimeoutError(DemoError):
    """Nodes did not come up or did not connect in time."""


class NoAnswerError(DemoError):
    """The nodes ran but published nothing."""
