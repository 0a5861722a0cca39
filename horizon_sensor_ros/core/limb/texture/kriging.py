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

import numpy as np

from horizon_sensor_ros.core.limb.edge.model import MAX_LEVEL, SHAPE_ERROR
from horizon_sensor_ros.core.limb.edge.near_edge import BESIDE_PX
from horizon_sensor_ros.core.limb.edge.raster import PLACE_SIGMA_PX, Raster
from horizon_sensor_ros.core.limb.edge.smear import Blur, Causes, blur_along
from horizon_sensor_ros.core.limb.profiles import nearness
from horizon_sensor_ros.core.limb.texture import ground_texture
from horizon_sensor_ros.core.limb.texture.along_limb import level_evidence, rounded, shared_error
from horizon_sensor_ros.core.limb.texture.fitted_limb import limb_in_raster
from horizon_sensor_ros.core.limb.texture.kriging_tables import Tables, tables_of
from horizon_sensor_ros.core.limb.texture.stretches import (
    INNER_PX,
    OUTER_PX,
    Stretches,
    samples_between,
    with_neighbours,
)
from horizon_sensor_ros.core.limb_points import CornerBlur, SharedError
from horizon_sensor_ros.core.mathematics.robust import median

_SPACE_PX = 2.5  # from where on space is
_WINDOW = 0.03  # over the planet's radius; along so much limb the texture is the same
_LEAST_WINDOW = 0.7  # stretches
_ANYWHERE = 0.1  # what a stretch elsewhere says about the texture, over what a near one does
_MOST_EVIDENCE = 8.0  # of one stretch, for one texture over another
_MOST_OF_ODD = 40.0  # the same, of one whose edge texture has made odd
_NO_TEXTURE = 5.0  # log odds beforehand of a limb without texture, to any one texture
# Of brightness's deviation along the limb over the noise: no ground follows the textures' law more
# finely. With less noise errors stay, as measured down to .4 DN, what they are with 2 DN.
_MOST_TEXTURE = 64.0


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
    used = samples_between(stretches.d_px, -INNER_PX, OUTER_PX)
    tables = tables_of(stretches, used)
    limb = _LimbStretches(stretches, good, Raster.of(stretches.base[:, :2], phase, good), odd)
    bright = _Brightness.of(limb, tables.rise)
    scaled = stretches.profiles[:, used] * (1.0 / bright.noise)
    over_step = bright.noise / bright.step
    found = _solved(scaled, over_step, limb, tables)
    usual = ground_texture.likely(bright.deviation / bright.noise)
    unknowns, edge, blur = _on_one_limb(found, usual, limb, tables)
    evidence = -0.5 * (_cost(scaled, edge / over_step, blur / over_step, tables) + tables.log_det)
    share = _shares(evidence, bright, limb)
    place, spread2, lacking = _averaged(found, share, limb, tables)
    chi2 = _cost(scaled, place / over_step, lacking.lacking_px / over_step, tables)
    misfit = (share * chi2).sum(axis=1) / (scaled.shape[1] - 3)
    model_error = SHAPE_ERROR + PLACE_SIGMA_PX * limb.raster.size
    misfit /= 1.0 + np.square(model_error / over_step)
    place, spread2 = _without_raster(place, spread2, limb)
    # What weighs less moves the limb less.
    weight = good / spread2
    textured = (weight * np.square(over_step)) @ share * np.square(tables.textured) / weight.sum()
    hidden_px = math.hypot(lacking.open_px, stretches.blur_open_px)
    hidden_px *= float(weight @ (share @ tables.lean)) / float(weight.sum())
    shared = shared_error(textured, limb.count, limb.ground, bright.deviation / bright.usual)
    shared = shared.besides(SharedError(hidden_px, hidden_px))
    sigma = np.sqrt(spread2)
    return KrigedEdges(place, sigma, unknowns, misfit, bright.step, shared, lacking.corner)


class _LimbStretches:
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
        self.ground = rounded(stretches.px_over_radius * stretches.length_px)
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
    def of(cls, limb: _LimbStretches, rise: float) -> _Brightness:
        """Of stretches; rise : as of `Tables`."""
        d_px, profiles = limb.stretches.d_px, limb.stretches.profiles
        # Just inside the edge: brightness may be another a few pixels on.
        beside = profiles[:, samples_between(d_px, *BESIDE_PX)]
        step = np.add.reduce(beside, axis=1) / np.float32(beside.shape[1])
        step -= median(limb.sure(profiles)[:, samples_between(d_px, _SPACE_PX)].ravel())
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


def _solved(
    scaled: np.ndarray, over_step: np.ndarray, limb: _LimbStretches, tables: Tables
) -> _Solved:
    """Solve profiles (N, J) over the noise; over_step (N,) : the noise over their steps."""
    solved = with_neighbours(scaled, limb.good) @ tables.weights
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
    found: _Solved, texture: int, limb: _LimbStretches, tables: Tables
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


def _shares(evidence: np.ndarray, bright: _Brightness, limb: _LimbStretches) -> np.ndarray:
    """How likely (N, S) each texture is beside each stretch, by what it and its neighbours say.

    evidence : (N, S) log likelihood of their profiles, to which that of their brightness is added.
    """
    # What the raster does to a profile is not texture.
    nearby = nearness(len(limb.good), max(_LEAST_WINDOW, _WINDOW / limb.ground)) + _ANYWHERE
    nearby *= limb.telling * limb.raster.unshaped(bright.usual / bright.noise)
    level = level_evidence(limb.sure(bright.step) / bright.noise, limb.ground)
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
    found: _Solved, share: np.ndarray, limb: _LimbStretches, tables: Tables
) -> tuple[np.ndarray, np.ndarray, Blur]:
    """Places (N,) and variances (N,) averaged over the textures, as likely as each is (N, S), and
    what the blur lacks.
    """
    information = found.wider_information * share
    total = information.sum(axis=1)
    lacking = (information * found.wider).sum(axis=1) / np.maximum(total, 1e-30)
    blur = blur_along(limb.causes, lacking, total, limb.stretches.psf_px)
    places = found.places - tables.lean * blur.lacking_px[:, None]
    place = (share * places).sum(axis=1)
    spread2 = (share * (found.variance + np.square(places - place[:, None]))).sum(axis=1)
    return place, spread2, blur


def _without_raster(
    place: np.ndarray, spread2: np.ndarray, limb: _LimbStretches
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


def _deviation(values: np.ndarray) -> float:
    """Standard deviation of values (N,)."""
    off = values - values.sum() / len(values)
    return math.sqrt(float(off @ off) / len(values))


def _cost(scaled: np.ndarray, edge: np.ndarray, blur: np.ndarray, tables: Tables) -> np.ndarray:
    """Cost (N, S) of each texture for profiles whose edge and blur (N,), in their steps over the
    noise, are known.
    """
    known = scaled - edge[:, None] * tables.slope - blur[:, None] * tables.widening
    chi = (known @ tables.residual).reshape(-1, scaled.shape[1])
    return np.asarray(np.einsum("nj,nj->n", chi, chi).reshape(len(scaled), -1))
