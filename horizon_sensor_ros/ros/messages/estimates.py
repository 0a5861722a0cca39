"""Estimates to the messages that the nodes publish."""

from __future__ import annotations

import numpy as np
from geometry_msgs.msg import (
    PoseWithCovarianceStamped,
    TwistWithCovarianceStamped,
    Vector3Stamped,
)

from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.mathematics.attitude import (
    level_from_base,
    nadir_sign,
    pose_covariance,
    quaternion_from_rotation,
)
from horizon_sensor_ros.ros.messages.stamps import time_from_ns

LEVEL_FRAME = "local_level"


def local_vertical_message(fit: HorizonFit, stamp: int, base_frame: str) -> Vector3Stamped:
    """Nadir: unit vector towards the planet in the base frame. `fit` has to be OK."""
    msg = Vector3Stamped()
    msg.header.stamp = time_from_ns(stamp)
    msg.header.frame_id = base_frame
    msg.vector.x, msg.vector.y, msg.vector.z = (float(v) for v in fit.nadir_base)
    return msg


def attitude_message(fit: HorizonFit, stamp: int, level_z: str) -> PoseWithCovarianceStamped:
    """Return the base frame's pose in the level frame: orientation (yaw 0), altitude in position.z.

    `fit` has to be OK. Covariance as in `core.mathematics.attitude.pose_covariance`.
    """
    rot_level_from_base = level_from_base(fit.nadir_base, level_z)
    msg = PoseWithCovarianceStamped()
    msg.header.stamp = time_from_ns(stamp)
    msg.header.frame_id = LEVEL_FRAME
    pose = msg.pose.pose
    pose.position.z = float(-nadir_sign(level_z) * fit.altitude_m)
    q = quaternion_from_rotation(rot_level_from_base)
    pose.orientation.x, pose.orientation.y, pose.orientation.z, pose.orientation.w = map(float, q)
    msg.pose.covariance = pose_covariance(
        fit.cov_nadir_altitude, rot_level_from_base, level_z
    ).ravel()
    return msg


def pose_message(
    pose: np.ndarray, covariance: np.ndarray, stamp: int, frame_id: str
) -> PoseWithCovarianceStamped:
    """Message of a pose (4, 4) in a frame.

    covariance : (6, 6) of (small rotations about that frame's axes, position), rad and m. The
    message has the position first.
    """
    msg = PoseWithCovarianceStamped()
    msg.header.stamp = time_from_ns(stamp)
    msg.header.frame_id = frame_id
    position, orientation = msg.pose.pose.position, msg.pose.pose.orientation
    position.x, position.y, position.z = map(float, pose[:3, 3])
    q = quaternion_from_rotation(pose[:3, :3])
    orientation.x, orientation.y, orientation.z, orientation.w = map(float, q)
    msg.pose.covariance = _position_first(covariance)
    return msg


def twist_message(
    twist: np.ndarray, covariance: np.ndarray, stamp: int, frame_id: str
) -> TwistWithCovarianceStamped:
    """Message of a velocity (6,), rotation (rad/s) before translation (m/s), in a frame.

    covariance : (6, 6) in the same order. The message has the translation first.
    """
    msg = TwistWithCovarianceStamped()
    msg.header.stamp = time_from_ns(stamp)
    msg.header.frame_id = frame_id
    linear, angular = msg.twist.twist.linear, msg.twist.twist.angular
    angular.x, angular.y, angular.z, linear.x, linear.y, linear.z = map(float, twist)
    msg.twist.covariance = _position_first(covariance)
    return msg


def _position_first(covariance: np.ndarray) -> np.ndarray:
    return np.roll(covariance, (3, 3), axis=(0, 1)).ravel()
