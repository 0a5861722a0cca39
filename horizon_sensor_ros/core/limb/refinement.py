"""Step three: the limb to a small part of a pixel, along the normal of the predicted limb."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.fits.limb_rays import rays_of
from horizon_sensor_ros.core.limb.air import usual_length_px
from horizon_sensor_ros.core.limb.edge.looks import (
    CLEAR_SHARE,
    MOST_IN_FOCUS_PX,
    USUAL_PSF_PX,
    guess_looks,
    likeliest_look,
)
from horizon_sensor_ros.core.limb.edge.model import EdgeLook
from horizon_sensor_ros.core.limb.edge.terminator import beside_over_deep
from horizon_sensor_ros.core.limb.edge_by_edge.edges import LimbEdges, believable
from horizon_sensor_ros.core.limb.edge_by_edge.followed import expected_limb
from horizon_sensor_ros.core.limb.edge_by_edge.limb import limb_of_edges
from horizon_sensor_ros.core.limb.edge_by_edge.modelled import modelled_edges
from horizon_sensor_ros.core.limb.glow.fit import fit_glow
from horizon_sensor_ros.core.limb.glow.limb import GlowLimb
from horizon_sensor_ros.core.limb.glow.points import points_alone
from horizon_sensor_ros.core.limb.sample import MIN_PROFILES, LimbSample, RefinePass, sample_limb
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.status import Status

# The limb, and looks of its edge.
_Refined = tuple[LimbPoints, tuple[EdgeLook, ...]]
_THINNEST_PX = 0.3  # length over which glow fades, from which it may be told from the blur
# Length of glow up to which it passes for blur; and from which it would shine beyond the edge, in
# sigmas of the noise at least: all of 20 simulated limbs told from such air did so.
_PASSES_PX = 2.5
_SHINES_PX, _SHINES = 0.8, 1.0


def refine_limb(
    gray: np.ndarray,
    view: CameraView,
    nadir_base: np.ndarray,
    rho_rad: float,
    step: RefinePass,
    looks: Sequence[EdgeLook] = (),
) -> tuple[LimbPoints, tuple[EdgeLook, ...]]:
    """Measure the limb near its predicted place in one image.

    gray : (H, W) uint8 or uint16, already reduced by ``step.factor``; pixels of the result are
    those of the full image. looks : what the edge may look like, as returned by the pass before;
    of several the likeliest is chosen. Without any the place of steepest fall is taken.
    Returns the limb and the look of its edge: after a pass without one, guesses or nothing; nothing
    where a given one does not hold. Too few significant edges: status NO_LIMB, and no looks.
    """
    cone = nadir_base, rho_rad
    joint = _JointFit(gray, step, view, cone)
    separate = step.separate_glow
    if separate and len(looks) == 1 and looks[0].air is not None:
        found = joint.in_known_air(looks[0])
        if found is not None:
            return found
        # The next frame's fit begins anew.
        separate, looks = False, (replace(looks[0], air=None),)
    sample = sample_limb(gray, view, *cone, step, modelled=bool(looks) or step.at_once)
    if isinstance(sample, LimbPoints):
        return sample, ()
    sample = _levelled(sample, looks, step)
    if step.expected and len(looks) == 1 and looks[0].glow_px == 0.0:
        followed = expected_limb(sample, looks[0], rho_rad)
        if followed is not None:
            return followed, tuple(looks)
    profiles, grid, steepest = sample.profiles, sample.grid, sample.steepest
    good = believable(steepest)
    enough = np.count_nonzero(good) >= MIN_PROFILES
    if step.at_once and enough:
        looks = guess_looks(profiles[good], grid.d_px, steepest.take(good), CLEAR_SHARE)
        if any(look.glow_px > 0.0 for look in looks):
            reason = "the edge is soft, or the air above it glows"
            return LimbPoints.none(Status.NO_LIMB, reason), ()
    edges = LimbEdges(steepest, good)
    if looks and enough:
        plain = good & ~sample.clipped
        shown = profiles[plain if np.count_nonzero(plain) >= MIN_PROFILES else good]
        # Whether air glows is asked before; what else the edge looks like the joint fit finds out.
        perhaps = separate and any(look.glow_px > 0.0 for look in looks)
        for climb in (False, True) if perhaps and len(looks) > 1 else (True,):
            look = likeliest_look(shown, sample.noise, looks, grid, climb=climb)
            if separate and look.glow_px > 0.0:
                found = joint.of(look, edges.jumps_px)
                if found is not None:
                    return found
        looks = (look,)
        edges = modelled_edges(sample, look, edges, rho_rad, step) or edges
    if separate and looks and enough and looks[0].glow_px == 0.0:
        found = joint.of_thin_air(looks[0], edges, sample, good)
        if found is not None:
            return found
    return limb_of_edges(sample, edges, steepest, looks, view, rho_rad, step, uneven=joint.uneven)


def _levelled(sample: LimbSample, looks: Sequence[EdgeLook], step: RefinePass) -> LimbSample:
    """`LimbSample.levelled`, where it is known that no air glows."""
    if not looks or any(look.glow_px > 0.0 for look in looks):
        return sample
    if step.expected:
        return sample.levelled(sample.steps[1])
    return sample.levelled(believable(sample.steepest))


def separate_limb(
    gray: np.ndarray,
    view: CameraView,
    cone: tuple[np.ndarray, float],
    step: RefinePass,
    look: EdgeLook,
    jumps_px: float,
) -> _Refined | None:
    """The limb near a cone, told apart from the glow above it, and its look with that air; None
    where it cannot be.

    gray, step : as of `refine_limb`. look : with the air to start from, or without any. jumps_px :
    of edges that were found one by one.
    """
    return _JointFit(gray, step, view, cone).of(look, jumps_px)


def separate_from_thin_air(
    gray: np.ndarray,
    view: CameraView,
    cone: tuple[np.ndarray, float],
    step: RefinePass,
    jumps_px: float,
) -> _Refined | None:
    """The limb near a cone, told apart from air that is as thin as the blur, as by `separate_limb`;
    None where that is not surely air.
    """
    length_px = usual_length_px(view, cone[1], step.factor)
    if not _passes_for_blur(length_px, step):
        return None
    joint = _JointFit(gray, step, view, cone)
    return joint.of_air_as_thin_as(length_px, jumps_px, surely=True)


def _passes_for_blur(length_px: float, step: RefinePass) -> bool:
    """Whether edges may look like those of a soft lens where air fades over such a length."""
    return _THINNEST_PX < length_px < _PASSES_PX and step.blur_open_px == 0.0


def _without_glow(sample: LimbSample, look: EdgeLook) -> EdgeLook:
    """What edges look like that are taken to have no glow, where they had some look with glow.

    That one's blur is the lens's, or but where a fit began; what is left of the air blurs them too.
    """
    _, good = sample.steps
    sharp = EdgeLook(look.psf_px, 0.0)
    if np.count_nonzero(good) < MIN_PROFILES:
        return sharp
    looks = (sharp, *sharp.neighbours())
    return likeliest_look(sample.profiles[good], sample.noise, looks, sample.grid)


class _JointFit:
    """Fits of the limb near a predicted cone together with the glow above it.

    uneven : glow was too uneven for one of them.
    """

    def __init__(
        self,
        gray: np.ndarray,
        step: RefinePass,
        view: CameraView,
        cone: tuple[np.ndarray, float],
    ) -> None:
        self._gray, self._step, self._view, self._cone = gray, step, view, cone
        self.uneven = self._taken = False

    def of(self, look: EdgeLook, jumps_px: float = np.inf) -> _Refined | None:
        """Points of the limb, and the look with its air; None where the fit does not hold.

        look : to start from. jumps_px : of edges that were found one by one.
        """
        limb = self._fitted(look)
        return None if limb is None else self._refined(limb, look, jumps_px)

    def _fitted(self, look: EdgeLook) -> GlowLimb | None:
        step = self._step
        limb = fit_glow(
            self._gray, self._view, *self._cone, look, step.factor, in_part=step.in_part
        )
        if not isinstance(limb, GlowLimb):
            self.uneven |= limb is not None
            self._taken |= limb is not None and limb.taken
            return None
        if self._taken and not limb.air.twilit:
            # Nor is glow even to a fit that began with another look of the edge.
            return None
        return replace(limb, smeared=True) if step.blur_open_px > 0.0 else limb

    def _refined(self, limb: GlowLimb, look: EdgeLook, jumps_px: float) -> _Refined:
        step, view, cone = self._step, self._view, self._cone
        points = replace(points_alone(limb), jumps_px=jumps_px * step.factor)
        points = replace(points, offset_px=rays_of(view, points).residuals_px(*cone))
        return points, (replace(look, air=limb.air),)

    def of_thin_air(
        self, look: EdgeLook, edges: LimbEdges, sample: LimbSample, good: np.ndarray
    ) -> _Refined | None:
        """`of` where edges show no glow, but may all the same lie in it.

        From far away air is as thin as the blur, and either no edge quite looks like one of them,
        or it passes for blur, and lifts the edges. look : of these, which are good (N,) of the
        sample's.
        """
        length_px = usual_length_px(self._view, self._cone[1], self._step.factor)
        blurred = (
            look.psf_px > MOST_IN_FOCUS_PX
            and _passes_for_blur(length_px, self._step)
            and not self._step.expected
            and (length_px < _SHINES_PX or sample.light_beyond(good) > _SHINES)
        )
        if not (blurred or (edges.model_free and length_px > _THINNEST_PX)):
            return None
        # Where a model fits edges as well, it may be clouds beside a soft lens that look like air.
        surely = not edges.model_free
        found = self.of_air_as_thin_as(length_px, edges.jumps_px, surely=surely)
        if found is None:
            return None
        # Where light ends, as along a terminator, glow may be fitted to how it fades.
        rises = beside_over_deep(sample.profiles[good], sample.grid)
        return replace(found[0], beside_over_deep=rises), found[1]

    def of_air_as_thin_as(
        self, length_px: float, jumps_px: float, *, surely: bool
    ) -> _Refined | None:
        """`of` thin air that fades over about such a length. surely : only where it is air beyond
        doubt.
        """
        thin = EdgeLook(USUAL_PSF_PX, length_px)
        limb = self._fitted(thin)
        if limb is None or (surely and not limb.is_surely_air):
            return None
        return self._refined(limb, thin, jumps_px)

    def in_known_air(self, look: EdgeLook) -> _Refined | None:
        """`of` from the air that the last frame's fit found; where that was hardly any, and the
        limb is where it was expected, without it.
        """
        step, cone = self._step, self._cone
        if step.expected and look.air is not None and look.air.faint:
            sample = sample_limb(self._gray, self._view, *cone, step, modelled=True)
            if isinstance(sample, LimbSample):
                sharp = _without_glow(sample, look)
                followed = expected_limb(sample, sharp, cone[1])
                if followed is not None:
                    return followed, (sharp,)
        return self.of(look)
