"""A disc in the sky beside a larger one: the Moon, say, beside the planet's thin crescent.

A whole disc that is lit all over has more of an edge than a crescent, and wins the vote. But the
planet is the nearest body: whatever else shows beside it is smaller.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.limb.search.candidates import candidates_in
from horizon_sensor_ros.core.limb.search.selection import limb_consensus, rays_of_candidates
from horizon_sensor_ros.core.limb.search.working_image import WorkingImage
from horizon_sensor_ros.core.mathematics.attitude import angle_rad
from horizon_sensor_ros.core.status import Status


def larger_disc_rad(
    views: Sequence[CameraView],
    working: Sequence[WorkingImage],
    nadir_base: np.ndarray,
    rho_rad: float,
    rho_max_rad: float,
) -> float | None:
    """Angular radius of a larger disc beside the one that was taken for the planet's, cone of
    nadir_base (3,) and rho_rad; None where none shows.

    views, working : of all frames. rho_max_rad : of the lowest altitude. A disc counts whose limb
    shows along more than the other one is wide, and within which that does not lie: what surrounds
    a planet are layers of its air.
    """
    wide_rad = 2.0 * rho_rad
    if wide_rad > max(_field_rad(view) for view in views):
        return None
    candidates = rays_of_candidates(
        views,
        [
            candidates_in(image, mask=view.mask, thin=True)
            for view, image in zip(views, working, strict=True)
        ],
    )
    beyond = candidates.take(candidates.outside(nadir_base, rho_rad))
    if beyond.pitch_rad.sum() < wide_rad:
        return None
    other = limb_consensus(beyond, rho_min_rad=rho_rad, rho_max_rad=rho_max_rad)
    if other.status is not Status.OK or beyond.pitch_rad[other.inliers].sum() < wide_rad:
        return None
    apart_rad = angle_rad(other.nadir_base, nadir_base)
    return other.rho_rad if apart_rad > other.rho_rad else None


def _field_rad(view: CameraView) -> float:
    """What a camera sees across at most, about."""
    camera = view.camera
    return camera.pixel_rad * math.hypot(camera.width, camera.height)
