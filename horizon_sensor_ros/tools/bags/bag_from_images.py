"""`horizon_bag_from_images`: folders of images or of point clouds to a bag, without ROS."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from horizon_sensor_ros.tools.bags.frame_files import UNITS_NS
from horizon_sensor_ros.tools.command import fill_defaults, run_command

DESCRIPTION = """\
Make a rosbag2 of one's own frames: a folder of images for each camera, a folder of point clouds, or
both. The camera file says how each camera sees and how it is mounted; it is that of
horizon_applicability (config/applicability_example.yaml). Beside the bag goes a parameter file with
the mountings, for horizon_replay --params."""

EPILOG = """\
examples:
  horizon_bag_from_images flight --camera-file rig.yaml --images camera_1=left \\
      --images camera_2=right --rate 10
  horizon_replay flight out --params flight.params.yaml
  horizon_bag_to_csv out tables

  horizon_bag_from_images flight --camera-file rig.yaml --images mav0/cam0/data \\
      --stamps mav0/cam0/data.csv --stamp-unit ns
  horizon_bag_from_images target --clouds scans --stamps-in-names

Frames go by the numbers in their names (9.png before 10.png). Stamps: by --rate, from --stamps
FILE (a line a frame: the stamp, then perhaps the frame's name; # begins a comment), or the last
number in each name. Cameras that belong together need stamps that differ by no more than the nodes'
slop (20 ms). Images are .png, .jpg, .bmp, .tif, .pgm and the like, 8 bit gray or colour or 16 bit;
clouds are .pcd, .ply, .npy, .xyz, .txt or .csv, in metres, in the sensor's frame."""

# Of options that show, by having none until then, whether they were given.
_DEFAULTS = {"rate": 10.0, "start": 1.0, "stamp_unit": "s", "cloud_frame": "tof"}


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="horizon_bag_from_images",
        description=DESCRIPTION,
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("out_bag", metavar="OUT_BAG", type=Path, help="directory to be made")
    add("--camera-file", metavar="FILE", type=Path, help="YAML file of cameras and extrinsics")
    add(
        "--images",
        metavar="CAMERA=FOLDER",
        action="append",
        default=[],
        help="images of a camera of the file, again for each; FOLDER alone where it has one camera",
    )
    add("--clouds", metavar="FOLDER", type=Path, help="point clouds, for topic target/points")
    add("--cloud-frame", metavar="NAME", help="frame of the clouds (default tof)")
    stamps = parser.add_mutually_exclusive_group()
    stamps.add_argument("--rate", metavar="HZ", type=float, help="frames a second (default 10)")
    stamps.add_argument("--stamps", metavar="FILE", type=Path, help="stamps of the frames")
    stamps.add_argument(
        "--stamps-in-names", action="store_true", help="the last number in each file's name"
    )
    add(
        "--stamp-unit",
        choices=tuple(UNITS_NS),
        help="what --stamps or the names count in (default s)",
    )
    add(
        "--start",
        metavar="S",
        type=float,
        help="stamp of the first frame, with --rate (default 1)",
    )
    add("--storage", choices=["mcap", "sqlite3"], default="mcap", help="default: mcap")
    add("--force", action="store_true", help="replace OUT_BAG and its parameter file if they exist")
    return parser


def _refuse_idle(parser: argparse.ArgumentParser, arguments: argparse.Namespace) -> None:
    """End with a usage error where an option was given that counts with another one alone."""
    stamped = bool(arguments.stamps or arguments.stamps_in_names)
    if arguments.stamp_unit is not None and not stamped:
        parser.error("--stamp-unit has no effect without --stamps or --stamps-in-names")
    if arguments.start is not None and stamped:
        other = "--stamps" if arguments.stamps else "--stamps-in-names"
        parser.error(f"--start has no effect with {other}, which tells all stamps")
    if arguments.cloud_frame is not None and not arguments.clouds:
        parser.error("--cloud-frame has no effect without --clouds")
    if arguments.camera_file and not arguments.images:
        parser.error("--camera-file has no effect without --images")


def main(argv: Sequence[str] | None = None) -> int:
    """Run `horizon_bag_from_images`; return the exit code."""
    parser = _parser()
    arguments = parser.parse_args(argv)
    if not (arguments.images or arguments.clouds):
        parser.error("give --images CAMERA=FOLDER, or --clouds FOLDER")
    if arguments.images and not arguments.camera_file:
        parser.error("--images needs --camera-file FILE: how the cameras see and are mounted")
    _refuse_idle(parser, arguments)
    fill_defaults(arguments, _DEFAULTS)
    if not (math.isfinite(arguments.rate) and 1e-6 <= arguments.rate <= 1e6):
        parser.error(f"--rate must be 1e-6 to 1e6 frames a second, got {arguments.rate:g}")
    if not 0 <= arguments.start < 2**31:
        parser.error(f"--start must be 0 to 2^31 seconds, got {arguments.start:g}")

    def work(stopped: Callable[[], bool]) -> str:
        from horizon_sensor_ros.tools.bags.frame_recording import record  # noqa: PLC0415

        return record(arguments, stopped)

    return run_command("horizon_bag_from_images", work)


if __name__ == "__main__":
    sys.exit(main())
