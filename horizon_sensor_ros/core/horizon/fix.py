"""Simultaneous frames, and what they told: nadir and altitude, or the reason why not."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.fits.assessment import inliers, root_mean_square
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.limb.search.working_image import WorkingImage
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.planet_figure import Disc, disc_of
from horizon_sensor_ros.core.status import Status

_LESS_SURE = "the other camera is surer without it"
_NO_PART = "its limb is off the others' cone, or too short for the fit"


@dataclass(frozen=True, eq=False)
class Frame:
    """One image and the camera that took it.

    gray : (H, W) uint8 or uint16; a sensor keeps it until the camera's next one, which must be
    another array: one buffer that is filled anew is the very same image again. after_s : its time
    after that of the set of frames. unusable : why it is not to be looked at; empty where it is.
    Raises ValueError when after_s is not finite.
    """

    view: CameraView
    gray: np.ndarray
    after_s: float = 0.0
    unusable: str = ""

    def __post_init__(self) -> None:
        if not math.isfinite(self.after_s):
            raise ValueError(f"after_s of {self.view.name!r} must be finite, got {self.after_s}")

    @cached_property
    def working(self) -> WorkingImage:
        """The image in the size that a search works on; made once, whoever searches it."""
        return WorkingImage.of(self.gray, self.view.mask)

    @property
    def late_s(self) -> float:
        """How far from the set's time its pixels are seen, at most."""
        return abs(self.view.readout_s) + abs(self.after_s)

    @property
    def takes_s(self) -> float:
        """`late_s`, and the time for which its pixels are exposed."""
        return self.late_s + self.view.exposure_s


@dataclass(frozen=True)
class HorizonFix:
    """What simultaneous frames told.

    reason : why there is no estimate, or what makes it less certain; empty where nothing does.
    fit : the estimate, NaN when status is not OK.
    limbs : one per frame, in order; a frame that contributed nothing says why.
    cameras_used : names of the cameras that contributed.
    predicted : where the limb was expected, if it was followed and not searched for.
    airglow : the edge of the airglow above the limb, as a fit of its own, where it told nadir too.
    airglow_alone : that edge told all of the estimate, and limbs are points of it.
    cameras_spared : names of cameras whose limbs lie on the same cone, but without which the fix is
    surer.
    views : one per frame, as they see the horizon at the set's time, where frames are not of that
    moment; else empty.
    contradicting : names of cameras that were searched one by one and see a limb where others do
    not.
    gyro_refused : frames not of one moment were brought together without the gyro's rate, since no
    horizon bears it out.
    """

    status: Status
    reason: str
    fit: HorizonFit
    limbs: tuple[LimbPoints, ...]
    cameras_used: tuple[str, ...]
    predicted: Disc | None = None
    airglow: HorizonFit | None = None
    airglow_alone: bool = False
    cameras_spared: tuple[str, ...] = ()
    views: tuple[CameraView, ...] = ()
    contradicting: tuple[str, ...] = ()
    gyro_refused: bool = False

    @property
    def ok(self) -> bool:
        """True when there is an estimate."""
        return self.status is Status.OK

    @property
    def of_several(self) -> bool:
        """Whether the limbs of several cameras lie on its cone."""
        return len(self.cameras_used) + len(self.cameras_spared) > 1

    def why_left_out(self, limb: LimbPoints) -> str:
        """Why a camera that is not in `cameras_used` contributed nothing. limb : its own."""
        if limb.status is not Status.OK:
            return limb.reason or str(limb.status)
        if not self.ok:
            return self.reason
        return _NO_PART

    def residual_px(self, view: CameraView, limb: LimbPoints) -> float:
        """Root mean square distance of one camera's limb points from the fitted limb.

        Outliers are left out. NaN without a fix or without points.
        """
        if not self.ok:
            return np.nan
        residual = disc_of(self.fit).residuals_px(view, limb)
        return root_mean_square(residual[inliers(residual)]) if len(residual) else np.nan

    def cameras_on_cone(self, views: Sequence[CameraView]) -> tuple[str, ...]:
        """Names of the cameras whose limbs agree, also of those without which the fix is surer.

        views : of the frames, in order.
        """
        agree = {*self.cameras_used, *self.cameras_spared}
        return tuple(view.name for view in views if view.name in agree)

    def surer_without_rest(self, views: Sequence[CameraView]) -> HorizonFix:
        """The fix, where limbs that are not in it, though on its cone, say so.

        views : of the frames, in order.
        """
        spared = tuple(
            view.name
            for view, limb in zip(views, self.limbs, strict=True)
            if limb.status is Status.OK and view.name not in self.cameras_used
        )
        limbs = tuple(
            replace(limb, reason=_LESS_SURE) if view.name in spared else limb
            for view, limb in zip(views, self.limbs, strict=True)
        )
        return replace(self, limbs=limbs, cameras_spared=spared)


def told_by(views: Sequence[CameraView], limbs: Sequence[LimbPoints]) -> str:
    """Why there is no fix, as each camera's limb says."""
    if len({limb.reason for limb in limbs}) == 1:
        return limbs[0].reason
    return "; ".join(f"{v.name}: {limb.reason}" for v, limb in zip(views, limbs, strict=True))


def in_place_of(
    fix: HorizonFix, frames: Sequence[Frame], other: HorizonFix, judged: Sequence[Frame]
) -> HorizonFix:
    """Another fix, which has judged some of the frames; of those left out, and of the cameras that
    contradict without being in it, what the fix says.
    """
    names = [frame.view.name for frame in judged]
    limbs = dict(zip(names, other.limbs, strict=True))
    return replace(
        other,
        limbs=tuple(
            limbs.get(frame.view.name, limb) for frame, limb in zip(frames, fix.limbs, strict=True)
        ),
        contradicting=tuple(name for name in fix.contradicting if name not in other.cameras_used),
    )
