"""Work that the end of the process need not wait for.

A hard frame may take longer to process than a process may take to end. What comes of it is not
published any more, so the signal breaks it off; anything else, such as publishing, is finished.
Light: it is loaded before everything that takes time.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


class Interrupted(BaseException):
    """The process is to end; no error, and for nobody to catch but what runs the nodes."""


class Interruption:
    """Whether the process is to end. asked_for : it is."""

    def __init__(self) -> None:
        self.asked_for = False
        self._breakable = False

    def ask(self) -> None:
        """Called in the main thread, by a signal: raises Interrupted out of breakable work."""
        self.asked_for = True
        if self._breakable:
            self._breakable = False
            raise Interrupted

    @contextmanager
    def breakable(self) -> Iterator[None]:
        """Work of the main thread that may be broken off, and is not begun once it is asked for."""
        if self.asked_for:
            raise Interrupted
        self._breakable = True
        try:
            yield
        finally:
            self._breakable = False


END = Interruption()
