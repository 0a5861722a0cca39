"""What the brightness across a limb looks like, and where such an edge most likely lies.

Along the normal, position d (pixels, outwards), the model of one profile with the edge at e is

    I(d) = background + level * (F(e - d) + glow * G(d - e)) + texture(d) + noise

F is a step blurred by the point-spread function (normal law, sigma `psf_px`); G is air glow: an
exponential outside the edge, blurred alike, whose height is a share `glow` (0 to 1) of the level
just inside; texture is whatever cloud and ground do inside: a Gaussian process with the covariance
of surface detail seen at grazing incidence, blurred alike; its strength and roughness are those
that make the image's profiles most likely. Background and level are free for every
profile. For each e on a grid the profile likelihood (restricted, so that the free amplitudes cost
what they should) is one matrix product; the table of matrices depends on the shape alone and is
kept. Texture beside the limb thereby widens the answer instead of moving it, and glow that is
strong over dark ground and weak over bright cloud does not bend the limb.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from horizon_sensor_ros.core.limb.glow.air import Air
from horizon_sensor_ros.core.limb.profiles import EdgePlaces, ProfileGrid, space_level


@dataclass(frozen=True)
class Texture:
    """What the surface adds to the brightness just inside the limb.

    amplitude : over that brightness. rough : it jumps, as at borders of clouds, instead of having
    gradients.
    """

    amplitude: float
    rough: bool = False


# What is considered: texture of the surface, one for all profiles of an image; height of the air's
# glow over the brightness just inside the limb, for every profile its own.
SHARP_TEXTURES = (
    *(Texture(amplitude) for amplitude in (0.0, 0.03, 0.1, 0.4)),
    *(Texture(amplitude, rough=True) for amplitude in (0.1, 0.3, 0.9)),
)
GLOW_TEXTURES = tuple(Texture(amplitude, rough=True) for amplitude in (0.06, 0.25))
GLOW_SHARES = (0.25, 0.6, 1.0)
_FINE_PSF_LADDER_PX = tuple(float(psf) for psf in np.round(0.42 * 1.06 ** np.arange(37), 3))
PSF_LADDER_PX = _FINE_PSF_LADDER_PX[::3]
GLOW_LADDER_PX = (1.0, 1.6, 2.5, 4.0, 6.3, 10.0)
# Correlation length of texture, in the root of the depth in pixels.
_SMOOTH_ROOT_LENGTH, _ROUGH_ROOT_LENGTH = 3.0, 1.5
_MOST_EVIDENCE = 8.0  # of one profile, for one look over another
_LOOK_PROFILES = 48  # profiles that decide on the look
MAX_LEVEL = 512.0  # brightness over noise beyond which more says nothing
_FINE_PX = 0.1  # grid on which the texture's covariance is blurred
_SHAPE_ERROR = 0.003  # what interpolation and a not quite normal blur add, over the level
_RULED_OUT = 1e9  # cost of a place where the edge would rise outwards
_NEWTON_STEPS = 3
_GLOW_ERROR = 0.03  # the same with glow, which is never quite exponential


@dataclass(frozen=True)
class EdgeTable:
    """Precomputed likelihood of the edge's place, for profiles in units of their noise.

    Several of them stacked have one more axis, in front.

    residual (E, J, J): whitened residual projectors, the cost of place e is ``|residual[e] @ I|^2
    + log_det[e]``. step (E, J): the step's estimate is ``step[e] @ I``.
    """

    e_px: np.ndarray
    residual: np.ndarray
    log_det: np.ndarray
    step: np.ndarray

    def looked_up(self, profiles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Squares of residuals, and steps, of profiles (N, J), for every place: (N, ..., E)."""
        num = profiles.shape[1]
        shape = len(profiles), *self.log_det.shape
        stacked = (profiles @ self.residual.reshape(-1, num).T).reshape(-1, num)
        squares = np.einsum("ij,ij->i", stacked, stacked).reshape(shape)
        return squares, (profiles @ self.step.reshape(-1, num).T).reshape(shape)


def normal_cdf(x: np.ndarray) -> np.ndarray:
    """Standard normal distribution function, to the last digits of its tails too."""
    # Not scipy.special: loading it takes a node as long as all its other libraries together.
    flat = (np.asarray(x, dtype=float) * -math.sqrt(0.5)).ravel().tolist()
    return 0.5 * np.array([math.erfc(value) for value in flat]).reshape(np.shape(x))


