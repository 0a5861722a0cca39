"""Work that the end of the process need not wait for.

A hard frame may take longer to process than a process may take to end. What comes of it is not
published any more, so the signal breaks it off; anything else, such as publishing, is finished.
The exception ends in the callback whose frame it is: an executor would print it as an error.
Light: it is loaded before everything that takes time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

Result = TypeVar("Result")


class Interrupted(BaseException):
    """The process is to end; no error, and for nobody to catch but who began the work."""


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

    def result_of(self, work: Callable[[], Result]) -> Result | None:
        """Return what comes of breakable work; None where it was broken off, or not begun."""
        try:
            with self.breakable():
                return work()
        except Interrupted:
            return None


END = Interruption()
