"""Any cloud as a range image; rigid motions; what is fitted to the image."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from horizon_sensor_ros.core.mathematics.rigid import (
    inverse_pose,
    orthonormal,
    pose_matrix,
    rotation_from_vector,
    skew,
    vector_from_rotation,
)
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.core.target_motion.ranges.range_image import range_image
from horizon_sensor_ros.core.target_motion.surfaces.planes import local_planes
from horizon_sensor_ros.core.target_motion.surfaces.surface_view import surface_view
from horizon_sensor_ros.sim.shapes import TARGETS, box, revolved, sich_n1
from horizon_sensor_ros.sim.tof_camera import ToFCamera, ToFScan

vectors = st.lists(st.floats(-3, 3), min_size=3, max_size=3).map(np.array)


def scan_of(name: str, seed: int, noise: float = 0.005) -> ToFScan:
    pose = pose_matrix(Rotation.random(random_state=seed).as_matrix(), np.array([0.1, -0.1, 5.2]))
    camera = ToFCamera(range_noise_m=noise)
    return camera.scan(TARGETS[name](), pose, np.random.default_rng(seed))


@given(vectors)
def test_rotations_are_scipys(vector: np.ndarray) -> None:
    rotation = rotation_from_vector(vector)
    assert np.allclose(rotation, Rotation.from_rotvec(vector).as_matrix(), atol=1e-9)
    back = vector_from_rotation(rotation)
    assert np.allclose(rotation_from_vector(back), rotation, atol=1e-6)
    assert np.linalg.norm(back) <= np.pi + 1e-9


@given(vectors)
def test_half_turns_come_back(vector: np.ndarray) -> None:
    if np.linalg.norm(vector) < 1e-3:
        return
    half = Rotation.from_rotvec(vector / np.linalg.norm(vector) * np.pi).as_matrix()
    assert np.allclose(rotation_from_vector(vector_from_rotation(half)), half, atol=1e-6)


def test_small_helpers() -> None:
    a, b = np.array([1.0, 2, 3]), np.array([-2.0, 0.5, 4])
    assert np.allclose(skew(a) @ b, np.cross(a, b))
    pose = pose_matrix(Rotation.random(random_state=1).as_matrix(), a)
    assert np.allclose(inverse_pose(pose) @ pose, np.eye(4))
    assert np.allclose(orthonormal(pose[:3, :3] * 1.001), pose[:3, :3])


def test_an_organised_cloud_keeps_its_pixels() -> None:
    scan = scan_of("n5", 0)
    image = range_image(scan.points)
    assert image.status is Status.OK
    assert image.focal_px == pytest.approx(320, rel=1e-5)
    tan_u, tan_v = image.tangents()
    row, column = np.nonzero(image.inverse_depth)
    depth = 1 / image.inverse_depth[row, column]
    again = np.column_stack([tan_u[column] * depth, tan_v[row] * depth, depth])
    order = np.lexsort(again.round(3).T)
    kept = scan.plain()[np.isin(scan.plain()[:, 2].round(4), depth.round(4))]
    assert len(again) > 0.97 * len(scan.plain())
    assert np.abs(again[order].mean(axis=0) - kept.mean(axis=0)).max() < 2e-3


def test_a_plain_cloud_in_any_order_gives_the_same_image() -> None:
    scan = scan_of("n5", 1)
    organised = range_image(scan.points)
    shuffled = np.random.default_rng(0).permutation(scan.plain())
    twice = np.concatenate([shuffled, shuffled[::3]])
    for cloud in (shuffled, twice, twice.astype(np.float64)):
        plain = range_image(cloud)
        assert plain.focal_px == pytest.approx(organised.focal_px, rel=1e-4)
        assert plain.inverse_depth.shape == organised.inverse_depth.shape
        assert np.allclose(plain.inverse_depth, organised.inverse_depth, atol=1e-6)


def test_points_strewn_at_random_make_an_image_with_few_holes() -> None:
    rng = np.random.default_rng(2)
    flat = np.column_stack([rng.uniform(-1, 1, (5000, 2)), np.full(5000, 3.0)])
    image = range_image(flat)
    inner = image.inverse_depth[12:-12, 12:-12]
    assert np.mean(inner > 0) > 0.7


@pytest.mark.parametrize("arm", [0.04, 0.1])
def test_pixels_are_as_wide_as_the_points_lie_apart_whatever_the_targets_shape(arm: float) -> None:
    """Of a plus with arms a tenth as wide as long pixels were twice as wide, as those of the box
    around it.
    """
    rng = np.random.default_rng(4)
    along, across = rng.uniform(-0.5, 0.5, 2500), rng.uniform(-arm / 2, arm / 2, 2500)
    spot = np.where(np.arange(2500)[:, None] % 2, np.c_[along, across], np.c_[across, along])
    image = range_image(np.column_stack([spot, np.ones(2500)]) * 5.0)
    area = 2 * arm - arm * arm
    assert 1 / image.focal_px == pytest.approx(np.sqrt(2 * area / 2500), rel=0.2)


def barrel(rows: int, columns: int, focal_px: float) -> np.ndarray:
    """(rows, columns, 2) x/z and y/z of the pixels of a lens with barrel distortion."""
    u, v = np.meshgrid(np.arange(columns) - columns / 2, np.arange(rows) - rows / 2)
    spot = np.stack([u, v], axis=-1) / focal_px
    return spot * (1 + 0.5 * (spot**2).sum(axis=-1, keepdims=True))


@pytest.mark.parametrize(
    "spot",
    [
        np.random.default_rng(2).uniform(-0.1, 0.1, (6000, 2)), barrel(100, 100, 320.0),
        barrel(200, 200, 320.0), barrel(100, 100, 320.0) * (1, 1.03),
        barrel(100, 100, 320.0) @ Rotation.from_euler("z", 1, degrees=True).as_matrix()[:2, :2],
    ],
    ids=["strewn", "weak barrel", "barrel", "narrow pixels", "rolled"],
)  # fmt: skip
def test_pixels_show_the_depth_in_their_middle(spot: np.ndarray) -> None:
    """The nearest return of a pixel, as if it were in the middle, was 1.6 mm short of this plane
    on average.
    """
    normal = np.array([0.5, -0.3, 1.0])
    depth = 5.0 / (spot @ normal[:2] + 1)
    image = range_image(np.concatenate([spot, np.ones_like(spot[..., :1])], -1) * depth[..., None])
    row, column = np.nonzero(image.inverse_depth)
    tan_u, tan_v = image.tangents()
    truth = 5.0 / (tan_u[column] * normal[0] + tan_v[row] * normal[1] + 1)
    error = 1 / image.inverse_depth[row, column] - truth
    assert len(row) > 2000
    assert abs(error.mean()) < 1e-4
    assert np.sqrt(np.mean(error**2)) < 3e-4


def test_a_pixel_that_holds_two_surfaces_shows_the_nearer_one() -> None:
    rng = np.random.default_rng(1)
    spot = rng.uniform(-0.1, 0.1, (8000, 2))
    depth = np.where(spot[:, 0] > 0.03 * np.sin(40 * spot[:, 1]), 4.0, 6.0)
    image = range_image(np.column_stack([spot, np.ones(len(spot))]) * depth[:, None])
    seen = 1 / image.inverse_depth[image.inverse_depth > 0]
    assert np.minimum(abs(seen - 4), abs(seen - 6)).max() < 1e-4


@pytest.mark.parametrize(
    "stray", [(0.02, 0.0, 0.05), (0.3011, 0.3012, 5.0), (0.0, 0.0, 0.002), (9.0, -8.0, 6.0)]
)
@pytest.mark.parametrize("organised", [True, False])
def test_a_stray_point_changes_nothing(stray: tuple[float, ...], organised: bool) -> None:
    """One of them sent the whole cloud to pixels twice as wide."""
    scan = scan_of("n5", 1)
    clean = range_image(scan.points)
    cloud = scan.points.copy()
    assert np.isnan(cloud[5, 7]).all()
    cloud[5, 7] = stray
    if not organised:
        cloud = cloud[np.isfinite(cloud[..., 2])]
    image = range_image(cloud)
    assert image.focal_px == pytest.approx(clean.focal_px, rel=1e-4)
    assert image.num_used == pytest.approx(clean.num_used, abs=2)
    assert image.num_points == clean.num_points + 1


def test_a_lidars_frame_is_brought_forward() -> None:
    scan = scan_of("n1", 3)
    lidar = scan.plain()[:, [2, 0, 1]] * (1, -1, -1)  # x forward, y left, z up
    image = range_image(lidar)
    assert image.status is Status.OK
    assert np.linalg.det(image.rot_sensor_from_view) == pytest.approx(1)
    centroid = image.rot_sensor_from_view @ image.centroid_m
    assert np.allclose(centroid, lidar.mean(axis=0), atol=1e-6)
    assert image.num_used == range_image(scan.plain()).num_used


def wall_by_lidar(half_height_m: float) -> np.ndarray:
    """(N, 3) a lidar's 64 lines, 15 deg up and down, on a wall 4 m ahead that leans a little."""
    azimuth, elevation = np.radians(np.meshgrid(np.arange(-22, 22, 0.2), np.linspace(-15, 15, 64)))
    ray = np.stack([np.cos(azimuth), np.sin(azimuth), np.tan(elevation)], axis=-1)
    points = ray * (4.0 / (ray @ [1.0, 0.1, 0.15]))[..., None]
    return points[np.abs(points[..., 2]) < half_height_m]


