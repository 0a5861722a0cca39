"""A camera's frame in the size in which its limb shows best."""

from __future__ import annotations

import math

import cv2
import numpy as np

from horizon_sensor_ros.core.limb.edge.looks import USUAL_PSF_PX
from horizon_sensor_ros.core.limb.edge.width import Smear
from horizon_sensor_ros.core.limb.search.working_image import block_average
from horizon_sensor_ros.core.limb_points import LimbPoints

# A frame comes back to its full size in steps of so much, for as long as neighbouring edges, in
# pixels of the full frame, do not differ by so many times as much: a limb that is soft for those
# shows itself better in larger ones.
_FINER, _MORE_JUMPS = 3, 1.25
# Squares of the blur, and of what pixels are of it.
_USUAL_PSF2, _PIXEL2 = USUAL_PSF_PX**2, 1.0 / 12.0
_LEAST_BLUR2, _BLUR_REACH = 0.05, 3.5  # px^2, so that a blur has an inverse; its roots


class SizedFrame:
    """One image, and the size in which its limb shows best.

    factor : by which it is reduced for the next pass. coarsest : the largest to begin with; without
    one the size is decided. smear : that is made the same in all directions.
    """

    def __init__(
        self, gray: np.ndarray, factor: int, coarsest: int = 0, *, smear: Smear | None = None
    ) -> None:
        self.smear = smear
        self.factor = self._first = factor
        self._coarsest = coarsest
        self._rests = coarsest == 0
        self._coarser = factor, np.inf  # the last size, and how neighbouring edges differ in it
        self._reduced = {1: gray if smear is None else _evened(gray, factor, smear)}

    @property
    def blur_open_px(self) -> float:
        """One sigma of what the blur may differ by along the limb, in that size."""
        if self.smear is None:
            return 0.0
        return self.smear.open_px2 / self.factor**2 / (2.0 * USUAL_PSF_PX)

    def coarsen(self) -> bool:
        """Begin again in a coarser size; False where there is none."""
        if 2 * self._first > self._coarsest:
            return False
        self.factor = self._first = 2 * self._first
        self._coarser = self.factor, np.inf
        self._rests = False
        return True

    def image(self) -> np.ndarray:
        """Gray levels (h, w) in that size."""
        if self.factor not in self._reduced:
            self._reduced[self.factor] = block_average(self._reduced[1], self.factor)
        return self._reduced[self.factor]

    def resize(self, limb: LimbPoints) -> int:
        """Go on to a finer size, 1, or back to the last, -1, by the limb as seen in this; or stay,
        0.
        """
        factor, jumps_px = self._coarser
        if self._rests:
            return 0
        if limb.jumps_px > _MORE_JUMPS * jumps_px:
            self.factor, self._rests = factor, True
            return -1
        if self.factor == 1:
            self._rests = True
            return 0
        self._coarser = self.factor, limb.jumps_px
        self.factor = max(1, self.factor // _FINER)
        return 1


def _evened(gray: np.ndarray, factor: int, smear: Smear) -> np.ndarray:
    """A smeared frame, blurred alike in all directions, and as suits one reduced by so much."""
    sigma2 = max((_USUAL_PSF2 - _PIXEL2) * factor**2 - _USUAL_PSF2, 0.0)
    cov = smear.lacking_px2 + (sigma2 + _LEAST_BLUR2) * np.eye(2)
    reach = math.ceil(_BLUR_REACH * math.sqrt(np.trace(cov)))
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    at = np.stack([x, y], axis=2).astype(float)
    kernel = np.exp(-0.5 * np.einsum("yxi,ij,yxj->yx", at, np.linalg.inv(cov), at))
    return cv2.filter2D(
        gray.astype(np.float32), -1, kernel / kernel.sum(), borderType=cv2.BORDER_REPLICATE
    )
