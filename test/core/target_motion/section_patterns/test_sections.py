"""Paper D: frame, patterns, objective and search against hand-made cases and each other."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from horizon_sensor_ros.core.target_motion.section_patterns.candidate import (
    candidate_of,
    motion,
    rotation_n_from_v,
)
from horizon_sensor_ros.core.target_motion.section_patterns.direct_search import (
    compass_search,
    direct_search,
    plateau_mean,
)
from horizon_sensor_ros.core.target_motion.section_patterns.inertia_frame import (
    inertia_frame,
    inertia_matrix,
)
from horizon_sensor_ros.core.target_motion.section_patterns.objective import (
    BatchObjective,
    objective,
)
from horizon_sensor_ros.core.target_motion.section_patterns.section_pattern import (
    SectionPattern,
    cut,
    likeness,
    one_way_likeness,
    section_points,
)
from horizon_sensor_ros.sim.shapes import sich_n5
from horizon_sensor_ros.sim.tof_camera import ToFCamera

PITCH_M = 0.026


def paper_pose(pitch: float, roll: float, yaw: float) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("YXZ", (pitch, roll, yaw), degrees=True).as_matrix()
    pose[2, 3] = 5.5
    return pose


@pytest.fixture(scope="module")
def clouds() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The paper's N5, variant 2, and the motion between."""
    camera, rng = ToFCamera(), np.random.default_rng(0)
    before, after = paper_pose(23.5, 23.5, 1), paper_pose(33.5, 33.5, 11)
    a = camera.scan(sich_n5(), before, rng).plain().astype(float)
    b = camera.scan(sich_n5(), after, rng).plain().astype(float)
    return a, b, after @ np.linalg.inv(before)


def pattern(rows: list[list[int]], radius: float = 1.0) -> SectionPattern:
    count = np.array(rows, float)
    return SectionPattern(count, np.full(count.shape, radius))


def test_the_inertia_matrix_is_the_sum_over_points() -> None:
    points = np.random.default_rng(0).normal(size=(50, 3)) * (1, 2, 3)
    x, y, z = (points - points.mean(axis=0)).T
    expected = [
        [(y**2 + z**2).sum(), -(x * y).sum(), -(x * z).sum()],
        [-(x * y).sum(), (x**2 + z**2).sum(), -(y * z).sum()],
        [-(x * z).sum(), -(y * z).sum(), (x**2 + y**2).sum()],
    ]
    assert np.allclose(inertia_matrix(points), expected)


@given(st.integers(0, 1000))
def test_the_frame_turns_with_the_cloud_and_is_right_handed(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(80, 3)) * (3, 2, 1)
    turn = Rotation.random(random_state=seed).as_matrix()
    one, two = inertia_frame(points), inertia_frame(points @ turn.T + (1, 2, 3))
    assert np.linalg.det(two.rot_sensor_from_frame) == pytest.approx(1)
    assert np.allclose(two.origin_m, turn @ one.origin_m + (1, 2, 3))
    along = np.abs(
        np.einsum("ij,ij->j", turn @ one.rot_sensor_from_frame, two.rot_sensor_from_frame)
    )
    assert np.allclose(along, 1, atol=1e-6)


def test_a_cloud_that_has_no_frame_is_refused() -> None:
    for wrong in (np.zeros((2, 3)), np.zeros((5, 2)), np.full((5, 3), np.nan)):
        with pytest.raises(ValueError, match="points"):
            inertia_frame(wrong)
    with pytest.raises(ValueError, match="pitch_m"):
        cut(np.eye(3), 0.0)


def test_the_rotation_is_the_papers_matrix() -> None:
    theta, phi, psi = 0.3, -0.2, 0.7
    expected = Rotation.from_euler("YXZ", (theta, phi, psi)).as_matrix()
    assert np.allclose(rotation_n_from_v(theta, phi, psi), expected)
    assert expected[1, 2] == pytest.approx(-np.sin(phi))


def test_a_section_is_what_lies_within_the_pitch() -> None:
    points = np.array([[0.0, 1, 2], [0.5, 3, 4], [-0.1, 5, 6]])
    assert section_points(points, 0, 0.2).tolist() == [[1, 2], [5, 6]]


