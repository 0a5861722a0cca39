import numpy as np
import pytest
from scipy.integrate import trapezoid

from horizon_sensor_ros.sim.air import airglow_layer, glow_above_limb, glow_inside_limb

RADIUS, SCALE = 6371e3, 9e3


def column(lowest_m: float, start_m: float, stop_m: float) -> float:
    """Air along a straight line, by distance from its lowest point; 1 for the whole grazing ray."""
    s = np.linspace(start_m, stop_m, 400001)
    height = np.hypot(RADIUS + lowest_m, s) - RADIUS
    s0 = np.linspace(-3e6, 3e6, 400001)
    grazing = np.exp(-(np.hypot(RADIUS, s0) - RADIUS) / SCALE)
    return trapezoid(np.exp(-height / SCALE), s) / trapezoid(grazing, s0)


@pytest.mark.parametrize("height_m", [0.0, 5e3, 20e3])
@pytest.mark.parametrize("ahead_m", [2.5e6, 4e5, 1e5, 0.0, -1e5, -4e5])
def test_column_above_the_limb(height_m: float, ahead_m: float) -> None:
    expected = column(height_m, -ahead_m, 3e6)
    got = glow_above_limb(np.array([height_m]), np.array([ahead_m]), SCALE, RADIUS)[0]
    assert got == pytest.approx(expected, rel=0.08, abs=1e-6)


@pytest.mark.parametrize("depth_m", [0.0, 1e3, 1e4, 1e5])
@pytest.mark.parametrize("altitude_m", [32e3, 400e3])
def test_column_in_front_of_the_surface(depth_m: float, altitude_m: float) -> None:
    surface = np.sqrt(RADIUS**2 - (RADIUS - depth_m) ** 2)
    ahead = np.sqrt((RADIUS + altitude_m) ** 2 - (RADIUS - depth_m) ** 2)
    expected = column(-depth_m, -ahead, -surface) / 0.5
    got = glow_inside_limb(np.array([depth_m]), np.array([ahead]), altitude_m, SCALE, RADIUS)[0]
    assert got == pytest.approx(expected, rel=0.1)


def test_airglow_is_brightest_at_its_height_and_gone_above() -> None:
    height = np.linspace(0.0, 150e3, 1501)
    layer = airglow_layer(height, 95e3, 6e3)
    assert height[np.argmax(layer)] == pytest.approx(95e3, abs=1e3)
    assert layer.max() == pytest.approx(1.0)
    assert layer[height > 120e3].max() < 1e-6
    assert 0.1 < layer[0] < 0.5
