"""Maximum-likelihood horizon: pixel residuals along the limb's normals, robust, with covariance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from horizon_sensor_ros.core.fits.assessment import (
    MAX_RMS_PX,
    MIN_INLIER_FRACTION,
    cone_refusal,
    correlation_factor,
    fit_of_cone,
    root_mean_square,
    too_few,
    too_uncertain,
)
from horizon_sensor_ros.core.fits.circle import robust_circle_on_sphere
from horizon_sensor_ros.core.fits.limb_rays import LimbRays
from horizon_sensor_ros.core.fits.observation import LimbObservation, gather
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.mathematics.attitude import tangent_basis
from horizon_sensor_ros.core.mathematics.robust import TUKEY_SIGMAS, robust_sigma
from horizon_sensor_ros.core.mathematics.symmetric3 import inverse, solve
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.status import Status

METHOD = "ml"
# The residuals' scale, in units of their claimed sigmas, is measured but not believed below this.
_LEAST_SCALE = 0.1
_START_ROUNDS = 1  # of the circle to start from, which is weighted anew in every step anyway
_MAX_STEPS = 40
_MAX_HALVINGS = 8
_MAX_STEP_RAD = 0.3
_PATIENCE = 8  # steps after which a step is stretched
_NEAR_MINIMUM = 100.0  # (sigma)^2 of the last step; from here on Newton's are tried
_NO_STEP = np.full(3, np.nan)
_SCALE_STEPS = 3  # then the residuals' scale is kept
# Residual, in sigmas, of a point that says nothing about a cone; finite, so that nothing times it
# is nothing.
_NOWHERE = 1e30
# A step of this many (sigma)^2 is the last. One of `_NEAR_ENOUGH` will do when steps run out, or
# of Newton's method, which then leaves hardly anything.
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
    """`fit_maximum_likelihood` of points that are gathered already.

    initial : nadir (3,), base frame, and rho (rad) to start from; None: those of a robust circle.
    """
    refused = too_few(rays, METHOD)
    if refused:
        return refused
    nadir, rho = robust_circle_on_sphere(rays, _START_ROUNDS) if initial is None else initial
    nadir = np.asarray(nadir, dtype=float)
    length = math.sqrt(nadir @ nadir)
    if not (0.0 < length < math.inf and math.isfinite(rho)):
        reason = "the limb points do not determine a cone"
        return HorizonFit.none(Status.ILL_CONDITIONED, reason, METHOD, rays.num_points)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        found = _iterate(rays, nadir / length, float(rho))
        return _assess(rays, planet, *found)


@dataclass(frozen=True, eq=False)
class _Cone:
    """A cone and how the rays lie to it.

    chi : (N,) residuals in sigmas, `_NOWHERE` where the limb normal contradicts the cone. sine :
    (N,) of the rays' angles; growth : (N,) of those angles, rad per sigma, infinite likewise.
    """

    nadir: np.ndarray
    rho: float
    chi: np.ndarray
    sine: np.ndarray
    growth: np.ndarray

    def rows(self, rays: LimbRays, basis: np.ndarray) -> np.ndarray:
        """(N, 3): how chi moves with nadir's components along a basis (3, 2), and with rho."""
        rows = self.design(rays, basis)
        rows /= self.growth[:, None]
        return rows

    def design(self, rays: LimbRays, basis: np.ndarray) -> np.ndarray:
        """`LimbRays.design` (N, 3)."""
        out = np.empty((len(rays), 3))
        np.divide(rays.rays_base @ basis, -self.sine[:, None], out=out[:, :2])
        out[:, 2] = -1.0
        return out

    @property
    def state(self) -> list[float]:
        """Nadir and rho."""
        return [*self.nadir.tolist(), self.rho]


class _SeenCones:
    """Limb rays as the iteration looks at cones from them, again and again."""

    def __init__(self, rays: LimbRays) -> None:
        self._rays = rays.rays_base
        self._inward = rays.outward_base * -rays.sigma_px[:, None]
        self._least = rays.least_growth * rays.sigma_px

    def of(self, nadir: np.ndarray, rho: float) -> _Cone:
        """Return a cone as the rays see it."""
        cosine = np.minimum(np.maximum(self._rays @ nadir, -1.0), 1.0)
        sine = np.sqrt(np.maximum(1.0 - cosine * cosine, 1e-300))
        growth = (self._inward @ nadir) / sine
        chi = (np.arccos(cosine) - rho) / growth
        along = growth > self._least
        if not along.all():
            chi = np.where(along, chi, _NOWHERE)
            growth = np.where(along, growth, np.inf)
        return _Cone(nadir, rho, chi, sine, growth)

    def moved(self, cone: _Cone, basis: np.ndarray, step: np.ndarray) -> _Cone:
        """Return a cone moved by (3,): nadir's components along a basis (3, 2), and rho."""
        nadir = cone.nadir + basis @ step[:2]
        return self.of(nadir / math.sqrt(nadir @ nadir), cone.rho + float(step[2]))


def _scale(chi: np.ndarray) -> float:
    scale = robust_sigma(chi)
    return max(scale, _LEAST_SCALE) if scale < _NOWHERE else np.inf


def _rest(chi: np.ndarray, scale: float) -> np.ndarray:
    """What Tukey's biweight leaves of each residual (N,): its square is the weight."""
    ratio = chi * (1.0 / (TUKEY_SIGMAS * scale))
    ratio *= ratio
    return np.maximum(1.0 - ratio, 0.0)


