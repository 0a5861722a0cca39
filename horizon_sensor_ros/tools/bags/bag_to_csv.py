"""`horizon_bag_to_csv`: the results in a bag as tables, one file a topic."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from horizon_sensor_ros.tools.command import run_command

DESCRIPTION = """\
Write what a bag holds of estimates, diagnostics and references (poses, twists, vectors,
quaternions, IMU) as CSV, one file a topic."""

EPILOG = """\
examples:
  horizon_bag_to_csv out tables
  horizon_bag_to_csv flight.mcap tables --topics /attitude /imu

/attitude becomes attitude.csv. The first line has the columns' names with their units: stamp_s is
the message's stamp in seconds, exact to the nanosecond; x_m, qx to qw and cov_... are its own
values; roll_deg, pitch_deg, yaw_deg are taken from the quaternion, Rz(yaw) Ry(pitch) Rx(roll).
Covariances are the upper triangle: cov_rot_x_rot_y_rad2. Frames and signs: doc/conventions.md."""


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="horizon_bag_to_csv",
        description=DESCRIPTION,
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("bag", metavar="BAG", type=Path, help="directory, .mcap or .db3")
    add("out_dir", metavar="OUT_DIR", type=Path, help="directory for the tables")
    add("--topics", metavar="TOPIC", nargs="+", help="only these (default: all that can be tables)")
    add("--force", action="store_true", help="replace tables that exist")
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run `horizon_bag_to_csv`; return the exit code."""
    arguments = _parser().parse_args(argv)

    def work(stopped: Callable[[], bool]) -> str:
        from horizon_sensor_ros.tools.bags.bag_tables import write_tables  # noqa: PLC0415

        return write_tables(arguments, stopped)

    return run_command("horizon_bag_to_csv", work)


if __name__ == "__main__":
    sys.exit(main())
