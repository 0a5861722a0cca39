"""Some of many, spread evenly."""

from __future__ import annotations

from functools import lru_cache

import numpy as np


@lru_cache(maxsize=64)
def evenly(length: int, count: int) -> np.ndarray:
    """Numbers of so many among `length`, from the first to the last; all, where these are fewer."""
    numbers = np.linspace(0, length - 1, min(count, length)).astype(np.intp)
    numbers.setflags(write=False)
    return numbers
