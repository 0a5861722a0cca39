"""The limb that fits places of its edge, to first order, and what the raster does to these."""

from __future__ import annotations

import numpy as np

from horizon_sensor_ros.core.limb.edge.raster import PLACE_SIGMA_PX
from horizon_sensor_ros.core.mathematics.robust import median
from horizon_sensor_ros.core.mathematics.symmetric3 import inverse

_FAR_OFF = 6.0  # times the median distance, from which on an edge is not the limb's


def fitted_limb(base: np.ndarray, place: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Three unknowns of the limb (`Stretches.base`) from places (N,) and their sigmas (N,).

    Places that lie far off are left out.
    """
    weight = sigma**-2.0
    limb = _solved(base, place, weight)
    far = _far_off(base, place, limb)
    if not far.any():
        return limb
    weight[far] = 0.0
    return _solved(base, place, weight)


def limb_in_raster(
    base: np.ndarray, place: np.ndarray, variance: np.ndarray, raster: np.ndarray
) -> tuple[np.ndarray, float, float]:
    """`fitted_limb`, by what the raster moves edges for a unit of `Raster.place` (N,), and the
    variance of that.
    """
    weight = 1.0 / variance
    both = np.empty((len(place), 2))
    both[:, 0], both[:, 1] = place, raster
    limbs = _solved(base, both, weight)
    far = _far_off(base, place, limbs[:, 0])
    if far.any():
        weight[far] = 0.0
        limbs = _solved(base, both, weight)
    limb, feigned = limbs.T
    aside = weight * (raster - base @ feigned)
    # What a limb may feign is not the raster's for sure.
    variance_open = 1.0 / (float(aside @ raster) + PLACE_SIGMA_PX**-2.0)
    error = float(aside @ (place - base @ limb)) * variance_open
    return limb - error * feigned, error, variance_open


def _far_off(base: np.ndarray, place: np.ndarray, limb: np.ndarray) -> np.ndarray:
    off = np.abs(place - base @ limb)
    return np.asarray(off > _FAR_OFF * median(off))


def _solved(base: np.ndarray, places: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Unknowns (3, ...) of the limb that is nearest to places (N, ...)."""
    weighted = base.T * weight
    information = weighted @ base
    # Along a short arc the three are nearly one and the same.
    information.ravel()[::4] += 1e-9 * information[-1, -1]
    return np.asarray(inverse(information) @ (weighted @ places))
