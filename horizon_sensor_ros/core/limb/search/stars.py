"""Stars in a frame: what only an exposure for the night shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.limb.search.working_image import WorkingImage

NIGHT_STARS = 8  # that show an exposure for the night
_SIGMAS = 8.0  # of noise that a star stands above what is around it
# A lens spreads a star's light over the pixels beside it, of which the four nearest get a third of
# the brightest one's and more before lenses that blur by .3 px and more; a hot pixel is alone.
_SPREAD = 0.2
_DARK = 0.1  # dark spots a bright one, more than which are not of the sky
_AROUND_PX = 3  # pixels about a spot, of which most are dark


def shows_stars(
    views: Sequence[CameraView],
    working: Sequence[WorkingImage],
    nadir_base: np.ndarray,
    beyond_rad: float,
    least: int = NIGHT_STARS,
) -> bool:
    """Whether any working image shows so many stars, `count_stars`; arguments as of that."""
    return any(
        count_stars(view, image, nadir_base, beyond_rad) >= least
        for view, image in zip(views, working, strict=True)
    )


def count_stars(
    view: CameraView, working: WorkingImage, nadir_base: np.ndarray, beyond_rad: float
) -> int:
    """How many spots of a pixel or two there are in the working image farther than beyond_rad from
    nadir_base (3,).

    Hot pixels and lamps of the craft count like stars.
    """
    return len(_spots_px(view, working, nadir_base, beyond_rad))


def spread_stars(
    gray: np.ndarray,
    view: CameraView,
    working: WorkingImage,
    nadir_base: np.ndarray,
    beyond_rad: float,
) -> int:
    """How many of the spots that `count_stars` counts can be stars, by how the lens spreads light
    over pixels of the frame (H, W): 0 where they are hot pixels mostly, but for those that
    demosaicing has spread, or compression's; or where they are less than `NIGHT_STARS`.
    """
    px = _spots_px(view, working, nadir_base, beyond_rad)
    if len(px) < NIGHT_STARS:
        return 0
    # Compression leaves dark spots beside the bright ones.
    negative = replace(working, gray=-working.gray.astype(np.float32))
    if len(_spots_px(view, negative, nadir_base, beyond_rad)) > _DARK * len(px):
        return 0
    spread = _spread(gray, px, working.factor)
    return len(spread) if len(spread) and np.median(spread) > _SPREAD else 0


def _spread(gray: np.ndarray, px: np.ndarray, factor: int) -> np.ndarray:
    """Light of the four pixels nearest to the brightest one of each spot, over that one's (M,); of
    spots at px (N, 2) of a frame, reduced by `factor`, but for those near its border.
    """
    reach = _AROUND_PX + factor
    height, width = gray.shape
    x, y = np.floor(px.T - 0.5 * (factor - 1) + 0.5).astype(int)
    inside = (x >= reach) & (y >= reach) & (x < width - reach) & (y < height - reach)
    x, y = x[inside], y[inside]
    step_y, step_x = np.indices((factor, factor)).reshape(2, -1)
    brightest = gray[y[:, None] + step_y, x[:, None] + step_x].argmax(axis=1)
    x, y = x + step_x[brightest], y + step_y[brightest]
    beside = np.arange(-_AROUND_PX, _AROUND_PX + 1)
    around = gray[y[:, None, None] + beside[:, None], x[:, None, None] + beside].astype(float)
    around -= np.median(around, axis=(1, 2))[:, None, None]
    at, to = _AROUND_PX, np.array([-1, 1])
    nearest = around[:, at + to, at].sum(axis=1) + around[:, at, at + to].sum(axis=1)
    return np.asarray(nearest / np.maximum(around[:, at, at], 1e-6))


def _spots_px(
    view: CameraView, working: WorkingImage, nadir_base: np.ndarray, beyond_rad: float
) -> np.ndarray:
    """Where `count_stars` sees them: pixels (N, 2) of the frame."""
    small = working.gray
    if min(small.shape) < 5:
        return np.empty((0, 2))
    middle = small[2:-2, 2:-2]
    around = np.maximum(small[:-4, 2:-2], small[4:, 2:-2])
    for farther in (small[2:-2, :-4], small[2:-2, 4:]):
        np.maximum(around, farther, out=around)
    bright = middle > around + _SIGMAS * working.noise
    y, x = np.divmod(np.flatnonzero(bright), bright.shape[1])
    beside = [small[y + 1, x + 2], small[y + 3, x + 2], small[y + 2, x + 1], small[y + 2, x + 3]]
    brightest = (middle[y, x] >= beside).all(axis=0)
    y, x = y[brightest], x[brightest]
    px = (np.stack([x, y], axis=1) + 2.5) * working.factor - 0.5
    if view.mask is not None:
        px = px[view.mask.clear(px, working.factor)]
    rays = view.camera.rays(px)
    with np.errstate(invalid="ignore"):
        in_the_sky = rays @ (view.rot_base_from_cam.T @ nadir_base) < np.cos(beyond_rad)
    return np.asarray(px[in_the_sky])
