"""Discs that the Sun draws where there is no planet: itself, overexposed; its halo's rings; ghosts.

They are as round as a planet from far away. But a planet ends in a step, and is lit by the Sun.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.limb.air import usual_length_px
from horizon_sensor_ros.core.limb.search.working_image import WorkingImage

# The largest disc that was taken for a planet where there was only the Sun: from 9000 km.
LARGEST_RAD = math.radians(24.5)
# Where ground and sky beside an edge are looked at, working pixels outwards.
_GROUND_PX = -1.5, -3.0
_SKY_PX = 2.5
_SCALE_HEIGHTS = 4.0  # of air: the sky is looked at no nearer than so many
# Light that is still there beyond the edge, over the step: of 450 simulated planets, and of the
# whole Earth in photographs, .02 at most.
_MOST_BEYOND = 0.1
_SIGMAS = 3.0  # of noise, which that has to be above as well
# The Sun in the frame.
_BRIGHTER = 1.4  # than what it lights, at least
_LEAST_SUN_PX = 30  # working pixels of it, at least; a star or a lamp has fewer
_DARK = math.sin(math.radians(-6.0))  # sine of its height, below which it leaves ground dark
_MOST_DARK = 0.1  # share of a planet's edge that shows though the Sun leaves it dark
# A ring about the Sun is dark inside; no planet's lit limb is so thin.
_INWARDS = 0.3  # of the radius: so far inside the edge it is asked
_HOLLOW = 0.3  # brightness there over the step, less than


def sun_artefact(
    limb_px: np.ndarray, seen: WorkingImage, view: CameraView, nadir_base: np.ndarray, rho: float
) -> str:
    """Why a disc is no planet but made by the Sun; empty where nothing says so.

    limb_px : (N, 2) edges found, raw pixels. seen : the frame as the search has it. rho : radius
    of the disc, rad; none above `LARGEST_RAD` is asked about.
    """
    if rho > LARGEST_RAD or len(limb_px) == 0:
        return ""
    nadir = view.rot_base_from_cam.T @ nadir_base
    rays = view.camera.rays(limb_px)
    outward = rays - (rays @ nadir)[:, None] * nadir
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    pitch_rad = seen.factor * view.camera.pixel_rad

    def level(beside_px: float) -> np.ndarray:
        """Brightness over space beside each edge; NaN outside the frame."""
        at = rho + beside_px * pitch_rad
        px = view.camera.pixels(math.cos(at) * nadir + math.sin(at) * outward)
        return _levels(seen, view, px)

    air_px = _SCALE_HEIGHTS * usual_length_px(view, rho) / seen.factor
    ground = np.fmax(*(level(beside_px) for beside_px in _GROUND_PX))
    beyond = level(max(_SKY_PX, air_px))
    known = np.isfinite(ground) & np.isfinite(beyond)
    if not known.any():
        return ""
    step, left = float(np.median(ground[known])), float(np.median(beyond[known]))
    if not step > 0.0:
        return ""  # no planet either, which others say
    sun = _sun(seen, view, _BRIGHTER * step)
    if sun is not None and float(sun @ nadir) < math.cos(rho):
        # Sine of the Sun's height above the horizon of the ground that is seen at each edge.
        height = math.cos(rho) * (outward @ sun) - math.sin(rho) * float(nadir @ sun)
        dark = float(np.mean(height < _DARK))
        if dark > _MOST_DARK:
            return f"a ghost, not a planet: the Sun in sight does not light {dark:.0%} of its edge"
        return ""
    noise = seen.noise / math.sqrt(np.count_nonzero(known))
    if left > max(_MOST_BEYOND * step, _SIGMAS * noise):
        return f"glare, not a planet: {left / step:.0%} of its light is still there beyond its edge"
    if sun is not None and float(sun @ nadir) > math.cos(0.5 * rho):
        inside = level(-_INWARDS * rho / pitch_rad)
        inside = inside[np.isfinite(inside)]
        if len(inside) and float(np.median(inside)) < _HOLLOW * step:
            return "a ring about the Sun, not a planet"
    return ""


def _levels(seen: WorkingImage, view: CameraView, px: np.ndarray) -> np.ndarray:
    """Brightness (N,) over space at raw pixels (N, 2); NaN outside the frame and on the mask."""
    small = seen.gray
    height, width = small.shape
    with np.errstate(invalid="ignore"):
        x, y = np.floor((px.T + 0.5) / seen.factor)
        inside = (x >= 0.0) & (x < width) & (y >= 0.0) & (y < height)
    if view.mask is not None:
        inside &= view.mask.clear(np.where(inside[:, None], px, 0.0), seen.factor)
    x, y = np.where(inside, (x, y), 0.0).astype(np.intp)
    return np.where(inside, small[y, x] - np.float32(seen.space_level), np.nan)


def _sun(seen: WorkingImage, view: CameraView, brighter: float) -> np.ndarray | None:
    """Direction (3,) in the camera of what may be the Sun; None if nothing is.

    brighter : than what, over space.
    """
    bright = (seen.gray > seen.space_level + brighter).astype(np.uint8)
    if view.mask is not None:
        bright &= view.mask.reduced(seen.factor)
    if cv2.countNonZero(bright) < _LEAST_SUN_PX:
        return None
    _, _, stats, centres = cv2.connectedComponentsWithStats(bright)
    largest = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    if stats[largest, cv2.CC_STAT_AREA] < _LEAST_SUN_PX:
        return None
    sun: np.ndarray = view.camera.rays((centres[largest : largest + 1] + 0.5) * seen.factor - 0.5)
    return sun[0] if np.isfinite(sun[0, 0]) else None
