"""Ground that darkens towards its limb, and what that moves edges by.

By Lambert's law, and the more, the farther the Sun stands behind the craft, brightness rises with
the root of the depth below the limb, by as much all along it: little beside a limb that is seen
from near by, whose step is larger, much where the whole disc is small in the frame. To a model of
steps and texture such edges lie too far in, farthest where the step is lowest.
"""

from __future__ import annotations

import math

import numpy as np

from horizon_sensor_ros.core.limb.edge.near_edge import BESIDE_PX, DEEP_PX, mean_at
from horizon_sensor_ros.core.limb.profiles import ProfileGrid
from horizon_sensor_ros.core.limb_points import NOTHING_SHARED, STRETCHES, SharedError
from horizon_sensor_ros.core.mathematics.parts import stretches
from horizon_sensor_ros.core.mathematics.robust import median

# Errors of edges: of the whole limb with the square of the rise over the step, and of dark places
# beside the others with that and with its square. Beside the truth of 90 discs of 24 to 200 px in
# radius, by Lambert's and Minnaert's laws.
_HEIGHT_PX, _DARK_PX, _DARKER_PX = 2.0, 0.8, 4.0
# Radii of the limb up to which all of it counts, and from which on brightness rises by too little
# to move edges that a model places.
_SMALL_PX, _LARGE_PX = 100.0, 250.0
_MOST = 1.0  # of that rise
_MODEL_FREE = 2.0  # times these, where brightness falls most steeply and no model places edges


def darkening_error(
    profiles: np.ndarray,
    grid: ProfileGrid,
    step: np.ndarray,
    px_over_radius: float,
    *,
    model_free: bool,
) -> SharedError:
    """What edges share, in pixels of the profiles (N, J), where brightness rises below all of them.

    step : (N,) gray levels from space to the planet beside each edge. px_over_radius :
    `ground_across_px`. model_free : as of `LimbEdges`.
    """
    small = min((_LARGE_PX - 1.0 / px_over_radius) / (_LARGE_PX - _SMALL_PX), 1.0)
    if small <= 0.0 and not model_free:
        return NOTHING_SHARED
    rise = mean_at(profiles, grid, DEEP_PX) - mean_at(profiles, grid, BESIDE_PX)
    means = [float(part.mean()) for part in stretches(rise, STRETCHES) if len(part)]
    # Clouds are brighter here and darker there.
    by_chance = float(np.std(means)) / math.sqrt(max(len(means) - 1, 1))
    share = max(float(np.mean(means)) - by_chance, 0.0) / max(median(step), 1e-9)
    share = min(share, _MOST)
    error = SharedError(
        height_px=_HEIGHT_PX * share**2, dark_px=_DARK_PX * share + _DARKER_PX * share**2
    )
    return error.times(_MODEL_FREE if model_free else small)
