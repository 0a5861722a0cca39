"""Sensors that lose what they see too much at a slant: where a curved surface fades is no edge."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from horizon_sensor_ros.core.mathematics.rigid import (
    inverse_pose,
    pose_matrix,
    vector_from_rotation,
)
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.core.target_motion.registration import Registration, register
from horizon_sensor_ros.core.target_motion.target_view import target_view
from horizon_sensor_ros.sim.shapes import TriangleMesh, assembly, box, cylinder, revolved
from horizon_sensor_ros.sim.tof_camera import ToFCamera

CAMERA = ToFCamera(width=204, height=204, range_noise_m=0.005, range_max_m=20.0)
FINE = ToFCamera(width=480, height=480, pixel_pitch_m=17e-6, range_noise_m=0.005, range_max_m=20.0)
TURN_RAD = np.radians(4.0)


def stage() -> TriangleMesh:
    """A rocket's stage with a dome and the open bell of its engine."""
    dome = [(0.4, 0.95), (0.25, 1.05), (0.0, 1.1)]
    bell = revolved([(0.12, -0.85), (0.22, -1.05), (0.35, -1.3)])
    return assembly([bell, revolved([(0.0, -0.8), (0.5, -0.8), (0.5, 0.8), *dome])])


def cone() -> TriangleMesh:
    return revolved([(0.0, -0.6), (0.6, -0.6), (0.0, 0.6)], 192)


def boxes() -> TriangleMesh:
    """Flat faces of which some are seen nearly as much at a slant as any."""
    return assembly([box((0.9, 0.7, 0.8)), box((0.3, 1.5, 0.1), (0.2, 0.0, 0.5))])


def cloud(
    mesh: TriangleMesh, pose: np.ndarray, lost_deg: float, camera: ToFCamera, seed: int
) -> np.ndarray:
    """Returns without those whose incidence is larger."""
    scan = camera.scan(mesh, pose, np.random.default_rng(seed))
    points = np.array(scan.points)
    points[~(camera.cosines(mesh, pose) > np.cos(np.radians(lost_deg)))] = np.nan
    return points


def turned_in_place(
    mesh: TriangleMesh, lost_deg: float, camera: ToFCamera, seed: int
) -> tuple[Registration, np.ndarray]:
    """What is found of a turn about the body's own axis, and the truth."""
    start = Rotation.random(random_state=seed).as_matrix()
    turn = Rotation.from_rotvec([0.0, 0.0, TURN_RAD]).as_matrix()
    poses = [
        pose_matrix(rotation, np.array([across, 0.05, 5.0]))
        for rotation, across in ((start, 0.1), (start @ turn, 0.12))
    ]
    a, b = (
        target_view(cloud(mesh, pose, lost_deg, camera, 2 * seed + k))
        for k, pose in enumerate(poses)
    )
    return register(a, b), poses[1] @ inverse_pose(poses[0])


@pytest.mark.parametrize("lost_deg", [75.0, 70.0, 62.0])
@pytest.mark.parametrize("body", [lambda: cylinder(0.5, 1.4, 240), stage, cone])
def test_a_body_of_revolution_that_fades_gets_no_answer(
    body: Callable[[], TriangleMesh], lost_deg: float
) -> None:
    mesh = body()
    found = [turned_in_place(mesh, lost_deg, CAMERA, seed)[0] for seed in range(8)]
    assert [each.status for each in found].count(Status.OK) == 0


def test_nor_does_one_seen_in_fine_pixels() -> None:
    """Of which a window spans less, so that a surface bends less within a few of them."""
    mesh = cylinder(0.5, 1.4, 240)
    found = [turned_in_place(mesh, 70.0, FINE, seed)[0] for seed in range(4)]
    assert [each.status for each in found].count(Status.OK) == 0


def test_faces_that_are_seen_nearly_as_steeply_keep_their_edges() -> None:
    mesh = boxes()
    squared = []
    for seed in range(10):
        found, truth = turned_in_place(mesh, 75.0, CAMERA, seed)
        if found.status is not Status.OK:
            continue
        turn = vector_from_rotation(found.pose_b_from_a[:3, :3] @ truth[:3, :3].T)
        squared.append(turn @ np.linalg.solve(found.covariance[:3, :3], turn))
    assert len(squared) >= 8
    assert np.median(squared) < 6.0
    assert max(squared) < 16.0
