"""How motion smears a limb, where exposure and angular rate are known.

A point of the limb moves across it by the rate times the exposure; a turn about nadir, which no
limb tells of, moves it along itself.
Source: derived here.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.limb.edge.width import BOX, NO_SMEAR, Smear, smear_from_parts
from horizon_sensor_ros.core.limb_curve import limb_curve

_SPACINGS = 100  # of points, to the length of a frame
_LEAST_POINTS = 6
# One sigma of a smear's length up to which the rate tells it better than the frame does.
_KNOWN_PX = 0.5


def told_smear(view: CameraView, nadir_base: np.ndarray, rho_rad: float) -> Smear | None:
    """Smear of the limb near a cone by what is told of the camera (`CameraView.exposure_s`) and of
    the craft's rate; None where it is not known, `NO_SMEAR` where hardly any limb is in sight.

    nadir_base, rho_rad : (3,) and radius of the cone.
    """
    rate = view.rate
    if view.exposure_s == 0.0 or rate is None:
        return None
    spacing_px = max(view.camera.width, view.camera.height) / _SPACINGS
    curve = limb_curve(view, nadir_base, rho_rad, spacing_px=spacing_px)
    if len(curve) < _LEAST_POINTS:
        return NO_SMEAR
    turn_cam_rad = view.exposure_s * (rate.rate_base_rad_s @ view.rot_base_from_cam)
    rays = view.camera.rays(curve.px)
    # What stands still outside moves by -turn x ray.
    moved_px = view.camera.project_along(rays, np.cross(rays, turn_cam_rad))[1]
    across_px = np.einsum("ni,ni->n", moved_px, curve.normal_px)
    known = np.isfinite(across_px)
    sigma_px = view.exposure_s * rate.sigma_rad_s / view.camera.pixel_rad
    if np.count_nonzero(known) < _LEAST_POINTS or sigma_px > _KNOWN_PX:
        return None
    smear = smear_from_parts(curve.normal_px[known], np.square(across_px[known]))
    # The square of a length is off by twice the length times its error.
    by_rate2 = 2.0 * smear.across_px * sigma_px / BOX
    return replace(smear, open_px2=math.hypot(smear.open_px2, by_rate2), boxed=True)
