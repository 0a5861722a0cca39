"""What single cameras find by themselves, and what that says of a fix of all of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import islice

import numpy as np

from horizon_sensor_ros.core.horizon.at_layer import (
    by_ground,
    is_above,
    is_at_layer,
    layer_of,
    shown_by_frames,
)
from horizon_sensor_ros.core.horizon.estimator import HorizonEstimator, Judged
from horizon_sensor_ros.core.horizon.fix import Frame, HorizonFix, in_place_of
from horizon_sensor_ros.core.horizon.judgement import disagreement_rad, nadir_sigma_rad
from horizon_sensor_ros.core.horizon.sighting import Sighting
from horizon_sensor_ros.core.limb.detection import Detection
from horizon_sensor_ros.core.limb.detector import joined
from horizon_sensor_ros.core.limb.search.columns import LAYER_M
from horizon_sensor_ros.core.limb.search.selection import Consensus
from horizon_sensor_ros.core.limb_curve import limb_in_sight
from horizon_sensor_ros.core.mathematics.attitude import angle_rad
from horizon_sensor_ros.core.planet_figure import disc_of
from horizon_sensor_ros.core.status import Status

_PERHAPS_AT_LAYER = "the limb may be the edge of a layer of airglow, and altitude 95 km too small"
_MUCH_LESS_SURE = 2.0  # times the sigma of nadir


# Limb in whole frames, and as a second argument a cone that it is known to be near, as of
# `detect_limb`.
_Look = Callable[..., Sighting]
# Limb in one of the frames of a sighting by itself, as of `limb_of_one`.
_LookAtOne = Callable[[Sighting, int], Sighting | None]


class SingleCameras:
    """Simultaneous frames, each of which is looked at by itself where it is asked about: it takes
    as long as a search, or a part of that near a limb that all of them show.

    any_sigma : estimator that accepts any sigma of nadir.
    """

    def __init__(
        self,
        frames: Sequence[Frame],
        look: _Look,
        look_at_one: _LookAtOne,
        estimator: HorizonEstimator,
        any_sigma: HorizonEstimator,
    ) -> None:
        self._frames, self._look, self._look_at_one = frames, look, look_at_one
        self._views = [frame.view for frame in frames]
        self._names = [view.name for view in self._views]
        self._number = {name: i for i, name in enumerate(self._names)}
        self._estimator, self._any_sigma = estimator, any_sigma
        self._seen: dict[int, tuple[Detection, Judged]] = {}
        self._near: dict[int, tuple[Detection, Judged]] = {}
        self._about: Sighting | None = None

    def detection(self, i: int) -> Detection:
        """Limb that a camera, by number, finds by itself."""
        return self._alone(i)[0]

    def judged(self, i: int) -> Judged:
        """Fix from that limb alone, whatever sigma of nadir it has."""
        return self._alone(i)[1]

    def _look_near(self, sighting: Sighting) -> None:
        """Look near the limbs of a sighting, where that tells what a search of the frame would."""
        if self._about is sighting:
            return
        self._about = sighting
        for k, frame in enumerate(sighting.frames):
            one = self._look_at_one(sighting, k)
            if one is not None:
                i = self._number[frame.view.name]
                self._near[i] = one.detection, self._any_sigma.judged(one)

    def _alone(self, i: int) -> tuple[Detection, Judged]:
        if i in self._near:
            return self._near[i]
        if i not in self._seen:
            sighting = self._look([self._frames[i]])
            self._seen[i] = sighting.detection, self._any_sigma.judged(sighting)
        return self._seen[i]

    def with_contradicting(self, fix: HorizonFix) -> HorizonFix:
        """The fix, and the cameras that see a limb, each by itself, elsewhere than the others do:
        those that are left out of it for that say so.
        """
        if not fix.ok:
            seen = zip(self._frames, fix.limbs, strict=True)
            of_limb = tuple(frame.view.name for frame, limb in seen if limb.status is Status.OK)
            disagree = fix.status is Status.CAMERAS_DISAGREE
            return replace(fix, contradicting=of_limb if disagree else ())
        agree = fix.cameras_on_cone(self._views)
        if len(agree) < 2 or fix.airglow_alone:
            return fix
        left_out = [i for i, name in enumerate(self._names) if name not in agree]
        limbs, names = list(fix.limbs), []
        for i, apart_rad in self.elsewhere(fix, left_out):
            reason = f"by itself it finds nadir {np.degrees(apart_rad):.1f} deg from the others'"
            limbs[i] = replace(limbs[i], reason=reason)
            names.append(self._names[i])
        return replace(fix, limbs=tuple(limbs), contradicting=tuple(names))

    def elsewhere(self, fix: HorizonFix, cameras: Sequence[int]) -> Iterator[tuple[int, float]]:
        """Of cameras, by number, those that by themselves have a fix elsewhere, and how far off
        (rad).

        One after the other, since to look at a camera alone takes time.
        """
        for i in cameras:
            if fix.limbs[i].status is Status.BAD_IMAGE:
                continue
            by_itself = self.judged(i).fix
            apart_rad = disagreement_rad(by_itself.fit, fix.fit) if by_itself.ok else None
            if apart_rad is not None:
                yield i, apart_rad

    def refusing(self, fix: HorizonFix) -> HorizonFix | None:
        """Refusal of a fix where as many cameras as agree on it, or more, agree on another, each by
        itself; else None.

        Where the extrinsics are wrong two good limbs lie on no common cone; the consensus keeps
        one of them, and nothing tells which camera is the one that is mounted as it should be: two
        heads of two cameras each are no better than two cameras.
        """
        if not fix.ok:
            return None
        agree = fix.cameras_on_cone(self._views)
        if len(agree) > 1:
            elsewhere = [i for i, name in enumerate(self._names) if name in fix.contradicting]
        else:
            unseen = [i for i, limb in enumerate(fix.limbs) if limb.status is not Status.OK]
            elsewhere = [i for i, _ in islice(self.elsewhere(fix, unseen), 1)]
        others = max((self._on_cone_of(elsewhere, i) for i in elsewhere), key=len, default=[])
        if not others or len(others) < len(agree):
            return None
        apart_rad = angle_rad(self.judged(others[0]).fix.fit.nadir_base, fix.fit.nadir_base)
        names = [self._names[i] for i in others]
        reason = (
            f"{' and '.join(names)} alone {'finds' if len(names) == 1 else 'find'} nadir "
            f"{np.degrees(apart_rad):.1f} deg from that of {' and '.join(agree)}"
        )
        refused = self._estimator.refused(Status.CAMERAS_DISAGREE, reason, fix.fit, fix.limbs)
        return replace(refused, contradicting=(*names, *agree))

    def _on_cone_of(self, cameras: Sequence[int], i: int) -> list[int]:
        """Camera `i`, and those of some that by themselves do not find nadir elsewhere than it."""
        own = self.judged(i).fix.fit
        rest = {k: self.judged(k).fix.fit for k in cameras if k != i}
        return [i, *(k for k, fit in rest.items() if disagreement_rad(fit, own) is None)]

    def by_own_limbs(self, sighting: Sighting, fix: HorizonFix) -> HorizonFix | None:
        """Fix, or why there is none, by the limbs that cameras find by themselves, where these
        contradict each other; else None.

        What is found around a common cone lies near it, also where the extrinsics are wrong and
        that cone is none of theirs.
        """
        consensus = sighting.detection.consensus
        if not by_ground(fix, consensus) or self._undisputed(fix, consensus):
            return None
        self._look_near(sighting)
        by_own = self._by_what_is_known(sighting, fix)
        if by_own is None or not self._near:
            return by_own
        # Errors of one camera's cone draw what is found near it: before cameras contradict each
        # other each is searched all over its frame.
        self._near.clear()
        return self._by_what_is_known(sighting, fix)

    def _by_what_is_known(self, sighting: Sighting, fix: HorizonFix) -> HorizonFix | None:
        """Answer of `by_own_limbs` by what is known so far of each camera."""
        return self._contradicting(sighting, fix) or self._surer_by_itself(fix)

    def _contradicting(self, sighting: Sighting, fix: HorizonFix) -> HorizonFix | None:
        """What comes of limbs that contradict each other; None where they do not."""
        detections = {
            i: self.detection(i)
            for i, limb in enumerate(fix.limbs)
            if limb.status is not Status.BAD_IMAGE and self.judged(i).fix.ok
        }
        # One that is left out by two that agree, each by itself too, is outvoted.
        agree = fix.cameras_on_cone(self._views)
        voters = {i: one for i, one in detections.items() if self._names[i] in agree}
        detections = voters if len(voters) > 1 else detections
        # Edges in glow and limbs that were separated from it lie on two cones anyway.
        separated = {one.limbs[0].glow_separated for one in detections.values()}
        if len(detections) < 2 or len(separated) > 1:
            return None
        of_found = [self._frames[i] for i in detections]
        own = joined(list(detections.values()), sighting.detection)
        by_own = self._estimator.judged(replace(sighting, frames=of_found, detection=own)).fix
        by_own = in_place_of(fix, self._frames, by_own, of_found)
        if by_own.status in (Status.CAMERAS_DISAGREE, Status.POOR_FIT):
            reason = f"each camera by itself sees a limb, but no common cone fits: {by_own.reason}"
            refused = self._estimator.refused(
                Status.CAMERAS_DISAGREE, reason, fix.fit, by_own.limbs
            )
            return replace(refused, contradicting=tuple(self._names[i] for i in detections))
        if not (by_own.ok and by_own.reason):
            return None
        # What contradicts itself already is only followed no longer where it is far worse.
        known_rad = _MUCH_LESS_SURE * nadir_sigma_rad(fix.fit) if fix.reason else 0.0
        return by_own if nadir_sigma_rad(by_own.fit) > known_rad else None

    def _surer_by_itself(self, fix: HorizonFix) -> HorizonFix | None:
        """Fix of a camera that was spared and by itself is surer than those that were not: around
        a cone that is none of its own its limb was measured badly. Else None.
        """
        by_itself = [
            (self._frames[i], self.judged(i).fix)
            for i, name in enumerate(self._names)
            if name in fix.cameras_spared and self.judged(i).fix.ok
        ]
        if not by_itself:
            return None
        frame, surest = min(by_itself, key=lambda one: nadir_sigma_rad(one[1].fit))
        if nadir_sigma_rad(surest.fit) >= nadir_sigma_rad(fix.fit):
            return None
        surest = in_place_of(fix, self._frames, surest, [frame])
        return surest.surer_without_rest(self._views)

    def perhaps_of_layer(self, sighting: Sighting, fix: HorizonFix) -> HorizonFix | None:
        """The fix, its altitude as uncertain as a layer of airglow is high, where the limb may
        be the edge of one; else None. About nadir both limbs say the same.
        """
        detection = sighting.detection
        if not by_ground(fix, detection.consensus):
            return None
        who = self._who_tells_of_layer(sighting, fix)
        if who is None:
            return None
        of_layer = self._estimator.judged(
            replace(sighting, detection=detection.raised(LAYER_M))
        ).fix
        reasons = filter(None, (of_layer.reason, f"{who}: {_PERHAPS_AT_LAYER}"))
        of_layer = replace(of_layer, reason="; ".join(reasons))
        return in_place_of(fix, self._frames, of_layer, sighting.frames)

    def _who_tells_of_layer(self, sighting: Sighting, fix: HorizonFix) -> str | None:
        """What says that a limb may be a layer's: all frames together, or one camera that by itself
        sees the edge of one there, or its limb so much lower. None under air as it is by day.
        """
        detection = sighting.detection
        if detection.under_daylit_air:
            return None
        shown = shown_by_frames(sighting, self._estimator.sphere)
        if shown:
            return shown
        if self._undisputed(fix, detection.consensus):
            return None
        self._look_near(sighting)
        for seen in detection.observations:
            i = self._number[seen.view.name]
            at_layer = is_at_layer([seen], layer_of(self.detection(i)))
            if at_layer or is_above(fix.fit, self.judged(i).fix):
                return f"{seen.view.name}, by itself"
        return None

    def instead_of(
        self, fix: HorizonFix, layer: Consensus | None
    ) -> tuple[HorizonFix, Detection | None] | None:
        """Fix by what single cameras find by themselves, where all together have none; with the
        detection, if it is of them all. None where they have one, or none of them is believed.

        A flooded frame, or one that glares, may spoil what they agree on. The cone of one camera is
        believed where the others are blind by themselves, or see their limbs on it as well when
        they are asked about it: if another limb is there, nothing tells which to believe.
        layer : as of `is_at_layer`. A camera by itself may not see that its limb is the layer's.
        """
        if fix.ok or len(self._frames) < 2:
            return None
        seen = [limb.status for limb in fix.limbs].count(Status.OK)
        # One camera alone saw a limb, and its fix was too uncertain: what it finds by itself is
        # known, and judged with what the other frames say of the light.
        known = fix.status is Status.UNCERTAIN and seen == 1
        blind = not known and fix.status is not Status.CAMERAS_DISAGREE
        found, limbs = [], list(fix.limbs)
        for i in range(len(self._frames)):
            if fix.limbs[i].status is Status.BAD_IMAGE:
                continue
            judged = self.judged(i)
            by_itself = judged.fix
            at_layer = not by_itself.airglow_alone and is_at_layer(
                self.detection(i).observations, layer
            )
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
            if not all(len(limb_in_sight(frame.view, *near)) for frame in self._frames):
                continue
            sighting = self._look(self._frames, near)
            if is_at_layer(sighting.detection.observations, layer):
                continue
            together = self._estimator.judged(sighting).fix
            if together.ok and len(together.cameras_used) == len(self._frames):
                return together, sighting.detection
        return None

    def _undisputed(self, fix: HorizonFix, consensus: Consensus) -> bool:
        """Whether no camera could find another cone: nearly all edges of all frames lie on this
        one, or there is one camera only.
        """
        num = len(self._frames)
        return num < 2 or (consensus.unanimous and len(fix.cameras_used) == num)
