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
    """As much of a step as is gone at once: cut, or lengthened by those that will follow it.

    change : of the unknowns. shift_px : (M,) what it moves the limb outwards by; far_px is the
    largest of these. last : (M,) shift of the step as it was solved for, which the next step is
    compared with; None if this one was lengthened.
    """

    change: np.ndarray
    shift_px: np.ndarray
    far_px: float
    last: np.ndarray | None


def stride_of(change: np.ndarray, rows: np.ndarray, last: np.ndarray | None) -> Stride:
    """Return how much of a step to go.

    change : of the unknowns, by the whole step. rows : (M, 3) of `GlowSight`, what the first three
    unknowns move the limb by. last : of the stride before.
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
