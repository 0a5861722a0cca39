"""Frames whose pixels are means of others, since a colour camera's were interpolated.

Behind a Bayer filter a pixel has one colour, and takes the others from its neighbours. Green ones,
every other pixel as on a chessboard, are means of fewer than red and blue ones: what is left of
noise and detail differs from the one field to the other. In frames of other cameras it does not.
Where such frames are white, what is clipped are the pixels before that.
Source: A. C. Gallagher and T. Chen, "Image authentication by detecting traces of demosaicing",
CVPR Workshops 2008 (variance of a high pass, along diagonals); the two fields compared here.
"""

from __future__ import annotations

import math

import numpy as np

from horizon_sensor_ros.core.cameras.white_level import NEAR_WHITE

_BANDS = 32  # of two rows each, which tell enough of a frame
_FEWEST = 200  # pixels of a field
# Difference of both fields' detail over its sum: .14 to .6 of simulated frames that were
# interpolated linearly, by how coarse gray levels are beside noise; of others up to .03. And that,
# over its sigma: 20 to 150, and up to 2.
_DIFFERENCE, _SIGMAS = 0.08, 6.0
_MOST = 3.0  # detail of a pixel, over the mean: edges and hot pixels tell nothing
# What means of two and four neighbours take of colours, each with its share of gray, to pixels
# beside them, in the mean over a pattern: an edge along rows, interpolated linearly.
BESIDE = 0.18


def demosaiced(gray: np.ndarray, white: float) -> bool:
    """Whether a frame (H, W) was interpolated from a Bayer pattern; white : where it saturates."""
    height, width = gray.shape
    if min(height, width) < 4:
        return False
    first = np.arange(1, height - 2, max(2, height // _BANDS))
    rows = np.concatenate([first, first + 1])
    above, middle, below = (gray[rows + k].astype(np.float32) for k in (-1, 0, 1))
    left, here, right = middle[:, :-2], middle[:, 1:-1], middle[:, 2:]
    above, below = above[:, 1:-1], below[:, 1:-1]
    detail = np.abs(4.0 * here - above - below - left - right)
    least = np.minimum.reduce([above, below, left, right, here])
    most = np.maximum.reduce([above, below, left, right, here])
    unclipped = (least > 0.0) & (most < NEAR_WHITE * white)
    odd = (rows[:, None] + np.arange(1, width - 1)) % 2 == 1
    fields = [detail[unclipped & field] for field in (odd, ~odd)]
    if min(map(len, fields)) < _FEWEST:
        return False
    most_detail = _MOST * float(detail[unclipped].mean())
    one, other = (np.minimum(field, most_detail) for field in fields)
    apart, both = abs(float(one.mean() - other.mean())), float(one.mean() + other.mean())
    sigma = math.sqrt(one.var() / len(one) + other.var() / len(other))
    return apart > _DIFFERENCE * both and apart > _SIGMAS * sigma
