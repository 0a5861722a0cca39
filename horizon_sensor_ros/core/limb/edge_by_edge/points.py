"""Limb points of the edges that were taken, and what else these show."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.limb.air import usual_length_px
from horizon_sensor_ros.core.limb.edge.darkening import darkening_error
from horizon_sensor_ros.core.limb.edge.model import EdgeLook
from horizon_sensor_ros.core.limb.edge.terminator import beside_over_deep
from horizon_sensor_ros.core.limb.glow.contour import ContourLimb
from horizon_sensor_ros.core.limb.glow.white_air import of_white_air
from horizon_sensor_ros.core.limb.profiles import EdgePlaces, ProfileGrid
from horizon_sensor_ros.core.limb.sample import LimbSample
from horizon_sensor_ros.core.limb.texture.ground_texture import ground_across_px
from horizon_sensor_ros.core.limb_points import STRETCHES, CornerBlur, LimbPoints, SharedError
from horizon_sensor_ros.core.mathematics.parts import starts_of_parts
from horizon_sensor_ros.core.status import Status

_STEP_PX = 3  # from so far inside the predicted edge on its step is seen
_NOT_SEEN = np.empty(0)
_NOT_SEEN.setflags(write=False)


@dataclass(frozen=True, eq=False)
class TakenEdges:
    """Edges (N,) of which limb points are made.

    profiles : (N, J) in which they are. px, normal_px : (N, 2) where these cross the predicted
    limb, pixels of the full image, and their directions. places : of the edges.
    """

    profiles: np.ndarray
    px: np.ndarray
    normal_px: np.ndarray
    places: EdgePlaces

    @classmethod
    def of(cls, sample: LimbSample, places: EdgePlaces, good: np.ndarray) -> TakenEdges:
        """Of a sample's edges (M,) those that are good."""
        if good.all():
            return cls(sample.profiles, sample.px, sample.normal_px, places)
        px, normal_px = sample.px[good], sample.normal_px[good]
        return cls(sample.profiles[good], px, normal_px, places.take(good))

    def along(self, contour: ContourLimb) -> TakenEdges:
        """Those of them that a contour of the glow could follow, where it has the limb."""
        keep, places = contour.keep, contour.places(self.places)
        return TakenEdges(self.profiles[keep], self.px[keep], self.normal_px[keep], places)

    @cached_property
    def falls(self) -> np.ndarray:
        """By how much brightness falls from sample to sample, in stretches of limb: (S, J - 1)."""
        first = starts_of_parts(len(self.profiles), STRETCHES)
        sums = np.add.reduceat(self.profiles.T, first, axis=1).T
        return np.asarray(sums[:, :-1] - sums[:, 1:])


def points_in_glow(
    sample: LimbSample,
    taken: TakenEdges,
    shared: SharedError,
    jumps_px: float,
    view: CameraView,
    rho_rad: float,
) -> LimbPoints:
    """Limb points (N,) of edges beyond which air glows.

    shared, jumps_px : in pixels of the sample's image, the former but for what overexposed air
    adds.
    """
    points = _points(sample, taken, shared, jumps_px)
    along_rad = len(taken.px) * sample.stretch_px * sample.pitch_rad
    share, length_px = float(np.mean(sample.clipped)), usual_length_px(view, rho_rad)
    by_white = of_white_air(share, along_rad, rho_rad, length_px)
    return replace(points, shared=points.shared.besides(by_white))


def points_without_glow(
    sample: LimbSample,
    taken: TakenEdges,
    shared: SharedError,
    jumps_px: float,
    look: EdgeLook | None,
    rho_rad: float,
    corner_blur: CornerBlur | None,
) -> LimbPoints:
    """Limb points (N,) of edges beyond which no air glows, with what shows there besides.

    shared, jumps_px, corner_blur : in pixels of the sample's image, the first but for what
    darkening ground adds. look : by which edges were placed; None without a model.
    """
    grid, factor = sample.grid, sample.factor
    darkening = darkening_error(
        taken.profiles,
        grid,
        taken.places.step,
        ground_across_px(sample.pitch_rad, rho_rad),
        model_free=look is None,
    )
    return _points(
        sample,
        taken,
        shared.besides(darkening),
        jumps_px,
        steepness=_steepness(taken.falls, grid),
        blur_px=np.nan if look is None else factor * look.psf_px,
        corner_blur=None if corner_blur is None else corner_blur.times(factor),
        beside_over_deep=beside_over_deep(taken.profiles, grid),
    )


def _points(
    sample: LimbSample,
    taken: TakenEdges,
    shared: SharedError,
    jumps_px: float,
    *,
    steepness: np.ndarray = _NOT_SEEN,
    blur_px: float = np.nan,
    corner_blur: CornerBlur | None = None,
    beside_over_deep: float = np.nan,
) -> LimbPoints:
    """Limb points (N,) in the full image of edges in a sample of it; shared, jumps_px : in pixels
    of the sample's. The others are fields of `LimbPoints` as they are.
    """
    factor, places = sample.factor, taken.places
    offset_px = places.offset_px * factor
    return LimbPoints(
        Status.OK,
        px=taken.px + offset_px[:, None] * taken.normal_px,
        normal_px=taken.normal_px,
        sigma_px=places.sigma_px * factor,
        shared=shared.times(factor),
        spacing_px=sample.stretch_px * factor,
        jumps_px=jumps_px * factor,
        predicted=sample.curve,
        offset_px=offset_px,
        factor=factor,
        step=places.step,
        steepness=steepness,
        blur_px=blur_px,
        corner_blur=corner_blur,
        beside_over_deep=beside_over_deep,
    )


def _steepness(falls: np.ndarray, grid: ProfileGrid) -> np.ndarray:
    """`LimbPoints.steepness` (S,) of falls (S, J - 1)."""
    step = falls[:, round(-grid.first_px) - _STEP_PX :].sum(axis=1)
    return falls_at(falls, grid) / np.maximum(step, 1e-9)


def falls_at(falls: np.ndarray, grid: ProfileGrid) -> np.ndarray:
    """Steepest fall (S,) beside the predicted edge."""
    here = round(-grid.first_px)
    return np.asarray(falls[:, here - 1 : here + 1].max(axis=1))
