"""Shares, as probabilities, and the logarithms of their odds."""

from __future__ import annotations

import math


def log_odds_of(share: float) -> float:
    """Logarithm of how many of a share, within (0, 1), go to one of the rest."""
    return math.log(share / (1.0 - share))


def share_of(log_odds: float) -> float:
    """Share with such a logarithm of its odds, of any size."""
    # Unlike 1 / (1 + exp(-x)) it does not overflow.
    return 0.5 + 0.5 * math.tanh(0.5 * log_odds)
