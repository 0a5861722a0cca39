"""Where the sensor's field of view ends, as far as a cloud tells: nothing was looked at beyond."""

from __future__ import annotations

import numpy as np

# Of the pixels that hold a return in any of the rows next to the frame, those that do in the last
# one, and how many at least: of a round outline less than 0.58 do, of a straight one a third that
# rises by three pixels.
_FRAME_SHARE, _FRAME_ROWS, _FRAME_LEAST = 0.6, 3, 5
# Of what is seen, columns that end within a pixel of the same elevation.
_CUT_SHARE = 0.5
# By how much their line bends, rounded to pixels: less, and it may be a straight edge.
_BENT_PX = 1.5
# A straight edge lies within a pixel of the circle that touches it over twice the root of twice its
# radius, in pixels; a round field's outline over this many times as much, at least.
_ROUND_SHARE, _ROUND_PX = 1.3, 1.0


def likely_frame(inverse: np.ndarray, margin_px: int) -> np.ndarray:
    """First column and row, last column and row of the frame, as far as a plain cloud tells, whose
    image (H, W) has an empty margin of so many pixels.

    Where the returns end in a row or column that holds most of what the next ones farther in hold,
    the target leaves the frame: its own outline seldom runs along the pixels.
    """
    seen = inverse > 0
    height, width = seen.shape
    inner = seen[margin_px:-margin_px, margin_px:-margin_px]
    left, right, top, bottom = (
        _cut_off(side) for side in (inner.T, inner.T[::-1], inner, inner[::-1])
    )
    return np.array(
        [
            margin_px if left else 0,
            margin_px if top else 0,
            width - 1 - margin_px if right else width - 1,
            height - 1 - margin_px if bottom else height - 1,
        ]
    )


def _cut_off(seen: np.ndarray) -> bool:
    """Whether what is seen (N, M) leaves the frame across row 0."""
    last = int(np.count_nonzero(seen[0]))
    around = int(np.count_nonzero(seen[:_FRAME_ROWS].any(axis=0)))
    return last >= _FRAME_LEAST and last > _FRAME_SHARE * around


def outside_lines(
    inverse: np.ndarray, corner: np.ndarray, focal: float, view: np.ndarray
) -> np.ndarray:
    """Pixels (H, W), bool, above or below a lidar's field, as far as the cloud tells.

    What turns about the sensor's z axis scans lines of the same elevation, which are no straight
    lines of the image. Where most of what is seen ends in the highest or the lowest one, which is
    bent, the target leaves the field there.
    """
    height, width = inverse.shape
    outside = np.zeros((height, width), bool)
    if view[2, 2] != 0.0:
        # Straight above or below the sensor.
        return outside
    x = corner[0] + np.arange(width) / focal
    y = corner[1] + np.arange(height)[:, None] / focal
    ray = view[:, 0, None, None] * x + view[:, 1, None, None] * y + view[:, 2, None, None]
    # In pixels across the lines, where these cross the middle of the image.
    level = np.rint(ray[2] / np.hypot(ray[0], ray[1]) * focal)
    seen = inverse > 0
    along = 0 if view[2, 1] != 0.0 else 1
    for side in (level, -level):
        ends = np.where(seen, side, -np.inf).max(axis=along)
        last = ends.max()
        cut = np.flatnonzero(ends >= last - 1.0)
        if len(cut) > _CUT_SHARE * np.count_nonzero(ends > -np.inf):
            # The line itself may lie between two pixels.
            beyond = side >= last - 1.0
            if _bends(np.count_nonzero(beyond, axis=along)[cut], cut):
                outside |= ~seen & beyond
    return outside


def _bends(place: np.ndarray, at: np.ndarray) -> bool:
    """Whether a line's places (N,) lie off a straight one, as a target's edge is, by a pixel."""
    arm = at - at.mean()
    off = place - place.mean() - arm * (arm @ place / max(float(arm @ arm), 1.0))
    return bool(np.ptp(off) > _BENT_PX)


def outside_circle(inverse: np.ndarray, corner_px: np.ndarray) -> np.ndarray:
    """Pixels (H, W), bool, outside a round field about the sensor's forward axis, as a rosette scan
    has it, as far as the cloud tells.

    corner_px : (2,) of pixel (0, 0) from that axis. Where what is seen ends in one circle about the
    axis, over more of it than a straight edge could, the target leaves the field there.
    """
    height, width = inverse.shape
    x = corner_px[0] + np.arange(width)
    y = corner_px[1] + np.arange(height)[:, None]
    radius = np.hypot(x, y)
    row, column = np.nonzero(inverse)
    of_seen = radius[row, column]
    last = of_seen.max()
    outer = of_seen > last - 1.0 - _ROUND_PX
    angle = np.arctan2(y[row[outer], 0], x[column[outer]])
    met = len(np.unique(np.floor(angle * last)))
    if met < _ROUND_SHARE * 2 * np.sqrt(2 * (1.0 + _ROUND_PX) * last):
        return np.zeros((height, width), bool)
    return (inverse == 0) & (radius > last - 1.0 - _ROUND_PX)
