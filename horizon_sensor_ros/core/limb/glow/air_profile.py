"""Brightness of lit air beside the limb, as a blurred image shows it along the limb's normal.

An exponential atmosphere's column falls as an exponential with the height of the line of sight;
in front of the ground it falls as ``erfcx`` of the root of the depth below the limb (the half of
the column that is on this side of the ground).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from horizon_sensor_ros.core.limb.texture.depth import seen_depths, seen_slopes
from horizon_sensor_ros.core.mathematics.normal_law import normal_cdf

_FAR = 6.0  # sigmas beyond the limb, from where on all of the blur lies in the glow


class Glow(NamedTuple):
    """Glow (N, J) over that of a ray that grazes the limb, and its derivatives by the place, by the
    blur and by the logarithm of the length over which it fades. In front of the ground (J,).
    """

    bright: np.ndarray
    by_place: np.ndarray
    by_blur: np.ndarray
    by_length: np.ndarray


def glow_outside(x_px: np.ndarray, psf_px: float, length_px: np.ndarray) -> Glow:
    """Glow at distances x_px (N, J) outside the limb.

    length_px : (N,) over which it fades by e. The step at the limb, where it begins, is blurred as
    all else.
    """
    blurs, lengths = x_px / psf_px, x_px / length_px[:, None]
    k = psf_px / length_px[:, None]
    at = blurs - k
    lit = np.ones_like(at)
    near = at < _FAR
    lit[near] = normal_cdf(at[near])
    bright = np.exp(np.minimum(0.5 * k * k - lengths, 50.0)) * lit
    begins = np.exp(-0.5 * np.square(blurs)) / (np.sqrt(2.0 * np.pi) * psf_px)
    return Glow(
        bright,
        begins - bright / length_px[:, None],
        bright * k / length_px[:, None] - begins * (blurs + k),
        bright * (lengths - k * k) + begins * (psf_px * k),
    )


def air_inside(x_px: np.ndarray, psf_px: float, length_px: float) -> Glow:
    """Glow of the air in front of the ground at distances x_px (J,), over that at the limb."""
    root, blur = seen_depths(x_px, psf_px)
    by_x, by_psf = seen_slopes(x_px, psf_px, root, blur)
    scaled = root / np.sqrt(length_px)
    lit, slope = _erfcx(scaled)
    return Glow(blur @ lit, by_x @ lit, by_psf @ lit, blur @ (-0.5 * scaled * slope))


def _erfcx(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """exp(x^2) erfc(x) for x >= 0, by its upper bound (exact at 0 and far out, 8 % between), and
    how that rises.
    """
    root = np.sqrt(x * x + 4.0 / np.pi)
    value = 2.0 / (np.sqrt(np.pi) * (x + root))
    return value, -value / root
