"""Ends of faces that something nearer may hide, of which but a part is seen."""

from __future__ import annotations

import numpy as np

from horizon_sensor_ros.core.target_motion.ranges.range_image import RangeImage
from horizon_sensor_ros.core.target_motion.surfaces.body_limb import limb_reach_px
from horizon_sensor_ros.core.target_motion.surfaces.edges.places import WAYS
from horizon_sensor_ros.core.target_motion.surfaces.planes import Planes

# Reaches of `limb_reach_px`, so far a surface may go on unseen.
_FARTHER_OUT, _BESIDE = 5, 2
# Of a return before a face: times noise, and pixels' widths.
_NEARER, _NEARER_PX = 4.0, 2.0


def may_be_hidden(
    image: RangeImage, planes: Planes, pixel: np.ndarray, way: np.ndarray, *, fading: bool
) -> np.ndarray:
    """Which ends of faces (N,) something nearer may hide that is seen beyond a gap: it may go on in
    the gap, unseen.

    pixel, way : (N,) flat indices at the ends, and which of `WAYS` leads outwards. fading : whether
    the sensor is known to lose surfaces: gaps may be wide then.
    """
    inverse = image.inverse_depth.ravel()
    level, noise = planes.level.ravel()[pixel], planes.noise.ravel()[pixel]
    du, dv = WAYS[way].T
    step = du + dv * image.inverse_depth.shape[1]
    slopes = du * planes.slope_u.ravel()[pixel] + dv * planes.slope_v.ravel()[pixel]
    nearer = level * np.float32(1 + _NEARER_PX / image.focal_px) + _NEARER * noise
    hidden = np.zeros(len(pixel), bool)
    gap = np.flatnonzero(inverse[pixel + step] == 0)
    farthest = (_FARTHER_OUT if fading else _BESIDE) * limb_reach_px(planes.radius_px)
    for away in range(2, farthest + 1):
        at = np.clip(pixel[gap] + away * step[gap], 0, len(inverse) - 1)
        seen = inverse[at] > 0
        hidden[gap] = seen & (inverse[at] > nearer[gap] + away * slopes[gap])
        gap = gap[~seen]
    return hidden
