"""Where in each profile an edge of a known look most likely lies, and how likely a look is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from horizon_sensor_ros.core.limb.edge.model import MAX_LEVEL, EdgeLook, edge_tables
from horizon_sensor_ros.core.limb.profiles import EdgePlaces, ProfileGrid, space_level

_MOST_EVIDENCE = 8.0  # of one profile, for one texture over another
_RULED_OUT = 1e9  # cost of a place where the edge would rise outwards
_NEWTON_STEPS = 2


def place_edges(
    profiles: np.ndarray, noise: float, look: EdgeLook, grid: ProfileGrid
) -> EdgePlaces:
    """Maximum-likelihood place of the edge in each profile.

    profiles : (N, J) gray levels sampled at ``grid.d_px``. noise : one-sigma pixel noise, gray
    levels. Which texture the image has is not known: the answers are averaged by how likely each
    makes all profiles together. A single profile cannot tell: one beside a strip of dark ground
    that is narrower than the blur looks like a clean one with its edge further in. How high the
    glow is differs from profile to profile, and is averaged over in each.
    """
    scaled = _Scaled.of(profiles, noise)
    costs = _Costs.of(scaled, (look,), grid)
    lowest = costs.lowest(grid)
    evidence = lowest.evidence
    by_texture, merit = _by_texture(evidence)
    share = np.exp(merit - merit.max(axis=1, keepdims=True))
    share /= share.sum(axis=1, keepdims=True)
    weight = np.exp(evidence - by_texture[..., None])
    weight *= share[..., None]
    weight = weight.reshape(len(profiles), -1)

    def mean(values: np.ndarray) -> np.ndarray:
        return np.einsum("ij,ij->i", weight, values.reshape(weight.shape))

    offset = lowest.offset_px.reshape(weight.shape)
    middle = mean(offset)
    spread = np.square(lowest.sigma_px.reshape(weight.shape)) + np.square(offset - middle[:, None])
    height = mean(costs.steps.ravel()[lowest.index]) * scaled.excess
    return EdgePlaces(
        middle,
        np.sqrt(mean(spread)),
        height * noise,
        height,
        mean(costs.chi2.ravel()[lowest.index] + lowest.drop) / (profiles.shape[1] - 3),
        mean(lowest.at_border) > 0.5,
    )


def look_evidence(
    profiles: np.ndarray, noise: float, looks: Sequence[EdgeLook], grid: ProfileGrid
) -> np.ndarray:
    """Logarithm (L, N) of how likely each of some looks, all with glow or all without, makes each
    profile (N, J), with the texture that it makes likeliest of all.
    """
    costs = _Costs.of(_Scaled.of(profiles, noise), looks, grid)
    by_texture, merit = _by_texture(costs.lowest(grid).evidence)
    chosen = merit.argmax(axis=1)
    return by_texture[:, np.arange(len(looks)), chosen].T


def _by_texture(evidence: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Evidence (N, L, T, G) of each texture and glow in each profile, summed over what the glow may
    be (N, L, T); and each texture's (L, T) in all profiles together.
    """
    best = evidence.max(axis=3)
    by_texture = best + np.log(np.exp(evidence - best[..., None]).sum(axis=3))
    behind = by_texture - by_texture.max(axis=2, keepdims=True)
    return by_texture, np.maximum(behind, -_MOST_EVIDENCE).sum(axis=0)


@dataclass(frozen=True, eq=False)
class _Scaled:
    """Profiles (N, J) in units of their noise.

    excess : (N,) by how much more they were divided: where noise is next to nothing the model's own
    error takes its place. level : (N,) brightness over the noise, to an octave.
    """

    profiles: np.ndarray
    excess: np.ndarray
    level: np.ndarray

    @classmethod
    def of(cls, profiles: np.ndarray, noise: float) -> _Scaled:
        """Profiles (N, J) of one sigma of noise, in gray levels."""
        scaled = (profiles * (1.0 / noise)).astype(np.float32)
        height = scaled.max(axis=1) - space_level(scaled)
        excess = np.maximum(height * (1.0 / MAX_LEVEL), 1.0)
        scaled /= excess[:, None]
        level = np.exp2(np.rint(np.log2(np.minimum(np.maximum(height / excess, 4.0), MAX_LEVEL))))
        return cls(scaled, excess, level)

    def rows(self) -> list[tuple[float, slice | np.ndarray]]:
        """Each level, and which of the profiles have it."""
        levels = set(self.level.tolist())
        if len(levels) == 1:
            return [(levels.pop(), slice(None))]
        return [(level, np.flatnonzero(self.level == level)) for level in levels]


