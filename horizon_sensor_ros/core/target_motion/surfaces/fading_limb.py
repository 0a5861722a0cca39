"""Where a sensor loses a curved surface: seen too much at a slant it gives no return.

That is no edge of the body: it stays where it is seen while the body turns under it.
"""

from __future__ import annotations

import numpy as np

from horizon_sensor_ros.core.target_motion.surfaces.body_limb import LIMB_BEND, limb_reach_px
from horizon_sensor_ros.core.target_motion.surfaces.planes import Planes

# The share of the steepest planes that tells from which cosine on a sensor sees anything; and times
# that, the cosines of planes next to where it does not: they are of the surface farther in.
_STEEPEST, _NEAR = 0.005, 1.5
_LEAST_SLANT = np.cos(np.radians(50.0))  # any sensor sees what is seen less at a slant
# Farther in a surface has turned towards the sensor by so many of its standard deviations, and no
# less than this; or so many of them may hide that it has by more than the other.
_SURE, _LEAST_RAD = 3.0, np.radians(1.0)
_PERHAPS, _MOST_RAD = 2.0, np.radians(8.0)
_OFF = 3.0  # of one surface, times what noise and its bend may make
_FEWEST = 8  # ends that fade for sure, of a sensor that loses surfaces at all
_FARTHER_IN = 2, 3  # reaches of `limb_reach_px`


def fading_limb(
    planes: Planes, pixel: np.ndarray, across: np.ndarray, run: np.ndarray
) -> np.ndarray:
    """Which ends of surfaces (N,) may be where the sensor has lost a curved one.

    pixel : (N,) flat indices at the ends, over which ``across`` (2, N) leads. run : (N,) number of
    the run of places that each is of.
    They are as steep as anything is seen, and the surface farther in, all along the run, has turned
    towards the sensor, or too little is seen of it to tell.
    """
    fades = np.zeros(len(pixel), bool)
    if not planes.found.any():
        return fades
    steepest = float(np.quantile(planes.cosine[planes.found], _STEEPEST))
    if steepest > _LEAST_SLANT:
        return fades
    cosine = planes.cosine.ravel()[pixel]
    steep = np.flatnonzero(planes.found.ravel()[pixel] & (cosine < _NEAR * steepest))
    if not len(steep):
        return fades
    pixel, across, run = pixel[steep], across[:, steep], run[steep]
    sight = -planes.points[pixel].astype(float)
    sight /= np.sqrt((sight * sight).sum(axis=1))[:, None]
    side = np.column_stack([across.T, np.zeros(len(pixel))])
    side -= (side * sight).sum(axis=1)[:, None] * sight

    def slant(at: np.ndarray) -> np.ndarray:
        normal = planes.normals[at]
        return np.arctan2(np.abs((normal * side).sum(axis=1)), (normal * sight).sum(axis=1))

    def fall(at: np.ndarray) -> np.ndarray:
        return across[0] * planes.slope_u.ravel()[at] + across[1] * planes.slope_v.ravel()[at]

    level, noise = planes.level.ravel(), planes.noise.ravel()
    count = np.bincount(run)
    sure, perhaps = np.zeros((2, len(count)), bool)
    for reach in _FARTHER_IN:
        away_px = reach * limb_reach_px(planes.radius_px)
        du, dv = np.rint(across * away_px).astype(np.int64)
        inwards = np.clip(pixel - (dv * planes.found.shape[1] + du), 0, planes.found.size - 1)
        # On one surface, without a step, the falls at both ends tell what lies between.
        falls = fall(pixel), fall(inwards)
        off = level[inwards] - level[pixel] + away_px * 0.5 * (falls[0] + falls[1])
        may_be = _OFF * (noise[pixel] + 0.1 * away_px * np.abs(falls[0] - falls[1]))
        bend = np.einsum("ij,ij->i", planes.normals[pixel], planes.normals[inwards])
        known = planes.found.ravel()[inwards] & (bend > LIMB_BEND[1]) & (np.abs(off) < may_be)
        num = np.bincount(run, known, len(count))
        turned = known * (slant(pixel) - slant(inwards))
        mean = np.bincount(run, turned, len(count)) / np.maximum(num, 1)
        # Windows side by side share their returns.
        independent = np.maximum(num / (2 * planes.radius_px + 1), 1)
        sigma = planes.normal_noise_rad * np.sqrt(2 / independent)
        enough = num > 0.5 * count
        sure |= enough & (mean > np.maximum(_SURE * sigma, _LEAST_RAD))
        perhaps |= ~enough | (mean + _PERHAPS * sigma > _MOST_RAD)
    # Where nothing fades for sure faces are as steep as they are.
    fading = np.count_nonzero(sure[run]) >= _FEWEST
    fades[steep] = (sure | perhaps)[run] if fading else False
    return fades
