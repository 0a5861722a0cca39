"""A round edge that is no limb: it stands still while the gyro says that the craft turns."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache

import cv2
import numpy as np
import pytest
from limb_frames import CAMERA, PLANET, as_frames, clouds, limb_views
from scipy.spatial.transform import Rotation

from horizon_sensor_ros.core.aiding import Aiding
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.horizon.craft_fixed import CraftFixed
from horizon_sensor_ros.core.horizon.fix import Frame, HorizonFix
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.sim.earth_camera import render_views
from horizon_sensor_ros.sim.earth_scene import Imaging
from horizon_sensor_ros.sim.poses import rot_from_axis

ALTITUDE_M = 500e3
ZENITH = np.array([0.6, 0.64, 0.48])
STEP_S = 0.25
AT_REST = (0.0, 0.0, 0.0)
STILL = "stands still"


def dish(seed: int) -> Frame:
    """A bright round part of the craft before dark sky."""
    rng = np.random.default_rng(seed)
    # About the axis a circle is what a planet's limb would be.
    across, down = np.meshgrid(np.arange(640) - 319.5, np.arange(480) - 239.5)
    gray = 8.0 + 162.0 * np.clip(210.5 - np.hypot(across, down), 0.0, 1.0)
    gray = cv2.GaussianBlur(gray, None, 0.8) + rng.normal(size=gray.shape)
    view = CameraView("camera_1", CAMERA, rot_from_axis(np.array([1.0, 0.0, 0.0]), 0.3))
    return Frame(view, gray.clip(0, 255).astype(np.uint8))


DARK = [Frame(CameraView("camera_1", CAMERA, np.eye(3)), np.zeros((480, 640), np.uint8))]
DISHES = [dish(seed) for seed in range(4)]


def by_gyro(rate_rad_s: np.ndarray, step_s: float = STEP_S) -> Aiding:
    return Aiding(
        rot_now_from_last=Rotation.from_rotvec(-rate_rad_s * step_s).as_matrix(),
        rate_base_rad_s=rate_rad_s,
        since_last_s=step_s,
    )


@lru_cache(maxsize=64)
def horizon(turn: tuple[float, float, float], cameras: int, seed: int = 0) -> tuple[Frame, ...]:
    """Frames of cameras on a craft that has turned so far about its own axes, rad. seed : of the
    noise, as no two images are the same.
    """
    views = limb_views(ALTITUDE_M, azimuths_rad=(0.0, 1.5)[:cameras])
    rot = rot_from_axis(-ZENITH, 0.7) @ Rotation.from_rotvec(turn).as_matrix()
    position = ZENITH * (PLANET.radius_m + ALTITUDE_M)
    rng = np.random.default_rng(seed)
    return tuple(
        as_frames(views, render_views(views, rot, position, clouds(2), rng, imaging=Imaging()))
    )


def flown(
    rate_rad_s: np.ndarray, told: np.ndarray, sets: int, cameras: int
) -> Iterator[HorizonFix]:
    """Fixes of a horizon that turns at a rate, with another one told by the gyro."""
    sensor = HorizonSensor()
    for k in range(sets):
        turn = rate_rad_s * STEP_S * k
        yield sensor.process(horizon(tuple(turn.tolist()), cameras, k % 2), by_gyro(told))


@pytest.mark.parametrize("rate_deg_s", [0.5, 2.0, 10.0])
def test_a_part_of_the_craft_is_no_horizon_once_the_craft_turns(rate_deg_s: float) -> None:
    sensor = HorizonSensor()
    rate = np.radians(rate_deg_s) * np.array([0.0, 1.0, 0.0])
    step_s = 0.5 / rate_deg_s
    fixes = [sensor.process([DISHES[k % 4]], by_gyro(rate, step_s)) for k in range(30)]
    assert fixes[0].ok
    found = next(k for k, fix in enumerate(fixes) if not fix.ok)
    # The gyro has told by then that nadir moved by two degrees, and what it may be off by.
    assert 2.0 < 0.5 * found < 8.0
    assert all(fix.status is Status.POOR_FIT and STILL in fix.reason for fix in fixes[found:])
    # It is none either when the craft has come to rest.
    fix = sensor.process([DISHES[0]], by_gyro(np.zeros(3)))
    assert STILL in fix.reason
    assert np.isnan(fix.fit.nadir_base).all()
    # A real one that comes into sight elsewhere is believed at once.
    assert sensor.process([horizon(AT_REST, 1)[0]], by_gyro(np.zeros(3))).ok
    sensor.reset()
    assert sensor.process([DISHES[0]]).ok


@pytest.mark.parametrize("rate_deg_s", [0.07, pytest.param(0.5, marks=pytest.mark.slow), 3.0])
def test_a_horizon_that_turns_with_the_gyro_is_one(rate_deg_s: float) -> None:
    rate = np.radians(rate_deg_s) * np.array([0.8, -0.6, 0.0])
    most = np.radians(6.0) / max(rate_deg_s * STEP_S * np.pi / 180.0, 1e-9)
    fixes = list(flown(rate, rate, min(40, int(most)), 1))
    assert all(fix.ok and STILL not in fix.reason for fix in fixes)


def test_a_gyro_of_another_scale_makes_no_part_of_the_craft_of_a_horizon() -> None:
    """It has moved by half of what the gyro tells: wrongly told is not standing still."""
    rate = np.radians(0.5) * np.array([0.8, -0.6, 0.0])
    fixes = list(flown(rate, 2.0 * rate, 40, 1))
    assert all(fix.ok and STILL not in fix.reason for fix in fixes)


def test_a_horizon_at_rest_that_an_orbit_turns_is_one() -> None:
    """Towards nadir all the time: the gyro shows one turn an orbit, for minutes."""
    rate = np.radians(0.07) * np.array([0.8, -0.6, 0.0])
    sensor = HorizonSensor()
    for k in range(60):
        assert sensor.process(horizon(AT_REST, 1, k % 2), by_gyro(rate, 2.0)).ok


def test_a_turn_about_nadir_moves_no_limb() -> None:
    sensor = HorizonSensor()
    for k in range(30):
        assert sensor.process(horizon(AT_REST, 1, k % 2), by_gyro(np.array([0.0, 0.0, 0.1]))).ok


def test_a_glitch_of_the_gyro_is_no_turn() -> None:
    sensor = HorizonSensor()
    glitch = by_gyro(np.array([0.7, 0.0, 0.0]))
    for k in range(20):
        aiding = glitch if k == 7 else by_gyro(np.zeros(3))
        assert sensor.process(horizon(AT_REST, 1, k % 2), aiding).ok


@pytest.mark.parametrize("cameras", [1, 2])
def test_a_gyro_that_was_wrong_for_a_while_is_forgiven(cameras: int) -> None:
    """Sooner where two cameras agree on the horizon: they refute it."""
    sensor = HorizonSensor()
    quiet, wrong = by_gyro(np.zeros(3)), by_gyro(np.array([0.3, 0.0, 0.0]))
    told = []
    for k in range(40 if cameras == 2 else 2500):
        fix = sensor.process(
            horizon(AT_REST, cameras, k % 2) if cameras == 2 or k < 20 or k % 100 == 99 else DARK,
            wrong if 5 <= k < 10 else quiet,
        )
        told.append(STILL in fix.reason)
    first = told.index(True)
    assert first < 20
    # Not at once, for five seconds at least.
    assert all(told[first : first + int(5.0 / STEP_S)]) or cameras == 1
    assert not told[-1]
    assert fix.ok


@pytest.mark.parametrize(("after_s", "held"), [(30, True), (590, True), (610, False)])
def test_what_stood_still_is_remembered_for_ten_minutes(after_s: int, held: bool) -> None:
    fix = HorizonSensor().process(horizon(AT_REST, 1))
    nothing = HorizonSensor().process(DARK)
    assert fix.ok
    assert not nothing.ok
    part, wrong, quiet = CraftFixed(), by_gyro(np.array([0.3, 0.0, 0.0])), by_gyro(np.zeros(3), 1.0)
    said = [part.against(fix, wrong) for _ in range(12)]
    assert STILL in said[-1]
    for _ in range(after_s - 1):
        part.against(nothing, quiet)
    assert (STILL in part.against(fix, quiet)) == held


def test_cameras_that_agree_on_a_horizon_are_believed_against_a_gyro() -> None:
    """It is told, and not believed: no part of the craft is one horizon to two cameras."""
    fixes = list(flown(np.zeros(3), np.array([0.03, 0.02, 0.0]), 30, 2))
    assert all(fix.ok and len(fix.cameras_used) == 2 for fix in fixes)
    assert STILL not in fixes[3].reason
    assert STILL in fixes[-1].reason
