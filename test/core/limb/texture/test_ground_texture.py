"""Covariances of ground beside the limb, against their laws written out, and against clouds."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from horizon_sensor_ros.core.limb.texture import ground_texture
from horizon_sensor_ros.sim.cloud_texture import cloud_brightness

ROUGH, SMOOTH = 3, ground_texture.NUM - 1


def test_variogram_and_correlation_tell_the_same() -> None:
    strength2 = ground_texture.variogram(1e9)
    for apart in (0.0, 0.01, 0.1, 0.5):
        alike = ground_texture.correlation(np.array([apart]))[:, 0]
        np.testing.assert_allclose(ground_texture.variogram(apart), strength2 * (1.0 - alike))
    assert strength2[ground_texture.NONE] == 0.0


def test_covariances_are_those_of_a_blurred_field() -> None:
    """Exponential, and Matern 3/2, along and across the limb apart: sums over all that is seen."""
    across, along = np.array([0.0, 0.05, 0.2]), np.array([0.0, 0.03])
    blur = np.array([[0.5, 0.3, 0.0], [0.1, 0.2, 0.6]])
    alone, together = ground_texture.covariances(blur, across, along)
    assert alone.shape == (ground_texture.NUM, 2, 2)
    assert together.shape == (ground_texture.NUM, 4, 4)
    assert np.linalg.eigvalsh(together[1:]).min() > 0.0

    def exponential(apart: float) -> float:
        return float(np.exp(-abs(apart) / 0.06))

    def matern(apart: float) -> float:
        scaled = np.sqrt(3.0) * abs(apart) / 0.2
        return float((1.0 + scaled) * np.exp(-scaled))

    for texture, strength, law in ((ROUGH, 4.0, exponential), (SMOOTH, 100.0, matern)):
        expected = np.zeros((4, 4))
        for (k, a), (m, b) in product(enumerate(along), repeat=2):
            for (i, row), (j, column) in product(enumerate(blur), repeat=2):
                seen = sum(
                    row[p] * column[q] * law(across[p] - across[q])
                    for p, q in product(range(3), repeat=2)
                )
                expected[2 * k + i, 2 * m + j] = strength**2 * seen * law(a - b)
        np.testing.assert_allclose(together[texture], expected)
        np.testing.assert_allclose(alone[texture], expected[:2, :2])


def test_rough_ground_is_as_rough_as_clouds_are() -> None:
    """Over a hundredth of the planet's radius, 64 km, as far as a sharp limb sees the ground."""
    apart = 0.01
    random = np.random.default_rng(0)
    at = random.standard_normal((4000, 3))
    at /= np.linalg.norm(at, axis=1, keepdims=True)
    towards = np.cross(at, random.standard_normal((4000, 3)))
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    beside = np.cos(apart) * at + np.sin(apart) * towards
    changes = variance = 0.0
    for seed in range(20):
        here, there = (cloud_brightness(p, seed, 0.55, 60.0, 200.0) for p in (at, beside))
        changes += 0.5 * np.square(there - here).mean()
        variance += here.var()
    alike = float(ground_texture.rough_correlation(np.array(apart)))
    assert alike == pytest.approx(1.0 - changes / variance, abs=0.03)


def test_smooth_ground_is_smooth_and_rough_ground_is_not() -> None:
    """Over a tenth of the distance smooth texture changes by a tenth, rough by a root of that."""
    change = ground_texture.variogram(1e-3)[1:] / ground_texture.variogram(1e-4)[1:]
    np.testing.assert_allclose(change[:8], 10.0, rtol=0.02)
    np.testing.assert_allclose(change[8:], 100.0, rtol=0.02)


def test_likely_texture_is_the_nearest() -> None:
    assert ground_texture.likely(0.2) == ground_texture.NONE
    assert ground_texture.variogram(1e9)[ground_texture.likely(9.0)] == 64.0
