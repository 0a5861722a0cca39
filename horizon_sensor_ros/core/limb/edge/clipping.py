"""Edges of a planet too bright for the exposure: where pixels saturate, the fall's foot is seen.

A blurred step of height S that is clipped at the white level,

    I(d) = background + min(white, S F((e - d) / w)),

is known by the samples on its way down. The higher S is over the white level, the farther out they
lie: heights and blurs w are tried, the place e found for each, and places averaged over what is
likely. What stays open shifts the whole limb, and is so much of its shared error.
A planet that is white and no brighter, as pictures that were drawn have it, is not clipped: pixels
on its edge are as often lighter than the middle as darker, or none is between black and white.
Source: derived here.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from horizon_sensor_ros.core.cameras.white_level import NEAR_WHITE
from horizon_sensor_ros.core.limb.edge.demosaicing import BESIDE
from horizon_sensor_ros.core.limb.profiles import EdgePlaces, nearness, space_level
from horizon_sensor_ros.core.limb_points import SharedError
from horizon_sensor_ros.core.mathematics.normal_law import normal_cdf

_DARK = 0.5  # space, over the white level, at most
# The part of a profile that is fitted, pixels outwards from the predicted edge.
_INNER_PX = -2.0
_OUTER_PX = 5.0
# Where the planet beside the edge is seen; up to where behind a soft lens, or in a reduced or a
# demosaiced frame, whose pixels are white where all that they are means of were. There an edge just
# overexposed is white only so far inside of where it falls most steeply, and that lies up to a
# pixel too far out.
_INSIDE_PX, _INSIDE_SOFT_PX = (-3.0, -0.5), -1.5
# A lens is soft where the feet of edges come down from the one to the other level, over white, in
# so many pixels: 1.1 behind a usual one. Nothing on the ground makes them longer, and air's fade by
# a law of their own: from the middle level 1.7 times as long as to it, where a lens's do 1.2 times.
_FOOT, _SOFT_FOOT_PX, _OF_LENS = (0.45, 0.2, 0.05), 1.6, 1.45
_TELLING = 0.1  # share of white edges from which on they tell: a few may be a cloud's
_PITCH_PX = 0.1  # between places of the edge that are tried
_PLACES_PX = np.arange(-20, 21) * _PITCH_PX
_HEIGHTS = 2.0 ** np.arange(0.0, 2.6, 0.125)  # of the step, over the white level
# Blurs that are tried, one sigma each; what is known of the blur beforehand, and the sigma of its
# logarithm.
_BLURS_PX = np.array(
    [0.3, 0.36, 0.43, 0.51, 0.6, 0.68, 0.76, 0.85, 0.95, 1.1, 1.25, 1.45, 1.7, 2.0, 2.35]
)
_USUAL_BLUR_PX = 0.76
_BLUR_SPREAD = 0.1
_SHOWN_SPREAD = 0.05  # likewise, where edges of the same limb that are not clipped show it
_DRAWN = np.log(0.03)  # beforehand, of a picture that was drawn without optics, over the usual one
_MODEL_ERROR = 0.01  # of a sample, over the white level: no blur is quite a normal law
_LOBES = 4  # of the Lanczos kernel by which profiles are interpolated between pixels
_FINE_PX = 0.05  # pitch on which that kernel is convolved with an edge
_WINDOW = 3.0  # edges, one sigma: neighbours that are about as bright tell of height and blur too
_ANYWHERE = 3.0  # what an edge anywhere tells of these, over a near one
_TOLD = 8.0  # edges, as many as which tell of height and blur: their errors are alike
_MOST_EVIDENCE = 20.0  # of one edge
_LEAST_SHARED = SharedError(0.03, 0.1)  # height and blur are not the same all along the limb
# What tells an edge that is cut off at white from one that was drawn no brighter: the pixels
# between black and white, their number a profile, and their mean from black, 0, to white, 1.
# Simulated edges clipped at three to nine tenths of their height have means of .37 to .45, at an
# eighth .41 to .47 and .6 such pixels; lenses' and air's have more pixels.
_NONE_BETWEEN = 0.02  # pixels a profile: fewer are in pictures of black and white alone
_FEWEST = 0.8  # pixels a profile, of an edge that was drawn
_MOST = 1.5  # likewise
_FAIR = 0.47  # mean of a drawn edge's, at least: as many lighter than the middle as darker
_FAIR_SIGMA = 0.02  # of that mean, at most: else it tells nothing
# From where on a pixel counts as neither black nor white.
_BETWEEN = 0.04  # of their difference
_NOISES = 4.0  # one sigma of a pixel's noise
_UNSEEN = 0.12  # of their difference: where noise asks for more, it hides an edge's foot


@dataclass(frozen=True)
class ClippedEdges:
    """places : of the edges. shared : error that they have in common, of blur and height."""

    places: EdgePlaces
    shared: SharedError


def clipped(
    profiles: np.ndarray,
    d_px: np.ndarray,
    white: float,
    *,
    reduced: bool = False,
    demosaiced: Callable[[], bool] = lambda: False,
) -> np.ndarray:
    """Which profiles (N, J), with samples at d_px (J,) outwards, are clipped up to the edge.

    Not those that are bright in space as well. reduced : they are of a reduced frame. demosaiced :
    whether pixels were interpolated after they were clipped, which takes a look at the frame.
    """
    if white == np.inf:
        return np.zeros(len(profiles), dtype=bool)
    space = space_level(profiles)
    dark_outside = space < _DARK * white
    found = _white_inside(profiles, d_px, white, _INSIDE_SOFT_PX) & dark_outside
    if reduced:
        return found
    enough = np.count_nonzero(found) > _TELLING * len(found)
    if enough and (_soft(profiles[found], d_px, space[found], white) or demosaiced()):
        return found
    return found & _white_inside(profiles, d_px, white, _INSIDE_PX[1])


def _white_inside(
    profiles: np.ndarray, d_px: np.ndarray, white: float, nearest_px: float
) -> np.ndarray:
    """Which profiles (N, J) are white beside the edge, up to so near to it."""
    beside = (d_px >= _INSIDE_PX[0]) & (d_px <= nearest_px)
    return np.asarray(profiles[:, beside].min(axis=1) >= NEAR_WHITE * white)


def _soft(profiles: np.ndarray, d_px: np.ndarray, space: np.ndarray, white: float) -> bool:
    """Whether the feet of edges, profiles (N, J) above space (N,), are those of a soft lens."""
    share = (profiles - space[:, None]) / (white - space)[:, None]
    high, middle, low = (_outermost_px(share, d_px, level) for level in _FOOT)
    of_lens = np.median(low - middle) < _OF_LENS * np.median(middle - high)
    return bool(of_lens and np.median(low - high) > _SOFT_FOOT_PX)


def _outermost_px(share: np.ndarray, d_px: np.ndarray, level: float) -> np.ndarray:
    """Where profiles (N, J) come down to a level for the last time, pixels outwards (N,)."""
    last = share.shape[1] - 2 - np.argmax(share[:, -2::-1] > level, axis=1)
    row = np.arange(len(share))
    above, below = share[row, last], np.minimum(share[row, last + 1], level)
    part = np.clip((above - level) / np.maximum(above - below, 1e-9), 0.0, 1.0)
    return np.asarray(d_px[last] + part * (d_px[last + 1] - d_px[last]))


def cut_off(levels: np.ndarray, white: float, noise: float) -> bool:
    """Whether something of white edges is cut off.

    levels : (N, J) gray levels of pixels across them, from white into space. noise : one sigma of
    a pixel.
    """
    space = np.median(levels[:, -3:])
    share = (levels - space) * (1.0 / (white - space))
    least = max(_BETWEEN, _NOISES * noise / (white - space))
    if least > _UNSEEN:
        return True
    between = share[(share > least) & (share < 1.0 - least)]
    count = len(between) / len(levels)
    if count < _NONE_BETWEEN:
        return False
    sigma = between.std() / np.sqrt(len(between))
    drawn = _FEWEST < count < _MOST and between.mean() > _FAIR and sigma < _FAIR_SIGMA
    return not drawn


def place_clipped_edges(
    profiles: np.ndarray,
    d_px: np.ndarray,
    white: float,
    noise: float,
    reach_px: float,
    shown_blur_px: float | None = None,
    *,
    demosaiced: bool = False,
) -> ClippedEdges:
    """Places of the edges of clipped profiles (N, J) along the normals.

    d_px : (J,) whole pixels outwards from the predicted place. noise : one sigma of a sample.
    reach_px : beyond it an edge counts as at the border. shown_blur_px : one sigma of the lens's
    blur, with the pixel's own width, as edges beside these show it; None: none do. demosaiced :
    pixels were interpolated after they were clipped.
    """
    used = (d_px >= _INNER_PX) & (d_px <= _OUTER_PX)
    space = space_level(profiles)
    scale = white - space
    samples = (profiles[:, used] - space[:, None]) / scale[:, None]
    models = _models(tuple(d_px[used].tolist()), demosaiced)
    chi2 = np.square(models).sum(axis=1) - 2.0 * samples @ models.T
    chi2 += np.square(samples).sum(axis=1)[:, None]
    chi2 /= (np.square(noise / scale) + _MODEL_ERROR**2)[:, None]
    offset, variance, cost = _lowest(chi2.reshape(len(samples), -1, len(_PLACES_PX)))
    least = cost.min(axis=1)
    evidence = np.maximum(-0.5 * (cost - least[:, None]), -_MOST_EVIDENCE)
    nearby = nearness(len(samples), _WINDOW) + _ANYWHERE
    nearby *= np.minimum(1.0, _TOLD / nearby.sum(axis=1))[:, None]
    if demosaiced and shown_blur_px is not None:
        # Of these edges, what is blurred before they are clipped.
        shown_blur_px = math.sqrt(max(shown_blur_px**2 - 2.0 * BESIDE, 0.0))
    evidence = nearby @ evidence + _log_prior(shown_blur_px)
    share = np.exp(evidence - evidence.max(axis=1, keepdims=True))
    share /= share.sum(axis=1, keepdims=True)
    place = (share * offset).sum(axis=1)
    apart2 = (share * np.square(offset - place[:, None])).sum(axis=1)
    places = EdgePlaces(
        place,
        np.sqrt((share * variance).sum(axis=1)),
        scale,
        scale / noise,
        least / samples.shape[1],
        np.abs(place) > reach_px,
    )
    open_px = float(np.sqrt(apart2.mean()))
    shared = SharedError(open_px, open_px).besides(_LEAST_SHARED)
    return ClippedEdges(places, shared._replace(white_px=shared.coherent_px))


def _lowest(chi2: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Place, its variance, and the cost there (N, M), of costs (N, M, P): vertices of parabolas."""
    index = np.clip(chi2.argmin(axis=2), 1, len(_PLACES_PX) - 2)[:, :, None]
    before, top, after = (np.take_along_axis(chi2, index + k, axis=2)[:, :, 0] for k in (-1, 0, 1))
    bend = np.maximum(before - 2.0 * top + after, 1e-9)
    lean = np.clip(0.5 * (before - after) / bend, -1.0, 1.0)
    offset = _PLACES_PX[index[:, :, 0]] + _PITCH_PX * lean
    return offset, 2.0 * _PITCH_PX**2 / bend, top - 0.5 * bend * np.square(lean)


