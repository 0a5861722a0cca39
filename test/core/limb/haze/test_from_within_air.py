"""Limbs under air that hides the ground, seen from within it: from a balloon."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hazy_scenes import error_and_sigma_rad, followed_rad, frames_of
from hypothesis import given
from hypothesis import strategies as st
from limb_frames import PLANET, as_frames, draw, limb_views
from scipy.integrate import quad

from horizon_sensor_ros.core.aiding import Aiding, AltitudeMeasurement
from horizon_sensor_ros.core.cameras.mask import Mask
from horizon_sensor_ros.core.covariance.hidden_air import hidden_air_sigma_m
from horizon_sensor_ros.core.fits.observation import LimbObservation
from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.core.horizon.fix import Frame, HorizonFix
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.limb.haze.column import LOWEST_RHO_RAD, AirColumn, seen_from_within
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.sim.earth_scene import EarthScene, Imaging
from horizon_sensor_ros.sim.hard_scenes import HardScene, hard_scenes

_SCENES = 12
_HEIGHT_M = 8.5e3 / 6371e3 * PLANET.radius_m  # the Earth's usual scale height


def _altitude_off(fix: HorizonFix, scene: HardScene) -> tuple[float, float]:
    """Error of the altitude, and the sigma that it claims, metres."""
    off_m = fix.fit.altitude_m - scene.frames[0].truth.altitude_m
    return off_m, float(np.sqrt(fix.fit.cov_nadir_altitude[3, 3]))


@pytest.fixture(scope="module")
def scenes() -> list[HardScene]:
    return list(hard_scenes(_SCENES, 71, ("balloon_haze",)))


@pytest.fixture(scope="module")
def fixes(scenes: list[HardScene]) -> list[HorizonFix]:
    return [HorizonSensor().process(frames_of(scene)) for scene in scenes]


def _column(camera_m: float, depression_rad: float) -> float:
    """Air along a ray from a camera so high, in metres of air as dense as on the ground, without
    regard to the ground.
    """
    start = PLANET.radius_m + camera_m
    sine = np.sin(depression_rad)

    def density(along_m: float) -> float:
        height_m = np.sqrt(start**2 + along_m**2 - 2.0 * start * along_m * sine) - PLANET.radius_m
        return float(np.exp(-height_m / _HEIGHT_M))

    lowest_m = start * sine
    points = (max(lowest_m, 0.0), max(lowest_m + 3e5, 3e5))
    return quad(density, 0.0, 3e6, points=points, limit=400)[0]


@pytest.mark.parametrize("above_m", [4e3, 12e3, 25e3, 60e3])
def test_optical_depth_is_that_of_the_air_along_each_ray(above_m: float) -> None:
    """Of a limb 15 km above the ground and a camera so far above that."""
    camera_m = 15e3 + above_m
    limb_rad = np.arccos((PLANET.radius_m + 15e3) / (PLANET.radius_m + camera_m))
    column = AirColumn(limb_rad)
    assert seen_from_within(0.5 * np.pi - limb_rad)
    falls = np.linspace(-1.5, min(4.0, column.most), 12)
    away_rad = column.outward_rad(falls)
    at_limb = _column(camera_m, limb_rad)
    seen = [_column(camera_m, limb_rad - away) / at_limb for away in away_rad]
    # The air's curvature, and that of small angles, are left out.
    np.testing.assert_allclose(np.log(seen), -falls, atol=0.04)


@given(
    depression_rad=st.floats(0.5 * np.pi - LOWEST_RHO_RAD, 0.157),
    shares=st.lists(st.floats(0.0, 1.0), min_size=2, max_size=8, unique=True),
)
def test_light_falls_outwards_all_the_way(depression_rad: float, shares: list[float]) -> None:
    column = AirColumn(depression_rad)
    falls = -3.0 + (column.most + 3.0) * np.sort(shares)
    away_rad = column.outward_rad(falls)
    assert (np.diff(away_rad) >= 0.0).all()
    assert away_rad[-1] <= depression_rad + np.radians(6.0) + 1e-6
    # Near the limb it falls to 1 / e over its length.
    near = column.outward_rad(np.array([-1e-4, 1e-4]))
    assert near[1] - near[0] == pytest.approx(2e-4 * column.length_rad, rel=1e-3)


def test_both_nadir_and_altitude_are_as_they_claim(
    scenes: list[HardScene], fixes: list[HorizonFix]
) -> None:
    """Most such frames were refused for a motion that they did not have."""
    errors, sigmas = np.transpose(
        [error_and_sigma_rad(fix, scene) for fix, scene in zip(fixes, scenes, strict=True)]
    )
    assert np.degrees(np.sqrt(np.mean(errors**2))) < 0.1
    assert (errors < 3.0 * sigmas).all()
    for scene, fix in zip(scenes, fixes, strict=True):
        off_m, sigma_m = _altitude_off(fix, scene)
        depth_one_m = scene.scene.air_scale_height_m * np.log(scene.scene.air_depth)
        # As much too low as the air is high where it hides what lies behind it.
        assert -off_m == pytest.approx(depth_one_m, abs=5e3)
        assert abs(off_m) < 2.0 * sigma_m


def test_a_limb_height_that_is_told_makes_the_altitude_right(scenes: list[HardScene]) -> None:
    config = HorizonConfig(planet=Planet(limb_height_m=17e3))
    for scene in scenes:
        off_m, sigma_m = _altitude_off(HorizonSensor(config).process(frames_of(scene)), scene)
        assert abs(off_m) < 3.0 * sigma_m
        assert sigma_m < 8e3


def test_an_altitude_that_is_known_is_used(scenes: list[HardScene]) -> None:
    scene = scenes[0]
    truth_m = scene.frames[0].truth.altitude_m
    known = Aiding(altitude=AltitudeMeasurement(truth_m, 50.0))
    fix = HorizonSensor().process(frames_of(scene), known)
    error, sigma = error_and_sigma_rad(fix, scene)
    assert not fix.reason
    assert fix.fit.altitude_m == pytest.approx(truth_m, abs=200.0)
    assert error < 3.0 * sigma


def test_a_followed_limb_is_as_near_as_a_searched_one(scenes: list[HardScene]) -> None:
    for error, sigma in followed_rad(scenes[1], (0.2, 0.4, 0.0)):
        assert error < 3.0 * sigma


def test_what_is_masked_is_left_out(scenes: list[HardScene], fixes: list[HorizonFix]) -> None:
    """A bar before the limb, from the frame's upper to its lower edge: only what it hides."""
    scene, whole = scenes[2], fixes[2]
    frames = []
    for frame in frames_of(scene):
        use = np.full(frame.gray.shape, 255, np.uint8)
        use[:, 300:330] = 0
        barred = np.where(use > 0, frame.gray, np.uint8(230))
        frames.append(Frame(replace(frame.view, mask=Mask(use)), barred))
    fix = HorizonSensor().process(frames)
    error, sigma = error_and_sigma_rad(fix, scene)
    assert error < 3.0 * sigma
    lost = [1.0 - len(a.px) / len(b.px) for a, b in zip(fix.limbs, whole.limbs, strict=True)]
    assert max(lost) < 0.3


