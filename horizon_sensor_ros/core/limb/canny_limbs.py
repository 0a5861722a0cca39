"""Whole-pixel limb points, as the papers have them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.limb.search.candidates import canny_candidates
from horizon_sensor_ros.core.limb.search.selection import MIN_INLIERS
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.status import Status

_REACH_PX = 2.0


def canny_limbs(
    views: Sequence[CameraView],
    images: Sequence[np.ndarray],
    nadir_base: np.ndarray,
    rho_rad: float,
) -> tuple[LimbPoints, ...]:
    """Whole-pixel limb points as in the papers: the Canny edges within two pixels of the predicted
    limb; one result a view, NO_LIMB where too few lie there.

    images : (H, W) uint8 or uint16. nadir_base, rho_rad : (3,) and radius of the predicted cone.
    """
    limbs = []
    for view, image in zip(views, images, strict=True):
        edges = canny_candidates(image)
        nadir = view.rot_base_from_cam.T @ nadir_base
        rays = view.camera.rays(edges.px)
        ahead = view.camera.rays(edges.px + edges.normal_px)
        with np.errstate(invalid="ignore"):
            angle = np.arccos(np.clip(rays @ nadir, -1.0, 1.0))
            per_px = np.arccos(np.clip(ahead @ nadir, -1.0, 1.0)) - angle
            keep = (per_px > 0) & (np.abs(angle - rho_rad) < _REACH_PX * per_px)
            if view.mask is not None:
                keep &= view.mask.clear(edges.px, _REACH_PX)
        if keep.sum() < MIN_INLIERS:
            reason = f"{int(keep.sum())} Canny edges near the limb"
            limbs.append(LimbPoints.none(Status.NO_LIMB, reason))
            continue
        # Rounding to whole pixels: a uniform error of one pixel's width.
        sigma = np.full(int(keep.sum()), 1.0 / np.sqrt(12.0))
        limbs.append(LimbPoints(Status.OK, "", edges.px[keep], edges.normal_px[keep], sigma))
    return tuple(limbs)
