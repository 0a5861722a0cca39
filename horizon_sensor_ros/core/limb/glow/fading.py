"""How far a lens darkens towards the corners, as the glow along a limb tells it.

A fading lens and a limb that is turned look alike in the glow's contour; the ground's edges tell
them apart, each of them badly. A lens that is corrected loses hardly any light, another one half of
it and more: the answer is the mean over both, by how well what is seen agrees with either.
Source: derived here.
"""

from __future__ import annotations

import math

import numpy as np

from horizon_sensor_ros.core.limb.air import FADING_SIGMA
from horizon_sensor_ros.core.limb.lens_kinds import Known, of_either
from horizon_sensor_ros.core.mathematics.odds import log_odds_of

# One in so many lenses fades; the others lose light in the corners by so much, in its logarithm.
_FADING_LENSES, _EVEN_SIGMA = 0.1, 0.02
# How far off it is found beside clouds, over what is claimed: they are no Gaussian process.
_MISJUDGED = 1.8
_NOTHING = 1e-6  # information on it, over that beforehand, that is none
_NEVER = 1e-300


def either_lens(mean: float, variance: float) -> tuple[float, float]:
    """Mean and variance of fading whatever the lens, from those with one that fades.

    No lens brightens towards the corners.
    """
    known = FADING_SIGMA**-2.0
    information = max(1.0 / variance - known, _NOTHING * known)
    seen = mean / (variance * information)
    variance = _MISJUDGED**2 / information
    even, fading = (Known.of(seen, variance, sigma) for sigma in (_EVEN_SIGMA, FADING_SIGMA))
    # Twice the share of the law that lies above zero.
    above = math.erfc(-fading.mean / math.sqrt(2.0 * fading.variance))
    log_odds = log_odds_of(_FADING_LENSES) + math.log(max(above, _NEVER))
    return of_either(even, fading, log_odds)


def with_either_lens(
    change: np.ndarray, cov: np.ndarray, place: int, fading: float
) -> tuple[np.ndarray, np.ndarray]:
    """A step (P,) and its covariance (P, P) whatever the lens, from those with one that fades.

    place : among the unknowns, of fading, which the step starts from.
    """
    variance = float(cov[place, place])
    mean, spread = either_lens(fading + float(change[place]), variance)
    by_fading = cov[:, place] / variance
    return (
        change + by_fading * (mean - fading - change[place]),
        cov + np.outer(by_fading, by_fading) * (spread - variance),
    )
