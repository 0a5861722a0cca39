"""The field of applicability, and with `--error` the nadir error to be expected in it."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from tqdm import tqdm

from horizon_sensor_ros.core.applicability.error_map import bound_error, fit_error
from horizon_sensor_ros.core.applicability.visibility import horizon_in_view
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.tools.applicability.arguments import (
    altitude_of,
    angle_grid,
    attitudes_of,
    check_noise,
    chosen_views,
    horizon_of,
)
from horizon_sensor_ros.tools.applicability.figures import Panel, draw_maps
from horizon_sensor_ros.tools.applicability.table import (
    angle_columns,
    line_length,
    output_paths,
    visibility_columns,
    write_csv,
)
from horizon_sensor_ros.tools.camera_file import Rig, read_camera_file
from horizon_sensor_ros.tools.output_files import written_whole

# So dense that limb points a pixel apart are samples of the horizon.
_DENSE_SAMPLES = 7200


def draw_field(args: argparse.Namespace) -> str:
    """Write maps and table of the field, and of the error with --error; return the answer."""
    rig = read_camera_file(args.camera_file)
    grid, views = angle_grid(args), chosen_views(args, rig)
    altitude_m = altitude_of(args, rig)
    check_noise(args)
    rays = horizon_of(rig, altitude_m)
    png, table = output_paths(args.output or Path("applicability"))
    attitudes = attitudes_of(grid, rig.nadir_at_zero)
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
    with written_whole(png, table) as (picture, rows):
        draw_maps(
            picture,
            grid,
            panels,
            f"Field of applicability at {altitude_m / 1e3:g} km: "
            f"{100 * field.mean():.1f} % of these attitudes. Grey: no horizon, or no answer",
        )
        write_csv(rows, columns)
    return f"{answer}; wrote {png} and {table}"


def _errors_rad(
    args: argparse.Namespace,
    rig: Rig,
    views: Sequence[CameraView],
    altitude_m: float,
    attitudes: np.ndarray,
    field: np.ndarray,
) -> np.ndarray:
    planet = rig.planet
    rays = horizon_of(rig, altitude_m, _DENSE_SAMPLES)
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
