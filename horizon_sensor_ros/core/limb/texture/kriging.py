"""The edge's place beside cloud and ground, whose strength is not the same all along the limb.

Stretches of limb are taken together with their neighbours: the brightness inside is

    I_i(d) = background + level F(d) + e_i step_i F'(d) + a_i T_i(d) + noise

to first order in the edge's distance e_i from a predicted place; T is a Gaussian process over the
ground, seen at grazing incidence: a pixel across the limb spans many times the ground that one
along it does. Solved for e_i with level and background free, this is kriging. The texture's kind,
rough as cloud edges or smooth, and its strength a_i are those that make the stretch and those
nearby most likely, once the edges are on one limb: an edge that texture has moved off it counts as
textured, which its own profile cannot tell.
Source: derived here; for Gaussian processes with unknown means see Rasmussen & Williams 2006, 2.7.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from horizon_sensor_ros.core.limb.edge.model import MAX_LEVEL, normal_cdf
from horizon_sensor_ros.core.limb.edge.near_edge import BESIDE_PX
from horizon_sensor_ros.core.limb.edge.raster import PLACE_SIGMA_PX, Raster
from horizon_sensor_ros.core.limb.edge.smear import Blur, Causes, blur_along
from horizon_sensor_ros.core.limb.profiles import nearness
from horizon_sensor_ros.core.limb.texture import ground_texture
from horizon_sensor_ros.core.limb.texture.depth import seen_depths
from horizon_sensor_ros.core.limb.texture.fitted_limb import limb_in_raster
from horizon_sensor_ros.core.limb_points import CornerBlur, SharedError
from horizon_sensor_ros.core.mathematics.robust import median

# The part of a profile that is used, pixels from the predicted edge into the planet and into space.
INNER_PX = 6.0
OUTER_PX = 7.0
_SPACE_PX = 2.5  # from where on space is
_WINDOW = 0.03  # over the planet's radius; along so much limb the texture is the same
_LEAST_WINDOW = 0.7  # stretches
_ANYWHERE = 0.1  # what a stretch elsewhere says about the texture, over what a near one does
_MOST_EVIDENCE = 8.0  # of one stretch, for one texture over another
_MOST_OF_ODD = 40.0  # the same, of one whose edge texture has made odd
_LEVEL_SIGMA = 30.0  # over the noise; of a stretch's brightness about that of three
_NO_TEXTURE = 5.0  # log odds beforehand of a limb without texture, to any one texture
_LAG = 0.06  # over the planet's radius; brightness is compared along so much limb
_STEP_VARIANCE = 0.5  # over that of a pixel of a profile: two of them are beside the edge
# What neighbours share of texture's variance, over what its covariance says: as measured, of rough
# texture and of smooth.
_SHARED = ground_texture.by_kind(0.75, 2.4)
# Rough texture that changes brightness by nearly as much as there is of it moves all of a limb by
# more than to first order: as measured.
_BY_CONTRAST = 5.0  # growth of that move with the contrast: deviation of brightness over its median
_MOST_CONTRAST = 0.7  # from where on it grows no more
# Of brightness's deviation along the limb over the noise: no ground follows the textures' law more
# finely. With less noise errors stay, as measured down to .4 DN, what they are with 2 DN.
_MOST_TEXTURE = 64.0
_PARTS = 6  # of the limb, between which nothing is shared
_SCALES_PER_OCTAVE = 2.0  # tables are made for such steps of the ground's scale
_PHASE_WEIGHT = 3.0  # by which a stretch's phase in the raster takes from what it says of texture
_SHAPE_ERROR = 0.003  # over the step; no edge is quite the model's


@dataclass(frozen=True, eq=False)
class Stretches:
    """Mean profiles of successive stretches of limb, sampled about predicted places of the edge.

    profiles : (N, J) gray levels at d_px (J,), whole pixels outwards. noise : one sigma of each.
    psf_px : the edge's blur. length_px : of limb. px_over_radius : ground across one pixel at the
    limb, along it, over the planet's radius. base : (N, 3) how the edge moves along the normals
    with the limb's three unknowns. cornered : (N,) squares of the distances to the optical axis,
    over half the frame's diagonal. blur_open_px : one sigma of what the blur may differ by along
    the limb. corner_px : as of `Causes`.
    """

    profiles: np.ndarray
    d_px: np.ndarray
    noise: float
    psf_px: float
    length_px: float
    px_over_radius: float
    base: np.ndarray
    cornered: np.ndarray
    blur_open_px: float = 0.0
    corner_px: float | None = None


@dataclass(frozen=True, eq=False)
class _Tables:
    """What solves profiles of J samples, over their noise, for each of S textures.

    Two unknowns of an edge are solved for: e, its distance from the predicted place, and w, by
    which its blur is wider than expected, both in pixels and times the step over the noise.
    weights : (3 J, 2 S) by which a profile between its two neighbours is multiplied for e (first S
    columns) and w (the others). sigma, widening_sigma : (S,) of e for a known w, and of w.
    textured : (S,) the part of sigma that the texture causes. lean : (S,) change of e with w.
    residual : (J, S J) takes one profile, less its edge, to what no level and background explain,
    whitened: its square is the cost. log_det : (S,) of the covariances that this is whitened by.
    slope, widening : (J,) derivatives of a unit step by e and w. rise : mean of a unit step at
    `BESIDE_PX`, where steps are measured.
    """

    weights: np.ndarray
    sigma: np.ndarray
    textured: np.ndarray
    widening_sigma: np.ndarray
    lean: np.ndarray
    residual: np.ndarray
    log_det: np.ndarray
    slope: np.ndarray
    widening: np.ndarray
    rise: float


@dataclass(frozen=True, eq=False)
class KrigedEdges:
    """Places (N,) of the edge along the normals from the predicted ones and their sigmas, pixels.

    limb (3,) : unknowns of the limb that fits them. misfit (N,) : cost over the degrees of freedom.
    step (N,) : gray levels from space to the planet beside the limb. shared : of texture's error,
    what a sixth of the limb has in common, and what the whole of it has. corner_blur : as of
    `LimbPoints`.
    """

    offset_px: np.ndarray
    sigma_px: np.ndarray
    limb: np.ndarray
    misfit: np.ndarray
    step: np.ndarray
    shared: SharedError
    corner_blur: CornerBlur | None


def krige_edges(
    stretches: Stretches, good: np.ndarray, phase: np.ndarray, odd: np.ndarray | None = None
) -> KrigedEdges:
    """Measure the edges of stretches of limb.

    good : (N,) stretches that show one; the others tell nothing of their neighbours. phase : (N,)
    complex, the mean over the stretch of the edge's phase among rows or columns of pixels: its size
    is one where they run with the limb. odd : (N,) those of the others that show an edge which no
    model follows: cloud ends there, and may reach unseen into the stretches beside them; by default
    none. To first order in the edge's distance from its predicted place: a tenth of a pixel is near
    enough.
    """
    used = _samples(stretches.d_px, -INNER_PX, OUTER_PX)
    tables = _tables_of(stretches, used)
    limb = _Limb(stretches, good, Raster.of(stretches.base[:, :2], phase, good), odd)
    bright = _Brightness.of(limb, tables.rise)
    scaled = stretches.profiles[:, used] * (1.0 / bright.noise)
    over_step = bright.noise / bright.step
    found = _solved(scaled, over_step, limb, tables)
    usual = ground_texture.likely(bright.deviation / bright.noise)
    unknowns, edge, blur = _on_one_limb(found, usual, limb, tables)
    evidence = -0.5 * (_cost(scaled, edge / over_step, blur / over_step, tables) + tables.log_det)
    share = _shares(evidence, limb.sure(bright.step) / bright.noise, limb)
    place, spread2, lacking = _averaged(found, share, limb, tables)
    chi2 = _cost(scaled, place / over_step, lacking.lacking_px / over_step, tables)
    misfit = (share * chi2).sum(axis=1) / (scaled.shape[1] - 3)
    model_error = _SHAPE_ERROR + PLACE_SIGMA_PX * limb.raster.size
    misfit /= 1.0 + np.square(model_error / over_step)
    place, spread2 = _without_raster(place, spread2, limb)
    # What weighs less moves the limb less.
    weight = good / spread2
    textured = (weight * np.square(over_step)) @ share * np.square(tables.textured) / weight.sum()
    hidden_px = math.hypot(lacking.open_px, stretches.blur_open_px)
    hidden_px *= float(weight @ (share @ tables.lean)) / float(weight.sum())
    shared = _shared_error(textured, limb.count, limb.ground, bright.deviation / bright.usual)
    shared = shared.besides(SharedError(hidden_px, hidden_px))
    sigma = np.sqrt(spread2)
    return KrigedEdges(place, sigma, unknowns, misfit, bright.step, shared, lacking.corner)


def _tables_of(stretches: Stretches, used: slice) -> _Tables:
    """Tables for these stretches; their ground's scale is rounded, so that few are made."""
    octave = round(_SCALES_PER_OCTAVE * math.log2(stretches.px_over_radius))
    return _tables(
        tuple(stretches.d_px[used].tolist()),
        stretches.psf_px,
        2.0 ** (octave / _SCALES_PER_OCTAVE),
        round(stretches.length_px),
    )