def test_a_lidars_highest_and_lowest_line_are_no_edges() -> None:
    """They are bent in the image: of a wall that goes on, and of one that ends before them."""
    for half_height_m, cut in ((9.0, True), (0.8, False)):
        image = range_image(wall_by_lidar(half_height_m))
        x, y = image.tangents()
        ray = image.rot_sensor_from_view @ np.stack(
            [*np.meshgrid(x, y), np.ones((len(y), len(x)))]
        ).reshape(3, -1)
        elevation_deg = np.degrees(np.arctan2(ray[2], np.hypot(ray[0], ray[1])))
        unknown = image.unknown.ravel()
        beside = np.abs(ray[1] / ray[0]) < 0.3
        for side in (1, -1):
            farther = beside & (side * elevation_deg > 15.6) & (side * elevation_deg < 17.0)
            assert np.count_nonzero(farther) > 20 or not cut
            assert (unknown[farther] == cut).all()
        assert not unknown[beside & (np.abs(elevation_deg) < 10.0)].any()


@pytest.mark.parametrize(
    "cloud",
    [
        np.zeros((0, 3)), np.zeros((0, 0, 3)), np.full((300, 3), np.nan), np.zeros((3000, 3)),
        np.full((300, 3), 1e30), np.tile([0.1, 0.2, 3.0], (500, 1)), np.full((30, 40, 3), np.inf),
        np.column_stack([np.linspace(-1, 1, 999), np.zeros(999), np.full(999, 4.0)]),
    ],
)  # fmt: skip
def test_clouds_of_no_use_are_refused_with_a_reason(cloud: np.ndarray) -> None:
    image = range_image(cloud)
    assert image.status is Status.TOO_FEW_POINTS
    assert image.reason


