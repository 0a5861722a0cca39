"""Rigid motions as (rotation (..., 3, 3), translation (..., 3)), and their small changes."""

from __future__ import annotations

import numpy as np


def skew(v: np.ndarray) -> np.ndarray:
    """(..., 3, 3) matrices with ``skew(v) @ a == cross(v, a)``."""
    v = np.asarray(v)
    out = np.zeros((*v.shape, 3), dtype=v.dtype)
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return out


def rotation_from_vector(vector_rad: np.ndarray) -> np.ndarray:
    """(..., 3, 3) rotations about ``vector_rad`` (..., 3) by its length (Rodrigues)."""
    vector = np.asarray(vector_rad, dtype=float)
    angle2 = (vector * vector).sum(axis=-1)[..., None, None]
    angle = np.sqrt(angle2)
    small = angle2 < 1e-8
    safe = np.where(small, 1.0, angle)
    a = np.where(small, 1 - angle2 / 6, np.sin(safe) / safe)
    b = np.where(small, 0.5 - angle2 / 24, (1 - np.cos(safe)) / (safe * safe))
    k = skew(vector)
    return np.eye(3) + a * k + b * (k @ k)


def vector_from_rotation(rotation: np.ndarray) -> np.ndarray:
    """The rotation vector (3,), radians, at most pi long, of one rotation (3, 3)."""
    r = np.asarray(rotation, dtype=float)
    axis2 = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    sine, cosine = np.linalg.norm(axis2) / 2, (np.trace(r) - 1) / 2
    angle = np.arctan2(sine, cosine)
    if cosine > 0:
        return axis2 / 2 if sine < 1e-7 else axis2 / (2 * sine) * angle
    # Towards half a turn the sine vanishes, and with it the axis; that of R + R^T does not.
    along = (r + r.T) / 2 - cosine * np.eye(3)
    column = along[:, np.argmax(np.diag(along))]
    return column / np.linalg.norm(column) * (angle if axis2 @ column >= 0 else -angle)


def inverse_left_jacobian(vector_rad: np.ndarray) -> np.ndarray:
    """(3, 3) by which a small rotation before a large one, of a vector (3,), changes that vector
    (Barfoot, State Estimation for Robotics, 2017, eq. 7.77).
    """
    angle = float(np.linalg.norm(vector_rad))
    across = skew(vector_rad)
    # The series' next term is angle**2 / 720.
    share = 1 / 12
    if angle > 1e-3:
        share = (1 - angle / 2 / np.tan(angle / 2)) / angle**2
    return np.asarray(np.eye(3) - across / 2 + share * across @ across)


def turn_and_shift(rotation: np.ndarray) -> np.ndarray:
    """(6, 6) by which a turn and a shift, one below the other, are told about other axes: rotation
    (3, 3) from the old ones, or what changes with it.
    """
    both = np.zeros((6, 6))
    both[:3, :3] = both[3:, 3:] = rotation
    return both


def rotated_covariance(covariance: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """A covariance (6, 6) of turn and shift about other axes, rotation (3, 3) from the old ones."""
    both = turn_and_shift(rotation)
    return np.asarray(both @ covariance @ both.T)


def pose_matrix(rotation: np.ndarray, translation_m: np.ndarray) -> np.ndarray:
    """(4, 4) homogeneous form."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, translation_m
    return pose


def inverse_pose(pose: np.ndarray) -> np.ndarray:
    """Inverse of a (4, 4) rigid motion."""
    back = pose[:3, :3].T
    return pose_matrix(back, -back @ pose[:3, 3])


def orthonormal(rotation: np.ndarray) -> np.ndarray:
    """The rotations nearest to (..., 3, 3) matrices that rounding has spoilt."""
    u, _, vt = np.linalg.svd(rotation)
    return u @ vt


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross products (N, 3): numpy's own spends most of its time on its arguments."""
    return a[:, [1, 2, 0]] * b[:, [2, 0, 1]] - a[:, [2, 0, 1]] * b[:, [1, 2, 0]]
