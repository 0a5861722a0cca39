"""Attitude from the vertical: quaternions, roll and pitch, the level frame, and its covariance.

Level frame: z along the local vertical, ``level_z`` "up" (away from the planet, the default of the
nodes) or "down" (towards it). Its yaw is arbitrary and chosen so that the base frame has yaw 0:
``rot_level_from_base = Ry(pitch) Rx(roll)``. With "down", nadir in the base frame is
``(-sin pitch, cos pitch sin roll, cos pitch cos roll)`` (Raeisy & Ghofrani); with "up" it is minus
that.
"""

from __future__ import annotations

import math

import numpy as np

# Not observed by a horizon sensor. Yaw: one sigma is a full turn. Along the ground: one sigma is of
# the size of a planet.
YAW_VARIANCE_RAD2 = (2 * np.pi) ** 2
GROUND_VARIANCE_M2 = 1e14

_QUATERNION_NORM_TOLERANCE = 1e-3


def rotation_from_quaternion(quaternion_xyzw: np.ndarray) -> np.ndarray:
    """Rotation matrix (3, 3) of a unit quaternion (x, y, z, w).

    Raises ValueError when it is not finite or its length is off 1 by more than 1e-3.
    """
    q = np.asarray(quaternion_xyzw, dtype=float)
    if q.shape != (4,) or not np.all(np.isfinite(q)):
        raise ValueError(f"quaternion must be four finite numbers x, y, z, w, got {q.tolist()}")
    norm = math.hypot(*q)
    if abs(norm - 1.0) > _QUATERNION_NORM_TOLERANCE:
        raise ValueError(f"quaternion must have length 1, got {norm:.6g} for {q.tolist()}")
    x, y, z, w = q / norm
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def quaternion_from_rotation(rot: np.ndarray) -> np.ndarray:
    """Unit quaternion (x, y, z, w), w >= 0, of a rotation matrix (3, 3).

    Raises ValueError when rot is not a rotation (orthonormal to 1e-6, determinant +1).
    """
    m = require_rotation(rot, "rot")
    # Four times the outer product of the quaternion with itself; its largest column is well scaled.
    outer = np.array(
        [
            [
                1 + m[0, 0] - m[1, 1] - m[2, 2],
                m[1, 0] + m[0, 1],
                m[2, 0] + m[0, 2],
                m[2, 1] - m[1, 2],
            ],
            [
                m[1, 0] + m[0, 1],
                1 - m[0, 0] + m[1, 1] - m[2, 2],
                m[2, 1] + m[1, 2],
                m[0, 2] - m[2, 0],
            ],
            [
                m[2, 0] + m[0, 2],
                m[2, 1] + m[1, 2],
                1 - m[0, 0] - m[1, 1] + m[2, 2],
                m[1, 0] - m[0, 1],
            ],
            [m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], 1 + np.trace(m)],
        ]
    )
    q = outer[np.argmax(np.diag(outer))]
    q = q / np.linalg.norm(q)
    return -q if q[3] < 0 else q


def require_rotation(rot: np.ndarray, name: str) -> np.ndarray:
    """Return rot as a float (3, 3) array; ValueError, with its name, when it is not a rotation."""
    m = np.array(rot, dtype=float)
    if m.shape != (3, 3) or not np.all(np.isfinite(m)):
        raise ValueError(f"{name} must be a finite 3 x 3 matrix, got shape {m.shape}")
    if np.abs(m @ m.T - np.eye(3)).max() > 1e-6 or np.linalg.det(m) < 0:
        raise ValueError(f"{name} is not a rotation matrix: {m.tolist()}")
    return m


def require_vector(vector: np.ndarray, name: str, unit: str) -> np.ndarray:
    """Return a vector as a float (3,) array; ValueError, with its name, when it is not finite."""
    v = np.array(vector, dtype=float)
    if v.shape != (3,) or not np.all(np.isfinite(v)):
        raise ValueError(f"{name} must be three finite {unit}, got {v.tolist()}")
    return v


def nadir_from_roll_pitch(roll_rad: float, pitch_rad: float, level_z: str = "up") -> np.ndarray:
    """Nadir (3,), unit, in the base frame; level_z is "up" or "down", else ValueError."""
    z_base = np.array(
        [
            -np.sin(pitch_rad),
            np.cos(pitch_rad) * np.sin(roll_rad),
            np.cos(pitch_rad) * np.cos(roll_rad),
        ]
    )
    return nadir_sign(level_z) * z_base


def roll_pitch_from_nadir(nadir_base: np.ndarray, level_z: str = "up") -> tuple[float, float]:
    """Roll in (-pi, pi] and pitch in [-pi/2, pi/2] of a nadir (3,) in the base frame.

    At pitch +-pi/2, where roll is free, it is 0. Raises ValueError for a nadir that is no
    direction.
    """
    z_base = nadir_sign(level_z) * unit_direction(nadir_base, "nadir_base")
    level = float(np.hypot(z_base[1], z_base[2]))
    roll = float(np.arctan2(z_base[1], z_base[2])) if level > 0 else 0.0
    # Just below zero, -0.0 included, half a turn rounds to minus half a turn.
    return abs(roll) if roll == -np.pi else roll, float(np.arctan2(-z_base[0], level))


