"""`horizon_applicability`: the field of applicability and the error map as PNG and CSV."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from horizon_sensor_ros.tools.applicability.idle_options import DEFAULTS, idle_option
from horizon_sensor_ros.tools.command import fill_defaults, run_computation
from horizon_sensor_ros.tools.command_errors import CommandError

DESCRIPTION = """\
Field of applicability: at which attitudes the horizon is in the frames of the cameras, and how
much of it; with --error, also the nadir error to be expected there. With --quality: the share of
the horizon that each camera sees, and the sigma to be expected of it alone and of all together.
With --mounting: how far below the horizontal the cameras should look. The horizon is exact (sphere
or ellipsoid), the frame is that of the real camera, distortion included. Attitudes are
Rz(yaw) Ry(pitch) Rx(roll) from the zero attitude of the file. After Lomaka & Ustyugov, and the
vertical builder of Izv. vuzov. Priborostroenie 59(6), 2016."""

EPILOG = """\
examples:
  horizon_applicability config/applicability_example.yaml
  horizon_applicability config/applicability_example.yaml --range -50 50 --step 2 --error arc
  horizon_applicability rig.yaml --axes roll,pitch --altitude 500 --error bound --sigma 0.2 -o rig
  horizon_applicability rig.yaml --quality --altitude 500 --range -40 40 --step 2 -o quality
  horizon_applicability rig.yaml --mounting 300 1200 --tilt 5 -o mounting
  horizon_applicability --figure6

The CSV has one row an attitude: the angles; for each camera the fraction of the horizon's azimuth
in the frame, the length of its line and of its longest arc in pixels, and the number of arcs;
whether the attitude is in the field; and the error (empty where there is none). With --quality: the
angles, and for each camera and for all the share and the sigma; with --mounting: angle, altitude
and sigma. Sigma is one of nadir in its least certain direction, from the Fisher information of the
limb in the frames, with --sigma px of error in each pixel of limb (0.02 is a sharp, even limb, 0.3
one with clouds)."""


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point of `horizon_applicability`; exit code 2 for wrong arguments, 1 for files that
    cannot be read or written.
    """
    return run_computation("horizon_applicability", lambda: _run(argv))


def _run(argv: Sequence[str] | None) -> int:
    parser = _parser()
    args = parser.parse_args(argv)
    mistake = idle_option(args)
    if mistake:
        parser.error(mistake)
    if args.figure6 and args.camera_file:
        parser.error("--figure6 has its own cameras; leave out the camera file")
    if not args.figure6 and args.camera_file is None:
        parser.error("give a camera and extrinsics file, or --figure6")
    fill_defaults(args, DEFAULTS)
    from horizon_sensor_ros.tools.camera_file import CameraFileError  # noqa: PLC0415 - takes time

    try:
        print(_mode(args)(args))
    except CommandError as error:
        told = f"{error}; choose another place with -o PREFIX"
        print(f"horizon_applicability: error: {told}", file=sys.stderr)
        return 1
    except ValueError as error:
        print(f"horizon_applicability: error: {error}", file=sys.stderr)
        return 1 if isinstance(error, CameraFileError) else 2
    return 0


def _mode(args: argparse.Namespace) -> Callable[[argparse.Namespace], str]:
    # Loaded here, as all that takes time: a signal is taken care of by now.
    if args.quality:
        from horizon_sensor_ros.tools.applicability.modes.quality import draw_quality  # noqa: PLC0415

        return draw_quality
    if args.mounting:
        from horizon_sensor_ros.tools.applicability.modes.mounting import draw_mounting  # noqa: PLC0415

        return draw_mounting
    if args.figure6:
        from horizon_sensor_ros.tools.applicability.modes.paper_figure import draw_paper_figure  # noqa: PLC0415 # fmt: skip

        return draw_paper_figure
    from horizon_sensor_ros.tools.applicability.modes.field import draw_field  # noqa: PLC0415

    return draw_field


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="horizon_applicability",
        description=DESCRIPTION,
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "camera_file", nargs="?", type=Path, help="YAML file of cameras and extrinsics"
    )
    parser.add_argument(
        "-o",
        "--output",
        type=_prefix,
        metavar="PREFIX",
        help="write PREFIX.png and PREFIX.csv, in place of what has these names (default: quality, "
        "mounting or figure6, as the option is called; applicability without one)",
    )
    _add_map(parser.add_argument_group("where, and with which cameras").add_argument)
    _add_field(parser.add_argument_group("the field and the error in it").add_argument)
    _add_questions(parser.add_argument_group("other questions").add_argument)
    return parser


