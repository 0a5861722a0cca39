"""Coarse poses and angular rates to numpy."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.ros.messages.geometry import rotation_of, xyz_of
from horizon_sensor_ros.ros.messages.refusal import Refusal, quoted

EARTH_FRAME = "earth"

_FARTHEST_M = 1e12  # of a coarse pose
_FASTEST_RAD_S = 100.0  # of an angular rate; no gyro measures more


def coarse_pose_from_message(msg: Any, planet: Planet) -> tuple[np.ndarray, np.ndarray] | Refusal:
    """Position (3,), m, and rot_ecef_from_base (3, 3) of a `PoseStamped` in the frame `earth`."""
    frame = str(msg.header.frame_id)
    if frame != EARTH_FRAME:
        return Refusal("wrong_frame", f"header frame is {quoted(frame)}, not '{EARTH_FRAME}'")
    position = xyz_of(msg.pose.position)
    if not np.all(np.isfinite(position)):
        return Refusal("not_finite", "position is not finite")
    distance = math.hypot(*position)
    far_km = f"position is {distance / 1e3:.0f} km from the planet's centre"
    if distance < planet.polar_radius_m:
        return Refusal("inside_planet", far_km)
    if distance > _FARTHEST_M:
        return Refusal("too_far", far_km)
    try:
        return position, rotation_of(msg.pose.orientation)
    except ValueError as error:
        return Refusal("bad_orientation", str(error))


def rate_from_imu(msg: Any, base_frame: str) -> np.ndarray | Refusal:
    """Angular rate (3,), rad/s, of a `sensor_msgs/Imu` in the base frame."""
    frame = str(msg.header.frame_id)
    if frame != base_frame:
        return Refusal("wrong_frame", f"header frame is {quoted(frame)}, not {quoted(base_frame)}")
    rate = xyz_of(msg.angular_velocity)
    if not np.all(np.isfinite(rate)):
        return Refusal("not_finite", "angular velocity is not finite")
    if math.hypot(*rate) > _FASTEST_RAD_S:
        return Refusal("too_fast", f"angular velocity is {math.hypot(*rate):.3g} rad/s")
    if float(msg.angular_velocity_covariance[0]) == -1.0:
        return Refusal("no_rate", "angular_velocity_covariance[0] is -1: there is no rate")
    return rate
