"""Clouds that a driver has averaged over time."""

import importlib
from collections.abc import Iterator

import numpy as np
import pytest

from horizon_sensor_ros.core.mathematics.rigid import pose_matrix, rotation_from_vector
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.core.target_motion.noise.temporal_filter import TemporalFilter
from horizon_sensor_ros.core.target_motion.ranges.range_image import range_image
from horizon_sensor_ros.core.target_motion.target_fix import TargetFix
from horizon_sensor_ros.core.target_motion.tracker import TargetTracker
from horizon_sensor_ros.sim.shapes import TARGETS, box
from horizon_sensor_ros.sim.tof_camera import ToFCamera

CAMERA = ToFCamera()
NOISE_M, MOST_M, NEW = 0.005, 0.03, 0.4
BEFORE, CLOUDS = 3, 6


def clouds(name: str, *, averaged: bool = False, pattern_m: float = 0.0) -> Iterator[np.ndarray]:
    """Of a target that turns by 0.8 deg and moves by a pixel each, with a driver's filter that has
    run for some clouds, or with pixels that are each off by something that stays.
    """
    rng = np.random.default_rng(4)
    target, rays = TARGETS[name](), CAMERA.rays()
    shape = CAMERA.height, CAMERA.width
    pattern = rng.normal(0.0, pattern_m, shape)
    axis = np.radians(0.8) * np.array([0.6, 0.64, 0.48])
    start = rotation_from_vector(np.array([0.4, 0.5, 0.1]))
    held = np.full(shape, np.nan)
    for k in range(-BEFORE, CLOUDS):
        place = np.array([0.02 * k, 0.01 * k, 5.0])
        pose = pose_matrix(rotation_from_vector(k * axis) @ start, place)
        ranges = CAMERA.ranges(target, pose) + pattern + rng.normal(0.0, NOISE_M, shape)
        if averaged:
            near = np.abs(ranges - held) < MOST_M
            ranges = held = np.where(near, NEW * ranges + (1 - NEW) * held, ranges)
        if k >= 0:
            yield (rays * ranges[..., None]).astype(np.float32)


def answers(name: str, *, averaged: bool = False, pattern_m: float = 0.0) -> list[TargetFix]:
    tracker = TargetTracker()
    seen = clouds(name, averaged=averaged, pattern_m=pattern_m)
    return [tracker.process(points, k * 200_000_000) for k, points in enumerate(seen)]


def poses_of(fixes: list[TargetFix]) -> int:
    """How many are let through, after a first one."""
    return sum(fix.status is Status.OK and not fix.new_frame for fix in fixes)


@pytest.mark.parametrize("name", ["winged_cylinder", "l_truss"])
def test_clouds_averaged_over_time_are_refused(name: str) -> None:
    """Of the truss all of them were let through, off by many sigma."""
    fixes = answers(name, averaged=True)
    assert poses_of(fixes) == 0
    assert any("temporal filter" in fix.reason for fix in fixes)


@pytest.mark.parametrize("name", ["n1", "n5"])
def test_independent_noise_is_not_taken_for_a_filter(name: str) -> None:
    assert poses_of(answers(name)) == CLOUDS - 1


@pytest.mark.usefixtures("modules_of_the_benchmark")
def test_relief_that_moves_by_two_pixels_is_not_taken_for_a_filter() -> None:
    """Of a tumbling truss, where it is narrow: eleven of these clouds were refused."""
    rng = np.random.default_rng([1, 10])
    poses = importlib.import_module("target.pairs").tumbling(10.0, 200, 5.0, rng)[:34]
    tracker, truss = TargetTracker(), TARGETS["l_truss"]()
    fixes = [
        tracker.process(CAMERA.scan(truss, pose, rng).points, k * 200_000_000)
        for k, pose in enumerate(poses)
    ]
    assert poses_of(fixes) == len(fixes) - 1


@pytest.mark.parametrize("name", ["n1", "n5"])
def test_a_pattern_of_the_pixels_costs_one_cloud_at_most(name: str) -> None:
    assert poses_of(answers(name, pattern_m=NOISE_M)) >= CLOUDS - 2


def told_of(new: float, seed: int) -> list[bool]:
    """What clouds of a board that moves by a pixel and a half each tell, with a driver's filter
    that takes up so little of each new one; 0: a pattern that stays. Half as much noise besides is
    of each cloud alone, as of digits that are dropped.
    """
    rng, of_driver = np.random.default_rng(seed), TemporalFilter()
    camera, board = ToFCamera(width=64, height=48), box((0.6, 0.6, 0.1))
    shape = camera.height, camera.width
    step_m = 1.5 * 5.0 / camera.focal_px
    held_m = rng.normal(0.0, NOISE_M, shape)
    told = []
    for k in range(14):
        place = np.array([(k % 4 - 1.5) * step_m, k // 4 % 2 * step_m, 5.0])
        pose = pose_matrix(np.eye(3), place)
        ranges = camera.ranges(board, pose) + held_m + rng.normal(0.0, 0.6 * NOISE_M, shape)
        of_new = rng.normal(0.0, NOISE_M, shape)
        held_m = (1.0 - new) * held_m + np.sqrt(new * (2.0 - new)) * of_new
        image = range_image((camera.rays() * ranges[..., None]).astype(np.float32))
        if k:
            told.append(of_driver.told(image, NOISE_M, pose))
        else:
            of_driver.start(image, NOISE_M, pose)
    return told


@pytest.mark.parametrize("seed", range(3))
def test_a_filter_that_takes_up_little_of_each_cloud_is_told_from_a_pattern_by_eight(
    seed: int,
) -> None:
    """From one cloud to the next but one such noise fades too little to tell."""
    assert all(told_of(0.03, seed)[-5:])
    assert not any(told_of(0.0, seed)[1:])
