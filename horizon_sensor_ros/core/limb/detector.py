"""The limb in the frames of all cameras: candidates, one consensus, refinement."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from horizon_sensor_ros.core.camera import CameraView
from horizon_sensor_ros.core.fits.maximum_likelihood import refine
from horizon_sensor_ros.core.fits.observation import LimbObservation, gather
from horizon_sensor_ros.core.limb.curve import limb_curve
from horizon_sensor_ros.core.limb.edge.model import EdgeLook
from horizon_sensor_ros.core.limb.edge.width import Smear, smear_of
from horizon_sensor_ros.core.limb.points import LimbPoints
from horizon_sensor_ros.core.limb.refinement import refine_limb
from horizon_sensor_ros.core.limb.sample import RefinePass
from horizon_sensor_ros.core.limb.search.air_layer import ground_under_airglow
from horizon_sensor_ros.core.limb.search.candidates import (
    LimbCandidates,
    canny_candidates,
    space_boundary_candidates,
)
from horizon_sensor_ros.core.limb.search.selection import (
    MIN_INLIERS,
    Consensus,
    limb_consensus,
    rays_of_candidates,
)
from horizon_sensor_ros.core.limb.sized_frame import SizedFrame
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.robust import median, stretches
from horizon_sensor_ros.core.status import Status

# From the consensus, good to a grid step or two, to the last tenths of a pixel. Where air glows the
# ground's edge lies farther from the steepest fall, where the first two look, than the last does.
# The search sees a reduced image, whose edges look sharper than they are.
_SEARCH = RefinePass(reach_px=8.0, grid_px=0.5, spacing_px=4.0, contour=False)
_NEAR = RefinePass(reach_px=3.0, grid_px=0.5, spacing_px=2.0)
_GLOW = RefinePass(reach_px=2.0, grid_px=0.25, spacing_px=2.0, joint=True)
_FINAL = RefinePass(reach_px=1.0, grid_px=0.125, spacing_px=1.0, joint=True, in_part=True)
EXPECTED = replace(_FINAL, expected=True, inner_px=5.0)
# Where the fit of limb and glow did not hold in the last frame one attempt is enough.
_NEARER = replace(_GLOW, joint=False)
# Around a consensus that nearly all candidates agree on: it is as near as the passes come.
_AT_ONCE = replace(_FINAL, at_once=True, joint=False)
# Where the prediction was off.
_AGAIN = RefinePass(reach_px=10.0, grid_px=0.5, spacing_px=4.0, guess=False)
_STRETCHES, _ON_COURSE_PX = 4, 0.6
# Where it is not known what the edge looks like.
_FRESH = (_NEAR, _GLOW, _FINAL)
# Jumps from edge to edge of a limb that shows itself well at once: of edges by themselves, and of
# means of many.
_STEADY_PX, _STEADY_MEANS_PX = 0.3, 0.15
# Blur of edges that no motion smeared; smears, without glow and with it, that are too long for a
# frame's pixels; how much of them is left in those of a reduced frame, which is no smaller than so.
_SHARP_PX, _SMEAR_PX, _GLOWING_PX, _LEFT_PX, _SMALLEST_PX = 0.82, 1.55, 3.0, 1.5, 64
_AS_MUCH = 0.25  # share by which the next frame's smear may be another
# Errors that points of smeared limbs share, over what they are where nothing moved: as measured
# beside the truth of simulated ones.
_MISJUDGED = 1.6
# ... of a limb under glow that elsewhere, in another camera's frame, lies in the dark: towards the
# night air and ground change faster along it than is told.
_TOWARDS_NIGHT = 2.0
_SMEARED = "motion smears the limb too far"
_CANNY_REACH_PX = 2.0
_COARSE_PX = 16.0  # spacing of points that tell whether the limb is in a frame


@dataclass(frozen=True)
class Detection:
    """The limb in each frame, and where the last pass of refinement looked for it.

    observations : one per frame, in order. nadir_base, rho_rad : the cone whose limb the last pass
    refined; NaN where there is none. candidates : step one's, for drawing. consensus : step two's.
    looks : one per frame, what the limb's edge looks like; none where no model fits it. factors :
    one per frame, by which it was reduced for the last pass. layer_rad : how far above the limb a
    layer of airglow lies, 0 without one. smears : one per frame, motion's in it, None where there
    is hardly any.
    """

    observations: tuple[LimbObservation, ...]
    candidates: tuple[LimbCandidates, ...] = ()
    consensus: Consensus = field(default_factory=lambda: Consensus(Status.NO_LIMB))
    nadir_base: np.ndarray = field(default_factory=lambda: np.full(3, np.nan))
    rho_rad: float = np.nan
    looks: tuple[tuple[EdgeLook, ...], ...] = ()
    factors: tuple[int, ...] = ()
    layer_rad: float = 0.0
    smears: tuple[Smear | None, ...] = ()

    @property
    def limbs(self) -> tuple[LimbPoints, ...]:
        """Limb in each frame."""
        return tuple(seen.limb for seen in self.observations)

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
    def joint(self) -> bool:
        """Whether limb and glow were told apart in every frame that shows a limb."""
        return all(limb.joint for limb in self.limbs if limb.status is Status.OK)

    @cached_property
    def on_course(self) -> bool:
        """Whether every limb that was seen lies near the cone that it was measured around, or was
        sought around cones of its own.
        """
        return all(
            limb.joint or _on_course(limb, _ON_COURSE_PX * factor)
            for limb, factor in zip(self.limbs, self.factors, strict=True)
            if limb.status is Status.OK
        )


def detect_limb(
    views: Sequence[CameraView],
    images: Sequence[np.ndarray],
    planet: Planet,
    *,
    rho_min_rad: float,
    rho_max_rad: float,
) -> Detection:
    """Find the limb in simultaneous frames of any number of cameras.

    images : (H, W) uint8 or uint16, one a view. A camera that sees no limb comes back with its own
    status; if no consensus is found all do.
    """
    candidates = tuple(
        space_boundary_candidates(image, mask=view.mask)
        for view, image in zip(views, images, strict=True)
    )
    found = rays_of_candidates(views, candidates)
    consensus = limb_consensus(found, rho_min_rad=rho_min_rad, rho_max_rad=rho_max_rad)
    consensus = ground_under_airglow(views, candidates, found, consensus, planet)
    if consensus.status is not Status.OK:
        none = LimbPoints.none(consensus.status, consensus.reason)
        observations = tuple(LimbObservation(view, none) for view in views)
        return Detection(observations, candidates, consensus)
    near = consensus.nadir_base, consensus.rho_rad
    looked = _seen_at_once(views, images, near) if consensus.unanimous else None
    if looked is None:
        frames = [
            SizedFrame(image, max(1, int(found.pitch_px) // 2), int(found.pitch_px))
            for image, found in zip(images, candidates, strict=True)
        ]
        looked = _look(views, frames, planet, near, [()] * len(views), (_SEARCH, *_FRESH))
    looked = _towards_night(_without_smear(views, images, planet, looked))
    return replace(
        looked, candidates=candidates, consensus=consensus, layer_rad=consensus.layer_rad
    )


def _without_smear(
    views: Sequence[CameraView], images: Sequence[np.ndarray], planet: Planet, found: Detection
) -> Detection:
    """The same limb, in frames blurred alike in all directions, and reduced until motion smears it
    over no more than a pixel or two.

    A camera whose frame would be too small is left out.
    """
    smears = _smears(views, images, found)
    if not any(smears):
        return replace(found, smears=tuple(smears))
    factors = [
        math.ceil(smear.across_px / _LEFT_PX) if smear else factor
        for smear, factor in zip(smears, found.factors, strict=True)
    ]
    frames = [
        SizedFrame(image, factor, smear=smear)
        for image, factor, smear in zip(images, factors, smears, strict=True)
    ]
    near = found.nadir_base, found.rho_rad
    fresh: list[tuple[EdgeLook, ...]] = [()] * len(views)
    found = _look(views, frames, planet, near, fresh, _FRESH)
    none = LimbPoints.none(Status.NO_LIMB, _SMEARED)
    usable = [
        seen
        if smear is None or min(image.shape) >= _SMALLEST_PX * factor
        else LimbObservation(seen.view, none)
        for seen, image, smear, factor in zip(
            found.observations, images, smears, factors, strict=True
        )
    ]
    return _misjudged(replace(found, observations=tuple(usable), smears=tuple(smears)))


def _misjudged(found: Detection) -> Detection:
    """The same with the errors that points of smeared limbs really share."""
    return _with_errors(found, [smear is not None for smear in found.smears], _MISJUDGED)


def _with_errors(found: Detection, of: Sequence[bool], times: float) -> Detection:
    """The same with errors so many times as large that points of some limbs share."""
    return replace(
        found,
        observations=tuple(
            LimbObservation(seen.view, seen.limb.misjudged(times)) if wanted else seen
            for seen, wanted in zip(found.observations, of, strict=True)
        ),
    )


def _towards_night(found: Detection) -> Detection:
    """The same with the errors that points of limbs under glow share beside a dark limb."""
    near = found.nadir_base, found.rho_rad
    glows = [limb.joint for limb in found.limbs]
    beside_night = any(glows) and any(
        seen.limb.status is not Status.OK
        and len(limb_curve(seen.view, *near, spacing_px=_COARSE_PX)) >= MIN_INLIERS
        for seen in found.observations
    )
    return _with_errors(found, glows, _TOWARDS_NIGHT) if beside_night else found


def _smears(
    views: Sequence[CameraView], images: Sequence[np.ndarray], found: Detection
) -> list[Smear | None]:
    """Motion's smear in each frame, None where there is hardly any."""
    smears: list[Smear | None] = []
    seen = zip(views, images, found.limbs, found.looks, found.factors, strict=True)
    for view, image, limb, looks, factor in seen:
        smear = None
        glows = any(look.glow_px > 0.0 for look in looks)
        sharp = factor == 1 and looks and looks[0].psf_px < _SHARP_PX and not glows
        if limb.status is Status.OK and not sharp:
            smear = smear_of(image, view, found.nadir_base, found.rho_rad)
            soft = glows or factor > 1
            if smear.sure_px <= (_GLOWING_PX if soft else _SMEAR_PX) * factor:
                smear = None
        smears.append(smear)
    return smears


