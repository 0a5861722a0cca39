"""Foil that is crumpled finer than the windows of planes, and what it makes ranges seem."""

from __future__ import annotations

import numpy as np
from registered_motion import motion_nees

from horizon_sensor_ros.core.mathematics.rigid import pose_matrix, rotation_from_vector
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.core.target_motion.alignment.relief import range_error_of_relief_m
from horizon_sensor_ros.core.target_motion.registration import register
from horizon_sensor_ros.core.target_motion.target_view import target_view
from horizon_sensor_ros.sim.shapes import TriangleMesh, assembly, box
from horizon_sensor_ros.sim.tof_camera import ToFCamera

CAMERA = ToFCamera(width=160, height=160, pixel_pitch_m=51e-6, range_noise_m=0.004)
CELL_M = 0.02


def foil(rng: np.random.Generator, relief_m: float) -> TriangleMesh:
    """A box whose faces bulge at random from cell to cell, but not at its edges; and a small one
    beside it.
    """
    size = rng.uniform(0.6, 1.0, 3)
    parts = [box((0.3, 0.02, 0.3), (0.0, 0.75, 0.0)), box((0.05, 0.4, 0.05), (0.0, 0.55, 0.0))]
    for axis in range(3):
        one, other = (i for i in range(3) if i != axis)
        num = int(max(size) / CELL_M)
        grid = np.linspace(-0.5, 0.5, num)
        u, v = np.meshgrid(grid, grid, indexing="ij")
        inner = (np.abs(u) < 0.5) & (np.abs(v) < 0.5)
        first = np.arange(num * num).reshape(num, num)[:-1, :-1].ravel()
        faces = np.concatenate(
            [
                np.stack([first, first + 1, first + num], axis=1),
                np.stack([first + 1, first + num + 1, first + num], axis=1),
            ]
        )
        for side in (-0.5, 0.5):
            vertices = np.empty((num, num, 3))
            vertices[..., one], vertices[..., other] = u * size[one], v * size[other]
            vertices[..., axis] = side * size[axis] + inner * relief_m * rng.normal(size=u.shape)
            parts.append(TriangleMesh(vertices.reshape(-1, 3), faces))
    return assembly(parts)


def pair_of(rng: np.random.Generator, turn_deg: float) -> list[np.ndarray]:
    """Poses (4, 4) some 4 m away, the second turned by so much about any axis."""
    start = rotation_from_vector(2.0 * rng.normal(size=3))
    axis = rng.normal(size=3)
    turn = rotation_from_vector(np.radians(turn_deg) * axis / np.linalg.norm(axis))
    place = np.array([*rng.uniform(-0.1, 0.1, 2), rng.uniform(3.5, 4.5)])
    moved = place + np.array([0.03, 0.0, 0.02])
    return [pose_matrix(start, place), pose_matrix(turn @ start, moved)]


def test_relief_is_told_from_noise() -> None:
    """What is alike in both views is, and of flat faces nothing."""
    found = []
    for relief_m in (0.0, 0.01):
        rng = np.random.default_rng(3)
        target, poses = foil(rng, relief_m), pair_of(rng, 6.0)
        a, b = (target_view(CAMERA.scan(target, pose, rng).points).surface for pose in poses)
        assert a is not None
        assert b is not None
        motion = poses[1] @ np.linalg.inv(poses[0])
        turn_a, turn_b = (view.image.rot_sensor_from_view for view in (a, b))
        rotation, shift_m = turn_b.T @ motion[:3, :3] @ turn_a, turn_b.T @ motion[:3, 3]
        found.append(range_error_of_relief_m(a, b, rotation, shift_m))
    # Windows follow a part of it, and one sigma is twice the rest.
    assert found[0] == 0.0
    assert 0.005 < found[1] < 0.02


def test_motions_of_crumpled_foil_are_claimed_about_as_they_are_known() -> None:
    """Without what is asked for relief NEES is 22 in the mean, and above 22.5 in 25 of 60."""
    rng = np.random.default_rng(11)
    nees = []
    for _ in range(60):
        target = foil(rng, 0.012)
        poses = pair_of(rng, rng.uniform(8.0, 20.0))
        scans = (CAMERA.scan(target, pose, rng).points for pose in poses)
        found = register(*map(target_view, scans), None, poses[1] @ np.linalg.inv(poses[0]))
        if found.status is Status.OK:
            nees.append(motion_nees(found, poses))
    assert len(nees) > 50
    assert np.mean(nees) < 14.0
    assert np.count_nonzero(np.array(nees) > 22.5) < 10
