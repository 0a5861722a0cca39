"""`horizon_applicability`: the field of applicability and the error map as PNG and CSV."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from tqdm import tqdm

from horizon_sensor_ros.core.camera_view import CameraView
from horizon_sensor_ros.core.error_map import bound_error, fit_error
from horizon_sensor_ros.core.fits import METHODS
from horizon_sensor_ros.core.visibility import (
    horizon_in_view,
    horizon_rays,
    rot_base_from_down,
)
from horizon_sensor_ros.tools.applicability.figure6 import Figure6, figure6
from horizon_sensor_ros.tools.applicability.figures import (
    AngleGrid,
    FrameView,
    Panel,
    draw_figure6,
    draw_maps,
)
from horizon_sensor_ros.tools.applicability.modes import draw_mounting, draw_quality
from horizon_sensor_ros.tools.applicability.mounting_angle import mountings
from horizon_sensor_ros.tools.applicability.quality_map import quality_maps
from horizon_sensor_ros.tools.applicability.table import (
    angle_columns,
    line_length,
    output_paths,
    visibility_columns,
    write_csv,
)
from horizon_sensor_ros.tools.camera_file import CameraFileError, Rig, read_camera_file

AXES = ("roll", "pitch", "yaw")
# So dense that limb points a pixel apart are samples of the horizon.
DENSE_SAMPLES = 7200
MOST_ATTITUDES = 2_000_000

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
    """Entry point of `horizon_applicability`; exit code 2 for wrong arguments or files."""
    parser = _parser()
    args = parser.parse_args(argv)
    if args.figure6 and (args.camera_file or args.error or args.cameras):
        parser.error("--figure6 has its own cameras and no error map; leave the others out")
    if args.quality and args.mounting:
        parser.error("--quality and --mounting are two questions; ask one of them")
    if (args.quality or args.mounting) and (args.figure6 or args.error or args.any):
        parser.error("--quality and --mounting have maps of their own; leave out the other modes")
    if not args.figure6 and args.camera_file is None:
        parser.error("give a camera and extrinsics file, or --figure6")
    try:
        print(_mode(args)(args))
    except (CameraFileError, ValueError) as error:
        print(f"horizon_applicability: error: {error}", file=sys.stderr)
        return 2
    except OSError as error:
        print(
            f"horizon_applicability: error: cannot write {error.filename}: {error.strerror}; "
            "choose another place with -o PREFIX",
            file=sys.stderr,
        )
        return 2
    return 0


def _mode(args: argparse.Namespace) -> Callable[[argparse.Namespace], str]:
    if args.quality:
        return _draw_quality
    if args.mounting:
        return _draw_mounting
    return _draw_figure6 if args.figure6 else _draw_field


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="horizon_applicability",
        description=DESCRIPTION,
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("camera_file", nargs="?", type=Path, help="YAML file of cameras and extrinsics")
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
        default=(-90.0, 90.0),
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
    add("--step", type=float, default=1.0, metavar="DEG", help="of the grid (default 1)")
    add(
        "--altitude",
        type=float,
        default=None,
        metavar="KM",
        help="above the surface (default: the file's; 300 for --figure6)",
    )
    add("--cameras", metavar="NAME,...", help="those to use (default: all of the file)")
    add(
        "--min-arc",
        type=float,
        default=0.0,
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
        default=0.1,
        metavar="PX",
        help="noise of a limb point, one a pixel, for the bound and with --trials (default 0.1)",
    )
    add(
        "--trials",
        type=int,
        default=0,
        metavar="N",
        help="noisy fits an attitude (default 0: one noise-free fit, which shows model error)",
    )
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
        default=0.0,
        metavar="DEG",
        help="with --mounting: the craft leans by up to this in any direction (default 0)",
    )
    add(
        "--figure6",
        action="store_true",
        help="paper A's figure 6 (half-aperture 28 deg, 3:4, 300 km), exact and as printed",
    )
    add(
        "-o",
        "--output",
        type=Path,
        metavar="PREFIX",
        help="write PREFIX.png and PREFIX.csv (default applicability, or figure6)",
    )
    return parser


def _axes(text: str) -> tuple[str, str]:
    names = [name.strip() for name in text.split(",")]
    if len(names) != 2 or len(set(names)) != 2 or not set(names) <= set(AXES):
        raise argparse.ArgumentTypeError(
            f"must be two of {', '.join(AXES)}, as yaw,pitch; got {text!r}"
        )
    return names[0], names[1]


def _grid(args: argparse.Namespace) -> AngleGrid:
    if not args.step > 0:
        raise ValueError(f"--step must be positive, got {args.step:g}")
    angles = []
    for option, limits in (("--range", args.range), ("--y-range", args.y_range or args.range)):
        low, high = limits
        if not (np.isfinite(low) and low < high <= low + 360):
            raise ValueError(f"{option} must rise by at most 360 degrees, got {low:g} {high:g}")
        angles.append(low + args.step * np.arange(int((high - low) / args.step + 1e-9) + 1))
    if angles[0].size * angles[1].size > MOST_ATTITUDES:
        raise ValueError(
            f"--step {args.step:g} makes {angles[0].size * angles[1].size} attitudes, more than "
            f"{MOST_ATTITUDES}; take a wider step or a narrower range"
        )
    axes = args.axes or (("roll", "pitch") if args.quality else ("yaw", "pitch"))
    return AngleGrid(*axes, *angles)


def _attitudes(grid: AngleGrid, nadir_at_zero: np.ndarray) -> np.ndarray:
    x_rad, y_rad = (np.radians(angle) for angle in grid.mesh_deg())
    angles = dict.fromkeys(AXES, np.zeros(x_rad.size)) | {grid.x_name: x_rad, grid.y_name: y_rad}
    return rot_base_from_down(angles["roll"], angles["pitch"], angles["yaw"], nadir_at_zero)


def _chosen(args: argparse.Namespace, rig: Rig) -> list[CameraView]:
    if args.cameras is None:
        return list(rig.views)
    views = {view.name: view for view in rig.views}
    names = [name.strip() for name in args.cameras.split(",")]
    for name in names:
        if name not in views:
            raise ValueError(
                f"--cameras: no camera {name!r} in {args.camera_file}; it has {', '.join(views)}"
            )
    return [views[name] for name in dict.fromkeys(names)]


# ------------------------------------------------------------------ field and error map


def _draw_field(args: argparse.Namespace) -> str:
    rig = read_camera_file(args.camera_file)
    grid, views = _grid(args), _chosen(args, rig)
    altitude_m = _altitude(args, rig)
    _check_noise(args)
    rays = horizon_rays(rig.planet, altitude_m, 720, rig.latitude_rad, rig.heading_rad)
    png, table = output_paths(args.output or Path("applicability"))
    attitudes = _attitudes(grid, rig.nadir_at_zero)
    seen = [
        horizon_in_view(view, rays, attitudes)
        for view in tqdm(views, desc="field", unit="camera", leave=False)
    ]
    counts = np.stack([vis.arc_px > args.min_arc for vis in seen])
    field = np.asarray(counts.any(axis=0) if args.any else counts.all(axis=0))
    cameras = views[0].name if len(views) == 1 else f"{'any' if args.any else 'all'} cameras"

    columns = angle_columns(grid)
    panels = []
    for view, vis in zip(views, seen, strict=True):
        columns |= visibility_columns(view.name, vis)
        panels.append(
            Panel(f"{view.name}: horizon in the frame", line_length(vis), "its length (px)")
        )
    columns["in_field"] = field.astype(int)
    if len(views) > 1:
        total = np.sum([vis.arc_px for vis in seen], axis=0)
        panels.append(
            Panel(f"field of {cameras}", np.where(field, total, np.nan), "length, all frames (px)")
        )
    answer = f"horizon in {cameras} at {100 * field.mean():.1f} % of {field.size} attitudes"
    if args.error is not None:
        error_deg = np.degrees(_errors_rad(args, rig, views, altitude_m, attitudes, field))
        columns["error_deg"] = error_deg
        panels.append(Panel(_error_title(args), error_deg, "nadir error (deg)", logarithmic=True))
        answer += f"; {_error_answer(args.error, error_deg[field])}"
    draw_maps(
        png,
        grid,
        panels,
        f"Field of applicability at {altitude_m / 1e3:g} km: "
        f"{100 * field.mean():.1f} % of these attitudes. Grey: no horizon, or no answer",
    )
    write_csv(table, columns)
    return f"{answer}; wrote {png} and {table}"


def _altitude(args: argparse.Namespace, rig: Rig) -> float:
    altitude_m = rig.altitude_m if args.altitude is None else 1e3 * args.altitude
    if altitude_m is None:
        raise ValueError(f"{args.camera_file}: has no altitude_km; add it, or give --altitude KM")
    if not rig.planet.limb_height_m < altitude_m < np.inf:
        raise ValueError(
            f"--altitude must be above the limb, {rig.planet.limb_height_m / 1e3:g} km, "
            f"got {altitude_m / 1e3:g}"
        )
    return altitude_m


def _check_noise(args: argparse.Namespace) -> None:
    for option, value in (("--sigma", args.sigma), ("--trials", args.trials)):
        if not (value > 0 or (value == 0 and option == "--trials")):
            raise ValueError(f"{option} must be positive, got {value:g}")


def _draw_quality(args: argparse.Namespace) -> str:
    rig = read_camera_file(args.camera_file)
    grid, views, altitude_m = _grid(args), _chosen(args, rig), _altitude(args, rig)
    _check_noise(args)
    rays = horizon_rays(rig.planet, altitude_m, 720, rig.latitude_rad, rig.heading_rad)
    attitudes = _attitudes(grid, rig.nadir_at_zero)
    files = output_paths(args.output or Path("quality"))
    maps = quality_maps(views, rays, attitudes, rig.planet, altitude_m, args.sigma)
    return draw_quality(files, grid, maps, altitude_m, args.sigma)


def _draw_mounting(args: argparse.Namespace) -> str:
    rig = read_camera_file(args.camera_file)
    views = _chosen(args, rig)
    _check_noise(args)
    low_km, high_km = args.mounting
    if not (max(0.0, rig.planet.limb_height_m / 1e3) < low_km <= high_km < 1e6):
        raise ValueError(
            "--mounting must be two altitudes above the limb in km, the lower first, "
            f"got {low_km:g} {high_km:g}"
        )
    if not 0 <= args.tilt < 45:
        raise ValueError(f"--tilt must be 0 to 45 degrees, got {args.tilt:g}")
    heights_m = (1e3 * low_km, 1e3 * high_km)
    files = output_paths(args.output or Path("mounting"))
    found = mountings(views, rig.planet, rig.nadir_at_zero, heights_m, args.sigma, args.tilt)
    return draw_mounting(files, found, views, rig.nadir_at_zero, rig.planet, args.tilt, args.sigma)


def _errors_rad(
    args: argparse.Namespace,
    rig: Rig,
    views: Sequence[CameraView],
    altitude_m: float,
    attitudes: np.ndarray,
    field: np.ndarray,
) -> np.ndarray:
    planet = rig.planet
    rays = horizon_rays(planet, altitude_m, DENSE_SAMPLES, rig.latitude_rad, rig.heading_rad)
    errors = np.full(len(attitudes), np.nan)
    bar = tqdm(np.flatnonzero(field), desc=f"error, {args.error}", unit="attitude", leave=False)
    for i in bar:
        if args.error == "bound":
            errors[i] = bound_error(views, attitudes[i], planet, altitude_m, args.sigma)
        else:
            errors[i] = fit_error(
                views,
                rays,
                attitudes[i],
                planet,
                args.error,
                sigma_px=args.sigma,
                noisy_trials=args.trials,
                seed=int(i),
            )
    return errors


def _error_title(args: argparse.Namespace) -> str:
    if args.error == "bound":
        return f"Cramér-Rao bound, {args.sigma:g} px a point"
    if args.trials:
        return f"{args.error}, RMS of {args.trials} fits, {args.sigma:g} px a point"
    return f"{args.error}, exact limb points"


def _error_answer(name: str, error_deg: np.ndarray) -> str:
    known = error_deg[np.isfinite(error_deg)]
    if known.size == 0:
        return f"no answer by {name} anywhere"
    return (
        f"nadir error by {name} {np.sqrt(np.mean(known**2)):.3g} deg RMS, "
        f"{known.max():.3g} at most, no answer at {error_deg.size - known.size} of these"
    )


# ------------------------------------------------------------------ paper A's figure 6


def _draw_figure6(args: argparse.Namespace) -> str:
    if args.axes not in (None, ("yaw", "pitch")):
        raise ValueError("--figure6 is drawn over yaw,pitch; leave out --axes")
    grid = _grid(args)
    altitude_km = 300.0 if args.altitude is None else args.altitude
    if not 0.0 < altitude_km < np.inf:
        raise ValueError(f"--altitude must be positive, got {altitude_km:g}")
    result = figure6(*grid.mesh_deg(), 1e3 * altitude_km)
    png, table = output_paths(args.output or Path("figure6"))
    yaw_deg, pitch_deg = result.maximum_deg
    circle_seen = result.circle_fraction > 0
    length = "length of the line (px)"
    panels = [
        Panel(
            "one camera, exact horizon",
            line_length(result.first),
            length,
            marks_deg=[(yaw_deg, -pitch_deg), (yaw_deg, pitch_deg)],
            label="horizon along the diagonal",
        ),
        Panel(
            "one camera, paper's section circle",
            np.where(circle_seen, result.circle_px, np.nan),
            length,
        ),
        Panel(
            "section circle minus exact",
            result.difference_px,
            "difference of length (px)",
            diverging=True,
        ),
        Panel("second camera, 90° about the long axis", line_length(result.second), length),
        Panel(
            "both cameras, exact",
            np.where(result.both, result.first.arc_px + result.second.arc_px, np.nan),
            "length of both lines (px)",
            outline=result.both_as_printed,
            label="paper: first map turned by 90°",
        ),
    ]
    frame = FrameView(
        f"the first frame at yaw {yaw_deg:.1f}°, pitch {pitch_deg:.1f}°",
        result.camera.width,
        result.camera.height,
        result.exact_px,
        result.circle_limb_px,
    )
    size = f"{result.camera.width} x {result.camera.height}"
    draw_figure6(
        png,
        grid,
        panels,
        frame,
        f"Lomaka & Ustyugov, figure 6: half-aperture 28°, 3:4 ({size}), {altitude_km:g} km. "
        "Grey: no horizon in the frame",
    )
    write_csv(
        table,
        angle_columns(grid)
        | visibility_columns("camera_1", result.first)
        | {
            "section_circle_fraction": result.circle_fraction,
            "section_circle_arc_px": result.circle_px,
        }
        | visibility_columns("camera_2", result.second)
        | {
            "in_field": result.both.astype(int),
            "in_field_as_printed": result.both_as_printed.astype(int),
        },
    )
    return f"{_figure6_answer(grid, result)}; wrote {png} and {table}"


def _figure6_answer(grid: AngleGrid, result: Figure6) -> str:
    x_deg, y_deg = grid.mesh_deg()
    top = int(np.argmax(result.first.arc_px))
    difference = result.difference_px[np.isfinite(result.difference_px)]
    if difference.size == 0:
        return "no horizon in the frame at any of these attitudes"
    yaw_deg, pitch_deg = result.maximum_deg
    verdicts = int(np.sum(result.first.visible != (result.circle_fraction > 0)))
    return (
        f"horizon in one frame at {100 * result.first.visible.mean():.1f} % of {x_deg.size} "
        f"attitudes, in both at {100 * result.both.mean():.1f} % (first map turned by 90 deg: "
        f"{100 * result.both_as_printed.mean():.1f} %); longest at yaw {x_deg[top]:g}, pitch "
        f"+-{abs(y_deg[top]):g} deg (the diagonal: {yaw_deg:.2f}, +-{pitch_deg:.2f}); section "
        f"circle: length off by {np.sqrt(np.mean(difference**2)):.1f} px RMS, "
        f"{np.abs(difference).max():.1f} at most, seen or not otherwise at {verdicts}, line off by "
        f"{result.circle_offset_px:.1f} px at most at that maximum"
    )


if __name__ == "__main__":
    sys.exit(main())
