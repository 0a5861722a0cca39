"""Standard output and error that cannot end a command's work: closed, full, or with no reader."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from horizon_sensor_ros.ros.process.closed_streams import open_closed_streams, write_to_nothing


class StandardStream:
    """A stream to whose end one may write whatever happens.

    error : why something could not be written, None while all was; what follows is dropped.
    """

    def __init__(self, stream: Any) -> None:
        self._stream = stream
        self.error: OSError | None = None

    def write(self, text: str) -> int:
        """Write a text; return its length. Letters that the stream's encoding lacks are written as
        Python's standard error has them, by number.
        """
        try:
            self._attempt(self._stream.write, text)
        except UnicodeEncodeError as error:
            spelt = text.encode(error.encoding, "backslashreplace").decode(error.encoding)
            self._attempt(self._stream.write, spelt)
        return len(text)

    def flush(self) -> None:
        """Write what is held back."""
        self._attempt(self._stream.flush)

    def _attempt(self, do: Any, *arguments: str) -> None:
        try:
            do(*arguments)
        except OSError as error:
            self.error = self.error or error
            with suppress(OSError, ValueError):
                write_to_nothing(self._stream.fileno())

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


@contextmanager
def lasting_streams() -> Iterator[StandardStream]:
    """Let nothing that is printed in the block raise; yield standard output, whose `error` tells.

    Closed streams are opened on nothing: a file of the command's would get their number, and with
    it what libraries write there.
    """
    open_closed_streams()
    before = sys.stdout, sys.stderr
    # Python has None for a stream that was closed when it started.
    opened = [open(os.devnull, "w", encoding="utf-8") for each in before if each is None]  # noqa: SIM115
    spare = iter(opened)
    output, errors = (StandardStream(next(spare) if each is None else each) for each in before)
    sys.stdout, sys.stderr = output, errors  # type: ignore[assignment]
    try:
        yield output
    finally:
        output.flush()
        errors.flush()
        sys.stdout, sys.stderr = before
        for each in opened:
            each.close()