class _Limb:
    """Stretches along one limb: which of them are good (N,), how they lie in the raster, and what
    changes their blur.

    telling : (N,) those that tell of texture, the good and the `odd` ones. most_evidence : (N, 1)
    of each for one texture over another. ground : length of a stretch, over the planet's radius.
    count : of the good ones.
    """

    def __init__(
        self,
        stretches: Stretches,
        good: np.ndarray,
        raster: Raster,
        odd: np.ndarray | None,
    ) -> None:
        self.stretches, self.good, self.raster = stretches, good, raster
        self.telling = good if odd is None else good | odd
        self.most_evidence = np.where(good, _MOST_EVIDENCE, _MOST_OF_ODD)[:, None]
        self.causes = Causes.of(
            stretches.base[:, :2], raster.blur, stretches.cornered, stretches.corner_px
        )
        self.every = bool(good.all())
        self.ground = _rounded(stretches.px_over_radius * stretches.length_px)
        self.count = int(np.count_nonzero(good))

    def sure(self, values: np.ndarray) -> np.ndarray:
        """Of values (N, ...), those of the good stretches."""
        return values if self.every else values[self.good]


@dataclass(frozen=True, eq=False)
class _Brightness:
    """Gray levels along a limb.

    step (N,) : from space to the planet beside each edge. usual : their median. deviation : one
    sigma along the limb. noise : of a sample, no less than what the model is wrong by.
    """

    step: np.ndarray
    usual: float
    deviation: float
    noise: float

    @classmethod
    def of(cls, limb: _Limb, rise: float) -> _Brightness:
        """Of stretches; rise : as of `_Tables`."""
        d_px, profiles = limb.stretches.d_px, limb.stretches.profiles
        # Just inside the edge: brightness may be another a few pixels on.
        beside = profiles[:, _samples(d_px, *BESIDE_PX)]
        step = np.add.reduce(beside, axis=1) / np.float32(beside.shape[1])
        step -= median(limb.sure(profiles)[:, _samples(d_px, _SPACE_PX)].ravel())
        step = np.maximum(step / rise, limb.stretches.noise)
        usual, deviation = median(limb.sure(step)), _deviation(limb.sure(step))
        noise = max(limb.stretches.noise, usual / MAX_LEVEL, deviation / _MOST_TEXTURE)
        return cls(step, usual, deviation, noise)


