"""Scenes under air that hides the ground, and how far off their fixes are."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from limb_frames import as_frames
from scipy.spatial.transform import Rotation

from horizon_sensor_ros.core.horizon.fix import Frame, HorizonFix
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.sim.earth_camera import render_views
from horizon_sensor_ros.sim.hard_scenes import HardScene


def frames_of(scene: HardScene) -> list[Frame]:
    return as_frames(scene.views, scene.frames)


def error_and_sigma_rad(fix: HorizonFix, scene: HardScene) -> tuple[float, float]:
    """Angle of the fix from true nadir, and the sigma that it claims of that."""
    assert fix.ok, f"{scene.name}: {fix.reason}"
    off = fix.fit.nadir_base - scene.frames[0].truth.nadir_base
    error = float(np.linalg.norm(off))
    return error, float(np.sqrt(off @ fix.fit.cov_nadir_altitude[:3, :3] @ off) / error)


def followed_rad(
    scene: HardScene, step_deg: tuple[float, float, float]
) -> Iterator[tuple[float, float]]:
    """`error_and_sigma_rad` of a craft that turns by so much from set to set: of the first set,
    which is searched, and of three that are followed.
    """
    truth = scene.frames[0].truth
    rng = np.random.default_rng(5)
    sensor = HorizonSensor()
    for step in range(4):
        turned = Rotation.from_rotvec(np.radians(step * np.array(step_deg))).as_matrix()
        frames = render_views(
            scene.views,
            truth.rot_world_from_base @ turned,
            truth.position_ecef_m,
            scene.scene,
            rng,
            imaging=scene.imaging,
        )
        now = replace(scene, frames=frames)
        fix = sensor.process(frames_of(now))
        assert (fix.predicted is not None) == (step > 0)
        yield error_and_sigma_rad(fix, now)
