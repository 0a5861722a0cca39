"""Mean profiles across a predicted limb, by angle, or from within the air by its optical depth: in
them air looks the same all along it, and from everywhere.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import cv2
import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.cameras.white_level import NEAR_WHITE, saturation_level
from horizon_sensor_ros.core.limb.air import usual_length_px
from horizon_sensor_ros.core.limb.haze.column import AirColumn, seen_from_within
from horizon_sensor_ros.core.limb.profiles import (
    Bundles,
    ProfileGrid,
    pixel_noise,
    pixel_rad_across,
    sample_profiles,
)
from horizon_sensor_ros.core.limb.sample import MIN_PROFILES, TAPS_PX
from horizon_sensor_ros.core.limb_curve import LimbCurve, limb_curve
from horizon_sensor_ros.core.mathematics.robust import median

# Pixels of the reduced image: the usual scale height, at which a ground's sharp edge would still
# show, and how far profiles reach beside where edges are sought, inwards and outwards.
_LENGTH_PX, _INNER_PX, _OUTER_PX = 3.2, 4.0, 9.0
_CLEARANCE_PX = 1.5  # from a mask, of single samples
_LEAST_OUTER_PX = 2.5  # where rays do not reach as far outside
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


class Warp(NamedTuple):
    """Profiles from within the air, whose samples are as far apart as its optical depth changes by
    the same factor: at the predicted limb a pixel of the reduced image, of so many rad.
    """

    column: AirColumn
    pixel_rad: float

    @property
    def most_px(self) -> float:
        """Place of the highest ray, samples outside the limb."""
        return self.column.most * self.column.length_rad / self.pixel_rad

    def outward_rad(self, d_px: np.ndarray) -> np.ndarray:
        """How far (J,) outside the limb places (J,) in samples are."""
        return self.column.outward_rad(d_px * (self.pixel_rad / self.column.length_rad))


@dataclass(frozen=True, eq=False)
class HazySample:
    """Mean profiles (M, J) across stretches of a predicted limb, by angle.

    gray : (H, W), the image, reduced by `factor`. curve : middles of the stretches; its normals are
    as long as a sample's step at the limb, in pixels of that image. noise : one sigma of profiles,
    gray levels. grid : where their samples are, and where edges are sought. predicted, rho_rad :
    the limb about which they are. stretch_px : length of a stretch, and pixel_rad : angle of a
    pixel, of that image. warp : how samples get farther apart outside; None: they do not.
    """

    gray: np.ndarray
    curve: LimbCurve
    profiles: np.ndarray
    noise: float
    grid: ProfileGrid
    predicted: LimbCurve
    stretch_px: float
    factor: int
    rho_rad: float
    pixel_rad: float
    warp: Warp | None

    @property
    def white_share(self) -> float:
        """Of the stretches, those that are overexposed."""
        white = NEAR_WHITE * saturation_level(self.gray, self.profiles)
        return float(np.mean(self.profiles.max(axis=1) >= white))

    def offset_px(self, places_px: np.ndarray) -> np.ndarray:
        """How far (M,) outside the limb places (M,) in samples are, steps of its normals."""
        if self.warp is None:
            return places_px
        return self.warp.outward_rad(places_px) / self.warp.pixel_rad


def air_length_px(view: CameraView, rho_rad: float, factor: int = 1) -> float:
    """Length over which the optical depth of the Earth's air falls to 1 / e outside a limb."""
    column = _column(rho_rad)
    if column is None:
        return usual_length_px(view, rho_rad, factor)
    return column.length_rad / (factor * view.camera.pixel_rad)


def haze_factor(view: CameraView, rho_rad: float) -> int:
    """By which an image is reduced so that the Earth's air fades over some three pixels."""
    return max(1, round(air_length_px(view, rho_rad) / _LENGTH_PX))


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
    usual_rad = median(pitch)
    curve = replace(predicted, normal_px=predicted.normal_px / (pitch / usual_rad)[:, None])
    first = -(reach_px + _INNER_PX)
    column = _column(rho_rad)
    warp = None if column is None else Warp(column, factor * usual_rad)
    outer_px = _OUTER_PX if warp is None else min(_OUTER_PX, warp.most_px - reach_px)
    if outer_px < _LEAST_OUTER_PX:
        return None
    num = int(2 * reach_px + _INNER_PX + outer_px) + 1
    grid = ProfileGrid(first, num, reach_px, grid_px)
    if warp is None:
        profiles, valid = sample_profiles(gray, curve, grid.d_px, factor)
        if view.mask is not None:
            valid &= view.mask.clear(curve.px, (TAPS_PX - first) * factor)
    else:
        away = warp.outward_rad(grid.d_px)
        profiles, valid = _by_rays(gray, view, nadir_base, predicted, away, factor)
    num_valid = int(np.count_nonzero(valid))
    if num_valid < MIN_PROFILES:
        return None
    size = max(1, min(round(num_valid / _STRETCHES), num_valid // MIN_PROFILES))
    bundles = Bundles.of(valid, size)
    means = bundles.mean(profiles)
    middle = bundles.middle
    least = _LEAST_NOISE * median(means.max(axis=1) - means[:, -1])
    return HazySample(
        gray,
        LimbCurve(curve.px[middle], curve.normal_px[middle], size * spacing_px * factor),
        means,
        max(pixel_noise(means, size), least),
        grid,
        predicted,
        size * spacing_px,
        factor,
        rho_rad,
        factor * usual_rad,
        warp,
    )


def _column(rho_rad: float) -> AirColumn | None:
    """The air above a limb that is seen from within it; None for others."""
    return AirColumn(0.5 * np.pi - rho_rad) if seen_from_within(rho_rad) else None


def _by_rays(
    gray: np.ndarray,
    view: CameraView,
    nadir_base: np.ndarray,
    limb: LimbCurve,
    away_rad: np.ndarray,
    factor: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Gray levels (N, J) so far (J,) outside a limb, as the lens shows it, and which of them (N,)
    are inside the frame and not masked.
    """
    nadir = view.rot_base_from_cam.T @ nadir_base
    rays = view.camera.rays(limb.px)
    outward = rays * (rays @ nadir)[:, None] - nadir
    outward /= np.linalg.norm(outward, axis=1)[:, None]
    there = np.cos(away_rad)[:, None] * rays[:, None]
    there = there + np.sin(away_rad)[:, None] * outward[:, None]
    px = view.camera.pixels(there.reshape(-1, 3)).reshape((*there.shape[:2], 2))
    at = (px + 0.5) / factor - 0.5
    # A place without a pixel is in no frame.
    with np.errstate(invalid="ignore"):
        inside = (at >= 0.0) & (at <= np.array(gray.shape[::-1]) - 1.0)
    valid = np.asarray(inside.all(axis=(1, 2)))
    if view.mask is not None:
        valid[valid] = view.mask.clear(px[valid], _CLEARANCE_PX * factor).all(axis=1)
    x, y = at[valid].astype(np.float32).transpose(2, 0, 1)
    profiles = np.zeros(there.shape[:2], dtype=np.float32)
    if valid.any():
        # Air that fades over three pixels is smooth.
        profiles[valid] = cv2.remap(gray.astype(np.float32), x, y, cv2.INTER_LINEAR)
    return profiles, valid
