"""Another body in the frame of one camera, where the planet was; drawn from a cone's equation."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.special import ndtr

from horizon_sensor_ros.core.aiding import Aiding
from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.horizon.fix import Frame, HorizonFix
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.mathematics.attitude import angle_rad

RADIUS_M, ALTITUDE_M, STEP_S = 6371e3, 500e3, 0.2
RHO_RAD = float(np.arcsin(RADIUS_M / (RADIUS_M + ALTITUDE_M)))
MOON_RAD = np.radians(6.0)
CAMERA = Camera(320, 240, 260.0, 260.0, 159.5, 119.5)
LEFT = Rotation.from_rotvec([0.0, -1.2, 0.0]).as_matrix()
VIEWS = (CameraView("camera_1", CAMERA, np.eye(3)), CameraView("camera_2", CAMERA, LEFT))
# In optical axes: the limb in the middle of the frame, and the Moon.
DOWN = np.array([0.0, np.sin(RHO_RAD), np.cos(RHO_RAD)])
MOON = np.array([0.05, -0.1, 1.0]) / np.linalg.norm([0.05, -0.1, 1.0])
STILL = np.zeros(3)


def frame(view: CameraView, nadir: np.ndarray, rho_rad: float, seed: int) -> Frame:
    """An evenly bright disc about a direction (3,) of the base frame, by an ideal camera."""
    x, y = np.meshgrid(np.arange(320) - CAMERA.cx, np.arange(240) - CAMERA.cy)
    rays = np.stack([x, y, np.full_like(x, CAMERA.fx)], axis=-1)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    inside = rho_rad - np.arccos(np.clip(rays @ view.rot_base_from_cam.T @ nadir, -1, 1))
    inside_px = inside / np.maximum(np.hypot(*np.gradient(inside)), 1e-9)
    noise = np.random.default_rng(seed).normal(size=inside.shape)
    gray = 8.0 + 150.0 * ndtr(inside_px / 0.757) + noise
    return Frame(view, np.clip(np.rint(gray), 0, 255).astype(np.uint8))


def by_gyro(rate: np.ndarray | None) -> Aiding:
    if rate is None:
        return Aiding(since_last_s=STEP_S)
    turn = Rotation.from_rotvec(-STEP_S * rate).as_matrix()
    return Aiding(rot_now_from_last=turn, rate_base_rad_s=rate, since_last_s=STEP_S)


class Flight:
    """Sets of frames, one after the other, through one sensor."""

    def __init__(self) -> None:
        self.sensor, self.sets = HorizonSensor(), 0

    def see(
        self,
        nadir: np.ndarray,
        rho_rad: float = RHO_RAD,
        rate: np.ndarray | None = STILL,
        cameras: int = 1,
    ) -> HorizonFix:
        self.sets += 1
        frames = [frame(view, nadir, rho_rad, 10 * self.sets + len(view.name)) for view in VIEWS]
        return self.sensor.process(frames[:cameras], by_gyro(rate))


def is_right(fix: HorizonFix, nadir: np.ndarray) -> bool:
    return fix.ok and angle_rad(fix.fit.nadir_base, nadir) < np.radians(0.2)


def test_the_moon_is_not_the_planet_that_was_there_before() -> None:
    flight = Flight()
    assert all(is_right(flight.see(DOWN), DOWN) for _ in range(8))
    moons = [flight.see(MOON, MOON_RAD) for _ in range(6)]
    assert not any(fix.ok for fix in moons)
    assert all("another body" in fix.reason for fix in moons)
    assert all(is_right(flight.see(DOWN), DOWN) for _ in range(4))


def test_frames_of_other_scenes_without_a_gyro_are_believed_at_once() -> None:
    flight = Flight()
    assert all(is_right(flight.see(DOWN, rate=None), DOWN) for _ in range(3))
    assert is_right(flight.see(MOON, MOON_RAD, rate=None), MOON)


def test_the_planet_is_believed_once_it_was_there_for_longer_than_what_was_no_planet() -> None:
    flight = Flight()
    assert all(flight.see(MOON, MOON_RAD).ok for _ in range(3))
    told = [is_right(flight.see(DOWN), DOWN) for _ in range(8)]
    assert told == [False] * 3 + [True] * 5
    # Both are remembered: the Moon has been there for no longer since.
    assert not any(flight.see(MOON, MOON_RAD).ok for _ in range(3))
    assert is_right(flight.see(DOWN), DOWN)


def test_however_long_another_body_was_there_a_minute_is_enough() -> None:
    flight = Flight()
    leaps = flight.sensor._leaps
    moon, planet = flight.see(MOON, MOON_RAD), Flight().see(DOWN)
    for _ in range(2000):
        assert leaps.against(moon, by_gyro(STILL)) == ""
    told = [leaps.against(planet, by_gyro(STILL)) for _ in range(400)]
    wait = round(60.0 / STEP_S)
    assert all(told[: wait - 1])
    assert not any(told[wait + 1 :])


def test_as_high_but_elsewhere_than_the_gyro_says() -> None:
    flight = Flight()
    assert all(flight.see(DOWN).ok for _ in range(5))
    up = -DOWN * (1.0, 1.0, -1.0)  # a limb at the frame's upper side
    assert is_right(Flight().see(up), up)
    elsewhere = [flight.see(up) for _ in range(4)]
    assert not any(fix.ok for fix in elsewhere)
    assert "by imu" in elsewhere[0].reason
    # Without a gyro the craft may have turned.
    free = Flight()
    assert all(is_right(free.see(DOWN, rate=None), DOWN) for _ in range(3))
    assert is_right(free.see(up, rate=None), up)


@pytest.mark.parametrize(("told", "lost"), [(-1.0, 0), (0.0, 2), (3.0, 0)])
def test_what_a_gyro_costs_that_is_wrong(told: float, lost: int) -> None:
    rate = np.array([0.5, 0.0, 0.0])
    flight, right = Flight(), []
    for i in range(-4, 5):
        nadir = Rotation.from_rotvec(-i * 0.5 * STEP_S * rate).apply(DOWN)
        right.append(is_right(flight.see(nadir, rate=told * rate), nadir))
    assert right.count(False) <= lost
    assert all(right[-4:])


def test_cameras_that_agree_are_believed_at_once() -> None:
    flight = Flight()
    assert all(flight.see(MOON, MOON_RAD).ok for _ in range(5))
    fix = flight.see(DOWN, cameras=2)
    assert fix.of_several
    assert is_right(fix, DOWN)
    assert is_right(flight.see(DOWN), DOWN)
