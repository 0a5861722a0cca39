"""A frame in the size that the search works on, and what empty space looks like in it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from horizon_sensor_ros.core.cameras.mask import Mask

# The search works on an image of about this many pixels on its longer side: the limb is a large
# thing, and the cost of the search stays nearly the same for any sensor.
WORKING_SIZE_PX = 320


@dataclass(frozen=True, eq=False)
class WorkingImage:
    """A frame, `factor` times smaller.

    gray : (h, w) float32 means of blocks, where masked at the level of space; or single pixels of
    the frame's type where the limb is followed. space_level, noise : gray level of empty space and
    its one sigma of noise, as the search measured them.
    """

    gray: np.ndarray
    factor: int
    space_level: float
    noise: float

    @classmethod
    def of(cls, gray: np.ndarray, mask: Mask | None = None) -> WorkingImage:
        """Reduce a frame (H, W) uint8 or uint16, and measure its space."""
        return cls._measured(*reduce_image(gray), mask)

    def coarser(self, times: int, mask: Mask | None) -> WorkingImage:
        """The frame, smaller by another factor. mask : of the full frame."""
        return self._measured(block_average(self.gray, times), times * self.factor, mask)

    @classmethod
    def _measured(cls, small: np.ndarray, factor: int, mask: Mask | None) -> WorkingImage:
        usable = None if mask is None else mask.reduced(factor)
        level, noise = space_level_and_noise(small, usable)
        if usable is not None:
            # No edge of the craft's is left to be found, and nothing of it counts as bright.
            small = np.where(usable, small, np.float32(level))
        return cls(small, factor, level, noise)

    def sampled(self, gray: np.ndarray) -> WorkingImage:
        """Working image of a later frame (H, W) of the camera: single pixels of it, which cost less
        than means, and space as it was.
        """
        step = self.factor
        height, width = gray.shape[0] // step, gray.shape[1] // step
        every = gray[step // 2 :: step, step // 2 :: step][:height, :width]
        return replace(self, gray=every)


def reduce_image(gray: np.ndarray) -> tuple[np.ndarray, int]:
    """Block-average an image (H, W) to the working size: (h, w) float32, and by which factor."""
    factor = max(1, int(np.ceil(max(gray.shape) / WORKING_SIZE_PX - 0.25)))
    return block_average(gray, factor), factor


def block_average(gray: np.ndarray, factor: int) -> np.ndarray:
    """Mean (H // factor, W // factor), float32, of blocks of pixels of an image (H, W); what does
    not fill a block is cut off.

    Not rounded: rounded means would make 8-bit images another search than the same in 16 bits.
    """
    height, width = (size // factor * factor for size in gray.shape)
    gray = gray[:height, :width]
    # Whole rows are added up first: a fraction of the time of OpenCV's area resampling. Single
    # precision holds all sums of blocks up to 16 pixels wide, in whatever order.
    sums = gray[::factor].astype(np.float32)
    for row in range(1, factor if sums.size else 1):
        cv2.accumulate(gray[row::factor], sums)
    means = sums.reshape(-1, factor) @ np.ones(factor, dtype=np.float32)
    means *= np.float32(1.0 / factor**2)
    return np.asarray(means.reshape(height // factor, width // factor))


def space_level_and_noise(
    small: np.ndarray, usable: np.ndarray | None = None
) -> tuple[float, float]:
    """Gray level of empty space and its noise: median and spread of the darkest of 256 tiles of an
    image (h, w).

    Darkest by its brighter part: the median of a tile that is just over half space is as dark.
    usable : mask like `small`; tiles that are not usable throughout count only if all are like
    that.
    """
    # A strip is lower than a tile.
    tile_h, tile_w = (min(max(4, size // 16), size) for size in small.shape)
    rows, cols = small.shape[0] // tile_h, small.shape[1] // tile_w
    tiles = small[: rows * tile_h, : cols * tile_w].reshape(rows, tile_h, cols, tile_w)
    tiles = tiles.transpose(0, 2, 1, 3).reshape(rows * cols, -1)[:, ::2]
    count = tiles.shape[1]
    low, middle, bright = (int(share * count) for share in (0.16, 0.5, 0.84))
    high = np.partition(tiles, bright, axis=1)[:, bright]
    if usable is not None:
        blocks = usable[: rows * tile_h, : cols * tile_w].reshape(rows, tile_h, cols, tile_w)
        whole = blocks.all(axis=(1, 3)).ravel()
        high = np.where(whole | ~whole.any(), high, np.inf)
    darkest = np.sort(tiles[int(np.argmin(high))])
    # A saturated or quantised frame may show no noise at all; a third of a gray level is what
    # rounding alone adds.
    return float(darkest[middle]), max(float(darkest[bright] - darkest[low]) / 2.0, 0.3)
