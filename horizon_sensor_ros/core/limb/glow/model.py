"""What a limb under glowing air shows, its unknowns, and one step towards them.

See `glow_limb` for the model. Unknowns, in this order: the limb (3, as `GlowSight.rows` has them),
the background, the blur, the logarithm of A (3, a polynomial along the limb), that of the scale
height, and the share of the air that lies in front of the ground.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from horizon_sensor_ros.core.limb.edge.model import normal_cdf
from horizon_sensor_ros.core.limb.glow.air_profile import air_inside, glow_outside
from horizon_sensor_ros.core.limb.glow.sight import GlowSight
from horizon_sensor_ros.core.limb.texture.ground_texture import rough_correlation, seen_across
from horizon_sensor_ros.core.robust import median

_LIMB, _BLUR, _LOGS, _SHARE = slice(3), 4, slice(5, 9), 9
_NUM = 10
# Up to where, beyond the edge, there may be texture: pixels, and blurs.
_TEXTURE_PX, _TEXTURE_PSF = 3.0, 3.0
_BESIDE_PX = (-2.0, -1.0)  # where the planet beside the edge is seen
# What is known beforehand, one sigma each: the scale height over the radius (of its logarithm), the
# change of the blur in a step, the air in front of the ground over that above it; slope and bend of
# the logarithm of A from the middle of the limb to its ends, the bend also as a share of the slope;
# levels, over the brightest, of all stretches and of each.
USUAL_HEIGHT, _HEIGHT_SIGMA = 8.5e3 / 6371e3, 0.3
_BLUR_SIGMA_PX = 0.1
USUAL_SHARE, _SHARE_SIGMA = 0.5, 0.4
_SLOPE_SIGMA, _BEND_SIGMA, _BEND_OF_SLOPE = 1.0, 0.05, 0.4
_COMMON_LEVEL, _OWN_LEVEL = 1.0, 0.15
_GLOW_ERROR, _SHAPE_ERROR = 0.01, 0.003  # over the glow, over the step: no model is quite right
# Error of saturated samples, and of those beside them, over the brightest level.
_BLIND, _CLIPPED = 1e3, 0.02
BLURS_PX = 0.35, 1.7
_MOST_CHANGE = 0.3  # of logarithms, in a step
_AGAIN = 2  # derivatives by what the step before takes the ground to be
_SMALL_PX, _SMALL = 0.02, 0.01  # differences that stand for derivatives


def powers(along: np.ndarray) -> np.ndarray:
    """Rows (M, 3) of the polynomial of log A at places along the limb."""
    return np.stack([np.ones_like(along), along, along * along], axis=1)


@dataclass(frozen=True)
class Air:
    """What is common to a limb: scale height over the radius, log A (3,), share of the air in front
    of the ground, blur, background.
    """

    height: float
    log_glow: np.ndarray
    share: float
    psf_px: float
    background: float

    def changed(self, change: np.ndarray) -> Air:
        """The same after a step (10,)."""
        logs = np.clip(change[_LOGS], -_MOST_CHANGE, _MOST_CHANGE)
        return replace(
            self,
            background=self.background + float(change[3]),
            psf_px=float(np.clip(self.psf_px + change[_BLUR], *BLURS_PX)),
            log_glow=self.log_glow + logs[:3],
            height=self.height * math.exp(logs[3]),
            share=self.share + float(change[_SHARE]),
        )

    def beforehand(self) -> tuple[np.ndarray, np.ndarray]:
        """Information (10,) of what is known beforehand, and its pull (10,) from these values."""
        bend = math.hypot(_BEND_SIGMA, _BEND_OF_SLOPE * self.log_glow[1])
        sigma = np.full(_NUM, np.inf)
        sigma[_BLUR] = _BLUR_SIGMA_PX
        sigma[6:] = _SLOPE_SIGMA, bend, _HEIGHT_SIGMA, _SHARE_SIGMA
        away = np.zeros(_NUM)
        away[6:8] = -self.log_glow[1:]
        away[8] = math.log(USUAL_HEIGHT / self.height)
        away[_SHARE] = USUAL_SHARE - self.share
        information = sigma**-2.0
        return information, information * away


@dataclass(frozen=True)
class GlowStep:
    """Change (10,) of the unknowns and covariance (3, 3) of the limb's; strength of the texture.
    cost : (M,) of the stretches, over the degrees of freedom; infinite of those left out.
    """

    change: np.ndarray
    cov: np.ndarray
    strength: float
    cost: np.ndarray


class _Lit:
    """What the air and the ground's mean brightness make of the profiles of kept stretches (K)."""

    def __init__(self, sight: GlowSight, air: Air, keep: np.ndarray) -> None:
        d_px, psf_px = sight.d_px, air.psf_px
        distance = sight.distance[keep]
        length_px = air.height / sight.rise[keep]
        power = powers(sight.along)[keep]
        glow = np.exp(power @ air.log_glow)[:, None]
        above = glow_outside(distance, psf_px, length_px)
        inside = glow * air_inside(d_px, psf_px, median(length_px))
        self.edge = normal_cdf(-d_px / psf_px)
        self.fall = np.exp(-0.5 * np.square(d_px / psf_px)) / (np.sqrt(2.0 * np.pi) * psf_px)
        self.rest = sight.profiles[keep] - air.background - glow * above - air.share * inside
        beside = (d_px >= _BESIDE_PX[0]) & (d_px <= _BESIDE_PX[1])
        self.level = self.rest[:, beside].mean(axis=1, keepdims=True) / self.edge[beside].mean()
        self.bright = float(np.percentile(sight.profiles[keep], 95)) - air.background
        rising = glow_outside(distance - _SMALL_PX, psf_px, length_px)
        rising -= glow_outside(distance + _SMALL_PX, psf_px, length_px)
        self.glow_moving = glow * rising / (2.0 * _SMALL_PX)
        wider = glow_outside(distance, (1.0 + _SMALL) * psf_px, length_px) - above
        self.glow_wider = glow * wider / (_SMALL * psf_px)
        longer = glow_outside(distance, psf_px, (1.0 + _SMALL) * length_px) - above
        self.rows = sight.rows[keep]
        self.design = np.empty((*self.rest.shape, _NUM))
        self.design[..., 3] = 1.0
        self.design[..., 5:8] = (glow * above)[..., None] * power[:, None]
        self.design[..., 8] = glow * longer / _SMALL
        self.design[..., _SHARE] = inside
        widening = (self.level - glow) * self.fall * (d_px / psf_px)
        self.derive(self.level * self.fall + self.glow_moving, widening)
        self.variance = sight.noise**2 + np.square(_GLOW_ERROR * glow * above)
        self.variance += np.square(_SHAPE_ERROR * self.level)
        blind = sight.blind[keep]
        beside_blind = np.zeros_like(blind)
        beside_blind[:, 1:] = blind[:, :-1]
        self.variance[beside_blind] += (_CLIPPED * self.bright) ** 2
        self.variance[blind] = (_BLIND * self.bright) ** 2

    def derive(self, moving: np.ndarray, widening: np.ndarray) -> None:
        """Set the profiles' derivatives (K, J) by an edge that moves out, and by the blur."""
        self.design[..., _LIMB] = moving[:, :, None] * self.rows[:, None]
        self.design[..., _BLUR] = widening


