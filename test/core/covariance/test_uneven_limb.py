"""Limbs whose height differs from place to place, as cloud tops make them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from limb_samples import cone_rays, nadir_nees

from horizon_sensor_ros.core.covariance.uneven_limb import heights_alike
from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.core.horizon.fix import Frame
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.sim.hard_scenes import hard_scene

UNEVEN_M = 1000.0


@pytest.mark.parametrize("altitude_m", [300e3, 6000e3])
def test_heights_are_alike_over_the_size_of_weather_systems(altitude_m: float) -> None:
    """Of two places 500 km of ground apart, wherever they are seen from, by one over e."""
    planet = Planet()
    rho_rad = planet.rho_from_altitude(altitude_m)
    nadir = np.array([0.36, -0.48, 0.8])
    # Places of the limb lie on a circle about nadir's point, 90 deg - rho from it.
    apart_rad = np.array([0.0, 250e3, 500e3, 1000e3]) / planet.radius_m
    azimuth_rad = 2.0 * np.arcsin(np.sin(0.5 * apart_rad) / np.cos(rho_rad))
    rays = cone_rays(nadir, rho_rad, azimuth_rad)
    alike = heights_alike(rays, nadir, rho_rad, planet.radius_m)
    np.testing.assert_allclose(alike[0], np.exp([0.0, -0.5, -1.0, -2.0]), rtol=1e-4)


@pytest.mark.parametrize("num", [6, pytest.param(24, marks=pytest.mark.slow)])
def test_an_uneven_limb_is_as_far_off_as_claimed_where_it_is_told(num: int) -> None:
    """Each camera by itself: .1 deg off in the median, and by ten variances where it is not."""
    squares: dict[float, list[float]] = {0.0: [], UNEVEN_M: []}
    for i in range(num):
        scene = hard_scene("clouds", i, 72)
        truth = scene.frames[0].truth
        world = replace(scene.scene, limb_uneven_m=UNEVEN_M)
        drawn = scene.redrawn(world, np.random.default_rng(i))
        for told_m, found in squares.items():
            sensor = HorizonSensor(HorizonConfig(limb_unevenness_m=told_m, tracking=False))
            for view, frame in zip(scene.views, drawn, strict=True):
                fix = sensor.process([Frame(view, frame.image)])
                if fix.ok:
                    found.append(nadir_nees(fix.fit, truth.nadir_base))
    assert len(squares[UNEVEN_M]) >= 4 / 3 * num
    assert np.mean(squares[UNEVEN_M]) < 3.5
    assert np.mean(squares[0.0]) > 6.0
