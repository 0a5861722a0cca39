"""Errors of a fix that the limb points' own scatter cannot show, for the covariance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from horizon_sensor_ros.core.attitude import tangent_basis
from horizon_sensor_ros.core.fits.assessment import covariance_nadir_altitude, tangent_rows
from horizon_sensor_ros.core.fits.limb_rays import LimbRays
from horizon_sensor_ros.core.fits.observation import LimbObservation, gather
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.robust import median, stretches
from horizon_sensor_ros.core.symmetric3 import inverse

_STRETCHES = 6
_NEGLIGIBLE = 0.02  # shared variance over the points' own that is not worth adding
_MEDIAN_VARIANCE = np.pi / 2.0  # of a median of normal errors, over that of their mean
_NOT_A_LIMB_PX = 9.0  # bend of a limb to which no distance can be told: no limb bends so far
_MOST_DARK = 4.0  # usual brightness over that of a place: less is not measured well
_SURE = 2.0  # times the points' own variance: what chance makes of it


def with_shared_error(
    fit: HorizonFit, observations: Sequence[LimbObservation], sphere: Planet
) -> HorizonFit:
    """Add to a fit's covariance the errors that points share.

    Of each camera: what stretches of its limb have in common (`LimbPoints.shared`), or the
    errors of the cone that its points lie on (`LimbPoints.cone_errors`).
    """
    return replace(fit, cov_nadir_altitude=_with_shared(fit, observations, sphere))


def bend_px(fit: HorizonFit, rays: LimbRays) -> float:
    """How far stretches of one camera's limb lie off the fitted one, RMS of their medians."""
    # Covariance and judgement ask the same.
    return _bend_px(rays, tuple(fit.nadir_base.tolist()), fit.rho_rad)


@lru_cache(maxsize=8)
def _bend_px(rays: LimbRays, nadir_base: tuple[float, ...], rho_rad: float) -> float:
    nadir = np.array(nadir_base)
    residual = rays.residuals_px(nadir, rho_rad)[rays.along_limb(nadir)]
    medians = [median(part) for part in stretches(residual, _STRETCHES)]
    bend = math.sqrt(sum(middle * middle for middle in medians) / _STRETCHES)
    return bend if bend < math.inf else _NOT_A_LIMB_PX


