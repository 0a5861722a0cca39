"""Space below a camera's black level: pixels clipped at zero, and what they would have shown.

Of a normal law that is clipped at zero, the share of zeros and the median of the rest tell its own
mean m and sigma s. What is left of its noise is less than s, and an edge's foot looks lifted: the
mean of clipped samples is

    s h(m / s),    h(t) = t F(t) + f(t)

with the normal law's density f and distribution function F; its inverse takes that back.
Source: derived here; for censored normal samples see Tobin 1958.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from horizon_sensor_ros.core.mathematics.normal_law import normal_cdf, normal_density

_LIT = 1.6  # level over its noise from which on hardly anything is clipped
# Shares of zeros between which they tell the law: with fewer it is not clipped, with more what is
# not black may be stars.
_FEWEST, _MOST = 0.03, 0.99
_TAIL, _LONGEST_TAIL = 0.9, 5.0  # quantile of what is not black, over its median: of a law, 3.4
_ROUNDED = 0.5  # gray levels below which a value becomes zero
_SCATTER = 0.25  # of means of clipped samples below their own mean, over the law's sigma
_REACH = 5.0  # sigmas to which the law is tabulated


@dataclass(frozen=True)
class Black:
    """The normal law of space's pixels before they were clipped: gray levels."""

    mean: float
    sigma: float

    def unclipped(self, means: np.ndarray) -> np.ndarray:
        """Means of many samples, any shape, as if nothing had been clipped."""
        law, _, lifted = _normal_law()
        t = np.interp(means * (1.0 / self.sigma), lifted, law)
        # Well below space's mean sampling swings beyond an edge, which no clipping lifts.
        space = self.sigma * float(np.interp(self.mean / self.sigma, law, lifted))
        swing = np.minimum(means - space + _SCATTER * self.sigma, 0.0)
        dark = np.where(means < space, self.mean + swing, self.sigma * t)
        return np.where(means < self.sigma * lifted[-1], dark, means).astype(means.dtype)


def black_of(space: np.ndarray) -> Black | None:
    """Law of space from its pixels (N,), whole gray levels; None where they do not tell one."""
    lit = np.sort(space[space > 0], kind="stable")  # which is the fastest of small integers
    zeros = 1.0 - len(lit) / len(space)
    if not _FEWEST < zeros < _MOST:
        return None
    value = int(lit[len(lit) // 2])
    # Of white ones nothing tells how much brighter they are.
    if value == np.iinfo(space.dtype).max or lit[int(_TAIL * len(lit))] > _LONGEST_TAIL * value:
        return None
    law, share, _ = _normal_law()
    below, middle = np.interp([zeros, 0.5 * (1.0 + zeros)], share, law).tolist()
    # Of whole numbers, each of which stands for all that are rounded to it.
    first, last = np.searchsorted(lit, [value, value + 1]).tolist()
    median = float(value) - _ROUNDED + (0.5 * len(lit) - first) / (last - first)
    sigma = (median - _ROUNDED) / (middle - below)
    return Black(_ROUNDED - below * sigma, sigma)


def may_be_clipped(level: float, noise: float) -> bool:
    """Whether space at such a level may be clipped; noise : one sigma of a pixel, as it is seen."""
    return level < _LIT * noise


@lru_cache(maxsize=1)
def _normal_law() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Values t of the standard normal law, F(t) and h(t)."""
    t = np.linspace(-_REACH, _REACH, 1001)
    share = normal_cdf(t)
    return t, share, t * share + normal_density(t)
