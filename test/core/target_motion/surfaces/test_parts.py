"""Planes of thin parts."""

import numpy as np
import pytest

from horizon_sensor_ros.core.mathematics.rigid import pose_matrix, rotation_from_vector
from horizon_sensor_ros.core.target_motion.ranges.range_image import range_image
from horizon_sensor_ros.core.target_motion.surfaces.parts import find_parts
from horizon_sensor_ros.core.target_motion.surfaces.planes import local_planes
from horizon_sensor_ros.core.target_motion.surfaces.surface_view import surface_view
from horizon_sensor_ros.sim.shapes import assembly, box, sich_n1
from horizon_sensor_ros.sim.tof_camera import ToFCamera


@pytest.mark.parametrize("seed", range(4))
def test_slats_at_two_depths_have_their_normals(seed: int) -> None:
    rng = np.random.default_rng(seed)
    # Four pixels wide, every second one 0.3 m behind: hardly a window holds one of them only.
    places = enumerate(np.linspace(-0.6, 0.6, 17))
    blind = assembly([box((0.05, 1.2, 0.02), (x, 0, 0.15 * (-1) ** k)) for k, x in places])
    pose = pose_matrix(rotation_from_vector(rng.uniform(-0.6, 0.6, 3)), np.array([0.05, -0.1, 4.5]))
    parts = surface_view(range_image(ToFCamera().scan(blind, pose, rng).points)).parts
    assert len(parts) > 1000
    normal = pose[:3, 2]
    off_deg = np.degrees(np.arccos(np.minimum(np.abs(parts.normals @ normal), 1)))
    assert np.median(off_deg) < 10
    assert np.quantile(off_deg, 0.9) < 25
    assert (np.einsum("ij,ij->i", parts.normals, parts.points) < 0).all()
    # Their faces lie 0.15 m to either side of the middle, and half a slat.
    depth = np.abs(np.abs((parts.points - pose[:3, 3]) @ normal) - 0.15) - 0.01
    assert np.std(depth / parts.sigma_m) < 1


def test_parts_are_returns_without_a_plane() -> None:
    rng = np.random.default_rng(0)
    pose = pose_matrix(rotation_from_vector(np.array([0.4, 0.5, 0.2])), np.array([0, 0, 5.0]))
    image = range_image(ToFCamera().scan(sich_n1(), pose, rng).points)
    planes = local_planes(image)
    parts = find_parts(image, planes)
    assert not planes.found.ravel()[parts.place].any()
    depth = 1 / image.inverse_depth.ravel()[parts.place]
    assert np.allclose(parts.points[:, 2], depth, rtol=1e-5)
