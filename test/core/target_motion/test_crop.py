"""Clouds cropped to a box: nothing but what is in it is looked at."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from target_messages import CAMERA, scan, stamp_of

from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.core.target_motion.config import TrackerConfig
from horizon_sensor_ros.core.target_motion.ranges.crop import Crop
from horizon_sensor_ros.core.target_motion.tracker import TargetTracker

BEFORE_THE_WALL = Crop((-2.0, -2.0, 2.0), (2.0, 2.0, 5.5))


def before_a_wall(index: int) -> np.ndarray:
    """The target, and 6 m away a wall where the sensor sees past it."""
    points, rays = scan(index).copy(), CAMERA.rays()
    noise = np.random.default_rng([index, 9]).normal(0.0, 0.005, points.shape[:2])
    wall = rays * ((6.0 + noise) / rays[..., 2])[..., None]
    past = ~np.isfinite(points[..., 2])
    points[past] = wall[past]
    return points


@given(
    arrays(np.float32, (7, 3), elements=st.floats(-4.0, 4.0, width=32) | st.just(np.nan)),
    st.tuples(*[st.floats(-3.0, 0.0)] * 3),
    st.tuples(*[st.floats(0.5, 3.0)] * 3),
)
def test_what_is_outside_is_no_return_and_what_is_inside_stays(
    points: np.ndarray, least_m: tuple[float, ...], most_m: tuple[float, ...]
) -> None:
    before = points.copy()
    cropped = Crop(least_m, most_m).of(points)
    for point, left in zip(points, cropped, strict=True):
        inside = all(a <= x <= b for a, x, b in zip(least_m, point, most_m, strict=True))
        assert np.array_equal(left, point if inside else [np.nan] * 3, equal_nan=True)
    assert np.array_equal(points, before, equal_nan=True)


def test_without_a_box_the_cloud_is_not_copied() -> None:
    points = scan(0)
    assert Crop().of(points) is points


@pytest.mark.parametrize(
    ("corners", "words"),
    [
        (((0.0, 0.0), (1.0, 1.0, 1.0)), "least_m must be three numbers"),
        (((0.0, 0.0, 0.0), (1.0, 1.0, np.nan)), "most_m must be three numbers"),
        (((0.0, 0.0, -np.inf), (1.0, 1.0, 1.0)), "least_m must be three numbers"),
        (((0.0, 2.0, 0.0), (1.0, 1.0, 1.0)), "least_m must be below most_m"),
    ],
)
def test_a_box_that_is_none_is_refused(corners: tuple, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        Crop(*corners)


def test_a_target_before_a_wall_moves_as_without_it() -> None:
    cropped, alone = TargetTracker(TrackerConfig(crop=BEFORE_THE_WALL)), TargetTracker()
    for index in range(4):
        found = cropped.process(before_a_wall(index), stamp_of(index))
        expected = alone.process(scan(index), stamp_of(index))
        assert found.status is Status.OK
        assert np.array_equal(found.pose_sensor_from_target, expected.pose_sensor_from_target)
        assert np.array_equal(found.covariance, expected.covariance)


def test_a_box_with_nothing_in_it_is_said() -> None:
    tracker = TargetTracker(TrackerConfig(crop=Crop((-1.0, -1.0, 50.0), (1.0, 1.0, 60.0))))
    fix = tracker.process(scan(0), stamp_of(0))
    assert fix.status is Status.TOO_FEW_POINTS
    assert "within the box of the crop" in fix.reason
