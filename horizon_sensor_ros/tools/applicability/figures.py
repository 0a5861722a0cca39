"""Pictures of `horizon_applicability`: maps over two angles, and figure 6 of paper A."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator

from horizon_sensor_ros.tools.colours import BLUE, VERMILION

NOT_SEEN = "0.86"
EXACT_COLOUR, CIRCLE_COLOUR = BLUE, VERMILION


@dataclass(frozen=True, eq=False)
class AngleGrid:
    """Two angles in degrees, the horizontal one x and the vertical one y, by name."""

    x_name: str
    y_name: str
    x_deg: np.ndarray
    y_deg: np.ndarray

    @property
    def shape(self) -> tuple[int, int]:
        """Rows (y) and columns (x) of a map."""
        return self.y_deg.size, self.x_deg.size

    def mesh_deg(self) -> tuple[np.ndarray, np.ndarray]:
        """x and y of every attitude, flat, x running fastest."""
        x, y = np.meshgrid(self.x_deg, self.y_deg)
        return x.ravel(), y.ravel()


@dataclass(frozen=True, eq=False)
class Panel:
    """One map: values (M,) over the grid, NaN where there is nothing to show.

    outline (M,) : bool, a region whose border is drawn over the map.
    """

    title: str
    values: np.ndarray
    unit: str
    diverging: bool = False
    logarithmic: bool = False
    limits: tuple[float, float] | None = None  # of the colours; default: of the values
    marks_deg: Sequence[tuple[float, float]] = ()
    outline: np.ndarray | None = None
    label: str = ""  # of the marks or the outline


def draw_panel(axes: Axes, grid: AngleGrid, panel: Panel) -> None:
    """Draw a map with its colour bar; attitudes without a value are grey."""
    values = np.ma.masked_invalid(panel.values.reshape(grid.shape))
    norm: Normalize | None = None
    if panel.limits is not None:
        norm = LogNorm(*panel.limits) if panel.logarithmic else Normalize(*panel.limits)
    elif panel.diverging:
        limit = float(np.abs(values).max()) if values.count() else 1.0
        norm = Normalize(-limit, limit)
    elif panel.logarithmic and values.count() and values.min() > 0:
        most = np.percentile(values.compressed(), 99)
        norm = LogNorm(max(values.min(), 1e-4 * most), most)
    elif not panel.logarithmic:
        norm = Normalize(0.0, float(values.max()) if values.count() else 1.0)
    axes.set_facecolor(NOT_SEEN)
    image = axes.pcolormesh(
        grid.x_deg,
        grid.y_deg,
        values,
        cmap="PuOr" if panel.diverging else "viridis",
        norm=norm,
        shading="nearest",
        rasterized=True,
    )
    bar = axes.figure.colorbar(
        image, ax=axes, shrink=0.85, extend="both" if isinstance(norm, LogNorm) else "neither"
    )
    bar.set_label(panel.unit)
    # Marks and outlines may lie outside the map; its limits are its own cells'.
    axes.set(xlim=_limits(grid.x_deg), ylim=_limits(grid.y_deg))
    for x, y in panel.marks_deg:
        for colour, width in (("white", 3.5), (CIRCLE_COLOUR, 1.8)):
            axes.plot(x, y, "+", color=colour, markersize=10, markeredgewidth=width)
    line = Line2D([], [], color=CIRCLE_COLOUR, marker="+", linestyle="", markeredgewidth=1.8)
    if panel.outline is not None:
        region = panel.outline.reshape(grid.shape).astype(float)
        if np.ptp(region) > 0:
            axes.contour(
                grid.x_deg, grid.y_deg, region, [0.5], colors=CIRCLE_COLOUR, linewidths=1.3
            )
        line = Line2D([], [], color=CIRCLE_COLOUR, linewidth=1.3)
    if panel.label:
        axes.legend([line], [panel.label], loc="lower left", fontsize=8, framealpha=0.95)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(nbins=7, steps=[1, 1.5, 2, 3, 5, 10]))
    axes.set(
        xlabel=f"{grid.x_name} (deg)",
        ylabel=f"{grid.y_name} (deg)",
        title=panel.title,
        aspect="auto",
    )
    axes.title.set_fontsize(10)


def _limits(angles_deg: np.ndarray) -> tuple[float, float]:
    half = 0.5 * (angles_deg[1] - angles_deg[0]) if angles_deg.size > 1 else 0.5
    return float(angles_deg[0] - half), float(angles_deg[-1] + half)


def draw_maps(
    path: Path,
    grid: AngleGrid,
    panels: Sequence[Panel],
    title: str,
    columns: int | None = None,
    panel_inches: tuple[float, float] = (5.0, 4.3),
) -> None:
    """Write the panels to a PNG, two or three in a row where it is not said how many."""
    columns = columns or (2 if len(panels) in (2, 4) else min(len(panels), 3))
    rows = -(-len(panels) // columns)
    figure, grid_axes = plt.subplots(
        rows,
        columns,
        figsize=(panel_inches[0] * columns, panel_inches[1] * rows + 0.5),
        layout="constrained",
        squeeze=False,
    )
    for axes, panel in zip(grid_axes.flat, panels, strict=False):
        draw_panel(axes, grid, panel)
    for axes in grid_axes.flat[len(panels) :]:
        axes.set_visible(False)
    figure.suptitle(title, fontsize=11)
    figure.savefig(path, dpi=110)
    plt.close(figure)


@dataclass(frozen=True, eq=False)
class FrameView:
    """The horizon in one frame: exact limb (N, 2) and section circle (K, 2), pixels."""

    title: str
    width: int
    height: int
    exact_px: np.ndarray
    circle_px: np.ndarray


def draw_frame(axes: Axes, view: FrameView, exaggerate: float) -> None:
    """Draw the frame with both horizons, the circle's offset from the exact one exaggerated."""
    axes.add_patch(
        Rectangle((-0.5, -0.5), view.width, view.height, fill=False, linewidth=1.5, color="0.2")
    )
    axes.plot([-0.5, view.width - 0.5], [-0.5, view.height - 0.5], ":", color="0.6", linewidth=1)
    axes.plot([-0.5, view.width - 0.5], [view.height - 0.5, -0.5], ":", color="0.6", linewidth=1)
    axes.plot(*view.exact_px.T, color=EXACT_COLOUR, linewidth=2, label="horizon, exact")
    axes.plot(
        *(view.exact_px + exaggerate * (view.circle_px - view.exact_px)).T,
        "--",
        color=CIRCLE_COLOUR,
        linewidth=1.6,
        label=f"section circle, offset x {exaggerate:g}",
    )
    axes.set(
        xlim=(-0.06 * view.width, 1.06 * view.width),
        ylim=(1.30 * view.height, -0.06 * view.height),
        aspect="equal",
        xlabel="x (px)",
        ylabel="y (px)",
        title=view.title,
    )
    axes.title.set_fontsize(10)
    axes.legend(loc="lower center", ncols=2, fontsize=8)


def draw_figure6(
    path: Path, grid: AngleGrid, panels: Sequence[Panel], frame: FrameView, title: str
) -> None:
    """Write paper A's figure 6: five maps and the frame at a maximum."""
    figure, grid_axes = plt.subplots(2, 3, figsize=(15.0, 9.1), layout="constrained")
    for axes, panel in zip(grid_axes.flat, panels, strict=False):
        draw_panel(axes, grid, panel)
    draw_frame(grid_axes.flat[-1], frame, exaggerate=20)
    figure.suptitle(title, fontsize=11)
    figure.savefig(path, dpi=110)
    plt.close(figure)