def test_soft_edges_from_within_the_air_may_be_airs() -> None:
    """As those of air that is overexposed: altitude was 12 to 21 km too low at 1 to 2 claimed."""
    views = limb_views(30e3)[:1]
    fix = HorizonSensor().process(as_frames(views, draw(views, 30e3, EarthScene(), Imaging(), 1)))
    sharp = fix.limbs[0]
    assert hidden_air_sigma_m(fix.fit, [LimbObservation(views[0], sharp)], PLANET) == 0.0
    soft = LimbObservation(views[0], replace(sharp, blur_px=np.nan))
    assert hidden_air_sigma_m(fix.fit, [soft], PLANET) == pytest.approx(18e3, rel=0.01)
    # From higher up the same edge is the ground's.
    higher = replace(fix.fit, rho_rad=PLANET.rho_from_altitude(300e3))
    assert hidden_air_sigma_m(higher, [soft], PLANET) == 0.0


def _edge(width: int, height: int, tilt: float, blur_px: float) -> np.ndarray:
    """A bright half of a frame, whose edge is straight and blurred, (H, W) uint8."""
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    below = (y - 0.5 * height) - tilt * (x - 0.5 * width) > 0.0
    light = cv2.GaussianBlur(np.where(below, 180.0, 0.0), (0, 0), blur_px)
    noise = np.random.default_rng(3).normal(0.0, 1.5, light.shape)
    return np.clip(np.rint(light + 8.0 + noise), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("blur_px", [6.0, 10.0, 16.0, 25.0])
@pytest.mark.parametrize("tilt", [-0.4, 0.0, 0.7])
def test_a_straight_soft_edge_of_the_crafts_is_no_limb(blur_px: float, tilt: float) -> None:
    """Near to a lens, out of focus: to one camera, to both, and whatever altitude is allowed."""
    views = limb_views(30e3)[:2]
    edge = _edge(views[0].camera.width, views[0].camera.height, tilt, blur_px)
    for seen in (views[:1], views):
        for lowest_m in (1e4, 10.0):
            sensor = HorizonSensor(HorizonConfig(altitude_min_m=lowest_m))
            fix = sensor.process([Frame(view, edge) for view in seen])
            assert not fix.ok
            assert fix.reason
