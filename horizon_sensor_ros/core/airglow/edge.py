"""The upper edge of the night's airglow in one frame: a limb of its own, without any texture.

The layer lies at the same height for thousands of kilometres, and its light falls off within a few
above it. Where that is steepest does not go with how bright it is, which changes along the limb.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.limb.profiles import pixel_rad_across, sample_profiles, scatter_px
from horizon_sensor_ros.core.limb.sample import thinning
from horizon_sensor_ros.core.limb_curve import LimbCurve, limb_curve
from horizon_sensor_ros.core.limb_points import LimbPoints, SharedError
from horizon_sensor_ros.core.mathematics.robust import median
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.status import Status

# Height of the edge above the ground: that of the green line's layer, and half of its thickness.
# Where it is looked for besides: as far as it may be higher or lower, and the limb below it off.
AIRGLOW_HEIGHT_M, _REACH_M = 97e3, 35e3
_LEAST_REACH_PX = 3.0
_MOST_M_PER_PX = 15e3  # coarser pixels show a line
_BLUR_M, _LEAST_BLUR_PX = 3e3, 1.0  # light is smoothed by before its fall is asked for
_TOGETHER = 8  # neighbouring profiles whose median counts as one, without stars
_LEAST_EDGES, _MOST_SCATTER_M, _GLANCE_SCATTER_M = 8, 6e3, 14e3
_LEAST_SIGMA_PX = 0.05
# Sigmas of the layer's height: of stretches, of ends one up and one down, and of all that one
# camera sees. Six stretches each of five photographs from the ISS were off the cone that was fitted
# by 0.1 to 0.9 km, which takes half of their variance; tides tilt the layer by kilometres in a
# thousand, which no cone shows.
_STRETCH_M, _ENDS_M, _ALL_M = 1.5e3, 3e3, 3e3


def sphere_of_airglow(planet: Planet) -> Planet:
    """The sphere whose limb the airglow's upper edge is."""
    return Planet(planet.radius_m + AIRGLOW_HEIGHT_M)


def airglow_edge(
    gray: np.ndarray, view: CameraView, nadir_base: np.ndarray, rho_rad: float, planet: Planet
) -> LimbPoints:
    """Find the airglow's upper edge above a limb with airglow above it, nadir (3,) and rho.

    gray : (H, W). As points of a limb of `sphere_of_airglow`, a few pixels apart, that share what
    the layer may be off by. NO_LIMB where it does not show, or is too thin.
    """
    from_centre_m = planet.limb_radius_m / math.sin(rho_rad)
    layer_rho = sphere_of_airglow(planet).rho_from_altitude(
        from_centre_m - planet.radius_m - AIRGLOW_HEIGHT_M
    )
    if not math.isfinite(layer_rho):
        return LimbPoints.none(Status.NO_LIMB, "the camera is in the airglow or below")
    spacing_px = thinning(gray)
    curve = limb_curve(view, nadir_base, layer_rho, spacing_px=spacing_px)
    num = len(curve) // _TOGETHER
    if num < _LEAST_EDGES:
        return LimbPoints.none(Status.NO_LIMB, "hardly any airglow in the frame")
    few = curve.thinned(_TOGETHER * spacing_px)
    px_rad = median(pixel_rad_across(view, few.px, few.normal_px))
    px_m = from_centre_m * math.cos(layer_rho) * px_rad
    if not px_m < _MOST_M_PER_PX:
        return LimbPoints.none(Status.NO_LIMB, "too far off to see the airglow's edge")
    blur_px = max(_LEAST_BLUR_PX, _BLUR_M / px_m)
    reach_px = max(_LEAST_REACH_PX, _REACH_M / px_m)
    step_px = blur_px  # sampled as finely as it is smoothed
    count = math.ceil(reach_px / step_px) + 1
    d_px = step_px * np.arange(-count, count + 1)
    # Without airglow the steepest falls are the noise's, and lie anywhere: single profiles show it.
    glance_px, inside = _places(gray, few, d_px, 1)
    inside &= _clear(view, few.px, reach_px)
    if not scatter_px(glance_px[inside]) * px_m < _GLANCE_SCATTER_M:
        return LimbPoints.none(Status.NO_LIMB, "no edge of airglow")
    offset_px, inside = _places(gray, curve, d_px, _TOGETHER)
    used = num * _TOGETHER
    clear = _clear(view, curve.px[:used], reach_px)
    inside &= clear.reshape(num, _TOGETHER).all(axis=1)
    offset_px = offset_px[inside]
    own_px = scatter_px(offset_px)
    if len(offset_px) < _LEAST_EDGES or not own_px * px_m < _MOST_SCATTER_M:
        return LimbPoints.none(Status.NO_LIMB, "no edge of airglow")
    middle = np.arange(_TOGETHER // 2, used, _TOGETHER)[inside]
    normal_px = curve.normal_px[middle]
    return LimbPoints(
        Status.OK,
        px=curve.px[middle] + offset_px[:, None] * normal_px,
        normal_px=normal_px,
        sigma_px=np.full(len(middle), max(own_px, _LEAST_SIGMA_PX)),
        shared=SharedError(_STRETCH_M / px_m, _ALL_M / px_m, _ENDS_M / px_m),
        spacing_px=_TOGETHER * spacing_px,
        predicted=curve,
        offset_px=offset_px,
    )


def _clear(view: CameraView, px: np.ndarray, reach_px: float) -> np.ndarray:
    """Whether the mask hides nothing so near to places (N, 2): (N,)."""
    if view.mask is None:
        return np.ones(len(px), dtype=bool)
    return view.mask.clear(px, reach_px)


def _places(
    gray: np.ndarray, curve: LimbCurve, d_px: np.ndarray, together: int
) -> tuple[np.ndarray, np.ndarray]:
    """Where light falls off most steeply in medians of profiles, so many each: places (M,) among
    d_px (J,), and whether they are inside these, and of profiles inside the frame.
    """
    num = len(curve) // together
    used = num * together
    profiles, valid = sample_profiles(gray, curve, d_px)
    level = profiles[:used]
    if together > 1:
        level = np.median(level.reshape(num, together, len(d_px)), axis=1)
    smooth = cv2.GaussianBlur(level, (7, 1), 1.0)
    offset_px, inside = _steepest(smooth[:, :-2] - smooth[:, 2:], d_px[1:-1])
    return offset_px, inside & valid[:used].reshape(num, together).all(axis=1)


def _steepest(fall: np.ndarray, d_px: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where values (N, J) at even places (J,) are largest, (N,), and whether that is inside."""
    at = fall.argmax(axis=1)
    inside = (at > 0) & (at < len(d_px) - 1)
    row, at = np.arange(len(fall)), np.clip(at, 1, len(d_px) - 2)
    before, here, after = (fall[row, at + step].astype(float) for step in (-1, 0, 1))
    bend = before - 2.0 * here + after
    inside &= bend < 0.0
    beside = 0.5 * (before - after) / np.where(inside, bend, -1.0)
    return d_px[at] + beside * (d_px[1] - d_px[0]), inside
