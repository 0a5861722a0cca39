"""The roll of bodies that little but small parts keeps from being ones of revolution: known as well
as is said, and not drawn towards no roll.
"""

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
from horizon_sensor_ros.core.target_motion.registration import register
from horizon_sensor_ros.core.target_motion.target_view import target_view
from horizon_sensor_ros.sim.shapes import TriangleMesh, assembly, box, revolved
from horizon_sensor_ros.sim.tof_camera import ToFCamera

MISSING = 0.01


def tank(rng: np.random.Generator) -> TriangleMesh:
    """A tank with domes, and two to four boxes on its barrel."""
    radius, half = rng.uniform(0.25, 0.45), rng.uniform(0.5, 0.8)
    dome = [(0, half + 0.3 * radius), (0.7 * radius, half + 0.2 * radius), (radius, half)]
    parts = [revolved([(across, -along) for across, along in dome] + dome[::-1])]
    for _ in range(rng.integers(2, 5)):
        size = rng.uniform(0.05, 0.14, 3) * (1, 1, rng.choice([1, 4]))
        turn = Rotation.from_euler("z", rng.uniform(0, 360), degrees=True).as_matrix()
        part = box(size, (radius + size[0] / 2 - 0.01, 0, rng.uniform(-0.8, 0.8) * half))
        parts.append(part.moved(turn))
    return assembly(parts)


def stage(_: np.random.Generator) -> TriangleMesh:
    """A rocket stage with a raceway and two boxes; and the open bell of its engine."""
    bell = revolved([(0.35, -2.5), (0.8, -3.6)])
    barrel = revolved([(0, -2.5), (1.2, -2.5), (1.2, 2.5), (0.7, 3.3), (0, 3.3)])
    boxes = [box((0.25, 0.2, 4.2), (1.28, 0, 0.2)), box((0.5, 0.4, 0.4), (-0.6, 1.15, 1.5))]
    return assembly([bell, barrel, *boxes, box((0.3, 0.5, 0.6), (-0.3, -1.25, -1.2))])


def rolls(
    body: Callable[[np.random.Generator], TriangleMesh],
    roll_deg: float,
    seeds: range,
    range_noise_m: float = 0.004,
    distance_m: float = 5.3,
) -> tuple[np.ndarray, np.ndarray]:
    """Errors along the roll and claimed sigmas, degrees, of the motions that were let through."""
    camera = ToFCamera(range_noise_m=range_noise_m, range_max_m=40.0)
    errors, sigmas = [], []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        mesh = body(rng)
        start = Rotation.random(random_state=seed)
        axis = start.as_matrix()[:, 2]
        turn = Rotation.from_rotvec(np.radians(roll_deg) * axis)
        place = np.array([0.1, -0.05, distance_m])
        poses = [pose_matrix(each.as_matrix(), place) for each in (start, turn * start)]
        clouds = [camera.scan(mesh, pose, rng).points for pose in poses]
        for cloud in clouds:
            cloud[rng.random(cloud.shape[:2]) < MISSING] = np.nan
        truth = poses[1] @ inverse_pose(poses[0])
        found = register(target_view(clouds[0]), target_view(clouds[1]), None, truth)
        if found.status is Status.OK:
            off = vector_from_rotation(found.pose_b_from_a[:3, :3] @ truth[:3, :3].T)
            errors.append(np.degrees(off @ axis))
            sigmas.append(np.degrees(np.sqrt(axis @ found.covariance[:3, :3] @ axis)))
    return np.array(errors), np.array(sigmas)


@pytest.mark.parametrize("roll_deg", [2.0, pytest.param(6.0, marks=pytest.mark.slow)])
def test_the_roll_of_a_tank_with_boxes_is_known_as_well_as_claimed(roll_deg: float) -> None:
    errors, sigmas = rolls(tank, roll_deg, range(100, 130))
    assert len(errors) > 8
    off = errors / sigmas
    assert np.sqrt(np.mean(off**2)) < 1.25
    assert np.abs(off).max() < 3.5
    assert abs(off.mean()) < 0.55


def test_thin_rims_seen_from_afar_do_not_hold_the_roll() -> None:
    # Pixels are 8 cm wide, and what stands out on the body two or three of them. A rim a pixel wide
    # looks alike however the body has rolled.
    errors, sigmas = rolls(stage, 3.0, range(60), 0.003, 25.6)
    assert len(errors) > 20
    assert np.sqrt(np.mean((errors / sigmas) ** 2)) < 1.4
    assert np.mean(np.abs(errors) > 0.5) < 0.05
    assert np.abs(errors).max() < 1.5
