"""`horizon_replay`: a bag in, the nodes' topics in a bag out, with the nodes' own pipeline."""

from __future__ import annotations

import argparse
import os
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from threading import Event


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="horizon_replay",
        description="Run the nodes' algorithms over a rosbag2 and write what they would publish.",
    )
    parser.add_argument("in_bag", metavar="IN_BAG", type=Path, help="directory, .mcap or .db3")
    parser.add_argument("out_bag", metavar="OUT_BAG", type=Path, help="directory to be made")
    parser.add_argument("--params", metavar="FILE", type=Path, help="ROS parameter file")
    parser.add_argument("--namespace", default="/", help="the nodes' namespace")
    parser.add_argument(
        "--remap", metavar="FROM:=TO", action="append", default=[], help="other name for a topic"
    )
    parser.add_argument("--storage", choices=["mcap", "sqlite3"], help="default: as IN_BAG")
    parser.add_argument("--force", action="store_true", help="replace OUT_BAG if it exists")
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run `horizon_replay`; return the exit code."""
    arguments = _parser().parse_args(argv)
    # Before numpy is loaded: for matrices as small as ours more threads only wait for each other.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # A signal is looked at between two messages: raised just anywhere, the exception may get lost.
    stop = Event()
    signals = (signal.SIGINT, signal.SIGTERM)
    previous = [signal.signal(number, lambda *_: stop.set()) for number in signals]
    from horizon_sensor_ros.tools.bag_replay import ReplayError, replay  # noqa: PLC0415

    try:
        print(replay(arguments, stop.is_set), file=sys.stderr)
    except KeyboardInterrupt:
        print("horizon_replay: interrupted, nothing written", file=sys.stderr)
        return 130
    except ReplayError as error:
        print(f"horizon_replay: {error}", file=sys.stderr)
        return 1
    finally:
        for number, handler in zip(signals, previous, strict=True):
            signal.signal(number, handler)
    return 0


if __name__ == "__main__":
    sys.exit(main())
