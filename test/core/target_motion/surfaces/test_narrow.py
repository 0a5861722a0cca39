"""Curved parts that are hardly wider than a window, and how far behind them its planes pass."""

import numpy as np
import pytest
from registered_motion import motion_nees

from horizon_sensor_ros.core.mathematics.rigid import pose_matrix, rotation_from_vector
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.core.target_motion.ranges.range_image import range_image
from horizon_sensor_ros.core.target_motion.registration import register
from horizon_sensor_ros.core.target_motion.surfaces.planes import local_planes
from horizon_sensor_ros.core.target_motion.target_view import target_view
from horizon_sensor_ros.sim.shapes import TriangleMesh, assembly, box, cylinder
from horizon_sensor_ros.sim.tof_camera import ToFCamera

CAMERA = ToFCamera(width=160, height=120, pixel_pitch_m=58e-6, range_max_m=12.0, range_noise_m=0.01)
RADIUS_M = 0.1  # some four pixels
UPRIGHT = rotation_from_vector(np.array([np.pi / 2, 0.0, 0.0]))
CROSS = assembly(
    [
        cylinder(RADIUS_M, 2.0, 64),
        cylinder(RADIUS_M, 1.4, 64).moved(UPRIGHT, (0.0, 0.0, 0.25)),
    ]
)


def window_radius(target: TriangleMesh, noise_m: float, distance_m: float) -> int:
    pose = pose_matrix(UPRIGHT, np.array([0.0, 0.0, distance_m]))
    points = CAMERA.scan(target, pose, np.random.default_rng(0)).points
    return local_planes(range_image(points), noise_m).radius_px


def test_windows_grow_with_the_noise_as_far_as_the_target_is_wide() -> None:
    rod, wide = cylinder(RADIUS_M, 2.0), box((2.0, 1.5, 1.0))
    assert [window_radius(wide, noise, 6.0) for noise in (0.01, 0.02, 0.05)] == [2, 3, 5]
    assert [window_radius(rod, noise, 6.0) for noise in (0.01, 0.02)] == [2, 2]


@pytest.mark.parametrize("num", [25, pytest.param(100, marks=pytest.mark.slow)])
def test_motions_of_thin_cylinders_are_claimed_as_they_are_known(num: int) -> None:
    """In some of the views the noise comes out so large that wider windows would do for it. Their
    planes pass 7 mm behind the cylinders, where those of the other views do not: NEES is 12.7 in
    the mean, and 90 at most.
    """
    rng = np.random.default_rng(5)
    nees = []
    for _ in range(num):
        start = rotation_from_vector(rng.normal(size=3))
        turn = rotation_from_vector(np.radians(rng.normal(0.0, 6.0, 3)))
        place = np.array([*rng.uniform(-0.2, 0.2, 2), rng.uniform(5.5, 6.5)])
        moved = place + np.array([0.05, 0.0, 0.02])
        poses = [pose_matrix(start, place), pose_matrix(turn @ start, moved)]
        found = register(*(target_view(CAMERA.scan(CROSS, pose, rng).points) for pose in poses))
        if found.status is Status.OK:
            nees.append(motion_nees(found, poses))
    assert len(nees) > 0.7 * num
    assert np.mean(nees) < 10
    assert max(nees) < 45