@lru_cache(maxsize=4)
def _log_prior(shown_blur_px: float | None) -> np.ndarray:
    """Of blurs and heights (M,): much too bright is less likely than a little."""
    around_px, spread = _USUAL_BLUR_PX, _BLUR_SPREAD
    if shown_blur_px is not None:
        around_px, spread = min(max(shown_blur_px, _BLURS_PX[0]), _BLURS_PX[-1]), _SHOWN_SPREAD
    blur = -0.5 * np.square(np.log(_BLURS_PX / around_px) / spread)
    blur = np.maximum(blur, _DRAWN)
    return np.asarray((blur[:, None] - np.log(_HEIGHTS)).ravel())


@lru_cache(maxsize=8)
def _models(d_px: tuple[float, ...], demosaiced: bool) -> np.ndarray:
    """Clipped edges over the white level, (blurs * heights * places, J).

    Pixels are clipped one by one, and interpolation between them rounds the corner off: over all
    phases of the pixels that is a convolution with its kernel (of Lanczos, four lobes).
    """
    fine = np.arange(d_px[0] - _LOBES, d_px[-1] + _LOBES, _FINE_PX) + 0.5 * _FINE_PX
    depth = _PLACES_PX[:, None] - fine
    rise = normal_cdf(depth / _BLURS_PX[:, None, None])
    seen = np.minimum(1.0, rise[:, None] * _HEIGHTS[:, None, None])
    apart = fine[:, None] - np.array(d_px)
    kernel = _lanczos(apart)
    if demosaiced:
        beside = _lanczos(apart - 1.0) + _lanczos(apart + 1.0)
        kernel = (1.0 - 2.0 * BESIDE) * kernel + BESIDE * beside
    return np.asarray((seen.reshape(-1, len(fine)) @ kernel) / kernel.sum(axis=0))


def _lanczos(apart_px: np.ndarray) -> np.ndarray:
    """The kernel by which profiles are interpolated, at such distances, any shape."""
    near = np.abs(apart_px) < _LOBES
    return np.where(near, np.sinc(apart_px) * np.sinc(apart_px / _LOBES), 0.0)
