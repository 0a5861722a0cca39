"""Rows at the end of a frame that were filled up for others that were lost on the way."""

from __future__ import annotations

import numpy as np

from horizon_sensor_ros.core.cameras.mask import Mask

# So many rows or columns along a border, and so large a share of all, hold one single value where a
# part of the frame was lost. A few may do so in any camera.
_LEAST, _LEAST_SHARE = 4, 0.01
# Space that is clipped at zero holds one value too. But the planet rises from it row by row: in the
# row before most pixels still hold it.
_STILL_THE_SAME = 0.5
_SHARE_OF_STEP = 0.3  # that is left for the second line on
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
    # As a rule one pixel tells that a line is not all the same.
    if lines[0, lines.shape[1] // 2] != value or (lines[0] != value).any():
        return 0
    # Where fill ends nearly all pixels of a line change: a few of them, of a few lines, tell where
    # that is.
    some = lines[:, :: max(1, lines.shape[1] // _SAMPLES)]
    others = np.flatnonzero((some[::_STRIDE] != value).any(axis=1))
    after = others[0] if len(others) else (len(some) - 1) // _STRIDE + 1
    start = _STRIDE * max(int(after) - 1, 0)
    others = np.flatnonzero((some[start : start + _STRIDE + 1] != value).any(axis=1))
    count = start + int(others[0]) if len(others) else 0
    if count < max(_LEAST, _LEAST_SHARE * len(lines)):
        return 0
    if np.mean(lines[count] == value) > _STILL_THE_SAME or (lines[:count] != value).any():
        return 0
    return 0 if _rises(lines[count : count + 3], float(value)) else count


def _rises(lines: np.ndarray, value: float) -> bool:
    """Whether lines come away from a value over more than one of them, as those of a limb that lies
    along them do.
    """
    first, last = float(lines[0].mean()), float(lines[-1].mean())
    return abs(last - first) > _SHARE_OF_STEP * abs(last - value) + 1.0


def _masked(mask: Mask, border: str, count: int) -> bool:
    """Whether the mask leaves all of these lines out."""
    last, rows = border.startswith("last"), border.endswith("rows")
    lines = mask.use if rows else mask.use.T
    return not (lines[-count:] if last else lines[:count]).any()
