"""The horizon of a sphere: all its rays form a cone about nadir."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.patches import Circle
from matplotlib.path import Path as Outline

from figures.drawing import BLUE, GREEN, ORANGE, arc, arrow, blank, save

_RADIUS, _CENTRE, _CRAFT = 17.0, (18.0, 20.0), (50.0, 20.0)
_ARROW = 12.0


def draw(folder: Path) -> None:
    """Write geometry.png: craft, planet, nadir, a limb ray, and the angle between them."""
    figure, axes = blank(6.5, 4.0)
    (cx, cy), (x, y) = _CENTRE, _CRAFT
    rho = np.arcsin(_RADIUS / (x - cx))
    axes.add_patch(Circle(_CENTRE, _RADIUS, facecolor="#DCEBF5", edgecolor=BLUE, linewidth=1.6))
    for sign in (1, -1):
        tangent = (cx + _RADIUS * np.sin(rho), cy + sign * _RADIUS * np.cos(rho))
        beyond = (x - 36 * np.cos(rho), y + sign * 36 * np.sin(rho))
        axes.plot([x, beyond[0]], [y, beyond[1]], ":", color=ORANGE, lw=1.2)
        axes.plot([x, tangent[0]], [y, tangent[1]], color=ORANGE, lw=1.6)
        axes.plot(*tangent, "o", color=ORANGE, markersize=6)
    tangent = (cx + _RADIUS * np.sin(rho), cy + _RADIUS * np.cos(rho))
    axes.plot([cx, tangent[0]], [cy, tangent[1]], color=BLUE, lw=1.2)
    corner = [_along(tangent, _CENTRE, 2), None, _along(tangent, _CRAFT, 2)]
    corner[1] = (corner[0][0] + corner[2][0] - tangent[0], corner[0][1] + corner[2][1] - tangent[1])
    axes.plot(*zip(*corner, strict=True), color="0.3", lw=1)
    # As far as the arrow to nadir, which goes on from there.
    axes.plot([cx, x - _ARROW], [cy, y], "--", color="0.5", lw=1)
    arrow(axes, _CRAFT, (x - _ARROW, y), GREEN, width=2.4)
    arrow(axes, _CRAFT, (x - _ARROW * np.cos(rho), y + _ARROW * np.sin(rho)), ORANGE, width=2.4)
    arc(axes, _CRAFT, 7.5, 180 - np.degrees(rho), 180, "0.2")
    axes.plot(*_CRAFT, marker=_satellite(), color="0.15", markersize=24)
    label = {"fontsize": 13, "ha": "center", "va": "center"}
    axes.text(x - 9.6, y + 2.3, r"$\rho$", **label)
    axes.text(x - 9.8, y - 2.3, r"nadir $\mathbf{n}$", color=GREEN, **label)
    axes.text(
        x - 7.5, y + 9.8, r"$\mathbf{u}$, a ray to the limb", color=ORANGE, **label | {"ha": "left"}
    )
    axes.text(cx + 2.8, cy + 8.6, "$R$", color=BLUE, **label)
    axes.text(cx - 7, cy - 4, "planet", color=BLUE, **label)
    axes.text(cx + _RADIUS / 2, cy - 2.3, "$R$", color="0.3", **label)
    axes.text(cx + _RADIUS + 1.8, cy + 2.2, "$H$", color="0.3", **label)
    axes.text(40, 5.2, r"$\sin\rho = \frac{R}{R+H}$", fontsize=17)
    axes.text(40, 1.2, r"$\mathbf{u}\cdot\mathbf{n} = \cos\rho$", fontsize=15)
    save(figure, folder / "geometry.png")


def _along(start: tuple[float, float], end: tuple[float, float], by: float) -> tuple[float, float]:
    direction = np.subtract(end, start) / np.hypot(*np.subtract(end, start))
    return float(start[0] + by * direction[0]), float(start[1] + by * direction[1])


def _satellite() -> Outline:
    """A body between two panels."""
    rectangles = [(-0.22, -0.25, 0.22, 0.25), (-0.16, 0.32, 0.16, 1.0), (-0.16, -1.0, 0.16, -0.32)]
    corners, codes = [], []
    for left, low, right, high in rectangles:
        corners += [(left, low), (right, low), (right, high), (left, high), (left, low)]
        codes += [Outline.MOVETO, *[Outline.LINETO] * 3, Outline.CLOSEPOLY]
    return Outline(corners, codes)