def test_another_shape_is_the_callers_bug() -> None:
    with pytest.raises(ValueError, match="points"):
        range_image(np.zeros((5, 4)))
    with pytest.raises(ValueError, match="focal_px"):
        range_image(np.zeros((5, 3)), focal_px=-1.0)


@pytest.mark.parametrize("noise", [0.002, 0.005, 0.02])
def test_range_noise_is_estimated(noise: float) -> None:
    view = surface_view(range_image(scan_of("n1", 4, noise).points))
    assert view.sigma_m == pytest.approx(noise, rel=0.1)


@pytest.mark.parametrize("of_ranges", [False, True], ids=["depths", "ranges"])
@pytest.mark.parametrize(
    ("noise", "step"), [(0.005, 0.01), (0.002, 0.01), (0.002, 0.004), (0.005, 0.001)]
)
def test_ranges_told_in_whole_steps_are_not_taken_for_exact(
    noise: float, step: float, of_ranges: bool
) -> None:
    """Neighbours that are rounded to the same step looked as if there were no noise: 0.8 mm."""
    cloud = scan_of("n1", 4, noise).points.astype(float)
    measured = np.linalg.norm(cloud, axis=-1) if of_ranges else cloud[..., 2]
    cloud *= (np.round(measured / step) * step / measured)[..., None]
    image = range_image(cloud.astype(np.float32))
    assert image.range_step_m == pytest.approx(step, rel=1e-3)
    assert surface_view(image).sigma_m == pytest.approx(np.hypot(noise, step / 12**0.5), rel=0.25)


