"""What the brightness across a limb looks like, and where such an edge most likely lies.

Along the normal, position d (pixels, outwards), the model of one profile with the edge at e is

    I(d) = background + level * (F(e - d) + glow * G(d - e)) + texture(d) + noise

F is a step blurred by the point-spread function (normal law, sigma `psf_px`); G is air glow: an
exponential outside the edge, blurred alike, whose height is a share `glow` (0 to 1) of the level
just inside; texture is whatever cloud and ground do inside: a Gaussian process with the covariance
of surface detail seen at grazing incidence, blurred alike. Background and level are free for every
profile. For each e on a grid the profile likelihood (restricted, so that the free amplitudes cost
what they should) is one matrix product; the table of matrices depends on the shape alone and is
kept. Texture beside the limb thereby widens the answer instead of moving it, and glow that is
strong over dark ground and weak over bright cloud does not bend the limb.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from horizon_sensor_ros.core.limb.profiles import EdgePlaces, ProfileGrid

# The kinds of profile that are considered: texture inside, over the level; glow outside, over it.
SHARP_KINDS = tuple((texture, 0.0) for texture in (0.0, 0.08, 0.25, 0.8))
GLOW_KINDS = tuple((texture, glow) for texture in (0.06, 0.25) for glow in (0.25, 0.6, 1.0))
PSF_LADDER_PX = (0.42, 0.5, 0.6, 0.75, 0.9, 1.1, 1.4, 1.8, 2.4, 3.2)
GLOW_LADDER_PX = (1.0, 1.6, 2.5, 4.0, 6.3, 10.0)
_TEXTURE_ROOT_LENGTH = 1.5  # correlation length of texture, in the root of the depth in pixels
_MOST_EVIDENCE = 8.0  # of one profile, for one look over another
_LOOK_PROFILES = 48  # profiles that decide on the look
MAX_LEVEL = 256.0  # brightness over noise beyond which more says nothing
_FINE_PX = 0.1  # grid on which the texture's covariance is blurred
_SHAPE_ERROR = 0.004  # what interpolation and a not quite normal blur add, over the level
_GLOW_ERROR = 0.03  # the same with glow, which is never quite exponential


@dataclass(frozen=True)
class EdgeTable:
    """Precomputed likelihood of the edge's place, for profiles in units of their noise.

    residual (E, J, J): whitened residual projectors, the cost of place e is ``|residual[e] @ I|^2
    + log_det[e]``. step (E, J): the step's estimate is ``step[e] @ I``.
    """

    e_px: np.ndarray
    residual: np.ndarray
    log_det: np.ndarray
    step: np.ndarray


def normal_cdf(x: np.ndarray) -> np.ndarray:
    """Standard normal distribution function, to the last digits of its tails too."""
    # Not scipy.special: loading it takes a node as long as all its other libraries together.
    flat = (np.asarray(x, dtype=float) * -math.sqrt(0.5)).ravel().tolist()
    return 0.5 * np.array([math.erfc(value) for value in flat]).reshape(np.shape(x))


@dataclass(frozen=True)
class EdgeLook:
    """What the edge looks like in one image.

    psf_px : its blur, one sigma. glow_px : length over which air glow fades by e; 0 without glow.
    """

    psf_px: float
    glow_px: float

    def neighbours(self) -> tuple[EdgeLook, ...]:
        """Looks one step of their ladders away: blur, and where there is glow its length."""
        psf = [EdgeLook(value, self.glow_px) for value in _beside(PSF_LADDER_PX, self.psf_px)]
        if self.glow_px == 0:
            return tuple(psf)
        glow = [EdgeLook(self.psf_px, value) for value in _beside(GLOW_LADDER_PX, self.glow_px)]
        return tuple(psf + glow)

    @property
    def kinds(self) -> tuple[tuple[float, float], ...]:
        """(texture, glow) of the profiles to consider."""
        return GLOW_KINDS if self.glow_px > 0 else SHARP_KINDS


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


def texture_covariance(x_px: np.ndarray, psf_px: float) -> np.ndarray:
    """Covariance of unit surface texture at signed distances x_px from the limb (planet: x < 0),
    blurred; (K, K).

    Ground distance grows with the square root of the depth below the limb, so detail of one size
    is squeezed together towards the edge: an exponential covariance in the root of the depth.
    """
    # Counted from the limb inwards: the texture begins at the limb, wherever the samples lie.
    fine = -_FINE_PX * (np.arange(np.ceil((3.0 * psf_px - min(x_px[0], 0.0)) / _FINE_PX)) + 0.5)
    root = np.sqrt(-fine)
    covariance = np.exp(-np.abs(np.subtract.outer(root, root)) / _TEXTURE_ROOT_LENGTH)
    blur = np.exp(-0.5 * ((x_px[:, None] - fine) / psf_px) ** 2)
    blur *= _FINE_PX / (np.sqrt(2.0 * np.pi) * psf_px)
    return blur @ covariance @ blur.T


@lru_cache(maxsize=2048)
def edge_table(
    look: EdgeLook, kind: tuple[float, float], level: float, grid: ProfileGrid
) -> EdgeTable:
    """Likelihood table for one kind of profile.

    kind : (texture, glow). level : brightness just inside the limb, over the noise.
    """
    d_px, e_px, num = grid.d_px, grid.e_px, grid.num
    # All that depends on d - e alone is computed once over the differences that occur.
    stride = round(1.0 / grid.grid_px)
    x_px = d_px[0] - e_px[-1] + grid.grid_px * np.arange(stride * (num - 1) + len(e_px))
    texture, glow = kind
    profile = edge_profile(x_px, look, glow)
    relative = texture**2 * texture_covariance(x_px, look.psf_px) if texture > 0 else 0.0
    relative = relative + np.diag(((_GLOW_ERROR if glow else _SHAPE_ERROR) * profile) ** 2)
    relative = level**2 * relative
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


def place_edges(
    profiles: np.ndarray, noise: float, look: EdgeLook, grid: ProfileGrid
) -> EdgePlaces:
    """Maximum-likelihood place of the edge in each profile.

    profiles : (N, J) gray levels sampled at ``grid.d_px``. noise : one-sigma pixel noise, gray
    levels. How strong the texture is differs from profile to profile and is not known: the
    likelihood is averaged over the look's kinds, so that a clean profile speaks loudly and one
    beside a cloud's border softly.
    """
    scaled = (profiles * (1.0 / noise)).astype(np.float32)
    height = scaled.max(axis=1) - np.median(scaled[:, -3:], axis=1)
    # Where noise is next to nothing the model's own error takes its place.
    excess = np.maximum(height / MAX_LEVEL, 1.0)
    scaled /= excess[:, None]
    octave = np.rint(np.log2(np.clip(height / excess, 4.0, MAX_LEVEL)))
    places = np.empty((len(look.kinds), 6, len(profiles)))
    for value in np.unique(octave):
        rows = np.flatnonzero(octave == value)
        for i, kind in enumerate(look.kinds):
            table = edge_table(look, kind, float(2.0**value), grid)
            places[i][:, rows] = _place(scaled[rows], table)
    offset, sigma, step, chi2, cost, at_border = places.transpose(1, 0, 2)
    # How common each kind of profile is in this image, from the image itself
    # (expectation-maximisation).
    evidence = sigma * np.exp(-0.5 * (cost - cost.min(axis=0)))
    share = np.full(len(look.kinds), 1.0 / len(look.kinds))
    for _ in range(4):
        weight = share[:, None] * evidence
        weight /= weight.sum(axis=0)
        share = weight.mean(axis=1)
    mean = (weight * offset).sum(axis=0)
    variance = (weight * (sigma**2 + (offset - mean) ** 2)).sum(axis=0)
    height = (weight * step).sum(axis=0) * excess
    return EdgePlaces(
        mean,
        np.sqrt(variance),
        height * noise,
        height,
        (weight * chi2).sum(axis=0) / (profiles.shape[1] - 3),
        (weight * at_border).sum(axis=0) > 0.5,
        np.log((share[:, None] * evidence).sum(axis=0)) - 0.5 * cost.min(axis=0),
    )


def _place(scaled: np.ndarray, table: EdgeTable) -> np.ndarray:
    """Place, sigma, step over noise, chi-square, cost and at-border of each profile, for one kind
    of texture.
    """
    num_places, num_samples = len(table.e_px), scaled.shape[1]
    stacked = scaled @ table.residual.reshape(-1, num_samples).T
    stacked = stacked.reshape(len(scaled), num_places, num_samples)
    chi2 = np.einsum("nej,nej->ne", stacked, stacked).astype(np.float64)
    steps = scaled @ table.step.T
    # The planet is the bright side: an edge that rises outwards is no limb.
    cost = np.where(steps > 0, chi2 + table.log_det, 1e9)
    best = np.argmin(cost, axis=1)
    inner = np.clip(best, 1, num_places - 2)
    rows = np.arange(len(scaled))
    before, centre, after = cost[rows, inner - 1], cost[rows, inner], cost[rows, inner + 1]
    grid = table.e_px[1] - table.e_px[0]
    curvature = np.maximum(before - 2.0 * centre + after, 1e-9)
    slope = 0.5 * (after - before)
    shift = np.clip(-slope / curvature, -1.0, 1.0)
    drop = slope * shift + 0.5 * curvature * shift**2
    return np.stack(
        [
            table.e_px[inner] + shift * grid,
            grid * np.sqrt(2.0 / curvature),
            steps[rows, inner].astype(np.float64),
            chi2[rows, inner] + drop,
            centre + drop,
            (best == 0) | (best == num_places - 1),
        ]
    )


def likeliest_look(
    profiles: np.ndarray, noise: float, guesses: Sequence[EdgeLook], grid: ProfileGrid
) -> EdgeLook:
    """Climb from the best of some guesses to the likeliest look of the profiles (N, J).

    No profile counts for more than `_MOST_EVIDENCE`: one across a boom fits no look at all.
    """
    few = profiles[:: max(1, len(profiles) // _LOOK_PROFILES)]

    def evidence(look: EdgeLook) -> np.ndarray:
        return place_edges(few, noise, look, grid).log_evidence

    first = evidence(guesses[0])

    def merit(look: EdgeLook) -> float:
        gain = evidence(look) - first
        return float(np.clip(gain, -_MOST_EVIDENCE, _MOST_EVIDENCE).sum())

    tried = {guess: merit(guess) for guess in guesses}
    while True:
        look = max(tried, key=lambda key: tried[key])
        fresh = [other for other in look.neighbours() if other not in tried]
        if not fresh:
            return look
        tried.update({other: merit(other) for other in fresh})
