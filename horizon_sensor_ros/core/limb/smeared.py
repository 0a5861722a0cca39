"""Limbs that motion smears: seen in frames blurred alike in all directions, and reduced."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.fits.observation import LimbObservation
from horizon_sensor_ros.core.limb.air import usual_length_px
from horizon_sensor_ros.core.limb.detection import Detection
from horizon_sensor_ros.core.limb.edge.model import EdgeLook
from horizon_sensor_ros.core.limb.edge.told_smear import told_smear
from horizon_sensor_ros.core.limb.edge.width import Smear, smear_of, widened_one_way
from horizon_sensor_ros.core.limb.passes import FRESH, look_for
from horizon_sensor_ros.core.limb.sized_frame import SizedFrame
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.status import Status

_SHARP_PX = 0.82  # one sigma of blur: sharper edges were not smeared by motion
_SMEAR_PX = 1.55  # length of a smear from which on a frame is reduced
_TOLD_PX = 1.0  # the same where it is known
_GLOWING_PX = 3.0  # the same where a limb is soft without motion: under glow, in a reduced frame
_LEFT_PX = 1.5  # length of the smear that is left in the pixels of the reduced frame
_SMALLEST_PX = 64  # shorter side of a reduced frame, at least; else its camera is left out
# Smears that are too long for a limb that looks sharp below its glow: of 300 that nothing moved one
# seemed to be smeared by 3.9 px, and those by 10 look sharp where a few points are left of them.
_UNSEEN_PX = 4.5
_AS_STEEP = 0.75  # share of a limb's steepness that is left where nothing has changed
_AS_MUCH = 0.25  # share by which the next frame's smear may be another
# Errors that points of smeared limbs share, over what they are where nothing moved: as measured
# beside the truth of simulated ones.
_MISJUDGED = 1.6
# Above such a smear the air's glow is lost in the ground's edge, which then lies too high: of 16
# simulated limbs under glow, smeared by 10 px and more and told so, three were off by more than
# three sigma.
_LONGEST_PX = 8.0
_SMEARED = "motion smears the limb too far, or it is no limb but the soft edge of clouds"


def without_smear(
    views: Sequence[CameraView], images: Sequence[np.ndarray], planet: Planet, detection: Detection
) -> Detection:
    """Find the limb again in smeared frames, blurred until the blur is equal in all directions and
    reduced until the smear is a pixel or two; unchanged where no frame is smeared.

    A camera whose reduced frame would be smaller than `_SMALLEST_PX`, or whose limb is smeared by
    more than `_LONGEST_PX`, gets no limb.
    """
    smears = _smears(views, images, detection)
    if not any(smears):
        return replace(detection, smears=tuple(smears))
    factors = [
        math.ceil(smear.across_px / _LEFT_PX) if smear else factor
        for smear, factor in zip(smears, detection.factors, strict=True)
    ]
    frames = [
        SizedFrame(image, factor, smear=smear)
        for image, factor, smear in zip(images, factors, smears, strict=True)
    ]
    near = detection.nadir_base, detection.rho_rad
    fresh: list[tuple[EdgeLook, ...]] = [()] * len(views)
    detection = look_for(views, frames, planet, near, fresh, FRESH)
    none = LimbPoints.none(Status.NO_LIMB, _SMEARED)
    usable = [
        seen
        if smear is None or _may_be_seen(smear, min(image.shape) / factor)
        else LimbObservation(seen.view, none)
        for seen, image, smear, factor in zip(
            detection.observations, images, smears, factors, strict=True
        )
    ]
    return with_smear_error(replace(detection, observations=tuple(usable), smears=tuple(smears)))


def _may_be_seen(smear: Smear, size_px: float) -> bool:
    """Whether a limb may be seen through a smear, in a reduced frame of so many pixels' side."""
    return smear.across_px <= _LONGEST_PX and size_px >= _SMALLEST_PX


def with_smear_error(detection: Detection) -> Detection:
    """Multiply the shared errors of smeared limbs by `_MISJUDGED`, as simulated ones need it."""
    if any(detection.smears):
        # How far a fit of limb and glow is misled by a smear is known of all limbs together.
        detection = replace(detection, separated=())
    return detection.with_limbs(
        [
            limb.with_shared_errors_times(_MISJUDGED) if smear else limb
            for limb, smear in zip(detection.limbs, detection.smears, strict=True)
        ]
    )


def _smears(
    views: Sequence[CameraView], images: Sequence[np.ndarray], detection: Detection
) -> list[Smear | None]:
    """Motion's smear in each frame, None where there is hardly any."""
    smears: list[Smear | None] = []
    separated = [one.limb.glow_separated for one in detection.separated or detection.observations]
    seen = zip(
        views, images, detection.limbs, detection.looks, detection.factors, separated, strict=True
    )
    for view, image, limb, looks, factor, from_glow in seen:
        smear = None
        if limb.status is Status.OK:
            known = told_smear(view, detection.nadir_base, detection.rho_rad)
            sharp = _sharp(looks, factor)
            if known is not None:
                smear = _if_known(known, factor)
            elif limb.glow_separated or not sharp:
                least_px = _UNSEEN_PX if sharp else 0.0
                smear = _smear_of(
                    image, view, detection, looks, factor, least_px, separated=from_glow
                )
        smears.append(smear)
    return smears


