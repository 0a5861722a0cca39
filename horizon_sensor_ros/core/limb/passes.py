"""Pass after pass of refinement, from the search's cone to the last hundredths of a pixel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.fits.maximum_likelihood import refine
from horizon_sensor_ros.core.fits.observation import LimbObservation, gather
from horizon_sensor_ros.core.limb.detection import Detection
from horizon_sensor_ros.core.limb.edge.model import EdgeLook
from horizon_sensor_ros.core.limb.glow.points import told_together
from horizon_sensor_ros.core.limb.refinement import (
    refine_limb,
    separate_from_thin_air,
    separate_limb,
)
from horizon_sensor_ros.core.limb.sample import RefinePass
from horizon_sensor_ros.core.limb.sized_frame import SizedFrame
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.status import Status

# From the consensus, good to a grid step or two, to the last tenths of a pixel. Where air glows the
# ground's edge lies farther from the steepest fall, where the first two look, than the last does.
# The search sees a reduced image, whose edges look sharper than they are.
SEARCH = RefinePass(
    reach_px=8.0, grid_px=0.5, spacing_px=4.0, contour=False, after_search=True, resizes=True
)
_NEAR = RefinePass(reach_px=3.0, grid_px=0.5, spacing_px=2.0, resizes=True)
_GLOW = RefinePass(reach_px=2.0, grid_px=0.25, spacing_px=2.0, separate_glow=True, for_glow=True)
_FINAL = RefinePass(
    reach_px=1.0, grid_px=0.125, spacing_px=1.0, separate_glow=True, in_part=True, finest=True
)
EXPECTED = replace(_FINAL, expected=True, inner_px=5.0)
# Where the fit of limb and glow did not hold in the last frame one attempt is enough.
NEARER = replace(_GLOW, separate_glow=False)
# Around a consensus that nearly all candidates agree on: it is as near as the passes come.
AT_ONCE = replace(_FINAL, at_once=True, separate_glow=False)
# Where the prediction was off.
AGAIN = RefinePass(reach_px=10.0, grid_px=0.5, spacing_px=4.0, guess=False)
# Where it is not known what the edge looks like.
FRESH = (_NEAR, _GLOW, _FINAL)
_NOT_SEPARATED = "the ground's limb is not told from the glow above it"
# Jumps from edge to edge of a limb that shows itself well at once.
_STEADY_PX = 0.3
_NOTHING = Detection(())


def look_for(
    views: Sequence[CameraView],
    frames: Sequence[SizedFrame],
    planet: Planet,
    near: tuple[np.ndarray, float],
    looks: Sequence[tuple[EdgeLook, ...]],
    steps: Sequence[RefinePass],
) -> Detection:
    """Pass after pass, each around the cone that fits the last one's limb.

    near : nadir (3,), base frame, and rho (rad) for the first pass. frames, looks : one a view.
    steps : the passes; one more `_FINAL` follows, unless the last of them found the limb on its
    cone.
    Ends early after a pass that leaves the cone undetermined, and after one in which every limb was
    separated from its glow. Passes that decide the frames' sizes are made again where one changes.
    """
    passes = _Passes(views, frames, planet, near, looks, [*steps, _FINAL])
    detection = _NOTHING
    while passes.ahead:
        step = passes.ahead.pop(0)
        if step.for_glow and not passes.unknown_glow:
            continue
        detection = passes.make(step)
        if _is_enough(step, detection):
            break
        if step.resizes and passes.resize(step, detection):
            continue
        if not (passes.ahead and passes.go_nearer(step, detection)):
            break
    if not any(
        seen.limb.glow_separated for seen in (*detection.observations, *detection.separated)
    ):
        return detection
    return replace(
        detection,
        observations=told_together(detection.observations),
        separated=told_together(detection.separated),
    )


class _Passes:
    """What each pass hands on to the next.

    ahead : passes still to be made. cone : nadir (3,) and rho (rad) around which the next one
    looks. looks : one a view, what the edge may look like.
    """

    def __init__(
        self,
        views: Sequence[CameraView],
        frames: Sequence[SizedFrame],
        planet: Planet,
        near: tuple[np.ndarray, float],
        looks: Sequence[tuple[EdgeLook, ...]],
        ahead: list[RefinePass],
    ) -> None:
        self._views, self._frames, self._planet = views, frames, planet
        self.cone = near
        self.looks = list(looks)
        self.ahead = ahead

    @property
    def unknown_glow(self) -> bool:
        """Whether some edge glows, in air that no fit has told yet."""
        return any(look.glow_px > 0 and look.air is None for kinds in self.looks for look in kinds)

    def make(self, step: RefinePass) -> Detection:
        """Look at all frames around the cone, at all limbs alike: separated from glow, or not."""
        views, frames, cone = self._views, self._frames, self.cone
        seen, held = refined(views, frames, cone, step, self.looks)
        separated: tuple[LimbObservation, ...] = ()
        if step.separate_glow and not step.expected:
            _separate_from_thin_air(views, frames, cone, step, seen, held)
        if step.separate_glow and _some_separated(seen):
            _separate_the_rest(views, frames, self._planet, cone, step, seen, held)
            if _of_two_limbs(seen, held):
                separated = _only_separated(seen, held)
                edges_only = replace(step, separate_glow=False)
                seen, held = refined(views, frames, cone, edges_only, self.looks)
        self.looks = [kinds or before for kinds, before in zip(held, self.looks, strict=True)]
        return Detection(
            tuple(seen),
            nadir_base=cone[0],
            rho_rad=cone[1],
            # The pass after a search guesses, and fits no model.
            looks=tuple(() if step.after_search else kinds for kinds in held),
            factors=tuple(frame.factor for frame in frames),
            separated=separated,
        )

    def resize(self, step: RefinePass, detection: Detection) -> bool:
        """Let frames change their size by how their limbs look; whether one went back to the last
        size, in which the cone was known better than from this.
        """
        limbs = zip(self._frames, detection.limbs, strict=True)
        resized = [frame.resize(limb) for frame, limb in limbs]
        if any(resized) and not step.after_search:
            self._again(step)
        return -1 in resized

    def go_nearer(self, step: RefinePass, detection: Detection) -> bool:
        """Go on around the cone that fits what a pass found; False where none does."""
        rays = gather(detection.observations)
        # Around a consensus that strayed to a cloud edges follow it where the limb is out of reach:
        # then those that are right are found by their agreement, not by where the consensus was.
        starts = (None, self.cone) if step.after_search else (self.cone, None)
        nearer = refine(rays, self._planet, starts[0])
        if not nearer.ok:
            nearer = refine(rays, self._planet, starts[1])
        if not nearer.ok:
            # Edges of a limb that is too soft for these frames scatter too much for any cone.
            coarser = step.after_search and sum(frame.coarsen() for frame in self._frames) > 0
            if coarser:
                self._again(step)
            return coarser
        self.cone = nearer.nadir_base, nearer.rho_rad
        if step.after_search:
            if shows_all(detection, self.looks, _STEADY_PX):
                self.ahead.remove(_NEAR)
            else:
                self.looks = [()] * len(self._views)
        return True

    def _again(self, step: RefinePass) -> None:
        """Make a pass once more in frames of other sizes, in which edges look otherwise."""
        self.looks = [()] * len(self._views)
        self.ahead.insert(0, step)


def _is_enough(step: RefinePass, detection: Detection) -> bool:
    """Whether no pass after this one would tell more."""
    if step.finest:
        return detection.on_course or not detection.modelled
    return step.for_glow and step.separate_glow and detection.glow_separated


def refined(
    views: Sequence[CameraView],
    frames: Sequence[SizedFrame],
    near: tuple[np.ndarray, float],
    step: RefinePass,
    looks: Sequence[tuple[EdgeLook, ...]],
) -> tuple[list[LimbObservation], list[tuple[EdgeLook, ...]]]:
    """One pass over all frames around a cone: each frame's limb, and models that fit its edge.

    near, looks : as of `look_for`.
    """
    seen, held = [], []
    for view, frame, kinds in zip(views, frames, looks, strict=True):
        here = step
        if frame.factor > 1 or frame.smear is not None:
            here = replace(step, factor=frame.factor, blur_open_px=frame.blur_open_px)
        limb, holds = refine_limb(frame.image(), view, *near, here, kinds)
        seen.append(LimbObservation(view, limb))
        held.append(holds)
    return seen, held


def _separate_from_thin_air(
    views: Sequence[CameraView],
    frames: Sequence[SizedFrame],
    near: tuple[np.ndarray, float],
    step: RefinePass,
    seen: list[LimbObservation],
    held: list[tuple[EdgeLook, ...]],
) -> None:
    """Where no model fits some camera's edges, thin air may be why: try to separate the others'
    limbs from it, though their edges look like those of none. Changes `seen` and `held` in place.

    Only where no limb was separated yet; what is then told is surely air.
    """
    shown = [i for i, found in enumerate(seen) if found.limb.status is Status.OK]
    if all(held[i] for i in shown) or any(seen[i].limb.glow_separated for i in shown):
        return
    for i in shown:
        if not _of_ground(seen[i].limb, held[i]) or frames[i].factor > 1:
            continue
        image, jumps_px = frames[i].image(), seen[i].limb.jumps_px
        found = separate_from_thin_air(image, views[i], near, step, jumps_px)
        if found is not None:
            seen[i], held[i] = LimbObservation(views[i], found[0]), found[1]


def _separate_the_rest(
    views: Sequence[CameraView],
    frames: Sequence[SizedFrame],
    planet: Planet,
    near: tuple[np.ndarray, float],
    step: RefinePass,
    seen: list[LimbObservation],
    held: list[tuple[EdgeLook, ...]],
) -> None:
    """Try again to separate limbs from glow, in the frames in which that failed, around the cone
    and starting from the air of those in which it worked. Changes `seen` and `held` in place.

    Also where edges show no glow: the same air may pass for blur there, and lift them by half a
    pixel and more. Where the limb is followed it was tried before.
    """
    cone = refine(gather([found for found in seen if found.limb.glow_separated]), planet, near)
    # The blur is one in pixels of a frame's size.
    whole = [i for i, frame in enumerate(frames) if frame.factor == 1]
    known = next((held[i] for i in whole if seen[i].limb.glow_separated), ())
    if not cone.ok or not known or known[0].air is None:
        return
    # In its air, and from nothing: here and there the fit converges from one of them alone.
    starts = (replace(known[0], air=known[0].air.elsewhere), replace(known[0], air=None))
    about = cone.nadir_base, cone.rho_rad
    for i in whole:
        limb = seen[i].limb
        if limb.status is not Status.OK or limb.glow_separated:
            continue
        if _of_ground(limb, held[i]) and (step.expected or known[0].air.faint):
            continue
        image, jumps_px = frames[i].image(), limb.jumps_px
        for look in starts[:1] if step.expected else starts:
            found = separate_limb(image, views[i], about, step, look, jumps_px)
            if found is not None:
                seen[i], held[i] = LimbObservation(views[i], found[0]), found[1]
                break


def _some_separated(seen: Sequence[LimbObservation]) -> bool:
    """Whether limb and glow were told apart in some frames and not in others that show a limb."""
    separated = [one.limb.glow_separated for one in seen if one.limb.status is Status.OK]
    return any(separated) and not all(separated)


def _of_two_limbs(seen: Sequence[LimbObservation], held: Sequence[tuple[EdgeLook, ...]]) -> bool:
    """Whether some cameras have the ground's limb and others the edge of the glow above it."""
    limbs = [(found.limb, kinds) for found, kinds in zip(seen, held, strict=True)]
    limbs = [(limb, kinds) for limb, kinds in limbs if limb.status is Status.OK]
    return any(limb.glow_separated for limb, _ in limbs) and not all(
        _of_ground(limb, kinds) for limb, kinds in limbs
    )


def _of_ground(limb: LimbPoints, kinds: Sequence[EdgeLook]) -> bool:
    """Whether it is the ground's limb: told apart from the glow above it, or without any."""
    return limb.glow_separated or (bool(kinds) and kinds[0].glow_px == 0.0)


def _only_separated(
    seen: Sequence[LimbObservation], held: Sequence[tuple[EdgeLook, ...]]
) -> tuple[LimbObservation, ...]:
    """`Detection.separated` of the limbs of one pass."""
    none = LimbPoints.none(Status.NO_LIMB, _NOT_SEPARATED)
    return tuple(
        LimbObservation(found.view, none)
        if found.limb.status is Status.OK and not _of_ground(found.limb, kinds)
        else found
        for found, kinds in zip(seen, held, strict=True)
    )


def shows_all(
    detection: Detection, looks: Sequence[tuple[EdgeLook, ...]], steady_px: float
) -> bool:
    """Whether a pass, in whole frames, shows what the next one would: edges that lie steadily,
    without glow.
    """
    return (
        max(detection.factors) == 1
        and not any(look.glow_px > 0.0 for kinds in looks for look in kinds)
        and all(limb.jumps_px < steady_px for limb in detection.limbs if limb.status is Status.OK)
    )
