"""Closed-form cones through limb rays, all cameras at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from horizon_sensor_ros.core.fits.assessment import (
    assess_least_squares,
    robust_sigma,
    too_few,
)
from horizon_sensor_ros.core.fits.limb_rays import LimbRays, gather
from horizon_sensor_ros.core.fits.result import HorizonFit, LimbObservation
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.status import Status

_ROBUST_ROUNDS = 6


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


def circle_on_sphere(rays: LimbRays, weight: np.ndarray | None = None) -> tuple[np.ndarray, float]:
    """Nadir (3,) and rho of the circle on the unit sphere nearest to the rays; NaN if undetermined.

    Minimises ``sum w (u . n - cos rho)^2 / sin^2 rho``, the squared angles from the circle to first
    order (Taubin's normalisation on the sphere), by a 4 x 4 eigenvalue problem; so it is not
    drawn to small circles by short arcs, and regular where rho nears 90 deg. The limb's
    normals decide which side is the planet's. weight : (N,), by default from the sigmas.
    """
    if weight is None:
        weight = rays.sigma_rad**-2
    points = np.column_stack((rays.rays_base, np.full(len(rays), -1.0)))
    scatter = (points * (weight / weight.sum())[:, None]).T @ points
    values, vectors = np.linalg.eig(np.diag([1.0, 1.0, 1.0, -1.0]) @ scatter)
    values, vectors = values.real, vectors.real
    # A circle has a vector with n . n > d . d; rounding may leave its eigenvalue just below zero.
    size = (vectors[:3] ** 2).sum(axis=0) - vectors[3] ** 2
    proper = np.flatnonzero(size > 0)
    if proper.size == 0:
        return np.full(3, np.nan), np.nan
    best = vectors[:, proper[np.argmin(np.abs(values[proper]))]]
    norm = np.linalg.norm(best[:3])
    nadir, cos_rho = best[:3] / norm, best[3] / norm
    if np.sum(rays.outward_base @ nadir > 0) > 0.5 * len(rays):
        nadir, cos_rho = -nadir, -cos_rho
    return nadir, float(np.arccos(np.clip(cos_rho, -1.0, 1.0)))


def robust_circle_on_sphere(rays: LimbRays) -> tuple[np.ndarray, float]:
    """`circle_on_sphere` reweighted by Geman and McClure's function of the residuals."""
    weight = rays.sigma_rad**-2
    nadir, rho = circle_on_sphere(rays, weight)
    for _ in range(_ROBUST_ROUNDS):
        if not np.isfinite(rho):
            break
        residual = (rays.angles(nadir)[0] - rho) / rays.sigma_rad
        scale = max(2.0 * robust_sigma(residual), 1.0)
        down = 1.0 / (1.0 + (residual / scale) ** 2) ** 2
        # Clean data end here after one look.
        if down.min() > 0.25:
            break
        nadir, rho = circle_on_sphere(rays, weight * down)
    return nadir, rho
