"""Streaks that the overexposed Sun draws along rows or columns of a frame, taken off it.

A streak beside a limb is neither space nor ground: what is fitted to the brightness across the limb
takes it for air, or for stray light, and the limb comes out a pixel off. It adds to what is there,
by as much in every row along the frame, but for a factor that changes slowly: both are measured in
the sky beside it.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from horizon_sensor_ros.core.cameras.white_level import NEAR_WHITE, full_scale
from horizon_sensor_ros.core.mathematics.robust import robust_sigma

# The Sun is sought on a grid of so many points along a frame, and no finer than pixels of this.
_GRID, _FINEST_PX = 80, 8
# Of the brightest: the Sun saturates evenly, clouds seldom do; and how far around its middle that
# is asked.
_SOLID, _CORE_PX = 0.99, 3
_LEAST_POINTS = 3  # of the grid, of something white that may be the Sun
_LARGEST = 0.2  # of the frame's height or width; what is white and larger both ways is none
_MOST = 3  # white places that are looked at, the largest first
# How far to either side of the Sun's row a streak is looked for, pixels of a frame of `_USUAL_PX`,
# and how much of that is sky beside it.
_BESIDE_PX, _USUAL_PX, _FLANK = 24, 640, 1.0 / 3.0
_COLUMNS = 160  # of the frame, that are looked at
# Of these, at least so many with sky on both sides: no brighter than the frame's darkest, but for
# so much of the full scale.
_LEAST_SKY, _OF_SKY = 20, 0.08
_LEAST_ON_GRID, _OFF_PX = 0.03, 6  # share of the grid's, and how near the Sun's row, at first sight
# How much brighter a streak is than its sides, over the noise of the median row, and over the full
# scale.
_SIGMAS, _LEAST_RISE = 8.0, 0.008
# Clouds, and the limb, are no such lines: of its height, at least to be seen in each of so many
# parts of the columns.
_ALL_ALONG, _PARTS = 0.25, 6
_ENDS_SIGMAS, _ENDS_SHARE = 2.0, 0.003  # where it ends, over that noise and its height
_SMOOTH = 9  # columns looked at, over which its height is taken to be even


class _Streak(NamedTuple):
    """Brightness (R,) of lines from the first on, times a factor (C,) along them."""

    first: int
    level: np.ndarray
    along: np.ndarray


def without_streaks(gray: np.ndarray) -> np.ndarray:
    """Return a frame (H, W), uint8 or uint16, less the Sun's streaks; itself where it has none.

    Saturated pixels stay what they are.
    """
    stride = max(_FINEST_PX, max(gray.shape) // _GRID)
    grid = gray[::stride, ::stride]
    white, black = full_scale(grid), float(grid.min())
    # Most frames have nothing white, and are asked no more.
    if grid.max() < NEAR_WHITE * white:
        return gray
    solid = _SOLID * float(grid.max())
    bright = (grid >= solid).astype(np.uint8)
    _, _, stats, centres = cv2.connectedComponentsWithStats(bright, connectivity=8)
    sizes = stats[1:, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]] / np.array(grid.shape[::-1])
    area = np.where(sizes.min(axis=1) < _LARGEST, stats[1:, cv2.CC_STAT_AREA], 0)
    beside = round(_BESIDE_PX * max(1.0, max(gray.shape) / _USUAL_PX))
    dark = black + _OF_SKY * white
    out = gray
    for i in np.argsort(area)[: -_MOST - 1 : -1].tolist():
        if area[i] < _LEAST_POINTS:
            break
        x, y = np.rint(centres[i + 1] * stride).astype(int).tolist()
        core = gray[
            max(y - _CORE_PX, 0) : y + _CORE_PX + 1, max(x - _CORE_PX, 0) : x + _CORE_PX + 1
        ]
        if core.min() < solid:
            continue
        for at, turned in ((y, False), (x, True)):
            lines = out.T if turned else out
            if not _may_show(lines, stride, at, beside, dark, _LEAST_RISE * white):
                continue
            streak = _streak(lines, at, beside, dark, white)
            if streak is not None:
                out = out.copy() if out is gray else out
                _take_off(out.T if turned else out, streak, NEAR_WHITE * white)
    return out


def _may_show(
    lines: np.ndarray, stride: int, at: int, beside: int, dark: float, least: float
) -> bool:
    """Whether at first sight, in every `stride`-th column, a streak stands out from the sky: most
    white places are clouds, and are asked no more.
    """
    if at < beside or at + beside >= len(lines):
        return False
    before, after = lines[at - beside, ::stride], lines[at + beside, ::stride]
    sky = np.maximum(before, after) < dark
    if np.count_nonzero(sky) < _LEAST_ON_GRID * len(sky):
        return False
    sides = 0.5 * (before[sky].astype(np.float64) + after[sky])
    near = lines[at - _OFF_PX : at + _OFF_PX + 1 : 2, ::stride][:, sky]
    return bool(np.median(near - sides, axis=1).max() > least)


def _take_off(lines: np.ndarray, streak: _Streak, saturated: float) -> None:
    band = lines[streak.first : streak.first + len(streak.level)]
    # It only adds: where noise alone makes of it less than nothing, nothing is taken.
    less = band - np.maximum(streak.level[:, None] * streak.along, 0.0)
    np.copyto(band, np.rint(np.maximum(less, 0.0)).astype(lines.dtype), where=band < saturated)


def _streak(lines: np.ndarray, at: int, beside: int, dark: float, white: float) -> _Streak | None:
    """Streak near one of the lines; None where there is none, or no sky to see it in."""
    first = at - beside
    step = max(1, lines.shape[1] // _COLUMNS)
    columns = np.arange(0, lines.shape[1], step)
    band = lines[first : at + beside + 1, ::step].astype(np.float32)
    flank = round(_FLANK * beside)
    before, after = band[:flank].mean(axis=0), band[-flank:].mean(axis=0)
    sky = np.maximum(before, after) < dark
    if np.count_nonzero(sky) < _LEAST_SKY:
        return None
    half = 0.5 * (flank - 1)
    place = (np.arange(len(band)) - half) / (len(band) - 1 - 2.0 * half)
    above = band[:, sky] - before[sky] - place[:, None] * (after - before)[sky]
    level = _over_its_sides(np.median(above, axis=1), beside)
    noise = max(robust_sigma(np.concatenate([level[:flank], level[-flank:]])), 1e-4 * white)
    top = int(np.argmax(level))
    if level[top] < max(_SIGMAS * noise, _LEAST_RISE * white):
        return None
    parts = np.array_split(above[top], _PARTS)
    if min(float(np.median(part)) for part in parts) < _ALL_ALONG * level[top]:
        return None
    ends = level < max(_ENDS_SIGMAS * noise, _ENDS_SHARE * level[top])
    ends[[0, -1]] = True
    rows = slice(top - int(np.argmax(ends[top::-1])) + 1, top + int(np.argmax(ends[top:])))
    # Where a limb is beside it the other half of the streak tells how high it is.
    height = np.full(len(columns), np.nan)
    height[sky] = _height(level, rows, above)
    for half_of, side in ((slice(rows.start, top + 1), before), (slice(top, rows.stop), after)):
        alone = np.isnan(height) & (side < dark)
        height[alone] = _height(level, half_of, band[:, alone] - side[alone])
    known = np.isfinite(height)
    smooth = cv2.blur(cv2.medianBlur(height[known].astype(np.float32)[None], 5), (_SMOOTH, 1))[0]
    along = np.interp(np.arange(lines.shape[1]), columns[known], smooth)
    return _Streak(first + rows.start, level[rows], along)


def _height(level: np.ndarray, rows: slice, above: np.ndarray) -> np.ndarray:
    """Factor (C,) by which a streak's rows, of a level (R,), lie above (R, C) their sides."""
    return np.asarray(level[rows] @ above[rows] / (level[rows] @ level[rows]))


def _over_its_sides(level: np.ndarray, beside: int) -> np.ndarray:
    """Level (2 N + 1,) over that half way to its ends: the Sun's halo is wider than a streak."""
    left, right = beside // 2, len(level) - 1 - beside // 2
    near = [float(np.median(level[at - 1 : at + 2])) for at in (left, right)]
    place = (np.arange(len(level)) - left) / (right - left)
    within = slice(left, right + 1)
    out = level.astype(np.float64)
    out[within] -= near[0] + place[within] * (near[1] - near[0])
    return out