def _with_shared(
    fit: HorizonFit, observations: Sequence[LimbObservation], sphere: Planet
) -> np.ndarray:
    """Covariance (4, 4) of nadir and altitude with the errors that neighbouring points share.

    The fit is linear in where the points lie, so its errors are theirs: their own, which are in its
    covariance already, and those of `_STRETCHES` independent stretches of each camera's limb,
    whatever the number of points; or the covariance of the cone that was fitted to a camera's limb,
    which holds both.
    """
    cameras = []
    negligible = True
    for observation in observations:
        rays = gather([observation])
        if len(rays) == 0 or observation.view.name not in fit.cameras:
            continue
        limb = observation.limb
        claimed_px = limb.shared.coherent_px if len(rays) >= 2 * _STRETCHES else 0.0
        own2 = _MEDIAN_VARIANCE * median(rays.sigma_px) ** 2 * _STRETCHES / len(rays)
        if limb.cone_errors is not None:
            negligible = False
        elif claimed_px > 0.0:
            negligible &= claimed_px**2 < _NEGLIGIBLE * own2 and bend_px(fit, rays) ** 2 < own2
        if limb.shared.scale_px > 0.0:
            scaled_px = limb.shared.scale_px * float(np.ptp(rays.log_scale))
            negligible &= scaled_px**2 < _NEGLIGIBLE * own2
        alike2 = limb.shared.shift_px**2 + limb.shared.height_px**2
        negligible &= alike2 < _NEGLIGIBLE * own2
        darker_px = _darker_px(limb, rays)
        negligible &= float(np.ptp(darker_px)) ** 2 < _NEGLIGIBLE * own2
        cameras.append((limb, rays, claimed_px**2, own2, darker_px))
    if negligible:
        return fit.cov_nadir_altitude
    basis = tangent_basis(fit.nadir_base)
    to_tangent = tangent_rows(basis)
    rows = [camera[1].design_sigmas(fit.nadir_base, basis) for camera in cameras]
    gain = inverse(sum((a.T @ a for a in rows), np.zeros((3, 3))))
    cov, of_cones = np.zeros((3, 3)), np.zeros((3, 1))
    height, by_scale = np.zeros(3), np.zeros(3)
    usual = _usual_log_scale([(limb, rays) for limb, rays, *_ in cameras])
    variance = np.diag(fit.cov_nadir_altitude).copy()
    variance[3] /= sphere.altitude_slope(fit.rho_rad) ** 2
    # Factor between the variance that the fit found for the points and that which they claim.
    more_own = float(variance.sum() / np.trace(gain))
    for (limb, rays, claimed2, own2, darker_px), a in zip(cameras, rows, strict=True):
        # How a sigma of each point moves the fit, and a pixel.
        by_sigma = a @ gain
        by_px = by_sigma / rays.sigma_px[:, None]
        order = rays.along_limb(fit.nadir_base)
        coherent2 = claimed2
        if claimed2 > 0.0:
            # What the stretches show of it, beyond their points' own errors, counts too.
            left = _left(a[order] * rays.sigma_px[order, None], by_px[order])
            coherent2 = max(claimed2, bend_px(fit, rays) ** 2 / left - _SURE * own2)
        if limb.cone_errors is not None:
            more = math.sqrt(max(coherent2 / limb.shared.coherent_px**2, 1.0))
            of_cones = of_cones + more * by_sigma.T @ a @ to_tangent @ limb.cone_errors
            continue
        of_all = by_px.sum(axis=0)
        shift = limb.shared.shift_px * of_all
        height += limb.shared.height_px * of_all
        cov += more_own * by_sigma.T @ by_sigma + np.outer(shift, shift)
        if limb.shared.slope_px > 0.0:
            ends = limb.shared.slope_px * np.linspace(-1.0, 1.0, len(rays)) @ by_px[order]
            cov += np.outer(ends, ends)
        if limb.shared.scale_px > 0.0:
            by_scale += limb.shared.scale_px * (rays.log_scale - usual) @ by_px
        if limb.shared.dark_px > 0.0:
            darker = darker_px @ by_px
            cov += np.outer(darker, darker)
        cov += coherent2 * len(rays) / _STRETCHES * by_px.T @ by_px
    cov += np.outer(height, height) + np.outer(by_scale, by_scale) + of_cones @ of_cones.T
    return covariance_nadir_altitude(cov, basis, fit.rho_rad, sphere)


def _usual_log_scale(limbs: Sequence[tuple[LimbPoints, LimbRays]]) -> float:
    """Mean `LimbRays.log_scale` of points with an error that goes with it: what they share there is
    one height of the limb.
    """
    of_points = [rays.log_scale for limb, rays in limbs if limb.shared.scale_px > 0.0]
    return float(np.concatenate(of_points).mean()) if of_points else 0.0


def _darker_px(limb: LimbPoints, rays: LimbRays) -> np.ndarray:
    """One sigma (N,) of the error that goes with darkness, less its mean, which is height.

    What changes faster along the limb than the Sun's height does turns none.
    """
    if limb.shared.dark_px == 0.0 or len(rays.step) != len(rays):
        return np.zeros(len(rays))
    usual = median(rays.step)
    darkness = usual / np.maximum(rays.step, usual / _MOST_DARK)
    powers = _slow_powers(len(rays))
    slow = darkness @ powers.T @ powers
    return np.asarray(limb.shared.dark_px * (slow - slow.mean()))


@lru_cache(maxsize=8)
def _slow_powers(count: int) -> np.ndarray:
    """Orthonormal polynomials (3, count), to the second degree, of the place along a limb."""
    return np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, count), 3, increasing=True))[0].T


def _left(rows_px: np.ndarray, by_px: np.ndarray) -> float:
    """Share of the variance of independent errors of stretches that is left in the residuals.

    rows_px : (N, 3) derivatives of the points' residuals by the cone's three unknowns. by_px :
    (N, 3) derivatives of these by the points' places. Both in order along the limb.
    """
    starts = [part[0] for part in stretches(np.arange(len(rows_px)), _STRETCHES)]
    sizes = np.diff([*starts, len(rows_px)])
    fitted = np.add.reduceat(rows_px, starts) / sizes[:, None] @ np.add.reduceat(by_px, starts).T
    return float(np.mean(np.sum((np.eye(_STRETCHES) - fitted) ** 2, axis=1)))
