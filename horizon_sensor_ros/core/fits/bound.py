"""Cramer-Rao bound of nadir and altitude: what no unbiased estimator of the limb can beat."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.fits.assessment import covariance_nadir_altitude
from horizon_sensor_ros.core.fits.limb_rays import outward_per_px
from horizon_sensor_ros.core.mathematics.attitude import tangent_basis, unit_direction
from horizon_sensor_ros.core.planet import Planet


def horizon_bound(
    views: Sequence[CameraView],
    planet: Planet,
    nadir_base: np.ndarray,
    altitude_m: float,
    sigma_px: float,
) -> np.ndarray:
    """Covariance (4, 4) of (nadir_base, altitude_m) that the limb in these cameras' frames allows.

    sigma_px : error across the limb of an edge measurement that uses one pixel of limb length,
    independent from pixel to pixel.
    NaN when no limb is in any frame, or too little of it. Raises ValueError for a nadir that is no
    direction, a sigma_px that is not positive or an altitude below the limb.
    """
    nadir, rho = _cone(planet, nadir_base, altitude_m, sigma_px)
    informations = [
        horizon_information(view, planet, nadir_base, altitude_m, sigma_px) for view in views
    ]
    information = np.sum(informations, axis=0) if informations else np.zeros((3, 3))
    return covariance_nadir_altitude(bound_of(information), tangent_basis(nadir), rho, planet)


def horizon_information(
    view: CameraView,
    planet: Planet,
    nadir_base: np.ndarray,
    altitude_m: float,
    sigma_px: float,
    samples: int = 3600,
) -> np.ndarray:
    """Fisher information (3, 3) that one camera's frame holds of nadir and the disc's radius.

    Of nadir's two components along `tangent_basis` (rad) and rho (rad); that of several cameras is
    the sum. samples : limb rays around the whole disc. Other arguments, and errors, as of
    `horizon_bound`.
    """
    nadir, rho = _cone(planet, nadir_base, altitude_m, sigma_px)
    basis = tangent_basis(nadir)
    azimuth = np.arange(samples) * (2 * np.pi / samples)
    around = np.array([np.cos(azimuth), np.sin(azimuth)]).T @ basis.T
    along = np.array([-np.sin(azimuth), np.cos(azimuth)]).T @ basis.T
    rays = np.cos(rho) * nadir + np.sin(rho) * around
    # Derivative of ``angle - rho`` by nadir's tangent components and rho.
    rows = np.column_stack((-np.cos(azimuth), -np.sin(azimuth), np.full(samples, -1.0)))
    rot_cam_from_base = view.rot_base_from_cam.T
    px, jacobian = view.camera.project(rays @ rot_cam_from_base.T)
    seen = view.camera.in_frame(px)
    if not seen.any():
        return np.zeros((3, 3))
    jacobian = jacobian[seen]
    step = np.einsum("ijk,ik->ij", jacobian, (along @ rot_cam_from_base.T)[seen])
    length_px = np.linalg.norm(step, axis=1) * np.sin(rho) * (2 * np.pi / samples)
    normal = np.column_stack((-step[:, 1], step[:, 0]))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    growth = np.linalg.norm(outward_per_px(jacobian, normal), axis=1)
    weight = length_px / (sigma_px * growth) ** 2
    return (rows[seen] * weight[:, None]).T @ rows[seen]


def _cone(
    planet: Planet, nadir_base: np.ndarray, altitude_m: float, sigma_px: float
) -> tuple[np.ndarray, float]:
    """Nadir (3,), unit, and rho; ValueError for arguments that make no sense."""
    rho = planet.rho_from_altitude(altitude_m)
    if not np.isfinite(rho):
        raise ValueError(f"altitude_m must be above the limb, got {altitude_m}")
    if not sigma_px > 0:
        raise ValueError(f"sigma_px must be positive, got {sigma_px}")
    return unit_direction(nadir_base, "nadir_base"), rho


def bound_of(information: np.ndarray) -> np.ndarray:
    """Covariance (3, 3) that an information allows; NaN where it leaves a direction open."""
    scale = np.sqrt(np.diag(information))
    if not np.all(scale > 0):
        return np.full((3, 3), np.nan)
    normalised = information / np.outer(scale, scale)
    if np.linalg.cond(normalised) > 1e14:
        return np.full((3, 3), np.nan)
    return np.linalg.inv(normalised) / np.outer(scale, scale)


def nadir_sigma_bound_rad(information: np.ndarray) -> float:
    """Least sigma (rad) that nadir can have in its least certain direction, by an information
    (3, 3) of `horizon_information`; infinite where that is left open.
    """
    cov = bound_of(information)
    if not np.isfinite(cov).all():
        return np.inf
    return float(np.sqrt(np.linalg.eigvalsh(cov[:2, :2])[-1]))
