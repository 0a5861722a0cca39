"""Vertical, altitude and the frame earth as the table of conventions has them, row by row."""

from __future__ import annotations

import numpy as np
import pytest

from horizon_sensor_ros.core.aiding import CoarsePose
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.planet_figure import Figure, MeanSphere, StretchedEllipsoid
from horizon_sensor_ros.core.status import Status

WGS84 = Planet.wgs84()
HEIGHT_M = 500e3
PLACES = {
    # Latitude, longitude (deg): nadir of a craft whose base frame is earth, geocentric at (0, 0).
    (0.0, 0.0): (-1.0, 0.0, 0.0),
    (0.0, 90.0): (0.0, -1.0, 0.0),
    (90.0, 0.0): (0.0, 0.0, -1.0),
    (-90.0, 0.0): (0.0, 0.0, 1.0),
}


def estimate(figure: Figure, position: np.ndarray, limb: Planet) -> HorizonFit:
    """What a figure makes of the limb seen from a position, base frame = earth, by a cone's fit."""
    rays = limb.limb_rays_ecef(position, np.linspace(0, 2 * np.pi, 40, endpoint=False))
    if isinstance(figure, StretchedEllipsoid):
        rays = rays * (1.0, 1.0, limb.radius_m / limb.polar_radius_m)
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    m = np.linalg.lstsq(rays, np.ones(len(rays)), rcond=None)[0]
    rho = float(np.arccos(1.0 / np.linalg.norm(m)))
    altitude = figure.sphere.altitude_from_rho(rho)
    fit = HorizonFit(Status.OK, "", "ml", m / np.linalg.norm(m), rho, altitude, np.zeros((4, 4)))
    return figure.estimate(fit)


def place(latitude_deg: float, longitude_deg: float) -> np.ndarray:
    return WGS84.ecef_from_geodetic(np.radians(latitude_deg), np.radians(longitude_deg), HEIGHT_M)


@pytest.mark.parametrize("vertical", ["geocentric", "geodetic"])
@pytest.mark.parametrize("where", PLACES)
def test_the_frame_earth(vertical: str, where: tuple[float, float]) -> None:
    position = place(*where)
    figure = StretchedEllipsoid(WGS84, vertical, CoarsePose(position, np.eye(3)))
    fit = estimate(figure, position, WGS84)
    np.testing.assert_allclose(fit.nadir_base, PLACES[where], atol=1e-9)
    assert fit.altitude_m == pytest.approx(HEIGHT_M, abs=0.1)


@pytest.mark.parametrize("latitude_deg", [-70.0, -45.0, 20.0, 45.0])
def test_verticals_and_altitude_with_a_pose(latitude_deg: float) -> None:
    position, latitude = place(latitude_deg, 0.0), np.radians(latitude_deg)
    pose = CoarsePose(position, np.eye(3))
    geocentric = estimate(StretchedEllipsoid(WGS84, "geocentric", pose), position, WGS84)
    geodetic = estimate(StretchedEllipsoid(WGS84, "geodetic", pose), position, WGS84)
    np.testing.assert_allclose(
        geocentric.nadir_base, -position / np.linalg.norm(position), atol=1e-9
    )
    normal = [np.cos(latitude), 0.0, np.sin(latitude)]
    np.testing.assert_allclose(geodetic.nadir_base, np.negative(normal), atol=1e-9)
    assert geocentric.altitude_m == pytest.approx(HEIGHT_M, abs=0.1)
    assert geodetic.altitude_m == pytest.approx(HEIGHT_M, abs=0.1)


def test_the_two_verticals_are_up_to_a_fifth_of_a_degree_apart() -> None:
    latitudes = np.radians(np.linspace(-90, 90, 361))
    apart = []
    for latitude in latitudes:
        position = WGS84.ecef_from_geodetic(latitude, 0.0, 0.0)
        cosine = WGS84.nadir_ecef(position, "geocentric") @ WGS84.nadir_ecef(position, "geodetic")
        apart.append(np.degrees(np.arccos(min(cosine, 1.0))))
    assert 0.190 < max(apart) < 0.195


@pytest.mark.parametrize("vertical", ["geocentric", "geodetic"])
def test_without_a_pose_both_verticals_are_the_mean_spheres(vertical: str) -> None:
    assert WGS84.mean_radius_m == pytest.approx(6371008.8, abs=0.1)
    nadir, rho = np.array([0.6, 0.0, -0.8]), 1.1
    sphere = MeanSphere(WGS84, vertical).sphere
    altitude = sphere.altitude_from_rho(rho)
    fit = HorizonFit(Status.OK, "", "ml", nadir, rho, altitude, np.zeros((4, 4)))
    found = MeanSphere(WGS84, vertical).estimate(fit)
    np.testing.assert_array_equal(found.nadir_base, nadir)
    assert found.altitude_m == pytest.approx(6371008.8 / np.sin(rho) - 6371008.8, abs=1.0)


@pytest.mark.parametrize("vertical", ["geocentric", "geodetic"])
def test_on_a_sphere_they_are_one_and_the_altitude_is_above_its_radius(vertical: str) -> None:
    planet = Planet(6.0e6)
    position = np.array([0.0, 4.0e6, 6.0e6])
    fit = estimate(MeanSphere(planet, vertical), position, planet)
    np.testing.assert_allclose(fit.nadir_base, -position / np.linalg.norm(position), atol=1e-12)
    assert fit.altitude_m == pytest.approx(np.linalg.norm(position) - 6.0e6, abs=1e-3)
