"""What an old coarse pose says of the altitude, against orbits that are flown on."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from horizon_sensor_ros.core.aiding import CoarsePose
from horizon_sensor_ros.core.planet import Planet

MU_M3_S2 = 3.986004418e14
WGS84 = Planet.wgs84()


def flown(position: np.ndarray, velocity: np.ndarray, time_s: float) -> np.ndarray:
    """Position (3,) on a two-body orbit after a time."""

    def motion(_: float, state: np.ndarray) -> np.ndarray:
        pull = -MU_M3_S2 * state[:3] / np.linalg.norm(state[:3]) ** 3
        return np.concatenate((state[3:], pull))

    start = np.concatenate((position, velocity))
    return np.asarray(solve_ivp(motion, (0.0, time_s), start, rtol=1e-9).y[:3, -1])


def altitude_sigmas_off(age_s: float, claimed_age_s: float, sigma_m: float) -> np.ndarray:
    """What altitudes of poses are off by after a time on nearly round orbits, over their sigma."""
    rng = np.random.default_rng(8)
    found = []
    for _ in range(150):
        height_m = rng.uniform(250e3, 1500e3)
        position = WGS84.ecef_from_geodetic(
            float(np.arcsin(rng.uniform(-1, 1))), rng.uniform(-np.pi, np.pi), height_m
        )
        distance_m = float(np.linalg.norm(position))
        up = position / distance_m
        along = np.cross(up, rng.standard_normal(3))
        along /= np.linalg.norm(along)
        rising = 0.005 * np.sin(rng.uniform(0, 2 * np.pi))
        velocity = np.sqrt(MU_M3_S2 / distance_m) * (along + rising * up)
        told = CoarsePose(position, Rotation.identity().as_matrix(), age_s=claimed_age_s)
        known = told.altitude(WGS84, sigma_m)
        true_m = WGS84.geodetic_from_ecef(flown(position, velocity, age_s))[2]
        noise_m = rng.normal(0.0, sigma_m)
        found.append((known.altitude_m + noise_m - true_m) / known.sigma_m)
    return np.array(found)


@pytest.mark.parametrize("age_s", [1.0, 10.0, 60.0, 300.0])
def test_what_an_orbit_rose_by_since_its_pose_is_in_the_altitudes_sigma(age_s: float) -> None:
    """A minute in low orbit changes the height above the flattened Earth by kilometres."""
    off = altitude_sigmas_off(age_s, age_s, 30.0)
    assert 0.4 < np.sqrt(np.mean(off**2)) < 1.2
    assert np.mean(np.abs(off) > 3.0) < 0.01


def test_an_altitude_at_its_own_time_is_as_good_as_told() -> None:
    pose = CoarsePose(np.array([7e6, 0.0, 0.0]), Rotation.identity().as_matrix())
    known = pose.altitude(WGS84, 30.0)
    assert known.altitude_m == pytest.approx(7e6 - WGS84.radius_m)
    assert known.sigma_m == 30.0


def test_an_altitude_of_long_ago_says_little_but_is_finite() -> None:
    pose = CoarsePose(np.array([7e6, 0.0, 0.0]), Rotation.identity().as_matrix(), age_s=1e6)
    assert 10e3 < pose.altitude(WGS84, 30.0).sigma_m < 100e3


@pytest.mark.parametrize("distance_m", [6.6e6, 8e6, 42.2e6, 400e6])
def test_how_far_a_circular_orbit_flies(distance_m: float) -> None:
    pose = CoarsePose(np.array([distance_m, 0.0, 0.0]), np.eye(3), age_s=50.0)
    kepler_rad = 50.0 * np.sqrt(MU_M3_S2 / distance_m**3)
    assert pose.flown_rad(WGS84) == pytest.approx(kepler_rad, rel=0.01)


def test_a_pose_below_the_surface_flies_no_faster_than_above_it() -> None:
    low, high = (
        CoarsePose(np.array([distance, 0.0, 0.0]), np.eye(3), age_s=50.0).flown_rad(WGS84)
        for distance in (1.0, WGS84.mean_radius_m)
    )
    assert low == high


@pytest.mark.parametrize("latitude_deg", [-90.0, -45.0, 0.0, 20.0, 70.0])
@pytest.mark.parametrize("age_s", [60.0, 300.0])
def test_what_the_flattened_surface_sinks_by_is_in_the_sigma(
    latitude_deg: float, age_s: float
) -> None:
    """Along circles about the centre, with any heading; what an orbit rises by is left out."""
    position = WGS84.ecef_from_geodetic(float(np.radians(latitude_deg)), 0.3, 500e3)
    told = CoarsePose(position, np.eye(3), age_s=age_s)
    variances = [told.altitude(p, 1.0).sigma_m ** 2 for p in (WGS84, Planet(WGS84.mean_radius_m))]
    north = np.cross(position, np.cross([0.0, 0.0, 1.0], position))
    axes = np.column_stack((north / np.linalg.norm(north), np.cross([0.0, 0.0, 1.0], position)))
    if abs(latitude_deg) == 90.0:
        axes = np.eye(3)[:, :2]
    axes /= np.linalg.norm(axes, axis=0)
    angle_rad = age_s * np.sqrt(MU_M3_S2 / np.linalg.norm(position) ** 3)
    sunk_m = []
    for heading in np.linspace(0.0, 2 * np.pi, 60, endpoint=False):
        axis = axes @ [np.cos(heading), np.sin(heading)]
        there = Rotation.from_rotvec(angle_rad * axis).apply(position)
        sunk_m.append(WGS84.geodetic_from_ecef(there)[2] - 500e3)
    claimed_m = np.sqrt(variances[0] - variances[1])
    assert 0.5 < claimed_m / np.sqrt(np.mean(np.square(sunk_m))) < 1.6


@pytest.mark.parametrize("sigma_m", [0.0, -1.0, np.nan, np.inf])
def test_a_poses_altitude_has_a_sigma(sigma_m: float) -> None:
    with pytest.raises(ValueError, match="sigma_m must be positive"):
        CoarsePose(np.array([7e6, 0.0, 0.0]), Rotation.identity().as_matrix()).altitude(
            WGS84, sigma_m
        )
