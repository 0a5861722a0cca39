"""How much air lies along rays from inside it, as from a balloon.

Far above the air brightness fades outwards evenly, by angle. From within it rays rise away from the
limb: d rad below the horizontal they pass (radius / 2) (d0^2 - d^2) above a limb at d0, and what
air lies between that place and the camera counts less. With u = d sqrt(radius / (2 scale height))
the optical depth goes with

    exp(u^2) (1 + erf(u)),

above the horizontal too, where u is below zero. Nothing but d0 has to be known for that: how high
the camera is above the limb follows from it.
Source: derived here, of an exponential atmosphere (Chapman's function for small angles).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from horizon_sensor_ros.core.limb.air import USUAL_HEIGHT
from horizon_sensor_ros.core.mathematics.normal_law import normal_cdf

_PER_RAD = math.sqrt(0.5 / USUAL_HEIGHT)
_ROOT_TWO, _ROOT_PI = math.sqrt(2.0), math.sqrt(math.pi)
_HIGHEST_RAD = math.radians(-6.0)  # below the horizontal: farther up rays say nothing of the limb
_WITHIN_RAD = 0.157  # depression of the Earth's limb 80 km up
# Of the lowest limb: nearer to the horizontal light changes too slowly across it.
LOWEST_RHO_RAD = 0.5 * math.pi - math.radians(1.8)
_NEWTON_STEPS = 8  # from the limb to ten scale heights beside it, to a millionth of one


def seen_from_within(rho_rad: float) -> bool:
    """Whether a limb of this radius is seen from within the air, or from just above it."""
    return 0.0 < 0.5 * math.pi - rho_rad < _WITHIN_RAD


class AirColumn(NamedTuple):
    """The air along rays near a limb that is seen so far (rad) below the horizontal."""

    depression_rad: float

    @property
    def length_rad(self) -> float:
        """Angle over which the optical depth at the limb falls to 1 / e."""
        return float(1.0 / (_PER_RAD * _slope(np.array(self.depression_rad * _PER_RAD))))

    @property
    def most(self) -> float:
        """Logarithm by which the optical depth falls from the limb to the highest ray."""
        here, there = _log_depth(np.array([self.depression_rad, _HIGHEST_RAD]) * _PER_RAD)
        return float(here - there)

    def outward_rad(self, falls: np.ndarray) -> np.ndarray:
        """How far (J,) outside the limb rays lie whose optical depth is lower by these logarithms
        (J,); negative inside.
        """
        start = self.depression_rad * _PER_RAD
        sought = _log_depth(np.array(start)) - falls
        u = np.full(np.shape(falls), start)
        for _ in range(_NEWTON_STEPS):
            u = u - (_log_depth(u) - sought) / _slope(u)
        return (start - u) / _PER_RAD


def _log_depth(u: np.ndarray) -> np.ndarray:
    return np.square(u) + np.log(normal_cdf(_ROOT_TWO * u))


def _slope(u: np.ndarray) -> np.ndarray:
    """Derivative of `_log_depth`."""
    return np.asarray(2.0 * u + np.exp(-np.square(u)) / (_ROOT_PI * normal_cdf(_ROOT_TWO * u)))
