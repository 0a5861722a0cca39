"""Stars in a frame: what only an exposure for the night shows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from horizon_sensor_ros.core.camera_view import CameraView
from horizon_sensor_ros.core.limb.search.candidates import LimbCandidates

NIGHT_STARS = 8  # that show an exposure for the night
_SIGMAS = 8.0  # of noise that a star stands above what is around it


def shows_stars(
    views: Sequence[CameraView],
    searched: Sequence[LimbCandidates],
    nadir_base: np.ndarray,
    beyond_rad: float,
    least: int = NIGHT_STARS,
) -> bool:
    """Whether any frame, as the search has it, shows so many stars farther from nadir than this."""
    return any(
        count_stars(view, seen, nadir_base, beyond_rad) >= least
        for view, seen in zip(views, searched, strict=True)
    )


def count_stars(
    view: CameraView, seen: LimbCandidates, nadir_base: np.ndarray, beyond_rad: float
) -> int:
    """How many spots of a pixel or two there are in the reduced image farther from nadir than this.

    Hot pixels and lamps of the craft count like stars.
    """
    small = seen.reduced
    if min(small.shape) < 5:
        return 0
    middle = small[2:-2, 2:-2]
    around = np.maximum.reduce(
        [small[:-4, 2:-2], small[4:, 2:-2], small[2:-2, :-4], small[2:-2, 4:]]
    )
    beside = np.maximum.reduce(
        [small[1:-3, 2:-2], small[3:-1, 2:-2], small[2:-2, 1:-3], small[2:-2, 3:-1]]
    )
    y, x = np.nonzero((middle >= beside) & (middle - around > _SIGMAS * seen.noise))
    px = (np.stack([x, y], axis=1) + 2.5) * seen.pitch_px - 0.5
    if view.mask is not None:
        px = px[view.mask.clear(px, seen.pitch_px)]
    rays = view.camera.rays(px)
    with np.errstate(invalid="ignore"):
        in_the_sky = rays @ (view.rot_base_from_cam.T @ nadir_base) < np.cos(beyond_rad)
    return int(np.count_nonzero(in_the_sky))
