"""Step one: where in the image the limb might be.

Two kinds of candidate. `canny_candidates` is the edge map the four papers start from: on a clouded
planet most of its edges are clouds. `space_boundary_candidates` keeps only the edges whose dark
side *is space*: dark along the whole way outwards. That is what tells a limb from a cloud.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np

from horizon_sensor_ros.core.cameras.mask import Mask
from horizon_sensor_ros.core.cameras.white_level import full_scale
from horizon_sensor_ros.core.limb.search.evenly import evenly
from horizon_sensor_ros.core.limb.search.working_image import WorkingImage
from horizon_sensor_ros.core.mathematics.robust import median

_CANNY = 50.0, 150.0  # its two thresholds
_OUTWARD_STEPS_PX = np.array(
    [3.0, 4.5, 6.5, 9.0, 13.0, 19.0, 28.0, 40.0], dtype=np.float32
)  # working pixels
# Near the edge air glow may hold half of the step; farther out it must have faded.
_GLOW_LEFT = np.array([0.65, 0.5, 0.4, 0.3, 0.25, 0.2, 0.2, 0.2], dtype=np.float32)
_FIRST_LOOK = 3  # outward steps that most edges inside the planet fail already
_FARTHER_PX = np.arange(4.0, 25.0, 2.0, dtype=np.float32)
_INWARD_STEPS_PX = np.array([-2.0, -6.0], dtype=np.float32)
_RIDGE_SHARE = 0.15  # of the step, left so far inside: less is a streak, or a layer of air
# A streak of the Sun's ends as it began, but for so much of its step; and its edges run past the
# Sun's middle by no more than this, working pixels.
_STREAK_SHARE, _PAST_SUN_PX = 0.25, 8.0
_SUN_PX = 60, 1500  # that the Sun covers, working pixels
_NEAR_SUN_PX, _SUN_SHARE = 20.0, 0.8  # from its middle, and how many of them lie so near
_LEAST_STREAK = 8  # edges
_ACROSS_PX = np.arange(-2.0, 3.0, dtype=np.float32)[:, None]
_BORDER_PX = 48  # working pixels beyond the frame that may be asked for
_MASK_CLEARANCE_PX = 4.0  # working pixels that a candidate keeps from a masked part of the frame


@dataclass(frozen=True, eq=False)
class LimbCandidates:
    """Edge points that may lie on the limb.

    px : (N, 2) float64 raw pixels of the full image. normal_px : (N, 2) unit vectors towards the
    dark side. contrast : (N,) gray-level step across the edge. pitch_px : spacing of the
    candidates' grid, full-image pixels. outermost : (N,) False where another candidate lies farther
    out along the normal; None where that was not looked at. beyond_px : (N,) how far outside px the
    image falls most steeply; empty where that was not looked at.
    """

    px: np.ndarray = field(default_factory=lambda: np.empty((0, 2)))
    normal_px: np.ndarray = field(default_factory=lambda: np.empty((0, 2)))
    contrast: np.ndarray = field(default_factory=lambda: np.empty(0))
    pitch_px: float = 1.0
    outermost: np.ndarray | None = None
    beyond_px: np.ndarray = field(default_factory=lambda: np.empty(0))

    def __len__(self) -> int:
        return len(self.px)


def canny_candidates(gray: np.ndarray) -> LimbCandidates:
    """All Canny edges of the full image, as the papers take them (8-bit; of 16-bit images the
    `full_scale` is scaled to that of 8 bits).

    gray : (H, W) uint8 or uint16. The normals point down the gradient. No edges: an empty result.
    """
    image = (
        gray
        if gray.dtype == np.uint8
        else cv2.convertScaleAbs(gray, alpha=255.0 / full_scale(gray))
    )
    smooth = cv2.GaussianBlur(image, (5, 5), 1.0)
    dx = cv2.Sobel(smooth, cv2.CV_16S, 1, 0)
    dy = cv2.Sobel(smooth, cv2.CV_16S, 0, 1)
    v, u = np.nonzero(cv2.Canny(dx, dy, *_CANNY, L2gradient=True))
    gradient = np.stack([dx[v, u], dy[v, u]], axis=1).astype(np.float64)
    magnitude = np.linalg.norm(gradient, axis=1)
    px = np.stack([u, v], axis=1).astype(np.float64)
    return LimbCandidates(px, -gradient / magnitude[:, None], magnitude / 4.0)


def space_boundary_candidates(
    gray: np.ndarray, *, max_candidates: int = 600, mask: Mask | None = None, thin: bool = False
) -> LimbCandidates:
    """Edges that separate something bright from empty space.

    gray : (H, W) uint8 or uint16. An edge point is kept when the image falls across it, and stays
    at the level of space along its outward normal for as far as the frame reaches (40 working
    pixels at most; one sample in five may be a star, the Moon or a streak, and air glow may fade
    over the first few). Nor is a streak's edge that runs past the Sun kept. No such edge: an empty
    result. At most `max_candidates`, evenly thinned. What is masked is unknown, like what lies
    beyond the frame. thin : also the edges of what is only a few pixels wide, as stars and thin
    crescents are.
    """
    working = WorkingImage.of(gray, mask)
    return candidates_in(working, max_candidates=max_candidates, mask=mask, thin=thin)


def candidates_in(
    working: WorkingImage,
    *,
    max_candidates: int = 600,
    mask: Mask | None = None,
    thin: bool = False,
) -> LimbCandidates:
    """`space_boundary_candidates` of a frame that is reduced already."""
    factor, level = working.factor, working.space_level
    smooth = cv2.GaussianBlur(working.gray, (0, 0), 1.0)
    rank = -max(1, smooth.size // 700)
    bright = float(np.partition(smooth.ravel()[::7], rank)[rank])
    # Smoothing with sigma 1 leaves 0.28 of white noise; a step is believed from five sigma of that.
    step_min = max(5.0 * 0.28 * working.noise, 0.01 * (bright - level), 0.5)
    empty = LimbCandidates(pitch_px=float(factor))
    if bright - level < 3.0 * step_min:
        return empty

    found = _steep(smooth, bright - level, step_min)
    if found is None:
        return empty
    known = smooth
    if mask is not None:
        known = np.where(mask.reduced(factor), smooth, np.float32(np.nan))
    found, step = _beside_space(found, smooth, known - np.float32(level), level, step_min, thin)
    if mask is not None:
        centre = (np.stack([found.u, found.v], axis=1) + 0.5) * factor - 0.5
        keep = mask.clear(centre, _MASK_CLEARANCE_PX * factor)
        found, step = found.take(keep), step[keep]
    if len(step) == 0:
        return empty
    there = np.zeros(smooth.shape, dtype=np.uint8)
    there[found.v, found.u] = 1
    if len(step) > max_candidates:
        pick = evenly(len(step), max_candidates)
        found, step = found.take(pick), step[pick]
    px = (np.stack([found.u, found.v], axis=1) + 0.5) * factor - 0.5
    return LimbCandidates(
        px.astype(np.float64),
        np.stack([found.out_x, found.out_y], axis=1).astype(np.float64),
        step.astype(np.float64),
        float(factor),
        _outermost(found, there),
        factor * found.beyond_px(smooth),
    )


@dataclass(frozen=True, eq=False)
class _Edges:
    """Edge pixels u, v (N,) of the working image, and the unit steps (N,) out of the planet."""

    u: np.ndarray
    v: np.ndarray
    out_x: np.ndarray
    out_y: np.ndarray

    def take(self, keep: np.ndarray) -> _Edges:
        return _Edges(self.u[keep], self.v[keep], self.out_x[keep], self.out_y[keep])

    def along(self, bordered: np.ndarray, steps_px: np.ndarray) -> np.ndarray:
        """Nearest pixels (S, N) of an image with a border, at distances (S,) along the normals."""
        # Truncating what the border made positive rounds.
        start = np.float32(_BORDER_PX + 0.5)
        x = (steps_px[:, None] * self.out_x + (self.u + start)).astype(np.int32)
        y = (steps_px[:, None] * self.out_y + (self.v + start)).astype(np.int32)
        y *= np.int32(bordered.shape[1])
        y += x
        return bordered.ravel().take(y)

    def runs_past(self, place: tuple[float, float], within_px: float) -> np.ndarray:
        """Edges (N,) whose lines pass a place, x and y, within so many pixels."""
        across = (self.u - place[0]) * self.out_x + (self.v - place[1]) * self.out_y
        return np.asarray(np.abs(across) < within_px)

    def beyond_px(self, smooth: np.ndarray) -> np.ndarray:
        """How far (N,) outside these pixels a smoothed image falls most steeply."""
        x, y = (
            (at + _ACROSS_PX * out).astype(np.float32)
            for at, out in ((self.u, self.out_x), (self.v, self.out_y))
        )
        levels = cv2.remap(smooth, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        before, here, after = levels[:-2] - levels[2:]
        bend = np.minimum(before - 2.0 * here + after, np.float32(-1e-6))
        return np.minimum(np.maximum(0.5 * (before - after) / bend, -1.0), 1.0)


def _steep(smooth: np.ndarray, contrast: float, step_min: float) -> _Edges | None:
    """Edge pixels of a smoothed image, of steps of step_min and more; None if there are none.

    contrast : of what is brightest in it.
    """
    # Canny wants 16-bit gradients; scale so that the brightest frame still fits.
    scale = min(64.0, 8000.0 / max(contrast, 1.0))
    dx = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, ksize=3, scale=0.125 * scale)
    dy = cv2.Sobel(smooth, cv2.CV_32F, 0, 1, ksize=3, scale=0.125 * scale)
    # A step of height s blurred by sigma ~1.2 px has a slope of about s/3 a pixel.
    slope = step_min / 3.0 * scale
    edges = cv2.Canny(dx.astype(np.int16), dy.astype(np.int16), slope, 2.0 * slope, L2gradient=True)
    edges[:2], edges[-2:], edges[:, :2], edges[:, -2:] = 0, 0, 0, 0
    spots = np.flatnonzero(edges.ravel() != 0)
    if len(spots) == 0:
        return None
    v, u = np.divmod(spots.astype(np.int32), np.int32(smooth.shape[1]))
    gx, gy = dx.ravel().take(spots), dy.ravel().take(spots)
    magnitude = np.sqrt(gx * gx + gy * gy)
    return _Edges(u, v, -gx / magnitude, -gy / magnitude)


def _beside_space(
    found: _Edges,
    smooth: np.ndarray,
    above: np.ndarray,
    level: float,
    step_min: float,
    thin: bool,
) -> tuple[_Edges, np.ndarray]:
    """Edges that have something bright inside and empty space outside, and their steps (N,).

    above : (h, w) the smoothed image over the level of space, NaN where nothing is known. thin : as
    of `space_boundary_candidates`.
    """
    # Inside stays bright for a few pixels: stars and thin streaks do not.
    beside = _with_border(above, np.nan)
    step, deep = found.along(beside, _INWARD_STEPS_PX)
    keep = step > step_min
    if not thin:
        keep &= ~(deep <= np.maximum(0.5 * step_min, _RIDGE_SHARE * step))
    found, step, deep = found.take(keep), step[keep], deep[keep]
    # Outside is space along the whole way, but for one place; beyond the frame nothing is known.
    for look in (slice(_FIRST_LOOK), slice(None)):
        outside = found.along(beside, _OUTWARD_STEPS_PX[look])
        bright_there = outside > np.maximum(_GLOW_LEFT[look, None] * step, step_min)
        num_bright = bright_there.sum(axis=0)
        keep = num_bright <= 1
        if look.stop is None:
            seen = np.isfinite(outside).sum(axis=0)
            keep = (seen >= 3) & (num_bright <= 0.2 * seen)
            far = outside[_FIRST_LOOK - 1]
            ridge = keep & (deep - far < _STREAK_SHARE * (step - far))
            sun = _sun(smooth, level) if np.count_nonzero(ridge) >= _LEAST_STREAK else None
            if sun is not None:
                keep &= ~(ridge & found.runs_past(sun, _PAST_SUN_PX))
        found, step, deep = found.take(keep), step[keep], deep[keep]
    return found, step


def _sun(smooth: np.ndarray, level: float) -> tuple[float, float] | None:
    """Middle of what is brightest in a smoothed image, x and y, if that is one compact spot."""
    thin = smooth[::2, ::2]
    bright = thin > level + 0.9 * (float(thin.max()) - level)
    if not _SUN_PX[0] <= 4 * np.count_nonzero(bright) <= _SUN_PX[1]:
        return None
    v, u = np.nonzero(bright)
    x, y = 2.0 * median(u), 2.0 * median(v)
    near = np.count_nonzero(np.hypot(2.0 * u - x, 2.0 * v - y) < _NEAR_SUN_PX)
    return (x, y) if near > _SUN_SHARE * len(u) else None


def _with_border(image: np.ndarray, value: float) -> np.ndarray:
    return cv2.copyMakeBorder(image, *(_BORDER_PX,) * 4, cv2.BORDER_CONSTANT, value=value)


def _outermost(found: _Edges, there: np.ndarray) -> np.ndarray:
    """Candidates (N,) with no other one farther out along their normals: a cloud's has the limb."""
    near = _with_border(cv2.dilate(there, np.ones((3, 3), dtype=np.uint8)), 0)
    return np.asarray(~found.along(near, _FARTHER_PX).any(axis=0))
