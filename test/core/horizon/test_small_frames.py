"""Frames of few pixels, as thermal imagers have: what is claimed of them holds."""

from __future__ import annotations

import numpy as np
import pytest
from limb_samples import nadir_nees

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.horizon.fix import Frame, HorizonFix
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.sim.earth_camera import render_views
from horizon_sensor_ros.sim.earth_scene import EarthScene, Imaging
from horizon_sensor_ros.sim.poses import camera_from_fov, random_direction, rot_from_axis

NUM = 40
BEYOND_NEES = 11.8  # of two unknowns, three sigma


def ground(kind: str, rng: np.random.Generator) -> EarthScene:
    seed = int(rng.integers(2**31))
    if kind == "smooth":
        return EarthScene(texture="smooth", texture_seed=seed, uniform_dn=140.0)
    return EarthScene(texture="clouds", texture_seed=seed, cloud_cover=0.5, cloud_contrast=0.2)


def one(kind: str, width: int, number: int) -> tuple[HorizonFix, np.ndarray]:
    """A fix from low orbit, the limb across the middle of the frame; and nadir."""
    rng = np.random.default_rng([number, width, 5])
    scene = ground(kind, rng)
    radius_m = scene.planet.radius_m
    distance_m = radius_m + rng.uniform(400e3, 800e3)
    nadir, rho = random_direction(rng), np.arcsin(radius_m / distance_m)
    across = np.cross(nadir, random_direction(rng))
    across /= np.linalg.norm(across)
    axis = np.cos(rho) * nadir + np.sin(rho) * across
    rot = rot_from_axis(axis, rng.uniform(0.0, 2.0 * np.pi))
    camera = camera_from_fov(width, 3 * width // 4, np.radians(60.0))
    view = CameraView("camera_1", camera, np.eye(3))
    imaging = Imaging(noise_dn=2.0)
    (frame,) = render_views((view,), rot, -nadir * distance_m, scene, rng, imaging=imaging)
    return HorizonSensor().process([Frame(view, frame.image)]), frame.truth.nadir_base


@pytest.mark.parametrize(("kind", "width"), [("smooth", 80), ("clouds", 80), ("smooth", 120)])
def test_textured_ground_is_not_taken_for_even(kind: str, width: int) -> None:
    """A stretch of limb is two pixels long there, which never hides how it lies in the raster."""
    nees = []
    for number in range(NUM):
        fix, nadir = one(kind, width, number)
        if fix.ok:
            nees.append(nadir_nees(fix.fit, nadir))
    assert len(nees) >= 0.85 * NUM
    assert np.mean(nees) < 5.0
    assert np.count_nonzero(np.array(nees) > BEYOND_NEES) <= 0.1 * NUM
