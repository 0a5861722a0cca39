"""Errors of mounting and limb height: against fits with cameras that are really turned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from limb_frames import PLANET
from limb_samples import observe, view_at_limb
from scipy.spatial.transform import Rotation

from horizon_sensor_ros.core.calibration_error import with_calibration_error
from horizon_sensor_ros.core.fits.maximum_likelihood import fit_maximum_likelihood
from horizon_sensor_ros.core.fits.observation import LimbObservation
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.horizon_config import HorizonConfig
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.sim.poses import camera_from_fov

CAMERA = camera_from_fov(640, 480, np.radians(60.0))
NADIR = np.array([0.36, -0.48, 0.8])
ALTITUDE_M = 900e3
RHO = PLANET.rho_from_altitude(ALTITUDE_M)
SIGMA_RAD = np.radians(0.05)


def exact_limbs(azimuths_deg: tuple[float, ...], rho: float = RHO) -> list[LimbObservation]:
    # The second camera sees a third of the limb that the first does, and sees it worse.
    return [
        observe(
            view_at_limb(CAMERA, NADIR, rho, np.radians(azimuth), name=f"camera_{i}"),
            NADIR,
            rho,
            sigma_px=0.5 * (i + 1),
            arc_rad=0.5 / (i + 1),
        )
        for i, azimuth in enumerate(azimuths_deg)
    ]


def fitted(observations: list[LimbObservation], planet: Planet = PLANET) -> HorizonFit:
    fit = fit_maximum_likelihood(observations, planet)
    assert fit.ok, fit.reason
    return fit


@pytest.mark.parametrize("azimuths_deg", [(0.0,), (0.0, 90.0), (0.0, 60.0, 200.0)])
def test_nadir_and_altitude_scatter_as_said_when_cameras_are_turned(
    azimuths_deg: tuple[float, ...],
) -> None:
    observations = exact_limbs(azimuths_deg)
    rng = np.random.default_rng(3)
    found = []
    for _ in range(400):
        turned = []
        for seen in observations:
            turn = Rotation.from_rotvec(rng.normal(0.0, SIGMA_RAD, 3)).as_matrix()
            view = replace(seen.view, rot_base_from_cam=turn @ seen.view.rot_base_from_cam)
            turned.append(LimbObservation(view, seen.limb))
        fit = fitted(turned)
        found.append([*fit.nadir_base, fit.altitude_m / 1e7])
    scatter = np.cov(np.array(found).T)
    fit = fitted(observations)
    with_error = with_calibration_error(
        fit, observations, PLANET, mounting_sigma_rad=SIGMA_RAD, limb_height_sigma_m=0.0
    )
    units = np.diag([1.0, 1.0, 1.0, 1e-7])
    said = units @ (with_error.cov_nadir_altitude - fit.cov_nadir_altitude) @ units
    np.testing.assert_allclose(said, scatter, atol=0.25 * np.linalg.norm(scatter, 2))
    # Least certain direction, and the altitude.
    assert np.linalg.norm(said[:3, :3], 2) == pytest.approx(
        np.linalg.norm(scatter[:3, :3], 2), rel=0.25
    )
    assert said[3, 3] == pytest.approx(scatter[3, 3], rel=0.3, abs=1e-16)


def test_one_camera_turns_nadir_with_it() -> None:
    observations = exact_limbs((30.0,))
    fit = fitted(observations)
    with_error = with_calibration_error(
        fit, observations, PLANET, mounting_sigma_rad=SIGMA_RAD, limb_height_sigma_m=0.0
    )
    added = with_error.cov_nadir_altitude - fit.cov_nadir_altitude
    across = np.eye(3) - np.outer(fit.nadir_base, fit.nadir_base)
    np.testing.assert_allclose(added[:3, :3], SIGMA_RAD**2 * across, atol=1e-12)
    np.testing.assert_allclose(added[3], 0.0, atol=1e-6)


def test_a_limb_that_lies_higher_moves_the_altitude_alone() -> None:
    observations = exact_limbs((0.0, 90.0))
    higher = fitted(observations, Planet(PLANET.radius_m, 5e3))
    fit = fitted(observations)
    with_error = with_calibration_error(
        fit, observations, PLANET, mounting_sigma_rad=0.0, limb_height_sigma_m=5e3
    )
    added = with_error.cov_nadir_altitude - fit.cov_nadir_altitude
    assert np.sqrt(added[3, 3]) == pytest.approx(higher.altitude_m - fit.altitude_m, rel=1e-6)
    assert np.count_nonzero(added) == 1


def test_none_is_the_same_fit() -> None:
    observations = exact_limbs((0.0,))
    fit = fitted(observations)
    same = with_calibration_error(
        fit, observations, PLANET, mounting_sigma_rad=0.0, limb_height_sigma_m=0.0
    )
    assert same is fit


@pytest.mark.parametrize("name", ["mounting_sigma_rad", "limb_height_sigma_m"])
@pytest.mark.parametrize("value", [-1.0, np.nan, np.inf])
def test_sigmas_that_make_no_sense(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=name):
        HorizonConfig(**{name: value})
