"""How a camera turns while a frame is exposed, and while it is read out."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.mathematics.rigid import rotation_from_vector

# Moments to a pixel of motion in the middle of the frame. Pixels are about as wide as the steps
# between moments, which leaves nothing of these.
_MOMENTS = 1.5
# Rows that are drawn at one attitude while a frame is read out, and rows around them that are drawn
# as well, and thrown away: the limb is found by the neighbours of a pixel.
_ROWS_AT_ONCE, ROWS_AROUND = 4, 2


def attitudes_during(
    rot_world_from_cam: np.ndarray, turn_cam_rad: np.ndarray, camera: Camera
) -> list[np.ndarray]:
    """Attitudes (3, 3) at moments spread evenly over an exposure, about that in its middle.

    turn_cam_rad : (3,) by which the camera turns meanwhile, in its own frame.
    """
    x, y = camera.width / 2.0, camera.height / 2.0
    here, beside = camera.rays(np.array([[x, y], [x + 1.0, y]]))
    angle = float(np.linalg.norm(turn_cam_rad))
    num = 1 + math.ceil(_MOMENTS * angle / float(np.linalg.norm(beside - here)))
    times = (np.arange(num) + 0.5) / num - 0.5
    return [rot_world_from_cam @ rotation_from_vector(time * turn_cam_rad) for time in times]


def strips_read_out(
    rot_world_from_cam: np.ndarray, turn_cam_rad: np.ndarray, camera: Camera
) -> Iterator[tuple[slice, Camera, np.ndarray]]:
    """Rows of a frame that is read out row by row: which they are, a camera of them and of
    `ROWS_AROUND` on either side, and its attitude (3, 3) when they are read.

    turn_cam_rad : (3,) by which the camera turns from the first row to the last, in its own frame;
    the attitude is that at the first one.
    """
    for top in range(0, camera.height, _ROWS_AT_ONCE):
        rows = slice(top, min(top + _ROWS_AT_ONCE, camera.height))
        height = rows.stop - top + 2 * ROWS_AROUND
        strip = replace(camera, height=height, cy=camera.cy - (top - ROWS_AROUND))
        share = 0.5 * (top + rows.stop - 1) / max(camera.height - 1, 1)
        yield rows, strip, rot_world_from_cam @ rotation_from_vector(share * turn_cam_rad)
