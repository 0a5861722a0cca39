"""What a frame cannot tell: errors beside those claimed, where it is told and where it is not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from figures.drawing import BLUE, ORANGE, save
from horizon_sensor_ros.core.aiding import Aiding
from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.core.horizon.fix import Frame, HorizonFix
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.sim.flight import swinging_flight
from horizon_sensor_ros.sim.hard_scenes import hard_scene
from horizon_sensor_ros.sim.scene_sets import set_m

_FLIGHTS, _SETS, _PERIOD_S, _READOUT_S = 40, 6, 1.0 / 30.0, 0.02
_MOVING, _EXPOSURE_S = 60, 0.01
_SCENES, _SEED, _UNEVEN_M = 40, 9, 1000.0
_Points = list[tuple[float, float]]


def draw(folder: Path) -> None:
    """Write told.png: rolling shutters, motion, uneven limbs, and lenses that blur more in the
    corners.
    """
    panels = plt.subplots(2, 2, figsize=(12.0, 8.0), layout="constrained")
    figure, ((shutters, exposures), (limbs, lenses)) = panels
    for told, points in _rolling().items():
        _scatter(shutters, points, told, "readout told, no gyro" if told else "not told")
    for told, points in _smeared().items():
        _scatter(exposures, points, told, "exposure and rate told" if told else "not told")
    for told, points in _uneven().items():
        _scatter(limbs, points, told, "unevenness told" if told else "not told")
    for told, points in _soft_corners().items():
        _scatter(lenses, points, told, "blur in the corners told" if told else "not told")
    for axes, title in (
        (shutters, "Rolling shutters of 20 ms, the craft turns at 0.5 to 10 deg/s"),
        (exposures, "Motion by 2 to 20 px during the exposure, single cameras"),
        (limbs, "Height of the limb uneven by 1 km, single cameras"),
        (lenses, "Lenses that blur more in the corners, single cameras"),
    ):
        sigma = np.array([1e-3, 0.6])
        axes.loglog(sigma, sigma, color="0.4", lw=1.0, label="as claimed")
        axes.loglog(sigma, 3.0 * sigma, "--", color="0.4", lw=1.0, label="three times that")
        axes.set_title(title, fontsize=11)
        axes.set(xlabel="sigma claimed (deg)", ylabel="error of nadir (deg)")
        axes.set(xlim=(8e-4, 0.8), ylim=(1e-3, 1.0))
        axes.grid(color="0.92")
        axes.legend(fontsize=10)
    save(figure, folder / "told.png")


def _scatter(axes: Axes, points: _Points, told: bool, label: str) -> None:
    sigma, error = np.array(points).T
    axes.loglog(sigma, error, "o", ms=4, color=BLUE if told else ORANGE, alpha=0.75, label=label)


def _rolling() -> dict[bool, _Points]:
    """Sigmas and errors of the last sets of flights, degrees, told of the readout and not."""
    found: dict[bool, _Points] = {False: [], True: []}
    for i in range(_FLIGHTS):
        rng = np.random.default_rng([_SEED, i])
        rate = np.radians(np.exp(rng.uniform(np.log(0.5), np.log(10.0))))
        flown = replace(swinging_flight(float(rate), rng), readout_s=_READOUT_S)
        sets = [flown.frames(step * _PERIOD_S) for step in range(_SETS)]
        for told, points in found.items():
            views = [replace(view, readout_s=_READOUT_S * told) for view in flown.views]
            sensor = HorizonSensor()
            for step, drawn in enumerate(sets):
                shown = [Frame(v, frame.image) for v, frame in zip(views, drawn, strict=True)]
                fix = sensor.process(shown, Aiding(since_last_s=_PERIOD_S if step else None))
            _add(points, fix, sets[-1][0].truth.nadir_base)
    return found


def _smeared() -> dict[bool, _Points]:
    """The same of single cameras that turn while they expose, told of that and not."""
    found: dict[bool, _Points] = {False: [], True: []}
    for case in set_m(_MOVING, _SEED):
        (view,), (drawn,) = case.views, case.frames
        rate = case.turn_base_rad / _EXPOSURE_S
        for told, points in found.items():
            seen_by = replace(view, exposure_s=_EXPOSURE_S * told)
            fix = HorizonSensor().process(
                [Frame(seen_by, drawn.image)], Aiding(rate_base_rad_s=rate)
            )
            _add(points, fix, drawn.truth.nadir_base)
    return found


def _uneven() -> dict[bool, _Points]:
    """The same of single cameras over clouds, told of an uneven limb and not."""
    found: dict[bool, _Points] = {False: [], True: []}
    for i in range(_SCENES):
        scene = hard_scene("clouds", i, _SEED)
        world = replace(scene.scene, limb_uneven_m=_UNEVEN_M)
        drawn = scene.redrawn(world, np.random.default_rng(i))[0]
        for told, points in found.items():
            sensor = HorizonSensor(HorizonConfig(limb_unevenness_m=_UNEVEN_M * told))
            fix = sensor.process([Frame(scene.views[0], drawn.image)])
            _add(points, fix, drawn.truth.nadir_base)
    return found


def _soft_corners() -> dict[bool, _Points]:
    """The same of lenses that blur more in the corners, told and not."""
    found: dict[bool, _Points] = {False: [], True: []}
    for i in range(_SCENES):
        scene = hard_scene("soft_corners", i, _SEED)
        view, frame, imaging = scene.views[0], scene.frames[0], scene.imaging[0]
        for told, points in found.items():
            seen_by = replace(view, corner_blur_px=imaging.corner_blur_px) if told else view
            fix = HorizonSensor().process([Frame(seen_by, frame.image)])
            _add(points, fix, frame.truth.nadir_base)
    return found


def _add(points: _Points, fix: HorizonFix, nadir_base: np.ndarray) -> None:
    """Add a fix's sigma in its least certain direction and its error, degrees."""
    if fix.ok:
        sigma = np.sqrt(np.linalg.eigvalsh(fix.fit.cov_nadir_altitude[:3, :3])[-1])
        off = np.linalg.norm(fix.fit.nadir_base - nadir_base)
        points.append((float(np.degrees(sigma)), float(np.degrees(off))))
