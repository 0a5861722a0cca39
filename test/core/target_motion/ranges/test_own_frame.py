"""Organised clouds brought into another frame: where the sensor was, and no loss to the motion."""

import numpy as np
import pytest
from registered_motion import motion_nees, pose_of

from horizon_sensor_ros.core.mathematics.rigid import (
    inverse_pose,
    pose_matrix,
    rotation_from_vector,
    vector_from_rotation,
)
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.core.target_motion.ranges.own_frame import sensor_of_returns
from horizon_sensor_ros.core.target_motion.registration import register
from horizon_sensor_ros.core.target_motion.target_view import target_view
from horizon_sensor_ros.core.target_motion.tracker import TargetTracker
from horizon_sensor_ros.sim.shapes import sich_n5
from horizon_sensor_ros.sim.tof_camera import ToFCamera

CAMERA = ToFCamera(64, 64, pixel_pitch_m=120e-6, range_noise_m=0.01)
FORWARD = np.array([[0, 0, 1.0], [-1, 0, 0], [0, -1, 0]])
# Of the sensor in the craft's frame: x forward, turned by 14 deg, aside.
MOUNTED = pose_matrix(
    rotation_from_vector(np.radians([5.0, 12.0, -4.0])) @ FORWARD, [0.4, -0.9, 0.3]
)


def brought(points: np.ndarray, mounted: np.ndarray = MOUNTED) -> np.ndarray:
    """A cloud in the craft's frame, as tf2 leaves it."""
    return (points @ mounted[:3, :3].T + mounted[:3, 3]).astype(np.float32)


@pytest.mark.parametrize("away_m", [0.0, 1.0, 100.0])
def test_the_sensor_is_where_its_rays_meet(away_m: float) -> None:
    rng = np.random.default_rng(1)
    mounted = MOUNTED.copy()
    mounted[:3, 3] *= away_m
    points = brought(CAMERA.scan(sich_n5(), pose_of(rng), rng).points, mounted)
    found = sensor_of_returns(points)
    assert found is not None
    assert np.allclose(found[0], mounted[:3, :3], atol=2e-4)
    assert np.allclose(found[1], mounted[:3, 3], atol=2e-3)


def test_clouds_of_no_pinhole_sensor_and_of_a_plane_tell_none() -> None:
    angle = np.linspace(-0.4, 0.4, 64)
    up, aside = np.meshgrid(angle, angle, indexing="ij")
    scanned = np.stack([np.cos(up) * np.cos(aside), np.cos(up) * np.sin(aside), np.sin(up)], -1)
    assert sensor_of_returns(scanned * (4 + aside[..., None] ** 2)) is None
    flat = CAMERA.rays() / CAMERA.rays()[..., 2:] * 4.0
    assert sensor_of_returns(brought(flat)) is None
    assert sensor_of_returns(np.full((20, 20, 3), np.nan, np.float32)) is None


def test_garbled_returns_do_no_harm() -> None:
    rng = np.random.default_rng(2)
    points = brought(CAMERA.scan(sich_n5(), pose_of(rng), rng).points)
    points[:2], points[2:4], points[4:6] = 1e30, np.inf, 3e4
    assert target_view(points).image.on_grid
    garbage = rng.normal(size=(30, 30, 3)) * 10.0 ** rng.uniform(-30, 30, (30, 30, 3))
    assert sensor_of_returns(garbage) is None
    assert target_view(garbage).status is not Status.OK


@pytest.mark.parametrize("missing", [np.nan, 0.0])
def test_a_motion_is_known_as_in_the_sensors_own_frame(missing: float) -> None:
    """Returns that are missing come as NaN, or as the sensor's place where they were zeros."""
    rng = np.random.default_rng(3)
    before = pose_of(rng)
    turn = rotation_from_vector(np.radians([4.0, -3.0, 5.0])) @ before[:3, :3]
    poses = before, pose_matrix(turn, before[:3, 3] + [0.03, -0.02, 0.04])
    clouds = [CAMERA.scan(sich_n5(), pose, rng).points for pose in poses]
    own = register(*(target_view(cloud) for cloud in clouds))
    filled = (np.where(np.isfinite(cloud), cloud, missing) for cloud in clouds)
    found = register(*(target_view(brought(cloud)) for cloud in filled))
    assert own.status is found.status is Status.OK
    assert motion_nees(found, tuple(MOUNTED @ pose for pose in poses)) < 20.0
    expected = MOUNTED @ own.pose_b_from_a @ inverse_pose(MOUNTED)
    off = found.pose_b_from_a @ inverse_pose(expected)
    assert np.linalg.norm(vector_from_rotation(off[:3, :3])) < 2e-4
    assert np.allclose((off @ [*found.centre_m, 1.0])[:3], found.centre_m, atol=5e-4)
    both = np.kron(np.eye(2), MOUNTED[:3, :3])
    assert np.allclose(found.covariance, both @ own.covariance @ both.T, rtol=0.05, atol=1e-9)


def test_a_track_is_told_in_the_frame_of_the_clouds() -> None:
    rng = np.random.default_rng(5)
    tracker, first, step = TargetTracker(), pose_of(rng), np.radians([1.5, 1.0, -1.0])
    for k in range(4):
        pose = pose_matrix(rotation_from_vector(k * step) @ first[:3, :3], first[:3, 3])
        fix = tracker.process(brought(CAMERA.scan(sich_n5(), pose, rng).points), k * 10**8)
        assert fix.status is Status.OK, fix.reason
        if not k:
            target = inverse_pose(MOUNTED @ pose) @ fix.pose_sensor_from_target
    off = MOUNTED @ pose @ target @ inverse_pose(fix.pose_sensor_from_target)
    turned = vector_from_rotation(off[:3, :3])
    error = np.append(turned, (MOUNTED @ pose @ target - fix.pose_sensor_from_target)[:3, 3])
    assert error @ np.linalg.solve(fix.covariance, error) < 20.0