def _seen_at_once(
    views: Sequence[CameraView],
    images: Sequence[np.ndarray],
    near: tuple[np.ndarray, float],
) -> Detection | None:
    """Limb around a cone that is as near as passes come; None where it does not show itself well in
    every frame that it crosses.
    """
    frames = [SizedFrame(image, 1) for image in images]
    seen, held = _refined(views, frames, near, _AT_ONCE, [()] * len(views))
    for view, observation in zip(views, seen, strict=True):
        missed = observation.limb.status is not Status.OK
        if missed and len(limb_curve(view, *near, spacing_px=_COARSE_PX)):
            return None
    found = Detection(
        tuple(seen),
        nadir_base=near[0],
        rho_rad=near[1],
        looks=tuple(held),
        factors=(1,) * len(views),
    )
    steady = _shows_all(found, held, _STEADY_MEANS_PX)
    return found if steady and found.modelled and found.on_course else None


def follow_limb(
    views: Sequence[CameraView],
    images: Sequence[np.ndarray],
    planet: Planet,
    nadir_base: np.ndarray,
    rho_rad: float,
    sees: Sequence[bool],
    looks: Sequence[tuple[EdgeLook, ...]],
    factors: Sequence[int],
    smears: Sequence[Smear | None],
) -> Detection | None:
    """Find the limb again near a predicted one; None where the prediction is of no help.

    sees : whether each frame's camera saw the limb. looks, factors, smears : as in the last
    detection.
    The last passes of `detect_limb` around the predicted cone; where the limb lies farther off, or
    looks otherwise, a pass or two more, so that the answer is that of a search. Other cameras that
    see the limb than did, or an edge that no model fits and that a search may measure otherwise:
    None.
    """
    fresh: list[tuple[EdgeLook, ...]] = [()] * len(views)
    attempts = ((looks, (_NEARER, EXPECTED)), (fresh, (_AGAIN, *_FRESH)))
    frames = [
        SizedFrame(image, factor, smear=smear)
        for image, factor, smear in zip(images, factors, smears, strict=True)
    ]
    for start, steps in attempts:
        found = _look(views, frames, planet, (nadir_base, rho_rad), start, steps)
        if [limb.status is Status.OK for limb in found.limbs] != list(sees):
            continue
        if found.modelled and found.on_course:
            if not _smeared_alike(views, images, found, smears):
                return None
            return _towards_night(_misjudged(replace(found, smears=tuple(smears))))
    return None


