"""What the figures share: colours, boxes, arrows, and how a figure is saved.

Figures are 6.5 inches wide with letters of 10 points or more: readable on a phone.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

# Okabe and Ito's colours, which colour-blind readers tell apart.
BLUE, ORANGE, GREEN = "#0072B2", "#D55E00", "#009E73"
SKY = "#56B4E9"
GREY = "0.45"


def blank(width: float, height: float, title: str = "") -> tuple[Figure, Axes]:
    """Return a figure without axes, in units of tenths of an inch, y upwards."""
    figure, axes = plt.subplots(figsize=(width, height))
    axes.set(xlim=(0, 10 * width), ylim=(0, 10 * height), aspect="equal")
    axes.axis("off")
    axes.set_position((0, 0, 1, 1))
    if title:
        axes.text(1, 10 * height - 2.5, title, fontsize=12, weight="bold")
    return figure, axes


def box(
    axes: Axes,
    corner: tuple[float, float],
    size: tuple[float, float],
    text: str,
    colour: str = "white",
    fontsize: float = 10,
) -> None:
    """Draw a box with text in its middle; the first line is bold where there are several."""
    axes.add_patch(
        FancyBboxPatch(
            corner, *size, "round,pad=0,rounding_size=0.8", facecolor=colour, edgecolor="0.25"
        )
    )
    x, y = corner[0] + size[0] / 2, corner[1] + size[1] / 2
    first, _, rest = text.partition("\n")
    lines = rest.count("\n") + 1 if rest else 0
    step = fontsize / 72 * 12.5
    axes.text(
        x,
        y + lines * step / 2,
        first,
        ha="center",
        va="center",
        fontsize=fontsize,
        weight="bold" if rest else "normal",
    )
    if rest:
        axes.text(
            x, y - step / 2, rest, ha="center", va="center", fontsize=fontsize - 1, linespacing=1.25
        )


def arrow(
    axes: Axes,
    start: tuple[float, float],
    end: tuple[float, float],
    colour: str = "0.25",
    bend: float = 0.0,
    width: float = 1.4,
) -> None:
    """Draw an arrow; bend is the height of its arc over its length."""
    axes.add_patch(
        FancyArrowPatch(
            start,
            end,
            arrowstyle="-|>",
            mutation_scale=13,
            color=colour,
            linewidth=width,
            connectionstyle=f"arc3,rad={bend}",
            shrinkA=0,
            shrinkB=0,
        )
    )


def arc(
    axes: Axes,
    centre: tuple[float, float],
    radius: float,
    start_deg: float,
    end_deg: float,
    colour: str,
) -> None:
    """Draw an arc of a circle, degrees from x counter-clockwise."""
    angle = np.radians(np.linspace(start_deg, end_deg, 60))
    axes.plot(
        centre[0] + radius * np.cos(angle), centre[1] + radius * np.sin(angle), color=colour, lw=1.6
    )


def save(figure: Figure, path: Path) -> None:
    """Write a PNG whose bytes depend on what is drawn alone."""
    figure.savefig(path, dpi=200, metadata={"Software": None})
    plt.close(figure)