@pytest.mark.parametrize("rounded_m", [None, 1e-3], ids=["as measured", "in mm"])
@pytest.mark.parametrize(("noise_px", "step_px"), [(0.0, 1 / 16), (0.03, 1 / 16), (0.005, 1 / 32)])
def test_depths_of_a_stereo_camera_come_in_steps_of_disparity(
    noise_px: float, step_px: float, rounded_m: float | None
) -> None:
    """At 60 px m of focal length and base; noise was taken for a hundredth of a millimetre."""
    focal_base = 60.0
    cloud = scan_of("n1", 4, 0.0).points.astype(float)
    depth = cloud[..., 2]
    noise = noise_px * np.random.default_rng(0).standard_normal(depth.shape)
    disparity = np.round((focal_base / depth + noise) / step_px) * step_px
    found = focal_base / disparity
    if rounded_m is not None:
        found = np.round(found / rounded_m) * rounded_m
    image = range_image((cloud * (found / depth)[..., None]).astype(np.float32))
    of_pixel = float(np.nanmedian(depth)) ** 2 / focal_base
    assert image.range_step_m == pytest.approx(step_px * of_pixel, rel=0.1)
    expected = of_pixel * np.hypot(noise_px, step_px / 12**0.5)
    assert surface_view(image).sigma_m == pytest.approx(expected, rel=0.4)


def test_ranges_that_come_in_no_steps_have_none() -> None:
    for seed, noise in ((1, 0.005), (2, 0.0)):
        assert range_image(scan_of("n5", seed, noise).points).range_step_m == 0


def test_planes_of_a_box_have_its_normals() -> None:
    scan = scan_of("n1", 5)
    view = surface_view(range_image(scan.points))
    faces = view.surfels.normals[: view.surfels.num_planes]
    axes = scan.pose_cam_from_target[:3, :3]
    nearest = np.abs(faces @ axes).max(axis=1)
    assert np.degrees(np.arccos(np.clip(np.median(nearest), -1, 1))) < 3
    assert np.mean(nearest > np.cos(np.radians(10))) > 0.9
    # Towards the sensor.
    points = view.surfels.points[: view.surfels.num_planes]
    assert (np.einsum("ij,ij->i", faces, points) < 0).all()


def inside_outline_px(points: np.ndarray, scan: ToFScan) -> np.ndarray:
    """How far inside the convex outline of a box N1 each point (N, 3) lies."""
    pose = scan.pose_cam_from_target
    corners = sich_n1().vertices @ pose[:3, :3].T + pose[:3, 3]
    spot = corners[:, :2] / corners[:, 2:]
    turn = np.linspace(0, np.pi, 720)
    way = np.column_stack([np.cos(turn), np.sin(turn)])
    low, high = (spot @ way.T).min(axis=0), (spot @ way.T).max(axis=0)
    along = (points[:, :2] / points[:, 2:]) @ way.T
    return np.minimum(along - low, high - along).min(axis=1) * 320


