"""The limb searched for all over simultaneous frames: with all cameras, without those that say
something against themselves, and by what single ones find.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from horizon_sensor_ros.core.aiding import Aiding
from horizon_sensor_ros.core.fits.observation import LimbObservation
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.horizon.at_layer import by_ground, is_at_layer, layer_of
from horizon_sensor_ros.core.horizon.estimator import HorizonEstimator, Judged
from horizon_sensor_ros.core.horizon.fix import Frame, HorizonFix, in_place_of, told_by
from horizon_sensor_ros.core.horizon.hidden_sky import farthest_limb_px
from horizon_sensor_ros.core.horizon.sighting import Sighting
from horizon_sensor_ros.core.horizon.single_cameras import SingleCameras
from horizon_sensor_ros.core.limb.detection import Detection
from horizon_sensor_ros.core.limb.detector import detect_limb, limb_of_one
from horizon_sensor_ros.core.limb.evidence import NEAREST_SKY_PX
from horizon_sensor_ros.core.limb.search.candidates import candidates_in
from horizon_sensor_ros.core.limb.search.larger_disc import larger_disc_rad
from horizon_sensor_ros.core.limb.search.selection import (
    Consensus,
    limb_consensus,
    rays_of_candidates,
)
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.planet_figure import disc_of
from horizon_sensor_ros.core.status import Status

_AT_LAYER = "what shows as a limb is the edge of a layer of airglow"


class HorizonSearch:
    """Frames of any number of cameras, of which nothing is known, to nadir and altitude."""

    def __init__(self, estimator: HorizonEstimator) -> None:
        config = estimator.config
        self._estimator = estimator
        # Accepts any nadir sigma, to ask what one camera finds by itself.
        self._any_sigma = HorizonEstimator(replace(config, max_nadir_sigma_rad=np.pi))
        self._rho_min = estimator.sphere.rho_from_altitude(config.altitude_max_m)
        # Nothing is seen from below the limb.
        lowest_m = max(config.altitude_min_m, config.planet.limb_height_m)
        self._rho_max = estimator.sphere.rho_from_altitude(lowest_m)

    def fix(
        self, frames: Sequence[Frame], unusable: Sequence[LimbPoints | None], aiding: Aiding
    ) -> tuple[HorizonFix, Detection | None]:
        """Search whole frames for the limb.

        unusable : one per frame, why it is not to be looked at; None where it is.
        Returns the fix, and the detection in the frames that were looked at that a track may start
        from: None unless the fix is of all of them and of the ground's limb.
        """
        fix, detection = self._found(frames, unusable, aiding)
        refused = self._beside_larger(frames, unusable, fix)
        return (fix, detection) if refused is None else (refused, None)

    def _beside_larger(
        self, frames: Sequence[Frame], unusable: Sequence[LimbPoints | None], fix: HorizonFix
    ) -> HorizonFix | None:
        """Refusal of a fix by the limb of a disc beside which a larger one shows; else None."""
        # Bodies without air are moons and asteroids mostly, with their planet or companion in the
        # sky. Moons of planets with air are smaller than these are from the highest altitude, and
        # what is large beside such a planet is a part of the craft.
        if not fix.ok or self._estimator.sphere.has_air:
            return None
        disc = disc_of(fix.fit)
        usable = [frame for frame, why in zip(frames, unusable, strict=True) if why is None]
        larger_rad = larger_disc_rad(
            [disc.figure.view(frame.view) for frame in usable],
            [frame.working for frame in usable],
            disc.nadir,
            disc.rho_rad,
            self._rho_max,
        )
        if larger_rad is None:
            return None
        small, large = np.degrees([disc.rho_rad, larger_rad])
        reason = f"a moon's limb? It is {small:.2g} deg in radius, a disc beside it {large:.2g}"
        return self._estimator.refused(Status.POOR_FIT, reason, fix.fit, fix.limbs)

    def _found(
        self, frames: Sequence[Frame], unusable: Sequence[LimbPoints | None], aiding: Aiding
    ) -> tuple[HorizonFix, Detection | None]:
        """Fix and detection as of `fix`, whatever shows beside the disc that the fix is of."""
        limbs = list(unusable)
        look = partial(self._sighting, aiding)
        singles = SingleCameras(frames, look, self._of_one, self._estimator, self._any_sigma)
        everything = True
        layer: Consensus | None = None
        # What all saw where some frames were doubtful, and these: number in it, and in `frames`.
        doubted: tuple[Sighting, dict[int, int]] | None = None
        while True:
            rest = [i for i, limb in enumerate(limbs) if limb is None]
            if not rest:
                return _no_fix(frames, limbs), None
            sighting = look([frames[i] for i in rest])
            layer = layer or layer_of(sighting.detection)
            judged = self._estimator.judged(sighting)
            fix, detection = self._estimator.prefer_separated(sighting, judged.fix)
            judged = replace(judged, fix=fix)
            sighting = replace(sighting, detection=detection)
            by_layer = self._estimator.by_airglow_alone(sighting, judged)
            if by_layer is not None and (by_layer.ok or not judged.doubtful):
                judged = Judged(by_layer)
            if not judged.doubtful:
                break
            # What a camera says against itself may have misled the others: once more without it.
            everything = False
            doubted = doubted or (sighting, {i: rest[i] for i in judged.doubtful})
            for i, limb in judged.doubtful.items():
                limbs[rest[i]] = limb
        fix = judged.fix
        if fix.ok and not fix.airglow_alone and is_at_layer(detection.observations, layer):
            fix = self._estimator.refused(Status.POOR_FIT, _AT_LAYER, fix.fit, fix.limbs)
        reason = fix.reason if fix.ok else _reason_and_left_out(frames, limbs, fix.reason)
        for i, limb in zip(rest, fix.limbs, strict=True):
            limbs[i] = limb
        fix = replace(fix, reason=reason, limbs=tuple(_filled(limbs)))
        # By what the others found a camera may be back that was left out for its sky alone.
        hidden = doubted and self._with_sky_hidden(frames, *doubted, fix, singles)
        if hidden:
            fix, sighting = hidden
            detection = sighting.detection
        # Then cameras by themselves: those that see another limb, and, where there is no fix of
        # all, one that has one of its own.
        fix = singles.with_contradicting(fix)
        contradicted = (
            singles.refusing(fix)
            or singles.perhaps_of_layer(sighting, fix)
            or singles.by_own_limbs(sighting, fix)
        )
        if contradicted is not None:
            return contradicted, None
        alone = singles.instead_of(fix, layer)
        if alone is not None:
            return alone
        return fix, detection if everything and not fix.airglow_alone else None

    def agreeing(self, frame: Frame) -> int:
        """Number of edges beside space in one frame that agree on a disc, whether or not it is the
        planet's; 0 where too few do.
        """
        candidates = rays_of_candidates(
            [frame.view], [candidates_in(frame.working, mask=frame.view.mask)]
        )
        consensus = limb_consensus(candidates, rho_min_rad=self._rho_min, rho_max_rad=self._rho_max)
        return int(np.count_nonzero(consensus.inliers))

    def _with_sky_hidden(
        self,
        frames: Sequence[Frame],
        doubted: Sighting,
        hidden: Mapping[int, int],
        fix: HorizonFix,
        singles: SingleCameras,
    ) -> tuple[HorizonFix, Sighting] | None:
        """Fix with the cameras that were left out for what is in their sky, and the sighting that
        it is of; None unless by the fix of the others a part of the craft hides that sky.

        doubted : of these and the others. hidden : numbers of their frames in it, and in `frames`.
        The others have to know where the limb is to less than the distance at which the sky is
        looked at, so that ground cannot reach there. Their own limbs remain in the fix.
        """
        detection = doubted.detection
        if not by_ground(fix, detection.consensus):
            return None
        for i in hidden:
            seen = LimbObservation(doubted.frames[i].view, detection.limbs[i])
            off_px = farthest_limb_px(seen, fix.fit, self._estimator.sphere)
            near = off_px < NEAREST_SKY_PX * detection.working[i].factor
            # What is left beside a boom is short: edges of no model say too little of their errors.
            if not (near and seen.limb.modelled):
                return None
        if any(singles.elsewhere(fix, list(hidden.values()))):
            return None
        judged = self._estimator.judged(doubted, hidden)
        together, detection = self._estimator.prefer_separated(doubted, judged.fix, hidden)
        if judged.doubtful or not together.ok:
            return None
        views = [frame.view for frame in frames]
        needed = {*fix.cameras_on_cone(views), *(views[i].name for i in hidden.values())}
        if not needed.issubset(together.cameras_on_cone(views)):
            return None
        together = in_place_of(fix, frames, together, doubted.frames)
        return together, replace(doubted, detection=detection)

    def _sighting(
        self,
        aiding: Aiding,
        frames: Sequence[Frame],
        near: tuple[np.ndarray, float] | None = None,
    ) -> Sighting:
        """Limb in whole frames, and the planet's figure as it turned out to lie.

        near : as of `detect_limb`.
        """
        figure = self._estimator.figure(aiding)
        detection = detect_limb(
            [figure.view(frame.view) for frame in frames],
            [frame.gray for frame in frames],
            self._estimator.sphere,
            rho_min_rad=self._rho_min,
            rho_max_rad=self._rho_max,
            near=near,
            working=[frame.working for frame in frames],
        )
        if np.isfinite(detection.rho_rad):
            figure = figure.aligned(detection.nadir_base)
        return Sighting(frames, detection, figure, aiding)

    def _of_one(self, sighting: Sighting, index: int) -> Sighting | None:
        """Limb in one of the frames by itself, as of `limb_of_one`."""
        frame = sighting.frames[index]
        detection = limb_of_one(
            sighting.views[index],
            frame.gray,
            self._estimator.sphere,
            sighting.detection,
            index,
            rho_min_rad=self._rho_min,
            rho_max_rad=self._rho_max,
        )
        if detection is None:
            return None
        return replace(sighting, frames=[frame], detection=detection)


def _no_fix(frames: Sequence[Frame], limbs: Sequence[LimbPoints | None]) -> HorizonFix:
    filled = _filled(limbs)
    reason = told_by([frame.view for frame in frames], filled)
    fit = HorizonFit.none(filled[0].status, reason, "")
    return HorizonFix(filled[0].status, reason, fit, tuple(filled), ())


def _reason_and_left_out(
    frames: Sequence[Frame], limbs: Sequence[LimbPoints | None], reason: str
) -> str:
    """Why there is no fix, and before that why cameras were left out of it, if any were.

    limbs : None where a camera took part.
    """
    names = [frame.view.name for frame in frames]
    out = [f"{name}: {limb.reason}" for name, limb in zip(names, limbs, strict=True) if limb]
    if not out:
        return reason
    rest = [name for name, limb in zip(names, limbs, strict=True) if limb is None]
    return "; ".join([*out, f"{rest[0]}: {reason}" if len(rest) == 1 else reason])


def _filled(limbs: Sequence[LimbPoints | None]) -> list[LimbPoints]:
    return [limb or LimbPoints.none(Status.NO_LIMB, "not looked at") for limb in limbs]
