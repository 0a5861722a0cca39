"""Clouds that the sensor's driver has averaged over time: each holds some of those before it, and
shows the target where it is no more.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import cv2
import numpy as np

from horizon_sensor_ros.core.mathematics.rigid import inverse_pose
from horizon_sensor_ros.core.mathematics.robust import NORMAL_MEDIAN
from horizon_sensor_ros.core.target_motion.noise.mixed_differences import mixed_differences
from horizon_sensor_ros.core.target_motion.ranges.range_image import RangeImage

# Mixed differences count up to so many standard deviations, hardly more than by their sign: noise
# is alike everywhere, relief in few pixels and strongly.
_MOST = 0.7
# Variance of a sum of products of such differences, over that of as many independent ones: nine
# pixels share returns.
_SHARED = 3.78
# Drivers do not average what differs by more than a few times the noise: pixels count whose mean
# range has changed by less, in standard deviations of one return. And what they show of the target
# has moved by so many pixels: its own relief then is another.
_CHANGED, _MOVED_PX = 2.5, 1.0
_FEWEST = 40  # such pixels
# Two clouds lie on one grid where their pixels lie within so much of each other.
_OFF_PX = 0.25
# Noise is alike where its correlation is beyond so many standard deviations, and so large: of less
# a cloud holds less than a fifth of those before it.
_SURE, _LEAST = 5.0, 0.2
# What is so much alike in the oldest cloud as well is the pattern of the sensor's pixels.
_FIXED = 0.75
# What each cloud tells counts for so much of what the next one does; and clouds that are kept.
_LASTS, _KEPT = 0.9, 8


@dataclass(frozen=True, eq=False)
class _Noise:
    """Mixed differences (H, W) of a cloud, m, 0 without; mean depths (H, W) of the nine returns, 0
    where one is missing; standard deviation of one; and the target's pose.
    """

    image: RangeImage
    bend_m: np.ndarray
    depth_m: np.ndarray
    sigma_m: float
    pose: np.ndarray


@dataclass
class _Sum:
    """Weighted sums over clouds: of products, less those that relief would make alike; of their
    variance, and of what they would be if the two were the same.
    """

    product: float = 0.0
    variance: float = 0.0
    whole: float = 0.0

    def add(
        self, a: np.ndarray, b: np.ndarray, whole: float, relief: np.ndarray | float = 0.0
    ) -> None:
        """Add what two clouds have in common, pixel by pixel.

        a, b : (N,) deviations of either. whole : what the sum of a * b would be if both had the
        same. relief : (N,) those of the second where the target's own relief would make them as
        like a as they are in b, twice as far on its way (`TemporalFilter._hold`); 0: not asked.
        """
        product, of_relief = a * b, a * relief
        self.product = _LASTS * self.product + float(product.sum() - of_relief.sum())
        squares = float(product @ product + of_relief @ of_relief)
        self.variance = _LASTS**2 * self.variance + _SHARED * squares
        self.whole = _LASTS * self.whole + whole

    @property
    def sure(self) -> bool:
        return self.product > _SURE * np.sqrt(self.variance)

    @property
    def share(self) -> float:
        return self.product / self.whole if self.whole else 0.0


@dataclass
class TemporalFilter:
    """What successive clouds tell of a filter over time in the driver: feed them in order.

    Exposures have independent noise. A cloud that holds a part of the one before has that part of
    its noise, in the same pixels, whatever has moved there. So has one by a sensor whose pixels
    are off by some pattern that stays, but that is in all of its clouds alike, whereas what a
    filter holds of a cloud fades.
    """

    _clouds: deque[_Noise] = field(default_factory=lambda: deque(maxlen=_KEPT))
    _last: _Sum = field(default_factory=_Sum)
    _faded: _Sum = field(default_factory=_Sum)

    def start(self, image: RangeImage, sigma_m: float, pose: np.ndarray) -> None:
        """Take the first cloud of a target frame, as of `told`: those before it do not tell how far
        the target has moved. What they told of the driver still holds.
        """
        self._clouds.clear()
        self._clouds.append(_noise_of(image, sigma_m, pose))

    def told(self, image: RangeImage, sigma_m: float, pose: np.ndarray) -> bool:
        """Take a cloud, the noise of its single returns, and the target's pose (4, 4) in the
        sensor's frame; whether it and those before it hold parts of each other.

        By the second cloud alone a pattern of the pixels may be taken for it.
        """
        now = _noise_of(image, sigma_m, pose)
        if self._clouds:
            self._hold(now, self._clouds[-1])
        self._clouds.append(now)
        if not (self._last.sure and self._last.share > _LEAST):
            return False
        return (
            self._faded.sure
            or self._faded.share >= (1 - _FIXED) * self._last.share
            or (not self._faded.whole)
        )

    def _hold(self, now: _Noise, before: _Noise) -> None:
        """Hold a cloud against the one before, and against the oldest that shows the same.

        What relief is alike by in one pixel, from which it has moved, it is alike by as well twice
        as far on the way that it has moved; noise is not. Where nothing is seen there, none counts.
        """
        place = np.nonzero(now.depth_m)
        bend, depth_m = _there(before, now.image, place)
        same = np.abs(depth_m - now.depth_m[place]) < _CHANGED * max(now.sigma_m, before.sigma_m)
        moved_px = _moved_px(now, before, place)
        on = np.rint(2.0 * moved_px).astype(np.int64)
        relief, _ = _there(before, now.image, (place[0] + on[1], place[1] + on[0]))
        same &= (depth_m > 0) & (np.hypot(*moved_px) > _MOVED_PX)
        if np.count_nonzero(same) < _FEWEST:
            return
        place = place[0][same], place[1][same]
        here, bend, relief = map(_clipped, (now.bend_m[place], bend[same], relief[same]))
        whole = float(np.sqrt((here @ here) * (bend @ bend)))
        self._last.add(here, bend, whole, relief)
        for older in list(self._clouds)[:-1]:
            oldest, depth_m = _there(older, now.image, place)
            seen = depth_m > 0
            if np.count_nonzero(seen) >= _FEWEST:
                here, bend, oldest = here[seen], bend[seen], _clipped(oldest[seen])
                whole = float(np.sqrt((here @ here) * (bend @ bend)))
                self._faded.add(here, bend - oldest, whole)
                return


def _noise_of(image: RangeImage, sigma_m: float, pose: np.ndarray) -> _Noise:
    """Of an image, the noise of its single returns, and the target's pose; nothing where its pixels
    are not the sensor's own.
    """
    inverse = image.inverse_depth
    bend_m, depth_m = np.zeros((2, *inverse.shape), np.float32)
    if image.on_grid:
        whole = cv2.erode((inverse > 0).view(np.uint8), np.ones((3, 3), np.uint8))
        place = np.flatnonzero(whole)
        bend_m.ravel()[place] = mixed_differences(inverse, place)
        # The mean of the nine returns tells nothing of their mixed differences.
        depth = cv2.boxFilter(1 / np.where(inverse > 0, inverse, np.float32(1)), -1, (3, 3))
        depth_m.ravel()[place] = depth.ravel()[place]
    return _Noise(image, bend_m, depth_m, sigma_m, pose)


def _there(
    cloud: _Noise, image: RangeImage, place: tuple[np.ndarray, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """What a cloud has in the same pixels of the sensor as the ``place`` (rows, columns) of another
    image: mixed differences (N,), and depths (N,), 0 where it has none.
    """
    own = cloud.image
    aside = (image.origin - own.origin) * own.focal_px
    whole = np.rint(aside).astype(np.int64)
    height, width = own.inverse_depth.shape
    stretch = abs(own.focal_px / image.focal_px - 1) * max(image.inverse_depth.shape)
    off_px = np.abs(aside - whole).max() + stretch
    apart = own.rot_sensor_from_view.T @ image.rot_sensor_from_view - np.eye(3)
    turned = np.abs(apart).max() * image.focal_px > _OFF_PX
    row, column = place[0] + whole[1], place[1] + whole[0]
    inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
    if turned or off_px > _OFF_PX:
        inside[:] = False
    row, column = np.where(inside, row, 0), np.where(inside, column, 0)
    return cloud.bend_m[row, column], np.where(inside, cloud.depth_m[row, column], 0.0)


def _moved_px(now: _Noise, before: _Noise, place: tuple[np.ndarray, ...]) -> np.ndarray:
    """(2, N) how many columns and rows aside what a cloud shows was in another one."""
    image = now.image
    tan_u, tan_v = image.tangents()
    seen = np.stack([tan_u[place[1]], tan_v[place[0]], np.ones(len(place[0]))])
    back = before.pose @ inverse_pose(now.pose)
    turn = image.rot_sensor_from_view.T @ back[:3, :3] @ image.rot_sensor_from_view
    moved_m = back[:3, 3] + (back[:3, :3] @ image.sensor_m - image.sensor_m)
    shift = image.rot_sensor_from_view.T @ moved_m
    then = turn @ (seen * now.depth_m[place]) + shift[:, None]
    return np.asarray(image.focal_px * (then[:2] / then[2] - seen[:2]))


def _clipped(bend_m: np.ndarray) -> np.ndarray:
    """In standard deviations, by the median."""
    sigma = float(np.median(np.abs(bend_m))) / NORMAL_MEDIAN
    return np.clip(bend_m / sigma, -_MOST, _MOST) if sigma > 0 else np.zeros(len(bend_m))
