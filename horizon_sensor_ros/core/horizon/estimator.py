"""From the limb found in simultaneous frames to nadir and altitude with all that may be wrong with
them, or the reason why there is no fix.
"""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from horizon_sensor_ros.core.aiding import Aiding
from horizon_sensor_ros.core.airglow.alone import by_airglow_alone
from horizon_sensor_ros.core.airglow.nadir import fit_airglow, under_stars, with_airglow
from horizon_sensor_ros.core.covariance.bare_ground import with_bare_ground
from horizon_sensor_ros.core.covariance.lifted_edges import with_lifted_edges
from horizon_sensor_ros.core.covariance.night import by_night
from horizon_sensor_ros.core.covariance.two_fields import with_two_fields
from horizon_sensor_ros.core.fits import fit_horizon
from horizon_sensor_ros.core.fits.known_altitude import with_altitude
from horizon_sensor_ros.core.fits.maximum_likelihood import METHOD as MAXIMUM_LIKELIHOOD
from horizon_sensor_ros.core.fits.maximum_likelihood import fit_maximum_likelihood
from horizon_sensor_ros.core.fits.observation import LimbObservation
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.horizon.agreement import each_alone, with_contradiction
from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.core.horizon.fit_errors import common_covariance, with_errors
from horizon_sensor_ros.core.horizon.fix import HorizonFix, told_by
from horizon_sensor_ros.core.horizon.frame_doubts import doubtful_frames
from horizon_sensor_ros.core.horizon.judgement import (
    bends_by_itself,
    disagreement_rad,
    nadir_sigma_rad,
    refusal,
)
from horizon_sensor_ros.core.horizon.sighting import Sighting
from horizon_sensor_ros.core.limb.canny_limbs import canny_limbs
from horizon_sensor_ros.core.limb.detection import Detection
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.motion.turn_rate import TurnRate, rate_by_gyro
from horizon_sensor_ros.core.planet_figure import (
    Disc,
    Figure,
    MeanSphere,
    StretchedEllipsoid,
    mean_sphere,
)
from horizon_sensor_ros.core.status import Status

# The fit weighs points by their own errors only. Where the points of one camera share a much larger
# error than those of another, the joint fit may be worse than the better camera alone. That camera
# is used alone where its sigma of nadir is below this share of the joint one. Where all limbs were
# separated from their glow they are weighed by shared errors too, and this is not asked.
_SURER = 0.5  # in general
# Where its limb was separated from the glow, and the others' edges were found one by one: in 24
# such simulated pairs it was nearer to the truth in 21.
_SURER_IN_GLOW = 0.95
# Edges in glow lie too high, by more than they claim. In simulated scenes a fix of separated limbs
# is nearer to the truth up to this multiple of the sigma of the fix with edges.
_NOT_LESS_SURE = 1.5
# Airglow knows nadir to 0.15 deg at best: it is not used where the limb alone has a smaller sigma.
_SURE_RAD = np.radians(0.05)
_BY_AIRGLOW_ALONE = "by the airglow's edge alone: no limb of the ground's shows below it"


@dataclass(frozen=True, eq=False)
class Judged:
    """What the limbs of a sighting came to.

    fix : of them; where any frame is doubtful it is not OK and has no reason of its own, and a
    search is made again without those frames. doubtful : by index into the frames, a limb without
    points whose `reason` says what speaks against it.
    """

    fix: HorizonFix
    doubtful: Mapping[int, LimbPoints] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class _Limbs:
    """The limbs that a fit was made of.

    observations : one per frame. alone : fits of single cameras, see `each_alone`.
    contradiction : how the cameras contradict each other, for a person; empty where they agree.
    """

    observations: Sequence[LimbObservation]
    alone: Sequence[HorizonFit]
    contradiction: str

    @property
    def points(self) -> tuple[LimbPoints, ...]:
        """Points of the limb, one set per frame."""
        return tuple(seen.limb for seen in self.observations)


