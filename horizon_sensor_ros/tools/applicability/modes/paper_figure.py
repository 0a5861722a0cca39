"""`--figure6`: paper A's figure 6, exact and as printed."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from horizon_sensor_ros.tools.applicability.arguments import angle_grid
from horizon_sensor_ros.tools.applicability.figure6 import Figure6, figure6
from horizon_sensor_ros.tools.applicability.figures import AngleGrid, FrameView, Panel, draw_figure6
from horizon_sensor_ros.tools.applicability.table import (
    angle_columns,
    line_length,
    output_paths,
    visibility_columns,
    write_csv,
)
from horizon_sensor_ros.tools.output_files import written_whole


def draw_paper_figure(args: argparse.Namespace) -> str:
    """Write the maps and their table; return the answer."""
    if args.axes not in (None, ("yaw", "pitch")):
        raise ValueError("--figure6 is drawn over yaw,pitch; leave out --axes")
    grid = angle_grid(args)
    altitude_km = 300.0 if args.altitude is None else args.altitude
    if not 0.0 < altitude_km < np.inf:
        raise ValueError(f"--altitude must be positive, got {altitude_km:g}")
    result = figure6(*grid.mesh_deg(), 1e3 * altitude_km)
    png, table = output_paths(args.output or Path("figure6"))
    camera = result.camera
    with written_whole(png, table) as (picture, rows):
        draw_figure6(
            picture,
            grid,
            _panels(result),
            _frame(result),
            "Lomaka & Ustyugov, figure 6: half-aperture 28°, 3:4 "
            f"({camera.width} x {camera.height}), {altitude_km:g} km. "
            "Grey: no horizon in the frame",
        )
        write_csv(rows, _columns(grid, result))
    return f"{_answer(grid, result)}; wrote {png} and {table}"


def _panels(result: Figure6) -> list[Panel]:
    yaw_deg, pitch_deg = result.maximum_deg
    circle_seen = result.circle_fraction > 0
    length = "length of the line (px)"
    return [
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


def _frame(result: Figure6) -> FrameView:
    yaw_deg, pitch_deg = result.maximum_deg
    return FrameView(
        f"the first frame at yaw {yaw_deg:.1f}°, pitch {pitch_deg:.1f}°",
        result.camera.width,
        result.camera.height,
        result.exact_px,
        result.circle_limb_px,
    )


def _columns(grid: AngleGrid, result: Figure6) -> dict[str, np.ndarray]:
    return (
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
        }
    )


def _answer(grid: AngleGrid, result: Figure6) -> str:
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