def _smeared_alike(
    views: Sequence[CameraView],
    images: Sequence[np.ndarray],
    found: Detection,
    smears: Sequence[Smear | None],
) -> bool:
    """Whether frames that motion smeared still are, by about as much."""
    for view, image, limb, smear in zip(views, images, found.limbs, smears, strict=True):
        if smear is None or limb.status is not Status.OK:
            continue
        now = smear_of(image, view, found.nadir_base, found.rho_rad)
        if not abs(now.across_px - smear.across_px) < _AS_MUCH * smear.across_px:
            return False
    return True


def _look(
    views: Sequence[CameraView],
    frames: Sequence[SizedFrame],
    planet: Planet,
    near: tuple[np.ndarray, float],
    looks: Sequence[tuple[EdgeLook, ...]],
    steps: Sequence[RefinePass],
) -> Detection:
    """Pass after pass, each around the cone that fits the last one's limb.

    near : nadir (3,) and rho of the first pass. Passes that leave the cone open are the last, and
    so is one in which every limb is fitted together with the glow above it. The first two are made
    once more in frames of another size, the final one where it finds the limb off its cone.
    """
    nadir, rho = near
    looks = list(looks)
    found = Detection(())
    passes = [*steps, _FINAL]
    while passes:
        step = passes.pop(0)
        if step in (_GLOW, _NEARER) and not any(
            look.glow_px > 0 and look.air is None for kinds in looks for look in kinds
        ):
            continue
        seen, held = _refined(views, frames, (nadir, rho), step, looks)
        if step.joint and _of_two_limbs(seen, held):
            seen, held = _refined(views, frames, (nadir, rho), replace(step, joint=False), looks)
        looks = [kinds or before for kinds, before in zip(held, looks, strict=True)]
        found = Detection(
            tuple(seen),
            nadir_base=nadir,
            rho_rad=rho,
            # The search's pass guesses, and fits no model.
            looks=tuple(() if step is _SEARCH else kinds for kinds in held),
            factors=tuple(frame.factor for frame in frames),
        )
        if step in (EXPECTED, _FINAL) and (found.on_course or not found.modelled):
            break
        if step is _GLOW and found.joint:
            break
        if step in (_SEARCH, _NEAR):
            resized = [frame.resize(limb) for frame, limb in zip(frames, found.limbs, strict=True)]
            if step is _NEAR and any(resized):
                looks = [()] * len(views)
                passes.insert(0, _NEAR)
            if -1 in resized:
                continue
        rays = gather(seen)
        # Around a consensus that strayed to a cloud edges follow it where the limb is out of reach:
        # then those that are right are found by their agreement, not by where the consensus was.
        starts = (None, (nadir, rho)) if step is _SEARCH else ((nadir, rho), None)
        nearer = refine(rays, planet, starts[0])
        if not nearer.ok:
            nearer = refine(rays, planet, starts[1])
        if not nearer.ok and step is _SEARCH and sum(frame.coarsen() for frame in frames):
            # Edges of a limb this soft scatter too much for any cone.
            looks = [()] * len(views)
            passes.insert(0, _SEARCH)
            continue
        if not nearer.ok:
            break
        nadir, rho = nearer.nadir_base, nearer.rho_rad
        if step is _SEARCH:
            if _shows_all(found, looks, _STEADY_PX):
                passes.remove(_NEAR)
            else:
                looks = [()] * len(views)
    return found


