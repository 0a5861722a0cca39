"""A limb whose height differs from place to place, as cloud tops and haze make it.

Heights are a random field along the ground, with an exponential correlation. What of it is as long
as the limb in a frame is taken for another nadir and altitude, and shows in no residual: how uneven
a planet's limb is has to be told.
Source: derived here; that horizons differ with the weather, as much as with season and latitude:
Empirical correction for earth sensor horizon radiance variation, 1998, of infrared ones.
"""

from __future__ import annotations

import math

import numpy as np

# Along so much ground the height becomes another one: the size of weather systems.
_SCALE_M = 500e3


def heights_alike(
    rays: np.ndarray, nadir: np.ndarray, rho_rad: float, radius_m: float
) -> np.ndarray:
    """Correlation (N, N) of the limb's height where rays (N, 3), at an angle of rho from nadir
    (3,), graze it.
    """
    level = rays - (rays @ nadir)[:, None] * nadir
    level /= np.linalg.norm(level, axis=1)[:, None]
    # From the planet's centre.
    place = math.cos(rho_rad) * level - math.sin(rho_rad) * nadir
    away_m = radius_m * np.arccos(np.clip(place @ place.T, -1.0, 1.0))
    return np.asarray(np.exp(away_m * (-1.0 / _SCALE_M)))
