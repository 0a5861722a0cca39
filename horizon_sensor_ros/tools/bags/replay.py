"""`horizon_replay`: a bag in, the nodes' topics in a bag out, with the nodes' own pipeline."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from horizon_sensor_ros.tools.command import Once, run_command

EPILOG = """\
examples:
  horizon_replay flight.mcap out --params my_cameras.yaml
  horizon_replay flight out --params my_cameras.yaml \\
      --remap camera_1/image_raw:=/left/image --remap camera_1/camera_info:=/left/info

OUT_BAG has the estimates with the stamps of their images, and /diagnostics, which says why there
was none. Parameters are the nodes'; config/params.yaml has them all."""


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="horizon_replay",
        description="Run the nodes' algorithms over a rosbag2 and write what they would publish.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("in_bag", metavar="IN_BAG", type=Path, help="directory, .mcap or .db3")
    parser.add_argument("out_bag", metavar="OUT_BAG", type=Path, help="directory to be made")
    parser.add_argument(
        "--params", metavar="FILE", type=Path, action=Once, help="ROS parameter file"
    )
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

    def work(stopped: Callable[[], bool]) -> str:
        from horizon_sensor_ros.tools.bags.bag_replay import replay  # noqa: PLC0415

        return replay(arguments, stopped)

    return run_command("horizon_replay", work)


if __name__ == "__main__":
    sys.exit(main())
