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
    KEPT,
    KEPT_BLUR,
    KEPT_LOG_GLOW,
    LIMB,
    SHARE_SIGMA,
    SHARES,
    USUAL_HEIGHT,
    USUAL_SHARE,
    Air,
    usual_bend,
)
from horizon_sensor_ros.core.limb.edge.model import EdgeLook
from horizon_sensor_ros.core.limb.glow.brightness import powers
from horizon_sensor_ros.core.limb.glow.glare import glare_lines, in_glare, reach_px
from horizon_sensor_ros.core.limb.glow.model import GlowStep, ends_unseen, step_towards
from horizon_sensor_ros.core.limb.glow.sight import GlowSight, look_along
from horizon_sensor_ros.core.limb.glow.twilight import lit_part
from horizon_sensor_ros.core.limb_curve import LimbCurve
from horizon_sensor_ros.core.mathematics.attitude import tangent_basis
from horizon_sensor_ros.core.mathematics.robust import median
from horizon_sensor_ros.core.mathematics.symmetric3 import is_positive

_LEAST_STRETCHES = 10  # of limb, that a fit takes
_KEEP_SHARE = 0.5  # of the stretches, that may not be outliers
_FROM_PX = 2.0  # beyond the edge, from where on there is hardly anything but glow
# How far beyond that glow is looked at.
_LENGTHS = 3.5  # lengths over which it fades
_SHORTEST_PX = 6.0
_LONGEST_PX = 40.0
_LEAST_LENGTH = 0.6  # of glow that is looked for, over the usual one
# Scale heights over the Earth's radius that are tried for the first guess.
_HEIGHTS = np.exp(np.linspace(np.log(4e3), np.log(16e3), 25)) / 6371e3
_THIN_PX = 1.0  # length of glow, below which it hides in the blur and is guessed
_THIN_GLOW = 0.5  # that guess, over the brightness just beyond the edge
# Steps of the fit, by how far they move the limb at most.
_NEAR_PX = 0.05  # of the last one
_STEPS = 16  # more are too many: the fit does not converge
_FAR_PX = 4.0  # of all together: farther is another edge
_MOST_STEP_PX = 2.0  # of one; longer ones are cut
# Under long glow, as from a balloon, it takes many small steps to separate blur and height.
_LONG_PX = 2.0  # length of glow, from where on as many times more are allowed as it is longer
_FAR_LENGTHS = 3.0  # lengths of glow that all steps together may go
_LONG_GLOW_PX = 4.0  # length of glow, from where on a fit that fails is begun again elsewhere
_STARTS = 0.0, -0.2, -0.4  # where: lengths of glow outwards
# A step over the last one, where the next ones will go on like it, or back and forth: all of them
# are then made at once, as the sum of a geometric series.
_AHEAD = 0.3, 0.8
_BACK = -1.3, -0.5
# Steps that leave the limb where it is with a blur at the end of what may be: no more come of it.
_PINNED = 3
_AFRESH_PX = 1.0  # off the cone about which the limb was drawn, from where on it is drawn again
# Glow of a stretch over the median one, that may still be the same air's.
_FAINTEST = 0.2
_BRIGHTEST = 5.0
_MOST_MISFIT = 4.0  # of a stretch's glow, over the noise or the median stretch's
# A part of the craft before ground and sky: their difference in a stretch that it hides, at most,
# and how much brighter than other sky it is at least, both over the usual difference.
_FLAT, _BRIGHT = 0.4, 0.15
_FAR = 3  # pixels at a stretch's outer end that are taken for sky
# How the logarithm of A, the glow's brightness, changes from the middle of the limb to its ends.
_TWILIGHT = 1.0  # slope or bend, at first sight, that no daylight has
_MOST_SLOPE = 0.3  # by daylight; more towards the terminator
_MOST_BEND = 0.15  # likewise
# Cost over the degrees of freedom.
_OUTLIER = 5.0  # of a stretch, over the median one's: left out
_OVEREXPOSED = 0.5  # share of the stretches: more, and how sharp the edge is is not known
# Logarithm of the glow's brightness over white from where on saturated samples hide the limb below
# it, and from where on no more of it is hidden.
_DIM, _DROWNED = -1.0, 0.2
_MISFIT = 1.4  # of the median stretch, from which the model does not hold
# Least glow over its own error. Of simulated limbs without air one of 120 reaches more; above those
# with air none of 1300 that are fixed has less than 5.
_LEAST_GLOW = 4.0
# The same, and least scale height over the usual one, from which it is air for sure, also beside a
# soft lens and clouds: of simulated limbs without air none reaches both, by far; of those with air
# that passes for blur nine of ten do.
_SURE_GLOW, _SURE_HEIGHT = 6.0, 0.75


