"""Nadir error to be expected at an attitude: paper B's error over the field of applicability.

Limb points are exact samples of the horizon (`limb_in_view`), so that a fit without noise shows a
method's model error alone, and the Cramer-Rao bound what no unbiased method can beat.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from horizon_sensor_ros.core.applicability.visibility import limb_in_view
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.fits import fit_horizon
from horizon_sensor_ros.core.fits.bound import horizon_bound
from horizon_sensor_ros.core.fits.observation import LimbObservation
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.mathematics.attitude import angle_rad
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.status import Status


def observe(
    views: Sequence[CameraView],
    rays_down: np.ndarray,
    attitude: np.ndarray,
    sigma_px: float = 0.1,
    spacing_px: float = 1.0,
) -> list[LimbObservation]:
    """Exact limb points of every camera that has the horizon in its frame; none: an empty list.

    Arguments as of `limb_in_view`.
    """
    limbs = [limb_in_view(view, rays_down, attitude, sigma_px, spacing_px) for view in views]
    return [
        LimbObservation(view, limb)
        for view, limb in zip(views, limbs, strict=True)
        if limb.status is Status.OK
    ]


def with_noise(
    observations: Sequence[LimbObservation], rng: np.random.Generator
) -> list[LimbObservation]:
    """Move every point along its normal by a normal deviate of its own sigma."""
    return [
        replace(observation, limb=_moved(observation.limb, rng)) for observation in observations
    ]


def _moved(limb: LimbPoints, rng: np.random.Generator) -> LimbPoints:
    step = limb.sigma_px * rng.standard_normal(len(limb.px))
    return replace(limb, px=limb.px + step[:, None] * limb.normal_px)


def fit_error(
    views: Sequence[CameraView],
    rays_down: np.ndarray,
    attitude: np.ndarray,
    planet: Planet,
    method: str,
    *,
    sigma_px: float = 0.1,
    noisy_trials: int = 0,
    seed: int = 0,
) -> float:
    """RMS angle (rad) between fitted and true nadir at one attitude (3, 3).

    noisy_trials = 0: one fit to the exact points, the method's model error. Otherwise that many
    fits to points with noise sigma_px across the limb. NaN when no fit is accepted.
    """
    exact = observe(views, rays_down, attitude, sigma_px)
    if not exact:
        return np.nan
    rng = np.random.default_rng(seed)
    trials = [exact] if noisy_trials == 0 else [with_noise(exact, rng) for _ in range(noisy_trials)]
    nadir_true = np.asarray(attitude, dtype=float)[:, 2]
    fits = [fit_horizon(observations, planet, method) for observations in trials]
    errors = [angle_rad(fit.nadir_base, nadir_true) for fit in fits if fit.ok]
    return float(np.sqrt(np.mean(np.square(errors)))) if errors else np.nan


def bound_error(
    views: Sequence[CameraView],
    attitude: np.ndarray,
    planet: Planet,
    altitude_m: float,
    sigma_px: float,
) -> float:
    """Cramer-Rao bound on the RMS angle (rad) between estimated and true nadir.

    attitude : (3, 3) rot_base_from_down. sigma_px : as of `horizon_bound`, with its errors. An
    ellipsoid is taken as its mean sphere. NaN when the frames hold too little of the limb.
    """
    nadir = np.asarray(attitude, dtype=float)[:, 2]
    cov = horizon_bound(views, planet, nadir, altitude_m, sigma_px)
    return float(np.sqrt(np.trace(cov[:3, :3])))
