"""The limb drawn by area: no stairs, and its place true to a small part of a pixel.

Pixels that it touches are supersampled 8 x 8, and each sample carries the share of its own little
square that lies on the planet.
"""

from __future__ import annotations

import cv2
import numpy as np

from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.sim.scene_light import PIECE, SceneLight, pieces, turned

_SUBPIXELS = 8


def draw_limb(
    light: np.ndarray, world: SceneLight, camera: Camera, rot: np.ndarray, excess: np.ndarray
) -> None:
    """Redraw the pixels of light (H, W) that the limb touches, in place.

    rot : (3, 3), optical frame to the world; excess (H, W) : of the pixels' lines of sight.
    """
    edge = np.flatnonzero(_limb_pixels(excess))
    if edge.size == 0:
        return
    gradient = _gradient(excess, edge)
    keep = np.isfinite(gradient).all(axis=1) & (np.abs(gradient).max(axis=1) > 0.0)
    edge, gradient = edge[keep], gradient[keep]
    # a square of side 1 / 8 is crossed by the limb over this change of the excess
    ramp = np.abs(gradient).sum(axis=1) / _SUBPIXELS
    offset = (np.arange(_SUBPIXELS) + 0.5) / _SUBPIXELS - 0.5
    dx, dy = (grid.ravel() for grid in np.meshgrid(offset, offset))
    y, x = np.divmod(edge, camera.width)
    samples = np.empty((len(edge), _SUBPIXELS**2), np.float32)
    for piece in pieces(len(edge), PIECE // _SUBPIXELS**2):
        px = np.stack([(x[piece, None] + dx).ravel(), (y[piece, None] + dy).ravel()], axis=1)
        steep = np.repeat(ramp[piece], _SUBPIXELS**2)
        samples[piece] = _shared_out(world, camera.rays(px), rot, steep).reshape(-1, len(dx))
    light.flat[edge] = samples.mean(axis=1)


def _shared_out(
    world: SceneLight, rays: np.ndarray, rot: np.ndarray, ramp: np.ndarray
) -> np.ndarray:
    """Brightness (N,) of little squares about rays (N, 3), optical frame, each by the share of it
    that lies on the planet.

    ramp (N,) : change of the excess across a square.
    """
    valid = np.asarray(np.isfinite(rays).all(axis=1))
    sight = world.sight(turned(np.where(valid[:, None], rays, [0.0, 0.0, 1.0]), rot))
    share = np.clip(0.5 + sight.excess / ramp, 0.0, 1.0)
    on, off = valid & (share > 0.0), valid & (share < 1.0)
    out = np.zeros(len(rays), np.float32)
    out[on] += share[on] * world.surface(sight.take(on))
    if world.has_air:
        out[off] += (1.0 - share[off]) * world.sky(sight.take(off))
    return out


def _limb_pixels(excess: np.ndarray) -> np.ndarray:
    """Mask (H, W) of pixels with the limb inside them or in their immediate neighbours."""
    on = (excess > 0.0).astype(np.uint8)
    kernel = np.ones((3, 3), np.uint8)
    return np.asarray(cv2.dilate(on, kernel) != cv2.erode(on, kernel))


def _gradient(values: np.ndarray, pixel: np.ndarray) -> np.ndarray:
    """Gradient (N, 2) of an image (H, W) at flat pixel indices, one-sided at the borders."""
    height, width = values.shape
    y, x = np.divmod(pixel, width)
    left, right = np.maximum(x - 1, 0), np.minimum(x + 1, width - 1)
    up, down = np.maximum(y - 1, 0), np.minimum(y + 1, height - 1)
    gx = (values[y, right] - values[y, left]) / np.maximum(right - left, 1)
    gy = (values[down, x] - values[up, x]) / np.maximum(down - up, 1)
    return np.stack([gx, gy], axis=1)