def smeared_one_way(images: Sequence[np.ndarray], detection: Detection) -> bool:
    """Whether what looks like thick air above limbs is motion, which widens them most one way."""
    return widened_one_way(
        [
            _told_or_seen(image, seen.view, detection)
            for image, seen in zip(images, detection.observations, strict=True)
            if seen.limb.status is Status.OK
        ]
    )


def _smear_of(
    image: np.ndarray,
    view: CameraView,
    detection: Detection,
    looks: Sequence[EdgeLook],
    factor: int,
    least_px: float = 0.0,
    *,
    separated: bool,
) -> Smear | None:
    """Motion's smear as one frame shows it, None where there is hardly any, or no more than so
    much. separated : its limb was told from the glow above it.
    """
    smear = smear_of(image, view, detection.nadir_base, detection.rho_rad)
    most_px = max(least_px, _GLOWING_PX if _soft(looks, factor) else _SMEAR_PX)
    if _glows(looks):
        # As wide as glow that is this long is no smear's work.
        most_px = max(most_px, usual_length_px(view, detection.rho_rad, factor))
    # The shape of what falls is then not a smear's alone.
    shape = replace(smear, boxed=False) if separated else smear
    return smear if shape.sure_px > most_px * factor else None


def _if_known(smear: Smear, factor: int) -> Smear | None:
    """A smear that is known, by exposure and rate; None where there is hardly any."""
    return smear if smear.across_px > _TOLD_PX * factor else None


def _told_or_seen(image: np.ndarray, view: CameraView, detection: Detection) -> Smear:
    """Smear by exposure and rate where these are known, else by what the frame shows."""
    about = detection.nadir_base, detection.rho_rad
    return told_smear(view, *about) or smear_of(image, view, *about)


def _sharp(looks: Sequence[EdgeLook], factor: int) -> bool:
    """Whether a limb is so sharp that no motion can have smeared it. Under glow that is known where
    the blur was told from it.
    """
    if not looks or factor > 1:
        return False
    air = looks[0].air
    if air is not None:
        return air.psf_px < _SHARP_PX
    return looks[0].psf_px < _SHARP_PX and not _glows(looks)


def _soft(looks: Sequence[EdgeLook], factor: int) -> bool:
    """Whether a limb is soft without motion: below glow, or in a frame reduced by more than one."""
    return factor > 1 or _glows(looks)


def _glows(looks: Sequence[EdgeLook]) -> bool:
    return any(look.glow_px > 0.0 for look in looks)


def smears_now(
    views: Sequence[CameraView],
    near: tuple[np.ndarray, float],
    before: Sequence[Smear | None],
) -> tuple[Smear | None, ...]:
    """Smears of frames that follow on others, by the limb near a predicted cone, nadir (3,) and
    rho: as it is told, or as it was; None of a frame that had none.
    """
    return tuple(
        smear and (told_smear(view, *near) or smear)
        for view, smear in zip(views, before, strict=True)
    )


def smeared_alike(
    views: Sequence[CameraView],
    images: Sequence[np.ndarray],
    detection: Detection,
    smears: Sequence[Smear | None],
) -> bool:
    """Whether frames that motion smeared still are, by about as much."""
    for view, image, limb, smear in zip(views, images, detection.limbs, smears, strict=True):
        if smear is None or limb.status is not Status.OK:
            continue
        now = _told_or_seen(image, view, detection)
        if not abs(now.across_px - smear.across_px) < _AS_MUCH * smear.across_px:
            return False
    return True


def still_sharp(
    views: Sequence[CameraView],
    images: Sequence[np.ndarray],
    detection: Detection,
    before: Sequence[np.ndarray],
    smears: Sequence[Smear | None],
    expected: Sequence[tuple[EdgeLook, ...]],
) -> tuple[np.ndarray, ...] | None:
    """Steepness of the limbs of followed frames, with which to compare the next ones; None where
    motion smears a frame that it did not smear before.

    That is asked where it is told, or a limb is not as it was. before : steepness of the limbs when
    it was asked the last time. expected : looks of the edges from which these were found; none
    where from nothing.
    """
    steepness = list(before)
    for i, (limb, looks, factor) in enumerate(
        zip(detection.limbs, detection.looks, detection.factors, strict=True)
    ):
        if smears[i] or limb.status is not Status.OK:
            continue
        known = told_smear(views[i], detection.nadir_base, detection.rho_rad)
        if known is not None:
            if _if_known(known, factor):
                return None
            continue
        as_it_was = _as_steep(limb.steepness, before[i])
        if as_it_was or (limb.glow_separated and _glows(expected[i])):
            continue
        separated = limb.glow_separated
        if _smear_of(images[i], views[i], detection, looks, factor, separated=separated):
            return None
        steepness[i] = limb.steepness
    return tuple(steepness)


def _as_steep(now: np.ndarray, before: np.ndarray) -> bool:
    return 0 < len(now) == len(before) and bool((now > _AS_STEEP * before).all())
