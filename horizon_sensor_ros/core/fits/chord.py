"""Local vertical from two cameras' chords (Lomaka & Ustyugov): exact over rays, and as printed."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from horizon_sensor_ros.core.fits.assessment import (
    LEAST_ANGLE_RAD,
    MIN_POINTS,
    assess_closed_form,
    inliers,
    too_few,
)
from horizon_sensor_ros.core.fits.circle import robust_circle_on_sphere
from horizon_sensor_ros.core.fits.limb_rays import LimbRays
from horizon_sensor_ros.core.fits.observation import LimbObservation, gather
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.mathematics.attitude import tangent_basis
from horizon_sensor_ros.core.mathematics.robust import robust_sigma
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.status import Status

_DIRECTIONS = 90
_OUTLIER_SIGMAS = 5.0


def fit_chord(observations: Sequence[LimbObservation], planet: Planet) -> HorizonFit:
    """Nadir perpendicular to the chords ``u_a - u_b`` of two or more cameras' limb ends.

    Exact for unit rays: ``u_a . n = u_b . n = cos rho``. Of each camera's points only the two
    farthest apart are used (after outliers from that camera's circle are dropped); nothing is
    averaged. The altitude is that of all points' mean angle from nadir. Needs two cameras.
    """
    return _fit(observations, planet, "chord", lambda ray: ray, exact=True)


def fit_chord_image(observations: Sequence[LimbObservation], planet: Planet) -> HorizonFit:
    """`fit_chord` with the chord drawn in the image plane, as the paper prints it.

    The chord is taken between the undistorted points (x, y, 1) of the image plane. That is exact
    only when both ends lie equally far from the principal point. Ends that lie 90 deg or more off
    the axis have no image-plane point and give no chord. The covariance includes the
    approximation's error, as the difference from the exact circle on the sphere.
    """
    return _fit(
        observations,
        planet,
        "chord_image",
        lambda ray: ray / ray[2] if ray[2] > 0 else np.full(3, np.nan),
        exact=False,
    )


def _fit(
    observations: Sequence[LimbObservation],
    planet: Planet,
    method: str,
    point_of_ray: Callable[[np.ndarray], np.ndarray],
    exact: bool,
) -> HorizonFit:
    rays = gather(observations)
    refused = too_few(rays, method)
    if refused:
        return refused
    chords, pairs = _chords(rays, observations, point_of_ray)
    if len(chords) < 2:
        reason = f"{len(chords)} chord, two cameras' needed"
        return HorizonFit.none(Status.ILL_CONDITIONED, reason, method, rays.num_points)
    directions = np.array([chord / np.linalg.norm(chord) for chord in chords])
    _, strength, basis_rows = np.linalg.svd(directions)
    if strength[1] < np.sin(LEAST_ANGLE_RAD):
        reason = "the cameras' chords are parallel"
        return HorizonFit.none(Status.ILL_CONDITIONED, reason, method, rays.num_points)
    nadir = basis_rows[2]
    if rays.points_to_space(nadir):
        nadir = -nadir
    theta = rays.angles(nadir)[0]
    rho = float(np.median(theta))
    close = inliers(theta - rho)
    rho = float(np.mean(theta[close])) if close.any() else rho

    def covariance(
        basis: np.ndarray, design: np.ndarray
    ) -> tuple[np.ndarray, tuple[np.ndarray, float] | None]:
        circle = robust_circle_on_sphere(rays)
        noise = max(robust_sigma((rays.angles(circle[0])[0] - circle[1]) / rays.sigma_rad), 1.0)
        cov = noise**2 * _covariance(rays, directions, chords, pairs, basis, design)
        return cov, None if exact else circle

    cameras = tuple(rays.cameras[int(rays.camera[pair[0]])] for pair in pairs)
    return assess_closed_form(rays, planet, method, nadir, rho, covariance, cameras)


def _chords(
    rays: LimbRays,
    observations: Sequence[LimbObservation],
    point_of_ray: Callable[[np.ndarray], np.ndarray],
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Chords (3,), base frame, of the cameras that have one, and the numbers (2,) of their ends."""
    by_name = {observation.view.name: observation.view for observation in observations}
    chords, pairs = [], []
    for camera, name in enumerate(rays.cameras):
        pair = _ends(rays, camera)
        if pair is None:
            continue
        rot_base_from_cam = by_name[name].rot_base_from_cam
        first, second = (point_of_ray(ray @ rot_base_from_cam) for ray in rays.rays_base[pair])
        if np.all(np.isfinite(first - second)) and np.any(first != second):
            chords.append(rot_base_from_cam @ (first - second))
            pairs.append(pair)
    return chords, pairs


def _ends(rays: LimbRays, camera: int) -> np.ndarray | None:
    """Indices of the two points of a camera that lie farthest apart; None without an arc."""
    index = np.flatnonzero(rays.camera == camera)
    if len(index) < MIN_POINTS:
        return None
    one = LimbRays(
        rays.rays_base[index],
        rays.outward_base[index],
        rays.sigma_px[index],
        np.zeros(len(index), dtype=int),
        (rays.cameras[camera],),
        len(index),
    )
    nadir, rho = robust_circle_on_sphere(one)
    if np.isfinite(rho):
        residual = np.abs(one.angles(nadir)[0] - rho) / one.sigma_rad
        limit = _OUTLIER_SIGMAS * max(robust_sigma(residual), 1.0)
        index = index[residual <= limit]
    if len(index) < 2:
        return None
    # Farthest apart to within a degree of direction: the widest of many projections.
    points = rays.rays_base[index]
    across = points @ tangent_basis(_mean_direction(points))
    angle = np.linspace(0.0, np.pi, _DIRECTIONS, endpoint=False)
    projected = across @ np.array([np.cos(angle), np.sin(angle)])
    best = int(np.argmax(np.ptp(projected, axis=0)))
    pair = [int(np.argmax(projected[:, best])), int(np.argmin(projected[:, best]))]
    return index[pair]


def _mean_direction(points: np.ndarray) -> np.ndarray:
    mean = points.mean(axis=0)
    norm = np.linalg.norm(mean)
    return mean / norm if norm > 1e-9 else np.array([0.0, 0.0, 1.0])


def _covariance(
    rays: LimbRays,
    directions: np.ndarray,
    chords: list[np.ndarray],
    pairs: list[np.ndarray],
    basis: np.ndarray,
    design: np.ndarray,
) -> np.ndarray:
    """(3, 3) of (tangent components, rho) from the ends' sigmas; rho from the mean angle."""
    across = directions @ basis
    solve = np.linalg.pinv(across)
    cov = np.zeros((2, 2))
    for row, (chord, pair) in enumerate(zip(chords, pairs, strict=True)):
        # An end that moves out by its sigma tilts its chord towards nadir by this much.
        tilt = np.sin(rays.angles(np.cross(basis[:, 0], basis[:, 1]))[0][pair])
        tilt = tilt * rays.sigma_rad[pair] / np.linalg.norm(chord)
        cov += np.outer(solve[:, row], solve[:, row]) * float(tilt @ tilt)
    # angle - rho = 0 on average: d rho = mean(d angle / d nadir) d nadir, plus the mean's own noise
    mean = design[:, :2].mean(axis=0)
    lift = np.vstack((np.eye(2), mean))
    out = lift @ cov @ lift.T
    out[2, 2] += float(np.mean(rays.sigma_rad**2)) / len(rays)
    return out