@dataclass(frozen=True, eq=False)
class _Solved:
    """What each stretch says of its edge by itself, (N, S) if the ground had one texture each.

    places : of the edge for a blur as expected, and variance, of these. wider : what the blur
    lacks, and wider_information, on that.
    """

    places: np.ndarray
    variance: np.ndarray
    wider: np.ndarray
    wider_information: np.ndarray


def _solved(scaled: np.ndarray, over_step: np.ndarray, limb: _Limb, tables: _Tables) -> _Solved:
    """Solve profiles (N, J) over the noise; over_step (N,) : the noise over their steps."""
    solved = _with_neighbours(scaled, limb.good) @ tables.weights
    solved *= over_step[:, None]
    information = np.square((limb.good / over_step)[:, None] / tables.widening_sigma)
    information /= 1.0 + information * limb.raster.blur_rest2()[:, None]
    return _Solved(
        solved[:, : ground_texture.NUM],
        np.square(tables.sigma * over_step[:, None]),
        solved[:, ground_texture.NUM :],
        information,
    )


def _on_one_limb(
    found: _Solved, texture: int, limb: _Limb, tables: _Tables
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Unknowns (3,) of the limb that fits the edges beside one texture; edges (N,) that lie on it,
    and what their blur lacks (N,).
    """
    stretches, raster = limb.stretches, limb.raster
    wider, information = found.wider[:, texture], found.wider_information[:, texture]
    blur = blur_along(limb.causes, wider, information, stretches.psf_px).lacking_px
    place = found.places[:, texture] - tables.lean[texture] * blur
    unknowns, error, _ = limb_in_raster(
        limb.sure(stretches.base),
        limb.sure(place),
        limb.sure(found.variance[:, texture]),
        limb.sure(raster.place),
    )
    return unknowns, stretches.base @ unknowns + error * raster.place, blur


def _shares(evidence: np.ndarray, step: np.ndarray, limb: _Limb) -> np.ndarray:
    """How likely (N, S) each texture is beside each stretch, by what it and its neighbours say.

    evidence : (N, S) log likelihood of their profiles, to which that of their brightness is added.
    step : of the good ones, over the noise.
    """
    # What the raster does to a profile is not texture.
    nearby = nearness(len(limb.good), max(_LEAST_WINDOW, _WINDOW / limb.ground)) + _ANYWHERE
    nearby *= limb.telling * np.maximum(1.0 - _PHASE_WEIGHT * limb.raster.size, 0.0)
    level = _level_evidence(step, limb.ground)
    if limb.every:
        evidence += level
    else:
        evidence[limb.good] += level
    evidence -= evidence.max(axis=1, keepdims=True)
    evidence = nearby @ np.maximum(evidence, -limb.most_evidence)
    evidence[:, ground_texture.NONE] += _NO_TEXTURE
    share = np.exp(evidence - evidence.max(axis=1, keepdims=True))
    return np.asarray(share / share.sum(axis=1, keepdims=True))


def _averaged(
    found: _Solved, share: np.ndarray, limb: _Limb, tables: _Tables
) -> tuple[np.ndarray, np.ndarray, Blur]:
    """Places (N,) and variances (N,) averaged over the textures, as likely as each is (N, S), and
    what the blur lacks.
    """
    information = found.wider_information * share
    told = information.sum(axis=1)
    lacking = (information * found.wider).sum(axis=1) / np.maximum(told, 1e-30)
    blur = blur_along(limb.causes, lacking, told, limb.stretches.psf_px)
    places = found.places - tables.lean * blur.lacking_px[:, None]
    place = (share * places).sum(axis=1)
    spread2 = (share * (found.variance + np.square(places - place[:, None]))).sum(axis=1)
    return place, spread2, blur


def _without_raster(
    place: np.ndarray, spread2: np.ndarray, limb: _Limb
) -> tuple[np.ndarray, np.ndarray]:
    """Places (N,) less what the raster moves them by, and their variances (N,) with what is left of
    it.
    """
    raster = limb.raster
    spread2 = spread2 + raster.rest2()
    _, error, open2 = limb_in_raster(
        limb.sure(limb.stretches.base),
        limb.sure(place),
        limb.sure(spread2),
        limb.sure(raster.place),
    )
    return place - error * raster.place, spread2 + raster.shared2(open2)


def _level_evidence(step: np.ndarray, ground: float) -> np.ndarray:
    """Log likelihood (N, S) of each texture by how brightness changes along the limb.

    step : (N,) over the noise, of stretches of a length of ``ground``.
    """
    lag = min(max(1, round(_LAG / ground)), len(step) - 1)
    change2 = 0.5 * np.square(step[lag:] - step[:-lag])
    ahead, behind = _around(len(step), lag)
    change2 = 0.5 * (change2[ahead] + change2[behind])
    expected = _STEP_VARIANCE + _variogram(lag, ground)
    # Changes over stretches in common are one.
    return -0.5 * (change2[:, None] / expected + np.log(expected)) / lag


def _shared_error(variance: np.ndarray, count: int, ground: float, contrast: float) -> SharedError:
    """What edges have in common: so much of each texture's variance (S,) as it is alike.

    count : stretches of limb, of a length of ``ground``. contrast : one sigma of their brightness,
    over its median.
    """
    shared = variance * _SHARED
    more = 1.0 + _BY_CONTRAST * min(contrast, _MOST_CONTRAST)
    part2 = shared @ _alike(max(1, round(count / _PARTS)), ground)
    whole2, rough2 = shared @ _alike(count, ground), shared @ _alike_if_rough(count, ground)
    return SharedError(math.sqrt(part2), math.sqrt(whole2 + (more * more - 1.0) * rough2))


def _rounded(ground: float) -> float:
    """A length of ground to two digits: near enough for how alike texture is, and often the same as
    in the last frame.
    """
    return float(f"{ground:.2g}")


@lru_cache(maxsize=64)
def _around(count: int, lag: int) -> tuple[np.ndarray, np.ndarray]:
    """Numbers (N,) of the changes, over so many stretches, that begin and end at each of `count`;
    those next to it at the ends.
    """
    index = np.arange(count)
    return np.minimum(index, count - lag - 1), np.maximum(index - lag, 0)


@lru_cache(maxsize=64)
def _variogram(lag: int, ground: float) -> np.ndarray:
    return ground_texture.variogram(lag * ground)


@lru_cache(maxsize=64)
def _alike(count: int, ground: float) -> np.ndarray:
    """Mean correlation (S,) of each texture over all pairs of so many stretches."""
    away = np.arange(count)
    pairs = np.where(away > 0, 2.0, 1.0) * (count - away) / count**2
    return ground_texture.correlation(away * ground) @ pairs


@lru_cache(maxsize=64)
def _alike_if_rough(count: int, ground: float) -> np.ndarray:
    """The same, nothing for smooth ones."""
    return _alike(count, ground) * ground_texture.by_kind(1.0, 0.0)


def _deviation(values: np.ndarray) -> float:
    """Standard deviation of values (N,)."""
    off = values - values.sum() / len(values)
    return math.sqrt(float(off @ off) / len(values))


def _cost(scaled: np.ndarray, edge: np.ndarray, blur: np.ndarray, tables: _Tables) -> np.ndarray:
    """Cost (N, S) of each texture for profiles whose edge and blur (N,), in their steps over the
    noise, are known.
    """
    known = scaled - edge[:, None] * tables.slope - blur[:, None] * tables.widening
    chi = (known @ tables.residual).reshape(-1, scaled.shape[1])
    return np.asarray(np.einsum("nj,nj->n", chi, chi).reshape(len(scaled), -1))


def _samples(d_px: np.ndarray, first_px: float, last_px: float = math.inf) -> slice:
    """Samples of profiles at d_px (J,), whole pixels, from one distance to another."""
    start = float(d_px[0])
    first = max(0, math.ceil(first_px - start))
    return slice(first, None if last_px == math.inf else math.floor(last_px - start) + 1)


def _with_neighbours(scaled: np.ndarray, good: np.ndarray) -> np.ndarray:
    """Each profile between the one before and the one after it (N, 3 J).

    Where only one of these is good it takes both places, and where none is the profile's own does.
    """
    first, last = _beside(len(scaled)) if good.all() else _good_beside(good)
    return np.concatenate([scaled[first], scaled, scaled[last]], axis=1)


@lru_cache(maxsize=64)
def _beside(count: int) -> tuple[np.ndarray, np.ndarray]:
    """`_good_beside` of so many that all are."""
    return _good_beside(np.ones(count, dtype=bool))


def _good_beside(good: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Numbers (N,) of the stretches that stand before and after each."""
    index = np.arange(len(good))
    before = np.concatenate([_NONE, good[:-1]])
    after = np.concatenate([good[1:], _NONE])
    first = np.where(before, index - 1, np.where(after, index + 1, index))
    last = np.where(after, index + 1, np.where(before, index - 1, index))
    return first, last


_NONE = np.zeros(1, dtype=bool)


@lru_cache(maxsize=64)
def _tables(
    d_px: tuple[float, ...], psf_px: float, px_over_radius: float, length_px: int
) -> _Tables:
    x_px = np.array(d_px)
    num = len(x_px)
    root, blur = seen_depths(x_px, psf_px)
    across = ground_texture.along_sight(root, px_over_radius)
    along = np.arange(3) * (length_px * px_over_radius)
    texture, together = ground_texture.covariances(blur, across, along)
    slope = _normal_law(x_px / psf_px) / psf_px
    widening = slope * (x_px / psf_px)
    free = np.stack([normal_cdf(-x_px / psf_px), np.ones(num)], axis=1)
    design = np.concatenate([np.kron(np.eye(3), slope[:, None]), np.tile(free, (3, 1))], axis=1)
    design = np.column_stack([design, np.tile(widening, 3)])
    # Light may change from stretch to stretch even where there is no texture.
    own_level = _LEVEL_SIGMA**2 * np.kron(np.eye(3), np.outer(free[:, 0], free[:, 0]))
    cov = together + own_level + np.eye(3 * num)
    weighted = np.linalg.solve(cov, design[None])
    information = np.swapaxes(weighted, 1, 2) @ design
    # The edge's place for a known blur, and the blur.
    known = np.linalg.inv(information[:, :-1, :-1])
    weights = np.einsum("sk,sjk->sj", known[:, 1], weighted[..., :-1])
    whole = np.linalg.inv(information)
    lower = np.linalg.cholesky(texture + np.eye(num))
    whiten = np.linalg.inv(lower)
    q, r = np.linalg.qr(whiten @ free)
    diagonals = np.diagonal(lower, axis1=1, axis2=2), np.diagonal(r, axis1=1, axis2=2)
    residual = whiten - q @ (np.swapaxes(q, 1, 2) @ whiten)
    return _Tables(
        weights=np.concatenate([weights, np.einsum("sk,sjk->sj", whole[:, -1], weighted)]).T.copy(),
        sigma=np.sqrt(known[:, 1, 1]),
        textured=np.sqrt(np.einsum("sj,sjk,sk->s", weights, together, weights)),
        widening_sigma=np.sqrt(whole[:, -1, -1]),
        lean=weights @ design[:, -1],
        residual=residual.reshape(-1, num).T.copy(),
        log_det=np.asarray(
            sum(2.0 * np.log(np.abs(diagonal)).sum(axis=1) for diagonal in diagonals)
        ),
        slope=slope,
        widening=widening,
        rise=float(free[_samples(x_px, *BESIDE_PX), 0].mean()),
    )


def _normal_law(x: np.ndarray) -> np.ndarray:
    return np.asarray(np.exp(-0.5 * x * x) / np.sqrt(2.0 * np.pi))
