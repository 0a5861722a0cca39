"""A fit and an altitude known from elsewhere, as one estimate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from horizon_sensor_ros.core.aiding import AltitudeMeasurement
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.planet import Planet


def with_altitude(fit: HorizonFit, known: AltitudeMeasurement, sphere: Planet) -> HorizonFit:
    """Return the fit's estimate given a measurement of its altitude too.

    Of any method's fit that is OK, after all its errors are in the covariance: nadir and altitude
    hang together on a short arc, so both gain. The minimum-variance update of a Gaussian estimate
    (Kalman 1960) with ``H = (0, 0, 0, 1)``. Where the two contradict each other the more certain
    one prevails.
    """
    cov = fit.cov_nadir_altitude
    variance = float(cov[3, 3]) + known.sigma_m**2
    gain = cov[:, 3] / variance
    step = gain * (known.altitude_m - fit.altitude_m)
    nadir = fit.nadir_base + step[:3]
    nadir /= np.linalg.norm(nadir)
    altitude = float(fit.altitude_m + step[3])
    cov = cov - np.outer(gain, gain) * variance
    across = np.eye(4)
    across[:3, :3] -= np.outer(nadir, nadir)
    return replace(
        fit,
        nadir_base=nadir,
        rho_rad=sphere.rho_from_altitude(altitude),
        altitude_m=altitude,
        cov_nadir_altitude=across @ cov @ across.T,
    )
