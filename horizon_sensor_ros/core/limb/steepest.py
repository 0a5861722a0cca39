"""The limb as the place of steepest fall: coarse, or where air glows above it.

Needs no model of what lies on either side. Above a sharp planet it is unbiased; in air glow it
lies outside the ground's edge by less than the glow's own length, by nearly the same amount all
along the limb, so that it shifts the altitude and hardly nadir.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from horizon_sensor_ros.core.limb.profiles import EdgePlaces, ProfileGrid, space_level

_SMOOTH = np.array([0.25, 0.5, 0.25])
# A fall of this share of the steepest one is an edge of its own, and the outermost counts.
_OUTERMOST = 0.15
# Profiles of textured planets scatter by up to this much about the limb, whatever the noise.
_TEXTURE_SIGMA_PX = 0.15
_LEAST_SIGMA_PX = 0.02


def steepest_fall(profiles: np.ndarray, noise: float, grid: ProfileGrid) -> EdgePlaces:
    """Place of the outermost steep fall in each profile (N, J), to a part of a sample.

    noise : one-sigma pixel noise, gray levels. Only places within ``grid.reach_px`` count.
    """
    smooth = (
        _SMOOTH[0] * profiles[:, :-2]
        + _SMOOTH[1] * profiles[:, 1:-1]
        + _SMOOTH[2] * profiles[:, 2:]
    )
    fall = 0.5 * (smooth[:, :-2] - smooth[:, 2:])
    d_px = grid.d_px[2:-2]
    # White noise of one gray level leaves this much in the fall.
    fall_noise = noise * 0.5 * np.linalg.norm(np.convolve(_SMOOTH, [1.0, 0.0, -1.0]))
    peak = (fall[:, 1:-1] >= fall[:, :-2]) & (fall[:, 1:-1] > fall[:, 2:])
    inside = np.abs(d_px[1:-1]) <= grid.reach_px
    strong = np.maximum(_OUTERMOST * fall.max(axis=1, keepdims=True), 4.0 * fall_noise)
    # A peak stands out from what lies just beyond it; the even slope of glow does not.
    beyond = np.minimum(fall[:, 2:], np.pad(fall[:, 3:], ((0, 0), (0, 1)), mode="edge"))
    beyond = np.minimum(beyond, np.pad(fall[:, 4:], ((0, 0), (0, 2)), mode="edge"))
    counts = peak & inside & (fall[:, 1:-1] - beyond > strong)
    found = counts.any(axis=1)
    last = counts.shape[1] - 1 - np.argmax(counts[:, ::-1], axis=1)
    rows = np.arange(len(profiles))
    before, top, after = fall[rows, last], fall[rows, last + 1], fall[rows, last + 2]
    curvature = np.minimum(before - 2.0 * top + after, -1e-9)
    shift = np.clip(0.5 * (before - after) / curvature, -0.5, 0.5)
    # The vertex of the parabola moves by this much for noise in the difference of its outer
    # samples.
    sigma = np.abs(fall_noise / curvature)
    # From the top of the fall inwards to the level of space: the step.
    step = smooth[rows, np.maximum(last - 1, 0)] - space_level(profiles)
    places = EdgePlaces(
        d_px[last + 1] + shift,
        sigma,
        step,
        np.where(found, top / fall_noise, 0.0),
        np.ones(len(profiles)),
        ~found,
        np.zeros(len(profiles)),
    )
    scatter = places.take(found).scatter_px()
    texture = _TEXTURE_SIGMA_PX if not np.isfinite(scatter) else min(scatter, _TEXTURE_SIGMA_PX)
    return replace(places, sigma_px=np.hypot(sigma, max(texture, _LEAST_SIGMA_PX)))
