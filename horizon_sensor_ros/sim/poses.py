"""Cameras and poses to simulate with: lenses, attitudes in paper C's convention, directions.

Body frame of paper C: x forward, y right, z down; its level frame has z towards the planet.
"""

from __future__ import annotations

import numpy as np

from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.planet import Planet

# Optical frame (x right, y down, z forward) of a camera that looks along a body axis, to the body.
ROT_BODY_FROM_FORWARD_CAMERA = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
ROT_BODY_FROM_RIGHT_CAMERA = np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])

# The base frame in the body's axes: "frd" is the body frame, "flu" REP 103's (forward, left, up).
ROT_BASE_FROM_BODY = {"frd": np.eye(3), "flu": np.diag([1.0, -1.0, -1.0])}


def side_views(camera: Camera, base_axes: str = "frd") -> tuple[CameraView, CameraView]:
    """Two cameras with perpendicular axes (papers A, B): camera_1 forward, camera_2 to the right.

    base_axes : "frd" or "flu", the base frame's axes; else ValueError.
    """
    if base_axes not in ROT_BASE_FROM_BODY:
        raise ValueError(f'base_axes must be "frd" or "flu", got {base_axes!r}')
    to_base = ROT_BASE_FROM_BODY[base_axes]
    return (
        CameraView("camera_1", camera, to_base @ ROT_BODY_FROM_FORWARD_CAMERA),
        CameraView("camera_2", camera, to_base @ ROT_BODY_FROM_RIGHT_CAMERA),
    )


def camera_from_fov(width: int, height: int, fov_rad: float) -> Camera:
    """Pinhole camera with square pixels and a field of view across its width, edge to edge; not in
    (0, pi): ValueError.
    """
    if not 0.0 < fov_rad < np.pi:
        raise ValueError(f"fov_rad must be between 0 and pi, got {fov_rad}")
    focal = 0.5 * width / np.tan(0.5 * fov_rad)
    return Camera(width, height, focal, focal, (width - 1) / 2.0, (height - 1) / 2.0)


def rot_level_from_body(roll_rad: float, pitch_rad: float, yaw_rad: float = 0.0) -> np.ndarray:
    """Rotation (3, 3), Rz(yaw) Ry(pitch) Rx(roll), into a level frame whose z points down."""
    cr, sr = np.cos(roll_rad), np.sin(roll_rad)
    cp, sp = np.cos(pitch_rad), np.sin(pitch_rad)
    cy, sy = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def rot_world_from_level(position_ecef_m: np.ndarray, planet: Planet) -> np.ndarray:
    """Rotation (3, 3) of the geocentric north, east, down frame at a position (3,) into ECEF."""
    down = planet.nadir_ecef(position_ecef_m)
    east = np.cross([0.0, 0.0, 1.0], -down)
    if np.linalg.norm(east) < 1e-9:  # over a pole
        east = np.array([0.0, 1.0, 0.0])
    east /= np.linalg.norm(east)
    return np.stack([np.cross(east, down), east, down], axis=1)


def pose_from_attitude(
    altitude_m: float,
    roll_rad: float,
    pitch_rad: float,
    yaw_rad: float = 0.0,
    *,
    latitude_rad: float = 0.0,
    longitude_rad: float = 0.0,
    planet: Planet | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Attitude rot_world_from_body (3, 3) and position_ecef_m (3,) of a body above the planet.

    Roll, pitch and yaw are paper C's, against geocentric north, east, down; latitude is geodetic.
    """
    planet = Planet() if planet is None else planet
    position = planet.ecef_from_geodetic(latitude_rad, longitude_rad, altitude_m)
    level = rot_world_from_level(position, planet)
    return level @ rot_level_from_body(roll_rad, pitch_rad, yaw_rad), position


def rot_from_axis(axis: np.ndarray, roll_rad: float = 0.0) -> np.ndarray:
    """Rotation (3, 3) out of an optical frame whose z is `axis` (3,), turned about it by roll."""
    z = np.asarray(axis, float) / np.linalg.norm(axis)
    x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
    x /= np.linalg.norm(x)
    y = np.cross(z, x)
    c, s = np.cos(roll_rad), np.sin(roll_rad)
    return np.stack([c * x + s * y, -s * x + c * y, z], axis=1)


def random_direction(rng: np.random.Generator) -> np.ndarray:
    """Unit vector (3,), uniform over the sphere."""
    v = rng.standard_normal(3)
    return v / np.linalg.norm(v)
