"""How far to go at once along a step of the fit of limb and glow."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

_MOST_STEP_PX = 2.0  # that a step moves the limb by, at most; longer ones are cut
# A step over the last one, where the next ones will go on like it, or back and forth: all of them
# are then made at once, as the sum of a geometric series.
_AHEAD = 0.3, 0.8
_BACK = -1.3, -0.5


class Stride(NamedTuple):
    """As much of a step as is gone at once.

    change : of the unknowns. shift_px : (M,) of the limb outwards, far_px at most. last : (M,) the
    step itself, for the next one to be held against; None after one that went farther than it.
    """

    change: np.ndarray
    shift_px: np.ndarray
    far_px: float
    last: np.ndarray | None


def stride_of(change: np.ndarray, rows: np.ndarray, last: np.ndarray | None) -> Stride:
    """What to go of a step that changes the unknowns so. rows, last : as of `GlowSight` and of the
    stride before.
    """
    shift = rows @ change[:3]
    share = _share(shift, last)
    last = shift if share == 0.0 else None
    change, shift = change / (1.0 - share), shift / (1.0 - share)
    far = float(np.abs(shift).max())
    if far > _MOST_STEP_PX:
        # Beside overexposed ground the first steps may be hundreds of pixels.
        change, shift = change * (_MOST_STEP_PX / far), shift * (_MOST_STEP_PX / far)
        far = _MOST_STEP_PX
    return Stride(change, shift, far, last)


def _share(shift: np.ndarray, last: np.ndarray | None) -> float:
    """By which share of the last step (M,) one goes the same way, or back: as all that follow will,
    so that they have an end; 0 where that cannot be told.
    """
    if last is None or len(last) != len(shift):
        return 0.0
    share = float(shift @ last) / float(last @ last)
    return share if any(low < share < high for low, high in (_AHEAD, _BACK)) else 0.0
