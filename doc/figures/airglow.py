"""The night's airglow as a second limb: where it is found, and what one camera gains by it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt

from figures.drawing import BLUE, ORANGE, SKY, save
from horizon_sensor_ros.core.figure import disc_of
from horizon_sensor_ros.core.horizon_sensor import Frame, HorizonFix, HorizonSensor
from horizon_sensor_ros.core.limb_curve import limb_curve
from horizon_sensor_ros.sim.hard_scenes import hard_scenes

_SCENES, _SEED, _SHOWN = 60, 12, 3
_DIMMEST, _BRIGHTEST = 0.0, 110.0  # gray levels from black to white
_ROWS = 420, 60  # of the frame that are drawn, bottom and top


def draw(folder: Path) -> None:
    """Write airglow.png: a frame with both limbs, and errors by the ground's alone and by both."""
    figure, (above, errors) = plt.subplots(2, 1, figsize=(6.5, 8.2), layout="constrained")
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
    above.imshow(shown.gray, cmap="gray", vmin=_DIMMEST, vmax=_BRIGHTEST)
    for cone, color, label in (
        (_cone_of_ground(fix), ORANGE, "the ground's limb"),
        (_cone_of_airglow(fix), SKY, "the airglow's upper edge"),
    ):
        x, y = limb_curve(shown.view, *cone).px.T
        above.plot(x, y, color=color, lw=1.2, label=label)
    above.set(ylim=_ROWS)
    above.axis("off")
    above.legend(fontsize=10, loc="upper right")
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


def _cone_of_ground(fix: HorizonFix) -> tuple[np.ndarray, float]:
    disc = disc_of(fix.fit)
    return disc.nadir, disc.rho_rad


def _cone_of_airglow(fix: HorizonFix) -> tuple[np.ndarray, float]:
    assert fix.airglow is not None
    return fix.airglow.nadir_base, fix.airglow.rho_rad
