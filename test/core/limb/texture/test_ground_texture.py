"""Covariances of ground beside the limb, against draws of it."""

from __future__ import annotations

import numpy as np

from horizon_sensor_ros.core.limb.texture import ground_texture


def test_variogram_and_correlation_tell_the_same() -> None:
    strength2 = ground_texture.variogram(1e9)
    for apart in (0.0, 0.01, 0.1, 0.5):
        alike = ground_texture.correlation(np.array([apart]))[:, 0]
        np.testing.assert_allclose(ground_texture.variogram(apart), strength2 * (1.0 - alike))
    assert strength2[ground_texture.NONE] == 0.0


def test_covariances_are_those_of_a_blurred_field() -> None:
    across, along = np.array([0.0, 0.05, 0.2]), np.array([0.0, 0.03])
    blur = np.array([[0.5, 0.3, 0.0], [0.1, 0.2, 0.6]])
    alone, together = ground_texture.covariances(blur, across, along)
    assert alone.shape == (ground_texture.NUM, 2, 2)
    assert together.shape == (ground_texture.NUM, 4, 4)
    strength2 = ground_texture.variogram(1e9)
    for texture in range(1, ground_texture.NUM):
        assert np.linalg.eigvalsh(together[texture]).min() > 0.0
        for i in range(2):
            np.testing.assert_allclose(together[texture][2 * i :, 2 * i :][:2, :2], alone[texture])
        # By hand: sums over what both samples see.
        distance = np.abs(across[:, None] - across)
        alike = ground_texture.correlation(distance.ravel())[texture].reshape(3, 3)
        np.testing.assert_allclose(alone[texture], strength2[texture] * blur @ alike @ blur.T)


def test_smooth_ground_is_smooth_and_rough_ground_is_not() -> None:
    """Over a tenth of the distance smooth texture changes by a tenth, rough by a root of that."""
    change = ground_texture.variogram(1e-3)[1:] / ground_texture.variogram(1e-4)[1:]
    np.testing.assert_allclose(change[:8], 10.0, rtol=0.02)
    np.testing.assert_allclose(change[8:], 100.0, rtol=0.02)


def test_likely_texture_is_the_nearest() -> None:
    assert ground_texture.likely(0.2) == ground_texture.NONE
    assert ground_texture.variogram(1e9)[ground_texture.likely(9.0)] == 64.0
