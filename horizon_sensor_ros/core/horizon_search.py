"""The limb searched for all over simultaneous frames: with all cameras, without those that say
something against themselves, and by what single ones find.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from horizon_sensor_ros.core.aiding import Aiding
from horizon_sensor_ros.core.fits.observation import LimbObservation, gather
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.hidden_sky import farthest_limb_px
from horizon_sensor_ros.core.horizon_estimator import HorizonEstimator, Judged, Sighting
from horizon_sensor_ros.core.horizon_fix import Frame, HorizonFix, told_by
from horizon_sensor_ros.core.judgement import disagreement_rad, nadir_sigma_rad
from horizon_sensor_ros.core.limb.detection import Detection
from horizon_sensor_ros.core.limb.detector import detect_limb, joined
from horizon_sensor_ros.core.limb.evidence import NEAREST_SKY_PX
from horizon_sensor_ros.core.limb.search.air_layer import may_be_cut_off
from horizon_sensor_ros.core.limb.search.candidates import space_boundary_candidates
from horizon_sensor_ros.core.limb.search.columns import LAYER_M
from horizon_sensor_ros.core.limb.search.selection import (
    Consensus,
    limb_consensus,
    rays_of_candidates,
)
from horizon_sensor_ros.core.limb_curve import limb_in_sight
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.planet_figure import disc_of
from horizon_sensor_ros.core.robust import median
from horizon_sensor_ros.core.status import Status

_AT_LAYER = "what shows as a limb is the edge of a layer of airglow"
_PERHAPS_AT_LAYER = "the limb may be the edge of a layer of airglow, and altitude 95 km too small"
_BY_FADING = "by how light fades below it"
_CUT_OFF = "the frame ends too near to the limb"
_SIGMAS = 4.0  # by which altitudes by the limb of the ground and of a layer are told apart
_MUCH_LESS_SURE = 2.0  # times the sigma of nadir
# What a camera, by number, finds by itself, and what its limb comes to; looked for once.
_Alone = Callable[[int], tuple[Detection, Judged]]


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
        Returns the fix, and the detection that a track may start from: None unless the fix is of
        all frames and of the ground's limb.
        """
        limbs = list(unusable)
        alone = self._each_alone(frames, aiding)
        everything = not any(limbs)
        layer: Consensus | None = None
        # What all saw where some frames were doubtful, and these: number in it, and in `frames`.
        doubted: tuple[Sighting, dict[int, int]] | None = None
        while True:
            rest = [i for i, limb in enumerate(limbs) if limb is None]
            if not rest:
                return _no_fix(frames, limbs), None
            sighting = self._sighting([frames[i] for i in rest], aiding)
            layer = layer or _layer(sighting.detection)
            judged = self._estimator.judged(sighting)
            fix, detection = self._estimator.prefer_separated(sighting, judged.fix)
            judged = replace(judged, fix=fix)
            sighting = replace(sighting, detection=detection)
            by_layer = self._estimator.by_airglow_alone(sighting, judged)
            if by_layer is not None and (by_layer.ok or not judged.doubtful):
                judged = Judged(by_layer)
            if not judged.doubtful:
                fix = judged.fix
                if fix.ok and not fix.airglow_alone and _is_at_layer(detection.observations, layer):
                    fix = self._estimator.refused(Status.POOR_FIT, _AT_LAYER, fix.fit, fix.limbs)
                reason = fix.reason if fix.ok else _reason_and_left_out(frames, limbs, fix.reason)
                for i, limb in zip(rest, fix.limbs, strict=True):
                    limbs[i] = limb
                fix = replace(fix, reason=reason, limbs=tuple(_filled(limbs)))
                hidden = doubted and self._with_sky_hidden(frames, *doubted, fix, alone)
                if hidden:
                    fix, sighting = hidden
                    detection = sighting.detection
                fix = replace(fix, contradicting=_contradicting(frames, fix, alone))
                contradicted = self._refused_by_another(frames, fix, alone)
                contradicted = contradicted or self._perhaps_of_layer(frames, sighting, fix, alone)
                contradicted = contradicted or self._by_own_limbs(frames, sighting, fix, alone)
                if contradicted is not None:
                    return contradicted, None
                return self._from_singles(frames, fix, aiding, alone, layer) or (
                    fix,
                    detection if everything and not fix.airglow_alone else None,
                )
            # What a camera says against itself may have misled the others: once more without it.
            everything = False
            doubted = doubted or (sighting, {i: rest[i] for i in judged.doubtful})
            for i, limb in judged.doubtful.items():
                limbs[rest[i]] = limb

    def agreeing(self, frame: Frame) -> int:
        """Number of edges beside space in one frame that agree on a disc, whether or not it is the
        planet's; 0 where too few do.
        """
        found = rays_of_candidates(
            [frame.view], [space_boundary_candidates(frame.gray, mask=frame.view.mask)]
        )
        consensus = limb_consensus(found, rho_min_rad=self._rho_min, rho_max_rad=self._rho_max)
        return int(np.count_nonzero(consensus.inliers))

    def _each_alone(self, frames: Sequence[Frame], aiding: Aiding) -> _Alone:
        @cache
        def alone(i: int) -> tuple[Detection, Judged]:
            sighting = self._sighting([frames[i]], aiding)
            return sighting.detection, self._any_sigma.judged(sighting)

        return alone

    def _with_sky_hidden(
        self,
        frames: Sequence[Frame],
        doubted: Sighting,
        hidden: Mapping[int, int],
        fix: HorizonFix,
        alone: _Alone,
    ) -> tuple[HorizonFix, Sighting] | None:
        """Fix with the cameras that were left out for what is in their sky, and the sighting that
        it is of; None unless by the fix of the others a part of the craft hides that sky.

        doubted : of these and the others. hidden : numbers of their frames in it, and in `frames`.
        The others have to know where the limb is to less than the distance at which the sky is
        looked at, so that ground cannot reach there. Their own limbs remain in the fix.
        """
        detection = doubted.detection
        if not _by_ground(fix, detection.consensus):
            return None
        for i in hidden:
            seen = LimbObservation(doubted.frames[i].view, detection.limbs[i])
            off_px = farthest_limb_px(seen, fix.fit, self._estimator.sphere)
            near = off_px < NEAREST_SKY_PX * detection.working[i].factor
            # What is left beside a boom is short: edges of no model say too little of their errors.
            if not (near and seen.limb.modelled):
                return None
        if any(_elsewhere(fix, list(hidden.values()), alone)):
            return None
        judged = self._estimator.judged(doubted, hidden)
        together, detection = self._estimator.prefer_separated(doubted, judged.fix, hidden)
        if judged.doubtful or not together.ok:
            return None
        views = [frame.view for frame in frames]
        needed = {*fix.cameras_on_cone(views), *(views[i].name for i in hidden.values())}
        if not needed.issubset(together.cameras_on_cone(views)):
            return None
        together = _in_place_of(fix, frames, together, doubted.frames)
        return together, replace(doubted, detection=detection)

    def _refused_by_another(
        self, frames: Sequence[Frame], fix: HorizonFix, alone: _Alone
    ) -> HorizonFix | None:
        """Refusal of one camera's fix where another camera, looked at alone, has a fix elsewhere.

        Where the extrinsics are wrong two good limbs lie on no common cone; the consensus keeps
        one of them, and nothing tells which camera is the one that is mounted as it should be.
        """
        if not fix.ok or len(fix.cameras_used) > 1:
            return None
        unseen = [i for i, limb in enumerate(fix.limbs) if limb.status is not Status.OK]
        for i, apart in _elsewhere(fix, unseen, alone):
            name = frames[i].view.name
            reason = (
                f"{name} alone finds nadir {np.degrees(apart):.1f} deg "
                f"from that of {fix.cameras_used[0]}"
            )
            refused = self._estimator.refused(Status.CAMERAS_DISAGREE, reason, fix.fit, fix.limbs)
            return replace(refused, contradicting=(name, *fix.cameras_used))
        return None

    def _by_own_limbs(
        self, frames: Sequence[Frame], sighting: Sighting, fix: HorizonFix, alone: _Alone
    ) -> HorizonFix | None:
        """Fix, or why there is none, by the limbs that cameras find by themselves, where these
        contradict each other; else None.

        What is found around a common cone lies near it, also where the extrinsics are wrong and
        that cone is none of theirs.
        """
        consensus = sighting.detection.consensus
        if not _by_ground(fix, consensus) or _undisputed(frames, fix, consensus):
            return None
        found = {
            i: alone(i)[0]
            for i, limb in enumerate(fix.limbs)
            if limb.status is not Status.BAD_IMAGE and alone(i)[1].fix.ok
        }
        # One that is left out by two that agree, each by itself too, is outvoted.
        agree = {*fix.cameras_used, *fix.cameras_spared}
        voters = {i: one for i, one in found.items() if frames[i].view.name in agree}
        found = voters if len(voters) > 1 else found
        # Edges in glow and limbs that were separated from it lie on two cones anyway.
        separated = {one.limbs[0].glow_separated for one in found.values()}
        if len(found) < 2 or len(separated) > 1:
            return None
        own = joined(list(found.values()), sighting.detection)
        by_own = self._estimator.judged(
            replace(sighting, frames=[frames[i] for i in found], detection=own)
        ).fix
        by_own = _in_place_of(fix, frames, by_own, [frames[i] for i in found])
        if by_own.status in (Status.CAMERAS_DISAGREE, Status.POOR_FIT):
            reason = f"each camera by itself sees a limb, but no common cone fits: {by_own.reason}"
            refused = self._estimator.refused(
                Status.CAMERAS_DISAGREE, reason, fix.fit, by_own.limbs
            )
            return replace(refused, contradicting=tuple(frames[i].view.name for i in found))
        if not (by_own.ok and by_own.reason):
            return None
        # What contradicts itself already is only followed no longer where it is far worse.
        known_rad = _MUCH_LESS_SURE * nadir_sigma_rad(fix.fit) if fix.reason else 0.0
        return by_own if nadir_sigma_rad(by_own.fit) > known_rad else None

    def _perhaps_of_layer(
        self, frames: Sequence[Frame], sighting: Sighting, fix: HorizonFix, alone: _Alone
    ) -> HorizonFix | None:
        """The same fix, its altitude as uncertain as a layer of airglow is high, where the limb may
        be the edge of one; else None. About nadir both limbs say the same.
        """
        detection = sighting.detection
        if not _by_ground(fix, detection.consensus):
            return None
        who = self._who_tells_of_layer(frames, sighting, fix, alone)
        if who is None:
            return None
        of_layer = self._estimator.judged(
            replace(sighting, detection=detection.raised(LAYER_M))
        ).fix
        told = filter(None, (of_layer.reason, f"{who}: {_PERHAPS_AT_LAYER}"))
        of_layer = replace(of_layer, reason="; ".join(told))
        return _in_place_of(fix, frames, of_layer, sighting.frames)

    def _who_tells_of_layer(
        self, frames: Sequence[Frame], sighting: Sighting, fix: HorizonFix, alone: _Alone
    ) -> str | None:
        """What says that a limb may be a layer's: how light fades below it; the borders of all
        frames, which hide what would tell; or one camera that by itself sees the edge of one there,
        or its limb so much lower.
        """
        detection = sighting.detection
        agreed = detection.agreed
        if agreed is not None and not detection.under_daylit_air:
            if detection.consensus.perhaps_layer:
                return _BY_FADING
            at = sighting.views, detection.working, agreed, detection.consensus
            if may_be_cut_off(*at, self._estimator.sphere):
                return _CUT_OFF
        if _undisputed(frames, fix, detection.consensus):
            return None
        number = {frame.view.name: i for i, frame in enumerate(frames)}
        for seen in detection.observations:
            itself, judged = alone(number[seen.view.name])
            if _is_at_layer([seen], _layer(itself)) or _is_above(fix.fit, judged.fix):
                return f"{seen.view.name}, by itself"
        return None

    def _from_singles(
        self,
        frames: Sequence[Frame],
        fix: HorizonFix,
        aiding: Aiding,
        alone: _Alone,
        layer: Consensus | None,
    ) -> tuple[HorizonFix, Detection | None] | None:
        """Fix by what single cameras find by themselves, where all together have none; with the
        detection, if it is of them all.

        A flooded frame, or one that glares, may spoil what they agree on. The cone of one camera is
        believed where the others are blind by themselves, or see their limbs on it as well when
        they are asked about it: if another limb is there, nothing tells which to believe.
        layer : as of `_is_at_layer`. A camera by itself may not see that its limb is the layer's.
        """
        if fix.ok or len(frames) < 2:
            return None
        seen = [limb.status for limb in fix.limbs].count(Status.OK)
        # One camera alone saw a limb, and its fix was too uncertain: what it finds by itself is
        # known, and judged with what the other frames say of the light.
        known = fix.status is Status.UNCERTAIN and seen == 1
        blind = not known and fix.status is not Status.CAMERAS_DISAGREE
        found, limbs = [], list(fix.limbs)
        for i in range(len(frames)):
            if fix.limbs[i].status is Status.BAD_IMAGE:
                continue
            judged = alone(i)[1]
            by_itself = judged.fix
            at_layer = not by_itself.airglow_alone and _is_at_layer(alone(i)[0].observations, layer)
            if by_itself.ok and not at_layer:
                found.append(by_itself)
            elif not judged.doubtful and by_itself.status is not Status.NO_LIMB:
                blind = False
            # Of a camera that is left out, what it says by itself.
            limbs[i] = judged.doubtful.get(0, by_itself.limbs[0])
        found.sort(key=lambda one: nadir_sigma_rad(one.fit))
        if blind and len(found) == 1:
            sure = nadir_sigma_rad(found[0].fit) <= self._estimator.config.max_nadir_sigma_rad
            return (replace(found[0], limbs=tuple(limbs)), None) if sure else None
        for by_itself in found:
            disc = disc_of(by_itself.fit)
            near = disc.nadir, disc.rho_rad
            if not all(len(limb_in_sight(frame.view, *near)) for frame in frames):
                continue
            sighting = self._sighting(frames, aiding, near)
            if _is_at_layer(sighting.detection.observations, layer):
                continue
            together = self._estimator.judged(sighting).fix
            if together.ok and len(together.cameras_used) == len(frames):
                return together, sighting.detection
        return None

    def _sighting(
        self,
        frames: Sequence[Frame],
        aiding: Aiding,
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
        )
        if np.isfinite(detection.rho_rad):
            figure = figure.aligned(detection.nadir_base)
        return Sighting(frames, detection, figure, aiding)