@dataclass(frozen=True, eq=False)
class GlowLimb:
    """The limb that fits a frame, by what that tells by itself.

    px, normal_px (M, 2) : points of it and their normals, in the full image. rows (M, 3) : how they
    move along these with nadir's two tangent components, about nadir_base, and rho, pixels of the
    reduced one. along : (M,) their places along the limb, -1 to 1. stretch_px : length of limb of
    each, in the reduced image. curve : all along which it was looked for.
    air : that glows above it, and length_px over which that fades. value (7,), cov (7, 7) : of the
    `KEPT` unknowns, the limb's three as they are off these points; beforehand : (7,) information on
    blur, slope and bend of log A that is in them. ripple : as of `GlowStep`. glaring : the Sun's
    glare was taken off. overexposed : share of the stretches with saturated samples. drowned : by
    how much of the logarithm of white the glow above the limb is saturated as well, from 0, `_DIM`,
    on; mean over the stretches. smeared : motion blurs the frame.
    """

    px: np.ndarray
    normal_px: np.ndarray
    rows: np.ndarray
    along: np.ndarray
    factor: int
    stretch_px: float
    curve: LimbCurve
    nadir_base: np.ndarray
    air: Air
    length_px: float
    value: np.ndarray
    cov: np.ndarray
    beforehand: np.ndarray
    ripple: float
    glaring: bool
    overexposed: float
    drowned: float
    smeared: bool = False

    @property
    def is_surely_air(self) -> bool:
        """Whether what glows fades as air does, and is no cloud beside a soft lens."""
        high = self.air.height > _SURE_HEIGHT * USUAL_HEIGHT
        return high and _glow_over_error(self.along, self.cov) > _SURE_GLOW


class UnevenGlow:
    """In place of a limb: glow changes too fast along it, and no fit of its lit part holds."""


def usual_length_px(view: CameraView, rho_rad: float, factor: int = 1) -> float:
    """Length over which the Earth's air usually fades above a limb of this radius."""
    return USUAL_HEIGHT * math.tan(rho_rad) / (factor * view.camera.pixel_rad)


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
    uneven = part is not None or isinstance(found, tuple)
    if isinstance(found, tuple) and in_part:
        fresh = replace(look, air=None)
        found = _fitted(gray, view, nadir_base, rho_rad, fresh, factor, found)
    if isinstance(found, GlowLimb):
        return found
    return UnevenGlow() if uneven else None


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
) -> GlowLimb | tuple[float, float] | None:
    """`fit_glow` by daylight, or towards the terminator of a part of what is seen of the limb, from
    0 to 1 along it. Where glow is too uneven for daylight: the part that is lit.
    """
    length_px = usual_length_px(view, rho_rad, factor)
    outer_px = _outer_px(look, length_px)
    air = look.air
    keep = np.empty(0, dtype=bool)
    sight: GlowSight | None = None
    moved = since = 0.0
    pinned = 0
    last: np.ndarray | None = None
    most_px = max(_FAR_PX, _FAR_LENGTHS * length_px)
    for _ in range(round(_STEPS * max(1.0, length_px / _LONG_PX))):
        if sight is None or since > _AFRESH_PX:
            glaring = sight is not None and bool(sight.glare.any())
            sight = _look(gray, view, (nadir_base, rho_rad), outer_px, factor, glaring, part)
            since = 0.0
            if sight is None:
                return None
        if air is None or len(keep) != len(sight):
            guess = _first_guess(sight, look, air)
            air, keep = guess.air.lit_in(part), guess.keep
            if part is None and (_too_few(keep) or np.abs(air.log_glow[1:]).max() > _TWILIGHT):
                return lit_part(guess.glow)
        if _too_few(keep) or not air.imaginable:
            return None
        found = step_towards(sight, air, keep)
        if not _determined(found):
            return None
        stride = _stride(found.change, sight.rows, last)
        last = stride.last
        outlying = keep & (found.cost > _OUTLIER * max(1.0, median(found.cost[keep])))
        settled = stride.far_px <= _NEAR_PX and not outlying.any()
        if settled and air.near(stride.change):
            if part is None and (_uneven(air) or ends_unseen(sight, air)):
                return lit_part(guess.glow)
            holds = median(found.cost[keep]) < _MISFIT and _plausible(air, sight)
            return _limb(sight, found, keep, air, nadir_base) if holds else None
        keep = keep & ~outlying
        air = air.changed(stride.change)
        pinned = pinned + 1 if settled and air.psf_px in BLURS_PX else 0
        moved += stride.far_px
        since += stride.far_px
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
    return _FROM_PX + min(max(_LENGTHS * glow_px, _SHORTEST_PX), _LONGEST_PX)


