"""Arc fit: radius and centre of curvature of the horizon in the image (Priborostroenie 2016).

The circle is fitted to the undistorted points of the image plane (unit focal length) by Taubin's
method. The horizon's image is a conic; on its axis of symmetry, which runs from the principal point
towards the image of nadir, it has two vertices, at ``tan(eta - rho)`` and ``tan(eta + rho)``, where
eta is nadir's angle off the optical axis; at both its radius of curvature is exactly
``tan rho``. The fitted circle is taken for the osculating circle at the vertex next to the arc:

    rho = atan(r),  eta = rho + atan(d - r)   (near vertex; far: eta = atan(d + r) - rho)

with r its radius and d its centre's distance from the principal point. That is the approximation:
the conic leaves that circle the faster, the farther the arc runs from the vertex and the vertex
from the axis.
"""

from __future__ import annotations

from collections.abc import Sequence

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
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.status import Status

_METHOD = "arc"
# Image-plane points farther off the axis than this (84 deg) are left out.
_LEAST_COSINE = 0.1
_BLOCKS = 12
_ROBUST_ROUNDS = 3
_NO_FIT = (np.full(3, np.nan), np.nan)


def fit_arc(
    observations: Sequence[LimbObservation], planet: Planet, altitude_m: float | None = None
) -> HorizonFit:
    """Nadir and rho from circles in the image, of one camera or of several.

    One camera: the deviation of its axis from the vertical, from centre and radius; with a known
    altitude_m, from the vertex alone, which is far more precise. Several: each camera's optical
    axis and centre of curvature span a plane that holds nadir; it is the planes' common line, and
    rho the mean angle between it and the vertices (paper's two-camera vertical). Cameras whose
    planes coincide: the mean of the single answers.
    The covariance is a jackknife over blocks of the arcs (noise and its correlation) and, for the
    approximation's own error, the difference from the exact circle on the sphere. Only the former
    decides whether there is an answer.
    """
    rays = gather(observations)
    refused = too_few(rays, _METHOD)
    if refused:
        return refused
    by_name = {observation.view.name: observation.view for observation in observations}
    rotations = [by_name[name].rot_base_from_cam for name in rays.cameras]
    rho_known = None if altitude_m is None else planet.rho_from_altitude(altitude_m)
    everything = np.ones(len(rays), dtype=bool)
    nadir, rho = _vertical(rays, rotations, everything, rho_known)
    if not np.all(np.isfinite(nadir)):
        reason = "no circle through the limb points of any camera"
        return HorizonFit.none(Status.ILL_CONDITIONED, reason, _METHOD, rays.num_points)
    return assess_closed_form(
        rays,
        planet,
        _METHOD,
        nadir,
        rho,
        lambda basis, _: (
            _jackknife(rays, rotations, rho_known, nadir, basis),
            robust_circle_on_sphere(rays),
        ),
    )


def fit_circle(points: np.ndarray) -> tuple[np.ndarray, float]:
    """Centre (2,) and radius of the circle through points (N, 2) by Taubin's method; NaN for none.

    Source: Taubin 1991, in Chernov's SVD form. Points on a line have no circle.
    """
    middle = points.mean(axis=0)
    centred = points - middle
    squares = np.einsum("ij,ij->i", centred, centred)
    mean_square = float(squares.mean())
    if len(points) < 3 or mean_square <= 0:
        return np.full(2, np.nan), np.nan
    half = 2.0 * np.sqrt(mean_square)
    moments = np.column_stack(((squares - mean_square) / half, centred))
    a, b, c = np.linalg.svd(moments, full_matrices=False)[2][-1]
    a /= half
    if abs(a) * np.sqrt(mean_square) < 1e-9:
        return np.full(2, np.nan), np.nan
    centre = -np.array([b, c]) / (2.0 * a)
    radius = float(np.sqrt(centre @ centre + mean_square))
    return centre + middle, radius


