"""Motion during the exposure: it smears a limb by as much as the limb lies across it.

A motion by m pixels adds m^2 / 12 to the square of the edge's blur along itself and nothing across,
so that the blur goes with twice the angle of the limb's normal.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from horizon_sensor_ros.core.limb.edge.lens_blur import UNEVEN_PX, of_either_lens
from horizon_sensor_ros.core.limb.edge.raster import BLUR_SIGMA_PX

_BLUR_SIGMA_PX = 0.03  # how well a limb's blur is known beforehand
# Error in common to a sixth of the limb, over one sigma of the lens's part: 2.4 would allow for its
# slope and bend whatever the lens; so much holds on average over even lenses and soft corners.
_OF_SIXTHS = 1.5
_SMEAR_SIGMA_PX = 0.3  # of what motion may add to it
_LEAST_INFORMATION = 1e-3  # px^-2
_PARTS = 12  # of a limb, in which edges may be wrong about their blur together
_SURE = 40.0  # times its variance, the square of a smear that chance does not make
# Blur that needs no motion: of optics and pixels, in a whole frame. What there is more of it may be
# a smear's, and may go with the direction by so large a share.
_STILL_PX, _SMEARED_SHARE = 0.85, 0.5
_UNTOLD = 3.0  # times its sigma, what texture may hide of a smear


@dataclass(frozen=True)
class Blur:
    """Correction of an assumed blur, pixels.

    lacking_px : (N,) true blur less the assumed one at each edge. open_px : one sigma of further
    parts that depend on the limb's direction, or grow away from the optical axis, and were not
    determined.
    """

    lacking_px: np.ndarray
    open_px: float


def blur_along(
    normal_px: np.ndarray,
    raster: np.ndarray,
    cornered: np.ndarray,
    lacking: np.ndarray,
    information: np.ndarray,
    assumed_px: float,
) -> Blur:
    """What an assumed blur lacks at each edge: the same for all, what the raster makes of it, what
    the lens adds away from its axis, and what goes with the direction.

    normal_px : (N, 2). raster : (N,), `Raster.blur`. cornered : (N,), see `Stretches`. lacking :
    (N,) what each edge says of it, and information : (N,) how well, by itself.
    """
    total = float(information.sum())
    if not total > 0.0:
        return Blur(np.zeros(len(lacking)), 0.0)
    by_raster = _Cause.of(raster, information, total)
    by_lens = _Cause.of(cornered, information, total)
    lens, lens_px = _of_lens(by_raster, by_lens, lacking, information)
    seen = normal_px, raster, information
    found = _of_motion(seen, (by_raster, by_lens), lacking - lens, assumed_px)
    if found.sure:
        # What motion explains is not the lens's, which goes with the direction as much.
        found = _of_motion(seen, (by_raster,), lacking, assumed_px)
        return Blur(found.lacking_px, found.open_px)
    return Blur(found.lacking_px + lens, math.hypot(found.open_px, lens_px))


class _Cause(NamedTuple):
    """What changes the blur along a limb. off : (N,) by how much each edge has of it, off the mean;
    told : (N,) that times the information; square : their product.
    """

    off: np.ndarray
    told: np.ndarray
    square: float

    @classmethod
    def of(cls, each: np.ndarray, information: np.ndarray, total: float) -> _Cause:
        """Of a cause that edges have so much of (N,)."""
        off = each - float(each @ information) / total
        told = off * information
        return cls(off, told, float(told @ off))


def _of_lens(
    by_raster: _Cause, by_lens: _Cause, lacking: np.ndarray, information: np.ndarray
) -> tuple[np.ndarray, float]:
    """What the lens adds to the blur of each edge (N,), on the mean over them nothing, and one
    sigma of the error that this leaves in common to a sixth of the limb.
    """
    both = float(by_raster.told @ by_lens.off)
    a, c = by_raster.square + BLUR_SIGMA_PX**-2.0, by_lens.square + _LEAST_INFORMATION
    seen = float(by_raster.told @ lacking), float(by_lens.told @ lacking)
    pixels, corners = _solved(a, both, c, *seen)
    rest = lacking - pixels * by_raster.off - corners * by_lens.off
    rest -= float(information @ rest) / float(information.sum())
    variance = _repetition(rest, information) * a / (a * c - both * both)
    corners, variance = of_either_lens(corners, variance)
    spread2 = variance * by_lens.square / float(information.sum())
    return corners * by_lens.off, _OF_SIXTHS * math.sqrt(spread2)


class _Motion(NamedTuple):
    """`Blur` but for the lens; sure : whether motion smears the limb for sure."""

    lacking_px: np.ndarray
    open_px: float
    sure: bool


def _of_motion(
    seen: tuple[np.ndarray, np.ndarray, np.ndarray],
    others: tuple[_Cause, ...],
    lacking: np.ndarray,
    assumed_px: float,
) -> _Motion:
    """What is the same for all edges, what the raster makes of it, and what goes with the
    direction.

    seen : normals, raster and information as of `blur_along`. others : what besides changes the
    blur along the limb, raster first, then the lens.
    """
    normal_px, raster, information = seen
    weighted = information * raster
    total = float(information.sum())
    common, pixels = _solved(
        total + _BLUR_SIGMA_PX**-2.0,
        float(weighted.sum()),
        float(weighted @ raster) + BLUR_SIGMA_PX**-2.0,
        float(information @ lacking),
        float(weighted @ lacking),
    )
    known = common + pixels * raster
    design = _twice_the_angle(normal_px)
    design -= (design @ information / total)[:, None]
    # What the raster or the lens may do is no smear.
    for other, sigma_px in zip(others, (BLUR_SIGMA_PX, UNEVEN_PX), strict=False):
        aside_of = design @ other.told / (other.square + sigma_px**-2.0)
        design -= aside_of[:, None] * other.off
    weighted = design * information
    rest = lacking - known
    told = weighted @ rest
    normal = weighted @ design.T
    smear = _solved_with(normal, _LEAST_INFORMATION, told)
    repeated = _repetition(rest - smear @ design, information)
    before = repeated * _SMEAR_SIGMA_PX**-2.0
    smear = _solved_with(normal, before, told)
    sure = float(smear @ told) >= _SURE * repeated
    more = assumed_px + float(information @ known) / total - _STILL_PX
    if not sure and more <= 0.0:
        return _Motion(known, 0.0, False)
    # Root of the mean variance of what a smear adds.
    (a, b), (_, c) = normal.tolist()
    size = (a + before) * (c + before) - b * b
    spread = (c + before) * a - 2.0 * b * b + (a + before) * c
    open_px = math.sqrt(repeated * max(spread, 0.0) / (size * total))
    if sure:
        return _Motion(known + smear @ design, open_px, True)
    return _Motion(known, min(_SMEARED_SHARE * more, _UNTOLD * open_px), False)


def _repetition(rest: np.ndarray, information: np.ndarray) -> float:
    """How often edges say the same: what parts of a limb leave of a smear, over chance."""
    num = min(_PARTS, len(rest))
    first = np.arange(num) * len(rest) // num
    weight = np.add.reduceat(information, first)
    sums = np.add.reduceat(information * rest, first)
    chi2 = float(sums @ (sums / np.maximum(weight, _LEAST_INFORMATION)))
    return max(1.0, chi2 / max(num - 3, 1))


def _solved_with(normal: np.ndarray, before: float, told: np.ndarray) -> np.ndarray:
    """Solution (2,) of normal equations (2, 2) with so much information beforehand."""
    (a, b), (_, c) = normal.tolist()
    return np.array(_solved(a + before, b, c + before, *told.tolist()))


def _solved(a: float, b: float, c: float, u: float, v: float) -> tuple[float, float]:
    """Solution of ``a x + b y = u, b x + c y = v``."""
    size = a * c - b * b
    return (c * u - b * v) / size, (a * v - b * u) / size


def _twice_the_angle(normal_px: np.ndarray) -> np.ndarray:
    """Cosine and sine (2, N) of twice the angle of normals (N, 2)."""
    x, y = normal_px.T
    return np.array([x * x - y * y, 2.0 * x * y])
