"""Errors of a fix from what the sensor is told of cameras and planet, for the covariance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from horizon_sensor_ros.core.attitude import tangent_basis
from horizon_sensor_ros.core.fits.assessment import covariance_nadir_altitude
from horizon_sensor_ros.core.fits.observation import LimbObservation
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.symmetric3 import inverse


def with_calibration_error(
    fit: HorizonFit,
    observations: Sequence[LimbObservation],
    sphere: Planet,
    *,
    mounting_sigma_rad: float,
    limb_height_sigma_m: float,
) -> HorizonFit:
    """Return the fit with these errors added to its covariance.

    mounting_sigma_rad : of each camera's rotation, about every axis, independent of the others'.
    limb_height_sigma_m : of the height of the visible limb. Zero: taken to be exact.
    The nadir that a camera alone would find turns with the camera; several weigh by what their
    points know. First order; source: derived here, after the information form of least squares.
    """
    if mounting_sigma_rad == 0.0 and limb_height_sigma_m == 0.0:
        return fit
    cov = fit.cov_nadir_altitude.copy()
    if mounting_sigma_rad > 0.0:
        basis = tangent_basis(fit.nadir_base)
        shares = _shares_of_cameras(fit, observations, basis)
        turned = mounting_sigma_rad**2 * sum(share[:, :2] @ share[:, :2].T for share in shares)
        cov += covariance_nadir_altitude(np.asarray(turned), basis, fit.rho_rad, sphere)
    # altitude = (radius + limb height) / sin(rho) - radius
    cov[3, 3] += (limb_height_sigma_m / math.sin(fit.rho_rad)) ** 2
    return replace(fit, cov_nadir_altitude=cov)


def _shares_of_cameras(
    fit: HorizonFit, observations: Sequence[LimbObservation], basis: np.ndarray
) -> list[np.ndarray]:
    """How the estimate follows what each camera alone would find, (3, 3) each, their sum is one."""
    informations = []
    for observation in observations:
        rays = observation.rays
        if observation.view.name not in fit.cameras or not len(rays):
            continue
        per_px = rays.angles(fit.nadir_base)[1] * rays.sigma_px
        rows = rays.design(fit.nadir_base, basis) / per_px[:, None]
        informations.append(rows.T @ rows)
    if len(informations) < 2:
        return [np.eye(3)]
    gain = inverse(np.sum(informations, axis=0))
    return [gain @ information for information in informations]
