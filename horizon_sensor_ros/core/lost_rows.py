"""Rows at the end of a frame that were filled up for others that were lost on the way."""

from __future__ import annotations

import numpy as np

from horizon_sensor_ros.core.mask import Mask

# So many rows or columns along a border, and so large a share of all, hold one single value where a
# part of the frame was lost. A few may do so in any camera.
_LEAST, _LEAST_SHARE = 4, 0.01
# Space that is clipped at zero holds one value too. But the planet rises from it row by row: in the
# row before most pixels still hold it.
_STILL_THE_SAME = 0.5
_SAMPLES, _STRIDE = 16, 16  # pixels of a line; lines
_BORDERS = ("last rows", "first rows", "last columns", "first columns")


def lost_rows(gray: np.ndarray, mask: Mask | None) -> str:
    """Why a frame (H, W) is not whole, for a person; empty where it seems to be.

    Where rows are lost on the way, those after them are moved up and the end is filled with one
    value: what shows of the limb is in the wrong place. mask : of the camera; what it leaves out
    altogether is not asked.
    """
    sides = (gray[::-1], gray, gray.T[::-1], gray.T)
    for name, lines in zip(_BORDERS, sides, strict=True):
        count = _filled(lines)
        if count and not (mask is not None and _masked(mask, name, count)):
            return (
                f"its {count} {name} hold nothing but the value {int(lines[0, 0])}: was a part of "
                "the frame lost? If they always do, a mask leaves them out"
            )
    return ""


def _filled(lines: np.ndarray) -> int:
    """How many lines, from the first one, are fill; 0 where these are none."""
    value = lines[0, 0]
    if (lines[0] != value).any():
        return 0
    # Where fill ends nearly all pixels of a line change: a few of them, of a few lines, tell where
    # that is.
    some = lines[:, :: max(1, lines.shape[1] // _SAMPLES)]
    after = _STRIDE * _first_other(some[::_STRIDE], value)
    count = max(after - _STRIDE, 0) + _first_other(some[max(after - _STRIDE, 0) : after + 1], value)
    if count < max(_LEAST, _LEAST_SHARE * len(lines)):
        return 0
    if np.mean(lines[count] == value) > _STILL_THE_SAME or (lines[:count] != value).any():
        return 0
    return count


def _first_other(lines: np.ndarray, value: np.generic) -> int:
    """The first line that does not hold one value; 0 where all do."""
    return int(np.argmax((lines != value).any(axis=1)))


def _masked(mask: Mask, border: str, count: int) -> bool:
    """Whether the mask leaves all of these lines out."""
    last, rows = border.startswith("last"), border.endswith("rows")
    lines = mask.use if rows else mask.use.T
    return not (lines[-count:] if last else lines[:count]).any()
