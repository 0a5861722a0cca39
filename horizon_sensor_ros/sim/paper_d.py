"""Paper D's test case: its satellite's attitudes in front of its camera."""

from __future__ import annotations

import numpy as np

from horizon_sensor_ros.core.mathematics.rigid import pose_matrix, rotation_from_vector

# Pitch of the cells of the section patterns in its example.
SECTION_PITCH_M = 0.026
DISTANCE_M = 5.5
# Roll and pitch (alike) and yaw of the previous cloud, and of the current one by variant.
PREVIOUS_DEG = (23.5, 1.0)
CURRENT_DEG = {1: (24.5, 2.0), 2: (33.5, 11.0)}


def paper_pose(pitch_roll_deg: float, yaw_deg: float) -> np.ndarray:
    """pose_cam_from_target (4, 4) of an attitude with roll and pitch alike."""
    a, b = np.radians([pitch_roll_deg, yaw_deg])
    turn = [rotation_from_vector(np.array(v)) for v in ([0, a, 0], [a, 0, 0], [0, 0, b])]
    return pose_matrix(turn[0] @ turn[1] @ turn[2], np.array([0.0, 0.0, DISTANCE_M]))
