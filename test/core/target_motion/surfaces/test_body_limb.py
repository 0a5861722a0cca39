"""The limb of a curved body: no edge of it, and no planes to trust; a cylinder in closed form."""

import numpy as np
import pytest

from horizon_sensor_ros.core.mathematics.rigid import pose_matrix, rotation_from_vector
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.core.target_motion.ranges.range_image import range_image
from horizon_sensor_ros.core.target_motion.registration import register
from horizon_sensor_ros.core.target_motion.surfaces.edges.detection import find_edges
from horizon_sensor_ros.core.target_motion.surfaces.planes import local_planes
from horizon_sensor_ros.core.target_motion.target_view import target_view

FOCAL_PX, SIDE_PX = 320.0, 204
RADIUS_M, HALF_M = 0.3, 0.6
PLACE_M = np.array([0.02, -0.05, 3.0])
_U, _V = np.meshgrid(*2 * [np.arange(SIDE_PX) - (SIDE_PX - 1) / 2])
RAYS = np.stack([_U / FOCAL_PX, _V / FOCAL_PX, np.ones_like(_U)], axis=-1)
AXES = [(0.0, 1.0, 0.2), (0.35, 0.9, 0.3), (0.7, 0.7, -0.3)]
# 4, 5 and 8 mm: windows of 5 and 7 pixels, noise of up to nine tenths of a pixel's width.
NOISES_M = [0.004, 0.005, 0.008]


def axis_of(axis: tuple[float, float, float]) -> np.ndarray:
    """(3,) unit."""
    return np.array(axis) / np.linalg.norm(axis)


def cylinder_cloud(
    axis: np.ndarray, place: np.ndarray, noise_m: float, rng: np.random.Generator
) -> np.ndarray:
    """(H, W, 3) returns of a cylinder with both its ends."""
    across = RAYS - (RAYS @ axis)[..., None] * axis
    off = -(place - (place @ axis) * axis)
    a, b, c = (across**2).sum(axis=-1), across @ off, off @ off - RADIUS_M**2
    with np.errstate(invalid="ignore", divide="ignore"):
        depths = [(-b - np.sqrt(b * b - a * c)) / a]
        depths[0][np.abs((depths[0][..., None] * RAYS - place) @ axis) > HALF_M] = np.inf
        for end in (-HALF_M, HALF_M):
            depth = (place @ axis + end) / (RAYS @ axis)
            inside = depth[..., None] * RAYS - (place + end * axis)
            inside -= (inside @ axis)[..., None] * axis
            outside = np.linalg.norm(inside, axis=-1) > RADIUS_M
            depths.append(np.where(outside | (depth <= 0), np.inf, depth))
    depth = np.nanmin(np.where(np.isnan(depths), np.inf, depths), axis=0)
    depth += rng.normal(0, noise_m, depth.shape) / np.linalg.norm(RAYS, axis=-1)
    return RAYS * np.where(np.isfinite(depth), depth, np.nan)[..., None]


