"""Frames that show no limb have no fix, those that hardly show one say so."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest
from horizon_fixes import (
    NADIR,
    SENSOR,
    SQUARE,
    assert_refused,
    clouded_pair,
    error_deg,
    scenes_of,
    sigma_deg,
)
from limb_frames import CAMERA, as_frames, clouds, draw, limb_views, unlike_any_limb

from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.horizon.fix import Frame
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.sim.earth_scene import Imaging, Occluder
from horizon_sensor_ros.sim.poses import camera_from_fov, side_views


@pytest.mark.parametrize("name", sorted(unlike_any_limb(48, 64)))
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_frames_without_a_horizon(name: str, dtype: type) -> None:
    gray = unlike_any_limb()[name].astype(dtype) * dtype(1 if dtype is np.uint8 else 257)
    views = side_views(CAMERA)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert_refused(SENSOR.process([Frame(views[0], gray)]), 1)
        assert_refused(SENSOR.process([Frame(view, gray) for view in views]), 2)


@pytest.mark.parametrize(
    "shape", [(1, 1), (1, 50), (8, 8), (16, 16), (17, 31), (16, 400), (40, 2000)]
)
def test_tiny_and_thin_images(shape: tuple[int, int]) -> None:
    view = CameraView("camera", camera_from_fov(shape[1], shape[0], 1.0), np.eye(3))
    rng = np.random.default_rng(0)
    step = np.zeros(shape, np.uint8)
    step[shape[0] // 2 :] = 200
    for gray in (np.zeros(shape, np.uint8), rng.integers(0, 255, shape).astype(np.uint8), step):
        fix = SENSOR.process([Frame(view, gray)])
        assert_refused(fix, 1)
        if min(shape) < 16:
            assert fix.status is Status.BAD_IMAGE
            assert f"{shape[1]} x {shape[0]}" in fix.reason


def test_planet_inside_out() -> None:
    frames = [replace(f, gray=255 - f.gray) for f in clouded_pair()]
    assert_refused(SENSOR.process(frames), 2)


def test_night_has_no_fix() -> None:
    for scene in scenes_of("night", 2):
        assert scene.expect == "none"
        assert_refused(SENSOR.process(as_frames(scene.views, scene.frames)), 2)


@pytest.mark.parametrize("level", [255, 130])
def test_flooded_frames(level: int) -> None:
    """Stray light all over one camera's frame: the other decides, or there is no fix."""
    one, two = clouded_pair()
    y, x = np.mgrid[:480, :640]
    glare = level * np.exp(-((x - 320.0) ** 2 + (y - 240.0) ** 2) / 3e5)
    flooded = replace(one, gray=np.clip(one.gray + glare, 0, 255).astype(np.uint8))
    alone = SENSOR.process([flooded])
    assert not alone.ok or error_deg(alone, NADIR) < 5.0 * sigma_deg(alone)
    fix = SENSOR.process([flooded, two])
    if fix.ok:
        assert error_deg(fix, NADIR) < max(0.1, 5.0 * sigma_deg(fix))
    else:
        assert_refused(fix, 2)


def test_boom_across_the_limb() -> None:
    views = limb_views(500e3, azimuths_rad=SQUARE, roll_rad=0.1)
    for x, brightness in ((200.0, 40.0), (400.0, 180.0)):
        bar = Occluder(
            ((x, -9.0), (x + 50.0, -9.0), (x + 20.0, 489.0), (x - 30.0, 489.0)), brightness
        )
        imaging = (Imaging(noise_dn=1.5, occluders=(bar,)), Imaging(noise_dn=1.5))
        fix = SENSOR.process(as_frames(views, draw(views, 500e3, clouds(2), imaging)))
        assert fix.ok, fix.reason
        assert "camera_2" in fix.cameras_used
        assert error_deg(fix, NADIR) < max(0.1, 4.0 * sigma_deg(fix))


def test_a_covered_lens() -> None:
    one, two = clouded_pair()
    for level in (0, 255):
        blind = replace(one, gray=np.full_like(one.gray, level))
        fix = SENSOR.process([blind, two])
        assert fix.ok, fix.reason
        assert fix.cameras_used == ("camera_2",)
        assert fix.limbs[0].reason
        assert error_deg(fix, NADIR) < max(0.2, 5.0 * sigma_deg(fix))


def test_the_sun_alone_raises_no_warning() -> None:
    """Taken for a disc from far away, no air is in sight above it."""
    rows, columns = np.indices((480, 640))
    radius_px = np.hypot(columns - 245.0, rows - 62.0)
    noise = np.random.default_rng(3).normal(0.0, 1.0, radius_px.shape)
    gray = np.clip(5751.0 / (1.0 + (radius_px / 16.0) ** 3.5) + 4.0 + noise, 0.0, 255.0)
    (view,) = limb_views(400e3)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fix = HorizonSensor().process([Frame(view, gray.astype(np.uint8))])
    assert not fix.ok or fix.fit.altitude_m > 9e6


@pytest.mark.parametrize("shape", [(16, 2000), (33, 3000), (2000, 16), (100, 2048)])
def test_strips_are_frames_too(shape: tuple[int, int]) -> None:
    """Of a line camera, or a region of interest: lower than a tile of the reduced frame."""
    height, width = shape
    focal_px = float(max(shape))
    camera = Camera(width, height, focal_px, focal_px, width / 2.0, height / 2.0)
    view = CameraView("strip", camera, np.eye(3))
    noise = np.random.default_rng(1).integers(0, 256, shape, dtype=np.uint8)
    step = np.full(shape, 30, np.uint8)
    step[height // 2 :] = 200
    for image in (noise, step):
        assert not SENSOR.process([Frame(view, image)]).ok
