"""Topics of the truth that a simulated recording has beside its sensors' topics.

Stamps are those of the images and clouds. A recording of real sensors has none of these topics.

| topic | type | content |
|---|---|---|
| `truth/local_vertical` | Vector3Stamped | unit vector towards the planet, as `local_vertical` |
| `truth/attitude` | PoseStamped | base frame in the level frame (yaw 0), as `attitude` |
| `truth/target/pose` | PoseStamped | the target's own axes in the sensor frame |

The target's own axes are those of its drawing; the frame of `target/pose` is another one fixed to
the target, which the node sets anew now and then: see `pose_in_target_frame`.
"""

from __future__ import annotations

import numpy as np
from geometry_msgs.msg import PoseStamped, Vector3Stamped

from horizon_sensor_ros.core.mathematics.attitude import level_from_base, nadir_sign
from horizon_sensor_ros.core.mathematics.rigid import inverse_pose, pose_matrix
from horizon_sensor_ros.ros.messages.estimates import LEVEL_FRAME, pose_message
from horizon_sensor_ros.ros.messages.stamps import time_from_ns

TRUE_LOCAL_VERTICAL = "truth/local_vertical"
TRUE_ATTITUDE = "truth/attitude"
TRUE_TARGET_POSE = "truth/target/pose"

TRUTH_TOPICS: dict[str, type] = {
    TRUE_LOCAL_VERTICAL: Vector3Stamped,
    TRUE_ATTITUDE: PoseStamped,
    TRUE_TARGET_POSE: PoseStamped,
}


def true_vertical_message(nadir_base: np.ndarray, stamp: int, base_frame: str) -> Vector3Stamped:
    """Message of `truth/local_vertical`; nadir_base (3,) is a unit vector."""
    msg = Vector3Stamped()
    msg.header.stamp = time_from_ns(stamp)
    msg.header.frame_id = base_frame
    msg.vector.x, msg.vector.y, msg.vector.z = map(float, nadir_base)
    return msg


def true_attitude_message(
    nadir_base: np.ndarray, altitude_m: float, stamp: int, level_z: str
) -> PoseStamped:
    """Message of `truth/attitude`, in the convention of `level_z`."""
    height = np.array([0.0, 0.0, -nadir_sign(level_z) * altitude_m])
    return true_pose_message(
        pose_matrix(level_from_base(nadir_base, level_z), height), stamp, LEVEL_FRAME
    )


def true_pose_message(pose: np.ndarray, stamp: int, frame_id: str) -> PoseStamped:
    """Message of a pose (4, 4) in a frame."""
    whole = pose_message(pose, np.zeros((6, 6)), stamp, frame_id)
    return PoseStamped(header=whole.header, pose=whole.pose.pose)


def pose_in_target_frame(
    true_pose: np.ndarray, true_pose_when_set: np.ndarray, pose_when_set: np.ndarray
) -> np.ndarray:
    """Truth (4, 4) for a `target/pose`, given the truth of its stamp on `truth/target/pose`.

    A `target/pose` without a `target/pose_delta` of its stamp sets a new target frame;
    `pose_when_set` is the last such one, `true_pose_when_set` the truth of its stamp.
    """
    return true_pose @ inverse_pose(true_pose_when_set) @ pose_when_set
