"""What the configuration withholds, and what it makes of an estimate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from horizon_fixes import (
    NADIR,
    SENSOR,
    SQUARE,
    assert_refused,
    clouded_fix,
    clouded_pair,
    error_deg,
    sigma_deg,
)
from limb_frames import PLANET, as_frames, draw, limb_views

from horizon_sensor_ros.core.aiding import Aiding, AltitudeMeasurement
from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.sim.earth_camera import render_views
from horizon_sensor_ros.sim.earth_scene import EarthScene
from horizon_sensor_ros.sim.poses import camera_from_fov, side_views


def test_a_camera_mounted_upside_down_is_no_fix() -> None:
    """Its nadir is opposite to the other's, as if it were the same line."""
    views = side_views(camera_from_fov(640, 480, np.radians(60.0)))
    flipped = replace(views[1], rot_base_from_cam=views[1].rot_base_from_cam @ np.diag([-1, -1, 1]))
    position = np.array([0.0, 0.0, -(PLANET.radius_m + 400e3)])
    drawn = render_views(
        (views[0], flipped), np.eye(3), position, EarthScene(), np.random.default_rng(1)
    )
    fix = SENSOR.process(as_frames(views, drawn))
    assert fix.status is Status.CAMERAS_DISAGREE
    assert "180.0 deg" in fix.reason


@pytest.mark.parametrize("cameras", [1, 2])
def test_a_known_altitude_leaves_the_limb_where_the_frames_show_it(cameras: int) -> None:
    """A limb higher than thought is that of another altitude, and no less a limb for it."""
    planet = replace(PLANET, limb_height_m=10e3)
    views = limb_views(500e3, azimuths_rad=SQUARE[:cameras])
    drawn = draw(views, 500e3, EarthScene(planet=planet))
    sensor = HorizonSensor(HorizonConfig(limb_height_sigma_m=10e3))
    aiding = Aiding(altitude=AltitudeMeasurement(500e3, 100.0))
    for _ in range(2):
        fix = sensor.process(as_frames(views, drawn), aiding)
        assert fix.ok, fix.reason
        assert fix.fit.altitude_m == pytest.approx(500e3, abs=100.0)
        assert error_deg(fix, NADIR) < 3.0 * sigma_deg(fix)
        for view, limb in zip(views, fix.limbs, strict=True):
            assert fix.residual_px(view, limb) < 0.1
    assert sensor.following


def test_altitude_outside_the_bounds_is_refused() -> None:
    for low, high in ((10e3, 450e3), (550e3, 1e8)):
        config = HorizonConfig(altitude_min_m=low, altitude_max_m=high)
        assert_refused(HorizonSensor(config).process(clouded_pair()), 2)


def test_uncertain_estimates_are_withheld() -> None:
    config = HorizonConfig(max_nadir_sigma_rad=1e-7)
    fix = HorizonSensor(config).process(clouded_pair())
    assert_refused(fix, 2)
    assert fix.status is Status.UNCERTAIN


def test_ragged_limbs_are_withheld() -> None:
    fix = HorizonSensor(HorizonConfig(max_residual_px=1e-3)).process(clouded_pair())
    assert_refused(fix, 2)
    assert fix.status is Status.POOR_FIT


def test_faint_limbs_are_withheld() -> None:
    fix = HorizonSensor(HorizonConfig(min_contrast=1e6)).process(clouded_pair())
    assert_refused(fix, 2)
    assert "faint" in fix.reason


def test_ellipsoid_is_fitted_by_its_mean_sphere_and_says_so() -> None:
    sphere = clouded_fix()
    ellipsoid = HorizonSensor(HorizonConfig(planet=Planet.wgs84())).process(clouded_pair())
    assert ellipsoid.ok
    assert error_deg(ellipsoid, sphere.fit.nadir_base) < 0.02
    assert 0.09 < np.sqrt(sigma_deg(ellipsoid) ** 2 - sigma_deg(sphere) ** 2) < 0.25
    altitude_sigma = [np.sqrt(f.fit.cov_nadir_altitude[3, 3]) for f in (sphere, ellipsoid)]
    assert altitude_sigma[1] > 1.5e3 > altitude_sigma[0]
    # no certainty along nadir is made up, none is taken away
    cov = ellipsoid.fit.cov_nadir_altitude[:3, :3]
    assert ellipsoid.fit.nadir_base @ cov @ ellipsoid.fit.nadir_base < 1e-12


def test_limb_height_goes_into_the_altitude() -> None:
    height = 12e3
    sphere = clouded_fix()
    raised = HorizonSensor(HorizonConfig(planet=Planet(limb_height_m=height)))
    fix = raised.process(clouded_pair())
    assert error_deg(fix, sphere.fit.nadir_base) < 5e-3
    scale = 1.0 + height / PLANET.radius_m
    want = (PLANET.radius_m + sphere.fit.altitude_m) * scale - PLANET.radius_m
    assert fix.fit.altitude_m == pytest.approx(want, abs=300.0)
