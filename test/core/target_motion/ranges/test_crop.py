"""Clouds cropped to a box: nothing but what is in it is looked at."""

import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from target_messages import CAMERA, scan, stamp_of, truth_at

from horizon_sensor_ros.core.mathematics.rigid import inverse_pose, vector_from_rotation
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.core.target_motion.config import TrackerConfig
from horizon_sensor_ros.core.target_motion.ranges.crop import Crop
from horizon_sensor_ros.core.target_motion.ranges.cropped import with_cropped
from horizon_sensor_ros.core.target_motion.ranges.range_image import range_image
from horizon_sensor_ros.core.target_motion.target_view import target_view
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
    cropped, outside = Crop(least_m, most_m).split(points)
    assert len(outside) == np.count_nonzero(np.isnan(cropped[:, 0]))
    for point, left in zip(points, cropped, strict=True):
        inside = all(a <= x <= b for a, x, b in zip(least_m, point, most_m, strict=True))
        assert np.array_equal(left, point if inside else [np.nan] * 3, equal_nan=True)
    assert np.array_equal(points, before, equal_nan=True)


def test_without_a_box_the_cloud_is_not_copied() -> None:
    points = scan(0)
    assert Crop().split(points)[0] is points


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


def behind_an_arm(nearer_m: float, farther_m: float) -> np.ndarray:
    """A plate of 1.6 m, 4 m away, right third hidden by what is nearer, before what is farther."""
    rays = CAMERA.rays()
    across, down = np.moveaxis(rays[..., :2] / rays[..., 2:], -1, 0)
    depth = np.where(np.maximum(np.abs(across), np.abs(down)) < 0.2, 4.0, farther_m)
    depth = np.where(across > 0.07, nearer_m, depth)
    depth += np.random.default_rng(3).normal(0.0, 0.004, depth.shape)
    return np.stack([across * depth, down * depth, depth], axis=-1)


def ends_at(points: np.ndarray, crop: Crop) -> np.ndarray:
    """x/z of the places where the plate is taken to end at a side."""
    kept, cropped = crop.split(points)
    surface = target_view(kept, None, cropped).surface
    assert surface is not None
    edges = surface.edges
    upright = np.abs(edges.directions[:, 1]) > 0.9
    return np.asarray(edges.points[upright, 0] / edges.points[upright, 2])


def test_what_hides_the_target_makes_no_end_of_it_and_what_is_behind_does() -> None:
    crop = Crop((-3.0, -3.0, 3.0), (3.0, 3.0, 5.0))
    at = ends_at(behind_an_arm(2.0, 7.0), crop)
    assert np.count_nonzero(np.abs(at + 0.2) < 0.01) > 10
    assert not (np.abs(at - 0.07) < 0.02).any()
    # The same arm far behind the plate hides nothing: the plate ends before it.
    at = ends_at(behind_an_arm(7.0, 7.0), crop)
    assert np.count_nonzero(np.abs(at - 0.07) < 0.01) > 10


@pytest.mark.parametrize("mixes", [True, False])
def test_an_outline_that_mixed_pixels_draw_in_is_claimed_for_it(*, mixes: bool) -> None:
    """A plate 4 m away before a wall at 7 m, its right side moved through a pixel. The range of one
    that shows both lies between, and is cropped; or is that of what it shows more of.
    """
    rays = CAMERA.rays()
    across, down = np.moveaxis(rays[..., :2] / rays[..., 2:], -1, 0)
    pitch = across[0, 1] - across[0, 0]
    crop = Crop((-3.0, -3.0, 3.0), (3.0, 3.0, 4.1))
    off_sigma = []
    for right in 0.1 + pitch * np.linspace(0.0, 1.0, 21):
        covered = np.clip((right - across) / pitch + 0.5, 0.0, 1.0)
        covered *= np.maximum(np.abs(down), -across) < 0.2
        covered = covered if mixes else covered > 0.5
        depth = 4.0 * covered + 7.0 * (1.0 - covered)
        depth += np.random.default_rng(3).normal(0.0, 0.004, depth.shape)
        kept, cropped = crop.split(np.stack([across * depth, down * depth, depth], axis=-1))
        surface = target_view(kept, None, cropped).surface
        assert surface is not None
        edges = surface.edges
        at = edges.points[:, 0] / edges.points[:, 2]
        of_side = (np.abs(edges.directions[:, 1]) > 0.9) & (at > 0.0)
        assert np.count_nonzero(of_side) > 20
        off_sigma.append(4.0 * (at[of_side] - right).mean() / edges.alike_m[of_side].mean())
    assert 0.7 < np.sqrt(np.mean(np.square(off_sigma))) < 1.3


def test_where_the_box_cuts_the_target_it_does_not_end() -> None:
    at = ends_at(behind_an_arm(7.0, 7.0), Crop((-0.4, -3.0, 3.0), (3.0, 3.0, 5.0)))
    assert not (np.abs(at + 0.1) < 0.02).any()
    assert np.count_nonzero(np.abs(at - 0.07) < 0.01) > 10


def test_garbled_bytes_outside_the_box_are_no_returns() -> None:
    """Every kind of NaN, infinities, numbers of any size."""
    image = range_image(scan(0))
    rng = np.random.default_rng(8)
    garbled = np.frombuffer(rng.bytes(12 * 100_000), np.float32).reshape(-1, 3)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        unknown = with_cropped(image, garbled).unknown
    assert np.count_nonzero(unknown & ~image.unknown) < 0.2 * unknown.size


def test_a_target_behind_an_arm_that_is_cropped_is_followed() -> None:
    tracker = TargetTracker(TrackerConfig(crop=Crop((-3.0, -3.0, 2.5), (3.0, 3.0, 6.0))))
    rays = CAMERA.rays()
    row, column = np.indices(rays.shape[:2])
    frame = np.eye(4)
    for index in range(10):
        points = scan(index).copy()
        along = np.radians(30.0 + 3.0 * index)
        arm = np.abs((column - 47.5) * np.cos(along) + (row - 47.5) * np.sin(along)) < 4.0
        points[arm] = 1.8 * rays[arm]
        fix = tracker.process(points, stamp_of(index))
        assert fix.status is Status.OK, fix.reason
        if index == 0:
            frame = inverse_pose(truth_at(0)) @ fix.pose_sensor_from_target
        truth, found = truth_at(index) @ frame, fix.pose_sensor_from_target
        turn = vector_from_rotation(truth[:3, :3] @ found[:3, :3].T)
        error = np.concatenate([turn, truth[:3, 3] - found[:3, 3]])
        assert error @ np.linalg.solve(fix.covariance, error) < 22.5  # 99.9 % of six unknowns