@dataclass(frozen=True)
class EdgeLook:
    """What the edge looks like in one image.

    psf_px : its blur, one sigma. glow_px : length over which air glow fades by e; 0 without glow.
    air : that glows, as it was last found, together with the limb; looks are alike without it.
    """

    psf_px: float
    glow_px: float
    air: Air | None = field(default=None, compare=False)

    def neighbours(self) -> tuple[EdgeLook, ...]:
        """Looks one step of their ladders away: blur, and where there is glow its length."""
        beside = _beside(_FINE_PSF_LADDER_PX, self.psf_px)
        psf = [EdgeLook(value, self.glow_px) for value in beside]
        if self.glow_px == 0:
            return tuple(psf)
        glow = [EdgeLook(self.psf_px, value) for value in _beside(GLOW_LADDER_PX, self.glow_px)]
        return tuple(psf + glow)

    @property
    def textures(self) -> tuple[Texture, ...]:
        """Textures to consider."""
        return GLOW_TEXTURES if self.glow_px > 0 else SHARP_TEXTURES

    @property
    def glows(self) -> tuple[float, ...]:
        """Heights of glow to consider in every profile."""
        return GLOW_SHARES if self.glow_px > 0 else (0.0,)


def _beside(ladder: tuple[float, ...], value: float) -> list[float]:
    index = int(np.argmin(np.abs(np.log(np.array(ladder) / value))))
    return [ladder[i] for i in (index - 1, index + 1) if 0 <= i < len(ladder)]


def edge_profile(x_px: np.ndarray, look: EdgeLook, glow: float) -> np.ndarray:
    """Brightness (K,) at signed distances from the edge, for level one and no background."""
    x = x_px / look.psf_px
    profile = normal_cdf(-x)
    if glow > 0:
        k = look.psf_px / look.glow_px
        # exp(-d / L) for d > 0, convolved with the normal law.
        tail = np.exp(np.minimum(0.5 * k * k - k * x, 50.0)) * normal_cdf(x - k)
        profile = profile + glow * tail
    return profile


def texture_covariance(x_px: np.ndarray, psf_px: float, rough: bool) -> np.ndarray:
    """Covariance of unit surface texture at signed distances x_px from the limb (planet: x < 0),
    blurred; (K, K).

    Ground distance grows with the square root of the depth below the limb, so detail of one size
    is squeezed together towards the edge: the covariance is one in the root of the depth,
    exponential where texture is rough and Matern's once differentiable one where it is smooth.
    """
    # Counted from the limb inwards: the texture begins at the limb, wherever the samples lie.
    fine = -_FINE_PX * (np.arange(np.ceil((4.0 * psf_px - min(x_px[0], 0.0)) / _FINE_PX)) + 0.5)
    root = np.sqrt(-fine)
    apart = np.abs(np.subtract.outer(root, root))
    if rough:
        covariance = np.exp(-apart / _ROUGH_ROOT_LENGTH)
    else:
        apart *= np.sqrt(3.0) / _SMOOTH_ROOT_LENGTH
        covariance = (1.0 + apart) * np.exp(-apart)
    blur = np.exp(-0.5 * ((x_px[:, None] - fine) / psf_px) ** 2)
    blur *= _FINE_PX / (np.sqrt(2.0 * np.pi) * psf_px)
    return blur @ covariance @ blur.T


@lru_cache(maxsize=16)
def _differences(psf_px: float, grid: ProfileGrid) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """All differences (K,) of sample and edge that occur in a grid, and the covariances of unit
    texture there, smooth and rough.
    """
    stride = round(1.0 / grid.grid_px)
    first = grid.d_px[0] - grid.e_px[-1]
    x_px = first + grid.grid_px * np.arange(stride * (grid.num - 1) + len(grid.e_px))
    smooth, rough = (texture_covariance(x_px, psf_px, rough) for rough in (False, True))
    return x_px, smooth, rough


