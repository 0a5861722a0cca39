"""Whether an answer or truth in a bag states anything: other programs may write there too."""

from __future__ import annotations

from typing import Any

import numpy as np

from horizon_sensor_ros.ros.messages.geometry import rotation_of, xyz_of


def is_usable(msg: Any) -> bool:
    """Whether a message of an answer or of a truth is finite, its direction one, and its rotation.

    msg : Vector3Stamped, PoseStamped, PoseWithCovarianceStamped or TwistWithCovarianceStamped.
    """
    if hasattr(msg, "vector"):
        size = float(np.linalg.norm(xyz_of(msg.vector)))
        return bool(0.0 < size < np.inf)
    if hasattr(msg, "twist"):
        rates = (*xyz_of(msg.twist.twist.linear), *xyz_of(msg.twist.twist.angular))
        return _finite(*rates, *msg.twist.covariance)
    pose, covariance = msg.pose, ()
    if hasattr(pose, "pose"):
        pose, covariance = pose.pose, pose.covariance
    try:
        rotation_of(pose.orientation)
    except ValueError:
        return False
    return _finite(*xyz_of(pose.position), *covariance)


def _finite(*numbers: float) -> bool:
    return bool(np.isfinite(numbers).all())
