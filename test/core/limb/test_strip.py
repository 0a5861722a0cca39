"""Strips before black sky, as round as a limb: drawn by their angle from nadir."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.cameras.mask import Mask
from horizon_sensor_ros.core.horizon.fix import Frame, HorizonFix
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.status import Status

CAMERA = Camera(640, 480, 550.0, 550.0, 319.5, 239.5)
RHO_RAD = np.radians(66.0)  # of the Earth from 600 km
# The limb crosses the frame above its middle.
NADIR = np.array([0.0, np.sin(RHO_RAD - 0.1), np.cos(RHO_RAD - 0.1)])
NADIR /= np.linalg.norm(NADIR)
Light = Callable[[np.ndarray], np.ndarray]


def fix_of(light: Light, nadir: np.ndarray, rho_rad: float, mask: Mask | None = None) -> HorizonFix:
    """Fix of what is so bright at a depth inside a disc, in pixels: of 4 x 4 in each, a little
    blurred, with noise.
    """
    fine = np.mgrid[:1920, :2560][::-1].reshape(2, -1).T / 4.0 - 0.375
    depth_px = CAMERA.fx * (rho_rad - np.arccos(np.clip(CAMERA.rays(fine) @ nadir, -1.0, 1.0)))
    drawn = np.where(depth_px > 0.0, light(depth_px), 0.0).reshape(480, 4, 640, 4).mean((1, 3))
    noise = np.random.default_rng(0).normal(8.0, 2.0, drawn.shape)
    image = np.clip(np.round(cv2.GaussianBlur(drawn, (0, 0), 0.7) + noise), 0, 255)
    view = CameraView("camera_1", CAMERA, np.eye(3), mask)
    return HorizonSensor().process([Frame(view, image.astype(np.uint8))])


def off_rad(fix: HorizonFix, nadir: np.ndarray) -> float:
    return float(np.linalg.norm(np.cross(fix.fit.nadir_base, nadir)))


def strip_of(breadth_px: float) -> Light:
    return lambda depth: np.where(depth < breadth_px, 120.0, 0.0)


@pytest.mark.parametrize("breadth_px", [24.0, 40.0, 90.0])
def test_a_strip_that_bends_as_a_limb_is_refused(breadth_px: float) -> None:
    fix = fix_of(strip_of(breadth_px), NADIR, RHO_RAD)
    assert fix.status is Status.NO_LIMB
    assert "a part of the craft: behind 100% of its edge it ends as sharply" in fix.reason


def test_a_planet_that_goes_on_is_none() -> None:
    fix = fix_of(strip_of(np.inf), NADIR, RHO_RAD)
    assert fix.status is Status.OK, fix.reason
    assert off_rad(fix, NADIR) < np.radians(0.02)


@pytest.mark.parametrize("power", [0.5, 1.0])
def test_ground_that_darkens_towards_its_terminator_is_none(power: float) -> None:
    """With the Sun's height, or with its root, as where the air lights the ground."""
    fix = fix_of(lambda d: 120.0 * np.clip(1.0 - d / 90.0, 0.0, 1.0) ** power, NADIR, RHO_RAD)
    assert "a part of the craft" not in fix.reason


def test_a_whole_disc_is_none_though_it_ends_opposite_as_sharply() -> None:
    nadir, rho_rad = np.array([0.05, -0.02, 1.0]), np.radians(10.0)
    nadir /= np.linalg.norm(nadir)
    fix = fix_of(strip_of(np.inf), nadir, rho_rad)
    assert fix.status is Status.OK, fix.reason
    assert off_rad(fix, nadir) < np.radians(0.02)


def test_where_a_mask_says_that_the_craft_hides_the_ground_it_is_none() -> None:
    behind = np.ones((480, 640), np.uint8)
    pixels = np.argwhere(behind)[:, ::-1].astype(float)
    depth_px = CAMERA.fx * (RHO_RAD - np.arccos(CAMERA.rays(pixels) @ NADIR))
    behind[(depth_px > 36.0).reshape(behind.shape)] = 0
    assert fix_of(strip_of(40.0), NADIR, RHO_RAD).status is Status.NO_LIMB
    fix = fix_of(strip_of(40.0), NADIR, RHO_RAD, Mask(behind))
    assert fix.status is Status.OK, fix.reason
    assert off_rad(fix, NADIR) < np.radians(0.02)