def _layer(found: Detection) -> Consensus | None:
    """Consensus of frames in which a layer of airglow shows; else None."""
    consensus = found.consensus
    return consensus if consensus.layer_rad > 0.0 else None


def _is_at_layer(limbs: Sequence[LimbObservation], layer: Consensus | None) -> bool:
    """Whether limbs lie rather at the edge of a layer that was seen elsewhere, by all cameras or by
    one alone, than at the limb of the ground below it; not where none was.
    """
    if layer is None:
        return False
    cosine = gather(limbs).rays_base @ layer.nadir_base
    above_rad = np.arccos(np.clip(cosine, -1.0, 1.0)) - layer.rho_rad
    return bool(len(above_rad) and median(above_rad) > 0.5 * layer.layer_rad)


def _by_ground(fix: HorizonFix, consensus: Consensus) -> bool:
    """Whether there is a fix, and no layer of airglow has a part in it."""
    return fix.ok and not fix.airglow_alone and consensus.layer_rad == 0.0


def _undisputed(frames: Sequence[Frame], fix: HorizonFix, consensus: Consensus) -> bool:
    """Whether no camera could find another cone: nearly all edges of all frames lie on this one, or
    there is one camera only.
    """
    return len(frames) < 2 or (consensus.unanimous and len(fix.cameras_used) == len(frames))


