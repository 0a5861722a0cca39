"""The command `horizon_demo`: what it is told, its signals, what it says when it fails.

Light: it is loaded before everything that takes time, so that a signal is taken care of by then.
"""

from __future__ import annotations

import argparse
import math
import os
import signal
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from types import FrameType

from horizon_sensor_ros.tools.command_errors import CommandError, in_one_line
from horizon_sensor_ros.tools.standard_streams import lasting_streams

_MOST_SETS = 100_000  # of frames and a cloud: more make a bag of 100 GB and more


def main(argv: Sequence[str] | None = None) -> int:
    """Command line entry point; returns the exit code."""
    parser = _parser()
    options = parser.parse_args(argv)
    if not options.seconds * options.rate <= _MOST_SETS:
        parser.error(
            f"--seconds {options.seconds:g} at --rate {options.rate:g} are more than {_MOST_SETS} "
            "image pairs: make the flight shorter, or the rate lower"
        )
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, _end_at_once)
    with lasting_streams():
        return _run(options)


def _run(options: argparse.Namespace) -> int:
    try:
        # Takes time, and an exception raised just anywhere in it would come out as another one.
        from horizon_sensor_ros.tools.demo.flight_past_nodes import (  # noqa: PLC0415
            fly_past_nodes,
        )

        signal.signal(signal.SIGINT, signal.default_int_handler)
        for number in (signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, _exit)
        fly_past_nodes(options)
    except CommandError as failure:
        print(f"horizon_demo: {failure}", file=sys.stderr)
        return 1
    except OSError as failure:
        # A full disk, a directory that is none.
        why = failure.strerror or in_one_line(failure)
        print(
            f"horizon_demo: cannot write to {options.output}: {why}; choose another directory with "
            "--output",
            file=sys.stderr,
        )
        return 1
    except KeyboardInterrupt:
        print("horizon_demo: interrupted", file=sys.stderr)
        return 130
    return 0


def _end_at_once(number: int, _frame: FrameType | None) -> None:
    """Nothing is under way yet."""
    with suppress(OSError):
        os.write(2, b"horizon_demo: interrupted\n")
    os._exit(128 + number)


def _exit(number: int, _frame: FrameType | None) -> None:
    # As an exception, so that the nodes and the workers are ended on the way out.
    raise SystemExit(128 + number)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="horizon_demo",
        description="Fly a simulated orbit past the real nodes, each in its own process, and "
        "compare what they publish with the truth. Leaves the flight as a bag with the truth "
        "in it, and the page that horizon_report makes of that bag.",
        epilog="Example: horizon_demo --seconds 60 --output /tmp/flight",
    )
    add = parser.add_argument
    add("--seconds", type=_positive, default=20.0, help="length of the flight (default 20)")
    add(
        "--rate",
        type=_positive,
        default=5.0,
        help="image pairs and clouds a second, fewer where drawing takes longer (default 5)",
    )
    add("--seed", type=_seed, default=0, help="of the noise, a whole number (default 0)")
    add(
        "--output",
        type=Path,
        default=Path("demo_output"),
        help="directory of the report (report.html), the bag (demo), the nodes' parameters "
        "(params.yaml) and logs (default demo_output); what is there under these names is "
        "overwritten, the bag only where it is one that this package wrote",
    )
    return parser


def _positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"must be a positive number, got {text}")
    return value


def _seed(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"must be a whole number, not negative, got {text}")
    return int(text)
