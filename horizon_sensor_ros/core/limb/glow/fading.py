"""How far a lens darkens towards the corners, as the glow along a limb tells it.

A fading lens and a limb that is turned look alike in the glow's contour; the ground's edges tell
them apart, each of them badly. A lens that is corrected loses hardly any light, another one half of
it and more: the answer is the mean over both, by how well what is seen agrees with either.
Source: derived here; Bayesian model averaging (Hoeting et al. 1999).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

# The logarithm of what light is lost in the corners, one sigma: of lenses that fade, one in so many
# of all, and of the others.
FADING_SIGMA, _FADING_LENSES, _EVEN_SIGMA = 0.7, 0.1, 0.02
# How far off it is found beside clouds, over what is claimed: they are no Gaussian process.
_MISJUDGED = 1.8
_NOTHING = 1e-6  # information on it, over that beforehand, that is none
_NEVER = 1e-300


@dataclass(frozen=True)
class _Fading:
    """What is known of fading with one kind of lens, and the logarithm of how likely it is that
    what was seen was seen, but for what is common to all kinds.
    """

    mean: float
    variance: float
    log_likelihood: float


def _with_lens(seen: float, information: float, sigma: float) -> _Fading:
    """By what was seen of it, with so much information, and what a lens's fading is beforehand."""
    variance = 1.0 / (information + sigma**-2.0)
    whole = 1.0 / information + sigma**2
    log_likelihood = -0.5 * (seen**2 / whole + math.log(whole))
    return _Fading(variance * information * seen, variance, log_likelihood)


def either_lens(mean: float, variance: float) -> tuple[float, float]:
    """Mean and variance of fading whatever the lens, from those with one that fades.

    No lens brightens towards the corners.
    """
    known = FADING_SIGMA**-2.0
    information = max(1.0 / variance - known, _NOTHING * known)
    seen = mean / (variance * information)
    information /= _MISJUDGED**2
    fading = _with_lens(seen, information, FADING_SIGMA)
    even = _with_lens(seen, information, _EVEN_SIGMA)
    log_odds = math.log(_FADING_LENSES / (1.0 - _FADING_LENSES))
    log_odds += fading.log_likelihood - even.log_likelihood
    # Twice the share of the law that lies above zero.
    above = math.erfc(-fading.mean / math.sqrt(2.0 * fading.variance))
    log_odds += math.log(max(above, _NEVER))
    fades = 0.5 + 0.5 * math.tanh(0.5 * log_odds)
    off = fading.mean - even.mean
    spread = fades * fading.variance + (1.0 - fades) * even.variance
    return even.mean + fades * off, spread + fades * (1.0 - fades) * off * off


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
