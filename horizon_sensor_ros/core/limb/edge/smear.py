"""Motion during the exposure: it smears a limb by as much as the limb lies across it.

A motion by m pixels adds m^2 / 12 to the square of the edge's blur along itself and nothing across,
so that the blur goes with twice the angle of the limb's normal.
A lens that is uneven, and texture, do so by chance. How likely it is that motion did is a matter of
odds, and what is not sure moves nothing, but is claimed.
Source: derived here; for odds by Bayes factors see Kass & Raftery 1995.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from horizon_sensor_ros.core.limb.edge.lens_blur import (
    MISJUDGED,
    UNEVEN_PX,
    of_either_lens,
    of_measured_lens,
)
from horizon_sensor_ros.core.limb.edge.raster import BLUR_SIGMA_PX
from horizon_sensor_ros.core.limb_points import CornerBlur
from horizon_sensor_ros.core.mathematics.odds import log_odds_of, share_of
from horizon_sensor_ros.core.mathematics.parts import starts_of_parts

_BLUR_SIGMA_PX = 0.03  # how well a limb's blur is known beforehand
# Error in common to a sixth of the limb, over one sigma of the lens's part: 2.4 would allow for its
# slope and bend whatever the lens; so much holds on average over even lenses and soft corners.
_OF_SIXTHS = 1.5
_SMEAR_SIGMA_PX = 0.3  # of what motion may add to it
_LEAST_INFORMATION = 1e-3  # px^-2
_PARTS = 12  # of a limb, in which edges may be wrong about their blur together
# Odds of a smear beforehand, and from how likely on what is seen is taken for one, not for an
# uneven lens. Where what is seen speaks against a smear there is none.
_LOG_ODDS, _SURE = log_odds_of(0.1), 0.9
# By how much more of it edges of one limb may be wider than others: motion by 2.5 px does that, and
# by more of it they are too wide to be looked at in the whole frame.
_MOST_PX = 0.3
# Blur that needs no motion: of optics and pixels, in a whole frame. What there is more of it may be
# a smear's, and may go with the direction by so large a share.
STILL_PX, _SMEARED_SHARE = 0.85, 0.5
_UNTOLD = 2.0  # times its sigma, what texture may hide of a smear


@dataclass(frozen=True, eq=False)
class Blur:
    """Correction of an assumed blur, pixels.

    lacking_px : (N,) true blur less the assumed one at each edge. open_px : one sigma of further
    parts that depend on the limb's direction, or grow away from the optical axis, and were not
    determined. corner : what is seen of the latter, if motion has no part in it.
    """

    lacking_px: np.ndarray
    open_px: float
    corner: CornerBlur | None = None


@dataclass(frozen=True, eq=False)
class Causes:
    """What changes the blur along a limb, rows (5, N): by how much each edge has of what is the
    same for all, of the raster's part, of the lens's, and of the two parts of a smear. corner_px :
    what the lens adds in the corners, if that is known.
    """

    rows: np.ndarray
    corner_px: float | None = None

    @classmethod
    def of(
        cls,
        normal_px: np.ndarray,
        raster: np.ndarray,
        cornered: np.ndarray,
        corner_px: float | None = None,
    ) -> Causes:
        """By normals (N, 2), `Raster.blur` (N,), and how far off the axis edges lie (N,), see
        `Stretches`.
        """
        x, y = normal_px.T
        # Cosine and sine of twice the normals' angle.
        rows = np.empty((_SEEN, len(x)))
        rows[_COMMON], rows[_RASTER], rows[_LENS] = 1.0, raster, cornered
        np.subtract(x * x, y * y, out=rows[3])
        np.multiply(2.0 * x, y, out=rows[4])
        return cls(rows, corner_px)


# Rows of `Causes`, and what is seen after them.
_COMMON, _RASTER, _LENS, _SMEAR, _SEEN = 0, 1, 2, (3, 4), 5
# Information on some of them beforehand.
_RASTER_BEFORE, _LENS_BEFORE = BLUR_SIGMA_PX**-2.0, UNEVEN_PX**-2.0


def blur_along(
    causes: Causes, lacking: np.ndarray, information: np.ndarray, assumed_px: float
) -> Blur:
    """What an assumed blur lacks at each edge: the same for all, what the raster makes of it, what
    the lens adds away from its axis, and what goes with the direction.

    lacking : (N,) what each edge says of it, and information : (N,) how well, by itself.
    """
    moments = _Moments(np.concatenate([causes.rows, lacking[None]]), information)
    if not moments.total > 0.0:
        return Blur(np.zeros(len(lacking)), 0.0)
    lens = _of_lens(moments, causes.corner_px)
    still = _of_motion(moments, lens.corners_px, assumed_px, with_lens=True)
    # What motion explains is not the lens's, which goes with the direction as much.
    moved = _of_motion(moments, 0.0, assumed_px, with_lens=False)
    evidence = still.evidence()
    if np.ptp(moved.smear[:_SEEN] @ causes.rows) < _MOST_PX:
        evidence = max(evidence, moved.evidence(lens.explained))
    share = share_of(_LOG_ODDS + evidence) if evidence >= 0.0 else 0.0
    sure = share > _SURE
    amounts = still.amounts
    amounts[_LENS] += lens.corners_px
    open2 = still.open_px**2 + lens.open_px**2
    if share > 0.0:
        off = moved.amounts + moved.smear - amounts
        open2 += share * (moved.sigma_px**2 - open2)
        open2 += (1.0 - share if sure else share) * moments.mean_square(off)
        amounts += sure * off
    amounts[_COMMON] -= amounts @ moments.mean
    return Blur(amounts[:_SEEN] @ causes.rows, math.sqrt(open2), None if sure else lens.seen)


class _Moments:
    """What edges tell of the causes, and what they see after them.

    total : of the information. mean (6,) : of what the edges have of each, but of what is the same
    for all, which has none. square (6, 6) : inner products of what they have off the mean; parted
    (6, 6) : of the sums of that over parts of the limb.
    """

    def __init__(self, rows: np.ndarray, information: np.ndarray) -> None:
        weighted = rows * information
        square = weighted @ rows.T
        self.total = float(square[_COMMON, _COMMON])
        if not self.total > 0.0:
            return
        self.mean = square[_COMMON] / self.total
        self.mean[_COMMON] = 0.0
        self.square = square - np.multiply.outer(self.mean, square[_COMMON])
        self.square[_COMMON, 1:] = 0.0
        self._num = min(_PARTS, rows.shape[1])
        first = starts_of_parts(rows.shape[1], self._num)
        sums = np.add.reduceat(weighted, first, axis=1)
        weight = np.maximum(sums[_COMMON], _LEAST_INFORMATION)
        sums -= np.multiply.outer(self.mean, sums[_COMMON])
        self.parted = (sums / weight) @ sums.T

    def mean_square(self, amounts: np.ndarray) -> float:
        """Mean square of what amounts (6,) of the causes make along the limb, off its mean."""
        off = amounts[:_SEEN]
        return max(float(off @ self.square[:_SEEN, :_SEEN] @ off), 0.0) / self.total

    def repetition(self, rest: np.ndarray) -> float:
        """How often edges say the same: what parts of a limb leave (6,), over chance."""
        return max(1.0, float(rest @ self.parted @ rest) / max(self._num - 3, 1))


class _OfLens(NamedTuple):
    """corners_px : how much the lens adds to the blur in the corners. open_px : one sigma of the
    error that this leaves in common to a sixth of the limb. seen : by what the limb shows alone.
    explained : of the cost of what is seen, by that.
    """

    corners_px: float
    open_px: float
    seen: CornerBlur
    explained: float


def _of_lens(moments: _Moments, corner_px: float | None) -> _OfLens:
    """What the lens adds to the blur. corner_px : as of `Causes`."""
    (_, raster, lens, *_, raster_seen), (_, _, square, *_, lens_seen) = moments.square[1:3].tolist()
    a, c = raster + BLUR_SIGMA_PX**-2.0, square + _LEAST_INFORMATION
    pixels, corners = _solved(a, lens, c, raster_seen, lens_seen)
    rest = np.array([0.0, -pixels, -corners, 0.0, 0.0, 1.0])
    variance = moments.repetition(rest) * a / (a * c - lens * lens)
    seen = CornerBlur(corners, math.sqrt(variance))
    explained = pixels * raster_seen + corners * lens_seen - raster_seen**2 / a
    if corner_px is None:
        corners, variance = of_either_lens(corners, variance)
    else:
        corners, variance = of_measured_lens(corners, variance, corner_px)
    open_px = _OF_SIXTHS * math.sqrt(variance * square / moments.total)
    return _OfLens(corners, open_px, seen, explained)


class _Motion(NamedTuple):
    """Blur by all but the lens, and by a smear.

    amounts (6,) : of each cause but a smear, off its mean. open_px : as of `Blur`, without one.
    smear (6,) : amounts by it. sigma_px : of what these add to the blur, RMS. explained : of the
    cost of what is seen, by a smear. repeated : how often edges say the same of it. narrowed :
    logarithm of what a smear may be beforehand, over what it may be by what is seen.
    """

    amounts: np.ndarray
    open_px: float
    smear: np.ndarray
    sigma_px: float
    explained: float
    repeated: float
    narrowed: float

    def evidence(self, otherwise: float = 0.0) -> float:
        """Logarithm of how much likelier this smear makes what is seen than none does, where
        something else explains so much of the cost.
        """
        return 0.5 * (self.explained - otherwise) / self.repeated - self.narrowed


def _of_motion(moments: _Moments, lens_px: float, assumed_px: float, *, with_lens: bool) -> _Motion:
    """What is the same for all edges, what the raster makes of it, and what goes with the
    direction.

    lens_px : what the lens adds to what is seen, in the corners. with_lens : whether it may add
    more along the limb than that.
    """
    square, total = moments.square.tolist(), moments.total
    mean = moments.mean.tolist()
    raster, lacking = mean[_RASTER], mean[_SEEN]
    of_raster, of_lens = square[_RASTER], square[_LENS]
    common, pixels = _solved(
        total + _BLUR_SIGMA_PX**-2.0,
        total * raster,
        of_raster[_RASTER] + total * raster**2 + BLUR_SIGMA_PX**-2.0,
        total * lacking,
        of_raster[_SEEN] - lens_px * of_raster[_LENS] + total * raster * lacking,
    )
    level = common + pixels * raster
    # What the raster or the lens may do is no smear.
    rows = np.zeros((3, 6))
    for row, own in enumerate(_SMEAR):
        by_raster = -of_raster[own] / (of_raster[_RASTER] + _RASTER_BEFORE)
        by_lens = 0.0
        if with_lens:
            by_lens = -(of_lens[own] + by_raster * of_lens[_RASTER])
            by_lens /= of_lens[_LENS] + _LENS_BEFORE
        rows[row, 1:3] = by_raster, by_lens
        rows[row, own] = 1.0
    rows[2] = lacking - level, -pixels, -lens_px, 0.0, 0.0, 1.0
    smears, rest = rows[:2], rows[2]
    (a, b, u), (_, c, v) = (smears @ moments.square @ rows.T).tolist()
    smear = np.array(_solved(a + _LEAST_INFORMATION, b, c + _LEAST_INFORMATION, u, v))
    repeated = MISJUDGED**2 * moments.repetition(rest - smear @ smears)
    before = repeated * _SMEAR_SIGMA_PX**-2.0
    along, across = _solved(a + before, b, c + before, u, v)
    # Root of the mean variance of what a smear adds.
    size = (a + before) * (c + before) - b * b
    spread = (c + before) * a - 2.0 * b * b + (a + before) * c
    sigma_px = math.sqrt(repeated * max(spread, 0.0) / (size * total))
    more = max(assumed_px + level - STILL_PX, 0.0)
    return _Motion(
        amounts=np.array([level, pixels, 0.0, 0.0, 0.0, 0.0]),
        open_px=min(_SMEARED_SHARE * more, _UNTOLD * sigma_px),
        smear=np.array([along, across]) @ smears,
        sigma_px=sigma_px,
        explained=along * u + across * v,
        repeated=repeated,
        narrowed=0.5 * math.log(size / before**2),
    )


def _solved(a: float, b: float, c: float, u: float, v: float) -> tuple[float, float]:
    """Solution of ``a x + b y = u, b x + c y = v``."""
    size = a * c - b * b
    return (c * u - b * v) / size, (a * v - b * u) / size
