"""Limb that several cameras see: what the ground beside it does to edges, it does in all of them.

Noise is each camera's own, but edges are mostly as good as texture lets them be. All of their
errors are taken to be the same, so that two cameras that look the same way know what one of them
does. Derived here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations

import numpy as np

from horizon_sensor_ros.core.fits.limb_rays import LimbRays
from horizon_sensor_ros.core.mathematics.attitude import tangent_basis
from horizon_sensor_ros.core.mathematics.robust import median

_POINTS = 4.0  # of the camera with the fewest, to a stretch: all that see it have some there


def common_stretches(nadir_base: np.ndarray, cameras: Sequence[LimbRays]) -> list[np.ndarray]:
    """Stretch of limb (N,) that each point of each camera lies in, counted about nadir (3,); empty
    where no two cameras see one together.
    """
    if len(cameras) < 2:
        return []
    basis = tangent_basis(nadir_base)
    across = [rays.rays_base @ basis for rays in cameras]
    azimuths = [np.arctan2(each[:, 1], each[:, 0]) for each in across]
    gaps = [np.diff(np.sort(each)) for each in azimuths]
    apart = max((median(each) for each in gaps if len(each)), default=0.0)
    per_rad = 1.0 / max(_POINTS * apart, 1e-3)
    stretches = [np.floor((each + math.pi) * per_rad).astype(int) for each in azimuths]
    seen = np.concatenate([np.unique(each) for each in stretches])
    return stretches if len(np.unique(seen)) < len(seen) else []


def of_same_limb(stretches: Sequence[np.ndarray], moved: Sequence[np.ndarray]) -> np.ndarray:
    """What a covariance (3, 3) of independent cameras lacks where these see the same limb.

    stretches : (N,) of each camera, as of `common_stretches`. moved : (N, 3) of each, how a sigma
    of each point moves the fit. Of a stretch each camera's points are off independently, and by
    their mean as the other cameras' are.
    """
    cov = np.zeros((3, 3))
    if not stretches:
        return cov
    most = 1 + max(int(each.max()) for each in stretches)
    means = []
    for stretch, by_sigma in zip(stretches, moved, strict=True):
        total = np.stack([np.bincount(stretch, each, most) for each in by_sigma.T], axis=1)
        num = np.bincount(stretch, minlength=most)
        means.append(total / np.sqrt(np.maximum(num, 1))[:, None])
    for one, other in combinations(means, 2):
        both = one.T @ other
        cov += both + both.T
    return cov
