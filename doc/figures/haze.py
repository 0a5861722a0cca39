"""A limb under air that hides the ground: what is seen across it, and how near the fixes come."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt

from figures.drawing import BLUE, GREEN, ORANGE, save
from horizon_sensor_ros.core.horizon.fix import Frame
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.limb.edge.model import EdgeLook, edge_profile
from horizon_sensor_ros.core.limb.haze.sample import PLACE, haze_factor, sample_haze
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.sim.hard_scenes import HardScene, hard_scenes

_SCENES, _SEED, _SHOWN = 40, 8, 2
_PSF_PX = 0.7


def draw(folder: Path) -> None:
    """Write haze.png: profiles across a limb beside their law, and errors beside those claimed."""
    scenes = list(hard_scenes(_SCENES, _SEED, ("haze",)))
    figure, (across, errors) = plt.subplots(2, 1, figsize=(6.5, 8.0), layout="constrained")
    depths, seen, law = _profiles(scenes[_SHOWN])
    for row in seen:
        across.plot(depths, row, color=BLUE, alpha=0.25, lw=0.8)
    across.plot(depths, law, color=ORANGE, lw=2.5, label="$1 - \\exp(-\\exp(-x))$, blurred")
    across.plot([], [], color=BLUE, label="stretches of one limb")
    across.set(
        xlabel="scale heights above where the optical depth is one",
        ylabel="brightness over the limb's",
        xlim=(depths[0], depths[-1]),
        ylim=(-0.1, 1.3),
    )
    balloons = list(hard_scenes(_SCENES, _SEED, ("balloon_haze",)))
    for seen_from, cameras, color, label in (
        (scenes, (0, 1), ORANGE, "both cameras"),
        (scenes, (0,), BLUE, "camera 1 alone"),
        (balloons, (0, 1), GREEN, "both, from a balloon"),
    ):
        rows = np.array([row for scene in seen_from if (row := _error_and_sigma(scene, cameras))])
        share = f"{label}: {len(rows)} of {len(seen_from)} fixed"
        errors.loglog(rows[:, 1], rows[:, 0], "o", ms=4, color=color, alpha=0.75, label=share)
    sigma = np.array([5e-3, 0.5])
    errors.loglog(sigma, sigma, color="0.4", lw=1.0, label="as claimed")
    errors.loglog(sigma, 3.0 * sigma, "--", color="0.4", lw=1.0, label="three times that")
    errors.set(xlabel="sigma claimed (deg)", ylabel="error of nadir (deg)", ylim=(5e-5, 0.5))
    for axes in (across, errors):
        axes.grid(color="0.92")
        axes.legend(fontsize=9, loc="upper right" if axes is across else "lower left")
    save(figure, folder / "haze.png")


def _profiles(scene: HardScene) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Heights (J,), brightness there (M, J) across stretches of a limb, and its law (J,)."""
    frame, view = scene.frames[0], scene.views[0]
    truth, air = frame.truth, scene.scene
    above_m = air.air_scale_height_m * np.log(air.air_depth)
    rho = Planet(limb_height_m=above_m).rho_from_altitude(truth.altitude_m)
    factor = haze_factor(view, rho)
    sample = sample_haze(frame.image, view, truth.nadir_base, rho, factor, PLACE)
    assert sample is not None
    assert factor == 1
    distance_m = np.cos(rho) * (truth.planet.radius_m + truth.altitude_m)
    length_px = air.air_scale_height_m / distance_m / view.camera.pixel_rad
    law = edge_profile(sample.grid.d_px, EdgeLook(_PSF_PX, length_px, haze=True), 0.0)
    space = sample.profiles[:, -3:].mean(axis=1, keepdims=True)
    seen = sample.profiles - space
    outside = sample.grid.d_px > -length_px
    level = (seen[:, outside] @ law[outside]) / (law[outside] @ law[outside])
    return sample.grid.d_px / length_px, seen / level[:, None], law


def _error_and_sigma(scene: HardScene, cameras: tuple[int, ...]) -> tuple[float, float] | None:
    """Error of nadir and the sigma claimed of it in its least certain direction, degrees."""
    fix = HorizonSensor().process([Frame(scene.views[i], scene.frames[i].image) for i in cameras])
    if not fix.ok:
        return None
    off = np.linalg.norm(fix.fit.nadir_base - scene.frames[0].truth.nadir_base)
    sigma = np.sqrt(np.linalg.eigvalsh(fix.fit.cov_nadir_altitude[:3, :3])[-1])
    return float(np.degrees(off)), float(np.degrees(sigma))