@dataclass(frozen=True, eq=False)
class _Costs:
    """Squares of residuals, costs and steps (N, L, T, G, E) of profiles: for some looks, their
    textures and glows, and every place of the edge.
    """

    chi2: np.ndarray
    cost: np.ndarray
    steps: np.ndarray

    @classmethod
    def of(cls, scaled: _Scaled, looks: Sequence[EdgeLook], grid: ProfileGrid) -> _Costs:
        """What the tables of looks say, all with glow or all without."""
        textures, glows = len(looks[0].textures), len(looks[0].glows)
        places = 2 * round(grid.reach_px / grid.grid_px) + 1
        shape = len(scaled.profiles), len(looks), textures * glows, places
        chi2, cost, steps = (np.empty(shape, dtype=np.float32) for _ in range(3))
        for level, rows in scaled.rows():
            profiles = scaled.profiles[rows]
            for i, look in enumerate(looks):
                table = edge_tables(look, level, grid)
                chi2[rows, i], steps[rows, i] = squares, _ = table.looked_up(profiles)
                cost[rows, i] = squares + table.log_det
        # The planet is the bright side: an edge that rises outwards is no limb.
        np.copyto(cost, _RULED_OUT, where=steps <= 0)
        by_kind = *shape[:2], textures, glows, places
        return cls(chi2.reshape(by_kind), cost.reshape(by_kind), steps.reshape(by_kind))

    def lowest(self, grid: ProfileGrid) -> _Lowest:
        """Minima of the costs at the grid's places."""
        last = self.cost.shape[-1] - 1
        cost = self.cost.reshape(-1, last + 1)
        best = cost.argmin(axis=1)
        inner = np.minimum(np.maximum(best, 2), last - 2)
        index = inner + np.arange(0, cost.size, last + 1)
        near = cost.ravel().take(index + _FIVE).astype(np.float64)
        shift, drop, curvature = _minimum(near)
        shape = self.cost.shape[:-1]
        return _Lowest(
            (grid.grid_px * (inner - last // 2 + shift)).reshape(shape),
            (grid.grid_px * np.sqrt(2.0 / curvature)).reshape(shape),
            (near[2] + drop).reshape(shape),
            drop.reshape(shape),
            ((best == 0) | (best == last)).reshape(shape),
            index.reshape(shape),
        )


_FIVE = np.arange(-2, 3)[:, None]


@dataclass(frozen=True, eq=False)
class _Lowest:
    """Minima of curves of costs: place, sigma, cost, its depth below the grid's least value, and
    whether that one is at an end; index : of the grid's value, or its neighbour, in the costs.
    """

    offset_px: np.ndarray
    sigma_px: np.ndarray
    cost: np.ndarray
    drop: np.ndarray
    at_border: np.ndarray
    index: np.ndarray

    @property
    def evidence(self) -> np.ndarray:
        """Logarithm of the likelihood, over all places."""
        return np.log(self.sigma_px) - 0.5 * self.cost


# From five equidistant values to the polynomial through them, about the middle one: coefficients of
# the first to the fourth power; to the slope and half the curvature of the parabola through three.
_QUARTIC = (
    np.array(
        [
            [2.0, -16.0, 0.0, 16.0, -2.0],
            [-1.0, 16.0, -30.0, 16.0, -1.0],
            [-2.0, 4.0, 0.0, -4.0, 2.0],
            [1.0, -4.0, 6.0, -4.0, 1.0],
            [0.0, -12.0, 0.0, 12.0, 0.0],
            [0.0, 12.0, -24.0, 12.0, 0.0],
        ]
    )
    / 24.0
)


def _minimum(cost: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Minimum of the quartics through five equidistant values (5, N), the middle one the least.

    Returns its distance from the middle, in steps, its depth below the middle, and the second
    derivative there. A parabola through three is off by a part of a step, whatever the noise.
    """
    out = cost > 0.5 * _RULED_OUT
    if out.any():
        cost = _without(cost, out)
    first, second, third, fourth, slope, bend = _QUARTIC @ cost
    bend = np.maximum(bend, 0.5e-9)
    shift = np.minimum(np.maximum(-0.5 * slope / bend, -1.0), 1.0)
    for _ in range(_NEWTON_STEPS):
        falls = first + shift * (2.0 * second + shift * (3.0 * third + shift * (4.0 * fourth)))
        curvature = 2.0 * second + shift * (6.0 * third + shift * (12.0 * fourth))
        curvature = np.where(curvature > 0.4 * bend, curvature, 2.0 * bend)
        shift = np.minimum(np.maximum(shift - falls / curvature, -1.0), 1.0)
    drop = shift * (first + shift * (second + shift * (third + shift * fourth)))
    return shift, np.minimum(drop, 0.0), curvature


def _without(cost: np.ndarray, out: np.ndarray) -> np.ndarray:
    """Values (5, N) with those that are out, which say nothing, replaced: by the one mirrored about
    the middle, or by those of the parabola through the three in the middle.
    """
    left2, left, middle, right, right2 = cost
    left, right = np.where(out[1], right, left), np.where(out[3], left, right)
    far = out[0] | out[4]
    even, odd = 2.0 * (left + right) - 3.0 * middle, right - left
    left2, right2 = np.where(far, even - odd, left2), np.where(far, even + odd, right2)
    return np.stack([left2, left, middle, right, right2])
