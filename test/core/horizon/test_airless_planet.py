"""A planet without air: nothing is claimed for air that is not seen, nor looked for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from limb_frames import ROT_WORLD_FROM_BASE, as_frames, limb_views

from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.core.horizon.fix import Frame, HorizonFix
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.mathematics.attitude import angle_rad
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.planet_figure import mean_sphere
from horizon_sensor_ros.sim.earth_camera import render_views
from horizon_sensor_ros.sim.earth_scene import EarthScene, Imaging
from horizon_sensor_ros.sim.poses import camera_from_fov

MOON = Planet(1737.4e3, has_air=False)
NADIR = np.array([0.0, 0.0, 1.0])


def seen(altitude_m: float, fov_rad: float, seed: int, psf_px: float) -> list[Frame]:
    """Frames of two cameras above patchy ground of the Moon's size."""
    camera = camera_from_fov(640, 480, fov_rad)
    views = limb_views(altitude_m, camera, (0.2, 1.8), planet=MOON)
    drawn = render_views(
        views,
        ROT_WORLD_FROM_BASE,
        -ROT_WORLD_FROM_BASE @ NADIR * (MOON.radius_m + altitude_m),
        EarthScene(planet=MOON, texture="clouds", texture_seed=seed),
        np.random.default_rng(seed),
        imaging=Imaging(noise_dn=1.5, psf_sigma_px=psf_px),
    )
    return as_frames(views, drawn)


def fixed(frames: list[Frame], planet: Planet) -> HorizonFix:
    return HorizonSensor(HorizonConfig(planet=planet)).process(frames)


@pytest.mark.parametrize(
    ("altitude_m", "psf_px"),
    [(300e3, 0.7), pytest.param(1300e3, 1.2, marks=pytest.mark.slow), (4000e3, 0.7)],
)
def test_altitude_claims_no_air(altitude_m: float, psf_px: float) -> None:
    """Blur is blur: the Earth's air, which does not show from so far, may be behind it."""
    with_air = replace(MOON, has_air=True)
    errors, claimed_m, with_air_m = [], [], []
    for seed in range(4):
        frames = seen(altitude_m, np.radians(75.0), seed, psf_px)
        fix, under_air = fixed(frames, MOON), fixed(frames, with_air)
        assert fix.ok, fix.reason
        sigma_rad = np.sqrt(np.linalg.eigvalsh(fix.fit.cov_nadir_altitude[:3, :3])[-1])
        assert angle_rad(fix.fit.nadir_base, NADIR) < 4.0 * sigma_rad
        claimed_m.append(np.sqrt(fix.fit.cov_nadir_altitude[3, 3]))
        errors.append((fix.fit.altitude_m - altitude_m) / claimed_m[-1])
        if under_air.ok:
            with_air_m.append(np.sqrt(under_air.fit.cov_nadir_altitude[3, 3]))
    assert max(map(abs, errors)) < 3.5
    if altitude_m > 1e6:
        assert np.median(claimed_m) < 0.2 * min(with_air_m)


def test_an_ellipsoid_without_air_is_a_sphere_without_air() -> None:
    ellipsoid = Planet(1738.1e3, flattening=0.0012, has_air=False)
    sphere = mean_sphere(ellipsoid)
    assert not sphere.has_air
    assert sphere.flattening == 0.0
    assert sphere.radius_m == ellipsoid.mean_radius_m
