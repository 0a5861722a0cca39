"""Cameras that show one image again and again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from limb_frames import as_frames, clouds, draw, limb_views
from scipy.spatial.transform import Rotation

from horizon_sensor_ros.core.aiding import Aiding
from horizon_sensor_ros.core.horizon.fix import Frame
from horizon_sensor_ros.core.horizon.repeated_images import RepeatedImages
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.sim.earth_scene import Imaging

PERIOD_S = 0.1
VIEWS = limb_views(500e3, azimuths_rad=(0.0, 1.5))
FRAMES = as_frames(VIEWS, draw(VIEWS, 500e3, clouds(2), Imaging(noise_dn=1.5), 1))


def turning(rate_deg_s: float) -> Aiding:
    """What a gyro tells of a set."""
    rate = np.array([0.0, np.radians(rate_deg_s), 0.0])
    turn = Rotation.from_rotvec(-rate * PERIOD_S).as_matrix()
    return Aiding(rot_now_from_last=turn, rate_base_rad_s=rate, since_last_s=PERIOD_S)


def noisy(frame: Frame, seed: int) -> Frame:
    """The same scene in another image."""
    noise = np.random.default_rng(seed).integers(0, 2, frame.gray.shape, dtype=np.uint8)
    return Frame(frame.view, np.minimum(frame.gray, 254) + noise)


def test_a_picture_that_is_published_again_and_again_is_answered() -> None:
    sensor = HorizonSensor()
    assert all(sensor.process(FRAMES, Aiding(since_last_s=PERIOD_S)).ok for _ in range(8))


@pytest.mark.parametrize("rate_deg_s", [0.05, 0.2])
def test_a_gyros_bias_is_no_turn(rate_deg_s: float) -> None:
    images = RepeatedImages()
    for _ in range(100):
        assert not any(one.unusable for one in images.marked(FRAMES, turning(rate_deg_s)))


def test_a_gyros_glitch_is_no_turn() -> None:
    images = RepeatedImages()
    glitch = replace(turning(200.0), rate_base_rad_s=np.zeros(3))
    for told in (turning(0.0), glitch, turning(0.0), turning(0.0)):
        assert not any(one.unusable for one in images.marked(FRAMES, told))


@pytest.mark.parametrize("rate_deg_s", [0.5, 1.0, 5.0])
def test_a_camera_is_frozen_where_the_craft_turns(rate_deg_s: float) -> None:
    sensor = HorizonSensor()
    fixes = [sensor.process(FRAMES[:1], turning(rate_deg_s)) for _ in range(6)]
    # No fix is of an image since which the craft had turned far beyond what the gyro leaves open:
    # the limb is known to some hundredths of a pixel.
    ok = [fix.ok for fix in fixes]
    assert ok[0]
    assert not any(ok[1:])
    assert fixes[-1].status is Status.BAD_IMAGE
    assert "the very same image again, though the craft has turned by" in fixes[-1].reason
    # A live image ends it. (With the gyro this one, too, would be of what does not turn.)
    assert sensor.process([noisy(FRAMES[0], 1)], Aiding(since_last_s=PERIOD_S)).ok


def test_a_camera_is_frozen_where_another_ones_images_change() -> None:
    sensor = HorizonSensor()
    for step in range(8):
        fix = sensor.process([FRAMES[0], noisy(FRAMES[1], step)])
        assert fix.cameras_used == (("camera_1", "camera_2") if step < 2 else ("camera_2",))
    assert fix.limbs[0].status is Status.BAD_IMAGE
    assert "other cameras' images have changed" in fix.limbs[0].reason


def test_what_is_no_image_is_forgotten() -> None:
    sensor = HorizonSensor()
    with pytest.raises(ValueError, match="must be"):
        sensor.process([Frame(VIEWS[0], [[1, 2], [3, 4]])])  # type: ignore[arg-type]
    assert sensor.process(FRAMES[:1]).ok


def test_images_that_differ_in_one_pixel_are_not_the_same() -> None:
    images = RepeatedImages()
    for step in range(20):
        gray = FRAMES[0].gray.copy()
        gray[100 + step, 7] += 1
        marked = images.marked([Frame(VIEWS[0], gray)], turning(10.0))
        assert marked[0].unusable == ""
