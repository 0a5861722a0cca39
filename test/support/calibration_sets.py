"""Frame sets of exact geometry: what cameras see of a sphere, with noise of known covariance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from horizon_sensor_ros.core.aiding import AltitudeMeasurement
from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.mathematics.attitude import nadir_from_roll_pitch, tangent_basis
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.self_calibration.measurement import (
    CameraHorizon,
    FrameSet,
    NadirReference,
)
from horizon_sensor_ros.sim.poses import side_views

ROTATIONS = {
    view.name: view.rot_base_from_cam
    for view in side_views(Camera(640, 480, 457.0, 457.0, 319.5, 239.5))
}
# As of a camera with a short arc: what is towards the horizon is uncertain, and rho with it.
_SPREAD = np.radians([0.02, 0.1, 0.1])


def swinging(count: int, amplitude_deg: float = 12.0) -> list[np.ndarray]:
    """Nadirs (3,) of a craft (z down) that rolls and pitches."""
    t = np.linspace(0.0, 1.0, count)
    roll = np.radians(amplitude_deg) * np.sin(2 * np.pi * 3.3 * t + 0.4)
    pitch = np.radians(amplitude_deg) * np.sin(2 * np.pi * 2.1 * t + 1.9)
    return [nadir_from_roll_pitch(r, p, "down") for r, p in zip(roll, pitch, strict=True)]


def frame_sets(
    nadirs_base: Sequence[np.ndarray],
    rot_base_from_cam: Mapping[str, np.ndarray] | Sequence[Mapping[str, np.ndarray]],
    rng: np.random.Generator | None = None,
    *,
    altitudes_m: Sequence[float] = (),
    planet: Planet | None = None,
    altitude_sigma_m: float | None = None,
    reference_sigma_rad: float | None = None,
) -> list[FrameSet]:
    """Sets 10 s apart of the horizons that truly so mounted cameras see; exact without an rng.

    planet : the true one. rot_base_from_cam : one for all, or one a set.
    """
    planet = planet or Planet()
    altitudes = altitudes_m or [500e3] * len(nadirs_base)
    one = isinstance(rot_base_from_cam, Mapping)
    out = []
    for index, (nadir, altitude_m) in enumerate(zip(nadirs_base, altitudes, strict=True)):
        rotations = rot_base_from_cam if one else rot_base_from_cam[index]
        rho = planet.rho_from_altitude(altitude_m)
        horizons = tuple(
            _horizon(camera, rot.T @ nadir, rho, rng) for camera, rot in rotations.items()
        )
        altitude = reference = None
        if altitude_sigma_m is not None:
            error = 0.0 if rng is None else altitude_sigma_m * rng.standard_normal()
            altitude = AltitudeMeasurement(altitude_m + error, altitude_sigma_m)
        if reference_sigma_rad is not None:
            error = np.zeros(2) if rng is None else reference_sigma_rad * rng.standard_normal(2)
            seen = nadir + tangent_basis(nadir) @ error
            reference = NadirReference(seen / np.linalg.norm(seen), reference_sigma_rad)
        out.append(FrameSet(10.0 * index, horizons, altitude, reference))
    return out


def _horizon(
    camera: str, nadir_cam: np.ndarray, rho: float, rng: np.random.Generator | None
) -> CameraHorizon:
    # Axes: sideways, towards the horizon below the camera's axis, rho; the last two nearly opposed.
    forward = np.array([0.0, 0.0, 1.0]) - nadir_cam * nadir_cam[2]
    forward /= np.linalg.norm(forward)
    axes = np.stack([np.cross(nadir_cam, forward), forward])
    factor = np.diag(_SPREAD)
    factor[2] = [0.0, -0.97 * _SPREAD[2], np.sqrt(1 - 0.97**2) * _SPREAD[2]]
    to_tangent = np.eye(3)
    to_tangent[:2, :2] = tangent_basis(nadir_cam).T @ axes.T
    cov = to_tangent @ factor @ factor.T @ to_tangent.T
    seen, seen_rho = nadir_cam, rho
    if rng is not None:
        error = factor @ rng.standard_normal(3)
        seen = nadir_cam + error[:2] @ axes
        seen, seen_rho = seen / np.linalg.norm(seen), rho + error[2]
    return CameraHorizon(camera, seen, seen_rho, _in_basis_of(seen, nadir_cam, cov))


def _in_basis_of(seen: np.ndarray, nadir_cam: np.ndarray, cov: np.ndarray) -> np.ndarray:
    turn = np.eye(3)
    turn[:2, :2] = tangent_basis(seen).T @ tangent_basis(nadir_cam)
    return turn @ cov @ turn.T
