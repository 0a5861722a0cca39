"""How far off the axis a distortion polynomial is one-to-one."""

from __future__ import annotations

import numpy as np


def first_positive_root(polynomial: np.polynomial.Polynomial) -> float:
    """Return the smallest positive real root, inf without one; the constant term must be 1."""
    # Solved for the reciprocal, whose leading coefficient is that 1, however small the last is.
    inverse = np.polynomial.polynomial.polyroots(polynomial.coef[::-1])
    real = inverse.real[np.abs(inverse.imag) <= 1e-7 * np.abs(inverse)]
    largest = float(real.max(initial=0.0))
    return 1.0 / largest if largest > 1e-12 else np.inf
