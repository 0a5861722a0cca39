"""`horizon_self_calibration`: how the cameras are mounted, from what they saw of the horizon."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from horizon_sensor_ros.tools.command import Once, fill_defaults, is_given, run_command

EPILOG = """\
examples:
  horizon_self_calibration flight.mcap --params my_cameras.yaml --out corrected.yaml
  horizon_self_calibration lunar_flight --params lunar.yaml --altitude coarse_pose --drift
  horizon_self_calibration flight --params my_cameras.yaml --reference imu/data --picture fit.png
  horizon_self_calibration flight --params one_camera.yaml --lenses --out told.yaml

The misalignment printed is a rotation vector in the base frame: corrected rotation = exp(vector)
times the rotation in FILE. What the recording cannot tell is named and left as it is. A good
recording turns the craft by 10 deg or more about two axes; see doc/self_calibration.md."""

# As of the nodes' parameter altitude_prior, whose table takes time to load.
_MAX_ALTITUDE_M = 1e12
# Sigmas of an altitude (m) and a reference (deg), and the largest one (deg) of what is told.
_DEFAULTS = {"altitude_sigma": 100.0, "reference_sigma": 0.05, "max_sigma": 0.1}
# What tells nothing of how lenses blur.
_OF_MOUNTINGS = ("--altitude", "--reference", "--drift", "--focal", "--max-sigma", "--picture")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="horizon_self_calibration",
        description="Find how the cameras are mounted from a recording of the horizon.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("in_bag", metavar="IN_BAG", type=Path, help="directory, .mcap or .db3")
    add(
        "--params",
        metavar="FILE",
        type=Path,
        action=Once,
        help="ROS parameter file with the rotations",
    )
    add("--out", metavar="FILE", type=Path, help="write FILE again with corrected rotations")
    add("--picture", metavar="FILE", type=Path, help="the cameras' nadirs before and after (png)")
    add("--force", action="store_true", help="replace these files if they exist")
    add(
        "--altitude",
        metavar="M|TOPIC",
        type=_altitude,
        help="known altitude, or a topic of poses that tell it",
    )
    add("--altitude-sigma", metavar="M", type=float, help="default 100")
    add("--reference", metavar="TOPIC", help="nadir or attitude from elsewhere: frees all cameras")
    add("--reference-sigma", metavar="DEG", type=float, help="default 0.05")
    add("--drift", action="store_true", help="misalignments may grow linearly in time")
    add("--focal", action="store_true", help="focal lengths may be wrong too")
    add(
        "--lenses",
        action="store_true",
        help="only how much lenses blur in the corners: one camera will do",
    )
    add(
        "--max-sigma",
        metavar="DEG",
        type=float,
        help="a turn less certain than this stays as it is (default 0.1)",
    )
    add(
        "--correlation",
        metavar="S",
        type=float,
        default=20.0,
        help="time over which clouds and air at the limb stay alike (default 20)",
    )
    add("--interval", metavar="S", type=float, default=0.0, help="use one frame set in so long")
    add("--namespace", default="/", help="the nodes' namespace")
    add("--remap", metavar="FROM:=TO", action="append", default=[], help="other name for a topic")
    return parser


def _altitude(text: str) -> str:
    """Return a number that can be an altitude, or the name of a topic, as they are given."""
    try:
        number = float(text)
    except ValueError:
        return text
    # Written so that NaN fails.
    if not 0.0 <= number <= _MAX_ALTITUDE_M:
        raise argparse.ArgumentTypeError(f"must be 0 to {_MAX_ALTITUDE_M:g} m, got {text}")
    return text


def parsed(argv: Sequence[str] | None = None) -> argparse.Namespace:
    """Return what the command line says; a usage error ends the process."""
    parser = _parser()
    arguments = parser.parse_args(argv)
    for option in ("--altitude", "--reference"):
        if is_given(arguments, f"{option}-sigma") and not is_given(arguments, option):
            parser.error(f"{option}-sigma has no effect without {option}")
    for option in _OF_MOUNTINGS:
        if arguments.lenses and is_given(arguments, option):
            parser.error(f"{option} has no effect with --lenses")
    files = [path.resolve() for path in (arguments.out, arguments.picture) if path is not None]
    if len(files) > len(set(files)):
        parser.error("--out and --picture are the same file")
    fill_defaults(arguments, _DEFAULTS)
    return arguments


def main(argv: Sequence[str] | None = None) -> int:
    """Run `horizon_self_calibration`; return the exit code."""
    arguments = parsed(argv)

    def work(stopped: Callable[[], bool]) -> str:
        from horizon_sensor_ros.tools.calibration.bag_calibration import calibrate_bag  # noqa: PLC0415

        return calibrate_bag(arguments, stopped)

    return run_command("horizon_self_calibration", work)


if __name__ == "__main__":
    sys.exit(main())
