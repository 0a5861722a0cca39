"""The frame of a cloud's centroid and principal axes of inertia (paper D, "Construction of the
section planes").
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class InertiaFrame:
    """Frame n of the paper: ``origin_m`` (3,) its origin g_c, ``rot_sensor_from_frame`` (3, 3) its
    axes U as columns.
    """

    origin_m: np.ndarray
    rot_sensor_from_frame: np.ndarray

    def coordinates(self, points: np.ndarray) -> np.ndarray:
        """(N, 3) points of the sensor frame in this frame."""
        return (points - self.origin_m) @ self.rot_sensor_from_frame


def inertia_matrix(points: np.ndarray) -> np.ndarray:
    """(3, 3) about the centroid, unit masses: J_aa = sum (b^2 + c^2), J_ab = -sum a b."""
    offset = points - points.mean(axis=0)
    product = offset.T @ offset
    return np.eye(3) * np.trace(product) - product


def inertia_frame(points: np.ndarray) -> InertiaFrame:
    """Centroid and principal axes of (N, 3) points, the largest moment first (J = U D U^T),
    right-handed.

    Raises ValueError for fewer than three points or any that is not finite.
    """
    points = np.asarray(points, dtype=float)
    if points.ndim != 2 or points.shape[1] != 3 or len(points) < 3 or not np.isfinite(points).all():
        raise ValueError(f"points must be finite, (N >= 3, 3), got shape {points.shape}")
    u = np.linalg.svd(inertia_matrix(points))[0]
    if np.linalg.det(u) < 0:
        u[:, 2] = -u[:, 2]
    return InertiaFrame(points.mean(axis=0), u)
