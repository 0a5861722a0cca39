"""Smooth ground: its statistics, and that it is smooth."""

from __future__ import annotations

import numpy as np
import pytest

from horizon_sensor_ros.sim.smooth_texture import smooth_field


def test_fields_have_zero_mean_and_unit_variance_over_seeds() -> None:
    points = np.random.default_rng(0).standard_normal((2000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    fields = np.array([smooth_field(points, seed) for seed in range(40)])
    assert abs(fields.mean()) < 0.05
    assert fields.std() == pytest.approx(1.0, abs=0.05)
    np.testing.assert_array_equal(smooth_field(points, 3), fields[3])
    assert np.abs(np.corrcoef(fields)[0, 1:]).max() < 0.6


def test_brightness_changes_gently() -> None:
    """Along a great circle: no wave is shorter than half a radius."""
    angle = np.linspace(0.0, 2.0 * np.pi, 4001)
    circle = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    for seed in range(5):
        slope = np.gradient(smooth_field(circle, seed), angle)
        assert np.sqrt(np.mean(slope**2)) < 2.0 * np.pi / 0.5
