"""The cone that is nearest to those of several cameras, as the errors of these hang together.

Where limb and glow are told apart a frame gives a cone, which knows the limb's slope far better
than its height, and whose errors are in part those of the other cameras' cones too. To a fit of
points every point counts by itself, which weighs such cones badly; generalised least squares does
it best.
Source: Aitken 1936, On least squares and linear combination of observations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from horizon_sensor_ros.core.fits.assessment import (
    birge_factor,
    covariance_nadir_altitude,
    inliers,
    root_mean_square,
    tangent_rows,
)
from horizon_sensor_ros.core.fits.maximum_likelihood import METHOD as MAXIMUM_LIKELIHOOD
from horizon_sensor_ros.core.fits.observation import LimbObservation, gather
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.mathematics.attitude import tangent_basis
from horizon_sensor_ros.core.mathematics.symmetric3 import inverse
from horizon_sensor_ros.core.planet import Planet


def cone_shares(
    fit: HorizonFit, observations: Sequence[LimbObservation]
) -> list[tuple[LimbObservation, np.ndarray]]:
    """Each camera of a fit, and by how much (3, 3) its cone, by the tangent components of nadir and
    rho, counts in the one that is nearest to all; together the unit matrix.

    Empty for one camera, where some camera's limb is no cone's, and for fits of other methods than
    maximum likelihood, which are as they are published.
    """
    if fit.method != MAXIMUM_LIKELIHOOD:
        return []
    seen = [one for one in observations if one.view.name in fit.cameras and len(one.rays)]
    errors = [one.limb.cone_errors for one in seen]
    cones = [each for each in errors if each is not None]
    if len(cones) < max(2, len(errors)):
        return []
    to_tangent = tangent_rows(tangent_basis(fit.nadir_base))
    together = np.concatenate([to_tangent @ each for each in cones])
    weight = np.linalg.inv(together @ together.T)
    # (3, N, 3): of the cone by what each camera's is off it.
    weight = weight.reshape(len(seen), 3, len(seen), 3).sum(axis=0)
    gain = inverse(weight.sum(axis=1))
    return [(one, gain @ weight[:, i]) for i, one in enumerate(seen)]


def nearest_to_cones(
    fit: HorizonFit, observations: Sequence[LimbObservation], sphere: Planet
) -> HorizonFit | None:
    """Return the fit moved to the cone that is nearest to all cameras' cones, with its covariance;
    None where that is left to the points.

    Where cones lie farther off it than they claim, that grows (`birge_factor`).
    """
    shares = cone_shares(fit, observations)
    if not shares:
        return None
    basis = tangent_basis(fit.nadir_base)
    to_tangent = tangent_rows(basis)
    offs, errors = [], []
    for one, _ in shares:
        rows = one.rays.design_sigmas(fit.nadir_base, basis)
        chi = one.rays.residuals_px(fit.nadir_base, fit.rho_rad) / one.rays.sigma_px
        # Its points lie on it.
        offs.append(-inverse(rows.T @ rows) @ (rows.T @ chi))
        errors.append(to_tangent @ one.limb.cone_errors)
    if not np.isfinite(offs).all():
        return None
    counted = [share for _, share in shares]
    step = sum((share @ off for share, off in zip(counted, offs, strict=True)), np.zeros(3))
    error = sum((share @ each for share, each in zip(counted, errors, strict=True)), np.zeros(1))
    together = np.concatenate(errors)
    off = np.concatenate(offs) - np.tile(step, len(offs))
    chi2 = float(off @ np.linalg.solve(together @ together.T, off))
    birge = birge_factor(chi2, len(off) - 3)
    nadir = fit.nadir_base + basis @ step[:2]
    nadir /= np.linalg.norm(nadir)
    rho = fit.rho_rad + float(step[2])
    residual = gather([one for one, _ in shares]).residuals_px(nadir, rho)
    cov = covariance_nadir_altitude(birge * error @ error.T, tangent_basis(nadir), rho, sphere)
    return replace(
        fit,
        nadir_base=nadir,
        rho_rad=rho,
        altitude_m=sphere.altitude_from_rho(rho),
        cov_nadir_altitude=cov,
        rms_residual_px=root_mean_square(residual[inliers(residual)]),
    )
