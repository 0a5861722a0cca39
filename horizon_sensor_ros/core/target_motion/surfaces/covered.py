"""How far the middle of what a pixel shows may lie off the pixel's own."""

from __future__ import annotations

import cv2
import numpy as np

from horizon_sensor_ros.core.target_motion.ranges.range_image import RangeImage
from horizon_sensor_ros.core.target_motion.surfaces.holes import without_holes

# A surface that ends anywhere in its last pixel covers a share c of it, and the pixel returns the
# range of that share's middle, (1 - c) / 2 pixels farther in. Where at least half of a pixel must
# be covered that is so much in the mean square, (1 - 1/2)^3 / 12.
_COVERED_PX = 96**-0.5


def off_middle_px(image: RangeImage) -> np.ndarray:
    """(H W) float32 standard deviation, in pixels, of where in its pixel a return lies: 0 within a
    surface, and where the pixels are not the sensor's own.
    """
    off = np.zeros(image.inverse_depth.shape, np.float32)
    if image.on_grid:
        seen = (without_holes(image.inverse_depth) > 0).view(np.uint8)
        off[cv2.erode(seen, np.ones((3, 3), np.uint8)) == 0] = _COVERED_PX
    return off.ravel()
