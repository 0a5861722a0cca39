"""Errors of a fix that the limb points' own scatter cannot show, for the covariance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from horizon_sensor_ros.core.covariance.same_limb import common_stretches, of_same_limb
from horizon_sensor_ros.core.fits.assessment import covariance_nadir_altitude, tangent_rows
from horizon_sensor_ros.core.fits.limb_rays import LimbRays
from horizon_sensor_ros.core.fits.observation import LimbObservation
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.limb_points import STRETCHES, LimbPoints
from horizon_sensor_ros.core.mathematics.attitude import tangent_basis
from horizon_sensor_ros.core.mathematics.parts import starts_and_sizes
from horizon_sensor_ros.core.mathematics.robust import median, medians
from horizon_sensor_ros.core.mathematics.symmetric3 import inverse
from horizon_sensor_ros.core.planet import Planet

_NEGLIGIBLE = 0.02  # shared variance over the points' own that is not worth adding
_MEDIAN_VARIANCE = np.pi / 2.0  # of a median of normal errors, over that of their mean
_NOT_A_LIMB_PX = 9.0  # bend of a limb to which no distance can be told: no limb bends so far
_MOST_DARK = 4.0  # usual brightness over that of a place: less is not measured well
# Times what is claimed of stretches and of their points, the square of a bend that chance makes:
# six stretches less three unknowns show twice as much one time in nine.
_BY_CHANCE = 2.0


def with_shared_error(
    fit: HorizonFit, observations: Sequence[LimbObservation], sphere: Planet
) -> HorizonFit:
    """Add to a fit's covariance the errors that points share.

    Of each camera: what stretches of its limb have in common (`LimbPoints.shared`), or the
    errors of the cone that its points lie on (`LimbPoints.cone_errors`). Of cameras that see the
    same limb, but for cones: what it does to edges (`same_limb`).
    """
    return replace(fit, cov_nadir_altitude=covariance_with_shared(fit, observations, sphere))


def bend_px(fit: HorizonFit, rays: LimbRays) -> float:
    """How far stretches of one camera's limb lie off the fitted one, RMS of their medians."""
    # Covariance and judgement ask the same.
    return _bend_px(rays, tuple(fit.nadir_base.tolist()), fit.rho_rad)


@lru_cache(maxsize=8)
def _bend_px(rays: LimbRays, nadir_base: tuple[float, ...], rho_rad: float) -> float:
    nadir = np.array(nadir_base)
    residual = rays.residuals_px(nadir, rho_rad)[rays.along_limb(nadir)]
    middles = medians(residual, STRETCHES)
    bend = math.sqrt(sum(middle * middle for middle in middles) / STRETCHES)
    return bend if bend < math.inf else _NOT_A_LIMB_PX


@dataclass(frozen=True, eq=False)
class _Shared:
    """One camera's points and what they share.

    claimed2 : px^2, of a stretch of limb, 0 where there are too few points for stretches. own2 : of
    a stretch by its points' own errors. darker_px : (N,), see `_darker_px`.
    """

    limb: LimbPoints
    rays: LimbRays
    claimed2: float
    own2: float
    darker_px: np.ndarray

    @classmethod
    def of(cls, limb: LimbPoints, rays: LimbRays) -> _Shared:
        """What the points of a limb share."""
        claimed_px = limb.shared.coherent_px if len(rays) >= 2 * STRETCHES else 0.0
        own2 = _MEDIAN_VARIANCE * median(rays.sigma_px) ** 2 * STRETCHES / len(rays)
        return cls(limb, rays, claimed_px**2, own2, _darker_px(limb, rays))

    def negligible(self, fit: HorizonFit) -> bool:
        """Whether all of it is, beside the points' own errors."""
        shared, own2 = self.limb.shared, self.own2
        if self.limb.cone_errors is not None or shared.fields_px > 0.0:
            return False
        negligible = shared.shift_px**2 + shared.height_px**2 < _NEGLIGIBLE * own2
        if shared.dark_px > 0.0:
            negligible &= float(np.ptp(self.darker_px)) ** 2 < _NEGLIGIBLE * own2
        if shared.scale_px > 0.0:
            scaled_px = shared.scale_px * float(np.ptp(self.rays.log_scale))
            negligible &= scaled_px**2 < _NEGLIGIBLE * own2
        if negligible and self.claimed2 > 0.0:
            bend2 = bend_px(fit, self.rays) ** 2
            negligible = self.claimed2 < _NEGLIGIBLE * own2 and bend2 < own2
        return negligible

    def coherent2(
        self, fit: HorizonFit, order: np.ndarray, rows_px: np.ndarray, by_px: np.ndarray
    ) -> float:
        """px^2 that a stretch is off by: what is claimed, and what the stretches show beyond what
        chance makes of that and of their points' own errors. order : (N,) of the points along the
        limb. rows_px : (N, 3) of the design, in pixels. by_px : (N, 3) how a pixel of each point
        moves the fit.
        """
        if self.claimed2 == 0.0:
            return 0.0
        left = _left(rows_px[order], by_px[order])
        beyond2 = bend_px(fit, self.rays) ** 2 / left - _BY_CHANCE * (self.claimed2 + self.own2)
        return self.claimed2 + max(beyond2, 0.0)

    def of_the_limb(self, order: np.ndarray, by_px: np.ndarray) -> np.ndarray:
        """Covariance (3, 3) of what all points share, with no other limb's. order, by_px : as of
        `coherent2`.
        """
        shared = self.limb.shared
        shift = shared.shift_px * by_px.sum(axis=0)
        cov = np.multiply.outer(shift, shift)
        if shared.slope_px > 0.0:
            ends = shared.slope_px * np.linspace(-1.0, 1.0, len(order)) @ by_px[order]
            cov += np.outer(ends, ends)
        if shared.dark_px > 0.0:
            darker = self.darker_px @ by_px
            cov += np.outer(darker, darker)
        return cov


