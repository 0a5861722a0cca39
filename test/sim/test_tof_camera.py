"""The simulated time-of-flight camera against closed forms and a second way to cast rays."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from horizon_sensor_ros.sim.shapes import TARGETS, body_of_revolution, box, cylinder, sich_n5
from horizon_sensor_ros.sim.tof_camera import ToFCamera, ToFDisturbances


def pose_of(rotation: np.ndarray, z: float = 5.0, x: float = 0.0) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, (x, 0.0, z)
    return pose


def slab_ranges(camera: ToFCamera, size: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Ranges of a box by intersecting the rays with its three pairs of planes."""
    rays = camera.rays() @ pose[:3, :3]
    start = -pose[:3, 3] @ pose[:3, :3]
    with np.errstate(divide="ignore", invalid="ignore"):
        one, two = (-size / 2 - start) / rays, (size / 2 - start) / rays
    enter = np.minimum(one, two).max(axis=-1)
    leave = np.maximum(one, two).min(axis=-1)
    return np.where((enter <= leave) & (leave > 0), enter, np.nan)


@settings(max_examples=20)
@given(st.integers(0, 10_000))
def test_a_box_is_where_its_slabs_are(seed: int) -> None:
    rng = np.random.default_rng(seed)
    camera = ToFCamera(width=60, height=50)
    size = rng.uniform(0.2, 1.5, 3)
    pose = pose_of(Rotation.random(random_state=seed).as_matrix(), rng.uniform(2, 5), 0.1)
    got = camera.ranges(box(size), pose)
    expected = slab_ranges(camera, size, pose)
    differ = np.isfinite(got) != np.isfinite(expected)
    assert differ.mean() < 0.002  # rays that graze an edge
    both = np.isfinite(got) & np.isfinite(expected)
    assert both.any()
    assert np.abs(got - expected)[both].max() < 1e-9


def test_a_wall_around_the_camera_is_seen_in_every_pixel() -> None:
    camera = ToFCamera(width=40, height=30)
    got = camera.ranges(box((4.0, 4.0, 4.0)), np.eye(4))
    assert np.abs(got - 2.0 / camera.rays()[..., 2]).max() < 1e-12


def test_a_cylinder_seen_from_its_side() -> None:
    camera = ToFCamera(width=41, height=41)
    turn = Rotation.from_euler("x", 90, degrees=True).as_matrix()
    got = camera.ranges(cylinder(0.3, 1.0, 720), pose_of(turn, 3.0))
    assert got[20, 20] == pytest.approx(2.7, abs=1e-4)


def test_noise_has_its_standard_deviation_along_the_ray() -> None:
    camera = ToFCamera(range_noise_m=0.005)
    wall, pose = box((3.0, 3.0, 0.1)), pose_of(np.eye(3))
    scan = camera.scan(wall, pose, np.random.default_rng(1))
    seen = np.isfinite(scan.points[..., 0])
    points = scan.points[seen].astype(float)
    off = np.linalg.norm(points, axis=1) - camera.ranges(wall, pose)[seen]
    assert off.std() == pytest.approx(0.005, rel=0.03)
    assert np.abs(np.cross(points, camera.rays()[seen])).max() < 1e-5
    assert np.array_equal(scan.plain(), scan.points[seen])


def test_ranges_beyond_the_limits_return_nothing() -> None:
    camera, wall, pose = ToFCamera(range_max_m=4.9), box((1.0, 1.0, 0.1)), pose_of(np.eye(3))
    assert np.isfinite(camera.ranges(wall, pose)).any()
    assert not len(camera.scan(wall, pose).plain())


def test_outliers_and_occlusion_come_in_the_shares_asked_for() -> None:
    camera = ToFCamera(range_noise_m=0.0)
    pose = pose_of(Rotation.random(random_state=3).as_matrix())
    truth = camera.ranges(sich_n5(), pose)
    count = len(camera.scan(sich_n5(), pose).plain())
    hidden = camera.scan(
        sich_n5(), pose, np.random.default_rng(0), ToFDisturbances(occluded_fraction=0.1)
    )
    assert len(hidden.plain()) == pytest.approx(0.9 * count, abs=1)
    spoilt = camera.scan(
        sich_n5(), pose, np.random.default_rng(0), ToFDisturbances(outlier_fraction=0.1)
    )
    seen = np.isfinite(truth)
    ranges = np.linalg.norm(spoilt.points.astype(float), axis=-1)
    wrong = seen & (np.abs(ranges - truth) > 1e-3)
    around = ~seen & np.isfinite(ranges)
    assert wrong.sum() == pytest.approx(0.05 * count, rel=0.1)
    assert around.sum() == pytest.approx(0.05 * count, rel=0.1)


