"""Frames of the Sun and no planet: its overexposed disc, halo, rays, a ring about it, a ghost."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

RING_SHARE = GHOST_SHARE = JPEG_SHARE = 0.3  # of the frames that have one
_BEYOND_PX = 60.0  # the Sun's middle may be so far outside the frame


@dataclass(frozen=True, eq=False)
class SunFrame:
    """image : (H, W) uint8. ring, ghost : whether there is one."""

    image: np.ndarray
    ring: bool
    ghost: bool


def sun_alone(width: int, height: int, rng: np.random.Generator) -> SunFrame:
    """Draw one frame.

    A halo of any size that falls off with the 1.8th to the fourth power of the distance, up to
    seven rays, ghosts of 5 to 60 DN mirrored about the middle, blur, noise and JPEG.
    """
    y, x = np.indices((height, width)).astype(float)
    sun = rng.uniform(-_BEYOND_PX, [width + _BEYOND_PX, height + _BEYOND_PX])
    off_px = np.hypot(x - sun[0], y - sun[1])
    peak_dn, core_px = 10.0 ** rng.uniform(2.5, 4.5), rng.uniform(2.0, 30.0)
    light = peak_dn / (1.0 + (off_px / core_px) ** rng.uniform(1.8, 4.0))
    light[off_px < rng.uniform(3.0, 8.0)] += 1500.0
    rays = int(rng.integers(0, 8))
    if rays:
        turn = np.arctan2(y - sun[1], x - sun[0]) - rng.uniform(0.0, 2.0 * np.pi)
        thin = np.abs(np.cos(0.5 * rays * turn)) ** rng.uniform(10.0, 80.0)
        light += peak_dn * rng.uniform(0.02, 0.3) * thin / (1.0 + off_px / (3.0 * core_px))
    ghost, ring = rng.uniform() < GHOST_SHARE, rng.uniform() < RING_SHARE
    if ghost:
        from_ghost_px = np.hypot(x - (width - sun[0]), y - (height - sun[1]))
        light += rng.uniform(5.0, 60.0) * (from_ghost_px < rng.uniform(10.0, 80.0))
    if ring:
        across = (off_px - rng.uniform(60.0, 200.0)) / rng.uniform(4.0, 15.0)
        light += rng.uniform(5.0, 40.0) * np.exp(-np.square(across))
    light = cv2.GaussianBlur(light, (0, 0), rng.uniform(0.5, 1.2))
    noise = rng.normal(rng.uniform(1.0, 8.0), rng.uniform(0.5, 4.0), light.shape)
    image = np.clip(np.rint(light + noise), 0.0, 255.0).astype(np.uint8)
    if rng.uniform() < JPEG_SHARE:
        quality = int(rng.integers(30, 95))
        _, coded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
        image = np.asarray(cv2.imdecode(coded, cv2.IMREAD_GRAYSCALE), dtype=np.uint8)
    return SunFrame(image, ring, ghost)
