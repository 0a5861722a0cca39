"""Where the limb is found in a profile: a sharp planet, clouds beside the limb, air above it."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from matplotlib import pyplot as plt

from figures.drawing import BLUE, GREEN, ORANGE, save
from horizon_sensor_ros.core.fits.observation import LimbObservation, gather
from horizon_sensor_ros.core.horizon.fix import Frame
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.sim.hard_scenes import hard_scenes

_SCENES = (("flat", "sharp planet"), ("clouds", "clouds beside the limb"), ("air", "air above it"))
_REACH_PX = 8.0
_SEED = 11


def draw(folder: Path) -> None:
    """Write edge.png: three profiles, the limb's true place, and the place found with its sigma."""
    figure, panels = plt.subplots(3, 1, figsize=(6.5, 7.6), layout="constrained", sharex=True)
    for axes, (kind, title) in zip(panels, _SCENES, strict=True):
        scene = next(iter(hard_scenes(1, _SEED, (kind,))))
        frames = [Frame(v, f.image) for v, f in zip(scene.views, scene.frames, strict=True)]
        fix = HorizonSensor().process(frames)
        limb, view = fix.limbs[0], frames[0].view
        i = len(limb.px) // 2
        d_px = np.arange(-_REACH_PX, _REACH_PX + 0.01, 0.25)
        at = limb.px[i] + d_px[:, None] * limb.normal_px[i]
        profile = cv2.remap(
            frames[0].gray, at[:, 0].astype(np.float32)[None], at[:, 1].astype(np.float32)[None],
            cv2.INTER_CUBIC,
        )[0]  # fmt: skip
        rays = gather([LimbObservation(view, limb)])
        truth = scene.frames[0].truth
        # The found point lies this far outside the true limb.
        found_px = float(
            rays.residuals_px(truth.nadir_cam @ view.rot_base_from_cam.T, truth.rho_rad)[i]
        )
        sigma_px = float(np.hypot(limb.sigma_px[i], limb.shared.coherent_px))
        axes.plot(
            d_px + found_px, profile, ".-", color=BLUE, markersize=4, lw=1, label="gray level"
        )
        axes.axvline(0.0, color="0.2", lw=1.2, ls="--", label="true limb")
        axes.axvspan(found_px - sigma_px, found_px + sigma_px, color=ORANGE, alpha=0.3, lw=0)
        axes.axvline(found_px, color=ORANGE, lw=1.8, label="found, one sigma")
        axes.set_title(
            f"{title}: {round(found_px, 2) + 0.0:+.2f} px off, sigma {sigma_px:.2f} px", fontsize=11
        )
        axes.set(ylabel="gray level", xlim=(-_REACH_PX, _REACH_PX))
        axes.grid(color="0.92")
    panels[0].legend(fontsize=10, loc="upper right")
    panels[-1].set_xlabel("distance across the limb, outwards (px)")
    panels[-1].annotate("planet", (0.02, 0.08), xycoords="axes fraction", fontsize=10, color=GREEN)
    panels[-1].annotate("space", (0.92, 0.08), xycoords="axes fraction", fontsize=10, color=GREEN)
    save(figure, folder / "edge.png")
