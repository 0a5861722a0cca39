"""Air to begin a fit of limb and glow with, by the profiles beyond the edge."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from horizon_sensor_ros.core.limb.air import USUAL_HEIGHT, USUAL_SHARE, Air
from horizon_sensor_ros.core.limb.edge.model import EdgeLook
from horizon_sensor_ros.core.limb.glow.brightness import powers
from horizon_sensor_ros.core.limb.glow.sight import LEAST_STRETCHES, GlowSight
from horizon_sensor_ros.core.mathematics.robust import median
from horizon_sensor_ros.core.planet import EARTH_RADIUS_M

FROM_PX = 2.0  # beyond the edge, from where on there is hardly anything but glow
# Scale heights over the Earth's radius that are tried for the first guess.
_HEIGHTS = np.exp(np.linspace(np.log(4e3), np.log(16e3), 25)) / EARTH_RADIUS_M
_THIN_PX = 1.0  # length of glow, below which it hides in the blur and is guessed
_THIN_GLOW = 0.5  # that guess, over the brightness just beyond the edge
# Glow of a stretch over the median one, that may still be the same air's.
_FAINTEST = 0.2
_BRIGHTEST = 5.0
_MOST_MISFIT = 4.0  # of a stretch's glow, over the noise or the median stretch's
# A part of the craft before ground and sky: their difference in a stretch that it hides, at most,
# and how much brighter than other sky it is at least, both over the usual difference.
_FLAT, _BRIGHT = 0.4, 0.15
_FAR = 3  # pixels at a stretch's outer end that are taken for sky


class Guess(NamedTuple):
    """Air that fits the profiles beyond the edge, which of them show it, keep (M,), and how
    brightly each does, glow (M,).
    """

    air: Air
    keep: np.ndarray
    glow: np.ndarray


def first_guess(sight: GlowSight, look: EdgeLook, air: Air | None) -> Guess:
    """What to begin the steps with. air : as found so far, which is kept."""
    background = median(sight.profiles[:, -2:].ravel())
    if air is None and median(USUAL_HEIGHT / sight.rise) < _THIN_PX:
        glow = _THIN_GLOW * (sight.profiles[:, 1] - background)
        log_glow = np.array([math.log(max(median(glow), 1e-6)), 0.0, 0.0])
        thin = Air(USUAL_HEIGHT, log_glow, USUAL_SHARE, look.psf_px, background, look.psf_px)
        return Guess(thin, _in_sight(sight), glow)
    outer = sight.d_px >= FROM_PX
    profiles, distance = sight.profiles[:, outer], sight.distance[:, outer]
    # Where sight is such that no air fits, none shows.
    best, none = np.inf, np.zeros(len(sight))
    found = USUAL_HEIGHT, none, none + np.inf
    for height in _HEIGHTS if air is None else (air.height,):
        fall = np.exp(-distance * (sight.rise / height)[:, None])
        own = fall - fall.mean(axis=1, keepdims=True)
        glow = (profiles * own).sum(axis=1) / (own * own).sum(axis=1)
        left = profiles - glow[:, None] * fall
        left -= left.mean(axis=1, keepdims=True)
        misfit = np.sqrt(np.mean(left * left, axis=1))
        if median(misfit) < best:
            best, found = median(misfit), (float(height), glow, misfit)
    height, glow, misfit = found
    usual = max(median(glow), 1e-6)
    keep = (glow > _FAINTEST * usual) & (glow < _BRIGHTEST * usual)
    keep &= misfit < _MOST_MISFIT * max(sight.noise, best)
    log_glow = np.zeros(3)
    if air is None and np.count_nonzero(keep) >= LEAST_STRETCHES:
        log_glow = np.linalg.lstsq(powers(sight.along)[keep], np.log(glow[keep]), rcond=None)[0]
    psf_px = look.psf_px
    air = air or Air(height, log_glow, USUAL_SHARE, psf_px, background, psf_px)
    return Guess(air, keep, glow)


def _in_sight(sight: GlowSight) -> np.ndarray:
    """Which stretches (M,) no part of the craft hides, nor a neighbour of theirs: one does where it
    is as bright in the sky as before the ground. The Sun's glare is not: it adds to both.
    """
    sky = sight.profiles[:, -_FAR:].mean(axis=1)
    fall = sight.profiles[:, sight.d_px < 0.0].mean(axis=1) - sky
    usual = median(fall)
    hidden = (fall < _FLAT * usual) & (sky - median(sky) > max(_BRIGHT * usual, 6.0 * sight.noise))
    beside = hidden.copy()
    beside[1:] |= hidden[:-1]
    beside[:-1] |= hidden[1:]
    return ~beside
