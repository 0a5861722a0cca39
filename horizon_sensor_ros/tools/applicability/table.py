"""What the modes of `horizon_applicability` share: where they write, and their tables."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from horizon_sensor_ros.core.applicability.visibility import Visibility
from horizon_sensor_ros.tools.applicability.figures import AngleGrid
from horizon_sensor_ros.tools.output_files import check_place


def output_paths(prefix: Path) -> tuple[Path, Path]:
    """Paths of the PNG and the CSV; CommandError where they cannot be written."""
    png, table = (prefix.with_name(prefix.name + suffix) for suffix in (".png", ".csv"))
    for path in (png, table):
        check_place(path)
    return png, table


def line_length(vis: Visibility) -> np.ndarray:
    """Length of the horizon's line, NaN where there is none."""
    return np.where(vis.visible, vis.arc_px, np.nan)


def angle_columns(grid: AngleGrid) -> dict[str, np.ndarray]:
    """Columns of the two angles."""
    x_deg, y_deg = grid.mesh_deg()
    return {f"{grid.x_name}_deg": x_deg, f"{grid.y_name}_deg": y_deg}


def visibility_columns(name: str, vis: Visibility) -> dict[str, np.ndarray]:
    """Columns of what one camera sees."""
    return {
        f"{name}_fraction": vis.fraction,
        f"{name}_arc_px": vis.arc_px,
        f"{name}_longest_px": vis.longest_px,
        f"{name}_arcs": vis.num_arcs,
    }


def write_csv(path: Path, columns: dict[str, np.ndarray]) -> None:
    """Write columns of one length; what is not finite stays empty."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        for row in zip(*columns.values(), strict=True):
            writer.writerow([f"{value:.7g}" if np.isfinite(value) else "" for value in row])
