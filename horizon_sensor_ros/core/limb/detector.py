"""The limb in the frames of all cameras: candidates, one consensus, refinement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.fits.maximum_likelihood import refine
from horizon_sensor_ros.core.fits.observation import LimbObservation
from horizon_sensor_ros.core.limb.detection import Detection, LimbState
from horizon_sensor_ros.core.limb.edge.model import EdgeLook
from horizon_sensor_ros.core.limb.glow.points import told_together
from horizon_sensor_ros.core.limb.haze.column import LOWEST_RHO_RAD
from horizon_sensor_ros.core.limb.haze.passes import (
    ThroughHaze,
    follow_through_haze,
    look_through_haze,
)
from horizon_sensor_ros.core.limb.passes import (
    AGAIN,
    AT_ONCE,
    EXPECTED,
    FRESH,
    NEARER,
    SEARCH,
    look_for,
    refined,
    shows_all,
)
from horizon_sensor_ros.core.limb.sample import RefinePass
from horizon_sensor_ros.core.limb.search.air_layer import ground_under_airglow
from horizon_sensor_ros.core.limb.search.candidates import candidates_in
from horizon_sensor_ros.core.limb.search.selection import (
    Consensus,
    RayCandidates,
    consensus_about,
    limb_consensus,
    rays_of_candidates,
)
from horizon_sensor_ros.core.limb.search.working_image import WorkingImage
from horizon_sensor_ros.core.limb.sized_frame import SizedFrame
from horizon_sensor_ros.core.limb.smeared import (
    smeared_alike,
    smeared_one_way,
    smears_now,
    still_sharp,
    with_smear_error,
    without_smear,
)
from horizon_sensor_ros.core.limb_curve import limb_in_sight
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.status import Status

# Jumps between means of many edges of a limb that shows itself well at once.
_STEADY_MEANS_PX = 0.15
# From its points, pixels of the search: a limb so far off is another one.
_ANOTHER_PX = 3.0
# By how much smaller images than the search's are in which a limb shows that fades slowly.
_COARSER = 2, 4
_LEAST_COARSE_PX = 16  # shorter side of one


def detect_limb(
    views: Sequence[CameraView],
    images: Sequence[np.ndarray],
    planet: Planet,
    *,
    rho_min_rad: float,
    rho_max_rad: float,
    near: tuple[np.ndarray, float] | None = None,
    working: Sequence[WorkingImage] | None = None,
) -> Detection:
    """Find the limb in simultaneous frames of any number of cameras.

    images : (H, W) uint8 or uint16, one a view. near : nadir (3,) and rho of a cone that is known
    to be the limb's, about which it is sought in all frames; by default the consensus of all.
    working : the images as the search sees them, where they are reduced already. A camera that sees
    no limb comes back with its own status; if no consensus is found all do.
    """
    if working is None:
        pairs = zip(views, images, strict=True)
        working = [WorkingImage.of(image, view.mask) for view, image in pairs]
    working = tuple(working)
    of_frames = [
        candidates_in(image, mask=view.mask) for view, image in zip(views, working, strict=True)
    ]
    candidates = rays_of_candidates(views, of_frames)
    if near is None:
        consensus = limb_consensus(candidates, rho_min_rad=rho_min_rad, rho_max_rad=rho_max_rad)
        consensus = ground_under_airglow(views, working, candidates, consensus, planet)
    else:
        consensus = consensus_about(candidates, *near)
    daylit = None
    if consensus.by_day is not None:
        daylit = _under_daylit_air(views, images, planet, working, consensus.by_day)
        consensus = consensus if daylit is None else consensus.by_day
    if consensus.status is not Status.OK:
        if near is None and planet.has_air:
            within = _from_within_air(views, images, planet, working, rho_min_rad)
            if within is not None:
                return within
        return _nothing(views, working, consensus)
    looked = daylit or _looked_for(views, images, planet, working, consensus)
    if near is None and not (daylit or consensus.unanimous) and not consensus.below_layer:
        below = _below_airglow(views, planet, working, candidates, looked)
        if below is not None:
            consensus = below
            if consensus.status is not Status.OK:
                return _nothing(views, working, consensus)
            looked = _looked_for(views, images, planet, working, consensus, FRESH)
    return _searched(looked, working, consensus, candidates)


def limb_of_one(
    view: CameraView,
    image: np.ndarray,
    planet: Planet,
    of_all: Detection,
    index: int,
    *,
    rho_min_rad: float,
    rho_max_rad: float,
) -> Detection | None:
    """What `detect_limb` finds in one frame alone, sooner: from what it found in all of them.

    view, image : of the frame. of_all, index : in all frames, and its number among these. What is
    found around a common cone lies near it, also where that is no camera's own: so the limb is
    looked for again around the cone of this frame's points. None where that may not tell what a
    search would find: frames in which the limb was not `seen_alike`; candidates of this one that
    agree on another limb; or a layer of airglow.
    """
    if of_all.candidates is None or not of_all.seen_alike:
        return None
    seen = of_all.observations[index]
    own = refine(seen.rays, planet, (of_all.nadir_base, of_all.rho_rad))
    if not own.ok:
        return None
    candidates, working = of_all.candidates.of_camera(index), of_all.working[index]
    consensus = limb_consensus(candidates, rho_min_rad=rho_min_rad, rho_max_rad=rho_max_rad)
    consensus = ground_under_airglow([view], [working], candidates, consensus, planet)
    elsewhere = (
        consensus.status is not Status.OK
        or consensus.below_layer
        or consensus.apart_px(seen.rays, working.factor * view.camera.pixel_rad) > _ANOTHER_PX
    )
    if elsewhere:
        return None
    near = own.nadir_base, own.rho_rad
    looked = follow_limb([view], [image], planet, near, of_all.state.of([index]))
    if looked is None:
        return None
    if not consensus.unanimous:
        below = _below_airglow([view], planet, [working], candidates, looked)
        if below is not None:
            return None
    return _searched(looked, (working,), consensus, candidates)


def joined(alone: Sequence[Detection], about: Detection) -> Detection:
    """Limbs that were found in one frame each, as found in all of them around another's cone."""
    return Detection(
        told_together([one.observations[0] for one in alone]),
        working=tuple(one.working[0] for one in alone),
        nadir_base=about.nadir_base,
        rho_rad=about.rho_rad,
        looks=tuple(one.looks[0] for one in alone),
        factors=tuple(one.factors[0] for one in alone),
        smears=tuple(one.smears[0] for one in alone),
        steepness=tuple(one.steepness[0] for one in alone),
        airglow=about.airglow,
    )


