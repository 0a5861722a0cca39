"""The limb in the frames of all cameras: candidates, one consensus, refinement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from horizon_sensor_ros.core.camera import CameraView
from horizon_sensor_ros.core.fits.limb_rays import gather
from horizon_sensor_ros.core.fits.maximum_likelihood import refine
from horizon_sensor_ros.core.fits.result import LimbObservation
from horizon_sensor_ros.core.limb.air_layer import ground_under_airglow
from horizon_sensor_ros.core.limb.candidates import (
    LimbCandidates,
    block_average,
    canny_candidates,
    space_boundary_candidates,
)
from horizon_sensor_ros.core.limb.edge_model import EdgeLook
from horizon_sensor_ros.core.limb.points import LimbPoints
from horizon_sensor_ros.core.limb.refinement import RefinePass, refine_limb
from horizon_sensor_ros.core.limb.selection import (
    MIN_INLIERS,
    Consensus,
    limb_consensus,
    rays_of_candidates,
)
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.robust import median
from horizon_sensor_ros.core.status import Status

# From the consensus, good to a grid step or two, to the last tenths of a pixel. Where air glows the
# ground's edge lies farther from the steepest fall, where the first two look, than the last does.
# The search sees a reduced image, whose edges look sharper than they are.
_SEARCH = RefinePass(reach_px=8.0, grid_px=0.5, spacing_px=4.0, guess=False)
_NEAR = RefinePass(reach_px=3.0, grid_px=0.5, spacing_px=2.0)
_GLOW = RefinePass(reach_px=2.0, grid_px=0.25, spacing_px=2.0)
_FINAL = RefinePass(reach_px=1.0, grid_px=0.125, spacing_px=1.0)
# Where the prediction was off.
_AGAIN = RefinePass(reach_px=10.0, grid_px=0.5, spacing_px=4.0, guess=False)
_STRETCHES, _ON_COURSE_PX = 4, 0.6
_CANNY_REACH_PX = 2.0


@dataclass(frozen=True)
class Detection:
    """The limb in each frame, and where the last pass of refinement looked for it.

    limbs : one per frame, in order. nadir_base, rho_rad : the cone whose limb the last pass
    refined; NaN where there is none. candidates : step one's, for drawing. consensus : step two's.
    looks : one per frame, what the limb's edge looks like.
    """

    limbs: tuple[LimbPoints, ...]
    candidates: tuple[LimbCandidates, ...] = ()
    consensus: Consensus = field(default_factory=lambda: Consensus(Status.NO_LIMB))
    nadir_base: np.ndarray = field(default_factory=lambda: np.full(3, np.nan))
    rho_rad: float = np.nan
    looks: tuple[tuple[EdgeLook, ...], ...] = ()


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
        return Detection((none,) * len(views), candidates, consensus)
    nadir, rho = consensus.nadir_base, consensus.rho_rad
    looks: list[tuple[EdgeLook, ...]] = [()] * len(views)
    held = list(looks)
    limbs: list[LimbPoints] = []
    for step in (_SEARCH, _NEAR, _GLOW, _FINAL):
        if step is _GLOW and not any(look.glow_px > 0 for seen in looks for look in seen):
            continue
        limbs = []
        for i, (view, image) in enumerate(zip(views, images, strict=True)):
            here, part = step, image
            if step is _SEARCH:
                factor = max(1, int(candidates[i].pitch_px) // 2)
                here = replace(step, factor=factor)
                part = image if factor == 1 else block_average(image, factor)
            limb, held[i] = refine_limb(part, view, nadir, rho, here, looks[i])
            limbs.append(limb)
            looks[i] = held[i] or looks[i]
        if step is _FINAL:
            break
        rays = gather([LimbObservation(v, limb) for v, limb in zip(views, limbs, strict=True)])
        nearer = refine(rays, planet, (nadir, rho))
        if not nearer.ok:
            nearer = refine(rays, planet)
        if not nearer.ok:
            break
        nadir, rho = nearer.nadir_base, nearer.rho_rad
    return Detection(tuple(limbs), candidates, consensus, nadir, rho, tuple(held))


def follow_limb(
    views: Sequence[CameraView],
    images: Sequence[np.ndarray],
    planet: Planet,
    nadir_base: np.ndarray,
    rho_rad: float,
    looks: Sequence[tuple[EdgeLook, ...]],
) -> Detection | None:
    """Find the limb again near a predicted one; None where the prediction is of no help.

    looks : of the edge in each frame, as in the last detection; none for a camera that saw no limb.
    The last pass of `detect_limb` around the predicted cone; if the limb turns out to lie more than
    a part of a pixel off, again around where it is, so that the answer is that of a search. Where a
    look no longer holds, or a camera sees a limb that saw none, that is for a search to say.
    """
    nadir, rho = nadir_base, rho_rad
    glows = any(seen.glow_px > 0 for look in looks for seen in look)
    approach = (_GLOW, _FINAL) if glows else (_FINAL,)
    for step in (*approach, _AGAIN, *approach, _FINAL):
        if step is _AGAIN:
            # What was out of reach was not even seen: the rest gave no better cone.
            nadir, rho = nadir_base, rho_rad
        found = [
            refine_limb(image, view, nadir, rho, step, () if step is _AGAIN else look)
            for view, image, look in zip(views, images, looks, strict=True)
        ]
        limbs = tuple(limb for limb, _ in found)
        observations = [LimbObservation(v, limb) for v, limb in zip(views, limbs, strict=True)]
        if any(
            limb.status is Status.OK and not look for limb, look in zip(limbs, looks, strict=True)
        ):
            return None
        if step is _FINAL and all(
            held and _on_course(observation, nadir, rho)
            for observation, (_, held), look in zip(observations, found, looks, strict=True)
            if look
        ):
            held_looks = tuple(held for _, held in found)
            return Detection(limbs, nadir_base=nadir, rho_rad=rho, looks=held_looks)
        nearer = refine(gather(observations), planet, (nadir, rho))
        if nearer.ok:
            nadir, rho = nearer.nadir_base, nearer.rho_rad
    return None


def _on_course(observation: LimbObservation, nadir_base: np.ndarray, rho_rad: float) -> bool:
    """Whether all stretches of a limb lie near the cone that it was measured around."""
    rays = observation.rays
    if len(rays) < MIN_INLIERS:
        return False
    off = rays.residuals_px(nadir_base, rho_rad)[rays.along_limb(nadir_base)]
    return max(abs(median(part)) for part in np.array_split(off, _STRETCHES)) < _ON_COURSE_PX


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
