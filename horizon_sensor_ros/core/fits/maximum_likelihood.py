"""Maximum-likelihood horizon: pixel residuals along the limb's normals, robust, with covariance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from horizon_sensor_ros.core.attitude import tangent_basis
from horizon_sensor_ros.core.fits.assessment import (
    MAX_RMS_PX,
    MIN_INLIER_FRACTION,
    correlation_factor,
    covariance_nadir_altitude,
    refusal,
    too_few,
    too_uncertain,
)
from horizon_sensor_ros.core.fits.circle import robust_circle_on_sphere
from horizon_sensor_ros.core.fits.limb_rays import LimbRays, gather
from horizon_sensor_ros.core.fits.result import HorizonFit, LimbObservation
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.robust import robust_sigma
from horizon_sensor_ros.core.status import Status

METHOD = "ml"
# Tukey's biweight: 95 % efficient for Gaussian residuals, blind to those beyond this many sigma.
_TUKEY = 4.685
# The residuals' scale, in units of their claimed sigmas, is measured but not believed below this.
_LEAST_SCALE = 0.1
_MAX_STEPS = 40
_MAX_HALVINGS = 8
_MAX_STEP_RAD = 0.3
_PATIENCE = 8  # steps after which a step is stretched
_SCALE_STEPS = 4  # then the residuals' scale is kept
# A step of this many (sigma)^2 is the last; one of `_NEAR_ENOUGH` will do when the steps run out.
_CONVERGED = 1e-5
_NEAR_ENOUGH = 1e-3


def fit_maximum_likelihood(
    observations: Sequence[LimbObservation],
    planet: Planet,
    initial: tuple[np.ndarray, float] | None = None,
) -> HorizonFit:
    """Nadir and rho that make the pixel residuals along the limb's normals most likely.

    initial : (nadir_base (3,), rho_rad) to start from; by default a closed-form robust circle.
    Source: derived here; the residual's first-order scaling is that of orthogonal distance fits.
    """
    return refine(gather(observations), planet, initial)


def refine(
    rays: LimbRays,
    planet: Planet,
    initial: tuple[np.ndarray, float] | None = None,
) -> HorizonFit:
    """`fit_maximum_likelihood` of points that are gathered already."""
    refused = too_few(rays, METHOD)
    if refused:
        return refused
    nadir, rho = robust_circle_on_sphere(rays) if initial is None else initial
    nadir = np.asarray(nadir, dtype=float)
    if not (np.all(np.isfinite(nadir)) and np.isfinite(rho) and np.any(nadir)):
        reason = "the limb points do not determine a cone"
        return HorizonFit.none(Status.ILL_CONDITIONED, reason, METHOD, rays.num_points)
    with np.errstate(divide="ignore", invalid="ignore"):
        start = _Cone.seen_by(rays, nadir / np.linalg.norm(nadir), float(rho))
        return _assess(rays, planet, *_iterate(rays, start))


@dataclass(frozen=True)
class _Cone:
    """A cone and how the rays lie to it.

    chi : (N,) residuals in sigmas, infinite where the limb normal contradicts the cone. growth :
    (N,) of the rays' angles, rad per sigma.
    """

    nadir: np.ndarray
    rho: float
    chi: np.ndarray
    growth: np.ndarray

    @classmethod
    def seen_by(cls, rays: LimbRays, nadir: np.ndarray, rho: float) -> _Cone:
        """Return the cone with the residuals of rays."""
        residual, growth = rays.residuals_and_growth(nadir, rho)
        return cls(nadir, rho, residual / rays.sigma_px, growth * rays.sigma_px)

    def moved(self, rays: LimbRays, basis: np.ndarray, step: np.ndarray) -> _Cone:
        """Return the cone moved by (3,): nadir's components along a basis (3, 2), and rho."""
        nadir = self.nadir + basis @ step[:2]
        return _Cone.seen_by(rays, nadir / np.linalg.norm(nadir), self.rho + float(step[2]))

    @property
    def state(self) -> np.ndarray:
        """(4,) nadir and rho."""
        return np.append(self.nadir, self.rho)


def _scale(chi: np.ndarray) -> float:
    scale = robust_sigma(chi)
    return max(scale, _LEAST_SCALE) if np.isfinite(scale) else np.inf


def _tukey_cost(chi: np.ndarray, scale: float) -> float:
    rest = np.maximum(1.0 - (chi / (_TUKEY * scale)) ** 2, 0.0)
    return float((1.0 - rest * rest * rest).sum()) * (_TUKEY * scale) ** 2 / 6.0


