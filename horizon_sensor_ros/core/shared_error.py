"""Errors of a fix that the limb points' own scatter cannot show, for the covariance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from horizon_sensor_ros.core.attitude import tangent_basis
from horizon_sensor_ros.core.figure import Figure
from horizon_sensor_ros.core.fits.assessment import covariance_nadir_altitude
from horizon_sensor_ros.core.fits.limb_rays import LimbRays
from horizon_sensor_ros.core.fits.observation import LimbObservation, gather
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.robust import median, stretches
from horizon_sensor_ros.core.symmetric3 import inverse

_STRETCHES = 6
_NEGLIGIBLE = 0.02  # shared variance over the points' own that is not worth adding
_MEDIAN_VARIANCE = np.pi / 2.0  # of a median of normal errors, over that of their mean
_SURE = 2.0  # times the points' own variance: what chance makes of it


def with_shared_error(
    fit: HorizonFit, observations: Sequence[LimbObservation], figure: Figure
) -> HorizonFit:
    """Return the fit with the errors that points share added to its covariance.

    Those are what stretches of the limb have in common (`LimbPoints.coherent_px`), and what the
    figure that was fitted leaves out of the planet's.
    """
    cov = fit.cov_nadir_altitude + _coherent_covariance(fit, observations, figure.sphere)
    cov += figure.covariance(fit, observations)
    return replace(fit, cov_nadir_altitude=cov)


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
    return bend if bend < math.inf else 9.0


def _coherent_covariance(
    fit: HorizonFit, observations: Sequence[LimbObservation], sphere: Planet
) -> np.ndarray:
    """Covariance (4, 4) of nadir and altitude from the errors that neighbouring points share.

    Each camera's limb counts as `_STRETCHES` independent stretches, whatever the number of points,
    or by the covariance of the cone that was fitted to it.
    """
    shares = []
    negligible = True
    for observation in observations:
        rays = gather([observation])
        if len(rays) < 2 * _STRETCHES or observation.view.name not in fit.cameras:
            continue
        claimed_px = observation.limb.coherent_px
        if claimed_px == 0.0:
            return np.zeros((4, 4))
        # What the stretches show of it, beyond their points' own errors, counts too, more than it
        # seems: the fit has bent to them.
        freedom = max(1.0 - 3.0 / (_STRETCHES * len(fit.cameras)), 0.25)
        own2 = _MEDIAN_VARIANCE * median(rays.sigma_px) ** 2 * _STRETCHES / len(rays)
        bend2 = max(bend_px(fit, rays) ** 2 / freedom - _SURE * own2, 0.0)
        coherent2 = max(claimed_px**2, bend2)
        negligible &= coherent2 < _NEGLIGIBLE * own2
        shares.append((observation, rays, coherent2))
    if negligible:
        return np.zeros((4, 4))
    basis = tangent_basis(fit.nadir_base)
    to_tangent = np.zeros((3, 4))
    to_tangent[:2, :3], to_tangent[2, 3] = basis.T, 1.0
    information = np.zeros((3, 3))
    shifts = []
    for observation, rays, coherent2 in shares:
        limb = observation.limb
        if limb.cov_cone is not None:
            more = coherent2 / limb.coherent_px**2
            information += inverse(more * to_tangent @ limb.cov_cone @ to_tangent.T)
            continue
        weight = _STRETCHES / (len(rays) * coherent2)
        rows = rays.design(fit.nadir_base, basis) / rays.angles(fit.nadir_base)[1][:, None]
        information += weight * rows.T @ rows
        shifts.append(limb.shift_px * weight * rows.sum(axis=0))
    gain = inverse(information)
    moved = [gain @ shift for shift in shifts]
    cov = gain + sum((np.outer(move, move) for move in moved), np.zeros((3, 3)))
    return covariance_nadir_altitude(cov, basis, fit.rho_rad, sphere)
