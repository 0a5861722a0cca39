"""How fast the craft turns."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from horizon_sensor_ros.core.aiding import Aiding

# One sigma of a gyro's rate as that of the horizon, which itself turns by up to .07 deg/s along an
# orbit.
GYRO_SIGMA_RAD_S = math.radians(0.1)
SURE = 3.0  # times what a gyro may be off by: so far the craft turns for sure
NOT_TURNED = np.eye(3)
NOT_TURNED.setflags(write=False)


@dataclass(frozen=True, eq=False)
class TurnRate:
    """Angular rate (3,) of the base frame in its own axes, rad/s, that moves the horizon in it, and
    one sigma of each component. nadir_base : (3,) about which it is not known; None: it is.
    """

    rate_base_rad_s: np.ndarray
    sigma_rad_s: float
    nadir_base: np.ndarray | None = None


def surely_turns(rate_base_rad_s: np.ndarray) -> bool:
    """Whether the craft turns, by a gyro's rate (3,), rad/s."""
    return float(np.linalg.norm(rate_base_rad_s)) > SURE * GYRO_SIGMA_RAD_S


def rate_by_gyro(aiding: Aiding) -> TurnRate | None:
    """How fast the craft turns by the gyro, if there is one."""
    if aiding.rate_base_rad_s is None:
        return None
    return TurnRate(aiding.rate_base_rad_s, math.hypot(GYRO_SIGMA_RAD_S, aiding.rate_spread_rad_s))
