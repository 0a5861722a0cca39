"""An estimate moved by what else is known, as one update of a Gaussian one moves it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.planet import Planet


def moved(fit: HorizonFit, step: np.ndarray, cov: np.ndarray, sphere: Planet) -> HorizonFit | None:
    """Return the fit with nadir_base and altitude changed by a step, and another covariance.

    step : (4,) of nadir_base (unit vector components) and altitude (m). cov : (4, 4) of the same,
    after the step; its part along the new nadir is removed. None where the new altitude is below
    the limb.
    """
    altitude_m = float(fit.altitude_m + step[3])
    rho_rad = sphere.rho_from_altitude(altitude_m)
    if not math.isfinite(rho_rad):
        return None
    nadir = fit.nadir_base + step[:3]
    nadir /= np.linalg.norm(nadir)
    across = np.eye(4)
    across[:3, :3] -= np.outer(nadir, nadir)
    return replace(
        fit,
        nadir_base=nadir,
        rho_rad=rho_rad,
        altitude_m=altitude_m,
        cov_nadir_altitude=across @ cov @ across.T,
    )