def _refined(
    views: Sequence[CameraView],
    frames: Sequence[SizedFrame],
    near: tuple[np.ndarray, float],
    step: RefinePass,
    looks: Sequence[tuple[EdgeLook, ...]],
) -> tuple[list[LimbObservation], list[tuple[EdgeLook, ...]]]:
    """One pass over all frames around a cone: the limbs, and the looks that hold of their edges."""
    seen, held = [], []
    for view, frame, kinds in zip(views, frames, looks, strict=True):
        here = step
        if frame.factor > 1 or frame.smear is not None:
            here = replace(step, factor=frame.factor, blur_open_px=frame.blur_open_px)
        limb, holds = refine_limb(frame.image(), view, *near, here, kinds)
        seen.append(LimbObservation(view, limb))
        held.append(holds)
    return seen, held


def _of_two_limbs(seen: Sequence[LimbObservation], held: Sequence[tuple[EdgeLook, ...]]) -> bool:
    """Whether some cameras have the ground's limb and others the edge of the glow above it."""
    limbs = [(found.limb, kinds) for found, kinds in zip(seen, held, strict=True)]
    limbs = [(limb, kinds) for limb, kinds in limbs if limb.status is Status.OK]
    sharp = [bool(kinds) and kinds[0].glow_px == 0.0 for _, kinds in limbs]
    joint = [limb.joint for limb, _ in limbs]
    return any(joint) and not all(a or b for a, b in zip(joint, sharp, strict=True))


