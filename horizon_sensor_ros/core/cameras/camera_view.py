"""A camera in its place on the craft."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.cameras.mask import Mask
from horizon_sensor_ros.core.mathematics.attitude import require_rotation
from horizon_sensor_ros.core.motion.turn_rate import TurnRate


@dataclass(frozen=True, eq=False)
class CameraView:
    """A camera in its place: name, camera, and the rotation that takes optical-frame vectors to the
    base frame.

    mask : what of its image may be used; None: all. readout_s : from the first row of an image to
    the last, below zero where the last one is read first; the image's time is that of the row that
    is read first; 0: all at once. exposure_s : of each of its pixels, about that time; 0: not
    known. after_s : time of its image after that of the set. rate : at which the craft turns while
    that is taken; None: it does not matter. corner_blur_px : one sigma of an edge's blur in the
    corners of its images, less that in the middle; None: not known.
    Raises ValueError when rot_base_from_cam is not a rotation matrix (orthonormal to 1e-6,
    determinant +1), the mask has another size than the camera, the readout, after_s or
    corner_blur_px is not finite, or the exposure is negative or not finite.
    """

    name: str
    camera: Camera
    rot_base_from_cam: np.ndarray
    mask: Mask | None = None
    readout_s: float = 0.0
    exposure_s: float = 0.0
    after_s: float = 0.0
    rate: TurnRate | None = None
    corner_blur_px: float | None = None

    def __post_init__(self) -> None:
        rot = require_rotation(self.rot_base_from_cam, f"rot_base_from_cam of {self.name!r}")
        rot.setflags(write=False)
        object.__setattr__(self, "rot_base_from_cam", rot)
        for field, got in (
            ("readout_s", self.readout_s),
            ("after_s", self.after_s),
            ("corner_blur_px", self.corner_blur_px),
        ):
            if got is not None and not math.isfinite(got):
                raise ValueError(f"{field} of {self.name!r} must be finite, got {got}")
        if not 0.0 <= self.exposure_s < math.inf:
            raise ValueError(
                f"exposure_s of {self.name!r} must be 0 or positive, got {self.exposure_s}"
            )
        if self.mask is not None and self.mask.shape != (self.camera.height, self.camera.width):
            height, width = self.mask.shape
            raise ValueError(
                f"mask of {self.name!r} is {width} x {height}, "
                f"the camera {self.camera.width} x {self.camera.height}"
            )