def follow_limb(
    views: Sequence[CameraView],
    images: Sequence[np.ndarray],
    planet: Planet,
    near: tuple[np.ndarray, float],
    before: LimbState,
) -> Detection | None:
    """Find the limb again near a predicted one; None where the prediction is of no help.

    near : nadir (3,) and rho (rad) of the predicted cone. before : the limb in the last frames.
    The last passes of `detect_limb` around the predicted cone; where the limb lies farther off, or
    looks otherwise, a pass or two more, so that the answer is that of a search. Other cameras that
    see the limb than did, or an edge that no model fits and that a search may measure otherwise:
    None.
    """
    if any(look.haze for kinds in before.looks for look in kinds):
        through = follow_through_haze(views, images, planet, near, before.looks, before.factors)
        return through if through is not None and through.state.sees == before.sees else None
    fresh: list[tuple[EdgeLook, ...]] = [()] * len(views)
    attempts = ((before.looks, (NEARER, EXPECTED)), (fresh, (AGAIN, *FRESH)))
    smears = smears_now(views, near, before.smears)
    frames = [
        SizedFrame(image, factor, smear=smear)
        for image, factor, smear in zip(images, before.factors, smears, strict=True)
    ]
    for start, steps in attempts:
        detection = look_for(views, frames, planet, near, start, steps)
        if detection.state.sees != before.sees:
            separated = detection.separated_only
            if separated is None or separated.state.sees != before.sees:
                continue
            detection = separated
        if start is before.looks and detection.state.white != before.white:
            # Exposed otherwise: what it looked like then was told by less of it, or by more.
            continue
        if detection.modelled and detection.on_course:
            if not smeared_alike(views, images, detection, before.smears):
                return None
            sharp = still_sharp(views, images, detection, before.steepness, before.smears, start)
            if sharp is None:
                return None
            detection = replace(detection, smears=smears, steepness=sharp)
            return with_smear_error(detection.raised(before.above_m))
    return None


def _searched(
    looked: Detection,
    working: Sequence[WorkingImage],
    consensus: Consensus,
    candidates: RayCandidates,
) -> Detection:
    """What was looked for near a consensus, with what the search for that found."""
    return replace(
        looked,
        working=tuple(working),
        consensus=consensus,
        layer_rad=consensus.layer_rad,
        candidates=candidates,
        steepness=tuple(limb.steepness for limb in looked.limbs),
    )


