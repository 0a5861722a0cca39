"""The planet against closed forms, tangency by its definition, and numerical search."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from horizon_sensor_ros.core.planet import Planet

latitudes = st.floats(-np.pi / 2, np.pi / 2)
longitudes = st.floats(-np.pi + 1e-9, np.pi)
heights = st.floats(0, 4e7)
flattened = st.sampled_from([Planet.wgs84(), Planet(6.4e6, 0, 0.1), Planet(3.4e6, 2e4, 0.005)])


def test_disc_of_a_sphere() -> None:
    planet = Planet(6371000.0)
    assert planet.rho_from_altitude(6371000.0) == pytest.approx(np.radians(30))
    assert planet.altitude_from_rho(np.pi / 2) == pytest.approx(0)
    assert np.isnan(planet.rho_from_altitude(-1.0))
    assert np.isnan(planet.rho_from_altitude(np.nan))
    assert np.isnan(planet.altitude_from_rho(1.6))
    assert np.isnan(planet.altitude_from_rho(0.0))
    hazy = Planet(6371000.0, 10000.0)
    assert np.sin(hazy.rho_from_altitude(3e5)) == pytest.approx(6381 / 6671)
    # horizon_facts.md: 10 km of air move rho by 0.29 deg at 300 km, 0.05 at 6000
    for altitude, degrees in ((3e5, 0.29), (6e6, 0.05)):
        change = hazy.rho_from_altitude(altitude) - planet.rho_from_altitude(altitude)
        assert np.degrees(change) == pytest.approx(degrees, abs=0.01)


@given(st.floats(1e3, 1e8), st.floats(0, 500))
def test_altitude_and_rho_are_inverse(altitude: float, limb_height: float) -> None:
    planet = Planet(6371000.0, limb_height)
    rho = planet.rho_from_altitude(altitude)
    assert planet.altitude_from_rho(rho) == pytest.approx(altitude, rel=1e-7, abs=1e-3)
    step = 1e-7
    numeric = (planet.altitude_from_rho(rho + step) - planet.altitude_from_rho(rho - step)) / (
        2 * step
    )
    assert planet.altitude_slope(rho) == pytest.approx(numeric, rel=1e-4)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"radius_m": 0.0}, "radius"),
        ({"radius_m": -6371000.0}, "radius"),
        ({"radius_m": np.nan}, "radius"),
        ({"limb_height_m": np.inf}, "limb height"),
        ({"limb_height_m": -7e6}, "limb height"),
        ({"flattening": 1.0}, "flattening"),
        ({"flattening": -0.1}, "flattening"),
    ],
)
def test_impossible_planets(arguments: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Planet(**arguments)


def test_wgs84_reference_values() -> None:
    planet = Planet.wgs84()
    assert planet.polar_radius_m == pytest.approx(6356752.314245, abs=1e-6)
    assert planet.mean_radius_m == pytest.approx(6371008.7714, abs=1e-3)
    assert planet.ecef_from_geodetic(0, 0, 1000) == pytest.approx(np.array([6379137.0, 0, 0]))
    pole = planet.ecef_from_geodetic(np.pi / 2, 0, 0)
    assert pole == pytest.approx(np.array([0, 0, 6356752.314245]), abs=1e-6)


@settings(max_examples=200)
@given(flattened, latitudes, longitudes, heights)
def test_geodetic_coordinates_are_inverse(
    planet: Planet, latitude: float, longitude: float, height: float
) -> None:
    position = planet.ecef_from_geodetic(latitude, longitude, height)
    found = planet.geodetic_from_ecef(position)
    assert found[0] == pytest.approx(latitude, abs=1e-11)
    assert found[2] == pytest.approx(height, abs=1e-6)
    again = planet.ecef_from_geodetic(*found)
    assert np.abs(again - position).max() < 1e-5


def test_geodetic_nadir_goes_to_the_nearest_point_of_the_ellipsoid() -> None:
    planet = Planet.wgs84()
    position = np.array([3.1e6, -4.2e6, 4.6e6])
    a, b = planet.radius_m, planet.polar_radius_m

    def surface(angles: np.ndarray) -> np.ndarray:
        t, f = angles
        return np.array([a * np.cos(t) * np.cos(f), a * np.cos(t) * np.sin(f), b * np.sin(t)])

    best = minimize(
        lambda angles: np.sum((surface(angles) - position) ** 2) / a**2, [0.7, -0.9], tol=1e-16
    )
    towards = surface(best.x) - position
    assert planet.nadir_ecef(position, "geodetic") == pytest.approx(
        towards / np.linalg.norm(towards), abs=1e-6
    )
    assert planet.nadir_ecef(position) == pytest.approx(-position / np.linalg.norm(position))
    with pytest.raises(ValueError, match="vertical"):
        planet.nadir_ecef(position, "magnetic")
    with pytest.raises(ValueError, match="position_ecef"):
        planet.nadir_ecef(np.zeros(3))


def test_the_two_verticals_differ_by_up_to_0_19_deg_on_earth() -> None:
    planet = Planet.wgs84()
    difference = []
    for latitude in np.radians(np.arange(0, 91)):
        position = planet.ecef_from_geodetic(latitude, 0.5, 0)
        between = np.cross(planet.nadir_ecef(position), planet.nadir_ecef(position, "geodetic"))
        difference.append(np.degrees(np.linalg.norm(between)))
    assert max(difference) == pytest.approx(0.1924, abs=1e-3)
    assert int(np.argmax(difference)) == 45


@settings(max_examples=60)
@given(flattened, latitudes, longitudes, st.floats(3e4, 4e7))
def test_limb_rays_touch_the_ellipsoid(
    planet: Planet, latitude: float, longitude: float, height: float
) -> None:
    position = planet.ecef_from_geodetic(latitude, longitude, height)
    azimuth = np.linspace(-np.pi, np.pi, 37)
    rays = planet.limb_rays_ecef(position, azimuth)
    assert np.linalg.norm(rays, axis=1) == pytest.approx(np.ones(37), abs=1e-14)
    equator = planet.radius_m + planet.limb_height_m
    pole = planet.polar_radius_m + planet.limb_height_m
    axes = np.array([equator, equator, pole])
    # In coordinates where the ellipsoid is the unit sphere, a tangent passes its centre at 1.
    start = position / axes
    scaled = rays / axes
    scaled /= np.linalg.norm(scaled, axis=1, keepdims=True)
    passing = np.linalg.norm(np.cross(start, scaled), axis=1)
    assert passing == pytest.approx(np.ones(37), abs=1e-9)
    assert np.all(scaled @ start < 0)
    cone = planet.limb_cone_ecef(position)
    assert np.abs(np.einsum("ij,jk,ik->i", rays, cone, rays)).max() < 1e-12 * np.abs(cone).max()
    nadir = planet.nadir_ecef(position)
    assert nadir @ cone @ nadir > 0
    outside = np.cross(nadir, rays[0])
    assert outside @ cone @ outside < 0


def test_limb_of_a_sphere_is_the_cone_of_rho() -> None:
    planet = Planet(6371000.0, 12000.0)
    position = np.array([0.0, 6.9e6, 1e5])
    azimuth = np.linspace(0, 6, 50)
    angle = np.arccos(planet.limb_rays_ecef(position, azimuth) @ planet.nadir_ecef(position))
    rho = planet.rho_from_altitude(np.linalg.norm(position) - 6371000.0)
    assert angle == pytest.approx(np.full(50, rho), abs=1e-9)


def test_azimuth_runs_from_north_through_east() -> None:
    planet = Planet.wgs84()
    position = planet.ecef_from_geodetic(0.5, 1.0, 5e5)
    north = np.array([-np.sin(0.5) * np.cos(1), -np.sin(0.5) * np.sin(1), np.cos(0.5)])
    east = np.array([-np.sin(1), np.cos(1), 0])
    rays = planet.limb_rays_ecef(position, np.array([0.0, np.pi / 2]))
    assert rays[0] @ north > 0.9
    assert abs(rays[0] @ east) < 1e-12
    assert rays[1] @ east > 0.9
    over_the_pole = planet.limb_rays_ecef(np.array([0, 0, 7e6]), np.array([0.0, np.pi / 2]))
    assert over_the_pole[0][0] < -0.9
    assert over_the_pole[1][1] > 0.9


def test_from_inside_there_is_no_limb() -> None:
    planet = Planet.wgs84(20000.0)
    position = planet.ecef_from_geodetic(0.3, 0.1, 10000.0)
    assert np.isnan(planet.limb_cone_ecef(position)).all()
    assert np.isnan(planet.limb_rays_ecef(position, np.zeros(3))).all()