def test_a_mixed_pixel_lies_between_what_it_covers() -> None:
    camera = ToFCamera(width=80, height=80, range_noise_m=0.0)
    near, far = box((0.4, 0.4, 0.1), (0, 0, -1.0)), box((3.0, 3.0, 0.1))
    mesh = type(near)(
        np.concatenate([near.vertices, far.vertices]),
        np.concatenate([near.faces, far.faces + len(near.vertices)]),
    )
    turn = Rotation.from_euler("z", 10, degrees=True).as_matrix()
    mixed = camera.scan(mesh, pose_of(turn), None, ToFDisturbances(mixed_pixels=True))
    depth = mixed.points[..., 2].astype(float)
    between = (depth > 4.0) & (depth < 4.9)
    assert 20 < between.sum() < 200


@pytest.mark.parametrize("name", sorted(TARGETS))
def test_every_target_is_seen_from_everywhere(name: str) -> None:
    camera, mesh = ToFCamera(), TARGETS[name]()
    for seed in range(3):
        scan = camera.scan(mesh, pose_of(Rotation.random(random_state=seed).as_matrix()))
        assert len(scan.plain()) > 500
        assert np.isfinite(scan.points[[0, -1]]).sum() == 0


def test_the_body_of_revolution_looks_the_same_from_around_its_axis() -> None:
    camera, mesh = ToFCamera(width=80, height=80), body_of_revolution()
    tip = Rotation.from_euler("x", 70, degrees=True)
    one, two = (
        camera.ranges(mesh, pose_of((tip * Rotation.from_euler("z", a)).as_matrix()))
        for a in (0.0, 1.0)
    )
    both = np.isfinite(one) & np.isfinite(two)
    assert np.quantile(np.abs(one - two)[both], 0.98) < 2e-3


def test_the_papers_clouds_come_out_at_about_its_number_of_points() -> None:
    camera = ToFCamera(focal_length_m=102 * 40e-6 / np.tan(np.radians(20.0)))
    for angles, expected in (((23.5, 23.5, 1), 4219), ((33.5, 33.5, 11), 4694)):
        turn = Rotation.from_euler("YXZ", angles, degrees=True).as_matrix()
        count = len(camera.scan(sich_n5(), pose_of(turn, 5.5)).plain())
        assert count == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize(
    "wrong",
    [
        {"width": 0}, {"focal_length_m": -1.0}, {"range_noise_m": -1e-3},
        {"range_min_m": 3.0, "range_max_m": 2.0},
    ],
)  # fmt: skip
def test_a_camera_that_cannot_be_is_refused(wrong: dict) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        ToFCamera(**wrong)


def test_a_pose_of_another_shape_and_chance_without_a_generator_are_refused() -> None:
    with pytest.raises(ValueError, match="pose_cam_from_target"):
        ToFCamera().ranges(box((1, 1, 1)), np.eye(3))
    with pytest.raises(ValueError, match="rng"):
        ToFCamera().scan(box((1, 1, 1)), pose_of(np.eye(3)), None, ToFDisturbances(0.1))
    with pytest.raises(ValueError, match="outlier_fraction"):
        ToFDisturbances(outlier_fraction=1.5)


def test_noise_grows_with_the_slant() -> None:
    """Of a wall that turns away by 60 deg: twice as large where the variance is as one over the
    cosine squared.
    """
    tilt = Rotation.from_euler("y", 60, degrees=True).as_matrix()
    wall, pose = box((4.0, 0.5, 0.02)), pose_of(tilt, 4.0)
    camera = ToFCamera(width=200, height=200, range_noise_m=0.005, slant_growth=1.0)
    truth, cosine = camera.ranges(wall, pose), camera.cosines(wall, pose)
    seen = np.isfinite(truth)
    normal = -tilt[:, 2]
    assert np.array_equal(np.isfinite(cosine), seen)
    face = seen & (cosine > 0.1)  # not its rim
    assert np.abs(cosine - np.abs(camera.rays() @ normal))[face].max() < 1e-6
    scan = camera.scan(wall, pose, np.random.default_rng(0))
    noise = (np.linalg.norm(scan.points, axis=-1) - truth) * cosine
    assert noise[face].std() == pytest.approx(0.005, rel=0.05)
