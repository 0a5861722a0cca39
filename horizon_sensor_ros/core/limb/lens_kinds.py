"""What is known of a lens that may be of either of two kinds: most are good, some are not.

The answer is the mean over both, weighted by how well either explains what is seen.
Source: Bayesian model averaging (Hoeting et al. 1999).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from horizon_sensor_ros.core.mathematics.odds import share_of


@dataclass(frozen=True)
class Known:
    """What is known of one lens, if it is of one kind: what lenses of that kind do is spread about
    nothing by one sigma.

    mean, variance : of what this one does. log_likelihood : how likely such a lens is to show what
    was seen, up to a term that all kinds have in common.
    """

    mean: float
    variance: float
    log_likelihood: float

    @classmethod
    def of(cls, seen: float, variance: float, sigma: float) -> Known:
        """By what was seen of it, and the variance of that. sigma : of its kind."""
        whole = variance + sigma**2
        share = sigma**2 / whole
        log_likelihood = -0.5 * (seen**2 / whole + math.log(whole))
        return cls(share * seen, share * variance, log_likelihood)


def of_either(usual: Known, other: Known, log_odds: float) -> tuple[float, float]:
    """Mean and variance over both kinds.

    log_odds : logarithm of how much likelier the other kind is, before anything is seen.
    """
    log_odds += other.log_likelihood - usual.log_likelihood
    share = share_of(log_odds)
    off = other.mean - usual.mean
    variance = usual.variance + share * (other.variance - usual.variance)
    return usual.mean + share * off, variance + share * (1.0 - share) * off**2
