"""Stars in a frame: what only an exposure for the night shows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from horizon_sensor_ros.core.camera_view import CameraView
from horizon_sensor_ros.core.limb.search.working_image import WorkingImage

NIGHT_STARS = 8  # that show an exposure for the night
_SIGMAS = 8.0  # of noise that a star stands above what is around it


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
    small = working.gray
    if min(small.shape) < 5:
        return 0
    middle = small[2:-2, 2:-2]
    around = np.maximum.reduce(
        [small[:-4, 2:-2], small[4:, 2:-2], small[2:-2, :-4], small[2:-2, 4:]]
    )
    beside = np.maximum.reduce(
        [small[1:-3, 2:-2], small[3:-1, 2:-2], small[2:-2, 1:-3], small[2:-2, 3:-1]]
    )
    y, x = np.nonzero((middle >= beside) & (middle > around + _SIGMAS * working.noise))
    px = (np.stack([x, y], axis=1) + 2.5) * working.factor - 0.5
    if view.mask is not None:
        px = px[view.mask.clear(px, working.factor)]
    rays = view.camera.rays(px)
    with np.errstate(invalid="ignore"):
        in_the_sky = rays @ (view.rot_base_from_cam.T @ nadir_base) < np.cos(beyond_rad)
    return int(np.count_nonzero(in_the_sky))
