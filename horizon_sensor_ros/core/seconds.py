"""Stamps and spans are whole nanoseconds; formulas and people want seconds."""

from __future__ import annotations

from typing import overload

import numpy as np

NANOSECONDS = 1_000_000_000  # in a second


def ns_from_s(seconds: float) -> int:
    """Return seconds in nanoseconds, to the nearest."""
    return round(seconds * NANOSECONDS)


@overload
def s_from_ns(nanoseconds: int) -> float: ...


@overload
def s_from_ns(nanoseconds: np.ndarray) -> np.ndarray: ...


def s_from_ns(nanoseconds: int | np.ndarray) -> float | np.ndarray:
    """Return nanoseconds, of any shape, in seconds; the last bit may be off.

    A product, since what is estimated hangs on every bit: the same bag is to give the same bytes.
    """
    return nanoseconds * 1e-9


@overload
def nearest_s_from_ns(nanoseconds: int) -> float: ...


@overload
def nearest_s_from_ns(nanoseconds: np.ndarray) -> np.ndarray: ...


def nearest_s_from_ns(nanoseconds: int | np.ndarray) -> float | np.ndarray:
    """Return nanoseconds, of any shape, in seconds; of a decimal fraction its own number."""
    return nanoseconds / NANOSECONDS
