"""Limb points under glowing air, of all cameras together, and what these are off by together."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from horizon_sensor_ros.core.fits.observation import LimbObservation
from horizon_sensor_ros.core.limb.air import BLUR_SIGMA_PX, LIMB, SHARE_SIGMA, USUAL_SHARE
from horizon_sensor_ros.core.limb.glow.brightness import powers
from horizon_sensor_ros.core.limb.glow.limb import GlowLimb
from horizon_sensor_ros.core.limb.glow.one_sky import Together, under_one_sky
from horizon_sensor_ros.core.limb_points import (
    BEND_OF_STRETCHES,
    MEAN_OF_STRETCHES,
    SLOPE_OF_STRETCHES,
    LimbPoints,
    SharedError,
)
from horizon_sensor_ros.core.mathematics.attitude import tangent_basis
from horizon_sensor_ros.core.status import Status

# No model is quite right: errors of the limb's mean, slope and bend beside the truth of simulated
# limbs, in sigmas that the fit claims, by what they grow with.
_MISJUDGED = np.array(
    [
        [0.7, 0.86, 0.5],  # even glow
        [8.0, 13.0, 8.0],  # amplitude of the logarithm of A around nadir, all along the limb
        [0.9, 0.5, 1.6],  # logarithm of what the lens fades
        [0.2, 0.4, 1.1],  # fading towards the terminator
        [0.8, 1.1, 1.3],  # ripple
        [2.4, 0.4, 0.4],  # blur off the edges' one, in sigmas of what is known of it
        [4.4, 1.0, 1.0],  # share of the air in front of the ground below the usual one, likewise
        [0.1, 0.1, 0.8],  # glare
        [4.0, 1.5, 5.0],  # saturated ground nearly all along
        [5.0, 8.0, 5.0],  # step of the logarithm of A from frame to frame
    ]
)
# From where on they grow, and from where on no more.
_EVEN = 0.03  # amplitude of the logarithm of A; up to here glow is as good as even
_UNEVEN = 0.15  # likewise, beyond which it matters no more
# Step of the logarithm of A between frames: where it is large, A is no polynomial along limbs.
_STEP, _LARGEST_STEP = 0.3, 0.7
_MOST_BLURRED = 2.0  # blur off the edges' one, sigmas
_LEAST_SHARE = 0.5  # share of the air below the usual one, sigmas
_OVEREXPOSED = 0.85  # share of the limb beside saturated ground, from where on it matters
# Ripple of glow along the limb, as under flickering light through which rows are exposed one after
# the other, as of `GlowStep`.
_RIPPLE = 0.4  # five of six even limbs show less
_MOST_RIPPLE = 1.0  # that is counted, beyond that
# All of these also grow with a power of the length of glow, where that is longer than one length,
# and fall with one where it is shorter than another: of mean, slope, bend.
_FINE_PX = 2.5
_FINER = np.array([0.0, 0.2, 0.1])
_THIN_PX = 1.0
_THINNER = np.array([0.0, 0.7, 0.55])
# However exact the fit claims to be: errors of mean, slope and bend over the length of glow.
_OF_LENGTH = np.array([0.001, 0.006, 0.012])
# Where glow saturates together with the ground the limb is told by the law by which it fades alone:
# how much higher, over the length of glow, all limbs of simulated frames come out by that, and what
# each is off by besides.
_OF_DROWNED = np.array([0.5, 0.15])
_POINT_SHARE = 0.5  # sigma of a point by itself, over what would explain all of the limb's


@dataclass(frozen=True, eq=False)
class GlowPoints(LimbPoints):
    """Points of a limb under glowing air. alone : what its frame says by itself."""

    alone: GlowLimb | None = None

    @property
    def twilit(self) -> bool:
        """Whether the glow fades towards the terminator."""
        return self.alone is not None and self.alone.air.twilit


def points_alone(limb: GlowLimb) -> GlowPoints:
    """Points of a limb as its own frame's fit has them.

    Where it was expected is not known here: without `LimbPoints.offset_px`.
    """
    as_fitted = Together(np.zeros((1, 3)), np.linalg.cholesky(limb.cov[LIMB, LIMB]), 0.0)
    return GlowPoints(Status.OK, **_points(limb, as_fitted, 0), predicted=limb.curve, alone=limb)


def told_together(seen: Sequence[LimbObservation]) -> tuple[LimbObservation, ...]:
    """Return limbs of simultaneous frames, those under glowing air by what all tell of it."""
    glowing = [
        (i, one.limb, one.limb.alone)
        for i, one in enumerate(seen)
        if isinstance(one.limb, GlowPoints) and one.limb.alone is not None
    ]
    out = list(seen)
    if glowing:
        views = [seen[i].view for i, _, _ in glowing]
        together = under_one_sky(views, [alone for _, _, alone in glowing])
        for place, (i, limb, alone) in enumerate(glowing):
            points = replace(limb, **_points(alone, together, place))
            out[i] = LimbObservation(seen[i].view, points)
    return tuple(out)


def _points(limb: GlowLimb, together: Together, index: int) -> dict[str, Any]:
    """Fields of `LimbPoints` of one limb, whose place among those told together is given."""
    change, errors = together.change[index], together.errors[3 * index : 3 * (index + 1)]
    factor, rows = limb.factor, limb.rows
    to_shape = np.linalg.pinv(powers(limb.along)) @ rows
    of_shape = np.linalg.inv(to_shape)
    # Of each column of errors, all of them independent; then this limb's own, and one of all.
    common = of_shape @ (_misjudged(limb, together)[:, None] * (to_shape @ errors))
    higher, besides = limb.length_px * limb.drowned * _OF_DROWNED
    own = np.zeros((3, errors.shape[1]))
    of_length = limb.length_px * _OF_LENGTH
    of_length[0] = math.hypot(of_length[0], besides)
    own[:, 3 * index : 3 * index + 3] = of_shape * of_length
    # The same in all frames: as a change of rho, which no other camera's takes back.
    height = np.array([[0.0], [0.0], [higher / rows[:, 2].mean()]])
    errors = np.concatenate([common, own, height], axis=1)
    shape = np.linalg.norm(to_shape @ errors, axis=1)
    coherent = float(max(shape[1] / SLOPE_OF_STRETCHES, shape[2] / BEND_OF_STRETCHES))
    mean = rows.mean(axis=0) @ errors
    shift2 = float(mean @ mean) - (MEAN_OF_STRETCHES * coherent) ** 2
    each = rows @ errors
    sigma = math.sqrt(float(np.einsum("ij,ij->", each, each)) / 3.0)
    to_cone = np.zeros((4, 3))
    to_cone[:3, :2], to_cone[3, 2] = tangent_basis(limb.nadir_base), 1.0
    return {
        "px": limb.px + (factor * (rows @ change))[:, None] * limb.normal_px,
        "normal_px": limb.normal_px,
        "sigma_px": np.full(len(rows), _POINT_SHARE * sigma * factor),
        "shared": SharedError(coherent, math.sqrt(max(shift2, 0.0))).times(factor),
        "spacing_px": limb.stretch_px * factor,
        "cone_errors": to_cone @ errors,
    }


def _misjudged(limb: GlowLimb, together: Together) -> np.ndarray:
    """Errors (3,) of a limb's mean, slope and bend, in sigmas of its fit."""
    air, by_day = limb.air, not limb.air.twilit
    amplitude = min(max(together.amplitude, _EVEN), _UNEVEN)
    step = min(max(together.step, _STEP), _LARGEST_STEP)
    blur_off = abs(air.psf_px - air.edge_psf_px) / BLUR_SIGMA_PX
    grown = np.array(
        [
            1.0,
            (amplitude - _EVEN) * by_day,
            air.fading,
            float(air.twilit),
            min(max(limb.ripple - _RIPPLE, 0.0), _MOST_RIPPLE),
            min(blur_off, _MOST_BLURRED),
            min(max((USUAL_SHARE - air.share) / SHARE_SIGMA, 0.0), _LEAST_SHARE),
            float(limb.glaring),
            max(limb.overexposed - _OVEREXPOSED, 0.0) / (1.0 - _OVEREXPOSED),
            (step - _STEP) * by_day,
        ]
    )
    finer = max(1.0, limb.length_px / _FINE_PX) ** _FINER
    finer *= min(1.0, limb.length_px / _THIN_PX) ** _THINNER
    return finer * np.asarray(np.linalg.norm(_MISJUDGED * grown[:, None], axis=0))
