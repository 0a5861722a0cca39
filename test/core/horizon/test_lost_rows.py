"""Frames of which rows were lost on the way, and whole ones that hold one value along a border."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from limb_frames import CAMERA, as_frames, clouds, draw, limb_views

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.cameras.mask import Mask
from horizon_sensor_ros.core.horizon.fix import Frame
from horizon_sensor_ros.core.horizon.lost_rows import lost_rows
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.sim.earth_scene import Imaging
from horizon_sensor_ros.sim.poses import camera_from_fov, rot_from_axis

ALTITUDE_M = 500e3
VIEWS = limb_views(ALTITUDE_M, azimuths_rad=(0.0, 1.5))
FRAMES = as_frames(VIEWS, draw(VIEWS, ALTITUDE_M, clouds(3), Imaging(noise_dn=1.5)))


def without(gray: np.ndarray, first: int, count: int, fill: int) -> np.ndarray:
    """The image as it arrives without some of its rows."""
    rest = np.delete(gray, range(first, first + count), axis=0)
    return np.concatenate([rest, np.full((count, gray.shape[1]), fill, gray.dtype)])


@pytest.mark.parametrize("fill", [0, 128, 255])
@pytest.mark.parametrize("count", [6, 30, 100])
def test_a_frame_that_lost_rows_is_refused(count: int, fill: int) -> None:
    damaged = [Frame(f.view, without(f.gray, 200, count, fill)) for f in FRAMES]
    assert f"its {count} last rows hold nothing but the value {fill}" in lost_rows(
        damaged[0].gray, None
    )
    fix = HorizonSensor().process(damaged[:1])
    assert fix.status is Status.BAD_IMAGE
    assert "was a part of the frame lost?" in fix.reason
    assert np.isnan(fix.fit.nadir_base).all()
    # Of two cameras the other one decides.
    fix = HorizonSensor().process([damaged[0], FRAMES[1]])
    assert fix.cameras_used == ("camera_2",)
    assert fix.limbs[0].status is Status.BAD_IMAGE


@pytest.mark.parametrize("height", [16, 20, 300, 480])
def test_however_many_lines_were_lost(height: int) -> None:
    rng = np.random.default_rng(height)
    gray = rng.integers(5, 200, (height, 400)).astype(np.uint8)
    for count in range(max(4, -(-height // 100)), height):
        fill = np.zeros((count, 400), np.uint8)
        assert f"its {count} last rows" in lost_rows(np.vstack([gray[count:], fill]), None)


@pytest.mark.parametrize("turns", range(4))
def test_it_may_be_any_border(turns: int) -> None:
    gray = np.rot90(without(FRAMES[0].gray, 100, 20, 16), turns)
    where = ("last rows", "last columns", "first rows", "first columns")[turns]
    assert f"its 20 {where} hold nothing" in lost_rows(np.ascontiguousarray(gray), None)


def test_bars_that_a_mask_leaves_out_are_none() -> None:
    gray = FRAMES[0].gray.copy()
    gray[-12:], gray[:12] = 0, 0
    use = np.ones(gray.shape, dtype=np.uint8)
    use[-12:] = 0
    assert "first rows" in lost_rows(gray, Mask(use))
    use[:12] = 0
    assert lost_rows(gray, Mask(use)) == ""
    view = replace(VIEWS[0], mask=Mask(use))
    assert HorizonSensor().process([Frame(view, gray)]).ok


@pytest.mark.parametrize("roll_rad", [0.0, 0.02, 0.3, 1.57, 3.14159])
@pytest.mark.parametrize("altitude_m", [30e3, 500e3, 36e6])
def test_space_that_is_clipped_and_ground_that_is_even_are_no_loss(
    altitude_m: float, roll_rad: float
) -> None:
    """Without a noise, and however the limb lies in the frame."""
    views = limb_views(altitude_m, CAMERA, roll_rad=roll_rad)
    _not_lost(views, altitude_m)


@pytest.mark.parametrize("tilt_rad", [0.0, 0.002, 0.005])
@pytest.mark.parametrize(("fov_deg", "altitude_m"), [(25, 20e3), (15, 20e3), (8, 35e3), (8, 100e3)])
def test_nor_is_a_limb_that_is_all_but_straight(
    fov_deg: float, altitude_m: float, tilt_rad: float
) -> None:
    camera = camera_from_fov(640, 480, np.radians(fov_deg))
    # Level in the frame: the camera's y towards nadir.
    for view in limb_views(altitude_m, camera, roll_rad=0.0):
        z = view.rot_base_from_cam[:, 2]
        x = np.cross([0.0, 0.0, 1.0], z)
        x /= np.linalg.norm(x)
        level = np.column_stack((x, np.cross(z, x), z)) @ rot_from_axis([0.0, 0.0, 1.0], tilt_rad)
        _not_lost((replace(view, rot_base_from_cam=level),), altitude_m)


def _not_lost(views: tuple[CameraView, ...], altitude_m: float) -> None:
    (drawn,) = draw(views, altitude_m, None, Imaging(noise_dn=0.0))
    for gray in (drawn.image, np.where(drawn.image < 12, 0, drawn.image).astype(np.uint8)):
        assert lost_rows(gray, None) == ""


def test_a_few_lines_and_whole_frames_of_one_value_are_no_loss() -> None:
    gray = FRAMES[0].gray.copy()
    gray[-3:] = 0
    assert lost_rows(gray, None) == ""
    for level in (0, 255):
        assert lost_rows(np.full((480, 640), level, np.uint8), None) == ""
    view = CameraView("camera_1", CAMERA, np.eye(3))
    fix = HorizonSensor().process([Frame(view, np.zeros((480, 640), np.uint8))])
    assert fix.status is not Status.BAD_IMAGE
