"""`horizon_report`: what a bag tells of the sensor, as one page that needs nothing else."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from horizon_sensor_ros.tools.command import Once, run_command
from horizon_sensor_ros.tools.command_errors import CommandError, UsageError
from horizon_sensor_ros.tools.output_files import check_place

EPILOG = """\
examples:
  horizon_report out --input flight.mcap --params my_cameras.yaml
  horizon_report bench_day --imu imu/data --out bench.html

BAG has the nodes' answers: recorded live, or made by horizon_replay. With the frames (in BAG or
--input) and --params the page also shows why frames were refused and whether the cameras agree.
Topics of truth (truth/local_vertical, truth/attitude, truth/target/pose), where present, give
errors; an IMU at rest on the ground gives paper B's bench comparison."""


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="horizon_report",
        description="Write one self-contained HTML page about a replayed or recorded bag.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("bag", metavar="BAG", type=Path, help="directory, .mcap or .db3, with the answers")
    add("--input", metavar="BAG", type=Path, action=Once, help="bag with the frames and clouds")
    add(
        "--out",
        metavar="FILE",
        type=Path,
        default=Path("report.html"),
        help="the page (default report.html)",
    )
    add("--params", metavar="FILE", type=Path, action=Once, help="ROS parameter file of the nodes")
    add("--imu", metavar="TOPIC", help="accelerometer to compare with (default: imu, if there)")
    add("--title", help="heading of the page")
    add("--force", action="store_true", help="replace FILE if it exists")
    add("--namespace", default="/", help="the nodes' namespace")
    add("--remap", metavar="FROM:=TO", action="append", default=[], help="other name for a topic")
    return parser


def write_report(bags: Sequence[Path], path: Path, **options: Any) -> None:
    """Write the page about what is in one or more bags.

    Where two bags have the same topic the first one's counts. options : params, namespace,
    remappings, imu_topic, title, stopped; see `report.page.write_page`. Raises CommandError, saying
    why there is no page.
    """
    from horizon_sensor_ros.tools.report.page import write_page  # noqa: PLC0415

    write_page(bags, path, **options)


def _check_kind(path: Path) -> None:
    """UsageError where the name says that the page is anything but HTML."""
    if path.suffix.lower() not in ("", ".html", ".htm"):
        page = path.with_suffix(".html")
        raise UsageError(f"--out: {path}: the page is HTML; name it {page}, print it from there")


def main(argv: Sequence[str] | None = None) -> int:
    """Run `horizon_report`; return the exit code."""
    arguments = _parser().parse_args(argv)

    def work(stopped: Callable[[], bool]) -> str:
        out: Path = arguments.out
        _check_kind(out)
        if out.exists() and not arguments.force:
            raise CommandError(f"{out} exists; choose another with --out, or --force to replace it")
        check_place(out)
        bags = [arguments.bag] if arguments.input is None else [arguments.bag, arguments.input]
        write_report(
            bags,
            out,
            params=arguments.params,
            namespace=arguments.namespace,
            remappings=arguments.remap,
            imu_topic=arguments.imu,
            title=arguments.title,
            stopped=stopped,
        )
        return f"written: {out}"

    return run_command("horizon_report", work)


if __name__ == "__main__":
    sys.exit(main())