def _determined(found: GlowStep) -> bool:
    """Whether a step tells all unknowns."""
    known = np.isfinite(found.change).all() and np.isfinite(found.cov).all()
    return bool(known and is_positive(found.cov[LIMB, LIMB]))


class _Stride(NamedTuple):
    """As much of a step as is gone at once.

    change : of the unknowns. shift_px : (M,) of the limb outwards, far_px at most. last : (M,) the
    step itself, for the next one to be held against; None after one that went farther than it.
    """

    change: np.ndarray
    shift_px: np.ndarray
    far_px: float
    last: np.ndarray | None


def _stride(change: np.ndarray, rows: np.ndarray, last: np.ndarray | None) -> _Stride:
    """What to go of a step that changes the unknowns so. rows, last : as of `GlowSight` and of the
    stride before.
    """
    shift = rows @ change[:3]
    share = _share(shift, last)
    last = shift if share == 0.0 else None
    change, shift = change / (1.0 - share), shift / (1.0 - share)
    far = float(np.abs(shift).max())
    if far > _MOST_STEP_PX:
        # Beside overexposed ground the first steps may be hundreds of pixels.
        change, shift = change * (_MOST_STEP_PX / far), shift * (_MOST_STEP_PX / far)
        far = _MOST_STEP_PX
    return _Stride(change, shift, far, last)


def _too_few(keep: np.ndarray) -> bool:
    """Whether too few of the stretches (M,) are kept for a fit."""
    return bool(np.count_nonzero(keep) < max(_LEAST_STRETCHES, _KEEP_SHARE * len(keep)))


def _share(shift: np.ndarray, last: np.ndarray | None) -> float:
    """By which share of the last step (M,) one goes the same way, or back: as all that follow will,
    so that they have an end; 0 where that cannot be told.
    """
    if last is None or len(last) != len(shift):
        return 0.0
    share = float(shift @ last) / float(last @ last)
    return share if any(low < share < high for low, high in (_AHEAD, _BACK)) else 0.0


def _uneven(air: Air) -> bool:
    """Whether glow changes along the limb as it does not by daylight."""
    slope, bend = air.log_glow[1:].tolist()
    bend -= usual_bend(air.log_glow)
    return not (abs(slope) < _MOST_SLOPE and abs(bend) < _MOST_BEND)


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


def _look(
    gray: np.ndarray,
    view: CameraView,
    cone: tuple[np.ndarray, float],
    outer_px: float,
    factor: int,
    glaring: bool,
    part: tuple[float, float] | None,
) -> GlowSight | None:
    """What is seen along a limb, or a part of it as of `_fitted`, up to outer_px above it, without
    the Sun's glare; None if little.

    glaring : it is known to be there.
    """
    sight = _without_glare(gray, view, cone, outer_px, factor, glaring)
    if sight is not None and part is not None:
        sight = sight.part(*part)
    return None if sight is None or len(sight) < _LEAST_STRETCHES else sight


def _without_glare(
    gray: np.ndarray,
    view: CameraView,
    cone: tuple[np.ndarray, float],
    outer_px: float,
    factor: int,
    glaring: bool,
) -> GlowSight | None:
    """`_look` at all of the limb."""
    sight = look_along(gray, view, *cone, outer_px, factor)
    if sight is None or len(sight) < _LEAST_STRETCHES:
        return None
    if not (glaring or in_glare(sight)):
        return sight
    reach = reach_px(sight)
    if reach is None:
        return None
    from_px, to_px = reach
    beyond = look_along(gray, view, *cone, to_px, factor)
    if beyond is None or len(beyond) < _LEAST_STRETCHES:
        return None
    lines = glare_lines(beyond, from_px)
    return sight if lines is None else beyond.without_glare(lines, from_px, outer_px)


class _Guess(NamedTuple):
    """Air that fits the profiles beyond the edge, which of them show it, keep (M,), and how
    brightly each does, glow (M,).
    """

    air: Air
    keep: np.ndarray
    glow: np.ndarray


