"""The Sun's glare beside a limb under glowing air: every stretch stands on a background of its own.

Across some tens of pixels it is a line, which shows in the black sky beyond the glow.
"""

from __future__ import annotations

import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.limb.air import USUAL_HEIGHT
from horizon_sensor_ros.core.limb.glow.sight import LEAST_STRETCHES, GlowSight, look_along
from horizon_sensor_ros.core.mathematics.robust import median, robust_sigma

_UNEVEN = 4.0  # scatter of the backgrounds over what noise makes of it
_OUTER = 0.5  # share of what lies above the limb in which they are compared
_LENGTHS, _SKY_PX = 5.0, 14.0  # of glow, from where on the sky is black, and how much of it is seen
_FARTHEST_PX = 60.0  # from the limb to that sky: beyond, glare is no line any more
# Misfit of lines, over the noise. Beside the Sun it was at most 1.5, below airglow at least 1.7.
_CURVED = 1.6


def look_without_glare(
    gray: np.ndarray,
    view: CameraView,
    cone: tuple[np.ndarray, float],
    outer_px: float,
    factor: int,
    glaring: bool,
    part: tuple[float, float] | None,
) -> GlowSight | None:
    """What is seen along a limb up to outer_px above it, without the Sun's glare; None if little.

    glaring : it is known to be there. part : of the limb, from 0 to 1 along it; None: all of it.
    """
    sight = _without_glare(gray, view, cone, outer_px, factor, glaring)
    if sight is not None and part is not None:
        sight = sight.part(*part)
    return None if sight is None or len(sight) < LEAST_STRETCHES else sight


def _without_glare(
    gray: np.ndarray,
    view: CameraView,
    cone: tuple[np.ndarray, float],
    outer_px: float,
    factor: int,
    glaring: bool,
) -> GlowSight | None:
    """`look_without_glare` at all of the limb."""
    sight = look_along(gray, view, *cone, outer_px, factor)
    if sight is None or len(sight) < LEAST_STRETCHES:
        return None
    if not (glaring or in_glare(sight)):
        return sight
    reach = reach_px(sight)
    if reach is None:
        return None
    from_px, to_px = reach
    beyond = look_along(gray, view, *cone, to_px, factor)
    if beyond is None or len(beyond) < LEAST_STRETCHES:
        return None
    lines = glare_lines(beyond, from_px)
    return sight if lines is None else beyond.without_glare(lines, from_px, outer_px)


def in_glare(sight: GlowSight) -> bool:
    """Whether the stretches' backgrounds differ, beyond what is left there of the glow."""
    outer = sight.d_px >= (1.0 - _OUTER) * sight.d_px[-1]
    profiles = sight.profiles[:, outer]
    fall = np.exp(-sight.distance[:, outer] * (sight.rise / USUAL_HEIGHT)[:, None])
    mean = fall.mean(axis=1, keepdims=True)
    # From far away there is no air at all in sight there.
    squares = np.maximum(np.square(fall - mean).sum(axis=1), np.finfo(float).tiny)
    glow = (profiles * (fall - mean)).sum(axis=1) / squares
    background = profiles.mean(axis=1) - glow * mean[:, 0]
    sigma = sight.noise * np.sqrt(1.0 / fall.shape[1] + np.square(mean[:, 0]) / squares)
    return robust_sigma(background - median(background)) > _UNEVEN * median(sigma)


def reach_px(sight: GlowSight) -> tuple[float, float] | None:
    """From where and up to where above the limb glare is measured; None if the glow reaches far."""
    from_px = max(float(sight.d_px[-1]), _LENGTHS * USUAL_HEIGHT / median(sight.rise))
    return (from_px, from_px + _SKY_PX) if from_px < _FARTHEST_PX else None


def glare_lines(sight: GlowSight, from_px: float) -> np.ndarray | None:
    """Level at the limb and slope (M, 2) of the backgrounds as seen from from_px above it, over the
    usual level; None where they are no lines, as below a layer of airglow.
    """
    sky = sight.d_px >= from_px
    d_px = sight.d_px[sky]
    design = np.stack([np.ones_like(d_px), d_px], axis=1)
    lines = np.linalg.lstsq(design, sight.profiles[:, sky].T, rcond=None)[0].T
    left = np.square(sight.profiles[:, sky] - lines @ design.T).mean(axis=1)
    if median(left) > (_CURVED * sight.noise) ** 2:
        return None
    lines[:, 0] -= median(lines[:, 0])
    return np.asarray(lines)