@pytest.mark.parametrize("seed", [8, 12, 13])
def test_ends_of_a_box_lie_on_its_silhouette(seed: int) -> None:
    scan = scan_of("n1", seed)  # three faces, none of them at a steep slant
    edges = surface_view(range_image(scan.points)).edges
    points = edges.points[~edges.creases]
    assert len(points) > 100
    inside = inside_outline_px(points, scan)
    assert np.quantile(np.abs(inside), 0.9) < 0.4
    assert abs(np.median(inside)) < 0.1


def test_holes_are_no_ends() -> None:
    scan = scan_of("n1", 8)
    lost = np.random.default_rng(0).random(scan.points.shape[:2]) < 0.2
    points = scan.points.copy()
    points[lost] = np.nan
    edges = surface_view(range_image(points)).edges
    ends = edges.points[~edges.creases]
    assert len(ends) > 50
    assert np.mean(inside_outline_px(ends, scan) < 2) > 0.9


@pytest.mark.parametrize("seed", [8, 12, 13])
def test_creases_of_a_box_lie_on_the_edges_between_its_faces(seed: int) -> None:
    scan = scan_of("n1", seed)
    edges = surface_view(range_image(scan.points)).edges
    assert np.count_nonzero(edges.creases) > 100
    pose = scan.pose_cam_from_target
    points = (edges.points[edges.creases] - pose[:3, 3]) @ pose[:3, :3]
    half = np.abs(sich_n1().vertices).max(axis=0)
    # On two faces at once; a pixel is 17 mm wide.
    off = np.sort(np.abs(np.abs(points) - half), axis=1)[:, 1]
    assert np.median(off) < 0.005
    assert np.quantile(off, 0.95) < 0.015


def test_the_end_of_a_plate_whose_rim_shows_counts_little() -> None:
    rng = np.random.default_rng(1)
    tilted = pose_matrix(rotation_from_vector(np.array([0.7, 0, 0])), np.array([0, 0, 4.0]))
    scan = ToFCamera().scan(box((0.8, 0.6, 0.02)), tilted, rng)
    edges = surface_view(range_image(scan.points)).edges
    # Beyond the one end the rim is seen, beyond the other one it is not.
    row = edges.points[:, 1] / edges.points[:, 2]
    ends = np.abs(edges.sides[:, 1]) > 0.9
    near, far = ends & (row > np.median(row)), ends & (row < np.median(row))
    few, many = sorted(np.median(edges.sigma_m[end]) for end in (near, far))
    assert many > 8 * few


def test_a_plane_is_told_from_a_body() -> None:
    rng = np.random.default_rng(0)
    camera = ToFCamera()
    wall = camera.scan(box((1.5, 1.5, 0.1)), pose_matrix(np.eye(3), np.array([0, 0, 5.0])), rng)
    assert surface_view(range_image(wall.points)).coplanar
    assert not surface_view(range_image(scan_of("n5", 7).points)).coplanar


def test_planes_of_a_ball_lie_on_it() -> None:
    """Least squares planes pass 0.9 mm behind a dome seen from ahead, and 2 mm where it slants."""
    camera, radius = ToFCamera(range_noise_m=0.002), 0.6
    ring = [(radius * np.sin(t), -radius * np.cos(t)) for t in np.linspace(0, np.pi, 121)]
    pose = pose_matrix(np.eye(3), np.array([0.0, 0.0, 5.3]))
    ahead, slanted = [], []
    for seed in range(5):
        cloud = camera.scan(revolved(ring, 240), pose, np.random.default_rng(seed)).points
        planes = local_planes(range_image(cloud))
        own, cosine = planes.own.ravel(), planes.cosine.ravel()
        height_m = np.linalg.norm(planes.points - pose[:3, 3], axis=1) - radius
        ahead.append(height_m[own & (cosine > 0.8)].mean())
        slanted.append(height_m[own & (cosine > 0.4) & (cosine < 0.6)].mean())
    assert abs(np.mean(ahead)) < 1e-4
    assert abs(np.mean(slanted)) < 3e-4
