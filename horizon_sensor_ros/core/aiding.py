"""What is known from elsewhere when a set of frames is processed: position, altitude, rotation,
rate, time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from horizon_sensor_ros.core.mathematics.attitude import require_rotation, require_vector
from horizon_sensor_ros.core.planet import Planet, require_position

# Of a circular orbit at the surface of the Earth, by its density, which no other planet exceeds.
_ORBIT_RAD_S = 1.24e-3
# One sigma of how fast an orbit rises or sinks, over its speed: that of most low ones is less.
_RISING = 0.005


@dataclass(frozen=True)
class AltitudeMeasurement:
    """An altitude known from elsewhere, above the planet's surface, and its sigma.

    Raises ValueError for an altitude that is not finite or a sigma that is not positive.
    """

    altitude_m: float
    sigma_m: float

    def __post_init__(self) -> None:
        if not np.isfinite(self.altitude_m):
            raise ValueError(f"altitude_m must be finite, got {self.altitude_m}")
        if not (np.isfinite(self.sigma_m) and self.sigma_m > 0):
            raise ValueError(f"sigma_m must be positive, got {self.sigma_m}")


@dataclass(frozen=True, eq=False)
class CoarsePose:
    """Where the craft roughly is, and how it roughly lies.

    position_ecef_m : (3,). rot_ecef_from_base : (3, 3). position_sigma_m, rotation_sigma_rad : one
    sigma of either along, and about, each axis, at the time that it is of. age_s : between that
    time and the frames', before or after.
    Raises ValueError for what is no position outside the planet's centre, or no rotation
    (orthonormal to 1e-6, determinant +1).
    """

    position_ecef_m: np.ndarray
    rot_ecef_from_base: np.ndarray
    position_sigma_m: float = 50e3
    rotation_sigma_rad: float = float(np.radians(10.0))
    age_s: float = 0.0

    def __post_init__(self) -> None:
        position = require_position(self.position_ecef_m, "position_ecef_m")
        object.__setattr__(self, "position_ecef_m", _read_only(position))
        rot = require_rotation(self.rot_ecef_from_base, "rot_ecef_from_base")
        object.__setattr__(self, "rot_ecef_from_base", _read_only(rot))
        for name in ("position_sigma_m", "rotation_sigma_rad", "age_s"):
            if not 0.0 <= getattr(self, name) < np.inf:
                raise ValueError(f"{name} must be 0 or positive, got {getattr(self, name)}")

    @property
    def distance_m(self) -> float:
        """From the planet's centre."""
        return float(np.linalg.norm(self.position_ecef_m))

    def flown_rad(self, planet: Planet) -> float:
        """Return the angle by which a circular orbit goes around the planet within age_s."""
        radii = max(self.distance_m / planet.mean_radius_m, 1.0)
        return _ORBIT_RAD_S * radii**-1.5 * self.age_s

    def position_sigma_rad(self, planet: Planet) -> float:
        """One sigma of the position each way, as an angle, at the time of the frames."""
        # Along one of the two ways, nobody knows which.
        flown = self.flown_rad(planet) * math.sqrt(0.5)
        return math.hypot(self.position_sigma_m / self.distance_m, flown)

    def altitude(self, planet: Planet, sigma_m: float) -> AltitudeMeasurement:
        """Return its altitude at the time of the frames; sigma_m : one sigma at that of the pose.

        An orbit is no circle, and the surface below it, flattened, does not keep its distance from
        the centre. Which way the craft flew since nobody knows. Raises ValueError for a sigma that
        is not positive.
        """
        if not 0.0 < sigma_m < np.inf:
            raise ValueError(f"sigma_m must be positive, got {sigma_m}")
        latitude, _, altitude_m = planet.geodetic_from_ecef(self.position_ecef_m)
        flown = self.flown_rad(planet)
        rising_m = _RISING * self.distance_m * min(flown, 1.0)
        along = abs(math.sin(2.0 * latitude)) * math.sqrt(0.5) * flown + 0.5 * flown**2
        surface_m = planet.flattening * planet.radius_m * min(along, 0.5)
        return AltitudeMeasurement(altitude_m, math.hypot(sigma_m, rising_m, surface_m))


@dataclass(frozen=True, eq=False)
class Aiding:
    """What is known from elsewhere for one set of frames; None where it is not.

    coarse_pose : of the base frame in ECEF. altitude : a measurement of it. rot_now_from_last :
    (3, 3) takes the components of a vector that does not turn from the base frame at the last
    processed set to the base frame now (an integrated gyro). rate_base_rad_s : (3,) angular rate of
    the base frame in its own axes (a gyro), and rate_spread_rad_s, one sigma of it beside a gyro's
    own. since_last_s : time since the last processed set.
    Raises ValueError for a rot_now_from_last that is no rotation, a rate that is not (3,) and
    finite, a spread that is negative or not finite, or a time that is not positive.
    """

    coarse_pose: CoarsePose | None = None
    altitude: AltitudeMeasurement | None = None
    rot_now_from_last: np.ndarray | None = None
    rate_base_rad_s: np.ndarray | None = None
    rate_spread_rad_s: float = 0.0
    since_last_s: float | None = None

    def __post_init__(self) -> None:
        if self.rot_now_from_last is not None:
            rot = require_rotation(self.rot_now_from_last, "rot_now_from_last")
            object.__setattr__(self, "rot_now_from_last", _read_only(rot))
        if self.rate_base_rad_s is not None:
            rate = require_vector(self.rate_base_rad_s, "rate_base_rad_s", "rad/s")
            object.__setattr__(self, "rate_base_rad_s", _read_only(rate))
        if not 0.0 <= self.rate_spread_rad_s < np.inf:
            got = self.rate_spread_rad_s
            raise ValueError(f"rate_spread_rad_s must be 0 or positive, got {got}")
        if self.since_last_s is not None and not 0.0 < self.since_last_s < np.inf:
            raise ValueError(f"since_last_s must be positive, got {self.since_last_s}")


NOTHING_KNOWN = Aiding()


def _read_only(array: np.ndarray) -> np.ndarray:
    array.setflags(write=False)
    return array