def _iterate(rays: LimbRays, start: _Cone) -> tuple[_Cone, bool, np.ndarray]:
    """Gauss-Newton on two tangent components and rho, reweighted, with step halving.

    Returns the cone, whether it is the minimum, and the states (K, 4) on the way.
    """
    cone = start
    history = [cone.state]
    scale = length2 = np.inf
    for count in range(_MAX_STEPS):
        # A scale that kept following the residuals would make every step chase the last one.
        scale = _scale(cone.chi) if count < _SCALE_STEPS else scale
        if not np.isfinite(scale):
            break
        basis = tangent_basis(cone.nadir)
        weight = np.maximum(1.0 - (cone.chi / (_TUKEY * scale)) ** 2, 0.0)
        weight *= weight
        rows = rays.design(cone.nadir, basis)
        rows /= np.where(weight > 0, cone.growth, np.inf)[:, None]
        weighted = rows * weight[:, None]
        information = weighted.T @ rows
        step = _solve(information, -(weighted.T @ np.where(weight > 0, cone.chi, 0.0)))
        if not np.all(np.isfinite(step)):
            break
        step *= min(1.0, _MAX_STEP_RAD / max(float(np.abs(step).max()), 1e-300))
        length2 = float(step @ information @ step)
        cost = _tukey_cost(cone.chi, scale)
        for _ in range(_MAX_HALVINGS):
            new = cone.moved(rays, basis, step)
            new_cost = _tukey_cost(new.chi, scale)
            if 0 < new.rho < np.pi and new_cost <= cost + 1e-9 * (1.0 + cost):
                break
            step *= 0.5
        else:
            # No descent left: at the minimum to within rounding, or lost.
            return cone, length2 < 1e-3 * max(1.0, scale * scale), np.array(history)
        if count >= _PATIENCE:
            # Along a valley reweighted steps creep: the same way on, while it leads downwards.
            while np.abs(step).max() < 0.5 * _MAX_STEP_RAD:
                far = new.moved(rays, basis, step)
                far_cost = _tukey_cost(far.chi, scale)
                if not (0 < far.rho < np.pi and far_cost < new_cost):
                    break
                new, new_cost = far, far_cost
                step *= 2.0
        cone = new
        history.append(cone.state)
        if length2 < _CONVERGED * max(1.0, scale * scale):
            return cone, True, np.array(history)
    near = np.isfinite(scale) and length2 < _NEAR_ENOUGH * max(1.0, scale * scale)
    return cone, bool(near), np.array(history)


def _solve(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve a symmetric 3 x 3 system, scaled to a unit diagonal; NaN when it is singular."""
    diagonal = np.sqrt(np.diag(matrix))
    if not np.all(diagonal > 0):
        return np.full(3, np.nan)
    try:
        return np.linalg.solve(matrix / np.outer(diagonal, diagonal), right / diagonal) / diagonal
    except np.linalg.LinAlgError:
        return np.full(3, np.nan)


def _assess(
    rays: LimbRays, planet: Planet, cone: _Cone, converged: bool, history: np.ndarray
) -> HorizonFit:
    """Judge the fit and give its covariance.

    The covariance is the M-estimator's, ``(A^T A)^-1 mean psi^2 / (mean psi')^2`` over the inliers
    (Huber 1981), enlarged by the residuals' correlation along the limb, and never smaller than
    the claimed sigmas allow.
    """

    def refuse(status: Status, reason: str) -> HorizonFit:
        return HorizonFit.none(status, reason, METHOD, rays.num_points)

    nadir, rho, chi = cone.nadir, cone.rho, cone.chi
    basis = tangent_basis(nadir)
    design = rays.design(nadir, basis)
    refused = refusal(rays, nadir, rho, design)
    if refused:
        return refuse(*refused)
    if not converged:
        return refuse(Status.NOT_CONVERGED, f"no convergence in {len(history) - 1} steps")
    scale = _scale(chi)
    inlying = np.abs(chi) < _TUKEY * scale
    num_inliers = int(np.count_nonzero(inlying))
    rms = float(np.sqrt(np.mean((chi[inlying] * rays.sigma_px[inlying]) ** 2)))
    if not rms <= MAX_RMS_PX:
        return refuse(Status.POOR_FIT, f"residual {rms:.1f} px rms")
    if num_inliers < max(MIN_INLIER_FRACTION * len(rays), 3):
        return refuse(Status.POOR_FIT, f"only {num_inliers} of {len(rays)} points on one limb")
    rows = design[inlying] / cone.growth[inlying, None]
    order = rays.along_limb(nadir)
    order = order[inlying[order]]
    along = chi[order]
    ratio2 = (along / (_TUKEY * scale)) ** 2
    psi = along * (1.0 - ratio2) ** 2
    slope = float(np.mean((1.0 - ratio2) * (1.0 - 5.0 * ratio2)))
    variance = float(psi @ psi) / max(num_inliers - 3, 1) / slope**2
    factor = max(1.0, variance * correlation_factor(psi, rays.camera[order]))
    information = rows.T @ rows / factor
    diagonal = np.sqrt(np.diag(information))
    try:
        cov = np.linalg.inv(information / np.outer(diagonal, diagonal))
    except np.linalg.LinAlgError:
        return refuse(Status.ILL_CONDITIONED, "the limb points do not determine a cone")
    cov /= np.outer(diagonal, diagonal)
    refused = too_uncertain(cov, rho)
    if refused:
        return refuse(*refused)
    return HorizonFit(
        Status.OK,
        "",
        METHOD,
        nadir_base=nadir,
        rho_rad=rho,
        altitude_m=planet.altitude_from_rho(rho),
        cov_nadir_altitude=covariance_nadir_altitude(cov, basis, rho, planet),
        rms_residual_px=rms,
        num_points=rays.num_points,
        num_inliers=num_inliers,
        cameras=rays.cameras,
        history=history,
    )
