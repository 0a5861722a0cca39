"""The linear cone through the limb rays of all cameras at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from horizon_sensor_ros.core.fits.assessment import (
    assess_least_squares,
    too_few,
)
from horizon_sensor_ros.core.fits.observation import LimbObservation, gather
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.status import Status


def fit_cone(observations: Sequence[LimbObservation], planet: Planet) -> HorizonFit:
    """Linear least squares of ``u . m = 1`` over all rays, each weighted by its angular sigma.

    ``m = nadir / cos rho``. Not robust; biased for short arcs. Source: Christian & Robinson 2016.
    """
    rays = gather(observations)
    refused = too_few(rays, "cone")
    if refused:
        return refused
    weight = 1.0 / rays.sigma_rad
    m, _, rank, _ = np.linalg.lstsq(rays.rays_base * weight[:, None], weight, rcond=1e-12)
    norm = float(np.linalg.norm(m))
    if rank < 3 or norm <= 1.0:
        reason = "the rays do not lie on a cone"
        return HorizonFit.none(Status.ILL_CONDITIONED, reason, "cone", rays.num_points)
    return assess_least_squares(
        rays, planet, "cone", m / norm, float(np.arccos(1.0 / norm)), weight * weight
    )
