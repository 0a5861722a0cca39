"""Roll, pitch and disc radius by Gauss-Newton, without knowing the altitude (Raeisy & Ghofrani)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from horizon_sensor_ros.core.fits.assessment import assess_least_squares, too_few
from horizon_sensor_ros.core.fits.limb_rays import LimbRays
from horizon_sensor_ros.core.fits.observation import LimbObservation, gather
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.mathematics.attitude import nadir_from_roll_pitch, tangent_basis
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.status import Status

_METHOD = "gauss_newton"
_MAX_STEPS = 25
_CONVERGED_RAD = 1e-7
# The frame's z axis is guessed as if the disc had this radius; any between 20 and 90 deg will do.
_GUESSED_RHO_RAD = np.radians(60.0)


def fit_gauss_newton(observations: Sequence[LimbObservation], planet: Planet) -> HorizonFit:
    """Fit roll, pitch and rho to ``u . nadir = cos rho`` over all rays, unweighted.

    The paper iterates in its camera's frame, whose z axis points roughly to nadir. To keep that
    for any mounting, and away from the singularity at pitch +-90 deg, the iteration runs in a
    frame whose z axis lies roughly towards nadir, judged by the limb's rays and normals. `history`
    is in the base frame all the same.
    """
    rays = gather(observations)
    refused = too_few(rays, _METHOD)
    if refused:
        return refused
    rot_work_from_base = _working_frame(rays)
    states, converged = solve_roll_pitch_rho(rays.rays_base @ rot_work_from_base.T)
    nadirs = np.array([nadir_from_roll_pitch(roll, pitch, "down") for roll, pitch, _ in states])
    rho = np.arccos(np.clip(np.cos(states[:, 2]), -1.0, 1.0))
    history = np.column_stack((nadirs @ rot_work_from_base, rho))
    if not converged:
        reason = f"no convergence in {len(states) - 1} steps"
        return HorizonFit.none(Status.NOT_CONVERGED, reason, _METHOD, rays.num_points)
    weight = np.full(len(rays), np.sin(rho[-1]) ** 2)
    return assess_least_squares(
        rays, planet, _METHOD, history[-1, :3], float(rho[-1]), weight, history
    )


def solve_roll_pitch_rho(rays: np.ndarray) -> tuple[np.ndarray, bool]:
    """Iterate from zero roll, pitch and altitude; unit rays (N, 3), z axis roughly towards nadir.

    Returns the states (K, 3), rows (roll, pitch, rho) in rad, the first being the start (0, 0,
    pi/2), and whether the last step was below 1e-7 rad. ``x <- x - (A^T A)^-1 A^T F(x)`` with
    ``F = u . n - cos rho`` and ``n = (-sin pitch, cos pitch sin roll, cos pitch cos roll)``.
    rho = pi/2 is altitude zero; at rho = 0 its own column of A would vanish.
    """
    state = np.array([0.0, 0.0, np.pi / 2])
    states = [state]
    for _ in range(_MAX_STEPS):
        roll, pitch, rho = state
        cos_roll, sin_roll = np.cos(roll), np.sin(roll)
        cos_pitch, sin_pitch = np.cos(pitch), np.sin(pitch)
        nadir = nadir_from_roll_pitch(roll, pitch, "down")
        by_roll = np.array([0.0, cos_pitch * cos_roll, -cos_pitch * sin_roll])
        by_pitch = np.array([-cos_pitch, -sin_pitch * sin_roll, -sin_pitch * cos_roll])
        matrix = np.column_stack((rays @ by_roll, rays @ by_pitch, np.full(len(rays), np.sin(rho))))
        residual = rays @ nadir - np.cos(rho)
        step = np.linalg.lstsq(matrix, residual, rcond=1e-12)[0]
        if not np.all(np.isfinite(step)):
            return np.array(states), False
        state = state - step
        states.append(state)
        if np.abs(step).max() < _CONVERGED_RAD:
            return np.array(states), True
    return np.array(states), False


def _working_frame(rays: LimbRays) -> np.ndarray:
    """rot_work_from_base (3, 3) with its z axis roughly towards nadir."""
    inward = -rays.outward_base / np.linalg.norm(rays.outward_base, axis=1, keepdims=True)
    guess = np.cos(_GUESSED_RHO_RAD) * rays.rays_base + np.sin(_GUESSED_RHO_RAD) * inward
    mean = guess.mean(axis=0)
    norm = np.linalg.norm(mean)
    z_axis = mean / norm if norm > 1e-9 else np.array([0.0, 0.0, 1.0])
    x_axis, y_axis = tangent_basis(z_axis).T
    return np.array([x_axis, y_axis, z_axis])
