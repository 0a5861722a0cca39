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


@pytest.mark.parametrize("sigma_m", [0.0, -1.0, np.nan, np.inf])
def test_a_poses_altitude_has_a_sigma(sigma_m: float) -> None:
    with pytest.raises(ValueError, match="sigma_m must be positive"):
        CoarsePose(np.array([7e6, 0.0, 0.0]), Rotation.identity().as_matrix()).altitude(
            WGS84, sigma_m
        )
