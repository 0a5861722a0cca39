"""Whether an answer or truth in a bag states anything: other programs may write there too."""

from __future__ import annotations

from typing import Any

import numpy as np

from horizon_sensor_ros.core.mathematics.attitude import rotation_from_quaternion


def is_usable(msg: Any) -> bool:
    """Whether a message of an answer or of a truth is finite, its direction one, and its rotation.

    msg : Vector3Stamped, PoseStamped, PoseWithCovarianceStamped or TwistWithCovarianceStamped.
    """
    if hasattr(msg, "vector"):
        size = float(np.linalg.norm(_xyz(msg.vector)))
        return bool(0.0 < size < np.inf)
    if hasattr(msg, "twist"):
        rates = (*_xyz(msg.twist.twist.linear), *_xyz(msg.twist.twist.angular))
        return _finite(*rates, *msg.twist.covariance)
    pose, covariance = msg.pose, ()
    if hasattr(pose, "pose"):
        pose, covariance = pose.pose, pose.covariance
    q = pose.orientation
    try:
        rotation_from_quaternion(np.array([q.x, q.y, q.z, q.w]))
    except ValueError:
        return False
    return _finite(*_xyz(pose.position), *covariance)


def _xyz(vector: Any) -> tuple[float, float, float]:
    return vector.x, vector.y, vector.z


def _finite(*numbers: float) -> bool:
    return bool(np.isfinite(numbers).all())
