"""The level frame and the sign of pitch, with z up and with z down."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from figures.drawing import BLUE, GREEN, ORANGE, arrow, blank, save
from horizon_sensor_ros.core.mathematics.attitude import level_from_base, nadir_from_roll_pitch

_PITCH_DEG = 20.0


def draw(folder: Path) -> None:
    """Write frames.png: a craft from its side, pitch positive, in both conventions."""
    figure, axes = blank(6.5, 4.1)
    axes.axvline(32.5, color="0.8", lw=1)
    _panel(axes, "up", 16.5, "level_z: up (default)", "base frame: forward, left, up")
    _panel(axes, "down", 48.5, "level_z: down", "base frame: forward, right, down")
    save(figure, folder / "frames.png")


def _panel(axes: Axes, level_z: str, middle: float, title: str, base: str) -> None:
    """The craft as the code turns it: what is drawn is `level_from_base`, seen from its right."""
    nadir = nadir_from_roll_pitch(0.0, np.radians(_PITCH_DEG), level_z)
    rot_level_from_base = level_from_base(nadir, level_z)
    upwards = 1.0 if level_z == "up" else -1.0

    def place(v_level: np.ndarray) -> np.ndarray:
        return np.array([v_level[0], upwards * v_level[2]])

    centre = np.array([middle, 18.5])
    nose = place(rot_level_from_base[:, 0])
    up = np.array([-nose[1], nose[0]])
    outline = [
        (-8, 0),
        (-7.2, 3.5),
        (-5.6, 1.2),
        (5, 1.2),
        (7.5, 0),
        (5, -1.2),
        (-7, -1.2),
        (-8, 0),
    ]
    corners = np.array([centre + x * nose + y * up for x, y in outline])
    axes.fill(*corners.T, facecolor="0.88", edgecolor="0.2", lw=1.3)
    axes.plot([middle - 14.5, middle + 14.5], [centre[1]] * 2, ":", color="0.6", lw=1)
    for axis, name in ((0, "x base"), (2, "z base")):
        tip = centre + 10.8 * place(rot_level_from_base[:, axis])
        arrow(axes, tuple(centre), tuple(tip), BLUE, width=2)
        outside = tip + (3.2 if axis == 0 else 1.6) * place(rot_level_from_base[:, axis])
        axes.text(*outside, name, color=BLUE, fontsize=10, ha="center", va="center")
    low = np.array([middle - 13, 3.0 if level_z == "up" else 10.5])
    for axis, name in ((0, "x level"), (2, "z level")):
        tip = low + 7 * place(np.eye(3)[axis])
        arrow(axes, tuple(low), tuple(tip), GREEN, width=2)
        side = (4.3, 0) if axis == 0 else (0, 1.6 * upwards)
        axes.text(*(tip + side), name, color=GREEN, fontsize=10, ha="center", va="center")
    arrow(axes, (middle + 13.5, 10.5), (middle + 13.5, 3.8), ORANGE, width=2)
    axes.text(middle + 13.5, 2, "nadir", color=ORANGE, fontsize=10, ha="center", va="center")
    says = "nose down" if nose[1] < 0 else "nose up"
    axes.text(middle, 38.5, title, fontsize=12, weight="bold", ha="center")
    axes.text(middle, 36, base, fontsize=10, ha="center", color="0.3")
    axes.text(middle, 32.6, f"pitch +{_PITCH_DEG:g} deg: {says}", fontsize=11, ha="center")
