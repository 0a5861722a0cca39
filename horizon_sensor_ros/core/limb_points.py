"""Limb points of one image, the product of limb detection and the input of every fit."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from horizon_sensor_ros.core.limb_curve import LimbCurve
from horizon_sensor_ros.core.status import Status


def _empty(columns: int) -> np.ndarray:
    return np.empty((0, columns))


class SharedError(NamedTuple):
    """One-sigma errors that the points of one camera's limb share, pixels along the normal.

    Of one camera, independent of the others':
    coherent_px : of a stretch of limb, independent of the other stretches (air glow bends long
    ones).
    white_px : the part of `coherent_px` that is of overexposed edges: it does not bend a limb, as
    the rest may.
    shift_px : of the whole limb (cameras see different air).
    slope_px : of its ends, one outwards and one inwards, which turns the limb.

    The same in the limbs of all cameras:
    height_px : of the whole limb (overexposed air, or below airglow).
    scale_px : of a place where the lens has e times as many pixels to an angle as elsewhere. Air
    that passes for blur lifts edges the less, the better it is resolved.
    dark_px : of a place that is as bright as is usual along the limb (`LimbPoints.step`), and more
    where it is darker. Air that passes for blur lifts edges the more, the less light the ground
    beside it gives.
    fields_px : of each of two fields of a frame, one outwards and one inwards.
    """

    coherent_px: float = 0.0
    shift_px: float = 0.0
    slope_px: float = 0.0
    height_px: float = 0.0
    scale_px: float = 0.0
    dark_px: float = 0.0
    white_px: float = 0.0
    fields_px: float = 0.0

    def besides(self, other: SharedError) -> SharedError:
        """Both errors together, independent of each other: the roots of the sums of squares."""
        return SharedError(*map(math.hypot, self, other))

    def times(self, factor: float) -> SharedError:
        """All of them multiplied by a factor."""
        return SharedError(*(factor * each for each in self))


NOTHING_SHARED = SharedError()

# Stretches of a camera's limb within which neighbouring points share an error, and between which
# they do not.
STRETCHES = 6
# One sigma of mean, slope and bend of a parabola along a limb, from one end (-1) to the other (1),
# whose six stretches are off by one each, independently.
MEAN_OF_STRETCHES, SLOPE_OF_STRETCHES, BEND_OF_STRETCHES = 0.41, 0.72, 1.47


class CornerBlur(NamedTuple):
    """What one limb by itself shows of the blur that its lens adds in the corners of the frame, see
    `CameraView.corner_blur_px`; one sigma without what texture may hide of it.
    """

    seen_px: float
    sigma_px: float

    def times(self, factor: float) -> CornerBlur:
        """Both multiplied by a factor."""
        return CornerBlur(factor * self.seen_px, factor * self.sigma_px)


@dataclass(frozen=True, eq=False)
class LimbPoints:
    """Points of one image that lie on the planet's limb.

    px : (N, 2) float64, raw (distorted) pixels, x right, y down, pixel centres at integers.
    normal_px : (N, 2) unit vectors in the image, across the limb, towards space.
    sigma_px : (N,) one sigma of each point along its normal, on its own.
    shared : errors that they share besides.
    spacing_px : length of limb that each point stands for.
    jumps_px : by how much neighbouring edges differ, one sigma, before any model smooths them;
    infinite where that was not measured.
    predicted : the limb all along which these were looked for; None where it was not drawn.
    offset_px : (N,) how far outside it these lie, in order along it; empty where that was not
    measured.
    cone_errors : (4, K) where limb and glow were separated by a joint fit (`glow.fit`), else None.
    Errors of (nadir_base, rho_rad) of the cone that the points lie on: each column is one sigma,
    independent of the other columns; column k is the same error in the limbs of all cameras. Such
    points lie on the ground's limb; edges found one by one lie in its glow, a pixel or two higher.
    modelled : False where these are sharp edges that follow no model of an edge.
    above_m : how far above the ground these may lie, in air that hides it.
    steepness : (S,) largest fall of brightness from pixel to pixel near the predicted limb, over
    the step there, in S stretches along it; empty where air glows.
    blur_px : one sigma of the blur of sharp edges, by their model; NaN without one, or under glow.
    factor : by which the image was reduced for edges to be placed in it.
    step : (N,) gray levels from space to the planet beside each point; empty where that was not
    measured.
    corner_blur : None where edges were not kriged, or motion smears them.
    beside_over_deep : as of `edge.terminator`; NaN where that was not measured.
    status, reason : OK, or why the image shows no usable limb (then N = 0).
    """

    status: Status
    reason: str = ""
    px: np.ndarray = field(default_factory=lambda: _empty(2))
    normal_px: np.ndarray = field(default_factory=lambda: _empty(2))
    sigma_px: np.ndarray = field(default_factory=lambda: np.empty(0))
    shared: SharedError = NOTHING_SHARED
    spacing_px: float = 1.0
    jumps_px: float = np.inf
    predicted: LimbCurve | None = None
    offset_px: np.ndarray = field(default_factory=lambda: np.empty(0))
    cone_errors: np.ndarray | None = None
    modelled: bool = True
    above_m: float = 0.0
    steepness: np.ndarray = field(default_factory=lambda: np.empty(0))
    blur_px: float = np.nan
    factor: int = 1
    step: np.ndarray = field(default_factory=lambda: np.empty(0))
    corner_blur: CornerBlur | None = None
    beside_over_deep: float = np.nan

    @property
    def glow_separated(self) -> bool:
        """Whether limb and glow were separated by a joint fit: then the limb is the ground's."""
        return self.cone_errors is not None

    def with_shared_errors_times(self, times: float) -> LimbPoints:
        """The points, with all errors that they share multiplied by `times`."""
        errors = self.cone_errors
        return replace(
            self,
            shared=self.shared.times(times),
            cone_errors=None if errors is None else times * errors,
        )

    def take(self, which: np.ndarray) -> LimbPoints:
        """Some of them, by a mask (N,) or by number."""
        return replace(
            self,
            px=self.px[which],
            normal_px=self.normal_px[which],
            sigma_px=self.sigma_px[which],
            offset_px=self.offset_px[which] if len(self.offset_px) else self.offset_px,
            step=self.step[which] if len(self.step) else self.step,
        )

    @classmethod
    def none(cls, status: Status, reason: str) -> LimbPoints:
        """No limb in this image, and why."""
        return cls(status, reason)
