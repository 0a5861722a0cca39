"""Errors of horizon fits against truth, and the bound that no unbiased estimator can beat."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import cv2
import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.fits.bound import horizon_bound
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.horizon.fix import Frame
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.mathematics.attitude import tangent_basis
from horizon_sensor_ros.sim.earth_camera import SimFrame
from horizon_sensor_ros.sim.frame_truth import FrameTruth
from tables import number, percentile

# Squared error of two unknowns in sigmas, as rare as three sigma of one.
BEYOND_NEES = float(-2.0 * np.log(0.0027))


@dataclass(frozen=True)
class FitErrors:
    """Of one fit: angle of nadir, altitude over the true one, squared error in sigmas (NEES)."""

    nadir_deg: float
    altitude_percent: float
    nees: float


def fit_errors(fit: HorizonFit, nadir_true: np.ndarray, altitude_true_m: float) -> FitErrors:
    """Errors of a fit that is OK. nadir_true (3,) unit, in the fit's base frame."""
    basis = tangent_basis(nadir_true)
    across = basis.T @ fit.nadir_base
    cov = basis.T @ fit.cov_nadir_altitude[:3, :3] @ basis
    return FitErrors(
        nadir_deg=angle_deg(fit.nadir_base, nadir_true),
        altitude_percent=100.0 * abs(fit.altitude_m / altitude_true_m - 1.0),
        nees=float(across @ np.linalg.solve(cov, across)),
    )


@dataclass
class FixErrors:
    """Errors of fixes: nadir's, degrees, its NEES, and altitude's over its sigma."""

    COLUMNS: ClassVar = (
        "fixed",
        "nadir median",
        "max",
        "NEES",
        "beyond 3 sigma",
        "altitude / sigma, RMS",
    )

    tried: int = 0
    errors: list[tuple[float, float, float]] = field(default_factory=list)

    def add(self, sensor: HorizonSensor, frames: list[Frame], truth: FrameTruth) -> None:
        """Add what a sensor makes of frames."""
        fix = sensor.process(frames)
        self.tried += 1
        if fix.ok:
            error = fit_errors(fix.fit, truth.nadir_base, truth.altitude_m)
            sigma_m = float(np.sqrt(fix.fit.cov_nadir_altitude[3, 3]))
            off = (fix.fit.altitude_m - truth.altitude_m) / sigma_m
            self.errors.append((error.nadir_deg, error.nees, off))

    def cells(self) -> tuple[str, ...]:
        """What stands in `COLUMNS`."""
        if not self.errors:
            return (f"0/{self.tried}", *("",) * (len(self.COLUMNS) - 1))
        nadir, nees, altitude = np.array(self.errors).T
        return (
            f"{len(nadir)}/{self.tried}",
            number(percentile(nadir, 50), 4),
            number(percentile(nadir, 100), 3),
            number(float(nees.mean()), 1),
            str(np.count_nonzero(nees > BEYOND_NEES)),
            number(float(np.sqrt(np.mean(np.square(altitude)))), 1),
        )


def angle_deg(a: np.ndarray, b: np.ndarray) -> float:
    """Angle between two unit vectors (3,), good for the smallest as well."""
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))


def nadir_sigma_deg(cov_nadir: np.ndarray) -> float:
    """Sigma of nadir in its least certain direction, from its covariance (3, 3) or (2, 2)."""
    return float(np.degrees(np.sqrt(np.linalg.eigvalsh(cov_nadir)[-1])))


def edge_sigma_px(step_dn: np.ndarray, noise_dn: float, psf_sigma_px: float) -> float:
    """Error of an edge's place from all pixels beside one pixel of its length, at least.

    step_dn (N,) : height of the step along the edge. A step s, blurred by a Gaussian of sigma w
    (the PSF and the pixel's own width, 1/12 px^2), has the slope ``s g(d)`` at distance d; the
    information on its place is ``s^2 / noise^2 * integral of g^2 = s^2 / noise^2 / (2 sqrt(pi) w)``
    for each pixel of length. noise_dn : of a pixel; rounding to whole DN (1/12) is added.
    """
    blur = np.sqrt(psf_sigma_px**2 + 1.0 / 12.0)
    noise = np.sqrt(noise_dn**2 + 1.0 / 12.0)
    return float(noise / np.sqrt(np.mean(np.square(step_dn)) / (2.0 * np.sqrt(np.pi) * blur)))


def nadir_bound_deg(
    views: Sequence[CameraView], frames: Sequence[SimFrame], noise_dn: float, psf_sigma_px: float
) -> tuple[float, float]:
    """Cramer-Rao bound of nadir's RMS angle (deg) in these frames, and their edge sigma (px).

    NaN where the frames hold too little limb.
    """
    steps = np.concatenate([frame.truth.limb.step_dn for frame in frames])
    if len(steps) == 0:
        return np.nan, np.nan
    sigma = edge_sigma_px(steps, noise_dn, psf_sigma_px)
    truth = frames[0].truth
    cov = horizon_bound(views, truth.planet, truth.nadir_base, truth.altitude_m, sigma)
    return float(np.degrees(np.sqrt(np.trace(cov[:3, :3])))), sigma


def canny_seconds(images: Sequence[np.ndarray]) -> float:
    """CPU time of one cv2.Canny pass over 8-bit images."""
    start = time.process_time()
    for image in images:
        cv2.Canny(image, 50, 150)
    return time.process_time() - start
