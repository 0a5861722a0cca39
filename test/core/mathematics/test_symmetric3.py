"""Closed forms of symmetric 3 x 3 matrices against LAPACK's."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from horizon_sensor_ros.core.mathematics.symmetric3 import (
    inverse,
    is_positive,
    largest_eigenvalue,
    solve,
)

exponents = st.tuples(*[st.floats(-3.0, 3.0)] * 3)
seeds = st.integers(0, 2**31)


def matrix_of(eigenvalues: np.ndarray, seed: int) -> np.ndarray:
    axes = Rotation.from_quat(np.random.default_rng(seed).normal(size=4)).as_matrix()
    matrix = axes @ np.diag(eigenvalues) @ axes.T
    return np.asarray(0.5 * (matrix + matrix.T))


@given(exponents, seeds)
def test_positive_definite(exponent: tuple[float, ...], seed: int) -> None:
    matrix = matrix_of(10.0 ** np.array(exponent), seed)
    right = np.random.default_rng(seed).normal(size=3)
    assert is_positive(matrix)
    np.testing.assert_allclose(matrix @ inverse(matrix), np.eye(3), atol=1e-8)
    np.testing.assert_allclose(matrix @ solve(matrix, right), right, atol=1e-8)


@given(exponents, seeds)
def test_with_a_negative_eigenvalue(exponent: tuple[float, ...], seed: int) -> None:
    matrix = matrix_of(10.0 ** np.array(exponent) * (1.0, 1.0, -1.0), seed)
    assert not is_positive(matrix)
    assert np.isnan(inverse(matrix)).all()
    assert np.isnan(solve(matrix, np.ones(3))).all()


@pytest.mark.parametrize("value", [0.0, np.nan, np.inf])
@pytest.mark.parametrize("place", [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)])
def test_singular_and_not_finite(place: tuple[int, int], value: float) -> None:
    """An infinite variance of the first two was positive definite, and had an inverse."""
    matrix = np.diag([1.0, 2.0, 3.0])
    matrix[place] = matrix[place[::-1]] = value
    singular = place[0] == place[1] or value != 0.0
    assert is_positive(matrix) == (not singular)
    assert np.isnan(inverse(matrix)).all() == singular
    assert np.isnan(solve(matrix, np.ones(3))).all() == singular


@given(exponents, seeds)
def test_largest_eigenvalue_of_a_singular_one(exponent: tuple[float, ...], seed: int) -> None:
    matrix = matrix_of(10.0 ** np.array(exponent) * (1.0, 1.0, 0.0), seed)
    assert largest_eigenvalue(matrix) == pytest.approx(np.linalg.eigvalsh(matrix)[-1], rel=1e-7)
