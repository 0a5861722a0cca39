"""Whether what is bright where a camera's sky should be is a part of the craft.

By itself a frame does not tell a boom before the sky from ground beyond an edge that is no limb.
Cameras that know from their own limbs where its limb lies do.
"""

from __future__ import annotations

import numpy as np

from horizon_sensor_ros.core.fits.assessment import tangent_rows
from horizon_sensor_ros.core.fits.observation import LimbObservation
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.mathematics.attitude import tangent_basis
from horizon_sensor_ros.core.mathematics.robust import median
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.planet_figure import disc_of

_SIGMAS = 2.0  # to which the others' cone is believed


def farthest_limb_px(seen: LimbObservation, others: HorizonFit, sphere: Planet) -> float:
    """How far off a camera's limb points the limb may be, pixels, by other cameras' fit.

    Points may be off that fit's cone, and the cone off the limb by two of its sigmas. Medians along
    the limb; infinite without points.
    """
    disc = disc_of(others)
    rays = LimbObservation(disc.figure.view(seen.view), seen.limb).rays
    if len(rays) == 0:
        return np.inf
    basis = tangent_basis(disc.nadir)
    to_cone = tangent_rows(basis)
    to_cone[2] /= sphere.altitude_slope(disc.rho_rad)
    slopes = rays.design(disc.nadir, basis) @ to_cone
    variance = np.einsum("ij,jk,ik->i", slopes, others.cov_nadir_altitude, slopes)
    off_px, growth = rays.residuals_and_growth(disc.nadir, disc.rho_rad)
    sigma_px = np.sqrt(np.maximum(variance, 0.0)) / np.maximum(growth, rays.least_growth)
    return float(np.hypot(median(np.abs(off_px)), _SIGMAS * median(sigma_px)))