def _agreement(rest: np.ndarray) -> float:
    """Number of points less Tukey's cost, in units of what it makes of a point that is far off."""
    return float((rest * rest) @ rest)


def _curvature(rest: np.ndarray) -> np.ndarray:
    """Second derivatives (N,) of Tukey's biweight by the residuals in sigmas; below zero far
    off.
    """
    return rest * (5.0 * rest - 4.0)


def _iterate(rays: LimbRays, nadir: np.ndarray, rho: float) -> tuple[_Cone, bool, np.ndarray]:
    """Gauss-Newton on two tangent components and rho, reweighted, with step halving.

    Returns the cone, whether it is the minimum, and the states (K, 4) on the way.
    """
    sight = _SeenCones(rays)
    cone = sight.of(nadir, rho)
    history = [cone.state]
    scale = length2 = np.inf
    for count in range(_MAX_STEPS):
        # A scale that kept following the residuals would make every step chase the last one.
        scale = _scale(cone.chi) if count < _SCALE_STEPS else scale
        if not scale < np.inf:
            break
        basis = tangent_basis(cone.nadir)
        rest = _rest(cone.chi, scale)
        weight = rest * rest
        rows = cone.rows(rays, basis)
        downhill = -((cone.chi * weight) @ rows)
        # Reweighting creeps; near the minimum Newton's method does not.
        step = _NO_STEP
        if length2 < _NEAR_MINIMUM * max(1.0, scale * scale):
            step = solve((rows * _curvature(rest)[:, None]).T @ rows, downhill)
        newton = step[0] < np.inf
        if not newton:
            step = solve((rows * weight[:, None]).T @ rows, downhill)
        largest = max(map(abs, step.tolist()))
        if not largest < np.inf:
            break
        if largest > _MAX_STEP_RAD:
            step *= _MAX_STEP_RAD / largest
        length2 = float(step @ downhill)
        # Within a sigma of the minimum Newton's step needs no second look.
        sure = newton and length2 < scale * scale
        agreement = -np.inf if sure else float(weight @ rest)
        for _ in range(_MAX_HALVINGS):
            new = sight.moved(cone, basis, step)
            if sure:
                break
            new_agreement = _agreement(_rest(new.chi, scale))
            if 0 < new.rho < np.pi and new_agreement >= agreement - 1e-9 * len(rays):
                break
            step *= 0.5
        else:
            # No descent left: at the minimum to within rounding, or lost.
            return cone, length2 < 1e-3 * max(1.0, scale * scale), np.array(history)
        if count >= _PATIENCE and not newton:
            new = _along_valley(sight, new, basis, step, scale)
        cone = new
        history.append(cone.state)
        if length2 < (_NEAR_ENOUGH if newton else _CONVERGED) * max(1.0, scale * scale):
            return cone, True, np.array(history)
    near = scale < np.inf and length2 < _NEAR_ENOUGH * max(1.0, scale * scale)
    return cone, near, np.array(history)


def _along_valley(
    sight: _SeenCones, cone: _Cone, basis: np.ndarray, step: np.ndarray, scale: float
) -> _Cone:
    """Where the way of a step (3,), in the basis (3, 2), leads on from a cone: along a valley
    reweighted steps creep, so it is gone on, ever farther, while it leads downwards.
    """
    agreement = _agreement(_rest(cone.chi, scale))
    while np.abs(step).max() < 0.5 * _MAX_STEP_RAD:
        far = sight.moved(cone, basis, step)
        far_agreement = _agreement(_rest(far.chi, scale))
        if not (0 < far.rho < np.pi and far_agreement > agreement):
            break
        cone, agreement = far, far_agreement
        step = 2.0 * step
    return cone


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
    design = cone.design(rays, basis)
    growth = (rays.outward_base @ nadir) / -cone.sine
    refused = cone_refusal(nadir, rho, growth, design)
    if refused:
        return refuse(*refused)
    if not converged:
        return refuse(Status.NOT_CONVERGED, f"no convergence in {len(history) - 1} steps")
    scale = _scale(chi)
    inlying = np.abs(chi) < TUKEY_SIGMAS * scale
    num_inliers = int(np.count_nonzero(inlying))
    residual = chi * rays.sigma_px
    rms = root_mean_square(residual if num_inliers == len(rays) else residual[inlying])
    if not rms <= MAX_RMS_PX:
        return refuse(Status.POOR_FIT, f"residual {rms:.1f} px rms")
    if num_inliers < max(MIN_INLIER_FRACTION * len(rays), 3):
        return refuse(Status.POOR_FIT, f"only {num_inliers} of {len(rays)} points on one limb")
    rows, along, camera = design / cone.growth[:, None], chi, rays.camera
    if not (rays.ordered and num_inliers == len(rays)):
        order = rays.along_limb(nadir)
        order = order[inlying[order]]
        rows, along, camera = rows[order], along[order], camera[order]
    ratio2 = np.square(along / (TUKEY_SIGMAS * scale))
    rest = 1.0 - ratio2
    psi = along * (rest * rest)
    slope = float(rest @ (1.0 - 5.0 * ratio2)) / num_inliers
    variance = float(psi @ psi) / max(num_inliers - 3, 1) / slope**2
    factor = max(1.0, variance * correlation_factor(psi, camera))
    cov = inverse(rows.T @ rows)
    cov *= factor
    refused = too_uncertain(cov, rho)
    if refused:
        return refuse(*refused)
    return fit_of_cone(
        METHOD,
        rays,
        planet,
        (nadir, rho),
        cov,
        basis,
        rms_px=rms,
        num_inliers=num_inliers,
        history=history,
    )
