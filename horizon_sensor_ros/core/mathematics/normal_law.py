"""The standard normal law."""

from __future__ import annotations

import math

import numpy as np

_ROOT_TWO_PI = np.sqrt(2.0 * np.pi)


def normal_cdf(x: np.ndarray) -> np.ndarray:
    """Distribution function of values of any shape, to the last digits of its tails too."""
    # Not scipy.special: loading it takes a node as long as all its other libraries together.
    flat = (np.asarray(x, dtype=float) * -math.sqrt(0.5)).ravel().tolist()
    return 0.5 * np.array([math.erfc(value) for value in flat]).reshape(np.shape(x))


def normal_density(x: np.ndarray) -> np.ndarray:
    """Density of values of any shape."""
    return np.asarray(np.exp(-0.5 * x * x) / _ROOT_TWO_PI)