def _add_map(add: Callable[..., argparse.Action]) -> None:
    add(
        "--axes",
        type=_axes,
        default=None,
        metavar="X,Y",
        help="two of roll, pitch, yaw: across and up the map, the third is 0 (default yaw,pitch; "
        "roll,pitch with --quality)",
    )
    add(
        "--range",
        type=float,
        nargs=2,
        metavar=("MIN", "MAX"),
        help="of both angles, degrees (default -90 90)",
    )
    add(
        "--y-range",
        type=float,
        nargs=2,
        default=None,
        metavar=("MIN", "MAX"),
        help="of the second angle, where it differs",
    )
    add("--step", type=float, metavar="DEG", help="of the grid (default 1)")
    add(
        "--altitude",
        type=float,
        default=None,
        metavar="KM",
        help="above the surface (default: the file's; 300 for --figure6)",
    )
    add("--cameras", metavar="NAME,...", help="those to use (default: all of the file)")


def _add_field(add: Callable[..., argparse.Action]) -> None:
    from horizon_sensor_ros.core.fits import METHODS  # noqa: PLC0415 - takes time

    add(
        "--min-arc",
        type=float,
        metavar="PX",
        help="a camera counts where it sees more than this length of the horizon (default 0)",
    )
    add(
        "--any",
        action="store_true",
        help="the field is where any camera counts (default: where all do)",
    )
    add(
        "--error",
        choices=("bound", *METHODS),
        help="map the nadir error: the Cramer-Rao bound, or a method's on exact limb points",
    )
    add(
        "--sigma",
        type=float,
        metavar="PX",
        help="noise of a limb point, one a pixel, for the bound and with --trials (default 0.1)",
    )
    add(
        "--trials",
        type=int,
        metavar="N",
        help="noisy fits an attitude (default 0: one noise-free fit, which shows model error)",
    )


def _add_questions(add: Callable[..., argparse.Action]) -> None:
    add(
        "--quality",
        action="store_true",
        help="map the share of the horizon seen and the expected sigma, by camera and for all",
    )
    add(
        "--mounting",
        type=float,
        nargs=2,
        metavar=("MIN", "MAX"),
        help="best angle of the cameras below the horizontal for altitudes from MIN to MAX, km",
    )
    add(
        "--tilt",
        type=float,
        metavar="DEG",
        help="with --mounting: the craft leans by up to this in any direction (default 0)",
    )
    add(
        "--figure6",
        action="store_true",
        help="paper A's figure 6 (half-aperture 28 deg, 3:4, 300 km), exact and as printed",
    )


def _prefix(text: str) -> Path:
    path = Path(text)
    if text.endswith("/") or path.name in ("", ".."):
        raise argparse.ArgumentTypeError(
            f"must end in a name, to which .png and .csv are added, got {text!r}"
        )
    return path


def _axes(text: str) -> tuple[str, str]:
    from horizon_sensor_ros.tools.applicability.arguments import AXES  # noqa: PLC0415 - takes time

    names = [name.strip() for name in text.split(",")]
    if len(names) != 2 or len(set(names)) != 2 or not set(names) <= set(AXES):
        raise argparse.ArgumentTypeError(
            f"must be two of {', '.join(AXES)}, as in 'yaw,pitch', got {text!r}"
        )
    return names[0], names[1]


if __name__ == "__main__":
    sys.exit(main())
