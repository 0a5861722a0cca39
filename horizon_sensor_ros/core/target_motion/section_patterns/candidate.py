"""Motions of the target as paper D tells them.

A candidate motion is (theta, phi, psi, x, y, z): pitch about y, roll about x, yaw about z (rad)
and the shift (m) of the section planes, in the inertia frame n of the previous cloud.
"""

from __future__ import annotations

import numpy as np

from horizon_sensor_ros.core.mathematics.rigid import pose_matrix
from horizon_sensor_ros.core.target_motion.section_patterns.section_pattern import Sections


def rotation_n_from_v(theta: float, phi: float, psi: float) -> np.ndarray:
    """G_n_v = Ry(theta) Rx(phi) Rz(psi), (3, 3)."""
    return rotations_n_from_v(np.array([[theta, phi, psi]]))[0]


def motion(sections: Sections, candidate: np.ndarray) -> np.ndarray:
    """(4, 4) rigid motion in the sensor frame, p_current = pose p_previous, of a candidate."""
    u, origin = sections.frame.rot_sensor_from_frame, sections.frame.origin_m
    turn = u @ rotation_n_from_v(*candidate[:3]) @ u.T
    return pose_matrix(turn, origin + u @ np.asarray(candidate[3:]) - turn @ origin)


def candidate_of(sections: Sections, pose: np.ndarray) -> np.ndarray:
    """(6,) the candidate of a rigid motion (4, 4) in the sensor frame: the inverse of
    ``motion``.
    """
    u, origin = sections.frame.rot_sensor_from_frame, sections.frame.origin_m
    g = u.T @ pose[:3, :3] @ u
    shift = u.T @ (pose[:3, :3] @ origin + pose[:3, 3] - origin)
    angles = [
        np.arctan2(g[0, 2], g[2, 2]),
        np.arcsin(np.clip(-g[1, 2], -1, 1)),
        np.arctan2(g[1, 0], g[1, 1]),
    ]
    return np.concatenate([angles, shift])


def rotations_n_from_v(angles: np.ndarray) -> np.ndarray:
    """(C, 3, 3) Ry(theta) Rx(phi) Rz(psi) of (C, 3) angles."""
    (st, sf, sp), (ct, cf, cp) = np.sin(angles.T), np.cos(angles.T)
    return np.stack(
        [ct * cp + st * sf * sp, -ct * sp + st * sf * cp, st * cf,
         cf * sp, cf * cp, -sf,
         -st * cp + ct * sf * sp, st * sp + ct * sf * cp, ct * cf], axis=1,
    ).reshape(-1, 3, 3)  # fmt: skip
