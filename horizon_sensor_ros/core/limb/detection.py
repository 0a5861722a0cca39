"""What was found of the limb in simultaneous frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.fits.observation import LimbObservation
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.limb.air import USUAL_HEIGHT, usual_length_px
from horizon_sensor_ros.core.limb.edge.model import EdgeLook
from horizon_sensor_ros.core.limb.edge.width import Smear
from horizon_sensor_ros.core.limb.search.air_layer import layer_heights_m
from horizon_sensor_ros.core.limb.search.selection import MIN_INLIERS, Consensus, RayCandidates
from horizon_sensor_ros.core.limb.search.working_image import WorkingImage
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.mathematics.robust import medians
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.status import Status

_STRETCHES, _ON_COURSE_PX = 4, 0.6
# Scale heights of air over the usual one that it has by day: simulated limbs .95 to 1.1; layers of
# airglow that pass for air .25.
_USUAL_SHARES = 0.6, 1.5
_ALIKE = {(Status.OK, True)}, {(Status.OK, False)}
_SHORTEST_PX = 1.0  # length of glow that is told from the blur
_NO_CONSENSUS = Consensus(Status.NO_LIMB)


@dataclass(frozen=True, eq=False)
class LimbState:
    """What the limb looked like in simultaneous frames: what following it starts from.

    One per frame, in order: sees : whether the frame shows the limb. looks, factors, smears,
    steepness : as of `Detection`. above_m : of all frames, as of `LimbPoints`. white : whether the
    limb is overexposed, so that its foot alone tells of its edge's look.
    """

    sees: tuple[bool, ...]
    looks: tuple[tuple[EdgeLook, ...], ...]
    factors: tuple[int, ...]
    smears: tuple[Smear | None, ...]
    steepness: tuple[np.ndarray, ...]
    above_m: float
    white: tuple[bool, ...]

    def of(self, frames: Sequence[int]) -> LimbState:
        """That of some of the frames, by number."""
        return LimbState(
            tuple(self.sees[i] for i in frames),
            tuple(self.looks[i] for i in frames),
            tuple(self.factors[i] for i in frames),
            # Of limbs through haze neither is asked.
            tuple(self.smears[i] for i in frames if self.smears),
            tuple(self.steepness[i] for i in frames if self.steepness),
            self.above_m,
            tuple(self.white[i] for i in frames),
        )

    def with_looks(self, frames: Sequence[int], now: Detection) -> LimbState:
        """State of a limb that looks in some frames, by number, as it was detected in them now, and
        in the others as before.
        """
        looks = dict(zip(frames, now.looks, strict=True))
        steepness = dict(zip(frames, now.steepness, strict=True)) if now.steepness else {}
        white = dict(zip(frames, now.state.white, strict=True))
        return replace(
            self,
            white=tuple(white.get(i, before) for i, before in enumerate(self.white)),
            looks=tuple(looks.get(i, before) for i, before in enumerate(self.looks)),
            steepness=tuple(steepness.get(i, before) for i, before in enumerate(self.steepness)),
        )


@dataclass(frozen=True, eq=False)
class Detection:
    """The limb in each frame, and where the last pass of refinement looked for it.

    One per frame, in order:
    observations : the limb.
    looks : models of its edge; empty where none fits.
    factors : by which the frame was reduced for the last pass.
    smears : motion's in it, None where there is hardly any.
    steepness : of the limb, when it was last asked whether motion smears it.
    working : the frame in the size of the search, in which evidence is looked for.
    separated : where some limbs were separated from the glow above them
    (`LimbPoints.glow_separated`) and others were not, those that were; else empty.

    Of all frames together:
    nadir_base (3,), rho_rad : the cone around which the last pass refined; NaN where there is none.
    consensus : what the search agreed on; status NO_LIMB where the limb was followed.
    candidates : the edges of which the consensus is; None where the limb was followed.
    layer_rad : how far above the limb a layer of airglow lies, 0 without one.
    airglow : after a search, whether such a layer may show; where the limb is followed, whether it
    did.
    """

    observations: tuple[LimbObservation, ...]
    working: tuple[WorkingImage, ...] = ()
    consensus: Consensus = _NO_CONSENSUS
    nadir_base: np.ndarray = field(default_factory=lambda: np.full(3, np.nan))
    rho_rad: float = np.nan
    looks: tuple[tuple[EdgeLook, ...], ...] = ()
    factors: tuple[int, ...] = ()
    layer_rad: float = 0.0
    smears: tuple[Smear | None, ...] = ()
    candidates: RayCandidates | None = None
    steepness: tuple[np.ndarray, ...] = ()
    separated: tuple[LimbObservation, ...] = ()
    airglow: bool = True

    @property
    def below_layer(self) -> bool:
        """Whether a layer of airglow lies above the limb."""
        return self.layer_rad > 0.0

    @property
    def limbs(self) -> tuple[LimbPoints, ...]:
        """Limb in each frame."""
        return tuple(seen.limb for seen in self.observations)

    @property
    def state(self) -> LimbState:
        """What the limb looks like, to follow it from."""
        sees = tuple(limb.status is Status.OK for limb in self.limbs)
        above_m = max((limb.above_m for limb in self.limbs), default=0.0)
        white = tuple(limb.shared.white_px > 0.0 for limb in self.limbs)
        return LimbState(
            sees, self.looks, self.factors, self.smears, self.steepness, above_m, white
        )

    @cached_property
    def agreed(self) -> RayCandidates | None:
        """The candidates that agree, on the limb or on the airglow's edge; None without any."""
        return None if self.candidates is None else self.candidates.take(self.consensus.inliers)

    def seen_by(self, views: Sequence[CameraView]) -> tuple[LimbObservation, ...]:
        """Return the observations by cameras that may have been stretched anew since."""
        return tuple(
            seen if seen.view is view else LimbObservation(view, seen.limb)
            for seen, view in zip(self.observations, views, strict=True)
        )

    @property
    def modelled(self) -> bool:
        """Whether a model fits the edge of every limb that was seen."""
        return all(
            look or limb.status is not Status.OK
            for limb, look in zip(self.limbs, self.looks, strict=True)
        )

    @property
    def glow_separated(self) -> bool:
        """Whether limb and glow were separated in every frame that shows a limb."""
        return all(limb.glow_separated for limb in self.limbs if limb.status is Status.OK)

    @property
    def seen_alike(self) -> bool:
        """Whether every frame shows the limb, in its full size, and by the same model: sharp, or
        separated from the glow above it.
        """
        alike = {(limb.status, limb.glow_separated) for limb in self.limbs}
        return self.modelled and alike in _ALIKE and max(self.factors) == 1

    @property
    def under_daylit_air(self) -> bool:
        """Whether every limb that was seen was separated from the glow above it, and that fades as
        the Earth's air does by day. The upper side of a layer of airglow fades over a quarter of
        that.
        """
        low, high = (share * USUAL_HEIGHT for share in _USUAL_SHARES)
        usual = [
            limb.glow_separated
            and any(kind.air is not None and low < kind.air.height < high for kind in kinds)
            for limb, kinds in zip(self.limbs, self.looks, strict=True)
            if limb.status is Status.OK
        ]
        return bool(usual) and all(usual)

    @property
    def separated_only(self) -> Detection | None:
        """Detection of only those limbs that were separated from the glow above them; None where
        all or none were.

        Edges in glow lie a pixel or two too far out, so that they and the ground's limb lie on two
        cones and must not be mixed in one fit. In the detection itself all limbs are edges.
        """
        if not self.separated:
            return None
        looks = tuple(
            kinds if seen.limb.status is Status.OK else ()
            for seen, kinds in zip(self.separated, self.looks, strict=True)
        )
        return replace(self, observations=self.separated, looks=looks, separated=())

    @cached_property
    def on_course(self) -> bool:
        """Whether every limb that was seen lies near the cone that it was measured around, or was
        sought around cones of its own.
        """
        return all(
            limb.glow_separated or _on_course(limb, _ON_COURSE_PX * factor)
            for limb, factor in zip(self.limbs, self.factors, strict=True)
            if limb.status is Status.OK
        )

    def left_outside(self, index: int) -> float:
        """Share (0 to 1) of the edges on which the search agreed that lie outside a frame's limb; 0
        where the limb was followed, or where glow above it may explain them.
        """
        if self.agreed is None or self.below_layer or self.limbs[index].glow_separated:
            return 0.0
        of_frame = self.agreed.camera == index
        outside = self.agreed.outside(self.nadir_base, self.rho_rad) & of_frame
        return int(np.count_nonzero(outside)) / max(int(np.count_nonzero(of_frame)), 1)

    def layer_heights_m(self, fit: HorizonFit, planet: Planet) -> tuple[float, float, float] | None:
        """Quartiles of the height of the layer of airglow above a fit's limb; None where it was not
        measured.
        """
        if self.agreed is None or not self.below_layer:
            return None
        return layer_heights_m(self.agreed, (fit.nadir_base, fit.rho_rad), planet)

    def glow_over_usual(self, index: int) -> float:
        """Length over which the glow above a frame's limb fades, as a multiple of the Earth's usual
        one; 0 without glow, where limb and glow were separated, and below a layer of airglow.
        """
        limb, looks = self.limbs[index], self.looks[index]
        if self.below_layer or limb.glow_separated or not looks or looks[0].glow_px == 0.0:
            return 0.0
        view = self.observations[index].view
        usual_px = usual_length_px(view, self.rho_rad, self.factors[index])
        return looks[0].glow_px / max(usual_px, _SHORTEST_PX)

    def raised(self, above_m: float) -> Detection:
        """Detection whose limbs may lie so far above the ground at least."""
        return self.with_limbs(
            [
                limb if limb.above_m >= above_m else replace(limb, above_m=above_m)
                for limb in self.limbs
            ]
        )

    def with_limbs(self, limbs: Sequence[LimbPoints]) -> Detection:
        """Detection with other points of the limbs, one a frame, or other errors of theirs."""
        if all(seen.limb is limb for seen, limb in zip(self.observations, limbs, strict=True)):
            return self
        return replace(
            self,
            observations=tuple(
                seen if seen.limb is limb else LimbObservation(seen.view, limb)
                for seen, limb in zip(self.observations, limbs, strict=True)
            ),
        )


def _on_course(limb: LimbPoints, tolerance_px: float) -> bool:
    """Whether all stretches of one camera's limb lie near where they were looked for."""
    middles = medians(limb.offset_px, _STRETCHES)
    return len(limb.px) >= MIN_INLIERS and max(map(abs, middles)) < tolerance_px
