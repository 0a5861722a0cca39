"""The picture of a self-calibration: the cameras' nadirs against each other, before and after."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")
import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.backend_bases import FigureCanvasBase

from horizon_sensor_ros.core.self_calibration.differences import (
    NadirDifference,
    nadir_differences,
)
from horizon_sensor_ros.core.self_calibration.result import Calibration
from horizon_sensor_ros.tools.colours import BLUE, VERMILION
from horizon_sensor_ros.tools.command_errors import CommandError, UsageError, in_one_line

_BEFORE: dict[str, Any] = {"color": VERMILION, "marker": "x", "label": "before"}
_AFTER: dict[str, Any] = {"color": BLUE, "marker": "o", "label": "after"}


def check_picture(path: Path) -> None:
    """UsageError where the name is not that of a kind of picture."""
    kinds = FigureCanvasBase.get_supported_filetypes()
    if path.suffix.removeprefix(".").lower() not in kinds:
        raise UsageError(f"--picture: {path} must end in one of .{', .'.join(sorted(kinds))}")


def draw_calibration(
    path: Path, calibration: Calibration, nominal: Mapping[str, np.ndarray]
) -> None:
    """Draw, for each camera, the turn between its nadir and the first one's.

    Left over time, right about the two base axes that lie most across nadir. CommandError where it
    cannot be drawn, OSError where it cannot be written.
    """
    before = nadir_differences(calibration.sets, nominal)
    after = nadir_differences(calibration.sets, calibration.rot_base_from_cam)
    middle = np.abs(calibration.nadir_base.mean(axis=0))
    axes_shown = tuple(sorted(np.argsort(middle)[:2].tolist()))
    times = np.array([s.time_s for s in calibration.sets])
    figure, panels = plt.subplots(
        len(before), 2, figsize=(10, 3.6 * len(before)), squeeze=False, layout="constrained"
    )
    for (left, right), one, other in zip(panels, before, after, strict=True):
        _over_time(left, times, one, other)
        _about_axes(right, axes_shown, one, other)
    try:
        figure.savefig(path, dpi=110)
    except ValueError as error:
        raise CommandError(f"cannot draw {path.name}: {in_one_line(error)}") from None
    finally:
        plt.close(figure)


def _over_time(
    axes: Axes, times_s: np.ndarray, before: NadirDifference, after: NadirDifference
) -> None:
    for difference, style in ((before, _BEFORE), (after, _AFTER)):
        angle = np.degrees(np.linalg.norm(difference.turn_rad, axis=1))
        axes.plot(times_s[difference.index], angle, linestyle="", markersize=4, **style)
    axes.set(
        title=f"Nadir of {before.name}", xlabel="time since the first frame (s)",
        ylabel="angle between them (deg)", ylim=(0, None),
    )  # fmt: skip
    axes.legend()
    axes.grid(alpha=0.3)


def _about_axes(
    axes: Axes, shown: tuple[int, ...], before: NadirDifference, after: NadirDifference
) -> None:
    first, second = shown
    for difference, style in ((before, _BEFORE), (after, _AFTER)):
        turn = np.degrees(difference.turn_rad)
        axes.plot(turn[:, first], turn[:, second], linestyle="", markersize=4, **style)
    axes.axhline(0.0, color="0.5", linewidth=0.8)
    axes.axvline(0.0, color="0.5", linewidth=0.8)
    axes.set(
        title="the same, about two base axes",
        xlabel=f"about {'xyz'[first]} (deg)",
        ylabel=f"about {'xyz'[second]} (deg)",
    )
    axes.set_aspect("equal", adjustable="datalim")
    axes.grid(alpha=0.3)
