import numpy as np
import pytest

from horizon_sensor_ros.sim.cloud_texture import city_brightness, cloud_brightness, cloud_noise


def sphere_points(n: int, seed: int = 0) -> np.ndarray:
    points = np.random.default_rng(seed).standard_normal((n, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def test_noise_has_zero_mean_and_unit_variance_and_is_repeatable() -> None:
    points = sphere_points(20000)
    fractal, smooth = cloud_noise(points, 7)
    for field in (fractal, smooth):
        assert abs(field.mean()) < 0.2
        assert field.std() == pytest.approx(1.0, abs=0.2)
    again, _ = cloud_noise(points, 7)
    other, _ = cloud_noise(points, 8)
    assert np.array_equal(fractal, again)
    assert abs(np.corrcoef(fractal, other)[0, 1]) < 0.1


def test_noise_has_no_seams() -> None:
    """Along a great circle neighbours 60 m apart differ by little, wherever the circle runs."""
    for seed in range(3):
        a, b = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 2)))[0].T
        t = np.linspace(0.0, 2.0 * np.pi, 600001)[:, None]
        fractal, smooth = cloud_noise(np.cos(t) * a + np.sin(t) * b, seed)
        # older OpenCV's remap moves in steps of 1/32 texel, 0.03 where the tile is steepest
        assert np.abs(np.diff(fractal)).max() < 0.06
        assert np.abs(np.diff(smooth)).max() < 0.06


@pytest.mark.parametrize("cover", [0.2, 0.5, 0.8])
def test_cover_is_the_clouded_share(cover: float) -> None:
    light = cloud_brightness(sphere_points(40000), 3, cover, 50.0, 250.0)
    assert np.mean(light > 70.0) == pytest.approx(cover, abs=0.12)
    assert light.min() > 30.0
    assert light.max() <= 251.0


def test_cities_are_small_and_few() -> None:
    light = city_brightness(sphere_points(40000), 3)
    assert 0.005 < np.mean(light > 0.1) < 0.15
    assert light.min() >= 0.0
    assert light.max() <= 1.0


def test_no_points_have_no_brightness() -> None:
    assert cloud_brightness(np.empty((0, 3)), 0, 0.5, 50.0, 250.0).shape == (0,)