class HorizonEstimator:
    """Limbs that were found, to a fix."""

    def __init__(self, config: HorizonConfig) -> None:
        self.config = config
        self.sphere = mean_sphere(config.planet)

    def figure(self, aiding: Aiding) -> Figure:
        """Return what stands for the planet, by what is known of a set of frames."""
        planet, vertical = self.config.planet, self.config.vertical
        if planet.flattening == 0.0 or aiding.coarse_pose is None:
            return MeanSphere(planet, vertical)
        rate = rate_by_gyro(aiding)
        if rate is None:
            rate = TurnRate(np.zeros(3), self.config.rate_sigma_rad_s)
        return StretchedEllipsoid(planet, vertical, aiding.coarse_pose, rate=rate)

    def judged(self, sighting: Sighting, hidden: Container[int] = ()) -> Judged:
        """Fit the limbs of a sighting and judge the fit.

        hidden : numbers of the frames in which a part of the craft is known to lie before the sky.
        """
        views, detection = sighting.views, sighting.detection
        observations = by_night(detection).seen_by(views)
        observations = with_lifted_edges(observations, self.sphere, detection.rho_rad)
        observations = with_bare_ground(observations, self.sphere, detection.rho_rad)
        observations = with_two_fields(
            observations, sighting.images, detection.nadir_base, sighting.moves_rad_s
        )
        if self.config.limb == "canny" and np.isfinite(detection.rho_rad):
            found = canny_limbs(views, sighting.images, detection.nadir_base, detection.rho_rad)
            observations = tuple(map(LimbObservation, views, found))
        limbs = tuple(seen.limb for seen in observations)
        if not any(limb.status is Status.OK for limb in limbs):
            why = told_by(views, limbs)
            fit = HorizonFit.none(limbs[0].status, limbs[0].reason, self.config.method)
            return Judged(HorizonFix(fit.status, why, fit, limbs, ()))
        fit = self._fit(observations, detection)
        if not fit.ok:
            return Judged(HorizonFix(fit.status, fit.reason, fit, limbs, ()))
        doubtful = doubtful_frames(sighting, limbs, fit, self.config, hidden)
        if doubtful:
            return _withheld(fit, limbs, doubtful)
        fit = with_errors(fit, observations, sighting.figure, self.config)
        contradiction = ""
        alone: tuple[HorizonFit, ...] = ()
        if len(fit.cameras) > 1 and self.config.limb == "subpixel":
            as_of_all = partial(with_errors, figure=sighting.figure, config=self.config)
            alone = each_alone(fit, observations, self.sphere, as_of_all)
            bent = bends_by_itself(fit, observations, alone)
            if bent:
                none = {i: LimbPoints.none(Status.NO_LIMB, why) for i, why in bent.items()}
                return _withheld(fit, limbs, none)
            fit, contradiction = with_contradiction(fit, alone, observations, self.sphere)
        return Judged(self._surest(sighting, fit, _Limbs(observations, alone, contradiction)))

    def prefer_separated(
        self, sighting: Sighting, fix: HorizonFix, hidden: Container[int] = ()
    ) -> tuple[HorizonFix, Detection]:
        """Prefer a fix from only those cameras whose limb was separated from the glow above it.

        fix : of the sighting, from edges in glow. It is returned as it is where no limb was
        separated, or where the other one is not OK or has more than `_NOT_LESS_SURE` times its
        sigma. hidden : as of `judged`. Returns the fix and the detection that it is of.
        """
        separated = sighting.detection.separated_only
        if separated is None or not (fix.ok or fix.status in (Status.UNCERTAIN, Status.POOR_FIT)):
            return fix, sighting.detection
        other = self.judged(replace(sighting, detection=separated), hidden).fix
        if not other.ok:
            return fix, sighting.detection
        if fix.ok and nadir_sigma_rad(other.fit) > _NOT_LESS_SURE * nadir_sigma_rad(fix.fit):
            return fix, sighting.detection
        return other, separated

    def by_airglow_alone(self, sighting: Sighting, by_ground: Judged) -> HorizonFix | None:
        """Fix by the airglow's edge, where a layer of it shows and no ground behind it that would
        tell nadir, or none that is beyond doubt; None otherwise.
        """
        fix, detection = by_ground.fix, sighting.detection
        layer = detection.consensus
        shown = [limb.status for limb in fix.limbs].count(Status.OK)
        no_ground = (
            layer.status is Status.POOR_FIT
            or fix.status is Status.ILL_CONDITIONED
            or 0 < shown == len(by_ground.doubtful)
        )
        as_usual = self.config.method == MAXIMUM_LIKELIHOOD and self.config.limb == "subpixel"
        if fix.ok or not (layer.below_layer and no_ground and as_usual):
            return None
        figure = sighting.figure.aligned(layer.nadir_base)
        found = by_airglow_alone(
            [(frame.gray, figure.view(frame.view)) for frame in sighting.frames],
            detection.working,
            (layer.nadir_base, layer.rho_rad),
            figure,
            mounting_sigma_rad=self.config.mounting_sigma_rad,
            lens_sigma_px=self.config.lens_sigma_px,
        )
        if found is None:
            return None
        edge, observations = found.edge, found.observations
        estimate = found.above_ground(self.sphere)
        estimate, unused = self._of_the_planet(estimate, figure, sighting.aiding)
        refused = refusal(edge, observations, self.config, layered=True, estimate=estimate)
        if refused is not None:
            if refused[0] is not Status.UNCERTAIN:
                return None
            reason = f"{refused[1]}, by the airglow's edge alone"
            return self.refused(refused[0], reason, edge, fix.limbs)
        disc = Disc(figure, edge.nadir_base, edge.rho_rad)
        return HorizonFix(
            Status.OK,
            "; ".join(filter(None, (_BY_AIRGLOW_ALONE, unused))),
            replace(estimate, disc=disc),
            tuple(seen.limb for seen in observations),
            edge.cameras,
            airglow=edge,
            airglow_alone=True,
        )

    def refused(
        self, status: Status, reason: str, fit: HorizonFit, limbs: tuple[LimbPoints, ...]
    ) -> HorizonFix:
        """Return no fix, where there is a fit that is not to be believed, and why."""
        none = HorizonFit.none(status, reason, self.config.method, fit.num_points)
        return HorizonFix(status, reason, none, limbs, ())

    def _surest(self, sighting: Sighting, fit: HorizonFit, limbs: _Limbs) -> HorizonFix:
        """Fix of all cameras together, or of the one that is much surer by itself."""
        fix = self._published(sighting, fit, limbs)
        surest = min(limbs.alone, key=nadir_sigma_rad, default=fit)
        separated = {seen.view.name for seen in limbs.observations if seen.limb.glow_separated}
        much = _SURER_IN_GLOW if separated.issuperset(surest.cameras) else _SURER
        surer = (
            surest.method == fit.method
            and not (limbs.contradiction or separated.issuperset(fit.cameras))
            and nadir_sigma_rad(surest) < much * nadir_sigma_rad(fit)
        )
        if surer and (fix.ok or fix.status is Status.UNCERTAIN):
            other = self._published(sighting, surest, limbs)
            return other.surer_without_rest(sighting.views) if other.ok else fix
        return fix

    def _published(self, sighting: Sighting, fit: HorizonFit, limbs: _Limbs) -> HorizonFix:
        """Fix of a fit with its errors, with what else is known, if it may be published."""
        figure, detection = sighting.figure, sighting.detection
        estimate, contradicted = fit, None
        airglow = self._airglow(sighting, fit, limbs.observations)
        if airglow is not None:
            estimate, contradicted = self._with_airglow(fit, airglow, limbs.observations, figure)
        estimate, unused = self._of_the_planet(estimate, figure, sighting.aiding)
        glows = [
            detection.glow_over_usual(i)
            for i, seen in enumerate(limbs.observations)
            if seen.view.name in fit.cameras
        ]
        refused = refusal(
            fit,
            limbs.observations,
            self.config,
            alone=limbs.alone,
            layered=detection.below_layer,
            layer_m=detection.layer_heights_m(fit, self.config.planet),
            glow_over_usual=max(glows, default=0.0),
            estimate=estimate,
        )
        refused = refused or contradicted
        if limbs.contradiction and refused is not None and refused[0] is Status.UNCERTAIN:
            refused = Status.CAMERAS_DISAGREE, limbs.contradiction
        if refused is not None:
            return self.refused(*refused, fit, limbs.points)
        doubts = "; ".join(filter(None, (limbs.contradiction, unused)))
        # The disc stays the one that the frames show, wherever the known altitude puts nadir.
        found = replace(estimate, disc=Disc(figure, fit.nadir_base, fit.rho_rad))
        return HorizonFix(Status.OK, doubts, found, limbs.points, fit.cameras, airglow=airglow)

    def _airglow(
        self, sighting: Sighting, fit: HorizonFit, observations: Sequence[LimbObservation]
    ) -> HorizonFit | None:
        """The airglow's edge above the limb of a fit; None where it does not show by night, or the
        limb knows nadir well without it.
        """
        detection = sighting.detection
        if not (detection.airglow and self.sphere.has_air) or nadir_sigma_rad(fit) <= _SURE_RAD:
            return None
        seen = list(zip(sighting.images, observations, strict=True))
        airglow = fit_airglow(seen, fit, self.sphere)
        # A layer shows by night alone; where the limb is followed it was found by a search.
        known = detection.below_layer or detection.agreed is None
        if airglow is None or known:
            return airglow
        return airglow if under_stars(sighting.views, detection.working, airglow) else None

    def _with_airglow(
        self,
        fit: HorizonFit,
        airglow: HorizonFit,
        observations: Sequence[LimbObservation],
        figure: Figure,
    ) -> tuple[HorizonFit, tuple[Status, str] | None]:
        """Estimate by the airglow's nadir too, and why there is none where that is another."""
        apart_rad = disagreement_rad(fit, airglow)
        if apart_rad is not None:
            reason = f"the airglow above it has its nadir {np.degrees(apart_rad):.1f} deg off"
            return fit, (Status.POOR_FIT, f"not the ground's limb: {reason}")
        common = common_covariance(fit, observations, figure, self.config)
        return with_airglow(fit, airglow, common, self.sphere), None

    def _of_the_planet(
        self, fit: HorizonFit, figure: Figure, aiding: Aiding
    ) -> tuple[HorizonFit, str]:
        """Estimate of nadir and altitude above the planet that a fit of its sphere makes, by the
        altitude that is known too, if one is; and why that is not used.
        """
        estimate = figure.estimate(fit)
        if aiding.altitude is None:
            return estimate, ""
        # Not before: how high one height is above the stretched planet changes with latitude, which
        # the update moves with nadir.
        return with_altitude(estimate, aiding.altitude, self.sphere)

    def _fit(self, observations: Sequence[LimbObservation], detection: Detection) -> HorizonFit:
        """Fit by the configured method, from the cone that the limb was measured around."""
        if self.config.method == MAXIMUM_LIKELIHOOD and np.isfinite(detection.rho_rad):
            near = detection.nadir_base, detection.rho_rad
            fit = fit_maximum_likelihood(observations, self.sphere, near)
            if fit.ok:
                return fit
        return fit_horizon(observations, self.sphere, self.config.method)


def _withheld(
    fit: HorizonFit, limbs: tuple[LimbPoints, ...], doubtful: Mapping[int, LimbPoints]
) -> Judged:
    """No fix yet: some of its frames are doubtful, and a fit without them may differ."""
    return Judged(HorizonFix(Status.NO_LIMB, "", fit, limbs, ()), doubtful)
