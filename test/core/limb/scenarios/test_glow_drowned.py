"""A limb below glow that is saturated as well: where it lies is told by the glow's law alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from limb_frames import as_frames, clouds, draw, limb_views

from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.sim.earth_scene import Imaging
from horizon_sensor_ros.sim.poses import camera_from_fov


@pytest.mark.parametrize("num", [5, pytest.param(20, marks=pytest.mark.slow)])
def test_altitude_holds_where_glow_saturates_together_with_the_ground(num: int) -> None:
    """All cameras are off alike: both were up to 1.7 px too high at .3 claimed, ten sigma."""
    over_sigma = []
    for seed in range(num):
        rng = np.random.default_rng([seed, 11])
        altitude_m = float(rng.uniform(300e3, 900e3))
        camera = camera_from_fov(640, 480, float(np.radians(rng.uniform(50.0, 70.0))))
        views = limb_views(altitude_m, camera, azimuths_rad=(0.0, 1.5), above_rad=0.05)
        scene = replace(clouds(seed), air_dn=float(rng.uniform(70.0, 110.0)))
        imaging = Imaging(noise_dn=2.0, gain=float(rng.uniform(3.5, 6.0)))
        fix = HorizonSensor().process(as_frames(views, draw(views, altitude_m, scene, imaging)))
        if fix.ok:
            variance = fix.fit.cov_nadir_altitude[3, 3]
            over_sigma.append((fix.fit.altitude_m - altitude_m) / np.sqrt(variance))
    assert len(over_sigma) >= 0.8 * num
    assert np.sqrt(np.mean(np.square(over_sigma))) < 1.6
    assert np.abs(over_sigma).max() < 4.0
