"""How a camera turns while a frame is exposed."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from horizon_sensor_ros.core.camera import Camera
from horizon_sensor_ros.core.rigid import rotation_from_vector

FloatArray = NDArray[np.float64]

# Moments to a pixel of motion in the middle of the frame. Pixels are about as wide as the steps
# between moments, which leaves nothing of these.
_MOMENTS = 1.5


def attitudes_during(
    rot_world_from_cam: FloatArray, turn_cam_rad: FloatArray, camera: Camera
) -> list[FloatArray]:
    """Attitudes (3, 3) at moments spread evenly over an exposure, about that in its middle.

    turn_cam_rad : (3,) by which the camera turns meanwhile, in its own frame.
    """
    x, y = camera.width / 2.0, camera.height / 2.0
    here, beside = camera.rays(np.array([[x, y], [x + 1.0, y]]))
    angle = float(np.linalg.norm(turn_cam_rad))
    num = 1 + math.ceil(_MOMENTS * angle / float(np.linalg.norm(beside - here)))
    times = (np.arange(num) + 0.5) / num - 0.5
    return [rot_world_from_cam @ rotation_from_vector(time * turn_cam_rad) for time in times]