def barrels_normals(points: np.ndarray, axis: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Normals (N, 3) of the barrel at points, and their heights above its middle (N,)."""
    arm = points - PLACE_M
    height = arm @ axis
    arm = arm - height[:, None] * axis
    return arm / np.linalg.norm(arm, axis=1, keepdims=True), height


@pytest.mark.parametrize("noise_m", NOISES_M)
@pytest.mark.parametrize("axis", AXES)
def test_own_planes_do_not_lean_at_the_limb(
    axis: tuple[float, float, float], noise_m: float
) -> None:
    """Those of windows that the limb cuts off leaned by 5 to 10 deg towards the sensor."""
    unit = axis_of(axis)
    cloud = cylinder_cloud(unit, PLACE_M, noise_m, np.random.default_rng(3))
    planes = local_planes(range_image(cloud, FOCAL_PX))
    own = np.flatnonzero(planes.own)
    points = planes.points[own].astype(float)
    truth, height = barrels_normals(points, unit)
    on_barrel = np.abs(height) < 0.7 * HALF_M
    sight = -points / np.linalg.norm(points, axis=1, keepdims=True)
    cosine = np.einsum("ij,ij->i", truth, sight)
    of_plane = np.einsum("ij,ij->i", planes.normals[own], sight)
    lean_deg = np.degrees(np.arccos(np.clip(cosine, -1, 1)) - np.arccos(np.clip(of_plane, -1, 1)))
    for low, high in ((-1.0, 0.2), (0.2, 0.35), (0.35, 0.5), (0.5, 0.7), (0.7, 1.1)):
        some = on_barrel & (cosine >= low) & (cosine < high)
        assert np.abs(lean_deg[some]).sum() < 4.0 * max(np.count_nonzero(some), 3)
        assert lean_deg[some].sum() < 1.0 * max(np.count_nonzero(some), 3)
    assert np.count_nonzero(on_barrel) > 2000


def test_a_slanted_face_keeps_its_planes_up_to_its_ends() -> None:
    pose = pose_matrix(rotation_from_vector(np.array([0.1, 1.2, 0.3])), PLACE_M)
    normal = pose[:3, 2]
    depth = (PLACE_M @ normal) / (RAYS @ normal)
    inside = (RAYS * depth[..., None] - PLACE_M) @ pose[:3, :2]
    depth[(np.abs(inside) > (0.7, 0.4)).any(axis=-1)] = np.nan
    depth += np.random.default_rng(0).normal(0, 0.004, depth.shape)
    planes = local_planes(range_image(RAYS * depth[..., None], FOCAL_PX))
    assert np.median(planes.cosine[planes.found]) < 0.4
    whole = planes.found & planes.own
    assert np.count_nonzero(whole) > 0.85 * np.count_nonzero(planes.found)


@pytest.mark.parametrize("noise_m", NOISES_M)
@pytest.mark.parametrize("axis", AXES)
def test_a_limb_is_no_edge_and_the_ends_of_a_barrel_are(
    axis: tuple[float, float, float], noise_m: float
) -> None:
    """Eighty to two hundred lay along the limbs, a part of them creases."""
    unit = axis_of(axis)
    cloud = cylinder_cloud(unit, PLACE_M, noise_m, np.random.default_rng(5))
    image = range_image(cloud, FOCAL_PX)
    edges = find_edges(image, local_planes(image))
    height = np.abs((edges.points - PLACE_M) @ unit)
    # Away from the ends, which a pixel slanted by its window may be short of.
    assert np.count_nonzero(height < 0.8 * HALF_M) <= 8
    assert np.count_nonzero(np.abs(height - HALF_M) < 0.05) > 50


@pytest.mark.parametrize("noise_m", NOISES_M)
def test_the_roll_of_a_cylinder_is_not_known(noise_m: float) -> None:
    """Every second one was told, to 0.3 deg and 3 deg off, with noise alone."""
    for seed in range(4):
        rng = np.random.default_rng(seed)
        axis = axis_of(AXES[seed % len(AXES)])
        after = PLACE_M + rng.normal(0, 0.004, 3)
        a, b = (
            target_view(cylinder_cloud(axis, place, noise_m, rng)) for place in (PLACE_M, after)
        )
        roll = rotation_from_vector(axis * np.radians(3.0))
        found = register(a, b, None, pose_matrix(roll, after - roll @ PLACE_M))
        assert found.status is Status.ILL_CONDITIONED
        turn = found.weak[0, :3] / np.linalg.norm(found.weak[0, :3])
        assert np.abs(turn @ axis) > 0.99


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("far", [1.7, 2.5])
def test_nothing_is_borrowed_from_the_limb(axis: tuple[float, float, float], far: float) -> None:
    """Pixels farther in took on planes of windows at the limb: 9 to 11 deg off in the median."""
    unit = axis_of(axis)
    cloud = cylinder_cloud(unit, far * PLACE_M, 0.003, np.random.default_rng(3))
    planes = local_planes(range_image(cloud, FOCAL_PX))
    borrowed = np.flatnonzero(planes.found & ~planes.own & ~planes.limb)
    points = planes.points[borrowed].astype(float)
    truth, height = barrels_normals(points + (1 - far) * PLACE_M, unit)
    lean = np.einsum("ij,ij->i", truth, planes.normals[borrowed]) < np.cos(np.radians(8.0))
    assert np.count_nonzero(lean & (np.abs(height) < 0.7 * HALF_M)) <= 1


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize(("far", "noise_m"), [(2.0, 0.01), (2.5, 0.01), (2.0, 0.015)])
def test_planes_near_the_limb_lie_on_the_barrel(
    axis: tuple[float, float, float], far: float, noise_m: float
) -> None:
    """Where few whole windows are left to tell that it is curved, those that the limb cuts off were
    believed: in the mean 3 to 5 mm behind the barrel, in both views, and motions 3 mm off.
    """
    unit, off_m = axis_of(axis), []
    for seed in range(6):
        cloud = cylinder_cloud(unit, far * PLACE_M, noise_m, np.random.default_rng(seed))
        planes = local_planes(range_image(cloud, FOCAL_PX))
        points = planes.points[(planes.found & ~planes.limb).ravel()].astype(float)
        truth, height = barrels_normals(points + (1 - far) * PLACE_M, unit)
        sight = -points / np.linalg.norm(points, axis=1, keepdims=True)
        slanted = np.einsum("ij,ij->i", truth, sight) < 0.7
        behind = np.einsum("ij,ij->i", points - far * PLACE_M, truth) - RADIUS_M
        off_m.append(behind[slanted & (np.abs(height) < 0.7 * HALF_M)])
    assert len(np.concatenate(off_m)) > 200
    assert np.abs(np.mean(np.concatenate(off_m))) < 0.002
