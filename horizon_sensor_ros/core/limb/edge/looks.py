"""Which look of an edge, its blur and glow, makes an image's profiles most likely."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from horizon_sensor_ros.core.limb.edge.model import GLOW_LADDER_PX, PSF_LADDER_PX, EdgeLook
from horizon_sensor_ros.core.limb.edge.places import look_evidence
from horizon_sensor_ros.core.limb.profiles import EdgePlaces, ProfileGrid, mean_profile
from horizon_sensor_ros.core.mathematics.normal_law import normal_cdf
from horizon_sensor_ros.core.mathematics.robust import median

_MOST_EVIDENCE = 8.0  # of one profile, for one look over another
_PROFILES = 48  # that decide on the look
_COARSE_PSF_PX = np.array(PSF_LADDER_PX[::3])
_FROM_PX, _TO_PX = -2.5, 4.0  # the part of the mean profile that is looked at
# Brightness left 2.5 px outside the edge, over the step, from which air glow is taken to be there;
# below it, a sharp edge above clear space has none.
_GLOW_SHARE, CLEAR_SHARE = 0.04, 0.02
USUAL_PSF_PX = 0.75  # with the pixel's own width; to start from where glow hides the blur
# Likewise; an edge that is blurred by more, more than a lens in focus leaves, may be air's.
MOST_IN_FOCUS_PX = 0.775
_USUAL = (EdgeLook(USUAL_PSF_PX, 0.0), *EdgeLook(USUAL_PSF_PX, 0.0).neighbours())


def guess_looks(
    profiles: np.ndarray, d_px: np.ndarray, places: EdgePlaces, glow_share: float = _GLOW_SHARE
) -> tuple[EdgeLook, ...]:
    """First guesses of the edge's look, at least two, from profiles (M, J) aligned at their own
    edges.

    d_px : (J,) places across the limb. places : of the edges, one a profile. glow_share :
    brightness left outside the edge from which glow is one of them.
    """
    middle = median(places.offset_px)
    apart = np.abs(places.offset_px - middle)
    together = apart <= 3.0 * median(apart) + 0.3
    where, mean = mean_profile(profiles[together], d_px, places.take(together))
    near = (where > _FROM_PX) & (where < _TO_PX)
    explained = np.square(mean[near] @ _edges(tuple(where[near].tolist()))).sum(axis=1)
    sharp = EdgeLook(float(_COARSE_PSF_PX[int(np.argmax(explained))]), 0.0)
    inside, tail, far = (float(np.interp(at, where, mean)) for at in (-1.5, 2.5, 4.5))
    if tail <= max(glow_share * inside, 0.0):
        # The usual one is the likeliest as a rule, which only those beside it tell.
        return tuple(dict.fromkeys((sharp, *_USUAL)))
    slope = 0.5 * np.log(max(far, 0.02 * tail) / tail)
    length = np.abs(np.log(np.array(GLOW_LADDER_PX) * max(-slope, 0.05)))
    return (sharp, _USUAL[0], EdgeLook(USUAL_PSF_PX, GLOW_LADDER_PX[int(np.argmin(length))]))


@lru_cache(maxsize=16)
def _edges(where: tuple[float, ...]) -> np.ndarray:
    """Orthonormal bases (L, K, 3) of profiles at distances (K,) from edges of several blurs: space,
    step, and slope inside.
    """
    at = np.array(where)
    rise = normal_cdf(-at / _COARSE_PSF_PX[:, None])
    slope = rise * np.minimum(at, 0.0)
    return np.linalg.qr(np.stack([np.ones_like(rise), rise, slope], axis=2))[0]


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
    few = profiles[:: max(1, len(profiles) // _PROFILES)]
    tried: dict[EdgeLook, np.ndarray] = {}
    fresh = list(guesses)
    while fresh:
        tried.update(zip(fresh, _evidence(few, noise, fresh, grid), strict=True))
        merit = _merit(np.array(list(tried.values())))
        look = list(tried)[int(merit.argmax())]
        if not climb:
            return look
        fresh = [other for other in look.neighbours() if other not in tried]
    return _between(look, dict(zip(tried, merit.tolist(), strict=True)))


def rate_looks(
    profiles: np.ndarray, noise: float, looks: Sequence[EdgeLook], grid: ProfileGrid
) -> np.ndarray:
    """Logarithms (L,) of how likely looks make profiles (N, J), as `likeliest_look` has them."""
    few = profiles[:: max(1, len(profiles) // _PROFILES)]
    return _merit(_evidence(few, noise, looks, grid))


def _evidence(
    profiles: np.ndarray, noise: float, looks: Sequence[EdgeLook], grid: ProfileGrid
) -> np.ndarray:
    """`look_evidence` (L, N) of looks of any kinds."""
    found = np.empty((len(looks), len(profiles)))
    for kind in set(map(_kind, looks)):
        which = [i for i, look in enumerate(looks) if _kind(look) == kind]
        found[which] = look_evidence(profiles, noise, [looks[i] for i in which], grid)
    return found


def _merit(evidence: np.ndarray) -> np.ndarray:
    """Sums (L,) of evidence (L, N), of which no profile adds more than `_MOST_EVIDENCE`."""
    return np.asarray(np.maximum(evidence - evidence.max(axis=0), -_MOST_EVIDENCE).sum(axis=1))


def _kind(look: EdgeLook) -> tuple[bool, bool]:
    """What has the same textures and glows to consider."""
    return look.glow_px > 0.0, look.haze


def _between(look: EdgeLook, merits: dict[EdgeLook, float]) -> EdgeLook:
    """Likeliest blur between a look and its neighbours on the ladder, to one percent of a pixel:
    the vertex of the parabola through their merits.
    """
    beside = [other for other in look.neighbours() if other.glow_px == look.glow_px]
    if len(beside) < 2:
        return look
    below, at, above = (merits[other] for other in (beside[0], look, beside[1]))
    curvature = below - 2.0 * at + above
    if curvature >= 0.0:
        return look
    shift = min(max(0.5 * (below - above) / curvature, -0.5), 0.5)
    psf = look.psf_px * (beside[1].psf_px / look.psf_px) ** shift
    return EdgeLook(round(psf, 2), look.glow_px)
