"""The whole horizon chain: simultaneous frames of N cameras in, nadir and altitude out, or the
reason why not.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from horizon_sensor_ros.core.agreement import each_alone, with_contradiction
from horizon_sensor_ros.core.aiding import NOTHING_KNOWN, Aiding
from horizon_sensor_ros.core.airglow_alone import by_airglow_alone
from horizon_sensor_ros.core.airglow_nadir import fit_airglow, under_stars, with_airglow
from horizon_sensor_ros.core.calibration_error import with_calibration_error
from horizon_sensor_ros.core.camera_view import CameraView
from horizon_sensor_ros.core.figure import (
    Disc,
    Figure,
    MeanSphere,
    StretchedEllipsoid,
    disc_of,
    mean_sphere,
)
from horizon_sensor_ros.core.fits import fit_horizon
from horizon_sensor_ros.core.fits.assessment import inliers, root_mean_square
from horizon_sensor_ros.core.fits.known_altitude import with_altitude
from horizon_sensor_ros.core.fits.maximum_likelihood import METHOD as MAXIMUM_LIKELIHOOD
from horizon_sensor_ros.core.fits.maximum_likelihood import fit_maximum_likelihood
from horizon_sensor_ros.core.fits.observation import LimbObservation
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.hidden_air import hidden_air_sigma_m
from horizon_sensor_ros.core.horizon_config import HorizonConfig
from horizon_sensor_ros.core.judgement import (
    bends_by_itself,
    disagreement_rad,
    doubt,
    full_scale,
    nadir_sigma_rad,
    refusal,
)
from horizon_sensor_ros.core.limb.canny_limbs import canny_limbs
from horizon_sensor_ros.core.limb.detection import Detection
from horizon_sensor_ros.core.limb.detector import detect_limb, follow_limb
from horizon_sensor_ros.core.limb.evidence import sky_evidence
from horizon_sensor_ros.core.limb.night import by_night
from horizon_sensor_ros.core.limb_curve import limb_in_sight
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.shared_error import with_shared_error
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.core.track import Track

# Longer side of a frame over the shorter one.
_MOST_LENGTHY = 100.0


@dataclass(frozen=True)
class Frame:
    """One image and the camera that took it. gray : (H, W) uint8 or uint16."""

    view: CameraView
    gray: np.ndarray


@dataclass(frozen=True)
class HorizonFix:
    """What simultaneous frames told.

    reason : why there is no estimate, or what makes it less certain; empty where nothing does.
    fit : the estimate, NaN when status is not OK. limbs : one per frame, in order; a frame that
    contributed nothing says why. cameras_used : names of those that did. predicted : where the limb
    was expected, if it was followed and not searched for. airglow : the edge of the airglow above
    the limb, as a fit of its own, where nadir is by that too. airglow_alone : all is by that edge,
    and limbs are points of it.
    """

    status: Status
    reason: str
    fit: HorizonFit
    limbs: tuple[LimbPoints, ...]
    cameras_used: tuple[str, ...]
    predicted: Disc | None = None
    airglow: HorizonFit | None = None
    airglow_alone: bool = False

    @property
    def ok(self) -> bool:
        """True when there is an estimate."""
        return self.status is Status.OK

    def residual_px(self, view: CameraView, limb: LimbPoints) -> float:
        """Root mean square distance of one camera's limb points from the fitted limb.

        Outliers are left out. NaN without a fix or without points.
        """
        if not self.ok:
            return np.nan
        residual = disc_of(self.fit).residuals_px(view, limb)
        return root_mean_square(residual[inliers(residual)]) if len(residual) else np.nan


# Points count by what each is off by on its own; where one camera's are off together by much more
# than another's, both together may be off by more than the one. It is taken by itself where it
# claims less than so much of that: of edges found one by one, and of a limb told from its glow
# beside such, which of 24 pairs was nearer to the truth by itself in all but three. Limbs that all
# are told from their glow are weighed by what they are off by together.
_SURER, _SURER_IN_GLOW = 0.5, 0.95
# Edges in glow lie too high, by more than they know: of simulated scenes limbs that were told from
# it are nearer to the truth even where they claim so much more.
_NOT_LESS_SURE = 1.5
_LESS_SURE = "the other camera is surer without it"
# Nadir by the limb alone that airglow would say little more of: it knows it to .15 deg at best.
_SURE_RAD = np.radians(0.05)
_BY_AIRGLOW_ALONE = "by the airglow's edge alone: no limb of the ground's shows below it"
# Sets of frames followed before the whole frames are searched again: a track that had slipped off
# the limb, or a camera that has come to see it, is noticed after so many at the latest.
_LONGEST_TRACK = 50


class HorizonSensor:
    """Frames of any number of cameras to nadir and altitude."""

    def __init__(self, config: HorizonConfig | None = None) -> None:
        self.config = HorizonConfig() if config is None else config
        planet = self.config.planet
        self._sphere = mean_sphere(planet)
        self._rho_min = self._sphere.rho_from_altitude(self.config.altitude_max_m)
        # Nothing is seen from below the limb.
        lowest_m = max(self.config.altitude_min_m, planet.limb_height_m)
        self._rho_max = self._sphere.rho_from_altitude(lowest_m)
        self._track: Track | None = None

    def reset(self) -> None:
        """Forget where the limb was: the next frames are searched."""
        self._track = None

    @property
    def following(self) -> bool:
        """Whether the last fix came from following the limb, not from a search."""
        return self._track is not None and self._track.age > 0

    def process(self, frames: Sequence[Frame], aiding: Aiding = NOTHING_KNOWN) -> HorizonFix:
        """Find the horizon in simultaneous frames, with what is known of them from elsewhere.

        A camera whose frame shows no trustworthy limb is left out and the others decide; its entry
        in `limbs` says why. Raises ValueError for no frames at all, or an image that is not (H, W)
        uint8 or uint16; a frame of another size than its camera's is refused with status BAD_IMAGE.
        """
        if len(frames) == 0:
            raise ValueError("frames must hold at least one frame")
        limbs: list[LimbPoints | None] = [_unusable(frame) for frame in frames]
        if self._track is not None and not any(limbs):
            followed = self._follow(frames, self._track, aiding)
            if followed is not None:
                return followed
        fix, detection = self._search(frames, limbs, aiding)
        self._track = None
        if (
            self.config.tracking
            and detection is not None
            and fix.fit.disc is not None
            and detection.modelled
        ):
            views = [frame.view for frame in frames]
            shows = detection.layer_rad > 0.0 or fix.airglow is not None
            detection = replace(detection, airglow=shows)
            self._track = Track.started(views, detection, fix.fit, _on_one_cone(views, fix))
        return fix

    def _search(
        self, frames: Sequence[Frame], limbs: list[LimbPoints | None], aiding: Aiding
    ) -> tuple[HorizonFix, Detection | None]:
        """Look for the limb all over the frames; with the detection, if the answer is of them all.

        limbs : one per frame, None where it is yet to be looked for.
        """
        everything = not any(limbs)
        while True:
            rest = [i for i, limb in enumerate(limbs) if limb is None]
            if not rest:
                return _no_fix(frames, limbs), None
            seen = [frames[i] for i in rest]
            detection, figure = self._detect(seen, aiding)
            fix, doubtful = self._judge(seen, detection, figure, aiding)
            fix, detection = self._told_apart(seen, fix, detection, figure, aiding)
            by_layer = self._by_airglow_alone(seen, fix, doubtful, detection, figure, aiding)
            if by_layer is not None and (by_layer.ok or not doubtful):
                fix, doubtful = by_layer, {}
            if not doubtful:
                reason = fix.reason if fix.ok else _reason_and_left_out(frames, limbs, fix.reason)
                for i, limb in zip(rest, fix.limbs, strict=True):
                    limbs[i] = limb
                fix = replace(fix, reason=reason, limbs=tuple(_filled(limbs)))
                contradicted = self._contradicted(frames, fix, aiding)
                if contradicted is not None:
                    return contradicted, None
                return self._from_singles(frames, fix, aiding) or (
                    fix,
                    detection if everything and not fix.airglow_alone else None,
                )
            # What a camera says against itself may have misled the others: once more without it.
            everything = False
            for i, limb in doubtful.items():
                limbs[rest[i]] = limb

    def _contradicted(
        self, frames: Sequence[Frame], fix: HorizonFix, aiding: Aiding
    ) -> HorizonFix | None:
        """Refusal of one camera's fix where another camera, looked at alone, has a fix elsewhere.

        Where the extrinsics are wrong two good limbs lie on no common cone; the consensus keeps
        one of them, and nothing tells which camera is the one that is mounted as it should be.
        """
        if not fix.ok or len(fix.cameras_used) > 1:
            return None
        for frame, limb in zip(frames, fix.limbs, strict=True):
            if limb.status in (Status.OK, Status.BAD_IMAGE):
                continue
            # However little the other knows: that is in its covariance.
            any_sigma = HorizonSensor(replace(self.config, max_nadir_sigma_rad=np.pi))
            alone, doubtful = any_sigma._attempt([frame], aiding)
            if not alone.ok or doubtful:
                continue
            apart = disagreement_rad(alone.fit, fix.fit)
            if apart > 0.0:
                reason = (
                    f"{frame.view.name} alone finds nadir {np.degrees(apart):.1f} deg "
                    f"from that of {fix.cameras_used[0]}"
                )
                none = HorizonFit.none(
                    Status.CAMERAS_DISAGREE, reason, self.config.method, fix.fit.num_points
                )
                return HorizonFix(none.status, reason, none, fix.limbs, ())
        return None

    def _from_singles(
        self, frames: Sequence[Frame], fix: HorizonFix, aiding: Aiding
    ) -> tuple[HorizonFix, Detection | None] | None:
        """Fix by what single cameras find by themselves, where all together have none; with the
        detection, if it is of them all.

        A flooded frame, or one that glares, may spoil what they agree on. The cone of one camera is
        believed where the others are blind by themselves, or see their limbs on it as well when
        they are asked about it: if another limb is there, nothing tells which to believe.
        """
        if fix.ok or len(frames) < 2:
            return None
        seen = [limb.status for limb in fix.limbs].count(Status.OK)
        # Of one camera's it is known already, with what the others' frames say of the light.
        known = fix.status is Status.UNCERTAIN and seen == 1
        blind = not known and fix.status is not Status.CAMERAS_DISAGREE
        found, limbs = [], list(fix.limbs)
        any_sigma = HorizonSensor(replace(self.config, max_nadir_sigma_rad=np.pi))
        for i, frame in enumerate(frames):
            if fix.limbs[i].status is Status.BAD_IMAGE:
                continue
            alone, doubtful = any_sigma._attempt([frame], aiding)
            if alone.ok and not doubtful:
                found.append(alone)
            elif not doubtful and alone.status is not Status.NO_LIMB:
                blind = False
            # Of a camera that is left out, what it says by itself.
            limbs[i] = doubtful.get(0, alone.limbs[0])
        found.sort(key=lambda one: nadir_sigma_rad(one.fit))
        if blind and len(found) == 1:
            sure = nadir_sigma_rad(found[0].fit) <= self.config.max_nadir_sigma_rad
            return (replace(found[0], limbs=tuple(limbs)), None) if sure else None
        for alone in found:
            disc = disc_of(alone.fit)
            near = disc.nadir, disc.rho_rad
            if not all(len(limb_in_sight(frame.view, *near)) for frame in frames):
                continue
            detection, figure = self._detect(frames, aiding, near)
            together, doubtful = self._judge(frames, detection, figure, aiding)
            if together.ok and not doubtful and len(together.cameras_used) == len(frames):
                return together, detection
        return None

    def _figure(self, aiding: Aiding) -> Figure:
        planet, vertical = self.config.planet, self.config.vertical
        if planet.flattening == 0.0 or aiding.coarse_pose is None:
            return MeanSphere(planet, vertical)
        return StretchedEllipsoid(planet, vertical, aiding.coarse_pose)

    def _follow(self, frames: Sequence[Frame], track: Track, aiding: Aiding) -> HorizonFix | None:
        """Fix from where the limb is expected; None where a search has to say what is there."""
        if track.age >= _LONGEST_TRACK or not track.is_of([frame.view for frame in frames]):
            return None
        nadir, rho = track.predicted_cone(aiding.rot_now_from_last)
        figure = self._figure(aiding).aligned(nadir)
        views = [figure.view(frame.view) for frame in frames]
        images = [frame.gray for frame in frames]
        detection = follow_limb(
            views,
            images,
            self._sphere,
            nadir,
            rho,
            track.sees,
            track.looks,
            track.factors,
            track.smears,
            track.steepness,
        )
        if detection is None:
            return None
        samples = track.samples(images)
        detection = replace(
            detection, candidates=samples, layer_rad=track.layer_rad, airglow=track.airglow
        )
        fix, doubtful = self._judge(frames, detection, figure, aiding)
        fix, detection = self._told_apart(frames, fix, detection, figure, aiding)
        seen = _on_one_cone([frame.view for frame in frames], fix)
        if doubtful or seen != track.cameras or fix.fit.disc is None:
            return None
        self._track = track.continued(detection, fix.fit)
        return replace(fix, predicted=Disc(figure, nadir, rho))

    def _attempt(
        self, frames: Sequence[Frame], aiding: Aiding
    ) -> tuple[HorizonFix, dict[int, LimbPoints]]:
        """One search and fit; with the frames whose own evidence speaks against it, and why."""
        return self._judge(frames, *self._detect(frames, aiding), aiding)

    def _detect(
        self,
        frames: Sequence[Frame],
        aiding: Aiding,
        near: tuple[np.ndarray, float] | None = None,
    ) -> tuple[Detection, Figure]:
        """Limb in whole frames, and the planet's figure as it turned out to lie.

        near : as of `detect_limb`.
        """
        figure = self._figure(aiding)
        detection = detect_limb(
            [figure.view(frame.view) for frame in frames],
            [frame.gray for frame in frames],
            self._sphere,
            rho_min_rad=self._rho_min,
            rho_max_rad=self._rho_max,
            near=near,
        )
        if np.isfinite(detection.rho_rad):
            figure = figure.aligned(detection.nadir_base)
        return detection, figure

    def _judge(
        self, frames: Sequence[Frame], detection: Detection, figure: Figure, aiding: Aiding
    ) -> tuple[HorizonFix, dict[int, LimbPoints]]:
        """Fit of a detection; with the frames whose own evidence speaks against it, and why."""
        views = [figure.view(frame.view) for frame in frames]
        observations = by_night(detection).seen_by(views)
        if self.config.limb == "canny" and np.isfinite(detection.rho_rad):
            images = [frame.gray for frame in frames]
            limbs = canny_limbs(views, images, detection.nadir_base, detection.rho_rad)
            observations = tuple(map(LimbObservation, views, limbs))
        limbs = tuple(seen.limb for seen in observations)
        if not any(limb.status is Status.OK for limb in limbs):
            fit = HorizonFit.none(limbs[0].status, limbs[0].reason, self.config.method)
            return HorizonFix(fit.status, _reasons(views, limbs), fit, limbs, ()), {}
        fit = self._fit(observations, detection)
        if not fit.ok:
            return HorizonFix(fit.status, fit.reason, fit, limbs, ()), {}
        doubtful = self._doubts(frames, views, detection, limbs, fit)
        if doubtful:
            return HorizonFix(Status.NO_LIMB, "", fit, limbs, ()), doubtful
        fit = self._with_errors(fit, observations, figure)
        apart = ""
        alone: tuple[HorizonFit, ...] = ()
        if len(fit.cameras) > 1 and self.config.limb == "subpixel":
            with_errors = partial(self._with_errors, figure=figure)
            alone = each_alone(fit, observations, self._sphere, with_errors)
            bent = bends_by_itself(fit, observations, alone)
            if bent:
                none = {i: LimbPoints.none(Status.NO_LIMB, why) for i, why in bent.items()}
                return HorizonFix(Status.NO_LIMB, "", fit, limbs, ()), none
            fit, apart = with_contradiction(fit, alone, observations, self._sphere)
        published = partial(
            self._published,
            frames=frames,
            observations=observations,
            detection=detection,
            figure=figure,
            aiding=aiding,
            alone=alone,
            apart=apart,
        )
        fix = published(fit)
        surest = min(alone, key=nadir_sigma_rad, default=fit)
        told = {seen.view.name for seen in observations if seen.limb.joint}
        surer = (
            surest.method == fit.method
            and not (apart or told.issuperset(fit.cameras))
            and nadir_sigma_rad(surest)
            < (_SURER_IN_GLOW if told.issuperset(surest.cameras) else _SURER) * nadir_sigma_rad(fit)
        )
        if surer and (fix.ok or fix.status is Status.UNCERTAIN):
            other = published(surest)
            fix = _with_reasons(other, views) if other.ok else fix
        return fix, {}

    def _published(
        self,
        fit: HorizonFit,
        *,
        frames: Sequence[Frame],
        observations: Sequence[LimbObservation],
        detection: Detection,
        figure: Figure,
        aiding: Aiding,
        alone: Sequence[HorizonFit],
        apart: str,
    ) -> HorizonFix:
        """Fix of a fit with its errors, with what else is known, if it may be published.

        alone : as of `each_alone`. apart : what cameras contradict each other by, in words.
        """
        limbs = tuple(seen.limb for seen in observations)
        estimate, contradicted = fit, None
        airglow = self._airglow(frames, fit, observations, detection)
        if airglow is not None:
            estimate, contradicted = self._with_airglow(fit, airglow, observations, figure)
        estimate, unused = self._with_known_altitude(estimate, figure, aiding)
        glows = [
            detection.glow_over_usual(i)
            for i, seen in enumerate(observations)
            if seen.view.name in fit.cameras
        ]
        refused = refusal(
            fit,
            observations,
            self.config,
            alone=alone,
            layered=detection.layer_rad > 0.0,
            layer_m=detection.layer_height_m(fit, self.config.planet),
            glow_over_usual=max(glows, default=0.0),
            estimate=estimate,
        )
        refused = refused or contradicted
        if apart and refused is not None and refused[0] is Status.UNCERTAIN:
            refused = Status.CAMERAS_DISAGREE, apart
        if refused is not None:
            none = HorizonFit.none(*refused, self.config.method, fit.num_points)
            return HorizonFix(*refused, none, limbs, ())
        doubts = "; ".join(filter(None, (apart, unused)))
        # The disc stays the one that the frames show, wherever the known altitude puts nadir.
        disc = Disc(figure, fit.nadir_base, fit.rho_rad)
        found = replace(figure.estimate(estimate), disc=disc)
        return HorizonFix(Status.OK, doubts, found, limbs, fit.cameras, airglow=airglow)

    def _with_known_altitude(
        self, estimate: HorizonFit, figure: Figure, aiding: Aiding
    ) -> tuple[HorizonFit, str]:
        """Estimate by the altitude that is known, if one is, and why it is not used."""
        if aiding.altitude is None:
            return estimate, ""
        return with_altitude(estimate, figure.altitude(aiding.altitude), self._sphere)

    def _airglow(
        self,
        frames: Sequence[Frame],
        fit: HorizonFit,
        observations: Sequence[LimbObservation],
        detection: Detection,
    ) -> HorizonFit | None:
        """The airglow's edge above the limb of a fit; None where it does not show by night, or the
        limb knows nadir well without it.
        """
        if not detection.airglow or nadir_sigma_rad(fit) <= _SURE_RAD:
            return None
        seen = [(frame.gray, one) for frame, one in zip(frames, observations, strict=True)]
        airglow = fit_airglow(seen, fit, self._sphere)
        # A layer shows by night alone; where the limb is followed it was found by a search.
        known = detection.layer_rad > 0.0 or detection.agreed is None
        if airglow is None or known:
            return airglow
        views = [one.view for one in observations]
        return airglow if under_stars(views, detection.candidates, airglow) else None

    def _with_airglow(
        self,
        fit: HorizonFit,
        airglow: HorizonFit,
        observations: Sequence[LimbObservation],
        figure: Figure,
    ) -> tuple[HorizonFit, tuple[Status, str] | None]:
        """Estimate by the airglow's nadir too, and why there is none where that is another."""
        apart_rad = disagreement_rad(fit, airglow)
        if apart_rad > 0.0:
            reason = f"the airglow above it has its nadir {np.degrees(apart_rad):.1f} deg off"
            return fit, (Status.POOR_FIT, f"not the ground's limb: {reason}")
        exact = replace(fit, cov_nadir_altitude=np.zeros((4, 4)))
        common = self._with_calibration_error(exact, observations).cov_nadir_altitude
        common = common + figure.covariance(fit, observations)
        return with_airglow(fit, airglow, common, self._sphere), None

    def _by_airglow_alone(
        self,
        frames: Sequence[Frame],
        fix: HorizonFix,
        doubtful: dict[int, LimbPoints],
        detection: Detection,
        figure: Figure,
        aiding: Aiding,
    ) -> HorizonFix | None:
        """Fix by the airglow's edge, where a layer of it shows and no ground behind it that would
        tell nadir, or none that is beyond doubt; None otherwise.
        """
        layer = detection.consensus
        shown = [limb.status for limb in fix.limbs].count(Status.OK)
        no_ground = (
            layer.status is Status.POOR_FIT
            or fix.status is Status.ILL_CONDITIONED
            or 0 < shown == len(doubtful)
        )
        as_usual = self.config.method == MAXIMUM_LIKELIHOOD and self.config.limb == "subpixel"
        if fix.ok or layer.layer_rad == 0.0 or not (no_ground and as_usual):
            return None
        figure = figure.aligned(layer.nadir_base)
        found = by_airglow_alone(
            [(frame.gray, figure.view(frame.view)) for frame in frames],
            detection.candidates,
            (layer.nadir_base, layer.rho_rad),
            figure,
            self.config,
        )
        if found is None:
            return None
        edge, observations = found.edge, found.observations
        estimate = found.above_ground(self._sphere)
        estimate, unused = self._with_known_altitude(estimate, figure, aiding)
        refused = refusal(edge, observations, self.config, layered=True, estimate=estimate)
        limbs = tuple(seen.limb for seen in observations)
        if refused is not None:
            if refused[0] is not Status.UNCERTAIN:
                return None
            reason = f"{refused[1]}, by the airglow's edge alone"
            none = HorizonFit.none(refused[0], reason, self.config.method, edge.num_points)
            return HorizonFix(none.status, reason, none, fix.limbs, ())
        disc = Disc(figure, edge.nadir_base, edge.rho_rad)
        return HorizonFix(
            Status.OK,
            "; ".join(filter(None, (_BY_AIRGLOW_ALONE, unused))),
            replace(figure.estimate(estimate), disc=disc),
            limbs,
            edge.cameras,
            airglow=edge,
            airglow_alone=True,
        )

    def _told_apart(
        self,
        frames: Sequence[Frame],
        fix: HorizonFix,
        detection: Detection,
        figure: Figure,
        aiding: Aiding,
    ) -> tuple[HorizonFix, Detection]:
        """Fix of only those cameras whose limb was told apart from the glow above it, and their
        detection, where it claims hardly more than the one given, which is of edges in glow, or
        where these are not a limb's.
        """
        apart = detection.told_apart
        if apart is None or not (fix.ok or fix.status in (Status.UNCERTAIN, Status.POOR_FIT)):
            return fix, detection
        other, doubtful = self._judge(frames, apart, figure, aiding)
        if not other.ok or doubtful:
            return fix, detection
        if fix.ok and nadir_sigma_rad(other.fit) > _NOT_LESS_SURE * nadir_sigma_rad(fix.fit):
            return fix, detection
        return other, apart

    def _with_errors(
        self, fit: HorizonFit, observations: Sequence[LimbObservation], figure: Figure
    ) -> HorizonFit:
        """Return the fit with all that may be wrong with observations in its covariance."""
        shared = with_shared_error(fit, observations, figure)
        return self._with_calibration_error(shared, observations)

    def _with_calibration_error(
        self, fit: HorizonFit, observations: Sequence[LimbObservation]
    ) -> HorizonFit:
        """Return the fit with what may be wrong with cameras and the limb's height."""
        hidden_m = hidden_air_sigma_m(fit, observations, self._sphere)
        return with_calibration_error(
            fit,
            observations,
            self._sphere,
            mounting_sigma_rad=self.config.mounting_sigma_rad,
            lens_sigma_px=self.config.lens_sigma_px,
            limb_height_sigma_m=math.hypot(self.config.limb_height_sigma_m, hidden_m),
        )

    def _fit(self, observations: Sequence[LimbObservation], detection: Detection) -> HorizonFit:
        """Fit by the configured method, from the cone that the limb was measured around."""
        if self.config.method == MAXIMUM_LIKELIHOOD and np.isfinite(detection.rho_rad):
            near = detection.nadir_base, detection.rho_rad
            fit = fit_maximum_likelihood(observations, self._sphere, near)
            if fit.ok:
                return fit
        return fit_horizon(observations, self._sphere, self.config.method)

    def _doubts(
        self,
        frames: Sequence[Frame],
        views: Sequence[CameraView],
        detection: Detection,
        limbs: Sequence[LimbPoints],
        fit: HorizonFit,
    ) -> dict[int, LimbPoints]:
        """Frames that delivered limb points but whose sky or limb says that they are not the
        limb.
        """
        doubts = {}
        for i, (frame, view, limb) in enumerate(zip(frames, views, limbs, strict=True)):
            if limb.status is not Status.OK:
                continue
            candidates = detection.candidates[i]
            evidence = sky_evidence(
                candidates.reduced,
                int(candidates.pitch_px),
                candidates.space_level,
                candidates.noise,
                view,
                fit.nadir_base,
                fit.rho_rad,
                limb.predicted,
                detection.layer_rad,
            )
            found_px = len(limb.px) * limb.spacing_px if self.config.limb == "subpixel" else np.inf
            space_share = candidates.space_level / full_scale(frame.gray)
            outside = detection.left_outside(i)
            reason = doubt(evidence, found_px, space_share, outside, self.config)
            if reason:
                doubts[i] = LimbPoints.none(Status.NO_LIMB, reason)
        return doubts