def _shows_all(found: Detection, looks: Sequence[tuple[EdgeLook, ...]], steady_px: float) -> bool:
    """Whether a pass, in whole frames, shows what the next one would: edges that lie steadily,
    without glow.
    """
    return (
        max(found.factors) == 1
        and not any(look.glow_px > 0.0 for kinds in looks for look in kinds)
        and all(limb.jumps_px < steady_px for limb in found.limbs if limb.status is Status.OK)
    )


def _on_course(limb: LimbPoints, tolerance_px: float) -> bool:
    """Whether all stretches of one camera's limb lie near where they were looked for."""
    parts = stretches(limb.offset_px, _STRETCHES)
    return len(limb.px) >= MIN_INLIERS and max(abs(median(p)) for p in parts) < tolerance_px


def canny_limbs(
    views: Sequence[CameraView],
    images: Sequence[np.ndarray],
    nadir_base: np.ndarray,
    rho_rad: float,
) -> tuple[LimbPoints, ...]:
    """Whole-pixel limb points as in the papers: the Canny edges within two pixels of the predicted
    limb.
    """
    limbs = []
    for view, image in zip(views, images, strict=True):
        edges = canny_candidates(image)
        nadir = view.rot_base_from_cam.T @ nadir_base
        rays = view.camera.rays(edges.px)
        ahead = view.camera.rays(edges.px + edges.normal_px)
        with np.errstate(invalid="ignore"):
            angle = np.arccos(np.clip(rays @ nadir, -1.0, 1.0))
            per_px = np.arccos(np.clip(ahead @ nadir, -1.0, 1.0)) - angle
            keep = (per_px > 0) & (np.abs(angle - rho_rad) < _CANNY_REACH_PX * per_px)
            if view.mask is not None:
                keep &= view.mask.clear(edges.px, _CANNY_REACH_PX)
        if keep.sum() < MIN_INLIERS:
            reason = f"{int(keep.sum())} Canny edges near the limb"
            limbs.append(LimbPoints.none(Status.NO_LIMB, reason))
            continue
        # Rounding to whole pixels: a uniform error of one pixel's width.
        sigma = np.full(int(keep.sum()), 1.0 / np.sqrt(12.0))
        limbs.append(LimbPoints(Status.OK, "", edges.px[keep], edges.normal_px[keep], sigma))
    return tuple(limbs)
