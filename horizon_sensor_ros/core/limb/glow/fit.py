"""The limb under glowing air: limb, glow and the texture beside them in one fit of a frame.

Along the normals of a predicted limb, d pixels outwards, the mean of each stretch of limb shows

    I_i(d) = B_i(d) + level_i F(e_i - d) + A_i (G(d - e_i) + share S(e_i - d)) + T_i(d) + noise

B is the background, which rises evenly along the limb, with stray light, and outwards, below a
layer of airglow; F the blurred step; G the glow of an exponential atmosphere above the limb, by the
height of each line of sight; S what the same air shows in front of the ground; T texture, a
Gaussian process as in `kriging`, along the limb as well. All edges e_i lie on one limb of three
unknowns. The air is the same all along it: one scale height, and a brightness A that changes
slowly, with the Sun's height, and towards the corners with the lens.
So the glow far out, where no ground is, tells what glow there is at the edge, and its contour tells
how the limb bends; what is left of the edge tells where it lies.
Source: derived here; maximum likelihood, its derivatives by way of the likeliest ground; the
texture's strength by restricted likelihood (Rasmussen & Williams 2006, 2.7 and 5.4).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.limb.air import (
    BLURS_PX,
    LIMB,
    SHARE_SIGMA,
    SHARES,
    USUAL_SHARE,
    Air,
    usual_bend,
    usual_length_px,
)
from horizon_sensor_ros.core.limb.edge.model import EdgeLook
from horizon_sensor_ros.core.limb.glow.first_guess import FROM_PX, first_guess
from horizon_sensor_ros.core.limb.glow.glare import look_without_glare
from horizon_sensor_ros.core.limb.glow.limb import GlowLimb, limb_of
from horizon_sensor_ros.core.limb.glow.model import GlowStep, ends_unseen, step_towards
from horizon_sensor_ros.core.limb.glow.sight import LEAST_STRETCHES, GlowSight
from horizon_sensor_ros.core.limb.glow.stride import stride_of
from horizon_sensor_ros.core.limb.glow.twilight import lacks_air, lit_part, taken_for_limb
from horizon_sensor_ros.core.mathematics.attitude import tangent_basis
from horizon_sensor_ros.core.mathematics.robust import median
from horizon_sensor_ros.core.mathematics.symmetric3 import is_positive

_KEEP_SHARE = 0.5  # of the stretches, that may not be outliers
# How far beyond `FROM_PX` glow is looked at.
_LENGTHS = 3.5  # lengths over which it fades
_SHORTEST_PX = 6.0
_LONGEST_PX = 40.0
_LEAST_LENGTH = 0.6  # of glow that is looked for, over the usual one
# Steps of the fit, by how far they move the limb at most.
_NEAR_PX = 0.05  # of the last one
_STEPS = 16  # more are too many: the fit does not converge
_FAR_PX = 4.0  # of all together: farther is another edge
# Under long glow, as from a balloon, it takes many small steps to separate blur and height.
_LONG_PX = 2.0  # length of glow, from where on as many times more are allowed as it is longer
_FAR_LENGTHS = 3.0  # lengths of glow that all steps together may go
_LONG_GLOW_PX = 4.0  # length of glow, from where on a fit that fails is begun again elsewhere
_STARTS = 0.0, -0.2, -0.4  # where: lengths of glow outwards
# Steps that leave the limb where it is with a blur at the end of what may be: no more come of it.
_PINNED = 3
_AFRESH_PX = 1.0  # off the cone about which the limb was drawn, from where on it is drawn again
# How the logarithm of A, the glow's brightness, changes from the middle of the limb to its ends.
_TWILIGHT = 1.0  # slope or bend, at first sight, that no daylight has
_MOST_SLOPE = 0.3  # by daylight; more towards the terminator
_MOST_BEND = 0.15  # likewise
# Cost over the degrees of freedom.
_OUTLIER = 5.0  # of a stretch, over the median one's: left out
_OVEREXPOSED = 0.5  # share of the stretches: more, and how sharp the edge is is not known
_MISFIT = 1.4  # of the median stretch, from which the model does not hold


@dataclass(frozen=True)
class UnevenGlow:
    """In place of a limb: glow changes too fast along it, and no fit of its lit part holds.

    taken : a fit by daylight took that for the limb's own turn or bend.
    """

    taken: bool = False


class _Fading(NamedTuple):
    """In place of a limb by daylight: the part of it that is lit, from 0 to 1 along it. taken : its
    fading was taken for the limb's own turn or bend.
    """

    part: tuple[float, float]
    taken: bool


def fit_glow(
    gray: np.ndarray,
    view: CameraView,
    nadir_base: np.ndarray,
    rho_rad: float,
    look: EdgeLook,
    factor: int = 1,
    *,
    in_part: bool = True,
) -> GlowLimb | UnevenGlow | None:
    """Fit the limb near a predicted one; None where the model does not hold, or too little shows.

    gray : (H, W), reduced by `factor`. look : of the edge, with its glow or air, to start from.
    in_part : where glow changes too fast along the limb, as towards the terminator, the part of it
    that is lit is fitted by itself.
    """
    part = None if look.air is None else look.air.part
    found = None
    for rho in _starts(view, rho_rad, factor):
        found = _fitted(gray, view, nadir_base, rho, look, factor, part)
        if found is not None:
            break
    uneven = part is not None or isinstance(found, _Fading)
    taken = isinstance(found, _Fading) and found.taken
    if isinstance(found, _Fading) and in_part:
        fresh = replace(look, air=None)
        found = _fitted(gray, view, nadir_base, rho_rad, fresh, factor, found.part)
    if isinstance(found, GlowLimb) and not (taken and lacks_air(found.air.share)):
        return found
    return UnevenGlow(taken) if uneven else None


def _starts(view: CameraView, rho_rad: float, factor: int) -> list[float]:
    """Radii to begin with: under long glow edges are found far beyond the limb, and the fit may
    settle there on glow for ground.
    """
    length_px = usual_length_px(view, rho_rad, factor)
    if length_px < _LONG_GLOW_PX:
        return [rho_rad]
    length_rad = length_px * factor * view.camera.pixel_rad
    return [rho_rad + start * length_rad for start in _STARTS]


def _fitted(
    gray: np.ndarray,
    view: CameraView,
    nadir_base: np.ndarray,
    rho_rad: float,
    look: EdgeLook,
    factor: int,
    part: tuple[float, float] | None,
) -> GlowLimb | _Fading | None:
    """`fit_glow` by daylight, or towards the terminator of a part of what is seen of the limb, from
    0 to 1 along it. Where glow is too uneven for daylight: the part that is lit.
    """
    length_px = usual_length_px(view, rho_rad, factor)
    outer_px = _outer_px(look, length_px)
    air = first = look.air
    keep = np.empty(0, dtype=bool)
    sight: GlowSight | None = None
    moved, since, pinned = 0.0, 0.0, 0
    last: np.ndarray | None = None
    most_px = max(_FAR_PX, _FAR_LENGTHS * length_px)
    for _ in range(round(_STEPS * max(1.0, length_px / _LONG_PX))):
        if sight is None or since > _AFRESH_PX:
            cone = nadir_base, rho_rad
            glaring = sight is not None and bool(sight.glare.any())
            sight = look_without_glare(gray, view, cone, outer_px, factor, glaring, part)
            since = 0.0
            if sight is None:
                return None
        if air is None or len(keep) != len(sight):
            guess = first_guess(sight, look, air)
            air, keep = guess.air.lit_in(part), guess.keep
            first = first or air
            if part is None and (_too_few(keep) or np.abs(air.log_glow[1:]).max() > _TWILIGHT):
                return _fading(guess.glow)
        if _too_few(keep) or not air.imaginable:
            return None
        found = step_towards(sight, air, keep)
        if not _determined(found):
            return None
        stride = stride_of(found.change, sight.rows, last)
        last = stride.last
        outlying = keep & (found.cost > _OUTLIER * max(1.0, median(found.cost[keep])))
        settled = stride.far_px <= _NEAR_PX and not outlying.any()
        if settled and air.near(stride.change):
            limb = limb_of(sight, found, keep, air, nadir_base)
            return _judged(limb, sight, air, first or air, guess.glow, median(found.cost[keep]))
        keep = keep & ~outlying
        air = air.changed(stride.change)
        pinned = pinned + 1 if settled and air.psf_px in BLURS_PX else 0
        moved, since = moved + stride.far_px, since + stride.far_px
        if pinned == _PINNED or moved > most_px:
            return None
        nadir_base = nadir_base + tangent_basis(nadir_base) @ stride.change[:2]
        nadir_base = nadir_base / np.linalg.norm(nadir_base)
        rho_rad += float(stride.change[2])
        if since <= _AFRESH_PX:
            sight = sight.moved(gray, stride.shift_px)
    return None


def _outer_px(look: EdgeLook, length_px: float) -> float:
    """How far above the limb glow is looked at. length_px : over which the usual one fades."""
    glow_px = max(look.glow_px, _LEAST_LENGTH * length_px)
    return FROM_PX + min(max(_LENGTHS * glow_px, _SHORTEST_PX), _LONGEST_PX)


def _determined(found: GlowStep) -> bool:
    """Whether a step tells all unknowns."""
    known = np.isfinite(found.change).all() and np.isfinite(found.cov).all()
    return bool(known and is_positive(found.cov[LIMB, LIMB]))


def _too_few(keep: np.ndarray) -> bool:
    """Whether too few of the stretches (M,) are kept for a fit."""
    return bool(np.count_nonzero(keep) < max(LEAST_STRETCHES, _KEEP_SHARE * len(keep)))


def _uneven(air: Air) -> bool:
    """Whether glow changes along the limb as it does not by daylight."""
    slope, bend = air.log_glow[1:].tolist()
    bend -= usual_bend(air.log_glow)
    return not (abs(slope) < _MOST_SLOPE and abs(bend) < _MOST_BEND)


def _fading(glow: np.ndarray, *, taken: bool = False) -> _Fading | None:
    """Of glow of stretches (M,); None if nothing glows."""
    part = lit_part(glow)
    return None if part is None else _Fading(part, taken)


def _judged(
    limb: GlowLimb, sight: GlowSight, air: Air, first: Air, glow: np.ndarray, misfit: float
) -> GlowLimb | _Fading | None:
    """What a fit that has settled comes to. first : air that it began with, above stretches with
    glow (M,). misfit : cost of the median one.
    """
    if not air.twilit and (_uneven(air) or ends_unseen(sight, air)):
        return _fading(glow)
    if not (misfit < _MISFIT and _plausible(air, sight)):
        return None
    # Under the Sun's glare first sight is not of glow alone, and under long glow it is of edges far
    # beyond the limb, see `_starts`.
    told = not limb.glaring and limb.length_px < _LONG_GLOW_PX
    evened = float(np.linalg.norm((first.log_glow - air.log_glow)[1:]))
    if told and not air.twilit and taken_for_limb(evened, air.share, misfit):
        return _fading(glow, taken=True)
    return limb


def _plausible(air: Air, sight: GlowSight) -> bool:
    """Whether what is seen of the limb is in daylight, or is taken to be in twilight, and blur and
    share are such as could be told: a limb as sharp as pixels can tell may be so where the share is
    an ordinary one, and most of it is not overexposed.
    """
    least = SHARES[0]
    if air.psf_px == BLURS_PX[0]:
        clear = sight.blind.any(axis=1).mean() < _OVEREXPOSED
        least = USUAL_SHARE - 2.0 * SHARE_SIGMA if clear else math.inf
    return bool(
        (air.twilit or not _uneven(air))
        and air.psf_px < BLURS_PX[1]
        and least < air.share < SHARES[1]
    )