def _on_one_cone(views: Sequence[CameraView], fix: HorizonFix) -> tuple[str, ...]:
    """Names of the cameras whose limbs agree, also of those without which the fix is surer."""
    return tuple(
        view.name
        for view, limb in zip(views, fix.limbs, strict=True)
        if view.name in fix.cameras_used or limb.reason == _LESS_SURE
    )


def _with_reasons(fix: HorizonFix, views: Sequence[CameraView]) -> HorizonFix:
    """The same, and limbs that are not in it say why."""
    limbs = tuple(
        replace(limb, reason=_LESS_SURE)
        if limb.status is Status.OK and view.name not in fix.cameras_used
        else limb
        for view, limb in zip(views, fix.limbs, strict=True)
    )
    return replace(fix, limbs=limbs)


def _unusable(frame: Frame) -> LimbPoints | None:
    gray, camera = frame.gray, frame.view.camera
    if (
        not isinstance(gray, np.ndarray)
        or gray.ndim != 2
        or gray.dtype not in (np.uint8, np.uint16)
    ):
        got = f"{getattr(gray, 'dtype', type(gray))} {getattr(gray, 'shape', '')}"
        raise ValueError(f"gray of {frame.view.name} must be (H, W) uint8 or uint16, got {got}")
    if gray.shape != (camera.height, camera.width):
        return LimbPoints.none(
            Status.BAD_IMAGE,
            f"image of {gray.shape[1]} x {gray.shape[0]}, "
            f"camera of {camera.width} x {camera.height}",
        )
    # Much longer than wide, nothing is left of the width in the size that limbs are looked for in.
    if min(gray.shape) < max(16, max(gray.shape) / _MOST_LENGTHY):
        size = f"{gray.shape[1]} x {gray.shape[0]}"
        return LimbPoints.none(Status.BAD_IMAGE, f"image of {size} is too small or too narrow")
    return None


def _no_fix(frames: Sequence[Frame], limbs: Sequence[LimbPoints | None]) -> HorizonFix:
    filled = _filled(limbs)
    reason = _reasons([frame.view for frame in frames], filled)
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


def _reasons(views: Sequence[CameraView], limbs: Sequence[LimbPoints]) -> str:
    if len({limb.reason for limb in limbs}) == 1:
        return limbs[0].reason
    return "; ".join(f"{v.name}: {limb.reason}" for v, limb in zip(views, limbs, strict=True))