class _Ground:
    """The ground's brightness as it is seen near the limb, a Gaussian field: a level of its own for
    each of K stretches, and texture; in the inner samples (J), in rows of a stretch each.
    """

    def __init__(self, sight: GlowSight, lit: _Lit, keep: np.ndarray, psf_px: float) -> None:
        self.inner = sight.d_px <= max(_TEXTURE_PX, math.ceil(_TEXTURE_PSF * psf_px))
        d_px = sight.d_px[self.inner]
        self.edge, self.fall = lit.edge[self.inner], lit.fall[self.inner]
        self.widening = self.fall * (d_px / psf_px)
        self.across, self._moved, self._widened = seen_across(d_px, psf_px, sight.px_over_radius)
        along = np.flatnonzero(keep) * (sight.stretch_px * sight.px_over_radius)
        self._likeness = rough_correlation(along[:, None] - along)
        num = len(along)
        self.levels = lit.bright**2 * (_OWN_LEVEL**2 * np.eye(num) + _COMMON_LEVEL**2)
        self._plain = np.kron(self.levels, np.outer(self.edge, self.edge))
        self.variance = lit.variance[:, self.inner]
        self._plain.flat[:: len(self._plain) + 1] += self.variance.ravel()
        self._texture = np.kron(self._likeness, self.across)

    def covariance(self, strength: float) -> np.ndarray:
        """Of all inner samples (K J, K J), with their noise."""
        return np.asarray(self._plain + strength**2 * self._texture)

    def derivatives(self, weights: np.ndarray, strength: float) -> tuple[np.ndarray, np.ndarray]:
        """How the likeliest ground moves with the limb, and widens with the blur (K, J).

        weights : (K, J) residuals over their covariance.
        """
        level = (self.levels @ (weights @ self.edge))[:, None]
        textured = strength**2 * (self._likeness @ weights)
        return (
            level * self.fall + textured @ self._moved.T,
            level * self.widening + textured @ self._widened.T,
        )

    def volume(self, precise: np.ndarray, strength: float) -> tuple[np.ndarray, float]:
        """Half of how the covariance's log determinant grows, by each edge (K,) and by the blur.

        precise : inverse of the covariance.
        """
        num, count = self.variance.shape
        by_row = precise.reshape(num, count, num, count)
        level = np.einsum("iajb,ij,b->ia", by_row, self.levels, self.edge, optimize=True)
        texture = np.einsum("iajb,ij->iab", by_row, self._likeness, optimize=True)
        texture *= strength**2
        edges = level @ self.fall + np.einsum("iab,ab->i", texture, self._moved)
        blur = (level @ self.widening).sum() + np.einsum("iab,ab->", texture, self._widened)
        return edges, float(blur)

    def own(self, strength: float) -> np.ndarray:
        """Covariance (K, J, J) of each stretch by itself."""
        alike = strength**2 * self.across + self.levels[0, 0] * np.outer(self.edge, self.edge)
        return np.asarray(alike + np.eye(len(self.edge)) * self.variance[:, None])