def moved_by_fields(fields_px: float, order: np.ndarray, by_px: np.ndarray) -> np.ndarray:
    """How (K, 3) two fields that show a limb so far apart may move a fit of it, one sigma each,
    independent of each other. order, by_px : as of `_Shared.coherent2`.

    A limb found amid both is half of it away from either, as a whole and at its ends; and each
    stretch of it may be anywhere between them.
    """
    ends = np.linspace(-1.0, 1.0, len(order)) @ by_px[order]
    starts, _ = starts_and_sizes(len(order), STRETCHES)
    of_stretches = np.add.reduceat(by_px[order], starts) / math.sqrt(3.0)
    return 0.5 * fields_px * np.vstack([by_px.sum(axis=0), ends, of_stretches])


def covariance_with_shared(
    fit: HorizonFit, observations: Sequence[LimbObservation], sphere: Planet
) -> np.ndarray:
    """Covariance (4, 4) of nadir and altitude with the errors that neighbouring points share.

    The fit is linear in where the points lie, so its errors are theirs: their own, which are in its
    covariance already, and those of `STRETCHES` independent stretches of each camera's limb,
    whatever the number of points; or the covariance of the cone that was fitted to a camera's limb,
    which holds both.
    """
    used = [each for each in observations if each.view.name in fit.cameras and len(each.rays)]
    cameras = [_Shared.of(each.limb, each.rays) for each in used]
    edges = [camera.rays for camera in cameras if camera.limb.cone_errors is None]
    together = common_stretches(fit.nadir_base, edges)
    if not together and all(camera.negligible(fit) for camera in cameras):
        return fit.cov_nadir_altitude
    basis = tangent_basis(fit.nadir_base)
    to_tangent = tangent_rows(basis)
    rows = [camera.rays.design_sigmas(fit.nadir_base, basis) for camera in cameras]
    gain = inverse(sum((a.T @ a for a in rows), np.zeros((3, 3))))
    cov, of_cones = np.zeros((3, 3)), np.zeros((3, 1))
    height, by_scale = np.zeros(3), np.zeros(3)
    moved = []
    usual = _usual_log_scale([(camera.limb, camera.rays) for camera in cameras])
    *tangent, height2 = fit.cov_nadir_altitude.diagonal().tolist()
    variance = sum(tangent) + height2 / sphere.altitude_slope(fit.rho_rad) ** 2
    # Factor between the variance that the fit found for the points and that which they claim.
    more_own = variance / float(gain.trace())
    for camera, a in zip(cameras, rows, strict=True):
        # How a sigma of each point moves the fit, and a pixel.
        by_sigma = a @ gain
        sigma_px = camera.rays.sigma_px[:, None]
        by_px = by_sigma / sigma_px
        order = camera.rays.along_limb(fit.nadir_base)
        shared, coherent2 = camera.limb.shared, camera.coherent2(fit, order, a * sigma_px, by_px)
        if camera.limb.cone_errors is not None:
            more = math.sqrt(max(coherent2 / shared.coherent_px**2, 1.0))
            of_cones = of_cones + more * by_sigma.T @ a @ to_tangent @ camera.limb.cone_errors
            continue
        height += shared.height_px * by_px.sum(axis=0)
        if shared.scale_px > 0.0:
            by_scale += shared.scale_px * (camera.rays.log_scale - usual) @ by_px
        cov += more_own * by_sigma.T @ by_sigma + camera.of_the_limb(order, by_px)
        cov += coherent2 * len(a) / STRETCHES * by_px.T @ by_px
        if shared.fields_px > 0.0:
            by_fields = moved_by_fields(shared.fields_px, order, by_px)
            cov += by_fields.T @ by_fields
        moved.append(by_px * np.sqrt(more_own * sigma_px**2 + coherent2 * len(a) / STRETCHES))
    cov += of_same_limb(together, moved)
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
    starts, sizes = starts_and_sizes(len(rows_px), STRETCHES)
    left = np.add.reduceat(rows_px, starts) / -sizes[:, None] @ np.add.reduceat(by_px, starts).T
    left.ravel()[:: STRETCHES + 1] += 1.0
    return float(np.einsum("ij,ij->", left, left)) / STRETCHES
