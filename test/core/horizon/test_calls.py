"""A caller's bugs, and frames and configurations that make no sense."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from horizon_fixes import SENSOR, assert_refused, clouded_pair

from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.cameras.white_level import full_scale
from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.core.horizon.fix import Frame
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.status import Status


@pytest.mark.parametrize(("width", "height"), [(17, 9000), (9000, 17), (15, 15), (4096, 32)])
def test_frames_too_narrow_to_search_are_refused(width: int, height: int) -> None:
    camera = Camera(width, height, 1e3, 1e3, width / 2, height / 2)
    gray = np.random.default_rng(0).integers(0, 200, (height, width)).astype(np.uint8)
    fix = SENSOR.process([Frame(CameraView("camera_1", camera, np.eye(3)), gray)])
    assert_refused(fix, 1)
    assert fix.status is Status.BAD_IMAGE
    assert f"{width} x {height}" in fix.reason


def test_frame_of_another_size_than_its_camera() -> None:
    one, two = clouded_pair()
    half = replace(one, gray=np.ascontiguousarray(one.gray[::2, ::2]))
    alone = SENSOR.process([half])
    assert_refused(alone, 1)
    assert alone.status is Status.BAD_IMAGE
    assert "320 x 240" in alone.reason
    assert "640 x 480" in alone.reason
    both = SENSOR.process([half, two])
    assert both.ok
    assert both.cameras_used == ("camera_2",)
    assert both.limbs[0].status is Status.BAD_IMAGE


@pytest.mark.parametrize(
    "gray",
    [
        np.zeros((480, 640)),
        np.zeros((480, 640), np.int16),
        np.zeros((480, 640, 3), np.uint8),
        np.zeros(480 * 640, np.uint8),
        [[0, 1], [2, 3]],
    ],
    ids=["float", "int16", "colour", "flat", "list"],
)
def test_what_is_no_gray_image_is_the_callers_bug(gray: np.ndarray) -> None:
    one, two = clouded_pair()
    with pytest.raises(ValueError, match="camera_2"):
        SENSOR.process([one, replace(two, gray=gray)])


def test_no_frames_is_the_callers_bug() -> None:
    with pytest.raises(ValueError, match="frames"):
        SENSOR.process([])


def test_two_frames_of_one_name_are_the_callers_bug() -> None:
    """Each was taken for the other one's last image, and chords for those of one camera."""
    one, two = clouded_pair()
    twice = [one, replace(two, view=replace(two.view, name=one.view.name))]
    with pytest.raises(ValueError, match="names of their own, got camera_1, camera_1"):
        SENSOR.process(twice)


def test_a_time_that_is_none_is_the_callers_bug() -> None:
    one, _ = clouded_pair()
    with pytest.raises(ValueError, match="after_s of 'camera_1' must be finite, got nan"):
        replace(one, after_s=np.nan)
    with pytest.raises(ValueError, match="after_s of 'camera_1' must be finite, got inf"):
        replace(one.view, after_s=np.inf)


def test_frames_are_left_as_they_were() -> None:
    frames = clouded_pair()[:1]
    before = [frame.gray.copy() for frame in frames]
    SENSOR.process(frames)
    for frame, copy in zip(frames, before, strict=True):
        np.testing.assert_array_equal(frame.gray, copy)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("method", "magic"),
        ("limb", "guess"),
        ("altitude_min_m", 0.0),
        ("altitude_min_m", 2e9),
        ("altitude_max_m", np.inf),
        ("altitude_max_m", np.nan),
        ("altitude_max_m", 1.0),
        ("max_nadir_sigma_rad", 0.0),
        ("max_nadir_sigma_rad", np.nan),
        ("max_residual_px", -1.0),
        ("min_contrast", np.inf),
        ("min_limb_share", 1.5),
        ("max_bright_sky", -0.1),
        ("min_clear_sky", np.nan),
        ("max_space_level", 2.0),
    ],
)
def test_configuration_that_makes_no_sense(field: str, value: object) -> None:
    with pytest.raises(ValueError, match=field):
        HorizonConfig(**{field: value})  # type: ignore[arg-type]


def test_limb_above_the_highest_altitude_makes_no_sense() -> None:
    with pytest.raises(ValueError, match="altitude_max_m"):
        HorizonConfig(planet=Planet(limb_height_m=60e3), altitude_max_m=50e3)


def test_full_scale_is_that_of_the_fewest_bits_that_hold_the_frame() -> None:
    assert full_scale(np.zeros((2, 2), np.uint8)) == 255
    for bits in (8, 10, 12, 14, 16):
        assert full_scale(np.full((2, 2), 2**bits - 1, np.uint16)) == 2**bits - 1
    assert full_scale(np.zeros((2, 2), np.uint16)) == 255