def test_likeness_follows_equation_one() -> None:
    one = pattern([[1, 0, 0, 0], [0, 0, 0, 2]])
    assert likeness(one, one) == pytest.approx(1)
    # The first cell has one beside it; the second (two points) has nothing within a cell.
    other = pattern([[0, 1, 0, 0], [0, 0, 0, 0]])
    assert one_way_likeness(one, other) == pytest.approx(np.exp(-1) / 3)
    corner = pattern([[0, 0, 0, 0], [0, 3, 0, 0]])
    assert one_way_likeness(one, corner) == pytest.approx(np.exp(-np.sqrt(2)) / 3)
    assert one_way_likeness(one, pattern([[0] * 4] * 2)) == 0


def test_a_cloud_is_most_like_itself(clouds: tuple[np.ndarray, ...]) -> None:
    a, _, _ = clouds
    assert objective(cut(a, PITCH_M), a, np.zeros(6)) == pytest.approx(1)


@settings(max_examples=25)
@given(st.lists(st.floats(-0.3, 0.3), min_size=6, max_size=6))
def test_many_at_once_are_each_as_printed(clouds: tuple, candidate: list[float]) -> None:
    a, b, _ = clouds
    sections = cut(a, PITCH_M)
    batch = BatchObjective(sections, b)
    both = np.array([candidate, np.array(candidate) / 7])
    expected = [objective(sections, b, c) for c in both]
    assert batch(both) == pytest.approx(expected, abs=1e-9)


def test_the_objective_tells_the_truth_from_no_motion(clouds: tuple[np.ndarray, ...]) -> None:
    a, b, truth = clouds
    sections = cut(a, PITCH_M)
    true = candidate_of(sections, truth)
    assert np.allclose(motion(sections, true), truth)
    assert objective(sections, b, true) > 0.8  # the paper: 0.87
    assert objective(sections, b, np.zeros(6)) < 0.4  # the paper: 0.17


def test_the_search_finds_the_papers_motion(clouds: tuple[np.ndarray, ...]) -> None:
    a, b, truth = clouds
    sections = cut(a, PITCH_M)
    batch = BatchObjective(sections, b)
    reach = np.array([np.radians(15)] * 3 + [0.08] * 3)
    found = direct_search(batch, reach, plateau=np.array([np.radians(1)] * 3 + [0.01] * 3))
    true = candidate_of(sections, truth)
    assert found.value >= objective(sections, b, true) - 1e-9
    assert batch(found.top)[0] == pytest.approx(found.value)
    for place in (found.best, found.top):
        assert np.degrees(np.abs(place[:3] - true[:3])).max() < 0.8
        assert np.abs(place[3:] - true[3:]).max() < 0.01


def test_the_middle_of_a_plateau_is_its_middle() -> None:
    top = np.array([0.3, -0.2])
    # Flat within 0.1 of the top.
    middle = plateau_mean(
        lambda x: -np.maximum(np.abs(x - top).max(axis=1) - 0.1, 0.0),
        top + np.array([0.09, -0.08]), np.full(2, 0.25), samples=1000,
    )  # fmt: skip
    assert np.abs(middle - top).max() < 0.01


def test_compass_search_climbs_a_smooth_hill() -> None:
    top = np.array([0.3, -0.2, 0.7])
    result = compass_search(
        lambda x: -((x - top) ** 2).sum(axis=1), np.zeros(3), np.full(3, 0.5), 1e-4
    )
    assert np.abs(result.best - top).max() < 1e-3
    assert result.evaluations < 1000


def test_an_empty_section_is_one_of_three() -> None:
    """Two parallel plates leave nothing in the plane between them."""
    x, y = np.meshgrid(np.linspace(-1, 1, 41), np.linspace(-0.5, 0.5, 21))
    points = np.array([(a, b, z) for a, b in zip(x.flat, y.flat, strict=True) for z in (-0.2, 0.2)])
    sections = cut(points, 0.05)
    assert min(pattern.count.sum() for pattern in sections.patterns) == 0
    still = np.zeros(6)
    batch = BatchObjective(sections, points)
    assert batch(still[None])[0] == pytest.approx(objective(sections, points, still))
