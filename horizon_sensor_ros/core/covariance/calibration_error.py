"""Errors of a fix from what the sensor is told of cameras and planet, for the covariance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from horizon_sensor_ros.core.cameras.readout import seen_after_s, seen_late
from horizon_sensor_ros.core.covariance.common_cone import cone_shares
from horizon_sensor_ros.core.covariance.uneven_limb import heights_alike
from horizon_sensor_ros.core.fits.assessment import covariance_nadir_altitude
from horizon_sensor_ros.core.fits.limb_rays import LimbRays
from horizon_sensor_ros.core.fits.observation import LimbObservation
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.mathematics.attitude import tangent_basis
from horizon_sensor_ros.core.mathematics.rigid import skew
from horizon_sensor_ros.core.mathematics.symmetric3 import inverse
from horizon_sensor_ros.core.planet import Planet

# How errors of focal length and of distortion grow with the distance to the optical axis.
_FOCAL, _DISTORTION = 1, 3
_SMALL_PX = 1e-2


def with_calibration_error(
    fit: HorizonFit,
    observations: Sequence[LimbObservation],
    sphere: Planet,
    *,
    mounting_sigma_rad: float = 0.0,
    lens_sigma_px: float = 0.0,
    limb_height_sigma_m: float = 0.0,
    limb_unevenness_m: float = 0.0,
    with_rate: bool = True,
) -> HorizonFit:
    """Return the fit with these errors added to its covariance.

    mounting_sigma_rad : of each camera's rotation, about every axis, independent of the others'.
    lens_sigma_px : of each camera's focal length and of its distortion, by what either moves the
    corners of its frame. limb_height_sigma_m : of the height of the visible limb, the same all
    along it; limb_unevenness_m : of what that differs by from place to place. Zero: taken to be
    exact. The rate at which cameras turn between the time of the set and that at which they see
    a point (`CameraView.rate`) is the same for all; with_rate : whether its error is added, too.
    A camera's turn turns the nadir that it would find by itself; of several cameras these are
    weighted by their information. First order; derived here, from the information form of least
    squares.
    """
    turning = with_rate and any(seen_late(seen.view) for seen in observations)
    of_cameras = mounting_sigma_rad + lens_sigma_px + limb_unevenness_m > 0.0 or turning
    if not of_cameras and limb_height_sigma_m == 0.0:
        return fit
    cov = fit.cov_nadir_altitude.copy()
    if of_cameras:
        basis = tangent_basis(fit.nadir_base)
        cameras = _Cameras(fit, observations, basis)
        tangent = np.zeros((3, 3))
        if mounting_sigma_rad > 0.0:
            tangent += mounting_sigma_rad**2 * cameras.by_turns()
        if lens_sigma_px > 0.0:
            tangent += lens_sigma_px**2 * cameras.by_lens()
        if turning:
            tangent += cameras.by_rate()
        if limb_unevenness_m > 0.0:
            tangent += limb_unevenness_m**2 * cameras.by_heights(fit.rho_rad, sphere)
        cov += covariance_nadir_altitude(tangent, basis, fit.rho_rad, sphere)
    # altitude = (radius + limb height) / sin(rho) - radius
    cov[3, 3] += (limb_height_sigma_m / math.sin(fit.rho_rad)) ** 2
    return replace(fit, cov_nadir_altitude=cov)


class _Cameras:
    """How much each camera of a fit moves it: nadir's two tangent components and rho."""

    def __init__(
        self, fit: HorizonFit, observations: Sequence[LimbObservation], basis: np.ndarray
    ) -> None:
        self._nadir = fit.nadir_base
        self._seen = [
            seen for seen in observations if seen.view.name in fit.cameras and len(seen.rays)
        ]
        self._rows = [seen.rays.design_sigmas(fit.nadir_base, basis) for seen in self._seen]
        self._informations = [rows.T @ rows for rows in self._rows]
        shares = [share for _, share in cone_shares(fit, observations)]
        if shares:
            seen = zip(shares, self._informations, strict=True)
            self._gains = [share @ inverse(each) for share, each in seen]
        else:
            gain = inverse(sum(self._informations, np.zeros((3, 3))))
            self._gains = [gain] * len(self._seen)

    def by_turns(self) -> np.ndarray:
        """Covariance (3, 3) of the cone where each camera is turned by one sigma of 1 rad."""
        if len(self._rows) < 2:
            return np.diag([1.0, 1.0, 0.0])
        seen = zip(self._gains, self._informations, strict=True)
        shares = [(gain @ each)[:, :2] for gain, each in seen]
        return np.asarray(sum(share @ share.T for share in shares))

    def by_lens(self) -> np.ndarray:
        """Covariance (3, 3) of the cone where corners of each frame are off by one sigma of 1 px,
        along the radius.
        """
        cov = np.zeros((3, 3))
        for seen, rows, gain in zip(self._seen, self._rows, self._gains, strict=True):
            rays, view = seen.rays, seen.view
            theta, growth = rays.angles(self._nadir)[0], rays.growth(self._nadir)
            px = view.camera.pixels(rays.rays_base @ view.rot_base_from_cam)
            out = view.camera.off_axis(px)
            radius = np.sqrt(np.einsum("ij,ij->i", out, out))[:, None]
            for power in _FOCAL, _DISTORTION:
                moved = px + _SMALL_PX * out * radius ** (power - 1)
                cosine = view.camera.rays(moved) @ (view.rot_base_from_cam.T @ self._nadir)
                shift_px = (np.arccos(np.clip(cosine, -1.0, 1.0)) - theta) / (_SMALL_PX * growth)
                # Beyond the lens's edge there are no rays.
                shift_px = np.nan_to_num(shift_px)
                off = gain @ (rows.T @ (shift_px / rays.sigma_px))
                cov += np.outer(off, off)
        return cov

    def by_rate(self) -> np.ndarray:
        """Covariance (3, 3) of the cone where the craft turns otherwise, by one sigma of its rate,
        between the time of the set and that at which points are seen.
        """
        off = np.zeros((3, 3))
        for seen, rows, gain in zip(self._seen, self._rows, self._gains, strict=True):
            rays, view = seen.rays, seen.view
            px = view.camera.pixels(rays.rays_base @ view.rot_base_from_cam)
            sigma_rad_s = 0.0 if view.rate is None else view.rate.sigma_rad_s
            turn = sigma_rad_s * np.nan_to_num(seen_after_s(view, px))
            # A ray's angle from nadir, by turns about the three axes.
            axes = rays.rays_base @ skew(self._nadir)
            axes /= -np.linalg.norm(axes, axis=1)[:, None]
            across = turn[:, None] * axes / self._sigmas_rad(rays)[:, None]
            off += gain @ (rows.T @ across)
        return np.asarray(off @ off.T)

    def by_heights(self, rho_rad: float, sphere: Planet) -> np.ndarray:
        """Covariance (3, 3) of the cone where the visible limb's height differs from place to
        place, one sigma 1 m.
        """
        weights, places = [], []
        for seen, rows, gain in zip(self._seen, self._rows, self._gains, strict=True):
            rays = seen.rays
            weights.append(gain @ (rows / self._sigmas_rad(rays)[:, None]).T)
            places.append(rays.rays_base)
        weight = np.concatenate(weights, axis=1)
        alike = heights_alike(np.concatenate(places), self._nadir, rho_rad, sphere.radius_m)
        slope = math.tan(rho_rad) / sphere.limb_radius_m
        return np.asarray(slope**2 * (weight @ alike @ weight.T))

    def _sigmas_rad(self, rays: LimbRays) -> np.ndarray:
        """One sigma (N,) of the rays' angles from nadir."""
        return rays.growth(self._nadir) * rays.sigma_px
