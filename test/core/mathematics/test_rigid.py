"""Rotations and rotation vectors, against SciPy's, up to half a turn."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from horizon_sensor_ros.core.mathematics.rigid import rotation_from_vector, vector_from_rotation

seeds = st.integers(0, 2**31)
angles = st.one_of(
    st.floats(0.0, np.pi),
    st.floats(-16.0, 0.0).map(lambda exponent: 10.0**exponent),
    st.floats(-16.0, 0.0).map(lambda exponent: np.pi - 10.0**exponent),
)


def vector_of(angle_rad: float, seed: int) -> np.ndarray:
    axis = np.random.default_rng(seed).normal(size=3)
    return np.asarray(axis * (angle_rad / np.linalg.norm(axis)))


@given(angles, seeds)
def test_rotations_of_vectors(angle_rad: float, seed: int) -> None:
    vector = vector_of(angle_rad, seed)
    expected = Rotation.from_rotvec(vector).as_matrix()
    assert rotation_from_vector(vector) == pytest.approx(expected, abs=1e-14)


@given(angles, seeds)
def test_vectors_of_rotations_up_to_half_a_turn(angle_rad: float, seed: int) -> None:
    """A hair less than half a turn was turned the other way."""
    turn = Rotation.from_rotvec(vector_of(angle_rad, seed))
    vector = vector_from_rotation(turn.as_matrix())
    assert np.linalg.norm(vector) == pytest.approx(angle_rad, abs=1e-14)
    off = Rotation.from_rotvec(vector) * turn.inv()
    assert off.magnitude() < 1e-13


@given(angles, seeds)
def test_a_rotation_that_is_one_to_a_millionth_has_its_vector(angle_rad: float, seed: int) -> None:
    """Near half a turn the axis was what rounding left: any at all."""
    turn = Rotation.from_rotvec(vector_of(angle_rad, seed))
    rounded = turn.as_matrix().astype(np.float32).astype(float)
    off = Rotation.from_rotvec(vector_from_rotation(rounded)) * turn.inv()
    assert off.magnitude() < 1e-6


@pytest.mark.parametrize("axis", [*np.eye(3), *-np.eye(3)])
def test_half_a_turn_about_an_axis(axis: np.ndarray) -> None:
    half_a_turn = 2.0 * np.outer(axis, axis) - np.eye(3)
    assert np.abs(vector_from_rotation(half_a_turn)) == pytest.approx(np.pi * np.abs(axis))
