"""Targets of which something hides a part, in either view another one."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from horizon_sensor_ros.core.mathematics.rigid import (
    inverse_pose,
    pose_matrix,
    vector_from_rotation,
)
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.core.target_motion.alignment.consistency import view_consistency
from horizon_sensor_ros.core.target_motion.judgement.hidden_patch import scores_but_for_a_patch
from horizon_sensor_ros.core.target_motion.registration import Registration, register
from horizon_sensor_ros.core.target_motion.target_view import TargetView, target_view
from horizon_sensor_ros.core.target_motion.tracker import TargetTracker
from horizon_sensor_ros.sim.shapes import TARGETS
from horizon_sensor_ros.sim.tof_camera import ToFCamera, ToFDisturbances

MESHES = {name: build() for name, build in TARGETS.items()}


def views(
    name: str, seed: int, turn_deg: float, hidden: float = 0.1
) -> tuple[TargetView, TargetView, np.ndarray]:
    """Both, and the true motion between them."""
    rng = np.random.default_rng([seed, 71])
    before = pose_matrix(Rotation.random(random_state=seed).as_matrix(), np.array([0.1, -0.1, 5.3]))
    axis = rng.normal(size=3)
    turn = Rotation.from_rotvec(axis / np.linalg.norm(axis) * np.radians(turn_deg)).as_matrix()
    after = pose_matrix(turn @ before[:3, :3], before[:3, 3] + rng.uniform(-0.08, 0.08, 3))
    patch = ToFDisturbances(occluded_fraction=hidden)
    a, b = (ToFCamera().scan(MESHES[name], pose, rng, patch).points for pose in (before, after))
    return target_view(a), target_view(b), after @ inverse_pose(before)


def off_deg(found: Registration, truth: np.ndarray) -> float:
    turn = vector_from_rotation(found.pose_b_from_a[:3, :3].T @ truth[:3, :3])
    return float(np.degrees(np.linalg.norm(turn)))


@pytest.mark.parametrize("name", ["n1", "n5"])
def test_a_box_with_a_patch_hidden_is_not_taken_for_one_that_turned_by_a_side(name: str) -> None:
    answered = 0
    for seed in range(12):
        a, b, truth = views(name, seed, 15.0)
        found = register(a, b)
        if found.status is Status.OK:
            answered += 1
            assert off_deg(found, truth) < 1.0
    assert answered >= 10


def test_a_turn_by_a_side_is_not_excused_by_a_patch() -> None:
    """What such a turn leaves unexplained is in several places."""
    for seed in range(8):
        a, b, truth = views("n1", seed, 75.0, hidden=0.0)
        found = register(a, b)
        assert found.status is not Status.OK or off_deg(found, truth) < 1.0


def test_with_a_patch_left_out_nothing_speaks_against_the_truth() -> None:
    as_seen = []
    for seed in range(6):
        a, b, truth = views("n5", seed, 15.0)
        assert a.surface is not None
        assert b.surface is not None
        rot_b, rot_a = b.image.rot_sensor_from_view, a.image.rot_sensor_from_view
        turn, shift = truth[:3, :3], truth[:3, 3]
        away = rot_b.T @ Rotation.from_rotvec([0.0, 0.0, 0.2]).as_matrix() @ turn @ rot_a
        turns = np.array([rot_b.T @ turn @ rot_a, away])
        moved = turn @ a.image.sensor_m + shift - b.image.sensor_m
        shifts = np.array([rot_b.T @ moved, b.image.centroid_m - away @ a.image.centroid_m])
        seen = view_consistency(a.surface, b.surface, turns, shifts, 300, 1.0).score
        true, turned = scores_but_for_a_patch(a.surface, b.surface, turns, shifts)
        as_seen.append(seen[0])
        assert true > 0.97
        assert turned < 0.95
    assert np.mean(as_seen) < 0.93


@pytest.mark.parametrize("name", ["n1", "plate_with_dish"])
def test_a_track_goes_on_while_an_arm_that_was_cropped_passes(name: str) -> None:
    """A bar without returns, 14 pixels wide, turns by a degree a cloud about the frame's middle."""
    rng = np.random.default_rng(71)
    camera, tracker = ToFCamera(), TargetTracker()
    start = Rotation.random(random_state=5).as_matrix()
    refused, frame = 0, np.eye(4)
    for k in range(24):
        turn = Rotation.from_rotvec(np.radians(0.6 * k) * np.array([0.5, 0.7, -0.5])).as_matrix()
        pose = pose_matrix(turn @ start, np.array([0.0, 0.0, 5.3]))
        cloud = camera.scan(MESHES[name], pose, rng).points
        row, column = np.indices(cloud.shape[:2])
        along = np.radians(40.0 + k)
        across = (column - 101.5) * np.cos(along) + (row - 101.5) * np.sin(along)
        cloud[np.abs(across) < 7.0] = np.nan
        fix = tracker.process(cloud, k * 200_000_000)
        refused += fix.status is not Status.OK
        if fix.new_frame:
            assert k == 0
            frame = inverse_pose(pose) @ fix.pose_sensor_from_target
        elif fix.status is Status.OK:
            off = vector_from_rotation(
                fix.pose_sensor_from_target[:3, :3].T @ (pose @ frame)[:3, :3]
            )
            assert np.degrees(np.linalg.norm(off)) < 1.0
    assert refused <= 1