def _robust_circle(points: np.ndarray) -> tuple[np.ndarray, float]:
    """`fit_circle` without the points that lie far from it."""
    centre, radius = fit_circle(points)
    for _ in range(_ROBUST_ROUNDS):
        distance = np.linalg.norm(points - centre, axis=1) - radius
        keep = inliers(distance)
        if keep.all() or np.count_nonzero(keep) < MIN_POINTS:
            break
        points = points[keep]
        centre, radius = fit_circle(points)
    return centre, radius


def _vertical(
    rays: LimbRays, rotations: list[np.ndarray], keep: np.ndarray, rho_known: float | None
) -> tuple[np.ndarray, float]:
    """Nadir and rho from the kept points, NaN if there are none."""
    singles, planes, vertices, sizes = [], [], [], []
    for index, rot_base_from_cam in enumerate(rotations):
        mine = keep & (rays.camera == index)
        found = _one_camera(rays, mine, rot_base_from_cam, rho_known)
        if found is None:
            continue
        nadir, rho, plane, vertex = found
        singles.append(np.append(nadir, rho))
        planes.append(plane)
        vertices.append(vertex)
        sizes.append(np.count_nonzero(mine))
    if not singles:
        return _NO_FIT
    mean = np.average(singles, axis=0, weights=sizes)
    norm = np.linalg.norm(mean[:3])
    if norm < 1e-6:
        return _NO_FIT
    nadir, rho = mean[:3] / norm, float(mean[3])
    if len(singles) < 2:
        return nadir, rho
    _, strength, rows = np.linalg.svd(np.array(planes))
    if strength[1] < np.sin(LEAST_ANGLE_RAD):
        return nadir, rho
    common = rows[2] if rows[2] @ nadir > 0 else -rows[2]
    if rho_known is None:
        rho = float(np.mean(np.arccos(np.clip(np.array(vertices) @ common, -1.0, 1.0))))
    return common, rho


def _one_camera(
    rays: LimbRays, mine: np.ndarray, rot_base_from_cam: np.ndarray, rho_known: float | None
) -> tuple[np.ndarray, float, np.ndarray, np.ndarray] | None:
    """Nadir, rho, normal of the plane of symmetry, limb vertex; None without a circle."""
    rays_cam = rays.rays_base[mine] @ rot_base_from_cam
    ahead = rays_cam[:, 2] > _LEAST_COSINE
    if np.count_nonzero(ahead) < MIN_POINTS:
        return None
    points = rays_cam[ahead, :2] / rays_cam[ahead, 2:]
    centre, radius = _robust_circle(points)
    if not np.isfinite(radius):
        return None
    # The planet lies on the centre's side of the limb.
    distance = float(np.linalg.norm(centre))
    towards = centre / distance if distance > 0 else np.array([1.0, 0.0])
    far = float(np.median((points - centre) @ towards)) > 0
    rho = float(np.arctan(radius)) if rho_known is None else rho_known
    if far:
        vertex_angle = np.arctan(distance + radius)
        eta = vertex_angle - rho
    else:
        vertex_angle = np.arctan(distance - radius)
        eta = vertex_angle + rho
    axis = np.array([0.0, 0.0, 1.0])
    side = np.append(towards, 0.0)
    nadir = np.sin(eta) * side + np.cos(eta) * axis
    vertex = np.sin(vertex_angle) * side + np.cos(vertex_angle) * axis
    plane = np.cross(axis, side)
    return (
        rot_base_from_cam @ nadir,
        rho,
        rot_base_from_cam @ plane,
        rot_base_from_cam @ vertex,
    )


def _jackknife(
    rays: LimbRays,
    rotations: list[np.ndarray],
    rho_known: float | None,
    nadir: np.ndarray,
    basis: np.ndarray,
) -> np.ndarray:
    """(3, 3) of (tangent components, rho) from estimates that leave out one block of the limb."""
    order = rays.along_limb(nadir)
    block = np.empty(len(rays), dtype=int)
    block[order] = np.arange(len(rays)) * _BLOCKS // len(rays)
    states = []
    for left_out in range(_BLOCKS):
        other, rho = _vertical(rays, rotations, block != left_out, rho_known)
        states.append(np.append(other @ basis, rho))
    deviations = np.array(states) - np.mean(states, axis=0)
    return deviations.T @ deviations * (_BLOCKS - 1) / _BLOCKS
