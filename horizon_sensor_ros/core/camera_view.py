"""A camera in its place on the craft."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from horizon_sensor_ros.core.attitude import require_rotation
from horizon_sensor_ros.core.camera import Camera
from horizon_sensor_ros.core.mask import Mask


@dataclass(frozen=True, eq=False)
class CameraView:
    """A camera in its place: name, camera, and the rotation that takes optical-frame vectors to the
    base frame.

    mask : what of its image may be used; None: all.
    Raises ValueError when rot_base_from_cam is not a rotation matrix (orthonormal to 1e-6,
    determinant +1), or the mask has another size than the camera.
    """

    name: str
    camera: Camera
    rot_base_from_cam: np.ndarray
    mask: Mask | None = None

    def __post_init__(self) -> None:
        rot = require_rotation(self.rot_base_from_cam, f"rot_base_from_cam of {self.name!r}")
        rot.setflags(write=False)
        object.__setattr__(self, "rot_base_from_cam", rot)
        if self.mask is not None and self.mask.shape != (self.camera.height, self.camera.width):
            height, width = self.mask.shape
            raise ValueError(
                f"mask of {self.name!r} is {width} x {height}, "
                f"the camera {self.camera.width} x {self.camera.height}"
            )
