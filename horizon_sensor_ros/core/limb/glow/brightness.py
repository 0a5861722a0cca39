"""How the logarithm of the glow's brightness changes along a limb.

By daylight a polynomial of second degree describes it. Towards the terminator it falls too fast for
that: further powers of the place along the limb are unknown as well.
"""

from __future__ import annotations

import numpy as np


def powers(along: np.ndarray) -> np.ndarray:
    """Rows (M, 3) of the polynomial at places (M,) along the limb, -1 to 1."""
    return np.stack([np.ones_like(along), along, along * along], axis=1)


def further_powers(along: np.ndarray, count: int) -> np.ndarray:
    """Rows (M, count) of it beyond the second power: Legendre's, which hardly move what the lower
    ones are.
    """
    return np.asarray(np.polynomial.legendre.legvander(along, 2 + count)[:, 3:])
