"""The best published sub-pixel edge: a blurred step on a sloped inside, profile by profile.

Profiles across the true limb, +-7 px in half pixels, cubic sampling; each is fitted by variable
projection: for every place of the edge the background, the step and the slope inside follow
linearly, and the place with the least cost is taken.
"""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from scipy.special import ndtr

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.fits import fit_horizon
from horizon_sensor_ros.core.fits.observation import LimbObservation
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.sim.frame_truth import FrameTruth

_D_PX = np.arange(-7.0, 7.25, 0.5)
_PLACES_PX = np.arange(-2.0, 2.01, 0.05)
_SIGMA_PX = 0.03  # of an edge; the same for all


def sloped_step_fit(
    gray: np.ndarray, view: CameraView, truth: FrameTruth, psf_px: float
) -> HorizonFit:
    """Robust fit of the edges found about the true limb. gray : (H, W) of the one camera.

    psf_px : blur of PSF and pixel together.
    """
    step = np.linalg.norm(np.diff(truth.limb.px, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(step)])
    each_pixel = np.unique(np.searchsorted(along, np.arange(0.0, along[-1])))
    px, normal = truth.limb.px[each_pixel], truth.limb.normal_px[each_pixel]
    at = px[:, None] + _D_PX[:, None] * normal[:, None]
    border = np.array([view.camera.width, view.camera.height]) - 3.0
    inside = ((at > 2.0) & (at < border)).all(axis=(1, 2))
    px, normal, at = px[inside], normal[inside], at[inside].astype(np.float32)
    profiles = cv2.remap(gray.astype(np.float32), at[..., 0], at[..., 1], cv2.INTER_CUBIC, None)
    offset = _places(profiles.astype(float), psf_px)
    points = LimbPoints(
        Status.OK, "", px + offset[:, None] * normal, normal, np.full(len(px), _SIGMA_PX)
    )
    return fit_horizon([LimbObservation(view, points)], truth.planet)


def _places(profiles: np.ndarray, psf_px: float) -> np.ndarray:
    """Places (N,) of the edge with the least cost, by a parabola through the cost there."""
    explained = np.square(np.einsum("gjk,nj->ngk", _bases(psf_px), profiles)).sum(axis=2)
    best = np.clip(explained.argmax(axis=1), 1, len(_PLACES_PX) - 2)
    row = np.arange(len(profiles))
    before, top, after = (explained[row, best + k] for k in (-1, 0, 1))
    bend = np.minimum(before - 2.0 * top + after, -1e-12)
    pitch = _PLACES_PX[1] - _PLACES_PX[0]
    return _PLACES_PX[best] + pitch * np.clip(0.5 * (before - after) / bend, -1.0, 1.0)


@lru_cache(maxsize=4)
def _bases(psf_px: float) -> np.ndarray:
    """Orthonormal bases (G, J, 3) of background, step and slope for each place of the edge."""
    depth = (_PLACES_PX[:, None] - _D_PX) / psf_px
    law = np.exp(-0.5 * depth * depth) / np.sqrt(2.0 * np.pi)
    model = np.stack([np.ones_like(depth), ndtr(depth), depth * ndtr(depth) + law], axis=2)
    return np.linalg.qr(model)[0]