def level_from_base(nadir_base: np.ndarray, level_z: str = "up") -> np.ndarray:
    """rot_level_from_base (3, 3), yaw 0, of a nadir (3,) in the base frame.

    It takes nadir to (0, 0, 1) with level_z "down", to (0, 0, -1) with "up". At pitch +-pi/2 yaw
    and roll are the same turn; roll is then taken as 0. Raises ValueError for a nadir that is no
    direction.
    """
    roll, pitch = roll_pitch_from_nadir(nadir_base, level_z)
    cos_roll, sin_roll = np.cos(roll), np.sin(roll)
    cos_pitch, sin_pitch = np.cos(pitch), np.sin(pitch)
    return np.array(
        [
            [cos_pitch, sin_pitch * sin_roll, sin_pitch * cos_roll],
            [0.0, cos_roll, -sin_roll],
            [-sin_pitch, cos_pitch * sin_roll, cos_pitch * cos_roll],
        ]
    )


def pose_covariance(
    cov_nadir_altitude: np.ndarray, rot_level_from_base: np.ndarray, level_z: str = "up"
) -> np.ndarray:
    """Covariance (6, 6) of the base frame's pose in the level frame: x y z, rotations about x y z.

    cov_nadir_altitude : (4, 4) of (nadir_base, altitude_m), as in `HorizonFit`.
    The rotation error e is about the level frame's fixed axes, ``R = exp(e) R_true`` (REP 103).
    position.z is the altitude with level_z "up", minus it with "down". With s = +1 for "down", -1
    for "up": a nadir error d in the level frame means ``e = s (d_y, -d_x)``, and the error of
    position.z is -s times that of the altitude. x, y and yaw are not observed: `GROUND_VARIANCE_M2`
    and `YAW_VARIANCE_RAD2`, uncorrelated with the rest.
    Raises ValueError for a wrong shape, a matrix that is no rotation, another level_z.
    """
    cov = np.asarray(cov_nadir_altitude, dtype=float)
    if cov.shape != (4, 4):
        raise ValueError(f"cov_nadir_altitude must be 4 x 4, got {cov.shape}")
    rot = require_rotation(rot_level_from_base, "rot_level_from_base")
    sign = nadir_sign(level_z)
    observed_from_errors = np.zeros((3, 4))
    observed_from_errors[0, 3] = -sign
    observed_from_errors[1, :3] = sign * rot[1]
    observed_from_errors[2, :3] = -sign * rot[0]
    out = np.diag([GROUND_VARIANCE_M2, GROUND_VARIANCE_M2, 0, 0, 0, YAW_VARIANCE_RAD2])
    block = observed_from_errors @ cov @ observed_from_errors.T
    out[2:5, 2:5] = 0.5 * (block + block.T)
    return out


def tangent_basis(direction: np.ndarray) -> np.ndarray:
    """Two unit vectors perpendicular to a unit vector (3,) and to each other, as columns (3, 2)."""
    x, y, z = direction.tolist()
    # Branch-free but for the sign of z, and never near a singularity (Duff et al. 2017).
    sign = 1.0 if z >= 0 else -1.0
    a = -1.0 / (sign + z)
    b = x * y * a
    return np.array([[1.0 + sign * x * x * a, b], [sign * b, sign + y * y * a], [-sign * x, -y]])


def angle_rad(a: np.ndarray, b: np.ndarray) -> float:
    """Angle (rad) between two unit vectors (3,), accurate for small ones."""
    p, q = a.tolist(), b.tolist()
    return 2.0 * math.atan2(math.dist(p, q), math.dist(p, [-each for each in q]))


def shortest_turn(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Rotation vector (3,), rad, of the shortest turn of one unit vector (3,) to another; of
    opposite ones half a turn about one of the axes across them.
    """
    cosine = float(start @ end)
    # Less what is parallel, so that little is left of rounding where the two are so nearly.
    axis = np.cross(start, end - math.copysign(1.0, cosine) * start)
    sine = float(np.linalg.norm(axis))
    angle = math.atan2(sine, cosine)
    return axis * (angle / sine) if sine > 1e-300 else angle * tangent_basis(start)[:, 0]


def nadir_sign(level_z: str) -> float:
    """Nadir's component along the level frame's z: +1 for "down", -1 for "up"; else ValueError."""
    if level_z == "down":
        return 1.0
    if level_z == "up":
        return -1.0
    raise ValueError(f'level_z must be "up" or "down", got {level_z!r}')


def unit_direction(vector: np.ndarray, name: str) -> np.ndarray:
    """Unit vector along (3,); ValueError, with its name, when that is no direction."""
    v = np.asarray(vector, dtype=float)
    norm = float(np.linalg.norm(v)) if v.shape == (3,) else np.nan
    if not (np.isfinite(norm) and norm > 0):
        raise ValueError(f"{name} must be a direction (3,), got {v.tolist()}")
    return v / norm
