"""Where returns that were cropped hide the target, or are of it: it may go on there.

An arm that is nearer hides what is behind it, and where the box cuts the target its surface goes on
in what was cropped. No end of it may be concluded from a missing return there; what lies farther
behind leaves the target's outline what it is.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.core.target_motion.ranges.nearest import nearest
from horizon_sensor_ros.core.target_motion.ranges.range_image import RangeImage

# A surface that is seen this steeply (tangent), or less, goes on from pixel to pixel; looked for so
# far beyond the cut.
_STEEP, _BEYOND_PX = 2.0, 3.0
_NEARER_PX = 2.0  # than the target beside it, pixels' widths, is before it


def with_cropped(image: RangeImage, cropped: np.ndarray) -> RangeImage:
    """The image of a cloud with what is unknown because of returns (N, 3) that were cropped from
    it, metres, in the cloud's frame; those that are not finite are none.
    """
    if image.status is not Status.OK or not len(cropped):
        return image
    with np.errstate(invalid="ignore"):  # signalling NaN, of garbled messages
        # Zeros are none, and of an organised cloud most points.
        returned = (cropped[:, 0] != 0) | (cropped[:, 1] != 0) | (cropped[:, 2] != 0)
        returned &= np.isfinite(cropped[:, 2])
    index, depth_m = image.project(cropped[returned])[1:]
    if not len(index):
        return image
    inverse = image.inverse_depth
    apart_px, beside = (each.ravel()[index] for each in nearest(inverse > 0))
    target_m = 1.0 / inverse.ravel()[beside].astype(float)
    behind_px = (depth_m - target_m) * image.focal_px / target_m
    cut = (apart_px <= _BEYOND_PX) & (behind_px <= _STEEP * apart_px)
    hides = index[cut | (behind_px < -_NEARER_PX)]
    unknown = image.unknown.copy()
    unknown.ravel()[hides] = True
    return replace(image, unknown=unknown & (inverse == 0))