def _is_above(fit: HorizonFit, by_itself: HorizonFix) -> bool:
    """Whether the limb lies above the one that a camera by itself found, by about what a layer of
    airglow does: more than errors explain.
    """
    if not by_itself.ok:
        return False
    off_m = by_itself.fit.altitude_m - fit.altitude_m
    variance = fit.cov_nadir_altitude[3, 3] + by_itself.fit.cov_nadir_altitude[3, 3]
    return bool(off_m > max(0.5 * LAYER_M, _SIGMAS * np.sqrt(variance)))


def _in_place_of(
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


def _contradicting(frames: Sequence[Frame], fix: HorizonFix, alone: _Alone) -> tuple[str, ...]:
    """Names of the cameras that see a limb, each by itself, elsewhere than the others together."""
    if not fix.ok:
        seen = zip(frames, fix.limbs, strict=True)
        of_limb = tuple(frame.view.name for frame, limb in seen if limb.status is Status.OK)
        return of_limb if fix.status is Status.CAMERAS_DISAGREE else ()
    if len(fix.cameras_used) < 2 or fix.airglow_alone:
        return ()
    taken = {*fix.cameras_used, *fix.cameras_spared}
    left_out = [i for i, frame in enumerate(frames) if frame.view.name not in taken]
    return tuple(frames[i].view.name for i, _ in _elsewhere(fix, left_out, alone))


def _elsewhere(
    fix: HorizonFix, cameras: Sequence[int], alone: _Alone
) -> Iterator[tuple[int, float]]:
    """Of cameras, by number, those that by themselves have a fix elsewhere, and how far off (rad).

    One after the other, since to look at a camera alone takes time.
    """
    for i in cameras:
        if fix.limbs[i].status is Status.BAD_IMAGE:
            continue
        by_itself = alone(i)[1].fix
        apart_rad = disagreement_rad(by_itself.fit, fix.fit) if by_itself.ok else 0.0
        if apart_rad > 0.0:
            yield i, apart_rad


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
