"""The limb that a fit of one frame separates from the glow above it, and what that fit says."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from horizon_sensor_ros.core.limb.air import KEPT, KEPT_BLUR, KEPT_LOG_GLOW, LIMB, USUAL_HEIGHT, Air
from horizon_sensor_ros.core.limb.glow.brightness import powers
from horizon_sensor_ros.core.limb.glow.model import GlowStep
from horizon_sensor_ros.core.limb.glow.sight import GlowSight
from horizon_sensor_ros.core.limb_curve import LimbCurve
from horizon_sensor_ros.core.mathematics.robust import median

# Logarithm of the glow's brightness over white from where on saturated samples hide the limb below
# it, and from where on no more of it is hidden.
_DIM, _DROWNED = -1.0, 0.2
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


def limb_of(
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


def _glow_over_error(along: np.ndarray, cov: np.ndarray) -> float:
    """Glow above stretches at places (M,) along the limb, over its own error. cov : (7, 7), of the
    `KEPT` unknowns.
    """
    mean = powers(along).mean(axis=0)
    variance = mean @ cov[KEPT_LOG_GLOW[:, None], KEPT_LOG_GLOW] @ mean
    return float(variance**-0.5)


def _drowned(sight: GlowSight, air: Air, keep: np.ndarray) -> float:
    """`GlowLimb.drowned` of kept stretches (M,)."""
    blind = sight.blind[keep]
    if not blind.any():
        return 0.0
    white = max(median(sight.profiles[keep][blind]) - air.background, sight.noise)
    over_white = powers(sight.along[keep]) @ air.log_glow - math.log(white)
    near = np.clip(over_white - _DIM, 0.0, _DROWNED - _DIM)
    return float((near * blind.any(axis=1)).mean())
