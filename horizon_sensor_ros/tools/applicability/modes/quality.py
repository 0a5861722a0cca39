"""`--quality`: the share of the horizon seen and the expected sigma, by camera and for all."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from horizon_sensor_ros.tools.applicability.arguments import (
    altitude_of,
    angle_grid,
    attitudes_of,
    check_noise,
    chosen_views,
    horizon_of,
)
from horizon_sensor_ros.tools.applicability.expected_sigma import USABLE_DEG
from horizon_sensor_ros.tools.applicability.figures import AngleGrid, Panel, draw_maps
from horizon_sensor_ros.tools.applicability.quality_map import Quality, quality_maps
from horizon_sensor_ros.tools.applicability.table import angle_columns, output_paths, write_csv
from horizon_sensor_ros.tools.camera_file import read_camera_file
from horizon_sensor_ros.tools.output_files import written_whole


def draw_quality(args: argparse.Namespace) -> str:
    """Write the maps and their table; return the answer."""
    rig = read_camera_file(args.camera_file)
    grid, views, altitude_m = angle_grid(args), chosen_views(args, rig), altitude_of(args, rig)
    check_noise(args)
    rays = horizon_of(rig, altitude_m)
    attitudes = attitudes_of(grid, rig.nadir_at_zero)
    files = output_paths(args.output or Path("quality"))
    maps = quality_maps(views, rays, attitudes, rig.planet, altitude_m, args.sigma)
    return _draw_maps(files, grid, maps, altitude_m, args.sigma)


def _draw_maps(
    files: tuple[Path, Path],
    grid: AngleGrid,
    maps: Mapping[str, Quality],
    altitude_m: float,
    sigma_px: float,
) -> str:
    png, table = files
    columns = angle_columns(grid)
    sigmas = {name: np.degrees(quality.sigma_rad) for name, quality in maps.items()}
    usable = {name: np.where(s <= USABLE_DEG, s, np.nan) for name, s in sigmas.items()}
    known = np.concatenate([s[np.isfinite(s)] for s in usable.values()])
    limits = (known.min(), max(known.max(), 1.01 * known.min())) if known.size else (1e-3, 1.0)
    panels = []
    most = max(100.0 * quality.share.max() for quality in maps.values()) or 1.0
    for name, quality in maps.items():
        seen = np.where(quality.share > 0, 100.0 * quality.share, np.nan)
        panels.append(
            Panel(f"{name}: horizon seen", seen, "share of the horizon (%)", limits=(0.0, most))
        )
        panels.append(
            Panel(
                f"{name}: expected sigma",
                usable[name],
                "nadir, one sigma (deg)",
                logarithmic=True,
                limits=limits,
            )
        )
        key = name.replace(" ", "_")
        columns |= {f"{key}_share": quality.share, f"{key}_sigma_deg": sigmas[name]}
    with written_whole(png, table) as (picture, rows):
        draw_maps(
            picture,
            grid,
            panels,
            f"At {altitude_m / 1e3:g} km, {sigma_px:g} px of error in each pixel of limb.\n"
            f"Grey: no horizon, or sigma above {USABLE_DEG:g} deg",
            columns=2,
            panel_inches=(3.7, 3.1),
        )
        write_csv(rows, columns)
    said = "; ".join(
        f"{name} {100 * np.isfinite(s).mean():.0f} %"
        + (f" (median sigma {np.nanmedian(s):.2g} deg)" if np.isfinite(s).any() else "")
        for name, s in usable.items()
    )
    return (
        f"sigma below {USABLE_DEG:g} deg at these shares of {len(columns[next(iter(columns))])} "
        f"attitudes: {said}; wrote {png} and {table}"
    )
