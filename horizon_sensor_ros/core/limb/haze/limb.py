"""The limb under air so thick that it hides the ground.

By daylight the real Earth's ground is not seen at its limb: along a ray that grazes it the air's
optical depth is 4 in red light, 7 in green and 15 in blue. What shows is the air itself, d pixels
outwards as bright as

    I(d) = background + level * (1 - exp(-exp((e - d) / L))),

blurred. L is the scale height, and e the place where the optical depth is one, one to three scale
heights above the ground, the same all along the limb. Ground shines through from about a scale
height below that on. L is nearly known beforehand, as an angle: so profiles are sampled by angle,
and in an image that is reduced until L is some three pixels.
Source: derived here; Gumbel's law is what an exponential atmosphere absorbs.
"""

from __future__ import annotations

import math

import numpy as np

from horizon_sensor_ros.core.limb.edge.looks import USUAL_PSF_PX, rate_looks
from horizon_sensor_ros.core.limb.edge.model import EdgeLook
from horizon_sensor_ros.core.limb.edge.places import place_edges
from horizon_sensor_ros.core.limb.edge_by_edge.edges import believable
from horizon_sensor_ros.core.limb.glow.white_air import of_white_air
from horizon_sensor_ros.core.limb.haze.sample import HazySample
from horizon_sensor_ros.core.limb.profiles import scatter_px
from horizon_sensor_ros.core.limb.sample import MIN_PROFILES
from horizon_sensor_ros.core.limb_points import LimbPoints, SharedError
from horizon_sensor_ros.core.mathematics.robust import median
from horizon_sensor_ros.core.status import Status

LENGTHS = 1.15 ** np.arange(-3.0, 4.0)  # scale heights that are tried, over the usual one
# Steepest fall over two pixels, in scale heights, over the whole fall, from so many of these inside
# to so many outside: .74 in haze, .64 to .86 where some texture shows; sharp edges fall faster.
# From within the air, where some of the ground shines through it, or what is brightest is clipped,
# up to 1.2; ground that shows as such 1.4 and more.
_STEEPNESS_WITHIN = 1.2
_STEEPNESS, _FROM, _TO, _LEAST_FROM_PX, _LEAST_TO_PX = 0.95, 1.5, 3.0, 2, 3
_OTHERS = (
    *(EdgeLook(USUAL_PSF_PX, length) for length in (1.0, 1.6, 2.5)),
    *(EdgeLook(psf, 0.0) for psf in (USUAL_PSF_PX, 1.2, 1.8, 2.5)),
)
# Lenses are in focus, as a rule: by how much likelier a blurred edge has to be than a limb in air.
_BLURRED_PX, _IN_FOCUS = 1.5, 100.0
# Errors of stretches, of the whole limb and of its ends, over the scale height: four to eight times
# what they are beside the truth of simulated limbs, whose air is the same everywhere.
_SHARED = SharedError(0.09, 0.09, 0.06)
# Jumps between neighbouring stretches, over the scale height: more than air makes, whose depth does
# not depend on the ground below it. Where ground shines through, limbs lie off by as much more.
_EVEN = 0.06
ABOVE_M = 17e3  # how far above the ground such a limb may lie, which the frame does not tell
THINNEST_PX = 0.8  # scale height in the full image from which on thick air is told from a blur
_LEAST_SIGMA_PX = 0.02


def may_be_haze(sample: HazySample, length_px: float) -> bool:
    """Whether edges are as soft as air makes them. length_px : as of `rate_haze`."""
    profiles = sample.profiles
    fall = profiles[:, :-2] - profiles[:, 2:]
    rows, steepest = np.arange(len(fall)), fall.argmax(axis=1)
    inner = steepest + 1 - max(round(_FROM * length_px), _LEAST_FROM_PX)
    outer = steepest + 1 + max(round(_TO * length_px), _LEAST_TO_PX)
    inside = profiles[rows, np.maximum(inner, 0)]
    outside = profiles[rows, np.minimum(outer, profiles.shape[1] - 1)]
    share = fall[rows, steepest] / np.maximum(inside - outside, sample.noise)
    most = _STEEPNESS if sample.warp is None else _STEEPNESS_WITHIN
    return bool(median(share) * length_px < most)


def rate_haze(sample: HazySample, length_px: float) -> np.ndarray:
    """By how much hazy air of each of `LENGTHS` makes profiles likelier than any other edge does:
    logarithms (K,).

    length_px : of the usual scale height, in the reduced image.
    """
    # Lengths that are the same from frame to frame: tables of them are kept.
    step = math.log(LENGTHS[1] / LENGTHS[0])
    low, high = (math.log(LENGTHS[end] * length_px) / step for end in (0, -1))
    ladder = np.arange(math.floor(low), math.ceil(high) + 1)
    hazy = [haze_look(math.exp(step * rung)) for rung in ladder.tolist()]
    merit = rate_looks(sample.profiles, sample.noise, [*hazy, *_OTHERS], sample.grid)
    blurred = np.array([look.psf_px > _BLURRED_PX for look in _OTHERS])
    better = merit[: len(hazy)] - (merit[len(hazy) :] - _IN_FOCUS * blurred).max()
    return np.interp(np.linspace(low, high, len(LENGTHS)), ladder, better)


def haze_look(length_px: float) -> EdgeLook:
    """Look of an edge in air of such a scale height."""
    return EdgeLook(USUAL_PSF_PX, round(length_px, 2), haze=True)


def hazy_limb(sample: HazySample, look: EdgeLook) -> LimbPoints:
    """Limb points of a sample, where the air's optical depth is one."""
    places = place_edges(sample.profiles, sample.noise, look, sample.grid)
    good = believable(places)
    if np.count_nonzero(good) < MIN_PROFILES:
        reason = f"{np.count_nonzero(good)} of {len(good)} profiles across the limb show an edge"
        return LimbPoints.none(Status.NO_LIMB, reason)
    step_px = np.linalg.norm(sample.curve.normal_px[good], axis=1)
    unit = sample.curve.normal_px[good] / step_px[:, None]
    offset_px = sample.offset_px(places.offset_px[good]) * step_px * sample.factor
    size_px = look.glow_px * sample.factor
    jumps_px = scatter_px(places.offset_px[good]) * sample.factor
    along_rad = len(step_px) * sample.stretch_px * sample.pixel_rad
    # The law's place is then where air comes down to white, not where its optical depth is one.
    by_white = of_white_air(sample.white_share, along_rad, sample.rho_rad, size_px)
    return LimbPoints(
        Status.OK,
        px=sample.curve.px[good] + offset_px[:, None] * unit,
        normal_px=unit,
        sigma_px=np.hypot(places.sigma_px[good], _LEAST_SIGMA_PX) * step_px * sample.factor,
        shared=_SHARED.times(max(size_px, jumps_px / _EVEN)).besides(by_white),
        spacing_px=sample.stretch_px * sample.factor,
        jumps_px=jumps_px,
        predicted=sample.predicted,
        offset_px=offset_px,
        above_m=ABOVE_M,
    )
