"""Looking for a limb under thick air, from a cone that is near it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.fits.maximum_likelihood import refine
from horizon_sensor_ros.core.fits.observation import LimbObservation, gather
from horizon_sensor_ros.core.limb.detection import Detection
from horizon_sensor_ros.core.limb.edge.model import EdgeLook
from horizon_sensor_ros.core.limb.haze.limb import (
    ABOVE_M,
    LENGTHS,
    THINNEST_PX,
    haze_look,
    hazy_limb,
    may_be_haze,
    rate_haze,
)
from horizon_sensor_ros.core.limb.haze.sample import (
    GLANCE,
    PLACE,
    SEEK,
    HazySample,
    Sought,
    air_length_px,
    haze_factor,
    sample_haze,
)
from horizon_sensor_ros.core.limb.search.working_image import block_average
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.status import Status

_EVIDENCE = 10.0  # logarithm by which it has to be likelier than any other edge, a camera
# The same, a stretch of limb, and how evenly it lies, over the scale height, where only air that
# hides the ground is so: 31 of 41 simulated pairs under such, and 2 of 36 pairs that others drew
# under thin air and that its law fits best. In finer pixels the law alone tells them apart.
_SURE, _EVEN, _FINE_PX = 3.0, 0.08, 2.5
# The logarithm by which a stretch is less likely in air that hides the ground than without, where a
# frame does not resolve it: 3 in two simulated scenes under thin air, .1 at most under thick.
_DENIED = 1.0
_MORE = 2  # passes, where the limb still lies off its cone
_NO_LIMB = LimbPoints.none(Status.NO_LIMB, "the limb is not in the frame")


class ThroughHaze(NamedTuple):
    """The limb under thick air. sure : whether it is under no other."""

    detection: Detection
    sure: bool

    def or_thin_air(self, looked: Detection) -> Detection:
        """The limb that was told from glow in all frames that show this one, if it was: where the
        air may be either, a fit of limb and glow is near the truth about nadir under both, the law
        of haze under thick air only. How high above the ground it lies stays as uncertain.

        looked : what was found without regard to haze.
        """
        from_glow = looked.separated_only or looked
        for hazy, limb in zip(self.detection.limbs, from_glow.limbs, strict=True):
            if hazy.status is Status.OK and not limb.glow_separated:
                return self.detection
        return from_glow.raised(ABOVE_M)


def look_through_haze(
    views: Sequence[CameraView],
    images: Sequence[np.ndarray],
    planet: Planet,
    near: tuple[np.ndarray, float],
) -> ThroughHaze | None:
    """Limb of simultaneous frames under thick air, near a cone; None where the air is not such.

    images : (H, W) uint8 or uint16, one a view. near : nadir (3,), base frame, and rho (rad).
    """
    thickest_px = max(air_length_px(view, near[1]) for view in views)
    if thickest_px < THINNEST_PX or not planet.has_air:
        return None
    factors = tuple(haze_factor(view, near[1]) for view in views)
    reduced = _reduced(images, factors)
    usual_px = [
        air_length_px(view, near[1], factor) for view, factor in zip(views, factors, strict=True)
    ]
    glances = _shown(_samples(views, reduced, factors, near, GLANCE), usual_px)
    if not any(may_be_haze(*glance) for glance in glances):
        return None
    samples = _samples(views, reduced, factors, near, SEEK)
    shown = _shown(samples, usual_px)
    rated = [rate_haze(*sample) for sample in shown]
    # It is the same air in all frames.
    merit = np.sum(rated, axis=0)
    if not rated or merit.max() < _EVIDENCE * len(rated):
        return None
    if any(_denied(*sample, merits) for sample, merits in zip(shown, rated, strict=True)):
        return None
    length = _likeliest_length(merit)
    looks: list[tuple[EdgeLook, ...]] = [
        () if sample is None else (haze_look(length * length_px),)
        for sample, length_px in zip(samples, usual_px, strict=True)
    ]
    detection = _refined(views, reduced, planet, near, looks, factors, (SEEK, PLACE))
    if detection is None:
        return None
    num = sum(len(sample.profiles) for sample in samples if sample is not None)
    uneven = max(
        (
            limb.jumps_px / (length * length_px * factor)
            for limb, length_px, factor in zip(detection.limbs, usual_px, factors, strict=True)
            if limb.status is Status.OK
        ),
        default=np.inf,
    )
    sure = thickest_px > _FINE_PX or (merit.max() > _SURE * num and uneven < _EVEN)
    return ThroughHaze(detection, bool(sure))


def follow_through_haze(
    views: Sequence[CameraView],
    images: Sequence[np.ndarray],
    planet: Planet,
    near: tuple[np.ndarray, float],
    looks: Sequence[tuple[EdgeLook, ...]],
    factors: Sequence[int],
) -> Detection | None:
    """Limb through haze that is known to be there, near a cone of nadir (3,) and rho (rad); None
    where no cone fits it.

    images : (H, W), one a view. looks : of hazy edges, one a frame, none where that shows no limb.
    factors : by which frames are reduced for it.
    """
    reduced = _reduced(images, factors)
    return _refined(views, reduced, planet, near, looks, factors, (PLACE, PLACE))


def _refined(
    views: Sequence[CameraView],
    reduced: Sequence[np.ndarray],
    planet: Planet,
    near: tuple[np.ndarray, float],
    looks: Sequence[tuple[EdgeLook, ...]],
    factors: Sequence[int],
    passes: Sequence[Sought],
) -> Detection | None:
    """Pass after pass until the limb lies near the cone that it was sought about."""
    for sought in (*passes, *[PLACE] * _MORE):
        samples = _samples(views, reduced, factors, near, sought)
        limbs = [
            _NO_LIMB if sample is None or not kinds else hazy_limb(sample, kinds[0])
            for sample, kinds in zip(samples, looks, strict=True)
        ]
        seen = tuple(map(LimbObservation, views, limbs))
        detection = Detection(
            seen,
            nadir_base=near[0],
            rho_rad=near[1],
            looks=tuple(
                kinds if limb.status is Status.OK else ()
                for kinds, limb in zip(looks, limbs, strict=True)
            ),
            factors=tuple(factors),
            smears=(None,) * len(views),
        )
        if sought is PLACE and detection.on_course:
            return detection
        nearer = refine(gather(seen), planet, near)
        if not nearer.ok:
            return None
        near = nearer.nadir_base, nearer.rho_rad
    return None


def _denied(sample: HazySample, length_px: float, merits: np.ndarray) -> bool:
    """Whether a frame shows too sharp a limb, by its `rate_haze`, for the air to hide the ground.

    The law of such air fits thin air too in a frame that resolves it. One that does not, as a
    smaller frame beside it, shows a sharp edge under thin air and a soft one under thick.
    """
    return length_px < THINNEST_PX and bool(merits.max() < -_DENIED * len(sample.profiles))


def _likeliest_length(merit: np.ndarray) -> float:
    """Scale height, over the usual one, where merits of `LENGTHS` are highest: the vertex of the
    parabola through three of them.
    """
    top = min(max(int(merit.argmax()), 1), len(merit) - 2)
    below, at, above = merit[top - 1 : top + 2].tolist()
    bend = 2.0 * at - below - above
    shift = min(max(0.5 * (above - below) / bend, -1.0), 1.0) if bend > 0.0 else 0.0
    return float(LENGTHS[top] * (LENGTHS[1] / LENGTHS[0]) ** shift)


def _reduced(images: Sequence[np.ndarray], factors: Sequence[int]) -> list[np.ndarray]:
    return [
        image if factor == 1 else block_average(image, factor)
        for image, factor in zip(images, factors, strict=True)
    ]


def _samples(
    views: Sequence[CameraView],
    reduced: Sequence[np.ndarray],
    factors: Sequence[int],
    near: tuple[np.ndarray, float],
    sought: Sought,
) -> list[HazySample | None]:
    return [
        sample_haze(image, view, *near, factor, sought)
        for view, image, factor in zip(views, reduced, factors, strict=True)
    ]


def _shown(
    samples: Sequence[HazySample | None], usual_px: Sequence[float]
) -> list[tuple[HazySample, float]]:
    """Those of the limbs that are in sight, each with the usual scale height there."""
    return [
        (sample, length_px)
        for sample, length_px in zip(samples, usual_px, strict=True)
        if sample is not None
    ]
