"""Rows of numbers, made column by column for a dataclass of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields

import numpy as np


def columns_of(kind: type, rows: Sequence[Mapping[str, float]]) -> dict[str, np.ndarray]:
    """Return a column (N,) for each field of a dataclass, of N rows; NaN where a row lacks it."""
    return {
        field.name: np.array([row.get(field.name, np.nan) for row in rows], dtype=float)
        for field in fields(kind)
    }
