"""Whether a driver took the median of neighbouring ranges: it gives one of them, and often gives
the same one to the pixel beside.
"""

from __future__ import annotations

import numpy as np

# Depths or ranges are the same where they differ by less than this, relative: what is rounded in
# between.
_SAME = 1e-6
# Of neighbours behind a median of 3 x 3 or of 5 x 5 pixels a fifth are the same on a surface seen
# squarely, fewer on slanted ones, of asteroids and trusses one in a hundred or more; of independent
# noise of a millimetre one in a thousand by chance, of more noise fewer.
_REPEATED, _FEWEST = 0.002, 30
# Ranges that come in steps are the same by chance, and those that are not then differ by that step.
# Else the nearest of these, as many again, differ by anything: of the nearest twentieth and the
# nearest half of them the largest are ten to one.
_STEPLESS = 3.0


def are_repeated(inverse: np.ndarray, tan_u: np.ndarray, tan_v: np.ndarray) -> bool:
    """Whether neighbours hold the very same depth, or range, more often than by chance.

    inverse : (H, W) inverse depth, 0 without a return, of the sensor's own pixels.  tan_u, tan_v :
        (W,) x/z of its columns and (H,) y/z of its rows.
    """
    secant = np.sqrt(1 + tan_u * tan_u + (tan_v * tan_v)[:, None])
    return any(_repeats(each) for each in (inverse, inverse / secant))


def _repeats(values: np.ndarray) -> bool:
    beside = (values[:, 1:], values[:, :-1]), (values[1:], values[:-1])
    # What fills a lone missing return from beside it repeats no return diagonally.
    aslant = (values[1:, 1:], values[:-1, :-1]), (values[1:, :-1], values[:-1, 1:])
    return all(_repeated(pairs) for pairs in (beside, aslant))


def _repeated(pairs: tuple[tuple[np.ndarray, np.ndarray], ...]) -> bool:
    apart = []
    for one, other in pairs:
        both = np.flatnonzero((one > 0) & (other > 0))
        here, there = one.ravel()[both], other.ravel()[both]
        apart.append(np.abs(here - there) / here)
    each = np.concatenate(apart)
    same = np.count_nonzero(each < _SAME)
    if same < max(_FEWEST, _REPEATED * len(each)) or 2 * same > len(each):
        return False
    nearest = np.partition(each, (same + same // 20, same + same // 2))
    return bool(nearest[same + same // 2] > _STEPLESS * nearest[same + same // 20])
