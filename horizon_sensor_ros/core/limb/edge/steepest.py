"""The limb as the place of steepest fall: coarse, or where air glows above it.

Needs no model of what lies on either side. Above a sharp planet it is unbiased; in air glow it
lies outside the ground's edge by less than the glow's own length, by nearly the same amount all
along the limb, so that it shifts the altitude and hardly nadir.
"""

from __future__ import annotations

import numpy as np

from horizon_sensor_ros.core.limb.profiles import EdgePlaces, ProfileGrid, scatter_px, space_level

# What white noise of one gray level leaves in the fall: half the difference of two samples, two
# apart, of a profile smoothed by a quarter, a half and a quarter.
_FALL_NOISE = 0.5 * np.linalg.norm([0.25, 0.5, 0.0, -0.5, -0.25])
# A fall of this share of the steepest one is an edge of its own, and the outermost counts.
_OUTERMOST = 0.15
# Profiles of textured planets scatter by up to this much about the limb, whatever the noise.
_TEXTURE_SIGMA_PX = 0.15
_LEAST_SIGMA_PX = 0.02


def steepest_fall(profiles: np.ndarray, noise: float, grid: ProfileGrid) -> EdgePlaces:
    """Place of the outermost steep fall in each profile (N, J), to a part of a sample.

    noise : one-sigma pixel noise, gray levels. Only places within ``grid.reach_px`` count.
    """
    smooth = 0.25 * (profiles[:, :-2] + profiles[:, 2:]) + 0.5 * profiles[:, 1:-1]
    fall = 0.5 * (smooth[:, :-2] - smooth[:, 2:])
    d_px = grid.d_px[2:-2]
    fall_noise = noise * _FALL_NOISE
    middle, outer = fall[:, 1:-1], fall[:, 2:]
    # A peak stands out from what lies just beyond it; the even slope of glow does not.
    beyond = outer.copy()
    for further in (1, 2):
        part = beyond[:, :-further]
        np.minimum(part, outer[:, further:], out=part)
    strong = np.maximum(_OUTERMOST * fall.max(axis=1), 4.0 * fall_noise)
    counts = (middle >= fall[:, :-2]) & (middle > outer) & (middle - beyond > strong[:, None])
    counts &= np.abs(d_px[1:-1]) <= grid.reach_px
    last = counts.shape[1] - 1 - np.argmax(counts[:, ::-1], axis=1)
    rows = np.arange(len(profiles))
    found = counts[rows, last]
    before, top, after = fall[rows, last], fall[rows, last + 1], fall[rows, last + 2]
    curvature = np.minimum(before - 2.0 * top + after, -1e-9)
    shift = np.minimum(np.maximum(0.5 * (before - after) / curvature, -0.5), 0.5)
    offset_px = d_px[last + 1] + shift
    # The vertex of the parabola moves by this much for noise in the difference of its outer
    # samples.
    sigma = np.abs(fall_noise / curvature)
    scatter = scatter_px(offset_px[found])
    texture = _TEXTURE_SIGMA_PX if np.isnan(scatter) else min(scatter, _TEXTURE_SIGMA_PX)
    return EdgePlaces(
        offset_px,
        np.hypot(sigma, max(texture, _LEAST_SIGMA_PX)),
        # From the top of the fall inwards to the level of space: the step.
        smooth[rows, np.maximum(last - 1, 0)] - space_level(profiles),
        np.where(found, top / fall_noise, 0.0),
        np.ones(len(profiles)),
        ~found,
    )
