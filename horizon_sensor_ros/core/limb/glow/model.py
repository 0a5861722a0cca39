"""What a limb under glowing air shows, its unknowns, and one step towards them.

See `glow.fit` for the model. The unknowns are the limb's three, as `GlowSight.rows` has them, and
those of `glow.air`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from horizon_sensor_ros.core.limb.air import (
    BACKGROUND,
    BLUR,
    FADING,
    KEPT,
    LIMB,
    LOG_GLOW,
    LOG_HEIGHT,
    NUM,
    SHARE,
    STRAY,
    Air,
)
from horizon_sensor_ros.core.limb.edge.model import SHAPE_ERROR
from horizon_sensor_ros.core.limb.edge.near_edge import BESIDE_PX
from horizon_sensor_ros.core.limb.glow.air_profile import air_inside, glow_outside
from horizon_sensor_ros.core.limb.glow.brightness import further_powers, powers
from horizon_sensor_ros.core.limb.glow.fading import with_either_lens
from horizon_sensor_ros.core.limb.glow.ground import Ground
from horizon_sensor_ros.core.limb.glow.sight import GlowSight
from horizon_sensor_ros.core.limb.glow.twilight import darker_end, lit_shares
from horizon_sensor_ros.core.mathematics.normal_law import normal_cdf
from horizon_sensor_ros.core.mathematics.robust import median, quantile

# Up to where, beyond the edge, there may be texture: pixels, and blurs.
_TEXTURE_PX, _TEXTURE_PSF = 3.0, 3.0
_GLOW_ERROR = 0.01  # over the glow: no model is quite right
_BRIGHT = 0.95  # share of the samples that are darker than the brightest level
# Error of saturated samples, and of those beside them, over the brightest level.
_BLIND, _CLIPPED = 1e3, 0.02
# Strengths of texture that are tried, over the scatter of the levels, and the least of that, over
# the brightest level.
_STRENGTH_STEP = 2.0
_STRENGTHS = _STRENGTH_STEP ** np.arange(-2.0, 2.0)
_LEAST_SCATTER = 0.02
# Ground in the dark, over the brightest: by day clouds leave .15 and more at the ends of 255
# simulated limbs.
_NIGHT = 0.12
_FAINT_GLOW = 0.5  # likewise, below which glow does not show by itself where it darkens
_AGAIN = 2  # derivatives by what the step before takes the ground to be


@dataclass(frozen=True, eq=False)
class GlowStep:
    """Change (P,) of the unknowns and covariance (7, 7) of `KEPT` ones. cost : (M,) of the
    stretches, over the degrees of freedom; infinite of those left out. ripple : how far the glow of
    neighbouring stretches is off the model alike; about 0, one sigma 1, where each is by itself.
    """

    change: np.ndarray
    cov: np.ndarray
    cost: np.ndarray
    ripple: float


class _Lit:
    """What the air makes of the profiles of kept stretches (K), and what is left of them.

    glow (K, J) : of the air beyond the limb. rest (K, J) : without the air. design (K, J, P) :
    derivatives by the unknowns. level (K,) : of the ground beside the edge. variance, doubt
    (K, J) : of noise and model, and of blind samples.
    """

    def __init__(self, sight: GlowSight, air: Air, keep: np.ndarray) -> None:
        d_px, psf_px = sight.d_px, air.psf_px
        length_px = air.height / sight.rise[keep]
        power = powers(sight.along)[keep]
        further = further_powers(sight.along, len(air.further))[keep]
        log_glow = power @ air.log_glow + further @ air.further
        glow = np.exp(log_glow - air.fading * sight.cornered[keep])[:, None]
        above = glow_outside(sight.distance[keep], psf_px, length_px)
        self.glow = bright = glow * above.bright
        inside = air_inside(d_px, psf_px, median(length_px))
        stray = np.empty((*bright.shape, 2))
        stray[..., 0] = sight.along[keep, None]
        stray[..., 1] = np.maximum(d_px, 0.0)
        sky = air.background + stray @ air.stray
        air_light = bright + air.share * glow * inside.bright
        self.rest = sight.profiles[keep] - sky - air_light
        beside = (d_px >= BESIDE_PX[0]) & (d_px <= BESIDE_PX[1])
        self.level = self.rest[:, beside].mean(axis=1)
        self.level /= normal_cdf(-d_px[beside] / psf_px).mean()
        bright_level = quantile(sight.profiles[keep].ravel(), _BRIGHT) - air.background
        self.bright = max(bright_level, sight.noise)
        self.rows = sight.rows[keep]
        self._moving = -glow * (above.by_place + air.share * inside.by_place)
        self._widening = glow * (above.by_blur + air.share * inside.by_blur)
        self.num = NUM + len(air.further)
        self.design = np.empty((*self.rest.shape, self.num))
        self.design[..., LIMB] = self._moving[..., None] * self.rows[:, None]
        self.design[..., BACKGROUND] = 1.0
        self.design[..., BLUR] = self._widening
        self.design[..., LOG_GLOW] = air_light[..., None] * power[:, None]
        self.design[..., LOG_HEIGHT] = glow * (above.by_length + air.share * inside.by_length)
        self.design[..., SHARE] = glow * inside.bright
        self.design[..., STRAY] = stray
        self.design[..., NUM:] = air_light[..., None] * further[:, None]
        self.design[..., FADING] = -air_light * sight.cornered[keep, None]
        self.variance = sight.noise**2 + np.square(_GLOW_ERROR * bright)
        self.variance += sight.glare_variance[keep]
        self.doubt = np.zeros_like(self.rest)
        blind = sight.blind[keep]
        if blind.any():
            self.doubt[:, 1:][blind[:, :-1]] = (_CLIPPED * self.bright) ** 2
            self.doubt[blind] = (_BLIND * self.bright) ** 2

    def derive(self, moving: np.ndarray, widening: np.ndarray) -> None:
        """Set the derivatives of the innermost samples, with those (K, J) of the ground there by an
        edge that moves out, and by the blur.
        """
        near = slice(moving.shape[1])
        moving = self._moving[:, near] + moving
        self.design[:, near, LIMB] = moving[..., None] * self.rows[:, None]
        self.design[:, near, BLUR] = self._widening[:, near] + widening


class _Normal:
    """Normal equations of the unknowns (P) and of what else is unknown of the ground (E).

    near : (K, J, P + E + 1) derivatives by all of them and residuals, along the ground's axes.
    known : (P + E, P + E) and pull : (P + E,) what is known besides.
    """

    def __init__(self, near: np.ndarray, known: np.ndarray, pull: np.ndarray) -> None:
        self.near, self.known, self.pull = near, known, pull

    def solved(self, precision: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Solutions (S, P + E), their information, and what they leave of the cost (S,), for
        precisions (S, K, J).
        """
        flat = self.near.reshape(-1, self.near.shape[2])
        squares = flat.T @ (precision.reshape(len(precision), -1, 1) * flat)
        information = squares[:, :-1, :-1] + self.known
        towards = squares[:, :-1, -1] + self.pull
        found = np.linalg.solve(information, towards[..., None])[..., 0]
        return found, information, squares[:, -1, -1] - np.einsum("sp,sp->s", towards, found)

    def likelihood(self, precision: np.ndarray) -> np.ndarray:
        """Twice the negative logarithms of the restricted likelihoods (S,), but for what is common
        to all.
        """
        _, information, cost = self.solved(precision)
        cost -= np.log(precision).sum(axis=(1, 2))
        return np.asarray(cost + np.linalg.slogdet(information)[1])

    def left(self, found: np.ndarray) -> np.ndarray:
        """Residuals (K, J) of a solution."""
        return np.asarray(self.near[..., -1] - self.near[..., :-1] @ found)


