"""The night's airglow as a second limb, and as the only one: where it is found, and what one camera
gains by it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from figures.drawing import BLUE, ORANGE, SKY, save
from horizon_sensor_ros.core.horizon.fix import Frame, HorizonFix
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.limb_curve import limb_curve
from horizon_sensor_ros.core.planet_figure import disc_of
from horizon_sensor_ros.sim.hard_scenes import hard_scenes

_SCENES, _SEED, _SHOWN, _DARK = 60, 12, 3, 6
_DIMMEST, _BRIGHTEST = 0.0, 110.0  # gray levels from black to white
_ROWS = 420, 60  # of the frame that are drawn, bottom and top
_EDGE = "the airglow's upper edge"


def draw(folder: Path) -> None:
    """Write airglow.png: a frame with both limbs and one with nothing but the layer, and errors by
    the ground's alone and by both.
    """
    figure, axes = plt.subplots(
        3, 1, figsize=(6.5, 11.2), height_ratios=(1.0, 1.0, 1.25), layout="constrained"
    )
    above, dark, errors = axes
    off, seen = [], []
    for scene in hard_scenes(_SCENES, _SEED, ("moonlit",)):
        for view, frame in zip(scene.views, scene.frames, strict=True):
            shown = Frame(view, frame.image)
            fix = HorizonSensor().process([shown])
            if fix.airglow is not None and not fix.airglow_alone:
                nadirs = np.array([disc_of(fix.fit).nadir, fix.fit.nadir_base])
                apart = np.linalg.norm(nadirs - frame.truth.nadir_base, axis=1)
                off.append(np.degrees(apart))
                seen.append((shown, fix))
    shown, fix = seen[_SHOWN]
    ground_cone = disc_of(fix.fit).nadir, disc_of(fix.fit).rho_rad
    _draw_frame(above, shown, {"the ground's limb": (ground_cone, ORANGE), _EDGE: _cone_of(fix)})
    shown, fix = _without_ground()
    _draw_frame(dark, shown, {f"{_EDGE} alone": _cone_of(fix)})
    ground, both = np.array(off).T
    errors.loglog(ground, both, "o", ms=4, color=BLUE, alpha=0.75)
    equal = np.array([3e-3, 3.0])
    errors.loglog(equal, equal, color="0.4", lw=1.0, label="no gain")
    for values, line in ((ground, errors.axvline), (both, errors.axhline)):
        line(float(np.median(values)), color=ORANGE, lw=1.0, ls="--")
    errors.plot([], [], "--", color=ORANGE, lw=1.0, label="medians")
    errors.set(
        xlabel="error of nadir by the ground's limb alone (deg)",
        ylabel="by both limbs (deg)",
        xlim=equal,
        ylim=equal,
    )
    errors.grid(color="0.92")
    errors.legend(fontsize=10, title=f"one camera, {len(off)} fixes")
    save(figure, folder / "airglow.png")


def _draw_frame(
    axes: Axes, frame: Frame, limbs: dict[str, tuple[tuple[np.ndarray, float], str]]
) -> None:
    axes.imshow(frame.gray, cmap="gray", vmin=_DIMMEST, vmax=_BRIGHTEST)
    for label, (cone, color) in limbs.items():
        x, y = limb_curve(frame.view, *cone).px.T
        axes.plot(x, y, color=color, lw=1.2, label=label)
    axes.set(ylim=_ROWS)
    axes.axis("off")
    axes.legend(fontsize=10, loc="upper right")


def _without_ground() -> tuple[Frame, HorizonFix]:
    """A frame in which nothing but the layer shows, and its fix."""
    found = []
    for scene in hard_scenes(_SCENES, _SEED, ("airglow",)):
        for view, frame in zip(scene.views, scene.frames, strict=True):
            shown = Frame(view, frame.image)
            fix = HorizonSensor().process([shown])
            if fix.airglow_alone:
                found.append((shown, fix))
            if len(found) > _DARK:
                return found[_DARK]
    raise AssertionError("hardly a scene is fixed by its airglow alone")


def _cone_of(fix: HorizonFix) -> tuple[tuple[np.ndarray, float], str]:
    assert fix.airglow is not None
    return (fix.airglow.nadir_base, fix.airglow.rho_rad), SKY