def _first_guess(sight: GlowSight, look: EdgeLook, air: Air | None) -> _Guess:
    """What to begin the steps with. air : as found so far, which is kept."""
    background = median(sight.profiles[:, -2:].ravel())
    if air is None and median(USUAL_HEIGHT / sight.rise) < _THIN_PX:
        glow = _THIN_GLOW * (sight.profiles[:, 1] - background)
        log_glow = np.array([math.log(max(median(glow), 1e-6)), 0.0, 0.0])
        thin = Air(USUAL_HEIGHT, log_glow, USUAL_SHARE, look.psf_px, background, look.psf_px)
        return _Guess(thin, _in_sight(sight), glow)
    outer = sight.d_px >= _FROM_PX
    profiles, distance = sight.profiles[:, outer], sight.distance[:, outer]
    # Where sight is such that no air fits, none shows.
    best, none = np.inf, np.zeros(len(sight))
    found = USUAL_HEIGHT, none, none + np.inf
    for height in _HEIGHTS if air is None else (air.height,):
        fall = np.exp(-distance * (sight.rise / height)[:, None])
        own = fall - fall.mean(axis=1, keepdims=True)
        glow = (profiles * own).sum(axis=1) / (own * own).sum(axis=1)
        left = profiles - glow[:, None] * fall
        left -= left.mean(axis=1, keepdims=True)
        misfit = np.sqrt(np.mean(left * left, axis=1))
        if median(misfit) < best:
            best, found = median(misfit), (float(height), glow, misfit)
    height, glow, misfit = found
    usual = max(median(glow), 1e-6)
    keep = (glow > _FAINTEST * usual) & (glow < _BRIGHTEST * usual)
    keep &= misfit < _MOST_MISFIT * max(sight.noise, best)
    log_glow = np.zeros(3)
    if air is None and np.count_nonzero(keep) >= _LEAST_STRETCHES:
        log_glow = np.linalg.lstsq(powers(sight.along)[keep], np.log(glow[keep]), rcond=None)[0]
    psf_px = look.psf_px
    air = air or Air(height, log_glow, USUAL_SHARE, psf_px, background, psf_px)
    return _Guess(air, keep, glow)


def _in_sight(sight: GlowSight) -> np.ndarray:
    """Which stretches (M,) no part of the craft hides, nor a neighbour of theirs: one does where it
    is as bright in the sky as before the ground. The Sun's glare is not: it adds to both.
    """
    sky = sight.profiles[:, -_FAR:].mean(axis=1)
    fall = sight.profiles[:, sight.d_px < 0.0].mean(axis=1) - sky
    usual = median(fall)
    hidden = (fall < _FLAT * usual) & (sky - median(sky) > max(_BRIGHT * usual, 6.0 * sight.noise))
    beside = hidden.copy()
    beside[1:] |= hidden[:-1]
    beside[:-1] |= hidden[1:]
    return ~beside


def _glow_over_error(along: np.ndarray, cov: np.ndarray) -> float:
    """Glow above stretches at places (M,) along the limb, over its own error. cov : (7, 7), of the
    `KEPT` unknowns.
    """
    mean = powers(along).mean(axis=0)
    variance = mean @ cov[KEPT_LOG_GLOW[:, None], KEPT_LOG_GLOW] @ mean
    return float(variance**-0.5)


def _limb(
    sight: GlowSight, found: GlowStep, keep: np.ndarray, air: Air, nadir_base: np.ndarray
) -> GlowLimb:
    """What the last step found of kept stretches (M,)."""
    normal_px, rows = sight.normal_px[keep], sight.rows[keep]
    beforehand = air.beforehand()[0][KEPT]
    faint = _glow_over_error(sight.along[keep], found.cov) < _LEAST_GLOW
    air = replace(air.changed(found.change), faint=faint)
    value = np.zeros(len(KEPT))
    value[KEPT_BLUR], value[KEPT_LOG_GLOW] = air.psf_px, air.log_glow
    return GlowLimb(
        px=sight.px[keep] + (sight.factor * (rows @ found.change[LIMB]))[:, None] * normal_px,
        normal_px=normal_px,
        rows=rows,
        along=sight.along[keep],
        factor=sight.factor,
        stretch_px=sight.stretch_px,
        curve=sight.curve,
        nadir_base=nadir_base,
        air=air,
        length_px=air.height / median(sight.rise[keep]),
        value=value,
        cov=found.cov,
        beforehand=beforehand,
        ripple=found.ripple,
        glaring=bool(sight.glare.any()),
        overexposed=float(sight.blind[keep].any(axis=1).mean()),
        drowned=_drowned(sight, air, keep),
    )


def _drowned(sight: GlowSight, air: Air, keep: np.ndarray) -> float:
    """`GlowLimb.drowned` of kept stretches (M,)."""
    blind = sight.blind[keep]
    if not blind.any():
        return 0.0
    white = max(median(sight.profiles[keep][blind]) - air.background, sight.noise)
    over_white = powers(sight.along[keep]) @ air.log_glow - math.log(white)
    near = np.clip(over_white - _DIM, 0.0, _DROWNED - _DIM)
    return float((near * blind.any(axis=1)).mean())
