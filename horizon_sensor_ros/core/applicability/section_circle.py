"""The section-circle approximation of the horizon, as Lomaka & Ustyugov print it (eqs 1-13).

For comparison only; `visibility` is exact. The planet is cut by the plane of the frame, which
passes through the point K where a ray in the vertical plane of the optical axis touches the planet:
the circle of the cut stands for the horizon. It meets the true horizon at K and has its curvature
there when the optical axis passes through K; elsewhere the two part.

Lengths are in planet radii, vectors in the camera's optical frame with the origin at the planet's
centre. Ideal pinhole only: the paper's camera is a pyramid.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class SectionCircle:
    """The circle at each attitude, as it appears in the image plane at unit distance.

    centre : (M, 2), x right, y down. radius : (M,). NaN where the frame's plane lies behind the
    camera: the paper has no rule for that case, and here the horizon is then not seen.
    """

    centre: np.ndarray
    radius: np.ndarray


def section_circle(nadir_cam: np.ndarray, rho_rad: float) -> SectionCircle:
    """Cut of the sphere by the frame's plane for each nadir_cam (M, 3); eqs 1, 2, 7.

    Eq. 1 is read as: K lies in the vertical plane of the axis, on the ray n_p from the camera, and
    n_p . K = 0 (the ray touches the sphere); the extracted text has n_k in the last line, which
    would be a tangent only for an axis that already touches the horizon.
    Raises ValueError for a wrong shape or rho outside (0, pi/2).
    """
    nadir = np.asarray(nadir_cam, dtype=float)
    if nadir.ndim != 2 or nadir.shape[1] != 3:
        raise ValueError(f"nadir_cam must have shape (M, 3), got {nadir.shape}")
    if not 0.0 < rho_rad < np.pi / 2:
        raise ValueError(f"rho_rad must be between 0 and pi/2, got {rho_rad}")
    position = -nadir / np.sin(rho_rad)
    # The horizontal direction of the optical axis (0, 0, 1); any will do when it is the vertical.
    ahead = np.array([0.0, 0.0, 1.0]) - nadir[:, 2:] * nadir
    length = np.linalg.norm(ahead, axis=1, keepdims=True)
    sideways = np.cross(nadir, [1.0, 0.0, 0.0]) + 1e-9 * np.cross(nadir, [0.0, 1.0, 0.0])
    sideways /= np.linalg.norm(sideways, axis=1, keepdims=True)
    ahead = np.where(length > 1e-9, ahead / np.maximum(length, 1e-9), sideways)
    tangent_ray = np.cos(rho_rad) * nadir + np.sin(rho_rad) * ahead
    touching = position + tangent_ray / np.tan(rho_rad)
    # The frame's plane is z = K_z; the centre of the cut is the foot of the planet's centre on it.
    distance = touching[:, 2] - position[:, 2]
    in_front = distance > 0
    scale = np.where(in_front, 1.0 / np.where(in_front, distance, 1.0), np.nan)
    return SectionCircle(
        centre=-position[:, :2] * scale[:, None],
        radius=np.hypot(touching[:, 0], touching[:, 1]) * scale,
    )


def section_circle_in_frame(
    nadir_cam: np.ndarray,
    rho_rad: float,
    half_width: float,
    half_height: float,
    samples: int = 3600,
) -> tuple[np.ndarray, np.ndarray]:
    """What is in the frame by the approximation: fraction of the circle and length, each (M,).

    half_width, half_height : of the frame, tangents of the half-angles of view; the length has the
    same unit (times the focal length in pixels it is in pixels). A point is in the frame when the
    triangles that it makes with the frame's sides have the frame's area (eqs 9-13).
    """
    circle = section_circle(nadir_cam, rho_rad)
    fraction = np.zeros(len(circle.radius))
    corners = np.array(
        [
            [-half_width, -half_height],
            [half_width, -half_height],
            [half_width, half_height],
            [-half_width, half_height],
        ]
    )
    area = 4 * half_width * half_height
    # Eq. 8: points of the circle.
    t = 2 * np.pi * np.arange(samples) / samples
    unit = np.column_stack([np.cos(t), np.sin(t)])
    # Areas are formed only for points as near to the frame's centre as its corners:
    # |centre + radius unit|^2 <= reach^2, linear in unit. NaN compares false: nothing is seen.
    reach = np.hypot(half_width, half_height) * (1 + 1e-9)
    nearest = np.sum(circle.centre**2, axis=1) + circle.radius**2 - reach**2
    candidates = np.flatnonzero(nearest <= 2 * circle.radius * np.hypot(*circle.centre.T))
    for first in range(0, candidates.size, 1024):
        batch = candidates[first : first + 1024]
        centre, radius = circle.centre[batch], circle.radius[batch]
        near = 2 * radius[:, None] * (centre @ unit.T) <= -nearest[batch, None]
        cell, sample = np.nonzero(near)
        points = centre[cell] + radius[cell, None] * unit[sample]
        triangles = np.zeros(len(points))
        for i in range(4):
            a, b = points - corners[i], points - corners[(i + 1) % 4]
            triangles += 0.5 * np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
        inside = triangles <= area * (1 + 1e-9)
        fraction[batch] = np.bincount(cell[inside], minlength=batch.size) / samples
    length = fraction * 2 * np.pi * np.where(fraction > 0, circle.radius, 0.0)
    return fraction, length
