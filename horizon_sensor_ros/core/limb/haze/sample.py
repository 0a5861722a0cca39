"""Mean profiles across a predicted limb, by angle: in them air looks the same all along it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from horizon_sensor_ros.core.camera_view import CameraView
from horizon_sensor_ros.core.limb.glow.limb import usual_length_px
from horizon_sensor_ros.core.limb.profiles import (
    Bundles,
    ProfileGrid,
    pixel_noise,
    pixel_rad_across,
    sample_profiles,
)
from horizon_sensor_ros.core.limb.sample import MIN_PROFILES, TAPS_PX
from horizon_sensor_ros.core.limb_curve import LimbCurve, limb_curve
from horizon_sensor_ros.core.robust import median

# Pixels of the reduced image: the usual scale height, at which a ground's sharp edge would still
# show, and how far profiles reach beside where edges are sought, inwards and outwards.
_LENGTH_PX, _INNER_PX, _OUTER_PX = 3.2, 4.0, 9.0
_STRETCHES = 64  # along the limb
# Noise over the brightness of the limb, at least: coding, and what a camera makes of light, bend
# profiles as much.
_LEAST_NOISE = 0.01


class Sought(NamedTuple):
    """How far from the predicted one edges are sought, on which grid, and how far apart along it,
    all in pixels of the reduced image.
    """

    reach_px: float
    grid_px: float
    spacing_px: float


# Near a consensus of candidates, at first and well; and near a limb that was found.
GLANCE, SEEK, PLACE = Sought(6.0, 0.5, 4.0), Sought(6.0, 0.5, 2.0), Sought(2.0, 0.25, 2.0)


@dataclass(frozen=True, eq=False)
class HazySample:
    """Mean profiles (M, J) across stretches of a predicted limb, by angle.

    curve : of the stretches' middles; its normals are as long as a sample's step, in pixels of the
    reduced image.
    """

    curve: LimbCurve
    profiles: np.ndarray
    noise: float
    grid: ProfileGrid
    predicted: LimbCurve
    stretch_px: float
    factor: int


def haze_factor(view: CameraView, rho_rad: float) -> int:
    """By which an image is reduced so that the Earth's air fades over some three pixels."""
    return max(1, round(usual_length_px(view, rho_rad) / _LENGTH_PX))


def sample_haze(
    gray: np.ndarray,
    view: CameraView,
    nadir_base: np.ndarray,
    rho_rad: float,
    factor: int,
    sought: Sought,
) -> HazySample | None:
    """Sample a predicted limb; None where too little of it shows.

    gray : (H, W), reduced by `factor`. nadir_base, rho_rad : (3,) and radius of its cone.
    """
    reach_px, grid_px, spacing_px = sought
    predicted = limb_curve(view, nadir_base, rho_rad, spacing_px=spacing_px * factor)
    if len(predicted) < MIN_PROFILES:
        return None
    # Pixels of the same angle everywhere along the limb.
    pitch = pixel_rad_across(view, predicted.px, predicted.normal_px)
    pitch /= np.median(pitch)
    curve = replace(predicted, normal_px=predicted.normal_px / pitch[:, None])
    first = -(reach_px + _INNER_PX)
    num = round(2 * reach_px + _INNER_PX + _OUTER_PX) + 1
    grid = ProfileGrid(first, num, reach_px, grid_px)
    profiles, valid = sample_profiles(gray, curve, grid.d_px, factor)
    if view.mask is not None:
        valid &= view.mask.clear(curve.px, (TAPS_PX - first) * factor)
    num_valid = int(np.count_nonzero(valid))
    if num_valid < MIN_PROFILES:
        return None
    size = max(1, min(round(num_valid / _STRETCHES), num_valid // MIN_PROFILES))
    bundles = Bundles.of(valid, size)
    means = bundles.mean(profiles)
    middle = bundles.middle
    least = _LEAST_NOISE * median(means.max(axis=1) - means[:, -1])
    return HazySample(
        LimbCurve(curve.px[middle], curve.normal_px[middle], size * spacing_px * factor),
        means,
        max(pixel_noise(means, size), least),
        grid,
        predicted,
        size * spacing_px,
        factor,
    )
