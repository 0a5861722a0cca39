"""Limbs under air that hides the ground: against drawn frames, and absorption along rays."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hazy_scenes import error_and_sigma_rad, followed_rad, frames_of
from scipy.integrate import quad
from scipy.spatial.transform import Rotation

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.core.horizon.fix import Frame, HorizonFix
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.limb.edge.model import EdgeLook, edge_profile
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.sim.earth_camera import render_views
from horizon_sensor_ros.sim.hard_scenes import HardScene, hard_scene, hard_scenes
from horizon_sensor_ros.sim.poses import camera_from_fov

_SCENES = 8


@pytest.fixture(scope="module")
def scenes() -> list[HardScene]:
    return list(hard_scenes(_SCENES, 61, ("haze",)))


@pytest.fixture(scope="module")
def fixes(scenes: list[HardScene]) -> list[HorizonFix]:
    return [HorizonSensor().process(frames_of(scene)) for scene in scenes]


def test_brightness_follows_the_absorption_along_each_ray() -> None:
    radius_m, height_m, depth = 6371e3, 8e3, 9.0

    def column(tangent_m: float) -> float:
        """Of an exponential atmosphere, along a ray that passes so far above the ground."""
        lowest = radius_m + tangent_m

        def density(x: float) -> float:
            return float(np.exp(-(np.hypot(lowest, x) - radius_m) / height_m))

        return 2.0 * quad(density, 0.0, 2e6, points=(2e5,), limit=200)[0]

    heights_m = np.linspace(0.0, 60e3, 25)
    grazing = column(0.0)
    seen = [1.0 - np.exp(-depth * column(height) / grazing) for height in heights_m]
    # In pixels of 2 km; the depth is one at ln(depth) scale heights.
    x_px = (heights_m - height_m * np.log(depth)) / 2e3
    model = edge_profile(x_px, EdgeLook(0.01, height_m / 2e3, haze=True), 0.0)
    np.testing.assert_allclose(model, seen, atol=0.01)


def test_two_cameras_find_nadir_to_hundredths_of_a_degree(
    scenes: list[HardScene], fixes: list[HorizonFix]
) -> None:
    errors, sigmas = np.transpose(
        [error_and_sigma_rad(fix, scene) for fix, scene in zip(fixes, scenes, strict=True)]
    )
    assert np.degrees(np.sqrt(np.mean(errors**2))) < 0.015
    assert (errors < 3.0 * sigmas).all()
    assert np.degrees(np.median(sigmas)) < 0.03


def test_how_far_above_the_ground_such_a_limb_lies_is_claimed(
    scenes: list[HardScene], fixes: list[HorizonFix]
) -> None:
    for scene, fix in zip(scenes, fixes, strict=True):
        assert all(limb.above_m > 0.0 for limb in fix.limbs)
        low_m = scene.frames[0].truth.altitude_m - fix.fit.altitude_m
        depth_one_m = scene.scene.air_scale_height_m * np.log(scene.scene.air_depth)
        if not all(limb.glow_separated for limb in fix.limbs):
            # As much too low as the air is high where it hides what lies behind it.
            assert low_m == pytest.approx(depth_one_m, abs=4e3)
        assert low_m < 2.0 * np.sqrt(fix.fit.cov_nadir_altitude[3, 3])


def test_one_camera_claims_what_it_is_off_by(scenes: list[HardScene]) -> None:
    errors, sigmas = np.transpose(
        [
            error_and_sigma_rad(HorizonSensor().process([frame]), scene)
            for scene in scenes[:4]
            for frame in frames_of(scene)
        ]
    )
    assert np.degrees(np.sqrt(np.mean(errors**2))) < 0.1
    assert (errors < 3.0 * sigmas).all()


def test_a_soft_limb_of_a_long_lens_is_found(scenes: list[HardScene]) -> None:
    # Air fades over ten pixels and more, as in photographs of small satellites' cameras.
    scene = scenes[0]
    view = scene.views[0]
    truth = scene.frames[0].truth
    narrow = CameraView(view.name, camera_from_fov(1280, 960, np.radians(28.0)), np.eye(3))
    # About the limb's nearest point to the optical axis.
    x, y, z = truth.nadir_cam
    off = np.arctan2(np.hypot(x, y), z) - truth.rho_rad
    axis = np.array([-y, x, 0.0]) / np.hypot(x, y)
    rot = truth.rot_world_from_cam @ Rotation.from_rotvec(-off * axis).as_matrix().T
    rng = np.random.default_rng(4)
    (drawn,) = render_views((narrow,), rot, truth.position_ecef_m, scene.scene, rng)
    config = HorizonConfig(max_nadir_sigma_rad=np.radians(3.0))
    fix = HorizonSensor(config).process([Frame(narrow, drawn.image)])
    error, sigma = error_and_sigma_rad(fix, replace(scene, frames=(drawn,)))
    assert np.degrees(error) < 0.3
    assert error < 3.0 * sigma


def test_a_followed_limb_is_as_near_as_a_searched_one(scenes: list[HardScene]) -> None:
    for error, sigma in followed_rad(scenes[1], (0.05, 0.1, 0.0)):
        assert np.degrees(error) < 0.02
        assert error < 3.0 * sigma


@cache
def _under_thin_air() -> list[HardScene]:
    """Ground shines through its air, which a coarse frame takes for air that hides it."""
    scenes = []
    for number, depth in ((9, 1.0), (9, 1.5), (14, 1.5), (21, 1.5)):
        thick = hard_scene("haze", number, 62)
        world = replace(thick.scene, air_depth=depth)
        frames = thick.redrawn(world, np.random.default_rng(1))
        scenes.append(replace(thick, scene=world, frames=frames))
    return scenes


def test_under_air_that_ground_shines_through_limb_and_glow_are_told_apart() -> None:
    """By the law of haze nadir was off by 0.07 deg in these scenes, and altitude by 10 km."""
    errors = []
    for scene in _under_thin_air():
        fix = HorizonSensor().process(frames_of(scene))
        error, sigma = error_and_sigma_rad(fix, scene)
        assert error < 3.0 * sigma
        errors.append(error)
        off_m = fix.fit.altitude_m - scene.frames[0].truth.altitude_m
        assert abs(off_m) < 5e3
        # That it is not thick air is likely, not certain.
        assert np.sqrt(fix.fit.cov_nadir_altitude[3, 3]) > 15e3
    assert np.degrees(np.sqrt(np.mean(np.square(errors)))) < 0.05


def test_what_may_be_thick_air_stays_so_while_the_limb_is_followed() -> None:
    scene = _under_thin_air()[0]
    sensor = HorizonSensor()
    fixes = [sensor.process(frames_of(scene)), sensor.process(frames_of(scene))]
    assert fixes[1].predicted is not None
    for fix in fixes:
        assert all(limb.glow_separated for limb in fix.limbs)
        assert np.sqrt(fix.fit.cov_nadir_altitude[3, 3]) > 15e3


@pytest.mark.parametrize("kind", ["daylight", "balloon", "clouds", "moonlit"])
def test_ground_that_shows_at_its_limb_is_not_taken_for_haze(kind: str) -> None:
    for scene in hard_scenes(3, 62, (kind,)):
        fix = HorizonSensor().process(frames_of(scene))
        assert not any(limb.above_m for limb in fix.limbs)


def test_a_limb_height_that_is_told_makes_the_altitude_right(scenes: list[HardScene]) -> None:
    config = HorizonConfig(planet=Planet(limb_height_m=17e3))
    off_m, sigmas_m = [], []
    for scene in scenes:
        fix = HorizonSensor(config).process(frames_of(scene))
        assert fix.ok, fix.reason
        off_m.append(fix.fit.altitude_m - scene.frames[0].truth.altitude_m)
        sigmas_m.append(np.sqrt(fix.fit.cov_nadir_altitude[3, 3]))
    assert (np.abs(off_m) < 3.0 * np.array(sigmas_m)).all()
    assert np.max(sigmas_m) < 10e3
