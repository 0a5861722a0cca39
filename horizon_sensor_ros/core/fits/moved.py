"""An estimate moved by what else is known, as one update of a Gaussian one moves it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.planet import Planet


def moved(fit: HorizonFit, step: np.ndarray, cov: np.ndarray, sphere: Planet) -> HorizonFit | None:
    """Return the fit a step (4,) of nadir_base and altitude farther, with a covariance (4, 4) of
    them, which is turned to the new nadir; None where no limb is seen from that altitude.
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
