"""What is known of a lens, of which two kinds are made.

Most are good, some are not: a mean over both by how well what is seen agrees with either.
Source: Bayesian model averaging (Hoeting et al. 1999).
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Known:
    """Mean and variance of what lenses of one kind do, about nothing by one sigma, and the
    logarithm of how likely it is that what was seen was seen, but for what is common to all kinds.
    """

    mean: float
    variance: float
    log_likelihood: float

    @classmethod
    def of(cls, seen: float, variance: float, sigma: float) -> Known:
        """By what was seen of it and the variance of that, of a kind's one sigma."""
        whole = variance + sigma**2
        share = sigma**2 / whole
        log_likelihood = -0.5 * (seen**2 / whole + math.log(whole))
        return cls(share * seen, share * variance, log_likelihood)


def of_either(usual: Known, other: Known, log_odds: float) -> tuple[float, float]:
    """Mean and variance whatever the kind.

    log_odds : of the other kind, before anything is seen.
    """
    log_odds += other.log_likelihood - usual.log_likelihood
    share = 0.5 + 0.5 * math.tanh(0.5 * log_odds)
    off = other.mean - usual.mean
    variance = usual.variance + share * (other.variance - usual.variance)
    return usual.mean + share * off, variance + share * (1.0 - share) * off**2
