"""From nadir and disc radius to a `HorizonFit`: residuals, covariance, and whether to trust it."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np

from horizon_sensor_ros.core.fits.circle import circle_on_sphere
from horizon_sensor_ros.core.fits.limb_rays import LimbRays
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.mathematics.attitude import tangent_basis
from horizon_sensor_ros.core.mathematics.robust import median, robust_sigma
from horizon_sensor_ros.core.mathematics.symmetric3 import is_positive
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.status import Status

MIN_POINTS = 4
# Larger residuals than these are not a limb's.
MAX_RMS_PX = 3.0
# Beyond this the linearised covariance means nothing, nor does the nadir.
MAX_NADIR_SIGMA_RAD = 0.05
MIN_INLIER_FRACTION = 0.4
# Chords, or planes of symmetry, closer to parallel than this leave the vertical open.
LEAST_ANGLE_RAD = np.radians(3.0)
# Smallest eigenvalue of the mean squared design; an arc of a quarter of a degree.
_LEAST_EIGENVALUE = 1e-13
_INLIER_SIGMAS = 4.0
# Seen from a micrometre above the ground.
_LARGEST_RHO_RAD = np.pi / 2 - 1e-6
_LONGEST_WINDOW = 80
_FEW = 48  # residuals, whose correlation is not measured well
_CHANCE = 1.5  # sigmas of what few independent residuals show of correlation


def too_few(rays: LimbRays, method: str) -> HorizonFit | None:
    """Refusal for less than `MIN_POINTS` usable points, else None."""
    if len(rays) >= MIN_POINTS:
        return None
    reason = f"{len(rays)} usable limb points, {MIN_POINTS} needed"
    return HorizonFit.none(Status.TOO_FEW_POINTS, reason, method, rays.num_points)


def correlation_factor(values: np.ndarray, camera: np.ndarray) -> float:
    """How many times the variance of a sum of residuals exceeds that of independent ones.

    values, camera : (N,), in order along the limb. From the sums over a sliding window (Bartlett's
    estimate of the spectral density at frequency zero), corrected for what three fitted
    unknowns take out of it. Of less than `_FEW` points, where windows are few, it is that less
    `_CHANCE` sigmas of what chance makes of independent ones; of less than 24 it is 1.
    """
    few = len(values) < _FEW
    window = len(values) // 8 if few else min(len(values) // 12, _LONGEST_WINDOW)
    if window < 3:
        return 1.0
    chance = _CHANCE * math.sqrt(2.0 * window / len(values)) if few else 0.0
    power = 0.0
    count = 0
    last = int(camera[-1])
    ends = np.searchsorted(camera, np.arange(last + 2)).tolist() if last else [0, len(values)]
    for first, last in pairwise(ends):
        if last - first <= window:
            continue
        total = np.zeros(last - first + 1)
        np.cumsum(values[first:last], out=total[1:])
        sums = total[window:] - total[:-window]
        power += float(sums @ sums)
        count += len(sums)
    variance = float(values @ values) / len(values)
    if count == 0 or variance == 0:
        return 1.0
    return power / count / (window * variance) / (1.0 - 3.0 * window / len(values)) - chance


def tangent_rows(basis: np.ndarray) -> np.ndarray:
    """(3, 4) that takes a small change of nadir_base and one more number to its components along a
    tangent basis (3, 2), and that number.
    """
    rows = np.zeros((3, 4))
    rows[:2, :3], rows[2, 3] = basis.T, 1.0
    return rows


def covariance_nadir_altitude(
    cov: np.ndarray, basis: np.ndarray, rho_rad: float, planet: Planet
) -> np.ndarray:
    """(4, 4) of (nadir_base, altitude_m) from (3, 3) of (tangent components, rho)."""
    to_fit = np.zeros((4, 3))
    to_fit[:3, :2] = basis
    to_fit[3, 2] = planet.altitude_slope(rho_rad)
    out = to_fit @ cov @ to_fit.T
    return 0.5 * (out + out.T)


def birge_factor(chi2: float, freedom: int) -> float:
    """Factor, at least one, for covariances of results that differ by chi squared, with so many
    degrees of freedom: as if all claimed too little by the same share.

    Source: Birge, Phys. Rev. 40 (1932) 207.
    """
    return max(1.0, chi2 / freedom)


def cone_refusal(
    nadir_base: np.ndarray, rho_rad: float, growth: np.ndarray, design: np.ndarray
) -> tuple[Status, str] | None:
    """Why this cone cannot be the planet's limb as its points saw it; None if it can.

    growth (N,), design (N, 3) : of the points' angles, see `LimbRays`.
    """
    if not math.isfinite(float(nadir_base @ nadir_base) + rho_rad):
        return Status.ILL_CONDITIONED, "the limb points do not determine a cone"
    if rho_rad <= 0 or median(growth) <= 0:
        return Status.WRONG_POLARITY, "the limb normals point into the fitted disc"
    if rho_rad > _LARGEST_RHO_RAD:
        return Status.WRONG_POLARITY, "the limb is straight or curved the wrong way"
    information = design.T @ design
    information.ravel()[::4] -= _LEAST_EIGENVALUE * len(design)
    if not is_positive(information):
        return Status.ILL_CONDITIONED, "the limb points cover too little of the limb"
    return None


def too_uncertain(cov: np.ndarray, rho_rad: float) -> tuple[Status, str] | None:
    """Refusal when the covariance (3, 3), tangent components before rho, leaves nadir open; else
    None.

    On a short arc the errors that are nearly Gaussian are those of the limb's curvature, cot rho;
    a small disc fitted by chance looks sharper than it is. So the limit is put on the disc
    that the curvature less four sigma would mean.
    """
    reason = "the limb points do not determine nadir"
    if not math.isfinite(float(np.add.reduce(cov, axis=None))):
        return Status.ILL_CONDITIONED, reason
    sigma = math.sqrt(max(_larger_eigenvalue(cov), 0.0))
    curvature = 1.0 / math.tan(rho_rad) - 4.0 * sigma / math.sin(rho_rad) ** 2
    if math.atan2(1.0, curvature) - rho_rad <= 4.0 * MAX_NADIR_SIGMA_RAD:
        return None
    return Status.ILL_CONDITIONED, f"{reason}: its sigma is {np.degrees(sigma):.2g} deg or more"


def _larger_eigenvalue(cov: np.ndarray) -> float:
    """Variance along the longer axis of the first two components."""
    (a, b), (_, c) = cov[:2, :2].tolist()
    return 0.5 * (a + c + math.hypot(a - c, 2.0 * b))


def inliers(residual: np.ndarray) -> np.ndarray:
    """Mask (N,) of residuals within four robust sigma; none where most are infinite."""
    sigma = robust_sigma(residual)
    if not np.isfinite(sigma):
        return np.zeros(len(residual), dtype=bool)
    return np.abs(residual) <= max(_INLIER_SIGMAS * sigma, 1e-6)


def root_mean_square(residual: np.ndarray) -> float:
    """Root mean square of values (N,); infinite of none."""
    return math.sqrt(float(residual @ residual) / residual.size) if residual.size else np.inf


def assess_least_squares(
    rays: LimbRays,
    planet: Planet,
    method: str,
    nadir_base: np.ndarray,
    rho_rad: float,
    weight: np.ndarray,
    history: np.ndarray | None = None,
) -> HorizonFit:
    """Result of a fit that minimised ``sum weight (angle - rho)^2``, to first order.

    weight : (N,). The covariance is that estimator's under the points' sigmas, enlarged where the
    residuals are larger than those, or hang together along the limb, and by the estimator's bias on
    short arcs, taken as its distance from the nearly unbiased `circle_on_sphere`.
    """
    basis = tangent_basis(nadir_base) if np.all(np.isfinite(nadir_base)) else np.zeros((3, 2))
    design = rays.design(nadir_base, basis)
    refused = cone_refusal(nadir_base, rho_rad, rays.angles(nadir_base)[1], design)
    if refused:
        return HorizonFit.none(*refused, method, rays.num_points)
    residual = rays.residuals_px(nadir_base, rho_rad)
    inlying = inliers(residual)
    rms = root_mean_square(residual[inlying])
    if rms > MAX_RMS_PX:
        reason = f"residual {rms:.1f} px rms"
        return HorizonFit.none(Status.POOR_FIT, reason, method, rays.num_points)
    weighted = design * weight[:, None]
    influence = np.linalg.solve(weighted.T @ design, weighted.T) * rays.sigma_rad
    order = rays.along_limb(nadir_base)
    order = order[inlying[order]]
    chi = (residual / rays.sigma_px)[order]
    chi2 = float(chi @ chi) / max(len(chi) - 3, 1)
    factor = max(1.0, chi2 * correlation_factor(chi, rays.camera[order]))
    bias = difference_from_circle(rho_rad, basis, circle_on_sphere(rays))
    cov = influence @ influence.T * factor + np.outer(bias, bias)
    refused = too_uncertain(cov, rho_rad)
    if refused:
        return HorizonFit.none(*refused, method, rays.num_points)
    return fit_of_cone(
        method,
        rays,
        planet,
        (nadir_base, rho_rad),
        cov,
        basis,
        rms_px=rms,
        num_inliers=int(np.count_nonzero(inlying)),
        history=history,
    )


def assess_closed_form(
    rays: LimbRays,
    planet: Planet,
    method: str,
    nadir_base: np.ndarray,
    rho_rad: float,
    covariance: Callable[
        [np.ndarray, np.ndarray], tuple[np.ndarray, tuple[np.ndarray, float] | None]
    ],
    cameras: tuple[str, ...] | None = None,
) -> HorizonFit:
    """Result of a method that has a covariance of its own, by the points that lie on its cone.

    covariance : of `tangent_basis` (3, 2) and design (N, 3), see `LimbRays`, makes the estimator's
    (3, 3), which decides whether there is an answer; and of an approximation a nearly unbiased
    circle, nadir and rho, from which its own error is told, else None. cameras : as of
    `fit_of_cone`.
    """
    basis = tangent_basis(nadir_base)
    design = rays.design(nadir_base, basis)
    refused = cone_refusal(nadir_base, rho_rad, rays.angles(nadir_base)[1], design)
    if refused:
        return HorizonFit.none(*refused, method, rays.num_points)
    cov, circle = covariance(basis, design)
    refused = too_uncertain(cov, rho_rad)
    if refused:
        return HorizonFit.none(*refused, method, rays.num_points)
    residual = rays.residuals_px(nadir_base, rho_rad)
    inlying = inliers(residual)
    if not inlying.any():
        reason = "the limb normals do not fit the cone"
        return HorizonFit.none(Status.POOR_FIT, reason, method, rays.num_points)
    if circle is not None:
        bias = difference_from_circle(rho_rad, basis, circle)
        cov = cov + np.outer(bias, bias)
    return fit_of_cone(
        method,
        rays,
        planet,
        (nadir_base, rho_rad),
        cov,
        basis,
        rms_px=root_mean_square(residual[inlying]),
        num_inliers=int(np.count_nonzero(inlying)),
        cameras=cameras,
    )


def fit_of_cone(
    method: str,
    rays: LimbRays,
    planet: Planet,
    cone: tuple[np.ndarray, float],
    cov: np.ndarray,
    basis: np.ndarray,
    *,
    rms_px: float,
    num_inliers: int,
    cameras: tuple[str, ...] | None = None,
    history: np.ndarray | None = None,
) -> HorizonFit:
    """Answer that a cone, (nadir in the base frame, rho), gives.

    cov : (3, 3) of the components of nadir along `basis`, its `tangent_basis`, and rho. rms_px : of
    the residuals of the points on it. cameras : that it is from; all unless they are given.
    """
    nadir_base, rho_rad = cone
    return HorizonFit(
        Status.OK,
        "",
        method,
        nadir_base=nadir_base,
        rho_rad=float(rho_rad),
        altitude_m=planet.altitude_from_rho(rho_rad),
        cov_nadir_altitude=covariance_nadir_altitude(cov, basis, rho_rad, planet),
        rms_residual_px=rms_px,
        num_points=rays.num_points,
        num_inliers=num_inliers,
        cameras=rays.cameras if cameras is None else cameras,
        history=np.empty((0, 4)) if history is None else history,
    )


def difference_from_circle(
    rho_rad: float, basis: np.ndarray, circle: tuple[np.ndarray, float]
) -> np.ndarray:
    """Difference (3,) in (tangent components, rho) from a nearly unbiased circle (nadir, rho).

    Its outer product is what an estimator's bias or an approximation adds to its covariance.
    """
    return np.append(circle[0] @ basis, circle[1] - rho_rad)
