"""What returns that were cropped tell of the target: where it may go on, or ends amid a pixel.

An arm that is nearer hides what is behind it, and where the box cuts the target its surface goes on
in what was cropped. No end of it may be concluded from a missing return there. What lies farther
behind leaves the target's outline what it is; but where pixels mix both, and those are cropped, it
is drawn in by what the target covers of them.
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
_OFF_PX = 2.0  # nearer than the target beside it, pixels' widths, is before it; farther, behind
# A return between the target and what is behind is nearer than the next by this share, and by so
# many times what that one and the third differ by, as a wall at a slant may.
_BETWEEN, _STEPS = 0.02, 3.0
_BESIDE_PX = 1.5


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
    missing = inverse == 0
    apart_px, beside = (each.ravel()[index] for each in nearest(~missing))
    target_m = 1.0 / inverse.ravel()[beside].astype(float)
    behind_px = (depth_m - target_m) * image.focal_px / target_m
    cut = (apart_px <= _BEYOND_PX) & (behind_px <= _STEEP * apart_px)
    hides = index[cut | (behind_px < -_OFF_PX)]
    unknown = image.unknown.copy()
    unknown.ravel()[hides] = True
    behind = behind_px > _OFF_PX
    inverse_behind = np.zeros(inverse.size)
    inverse_behind[index[behind]] = 1.0 / depth_m[behind]
    behind &= apart_px < _BESIDE_PX
    at = index[behind]
    mixed = image.mixed.copy()
    mixed.ravel()[at[_lies_between(inverse_behind, at, at - beside[behind])]] = True
    return replace(image, unknown=unknown & missing, mixed=mixed & missing)


def _lies_between(inverse_behind: np.ndarray, at: np.ndarray, outwards: np.ndarray) -> np.ndarray:
    """Which of the returns behind the target in flat pixels (N,) are nearer than what goes on
    behind it, as those are that mix both.

    inverse_behind : (H * W,) of all that is behind, 0 where nothing is.  outwards : (N,) steps.
    """
    own, second, third = (inverse_behind.take(at + n * outwards, mode="clip") for n in range(3))
    between = own - second > _BETWEEN * own + _STEPS * np.abs(second - third)
    return np.asarray(between & (second > 0))
