"""Glow of the air at the limb: columns through an exponential atmosphere, and the night airglow."""

from __future__ import annotations

import numpy as np


def _erfcx(x: np.ndarray) -> np.ndarray:
    """exp(x^2) erfc(x) for x >= 0, by its upper bound (exact at 0 and far out, 8 % between)."""
    return 2.0 / (np.sqrt(np.pi) * (x + np.sqrt(x * x + 4.0 / np.pi)))


def glow_above_limb(
    height_m: np.ndarray, ahead_m: np.ndarray, scale_height_m: float, radius_m: float
) -> np.ndarray:
    """Column of an exponential atmosphere along rays that miss the planet.

    height_m : (N,) of the rays' lowest points; ahead_m : (N,) distance from the camera to those
    points, negative when they lie behind it (a camera inside the air that looks up).
    Returns (N,): 1 for a ray that grazes the limb and starts outside the air.
    """
    x = np.abs(ahead_m) / np.sqrt(2.0 * radius_m * scale_height_m)
    tail = 0.5 * np.exp(-np.minimum(x * x, 700.0)) * _erfcx(x)
    return np.exp(-height_m / scale_height_m) * np.where(ahead_m >= 0.0, 1.0 - tail, tail)


def glow_inside_limb(
    depth_m: np.ndarray,
    ahead_m: np.ndarray,
    altitude_m: float,
    scale_height_m: float,
    radius_m: float,
) -> np.ndarray:
    """Column in front of the surface for rays that hit it, over that of the grazing ray's half.

    depth_m : (N,) how far below the surface the unhindered ray would pass.
    """
    before = _erfcx(np.sqrt(depth_m / scale_height_m))
    x = np.abs(ahead_m) / np.sqrt(2.0 * radius_m * scale_height_m)
    return before - np.exp(-altitude_m / scale_height_m) * _erfcx(x)


def airglow_layer(
    height_m: np.ndarray, layer_height_m: np.ndarray | float, thickness_m: float
) -> np.ndarray:
    """Brightness of a thin emitting shell by the rays' lowest points; about 1 seen edge-on."""
    below = (layer_height_m - height_m) / thickness_m
    edge_on = 1.0 / np.sqrt(1.0 + np.maximum(below, 0.0))
    above = np.minimum(below, 0.0)
    return edge_on * np.exp(-above * above)
