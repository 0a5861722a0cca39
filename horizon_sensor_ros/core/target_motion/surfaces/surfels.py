"""Surface elements of a range image: points with normals, and bare returns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from horizon_sensor_ros.core.target_motion.ranges.range_image import RangeImage
from horizon_sensor_ros.core.target_motion.surfaces.planes import Planes


@dataclass(frozen=True, eq=False)
class Surfels:
    """N observations "this point lies on this plane": ``normal . (x - point) = 0`` within
    ``sigma_m``.

    points, normals : (N, 3).  sigma_m : (N,) of one raw measurement.  weight : (N,) raw
        measurements that each stands for.
    tilt_rad : (N,) error of the normal that is alike in both views; 0 of bare returns.
    off_px : (N,) where in its pixel it lies, see `Planes`; in ``sigma_m`` of planes already.
    The first ``num_planes`` come from planes, not those at the limb of a curved body, which tell
    nothing but how it is seen; the others are bare returns where there is no plane
    (thin parts, slants too steep for the window, corners). Those have normal 0: they take over
    that of the other view's plane, with its noise.
    """

    points: np.ndarray
    normals: np.ndarray
    sigma_m: np.ndarray
    weight: np.ndarray
    tilt_rad: np.ndarray
    off_px: np.ndarray
    num_planes: int


def find_surfels(
    image: RangeImage, planes: Planes, tilt: np.ndarray, noise_m: np.ndarray
) -> Surfels:
    """Planes on a lattice thin enough to keep their number moderate, and bare returns.

    tilt (H W,), rad : `Surfels.tilt_rad` of the planes at the image's pixels. noise_m (H W,) :
        their sigmas.
    """
    width = planes.found.shape[1]
    index = np.flatnonzero(planes.found & ~planes.limb)
    share = 1
    if len(index) > 1200:
        row, column = np.divmod(index, width)
        # Neighbours share most of their window anyway.
        keep = (row + column) % 2 == 0
        share = 2
        if len(index) > 4800:
            step = 2 * int(np.ceil(np.sqrt(len(index) / 6000)))
            keep = (row % step == 0) & (column % step == 0)
            share = step * step
        index = index[keep]
    bare = np.flatnonzero((image.inverse_depth > 0) & ~planes.found)
    step = 1 + len(bare) // 800
    bare = bare[::step]
    both = np.concatenate([index, bare])
    weight, sigma, lean = np.empty((3, len(both)), np.float32)
    # Planes of both views are matched with each other twice, once in each direction.
    weight[: len(index)], weight[len(index) :] = share / 2, step
    sigma[: len(index)], sigma[len(index) :] = noise_m[index], planes.sigma_m
    lean[: len(index)], lean[len(index) :] = tilt[index], 0
    points, normals = planes.points.take(both, axis=0), planes.normals.take(both, axis=0)
    return Surfels(points, normals, sigma, weight, lean, planes.off_px[both], len(index))