def edge_table(
    look: EdgeLook, texture: Texture, glow: float, level: float, grid: ProfileGrid
) -> EdgeTable:
    """Likelihood table for one texture and one height of glow.

    level : brightness just inside the limb, over the noise.
    """
    e_px, num = grid.e_px, grid.num
    stride = round(1.0 / grid.grid_px)
    x_px, smooth, rough = _differences(look.psf_px, grid)
    profile = edge_profile(x_px, look, glow)
    relative = np.diag(((_GLOW_ERROR if glow else _SHAPE_ERROR) * profile) ** 2)
    if texture.amplitude > 0:
        relative += texture.amplitude**2 * (rough if texture.rough else smooth)
    relative *= level**2
    basis = np.stack([np.ones_like(x_px), profile], axis=1)
    taken = (len(e_px) - 1 - np.arange(len(e_px)))[:, None] + stride * np.arange(num)
    lower = np.linalg.cholesky(relative[taken[:, :, None], taken[:, None, :]] + np.eye(num))
    whiten = np.linalg.inv(lower)
    q, r = np.linalg.qr(whiten @ basis[taken])
    projected = np.swapaxes(q, 1, 2) @ whiten
    step = np.linalg.solve(r, projected)[:, 1]
    diagonals = np.diagonal(lower, axis1=1, axis2=2), np.diagonal(r, axis1=1, axis2=2)
    log_det = sum(2.0 * np.log(np.abs(diagonal)).sum(axis=1) for diagonal in diagonals)
    return EdgeTable(
        e_px,
        (whiten - q @ projected).astype(np.float32),
        np.asarray(log_det),
        step.astype(np.float32),
    )


@lru_cache(maxsize=128)
def _tables(look: EdgeLook, level: float, grid: ProfileGrid) -> EdgeTable:
    """Return the tables of all the look's textures and glows, one after the other (K, E, ...)."""
    tables = [
        edge_table(look, texture, glow, level, grid)
        for texture in look.textures
        for glow in look.glows
    ]
    return EdgeTable(
        grid.e_px,
        np.stack([table.residual for table in tables]),
        np.stack([table.log_det for table in tables]),
        np.stack([table.step for table in tables]),
    )


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
    scaled = (profiles * (1.0 / noise)).astype(np.float32)
    height = scaled.max(axis=1) - space_level(scaled)
    # Where noise is next to nothing the model's own error takes its place.
    excess = np.maximum(height / MAX_LEVEL, 1.0)
    scaled /= excess[:, None]
    octave = np.rint(np.log2(np.minimum(np.maximum(height / excess, 4.0), MAX_LEVEL)))
    count = len(profiles)
    shape = count, len(look.textures) * len(look.glows), len(grid.e_px)
    chi2, cost, steps = (np.empty(shape, dtype=np.float32) for _ in range(3))
    octaves = set(octave.tolist())
    for value in octaves:
        rows = slice(None) if len(octaves) == 1 else np.flatnonzero(octave == value)
        table = _tables(look, float(2.0**value), grid)
        chi2[rows], steps[rows] = table.looked_up(scaled[rows])
        cost[rows] = chi2[rows] + table.log_det
    # The planet is the bright side: an edge that rises outwards is no limb.
    cost[steps <= 0] = _RULED_OUT
    lowest = _lowest(cost.reshape(-1, shape[-1]), grid)
    shape = count, len(look.textures), len(look.glows)
    log_evidence = (np.log(lowest.sigma_px) - 0.5 * lowest.cost).reshape(shape)
    best = log_evidence.max(axis=2)
    weight = np.exp(log_evidence - best[..., None])
    total = weight.sum(axis=2)
    by_texture = best + np.log(total)
    likeliest = by_texture.max(axis=1, keepdims=True)
    merit = np.maximum(by_texture - likeliest, -_MOST_EVIDENCE).sum(axis=0)
    share = np.exp(merit - merit.max())
    weight *= (share / (share.sum() * total))[..., None]
    weight = weight.reshape(count, -1)

    def mean(values: np.ndarray) -> np.ndarray:
        return np.einsum("ij,ij->i", weight, values.reshape(count, -1))

    offset = lowest.offset_px.reshape(count, -1)
    middle = mean(offset)
    spread = lowest.sigma_px.reshape(count, -1) ** 2 + (offset - middle[:, None]) ** 2
    height = mean(steps.ravel()[lowest.index]) * excess
    return EdgePlaces(
        middle,
        np.sqrt(mean(spread)),
        height * noise,
        height,
        mean(chi2.ravel()[lowest.index] + lowest.drop) / (profiles.shape[1] - 3),
        mean(lowest.at_border) > 0.5,
        by_texture[:, np.argmax(merit)],
    )


@dataclass(frozen=True)
class _Lowest:
    """Minima of M curves of costs: place, sigma, cost, its depth below the grid's least value, and
    whether that one is at an end; index : of the grid's value, or its neighbour, in the costs.
    """

    offset_px: np.ndarray
    sigma_px: np.ndarray
    cost: np.ndarray
    drop: np.ndarray
    at_border: np.ndarray
    index: np.ndarray


