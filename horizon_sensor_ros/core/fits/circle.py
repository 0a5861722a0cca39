"""The circle on the unit sphere nearest to a set of limb rays: the closed-form start."""

from __future__ import annotations

import math

import numpy as np

from horizon_sensor_ros.core.fits.limb_rays import LimbRays
from horizon_sensor_ros.core.mathematics.rigid import cross
from horizon_sensor_ros.core.mathematics.robust import lower_quantile

_ROBUST_ROUNDS = 6
# Without residuals beyond this, at a scale not far above the claimed one, there are no outliers.
_CLEAN_SIGMAS = 5.0
_TRIPLES = 200
_TESTED_POINTS = 300
_QUANTILE = 0.4
# 40 % of a Gaussian's values lie within this many sigma.
_QUANTILE_SIGMAS = 0.5244


def circle_on_sphere(rays: LimbRays, weight: np.ndarray | None = None) -> tuple[np.ndarray, float]:
    """Nadir (3,) and rho of the circle on the unit sphere nearest to the rays; NaN if undetermined.

    Minimises ``sum w (u . n - cos rho)^2 / sin^2 rho``, the squared angles from the circle to first
    order (Taubin's normalisation on the sphere), by a 4 x 4 eigenvalue problem; so it is not
    drawn to small circles by short arcs, and regular where rho nears 90 deg. The limb's
    normals decide which side is the planet's. weight : (N,), by default from the sigmas.
    """
    if weight is None:
        weight = rays.sigma_rad**-2
    points = np.empty((len(rays), 4))
    points[:, :3], points[:, 3] = rays.rays_base, -1.0
    scatter = (points * (weight / weight.sum())[:, None]).T @ points
    scatter[3] *= -1.0
    values, vectors = np.linalg.eig(scatter)
    values, vectors = values.real, vectors.real
    # A circle has a vector with n . n > d . d; rounding may leave its eigenvalue just below zero.
    size = (vectors[:3] ** 2).sum(axis=0) - vectors[3] ** 2
    proper = np.flatnonzero(size > 0)
    if proper.size == 0:
        return np.full(3, np.nan), np.nan
    best = vectors[:, proper[np.argmin(np.abs(values[proper]))]]
    norm = np.linalg.norm(best[:3])
    nadir, cos_rho = best[:3] / norm, best[3] / norm
    if rays.points_to_space(nadir):
        nadir, cos_rho = -nadir, -cos_rho
    return nadir, float(np.arccos(np.clip(cos_rho, -1.0, 1.0)))


def robust_circle_on_sphere(
    rays: LimbRays, rounds: int = _ROBUST_ROUNDS
) -> tuple[np.ndarray, float]:
    """`circle_on_sphere` of the points that agree, found by consensus where not all do.

    The circle through three points whose residuals' 40 % quantile is least (of a fixed number of
    triples, the same ones for the same points) starts a reweighting by Geman and McClure's
    function, so many rounds of it. Holds up to about half of the points being elsewhere. Returns
    nadir (3,) and rho (rad), NaN where there is no circle.
    """
    weight = rays.sigma_rad**-2
    nadir, rho = circle_on_sphere(rays, weight)
    if not np.isfinite(rho):
        return nadir, rho
    residual = (rays.angles(nadir)[0] - rho) / rays.sigma_rad
    if np.abs(residual).max() < _CLEAN_SIGMAS * min(max(_quantile_sigma(residual), 1.0), 5.0):
        return nadir, rho
    nadir, rho = _best_triple(rays, nadir, rho)
    for _ in range(rounds):
        residual = (rays.angles(nadir)[0] - rho) / rays.sigma_rad
        ratio = 0.5 * residual / max(_quantile_sigma(residual), 1.0)
        nadir, rho = circle_on_sphere(rays, weight / (1.0 + ratio * ratio) ** 2)
        if not np.isfinite(rho):
            break
    return nadir, rho


def _quantile_sigma(residual: np.ndarray) -> float:
    """Scale of the best 40 % of the residuals, were they Gaussian."""
    return lower_quantile(np.abs(residual), _QUANTILE) / _QUANTILE_SIGMAS


def _best_triple(rays: LimbRays, nadir: np.ndarray, rho: float) -> tuple[np.ndarray, float]:
    """The circle with the least residual quantile, out of the given one and those of triples."""
    rng = np.random.default_rng(0)
    triples = rays.rays_base[rng.integers(0, len(rays), (_TRIPLES, 3))]
    normals = cross(triples[:, 1] - triples[:, 0], triples[:, 2] - triples[:, 0])
    length = np.sqrt(np.einsum("ij,ij->i", normals, normals))
    proper = length > 1e-12
    normals = normals[proper] / length[proper, None]
    cosines = np.einsum("ij,ij->i", normals, triples[proper, 0])
    normals = np.vstack((nadir, normals))
    cosines = np.append(np.cos(rho), cosines)
    some = rng.permutation(len(rays))[:_TESTED_POINTS]
    # Angles from the circles, to first order: it is the near ones that count.
    distance = np.abs(normals @ rays.rays_base[some].T - cosines[:, None])
    distance /= np.sqrt(np.maximum(1.0 - cosines * cosines, 1e-12))[:, None]
    distance /= rays.sigma_rad[some]
    rank = int(_QUANTILE * (len(some) - 1))
    best = int(np.argmin(np.partition(distance, rank, axis=1)[:, rank]))
    nadir, cosine = normals[best], float(cosines[best])
    if rays.points_to_space(nadir):
        nadir, cosine = -nadir, -cosine
    return nadir, math.acos(min(max(cosine, -1.0), 1.0))
