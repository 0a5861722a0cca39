"""What the commands that write files have in common: signals, errors for a person, exit codes.

Light: it is loaded before everything that takes time, so that a signal is taken care of by then.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from threading import Event
from types import FrameType
from typing import Any

from horizon_sensor_ros.tools.command_errors import CommandError
from horizon_sensor_ros.tools.output_files import remove_unfinished
from horizon_sensor_ros.tools.standard_streams import StandardStream, lasting_streams

_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_INTERRUPTED = 130  # exit code, as of a shell's command that SIGINT ended


def run_command(name: str, work: Callable[[Callable[[], bool]], str]) -> int:
    """Run a command's work, print its answer on stderr, and return the exit code.

    work : takes a function that says whether to stop; it then raises KeyboardInterrupt, leaving
    nothing behind. A CommandError is printed after the command's name, and says the exit code. What
    cannot be printed is lost without ending the work.
    """
    # Before numpy is loaded: for matrices as small as ours more threads only wait for each other.
    # And with another number of them sums come out in another order, and bags with other bytes.
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    # A signal is looked at between two messages: raised just anywhere, the exception may get lost.
    stop = Event()
    previous = [signal.signal(number, lambda *_: stop.set()) for number in _SIGNALS]
    try:
        with lasting_streams() as output:
            try:
                print(work(stop.is_set), file=sys.stderr)
            except KeyboardInterrupt:
                print(f"{name}: interrupted, nothing written", file=sys.stderr)
                return _INTERRUPTED
            except CommandError as error:
                print(f"{name}: {error}", file=sys.stderr)
                return error.exit_code
            return _all_printed(name, output)
    finally:
        for number, handler in zip(_SIGNALS, previous, strict=True):
            signal.signal(number, handler)


def run_computation(name: str, work: Callable[[], int]) -> int:
    """Run a command's work, and return the exit code; a signal ends the process at once, with 130,
    wherever it is.
    """

    def end(_number: int, _frame: FrameType | None) -> None:
        # Raised just anywhere an exception may get lost: in modules that are being loaded it comes
        # out as a failure to load them.
        start = "\r\x1b[K" if os.isatty(2) else "\n"  # of a line on which a progress bar may be
        with suppress(OSError):
            os.write(2, f"{start}{name}: interrupted\n".encode())
        remove_unfinished()
        os._exit(_INTERRUPTED)

    previous = [signal.signal(number, end) for number in _SIGNALS]
    try:
        with lasting_streams() as output:
            return work() or _all_printed(name, output)
    finally:
        for number, handler in zip(_SIGNALS, previous, strict=True):
            signal.signal(number, handler)


class Once(argparse.Action):
    """Stores an option that may be given but once: a node merges several parameter files, and here
    all but the last would be dropped without a word.
    """

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,
        option_string: str | None = None,
    ) -> None:
        """Store the value; an error where there is one already."""
        if getattr(namespace, self.dest) is not None:
            raise argparse.ArgumentError(self, "is there twice, and only one is read; join them")
        setattr(namespace, self.dest, values)


def is_given(arguments: argparse.Namespace, option: str) -> bool:
    """Whether an option, "--one-of-these", that has no default of its own was given."""
    return getattr(arguments, option.removeprefix("--").replace("-", "_")) not in (None, False)


def fill_defaults(arguments: argparse.Namespace, defaults: Mapping[str, Any]) -> None:
    """Give the options that were not given their defaults: of those that have none until then, so
    that it shows whether they were.
    """
    for name, value in defaults.items():
        if getattr(arguments, name) is None:
            setattr(arguments, name, value)


def _all_printed(name: str, output: StandardStream) -> int:
    """Return the exit code of a command whose work is done: 1 where not all could be printed."""
    output.flush()
    # Who closes a pipe, as `head`, has read enough.
    if output.error is None or isinstance(output.error, BrokenPipeError):
        return 0
    why = output.error.strerror
    print(f"{name}: cannot write to the standard output: {why}", file=sys.stderr)
    return 1