def _lowest(cost: np.ndarray, grid: ProfileGrid) -> _Lowest:
    """Minima of costs (M, E) at the grid's places."""
    last = cost.shape[1] - 1
    best = cost.argmin(axis=1)
    inner = np.minimum(np.maximum(best, 2), last - 2)
    index = inner + np.arange(0, cost.size, last + 1)
    near = cost.ravel()[index[:, None] + np.arange(-2, 3)].astype(np.float64)
    shift, drop, curvature = _minimum(near)
    return _Lowest(
        grid.grid_px * (inner - last // 2 + shift),
        grid.grid_px * np.sqrt(2.0 / curvature),
        near[:, 2] + drop,
        drop,
        (best == 0) | (best == last),
        index,
    )


# From five equidistant values to the polynomial through them, about the middle one: coefficients of
# the first to the fourth power; to the slope and half the curvature of the parabola through three.
_QUARTIC = np.array(
    [
        [2.0, -1.0, -2.0, 1.0, 0.0, 0.0],
        [-16.0, 16.0, 4.0, -4.0, -12.0, 12.0],
        [0.0, -30.0, 0.0, 6.0, 0.0, -24.0],
        [16.0, 16.0, -4.0, -4.0, 12.0, 12.0],
        [-2.0, -1.0, 2.0, 1.0, 0.0, 0.0],
    ]
) / (24.0, 24.0, 24.0, 24.0, 24.0, 24.0)


def _minimum(cost: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Minimum of the quartics through five equidistant values (N, 5), the middle one the least.

    Returns its distance from the middle, in steps, its depth below the middle, and the second
    derivative there. A parabola through three is off by a part of a step, whatever the noise.
    """
    out = cost > 0.5 * _RULED_OUT
    if out.any():
        cost = _without(cost, out)
    first, second, third, fourth, slope, bend = (cost @ _QUARTIC).T
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
    """Values (N, 5) with those that are out, which say nothing, replaced: by the one mirrored about
    the middle, or by those of the parabola through the three in the middle.
    """
    left2, left, middle, right, right2 = cost.T
    left, right = np.where(out[:, 1], right, left), np.where(out[:, 3], left, right)
    far = out[:, 0] | out[:, 4]
    even, odd = 2.0 * (left + right) - 3.0 * middle, right - left
    left2, right2 = np.where(far, even - odd, left2), np.where(far, even + odd, right2)
    return np.stack([left2, left, middle, right, right2], axis=1)


def likeliest_look(
    profiles: np.ndarray,
    noise: float,
    guesses: Sequence[EdgeLook],
    grid: ProfileGrid,
    *,
    climb: bool = True,
) -> EdgeLook:
    """Climb from the best of some guesses to the likeliest look of the profiles (N, J); or, not to
    climb, stay with the guess.

    No profile counts for more than `_MOST_EVIDENCE`: one across a boom fits no look at all.
    """
    if len(guesses) == 1:
        return guesses[0]
    few = profiles[:: max(1, len(profiles) // _LOOK_PROFILES)]

    def evidence(look: EdgeLook) -> np.ndarray:
        return place_edges(few, noise, look, grid).log_evidence

    tried = {guess: evidence(guess) for guess in guesses}
    while True:
        highest = np.max(list(tried.values()), axis=0)
        merits = {
            look: float(np.maximum(found - highest, -_MOST_EVIDENCE).sum())
            for look, found in tried.items()
        }
        look = max(merits, key=lambda key: merits[key])
        if not climb:
            return look
        fresh = [other for other in look.neighbours() if other not in tried]
        if not fresh:
            return _between(look, merits)
        tried.update({other: evidence(other) for other in fresh})


def _between(look: EdgeLook, merits: dict[EdgeLook, float]) -> EdgeLook:
    """Likeliest blur between a look and its neighbours on the ladder, to one percent of a pixel:
    the vertex of the parabola through their merits.
    """
    beside = [EdgeLook(psf, look.glow_px) for psf in _beside(_FINE_PSF_LADDER_PX, look.psf_px)]
    if len(beside) < 2:
        return look
    below, at, above = (merits[other] for other in (beside[0], look, beside[1]))
    curvature = below - 2.0 * at + above
    if curvature >= 0.0:
        return look
    shift = np.clip(0.5 * (below - above) / curvature, -0.5, 0.5)
    psf = look.psf_px * (beside[1].psf_px / look.psf_px) ** shift
    return EdgeLook(float(np.round(psf, 2)), look.glow_px)
