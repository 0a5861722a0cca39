"""Edges of a strip before black sky that bend no more than a limb: a boom, an arm, a panel's rim.

Behind a limb the planet goes on, to the frame's end, or towards its terminator. There light falls
over a good part of what is lit: from half to a twentieth over 0.3 of it even where it falls with
the root of the Sun's height. A strip ends as sharply as it begins, along most of its edge. Asked of
what is at least four times as long as it is broad: a whole disc is three times as long. Derived
here.
"""

from __future__ import annotations

import cv2
import numpy as np

from horizon_sensor_ros.core.cameras.mask import Mask
from horizon_sensor_ros.core.limb.search.working_image import WorkingImage
from horizon_sensor_ros.core.limb_points import LimbPoints

_PROFILES = 60  # across an edge, at most
_FIRST_PX = 3  # inwards of the edge, where its own blur has ended
_LEAST_BREADTH_PX = 16  # of narrower strips blur alone ends so; `SkyEvidence.dark_ground` sees them
_MOST_BREADTH = 0.25  # of the edge's length
_SMOOTH_PX = 3  # by which the frame is averaged, and the end is the wider
_SHARP = 0.2  # of the breadth, within which a strip ends
_BEYOND_PX = 8  # that are black behind it
_HALF, _BLACK = 0.5, 0.05  # of its brightness
_NOISE = 4.0  # sigmas; as black as space
_LEAST_CONTRAST = 40.0  # sigmas; half of it and a twentieth are then told apart
_MOST_STRIP = 0.8  # of the edge behind which light ends, share that may end sharply
_LEAST_SEEN = 0.5  # of the edge: behind so much of it light ends within the frame


def strip(limb: LimbPoints, gray: np.ndarray, working: WorkingImage, mask: Mask | None) -> str:
    """Why a limb may be the edge of a strip; empty where nothing says so.

    gray : (H, W) the frame; working : as the search has it. What is masked is not seen.
    """
    breadth_px = int(_MOST_BREADTH * limb.spacing_px * len(limb.px))
    if breadth_px < _LEAST_BREADTH_PX:
        return ""
    every = -(-len(limb.px) // _PROFILES)
    depth = np.arange(_FIRST_PX, breadth_px + _BEYOND_PX)
    px = limb.px[::every, None] - depth[:, None] * limb.normal_px[::every, None]
    x, y = np.moveaxis(np.rint(px).astype(np.intp), -1, 0)
    height, width = gray.shape
    seen = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    x, y = np.where(seen, x, 0), np.where(seen, y, 0)
    if mask is not None:
        seen &= mask.use[y, x]
    seen = np.logical_and.accumulate(seen, axis=1)
    space, noise = np.float32(working.space_level), working.noise * working.factor
    # Mostly there is ground as far as is looked: that is told by single pixels.
    _, black = _bright_and_black(gray[y, x] - space, seen, noise)
    if np.count_nonzero(black.any(axis=1)) < _LEAST_SEEN * len(black):
        return ""
    smooth = cv2.blur(gray, (_SMOOTH_PX, _SMOOTH_PX))
    sharp, ends = _ends(smooth[y, x] - space, seen, noise / _SMOOTH_PX)
    places = int(np.count_nonzero(ends))
    share = int(np.count_nonzero(sharp)) / max(places, 1)
    if places < _LEAST_SEEN * len(ends) or share < _MOST_STRIP:
        return ""
    return f"a part of the craft: behind {share:.0%} of its edge it ends as sharply, before black"


def _bright_and_black(
    level: np.ndarray, seen: np.ndarray, noise: float
) -> tuple[np.ndarray, np.ndarray]:
    """Brightness (N,) behind an edge, and where it is seen to be as black as space (N, J)."""
    bright = np.median(level[:, :_LEAST_BREADTH_PX], axis=1)
    return bright, seen & (level < np.maximum(_BLACK * bright, _NOISE * noise)[:, None])


def _ends(level: np.ndarray, seen: np.ndarray, noise: float) -> tuple[np.ndarray, np.ndarray]:
    """Behind which places (N,) of an edge light ends sharply, and behind which at all.

    level : (N, J) above space, inwards; seen : (N, J) where that is known.
    """
    bright, black = _bright_and_black(level, seen, noise)
    ends = black.any(axis=1) & seen[:, _LEAST_BREADTH_PX]
    first = black.argmax(axis=1)
    place = np.arange(level.shape[1])
    lit = (level > _HALF * bright[:, None]) & (place < first[:, None])
    last = np.where(lit, place, -1).max(axis=1)
    after = (place >= first[:, None]) & (place < first[:, None] + _BEYOND_PX)
    stays = (black & after).sum(axis=1) == _BEYOND_PX
    breadth = first + _FIRST_PX
    sharp = first - last <= _SHARP * breadth + 0.5 * (_SMOOTH_PX - 1)
    sharp &= stays & (last >= 0) & (breadth >= _LEAST_BREADTH_PX)
    return ends & sharp & (bright > _LEAST_CONTRAST * noise), ends
