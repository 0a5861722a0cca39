"""Pass after pass of refinement, from the search's cone to the last hundredths of a pixel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from horizon_sensor_ros.core.camera_view import CameraView
from horizon_sensor_ros.core.fits.maximum_likelihood import refine
from horizon_sensor_ros.core.fits.observation import LimbObservation, gather
from horizon_sensor_ros.core.limb.detection import Detection
from horizon_sensor_ros.core.limb.edge.model import EdgeLook
from horizon_sensor_ros.core.limb.glow.points import told_together
from horizon_sensor_ros.core.limb.refinement import refine_limb
from horizon_sensor_ros.core.limb.sample import RefinePass
from horizon_sensor_ros.core.limb.sized_frame import SizedFrame
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.status import Status

# From the consensus, good to a grid step or two, to the last tenths of a pixel. Where air glows the
# ground's edge lies farther from the steepest fall, where the first two look, than the last does.
# The search sees a reduced image, whose edges look sharper than they are.
SEARCH = RefinePass(reach_px=8.0, grid_px=0.5, spacing_px=4.0, contour=False)
_NEAR = RefinePass(reach_px=3.0, grid_px=0.5, spacing_px=2.0)
_GLOW = RefinePass(reach_px=2.0, grid_px=0.25, spacing_px=2.0, separate_glow=True)
_FINAL = RefinePass(reach_px=1.0, grid_px=0.125, spacing_px=1.0, separate_glow=True, in_part=True)
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
    separated from its glow. `SEARCH` and `_NEAR` are made again where a frame's size changes.
    """
    nadir, rho = near
    looks = list(looks)
    found = Detection(())
    passes = [*steps, _FINAL]
    while passes:
        step = passes.pop(0)
        if step in (_GLOW, NEARER) and not any(
            look.glow_px > 0 and look.air is None for kinds in looks for look in kinds
        ):
            continue
        seen, held = refined(views, frames, (nadir, rho), step, looks)
        separated: tuple[LimbObservation, ...] = ()
        if step.separate_glow and _of_two_limbs(seen, held):
            _separate_the_rest(views, frames, planet, (nadir, rho), step, seen, held)
        if step.separate_glow and _of_two_limbs(seen, held):
            separated = _only_separated(seen, held)
            edges_only = replace(step, separate_glow=False)
            seen, held = refined(views, frames, (nadir, rho), edges_only, looks)
        looks = [kinds or before for kinds, before in zip(held, looks, strict=True)]
        found = Detection(
            tuple(seen),
            nadir_base=nadir,
            rho_rad=rho,
            # The search's pass guesses, and fits no model.
            looks=tuple(() if step is SEARCH else kinds for kinds in held),
            factors=tuple(frame.factor for frame in frames),
            separated=separated,
        )
        if step in (EXPECTED, _FINAL) and (found.on_course or not found.modelled):
            break
        if step is _GLOW and found.glow_separated:
            break
        if step in (SEARCH, _NEAR):
            resized = [frame.resize(limb) for frame, limb in zip(frames, found.limbs, strict=True)]
            if step is _NEAR and any(resized):
                looks = [()] * len(views)
                passes.insert(0, _NEAR)
            if -1 in resized:
                continue
        rays = gather(seen)
        # Around a consensus that strayed to a cloud edges follow it where the limb is out of reach:
        # then those that are right are found by their agreement, not by where the consensus was.
        starts = (None, (nadir, rho)) if step is SEARCH else ((nadir, rho), None)
        nearer = refine(rays, planet, starts[0])
        if not nearer.ok:
            nearer = refine(rays, planet, starts[1])
        if not nearer.ok and step is SEARCH and sum(frame.coarsen() for frame in frames):
            # Edges of a limb this soft scatter too much for any cone.
            looks = [()] * len(views)
            passes.insert(0, SEARCH)
            continue
        if not nearer.ok:
            break
        nadir, rho = nearer.nadir_base, nearer.rho_rad
        if step is SEARCH:
            if shows_all(found, looks, _STEADY_PX):
                passes.remove(_NEAR)
            else:
                looks = [()] * len(views)
    if not any(seen.limb.glow_separated for seen in (*found.observations, *found.separated)):
        return found
    return replace(
        found,
        observations=told_together(found.observations),
        separated=told_together(found.separated),
    )


def refined(
    views: Sequence[CameraView],
    frames: Sequence[SizedFrame],
    near: tuple[np.ndarray, float],
    step: RefinePass,
    looks: Sequence[tuple[EdgeLook, ...]],
) -> tuple[list[LimbObservation], list[tuple[EdgeLook, ...]]]:
    """One pass over all frames around a cone: each frame's limb, and models that fit its edge."""
    seen, held = [], []
    for view, frame, kinds in zip(views, frames, looks, strict=True):
        here = step
        if frame.factor > 1 or frame.smear is not None:
            here = replace(step, factor=frame.factor, blur_open_px=frame.blur_open_px)
        limb, holds = refine_limb(frame.image(), view, *near, here, kinds)
        seen.append(LimbObservation(view, limb))
        held.append(holds)
    return seen, held


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
    """
    cone = refine(gather([found for found in seen if found.limb.glow_separated]), planet, near)
    # The blur is one in pixels of a frame's size.
    whole = [i for i, frame in enumerate(frames) if frame.factor == 1]
    known = next((held[i] for i in whole if seen[i].limb.glow_separated), ())
    if not cone.ok or not known:
        return
    for i in whole:
        if seen[i].limb.status is Status.OK and not _of_ground(seen[i].limb, held[i]):
            about = cone.nadir_base, cone.rho_rad
            limb, holds = refine_limb(frames[i].image(), views[i], *about, step, known)
            if limb.glow_separated:
                seen[i], held[i] = LimbObservation(views[i], limb), holds


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


def shows_all(found: Detection, looks: Sequence[tuple[EdgeLook, ...]], steady_px: float) -> bool:
    """Whether a pass, in whole frames, shows what the next one would: edges that lie steadily,
    without glow.
    """
    return (
        max(found.factors) == 1
        and not any(look.glow_px > 0.0 for kinds in looks for look in kinds)
        and all(limb.jumps_px < steady_px for limb in found.limbs if limb.status is Status.OK)
    )
