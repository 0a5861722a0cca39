"""Where the limb is in an image, measured across a known curve by means of its own."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.special import ndtr


def profiles(image: np.ndarray, px: np.ndarray, normal: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Grey levels (N, M) at distances `at` (M,) along the normals, cubic spline."""
    where = px[:, None] + at[None, :, None] * normal[:, None]
    return map_coordinates(image.astype(float), [where[..., 1], where[..., 0]], order=3)


def half_height_crossings(image: np.ndarray, px: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Distance (N,) along the normal at which a clean step falls through half its height."""
    at = np.arange(-6.0, 6.01, 0.1)
    levels = profiles(image, px, normal, at)
    half = 0.5 * (levels[:, at < -4].mean(axis=1) + levels[:, at > 4].mean(axis=1))
    row = np.arange(len(levels))
    after = np.clip(np.argmax(levels < half[:, None], axis=1), 1, None)
    high, low = levels[row, after - 1], levels[row, after]
    return at[after - 1] + 0.1 * (high - half) / (high - low)


def step_position(image: np.ndarray, px: np.ndarray, normal: np.ndarray, sigma: float) -> float:
    """Distance at which blurred steps on sloped insides explain the profiles best, all together.

    Every profile has its own levels and slope; the profiles count by their steps' heights.
    """
    at = np.arange(-1.5, 4.01, 0.25)
    levels = profiles(image, px, normal, at)
    shifts = np.arange(-0.6, 0.601, 0.02)
    misfit = []
    for shift in shifts:
        z = (at - shift) / sigma
        step = ndtr(-z)
        slope = sigma * (z * step - np.exp(-0.5 * z * z) / np.sqrt(2.0 * np.pi))
        basis, _ = np.linalg.qr(np.stack([step, slope, np.ones_like(at)], axis=1))
        misfit.append(np.sum((levels - (levels @ basis) @ basis.T) ** 2))
    best = int(np.clip(np.argmin(misfit), 1, len(shifts) - 2))
    before, here, after = misfit[best - 1 : best + 2]
    return float(shifts[best] + 0.01 * (before - after) / (before - 2.0 * here + after))


def inside_frame(px: np.ndarray, shape: tuple[int, ...], margin: float) -> np.ndarray:
    """Mask (N,) of points at least a margin away from the frame's border."""
    height, width = shape[:2]
    return (px > margin).all(axis=1) & (px[:, 0] < width - margin) & (px[:, 1] < height - margin)
