"""A fit and an altitude known from elsewhere, as one estimate."""

from __future__ import annotations

import math

import numpy as np

from horizon_sensor_ros.core.aiding import AltitudeMeasurement
from horizon_sensor_ros.core.fits.moved import moved
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.planet import Planet

# Sigmas by which frames and a known altitude may differ and still be of the same altitude.
_CONTRADICTION = 5.0


def with_altitude(
    fit: HorizonFit, known: AltitudeMeasurement, sphere: Planet
) -> tuple[HorizonFit, str]:
    """Return the fit's estimate given a measurement of its altitude too; and why not, if not.

    Of any method's fit that is OK, after all its errors are in the covariance: nadir and altitude
    hang together on a short arc, so both gain. The minimum-variance update of a Gaussian estimate
    (Kalman 1960) with ``H = (0, 0, 0, 1)``. Where the two contradict each other by more than
    `_CONTRADICTION` sigmas the fit comes back as it was, and the contradiction in words: a stale
    orbit would turn nadir. So it does where no limb is seen from that altitude.
    """
    cov = fit.cov_nadir_altitude
    variance = float(cov[3, 3]) + known.sigma_m**2
    apart_m = known.altitude_m - fit.altitude_m
    if not abs(apart_m) < _CONTRADICTION * math.sqrt(variance):
        own_sigma_km = 1e-3 * math.sqrt(float(cov[3, 3]))
        return fit, (
            f"the known altitude, {known.altitude_m / 1e3:.1f} +- {known.sigma_m / 1e3:.1f} km, is "
            f"not used: the frames show {fit.altitude_m / 1e3:.1f} +- {own_sigma_km:.1f} km"
        )
    gain = cov[:, 3] / variance
    step = gain * apart_m
    left = np.eye(4)
    left[:, 3] -= gain
    # Joseph's form: no difference of nearly equal variances where the altitude is known well.
    after = left @ cov @ left.T + np.outer(gain, gain) * known.sigma_m**2
    updated = moved(fit, step, after, sphere)
    if updated is None:
        return fit, (
            f"the known altitude, {known.altitude_m / 1e3:.1f} km, is not used: it lies below the "
            "limb"
        )
    return updated, ""
