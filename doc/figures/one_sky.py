"""What frames under glowing air tell together: by itself each takes glow and blur for its limb."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt

from figures.drawing import BLUE, ORANGE, save
from horizon_sensor_ros.core.fits.limb_rays import rays_of
from horizon_sensor_ros.core.horizon.fix import Frame
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.limb.glow.points import GlowPoints, points_alone
from horizon_sensor_ros.sim.hard_scenes import hard_scenes

_KINDS, _SCENES, _SEED = ("air", "boom", "lens", "moon"), 80, 8
_MOST_PX = 0.7
_STEPS = np.array([-1.0, 1.0])


def draw(folder: Path) -> None:
    """Write one_sky.png: errors of limbs' slopes and heights beside those of glow and blur."""
    alone, together = _measured()
    figure, panels = plt.subplots(2, 1, figsize=(6.5, 8.0), layout="constrained")
    columns = (
        ("limb's slope", "slope of the log of the glow along it, as found (true: 0)", 0, 2),
        ("limb's height", "blur, as found (px; true: 0.70)", 1, 3),
    )
    for axes, (of_what, beside, y, x) in zip(panels, columns, strict=True):
        series = (alone, BLUE, "each frame by itself"), (together, ORANGE, "both frames together")
        for rows, color, label in series:
            rms_px = float(np.sqrt(np.mean(np.square(rows[:, y] - np.mean(rows[:, y])))))
            axes.plot(
                alone[:, x],
                rows[:, y],
                "o",
                ms=4,
                color=color,
                alpha=0.75,
                label=f"{label}: scatter {rms_px:.2f} px",
            )
        axes.set(xlabel=beside, ylabel=f"error of the {of_what} (px)", ylim=_MOST_PX * _STEPS)
        axes.grid(color="0.92")
        axes.legend(fontsize=10, loc="upper right")  # no point is there: errors fall to the right
    save(figure, folder / "one_sky.png")


def _measured() -> tuple[np.ndarray, np.ndarray]:
    """Rows of a limb's errors of slope and height, px, and of glow's slope and blur as its frame
    has them: by the frame itself, and by both.
    """
    alone, together = [], []
    for scene in hard_scenes(_SCENES, _SEED, _KINDS):
        views = scene.views
        frames = [Frame(v, f.image) for v, f in zip(views, scene.frames, strict=True)]
        truth = scene.frames[0].truth
        for view, limb in zip(views, HorizonSensor().process(frames).limbs, strict=True):
            if not isinstance(limb, GlowPoints) or limb.alone is None:
                continue
            seen = [limb.alone.value[5], limb.alone.value[3]]
            for rows, points in ((alone, points_alone(limb.alone)), (together, limb)):
                off_px = rays_of(view, points).residuals_px(truth.nadir_base, truth.rho_rad)
                slope_px = np.polyfit(np.linspace(-1.0, 1.0, len(off_px)), off_px, 1)[0]
                rows.append([slope_px, off_px.mean(), *seen])
    return np.array(alone), np.array(together)
