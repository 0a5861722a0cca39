"""The circle on the unit sphere nearest to a set of limb rays: the closed-form start."""

from __future__ import annotations

import numpy as np

from horizon_sensor_ros.core.fits.limb_rays import LimbRays

_ROBUST_ROUNDS = 6
# Without residuals beyond this there is nothing to reweight.
_CLEAN_SIGMAS = 5.0
_MAD_TO_SIGMA = 1.4826


def robust_sigma(values: np.ndarray) -> float:
    """Scale of residuals about zero from their median size."""
    return float(_MAD_TO_SIGMA * np.median(np.abs(values)))


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
        ratio = residual / max(robust_sigma(residual), 1.0)
        if np.abs(ratio).max() < _CLEAN_SIGMAS:
            break
        nadir, rho = circle_on_sphere(rays, weight / (1.0 + 0.25 * ratio * ratio) ** 2)
    return nadir, rho
