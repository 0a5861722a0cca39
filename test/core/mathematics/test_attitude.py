"""Attitude against scipy's rotations, the conventions' table, and the exponential map."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from horizon_sensor_ros.core.mathematics.attitude import (
    GROUND_VARIANCE_M2,
    YAW_VARIANCE_RAD2,
    level_from_base,
    nadir_from_roll_pitch,
    pose_covariance,
    quaternion_from_rotation,
    roll_pitch_from_nadir,
    rotation_from_quaternion,
    shortest_turn,
    tangent_basis,
)

unit_quaternions = (
    st.tuples(*[st.floats(-1, 1)] * 4)
    .filter(lambda q: np.linalg.norm(q) > 0.1)
    .map(lambda q: np.array(q) / np.linalg.norm(q))
)
directions = (
    st.tuples(*[st.floats(-1, 1)] * 3)
    .filter(lambda v: np.linalg.norm(v) > 0.1)
    .map(lambda v: np.array(v) / np.linalg.norm(v))
)
level_zs = st.sampled_from(["up", "down"])


@given(directions, directions, st.floats(-18.0, -0.01), st.sampled_from([1.0, -1.0]))
def test_the_shortest_turn_leads_there_about_an_axis_across(
    start: np.ndarray, way: np.ndarray, exponent: float, sign: float
) -> None:
    end = sign * start + 10.0**exponent * way
    end /= np.linalg.norm(end)
    turn = shortest_turn(start, end)
    assert Rotation.from_rotvec(turn).apply(start) == pytest.approx(end, abs=1e-14)
    assert abs(turn @ start) < 1e-14
    assert np.linalg.norm(turn) <= np.pi + 1e-15


@given(directions)
def test_the_shortest_turns_to_itself_and_to_its_opposite(start: np.ndarray) -> None:
    assert not shortest_turn(start, start).any()
    turn = shortest_turn(start, -start)
    assert np.linalg.norm(turn) == pytest.approx(np.pi)
    assert Rotation.from_rotvec(turn).apply(start) == pytest.approx(-start, abs=1e-14)


@given(unit_quaternions)
def test_quaternions_are_scipys(q: np.ndarray) -> None:
    rot = Rotation.from_quat(q).as_matrix()
    assert rotation_from_quaternion(q) == pytest.approx(rot, abs=1e-14)
    back = quaternion_from_rotation(rot)
    assert back[3] >= 0
    assert np.linalg.norm(back) == pytest.approx(1, abs=1e-15)
    assert min(np.abs(back - q).max(), np.abs(back + q).max()) < 1e-14


@pytest.mark.parametrize("q", [(0, 0, 0, 0), (0, 0, 0, 1.1), (0, 0, np.nan, 1), (0, 0, 1)])
def test_quaternions_that_are_none(q: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match="quaternion must"):
        rotation_from_quaternion(np.array(q))


# The rows of the conventions: (level_z, roll, pitch in deg) -> nadir in the base frame.
@pytest.mark.parametrize(
    ("level_z", "roll", "pitch", "nadir"),
    [
        ("up", 0, 0, (0, 0, -1)),  # base x forward, y left, z up: level
        ("up", 0, 90, (1, 0, 0)),  # +pitch is nose down: x points at the planet
        ("up", 90, 0, (0, -1, 0)),  # +roll lifts the left side: y points away, right wing down
        ("down", 0, 0, (0, 0, 1)),  # base x forward, y right, z down: level
        ("down", 0, 90, (-1, 0, 0)),  # +pitch is nose up
        ("down", 90, 0, (0, 1, 0)),  # +roll is right side down
        ("down", 20, 30, (-0.5, 0.29619813, 0.81379768)),
    ],
)
def test_the_table_of_conventions(
    level_z: str, roll: float, pitch: float, nadir: tuple[float, ...]
) -> None:
    found = nadir_from_roll_pitch(np.radians(roll), np.radians(pitch), level_z)
    assert found == pytest.approx(np.array(nadir), abs=1e-8)


@given(directions, level_zs)
def test_level_frame_stands_on_nadir(nadir: np.ndarray, level_z: str) -> None:
    rot = level_from_base(nadir, level_z)
    assert rot @ rot.T == pytest.approx(np.eye(3), abs=1e-15)
    assert np.linalg.det(rot) == pytest.approx(1)
    z = 1.0 if level_z == "down" else -1.0
    assert rot @ nadir == pytest.approx(np.array([0, 0, z]), abs=1e-12)
    roll, pitch = roll_pitch_from_nadir(nadir, level_z)
    expected = Rotation.from_euler("ZYX", [0, pitch, roll]).as_matrix()
    assert rot == pytest.approx(expected, abs=1e-14)
    assert nadir_from_roll_pitch(roll, pitch, level_z) == pytest.approx(nadir, abs=1e-14)


@pytest.mark.parametrize("level_z", ["up", "down"])
@pytest.mark.parametrize("sign", [1, -1])
def test_nose_straight_at_the_planet_is_no_exception(level_z: str, sign: int) -> None:
    for tilt in (0.0, 1e-300, 1e-12):
        nadir = np.array([sign, tilt, -tilt])
        rot = level_from_base(nadir, level_z)
        assert rot @ rot.T == pytest.approx(np.eye(3), abs=1e-15)
        z = 1.0 if level_z == "down" else -1.0
        assert (rot @ nadir)[2] == pytest.approx(z, abs=1e-12)


@pytest.mark.parametrize(("level_z", "up"), [("up", 1.0), ("down", -1.0)])
@pytest.mark.parametrize("side", [0.0, -0.0, 1e-300, -1e-300])
def test_roll_upside_down_is_half_a_turn_to_the_right(level_z: str, up: float, side: float) -> None:
    """Half a turn is told in one way: it was -180 deg where rounding left a zero below zero."""
    roll, pitch = roll_pitch_from_nadir(np.array([0.0, side, up]), level_z)
    assert (roll, pitch) == (np.pi, 0.0)


def test_what_is_no_direction_is_refused() -> None:
    for bad in (np.zeros(3), np.full(3, np.nan), np.zeros(2)):
        with pytest.raises(ValueError, match="nadir_base"):
            level_from_base(bad)
    with pytest.raises(ValueError, match="level_z"):
        level_from_base(np.array([0, 0, 1.0]), "north")


@settings(max_examples=40)
@given(directions, level_zs, st.integers(0, 2**32 - 1))
def test_pose_covariance_is_that_of_the_exponential_error(
    nadir: np.ndarray, level_z: str, seed: int
) -> None:
    """Errors drawn from the covariance, turned into rotations about fixed axes one by one."""
    rng = np.random.default_rng(seed)
    basis = tangent_basis(nadir)
    root = rng.normal(size=(3, 3)) * np.array([[1e-4], [1e-4], [50.0]])
    to_fit = np.zeros((4, 3))
    to_fit[:3, :2] = basis
    to_fit[3, 2] = 1.0
    cov = to_fit @ root @ root.T @ to_fit.T
    rot_true = level_from_base(nadir, level_z)
    sign = 1.0 if level_z == "down" else -1.0
    columns = []
    for column in (to_fit @ root).T:
        # The rotation that takes the wrong nadir to the level frame's z, without turning about z.
        wrong = nadir + column[:3]
        wrong_level = rot_true @ wrong / np.linalg.norm(wrong)
        target = np.array([0, 0, sign])
        axis = np.cross(wrong_level, target)
        turn = Rotation.from_rotvec(axis / np.linalg.norm(axis) * np.arcsin(np.linalg.norm(axis)))
        assert turn.as_matrix() @ wrong_level == pytest.approx(target, abs=1e-9)
        error = (Rotation.from_matrix(turn.as_matrix() @ rot_true @ rot_true.T)).as_rotvec()
        columns.append([-sign * column[3], error[0], error[1]])
    expected = np.array(columns).T @ np.array(columns)
    found = pose_covariance(cov, rot_true, level_z)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.abs((found[2:5, 2:5] - expected) / scale).max() < 1e-3
    assert found[0, 0] == found[1, 1] == GROUND_VARIANCE_M2
    assert found[5, 5] == YAW_VARIANCE_RAD2
    rest = found.copy()
    rest[2:5, 2:5] = 0
    assert np.count_nonzero(rest) == 3
    assert (
        np.linalg.eigvalsh(found / np.sqrt(np.outer(np.diag(found), np.diag(found)))).min() > -1e-9
    )


def test_sign_of_altitude_and_rotation_in_the_covariance() -> None:
    """By hand: level, nadir's x error grows with the altitude's."""
    cov = np.zeros((4, 4))
    cov[0, 0], cov[3, 3], cov[0, 3], cov[3, 0] = 1e-6, 100.0, 5e-3, 5e-3
    # z down: nadir (0,0,1) seen at (d, 0, 1) is a turn about y by -d; position.z is minus altitude.
    down = pose_covariance(cov, level_from_base(np.array([0.0, 0, 1]), "down"), "down")
    assert down[2, 4] == pytest.approx(5e-3)
    # z up: nadir (0,0,-1) seen at (d, 0, -1) is a turn about y by +d; position.z is the altitude.
    up = pose_covariance(cov, level_from_base(np.array([0.0, 0, -1]), "up"), "up")
    assert up[2, 4] == pytest.approx(5e-3)
    assert down[4, 4] == up[4, 4] == pytest.approx(1e-6)
    assert down[3, 3] == up[3, 3] == 0


@given(directions)
def test_tangent_basis_completes_a_right_handed_frame(direction: np.ndarray) -> None:
    frame = np.column_stack((tangent_basis(direction), direction))
    assert frame.T @ frame == pytest.approx(np.eye(3), abs=1e-14)
    assert np.linalg.det(frame) == pytest.approx(1)
