"""How much more a lens blurs in the corners of its frames than in the middle, by all the limbs that
it showed.

One limb tells it badly: clouds beside it make edges wider here and sharper there
(`limb.edge.lens_blur`). But clouds pass by, and the lens stays. Blur is taken to grow as the square
of the distance to the axis: what is found is right where limbs were seen, and need not be quite
what a slanted edge shows in the very corner.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from horizon_sensor_ros.core.limb_points import CornerBlur
from horizon_sensor_ros.core.mathematics.robust import median, robust_sigma
from horizon_sensor_ros.core.self_calibration.measurement import FrameSet

# One sigma of what all limbs show alike too much or too little, over that: of simulated lenses of
# .6 and .8 px they showed 1.05 of it beside faint clouds, .7 to 1 beside those of full contrast.
_MISJUDGED = 0.15
_SIGMA_PX = 0.01  # in common to all limbs, however even their lens
_LEAST = 8  # limbs beside other clouds
_KNOWN_PX = 0.06  # one sigma of what is well enough known to be told
_AT_ONCE_S = 1e-3  # stamps are rounded
_OF_MEDIAN = 1.25  # its sigma over that of the mean, of a normal law


@dataclass(frozen=True)
class LensBlur:
    """What a recording tells of one lens, as of `CameraView.corner_blur_px`.

    blur_px, sigma_px : NaN where that is nothing. limbs : beside other clouds each, that showed it.
    """

    camera: str
    blur_px: float
    sigma_px: float
    limbs: int

    @property
    def observed(self) -> bool:
        """Whether it is known well enough to be told."""
        return self.sigma_px <= _KNOWN_PX

    @property
    def why_not(self) -> str:
        """What stands against it, in words."""
        if self.limbs < _LEAST:
            return (
                f"{self.limbs} limbs beside different clouds show it, {_LEAST} are needed; soft "
                "and smeared ones, and those below glowing or thin air, do not"
            )
        return f"it comes out as {self.blur_px:.2f} +- {self.sigma_px:.2f} px"


def lens_blurs(
    sets: Sequence[FrameSet], cameras: Sequence[str], correlation_s: float
) -> tuple[LensBlur, ...]:
    """What frame sets tell of each camera's lens: the median of limbs, of which those less than a
    time apart are beside the same clouds, and have one say.
    """
    return tuple(_of_lens(camera, sets, correlation_s) for camera in cameras)


def _of_lens(camera: str, sets: Sequence[FrameSet], correlation_s: float) -> LensBlur:
    seen = [
        (frames.time_s, horizon.corner_blur)
        for frames in sorted(sets, key=lambda each: each.time_s)
        for horizon in frames.horizons
        if horizon.camera == camera and horizon.corner_blur is not None
    ]
    apart = np.array(list(_one_after_the_other(seen, correlation_s))).reshape(-1, 2)
    limbs = len(apart)
    if limbs < _LEAST:
        return LensBlur(camera, np.nan, np.nan, limbs)
    blur, claimed = apart.T
    middle = median(blur)
    spread = max(robust_sigma(blur - middle), median(claimed))
    by_chance = _OF_MEDIAN * spread / math.sqrt(limbs)
    sigma = math.hypot(by_chance, _MISJUDGED * middle, _SIGMA_PX)
    return LensBlur(camera, middle, sigma, limbs)


def _one_after_the_other(
    seen: Sequence[tuple[float, CornerBlur]], apart_s: float
) -> Iterator[tuple[float, float]]:
    """Means of limbs that are seen within a time, beside the same clouds, and of their sigmas."""
    start = 0
    for end in range(1, len(seen) + 1):
        if end == len(seen) or seen[end][0] - seen[start][0] >= apart_s - _AT_ONCE_S:
            together = np.array([blur for _, blur in seen[start:end]])
            blur, sigma = together.mean(axis=0).tolist()
            yield blur, sigma
            start = end