def step_towards(sight: GlowSight, air: Air, keep: np.ndarray) -> GlowStep:
    """One step of Gauss and Newton for all unknowns, from kept stretches (M,)."""
    lit = _Lit(sight, air, keep)
    d_px, psf_px = sight.d_px, air.psf_px
    num = int(np.count_nonzero(d_px <= max(_TEXTURE_PX, math.ceil(_TEXTURE_PSF * psf_px))))
    level = lit.level[:, None]
    lit.variance += np.square(SHAPE_ERROR * level)
    ground = Ground(
        d_px[:num],
        psf_px,
        sight.px_over_radius,
        sight.stretch_px,
        keep,
        lit.bright,
        lit.variance[:, :num].mean(axis=0),
        lit.doubt[:, :num],
        lit_shares(sight.along[keep], level[:, 0]) if air.twilit else None,
    )
    moving, widening = level * ground.fall, level * ground.widening
    lit.derive(moving, widening)
    near = ground.in_axes(np.concatenate([lit.design[:, :num], lit.rest[:, :num, None]], axis=2))
    near = np.concatenate([near[..., :-1], ground.extra, near[..., -1:]], axis=2)
    normal = _Normal(near, *_known(lit, air, ground, num))
    scatter = max(float(np.std(ground.evenly_lit(level[:, 0]))), _LEAST_SCATTER * lit.bright)
    tried = normal.likelihood(ground.precision(scatter * _STRENGTHS))
    strength = scatter * _STRENGTHS[0] * _STRENGTH_STEP ** _lowest(tried)
    precision = ground.precision(np.array([strength]))
    found, information, _ = normal.solved(precision)
    edges, blur = ground.volume(precision[0], strength)
    normal.pull[LIMB] -= edges @ lit.rows
    normal.pull[BLUR] -= blur
    for _ in range(_AGAIN):
        lit.derive(*ground.derivatives(precision[0] * normal.left(found[0]), strength))
        normal.near[..., : BLUR + 1] = ground.in_axes(lit.design[:, :num, : BLUR + 1])
        found, information, _ = normal.solved(precision)
    step, cov = with_either_lens(found[0], np.linalg.inv(information[0]), FADING, air.fading)
    change = step[: lit.num]
    left = lit.rest - lit.design @ change
    cost = np.full(len(sight), np.inf)
    cost[keep] = ground.cost(left[:, :num], strength)
    far, weight = left[:, num:], 1.0 / (lit.variance + lit.doubt)[:, num:]
    cost[keep] += (weight * far * far).sum(axis=1)
    cost /= left.shape[1] - 2.0
    ripple = _ripple(far, weight, lit.glow[:, num:])
    return GlowStep(change, cov[KEPT[:, None], KEPT], cost, ripple)