def _from_within_air(
    views: Sequence[CameraView],
    images: Sequence[np.ndarray],
    planet: Planet,
    working: Sequence[WorkingImage],
    rho_min_rad: float,
) -> Detection | None:
    """Limb that fades too slowly for the search, as air does from within it; None without one.

    It may lie high above the ground, and the camera hardly above it.
    """
    for times in _COARSER:
        if min(min(small.gray.shape) for small in working) < _LEAST_COARSE_PX * times:
            break
        of_frames = [
            candidates_in(small.coarser(times, view.mask), mask=view.mask)
            for view, small in zip(views, working, strict=True)
        ]
        candidates = rays_of_candidates(views, of_frames)
        consensus = limb_consensus(candidates, rho_min_rad=rho_min_rad, rho_max_rad=LOWEST_RHO_RAD)
        if consensus.status is not Status.OK:
            continue
        near = consensus.nadir_base, consensus.rho_rad
        hazy = _through_haze(views, images, planet, near)
        if hazy is not None and hazy.sure:
            return _searched(hazy.detection, working, consensus, candidates)
    return None


def _under_daylit_air(
    views: Sequence[CameraView],
    images: Sequence[np.ndarray],
    planet: Planet,
    working: Sequence[WorkingImage],
    consensus: Consensus,
) -> Detection | None:
    """Limb near a consensus that may be that of a layer of airglow; None unless it is under air by
    day.
    """
    detection = _looked_for(views, images, planet, working, consensus)
    return detection if detection.under_daylit_air else None


def _nothing(
    views: Sequence[CameraView], working: tuple[WorkingImage, ...], consensus: Consensus
) -> Detection:
    """No limb in any frame, and why."""
    none = LimbPoints.none(consensus.status, consensus.reason)
    return Detection(tuple(LimbObservation(view, none) for view in views), working, consensus)


def _below_airglow(
    views: Sequence[CameraView],
    planet: Planet,
    working: Sequence[WorkingImage],
    candidates: RayCandidates,
    looked: Detection,
) -> Consensus | None:
    """Consensus of the ground's limb, or why there is none, where what was found is the airglow's
    edge after all; else None.

    Candidates that are of the layer here and of the ground there agree on neither's cone, from
    which the layer is not told; around the cone that edges were refined to it is.
    """
    if not np.isfinite(looked.rho_rad):
        return None
    about = consensus_about(candidates, looked.nadir_base, looked.rho_rad)
    below = ground_under_airglow(views, working, candidates, about, planet, refined=True)
    return None if below is about else below


def _looked_for(
    views: Sequence[CameraView],
    images: Sequence[np.ndarray],
    planet: Planet,
    working: Sequence[WorkingImage],
    consensus: Consensus,
    steps: Sequence[RefinePass] = (SEARCH, *FRESH),
) -> Detection:
    """Limb near a consensus of candidates: at once, through haze, or pass after pass."""
    near = consensus.nadir_base, consensus.rho_rad
    looked = _seen_at_once(views, images, near) if consensus.unanimous else None
    hazy = None
    if looked is None:
        hazy = _through_haze(views, images, planet, near)
        if hazy is not None and hazy.sure:
            return hazy.detection
        frames = [
            SizedFrame(image, max(1, small.factor // 2), small.factor)
            for image, small in zip(images, working, strict=True)
        ]
        looked = look_for(views, frames, planet, near, [()] * len(views), steps)
    looked = without_smear(views, images, planet, looked)
    return looked if hazy is None else hazy.or_thin_air(looked)


def _through_haze(
    views: Sequence[CameraView],
    images: Sequence[np.ndarray],
    planet: Planet,
    near: tuple[np.ndarray, float],
) -> ThroughHaze | None:
    """`look_through_haze`; not at limbs that look so since motion smears them."""
    hazy = look_through_haze(views, images, planet, near)
    return None if hazy is None or smeared_one_way(images, hazy.detection) else hazy


def _seen_at_once(
    views: Sequence[CameraView],
    images: Sequence[np.ndarray],
    near: tuple[np.ndarray, float],
) -> Detection | None:
    """Limb around a cone that is as near as passes come; None where it does not show itself well in
    every frame that it crosses.
    """
    frames = [SizedFrame(image, 1) for image in images]
    seen, held = refined(views, frames, near, AT_ONCE, [()] * len(views))
    for view, observation in zip(views, seen, strict=True):
        missed = observation.limb.status is not Status.OK
        if missed and len(limb_in_sight(view, *near)):
            return None
    detection = Detection(
        tuple(seen),
        nadir_base=near[0],
        rho_rad=near[1],
        looks=tuple(held),
        factors=(1,) * len(views),
    )
    steady = shows_all(detection, held, _STEADY_MEANS_PX)
    return detection if steady and detection.modelled and detection.on_course else None
