"""Which part of a camera's image may be used: what is not the craft itself."""

from __future__ import annotations

from functools import cached_property

import cv2
import numpy as np


class Mask:
    """A camera's mask, made once, with what the search asks of it.

    use : (H, W), nonzero where the image may be used, 0 where the craft is.
    Raises ValueError for what is not (H, W), or leaves nothing to use.
    """

    def __init__(self, use: np.ndarray) -> None:
        use = np.asarray(use)
        if use.ndim != 2 or use.size == 0:
            raise ValueError(f"use must be (H, W), got shape {use.shape}")
        self.use = use != 0
        if not self.use.any():
            raise ValueError("a mask without a usable pixel leaves nothing to look at")
        self.use.setflags(write=False)
        self._reduced: dict[int, np.ndarray] = {}

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width, pixels."""
        return self.use.shape[0], self.use.shape[1]

    @cached_property
    def clearance_px(self) -> np.ndarray:
        """(H, W) float32: distance of each pixel from the nearest masked one, 0 on the mask."""
        if self.use.all():
            return np.full(self.shape, np.inf, dtype=np.float32)
        return cv2.distanceTransform(self.use.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)

    def clear(self, px: np.ndarray, distance_px: float) -> np.ndarray:
        """Whether points (..., 2), raw pixels, keep a distance from the masked part.

        What lies outside the image is judged by the nearest pixel of the image; a point that is NaN
        keeps none.
        """
        height, width = self.shape
        known = ~np.isnan(px).any(axis=-1)
        px = np.where(known[..., None], px, 0)
        x = np.clip(np.rint(px[..., 0]), 0, width - 1).astype(np.intp)
        y = np.clip(np.rint(px[..., 1]), 0, height - 1).astype(np.intp)
        return known & (self.clearance_px[y, x] > distance_px)

    def reduced(self, factor: int) -> np.ndarray:
        """(h, w) bool, for an image averaged over blocks: True where all of a block is usable."""
        if factor not in self._reduced:
            height, width = self.shape[0] // factor, self.shape[1] // factor
            blocks = self.use[: height * factor, : width * factor]
            blocks = blocks.reshape(height, factor, width, factor).all(axis=(1, 3))
            blocks.setflags(write=False)
            self._reduced[factor] = blocks
        return self._reduced[factor]