def ends_unseen(sight: GlowSight, air: Air) -> bool:
    """Whether the ground along a limb ends in the dark, below a glow that is too faint to show that
    it darkens there as well.
    """
    level = _Lit(sight, air, np.ones(len(sight), dtype=bool)).level
    darker, brightest = darker_end(level)
    return darker < _NIGHT * brightest and math.exp(air.log_glow[0]) < _FAINT_GLOW * brightest


def _ripple(left: np.ndarray, weight: np.ndarray, glow: np.ndarray) -> float:
    """`GlowStep.ripple` of what is left (K, J) where there is nothing but glow; with the weights of
    the samples, and their glow.
    """
    of_glow = weight * glow
    off = (of_glow * left).sum(axis=1)
    off /= np.sqrt((of_glow * glow).sum(axis=1)) + np.finfo(float).tiny
    return float(off[1:] @ off[:-1]) / math.sqrt(len(off))


def _known(lit: _Lit, air: Air, ground: Ground, num: int) -> tuple[np.ndarray, np.ndarray]:
    """What is known of the unknowns beforehand, and beyond the texture, where every sample stands
    for itself: `_Normal.known` and `_Normal.pull`.

    num : of the samples that texture reaches.
    """
    far = lit.design[:, num:].reshape(-1, lit.num)
    weighted = far / (lit.variance + lit.doubt)[:, num:].reshape(-1, 1)
    prior, towards = air.beforehand()
    known = np.diag(np.concatenate([prior, ground.extra_prior]))
    known[: lit.num, : lit.num] += weighted.T @ far
    pull = np.zeros(len(known))
    pull[: lit.num] = towards + weighted.T @ lit.rest[:, num:].ravel()
    return known, pull


def _lowest(costs: np.ndarray) -> float:
    """Place of the lowest of equidistant costs, by the parabola through it and its neighbours."""
    at = int(np.argmin(costs))
    middle = min(max(at, 1), len(costs) - 2)
    before, here, after = costs[middle - 1 : middle + 2].tolist()
    bend = before - 2.0 * here + after
    if at != middle or not bend > 0.0:
        return float(at)
    return middle + 0.5 * (before - after) / bend