def step_towards(
    sight: GlowSight, air: Air, keep: np.ndarray, strength: float | None, shares: np.ndarray
) -> GlowStep:
    """One step of Gauss and Newton for all unknowns, from kept stretches (M,).

    strength : of the texture; None: the likeliest of shares (S,) of the levels' scatter.
    """
    lit = _Lit(sight, air, keep)
    ground = _Ground(sight, lit, keep, air.psf_px)
    inner = ground.inner
    seen = lit.rest[:, inner].ravel()
    prior, pull = air.beforehand()

    def near() -> np.ndarray:
        return np.asarray(lit.design[:, inner].reshape(len(seen), _NUM))

    def beyond() -> tuple[np.ndarray, np.ndarray]:
        """Information, and its pull: beyond the texture every sample stands for itself."""
        far = lit.design[:, ~inner].reshape(-1, _NUM)
        weighted = far / lit.variance[:, ~inner].reshape(-1, 1)
        information = weighted.T @ far + np.diag(prior)
        return information, weighted.T @ lit.rest[:, ~inner].ravel() + pull

    if strength is None:
        scatter = max(float(np.std(lit.level)), 0.02 * lit.bright)
        costs = [_cost(ground.covariance(s), near(), seen, beyond()) for s in shares * scatter]
        strength = float(shares[int(np.argmin(costs))]) * scatter
    precise = np.linalg.inv(ground.covariance(strength))
    information, towards = beyond()
    back = near().T @ precise
    change = np.linalg.solve(information + back @ near(), towards + back @ seen)
    edges, blur = ground.volume(precise, strength)
    pull[_LIMB] -= edges @ lit.rows
    pull[_BLUR] -= blur
    for _ in range(_AGAIN):
        weights = (precise @ (seen - near() @ change)).reshape(len(lit.rest), -1)
        moving, widening = lit.glow_moving.copy(), lit.glow_wider.copy()
        by_limb, by_blur = ground.derivatives(weights, strength)
        moving[:, inner] += by_limb
        widening[:, inner] += by_blur
        lit.derive(moving, widening)
        information, towards = beyond()
        back = near().T @ precise
        information += back @ near()
        change = np.linalg.solve(information, towards + back @ seen)
    left = lit.rest - lit.design @ change
    solved = np.linalg.solve(ground.own(strength), left[:, inner, None])[..., 0]
    cost = np.full(len(sight), np.inf)
    cost[keep] = (left[:, inner] * solved).sum(axis=1)
    cost[keep] += (np.square(left[:, ~inner]) / lit.variance[:, ~inner]).sum(axis=1)
    cost /= left.shape[1] - 2.0
    return GlowStep(change, np.linalg.inv(information)[_LIMB, _LIMB], strength, cost)


def _cost(
    covariance: np.ndarray,
    design: np.ndarray,
    seen: np.ndarray,
    beyond: tuple[np.ndarray, np.ndarray],
) -> float:
    """Twice the negative logarithm of the restricted likelihood, but for what is common to all."""
    lower = np.linalg.cholesky(covariance)
    white = np.linalg.solve(lower, np.column_stack([design, seen]))
    information = beyond[0] + white[:, :-1].T @ white[:, :-1]
    towards = beyond[1] + white[:, :-1].T @ white[:, -1]
    explained = towards @ np.linalg.solve(information, towards)
    volume = 2.0 * np.log(np.diag(lower)).sum() + np.linalg.slogdet(information)[1]
    return float(white[:, -1] @ white[:, -1] - explained + volume)
