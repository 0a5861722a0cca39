"""The planet: a sphere or an ellipsoid of revolution, and what its limb looks like.

Two verticals exist on an ellipsoid: geocentric nadir points to the centre, geodetic nadir along the
ellipsoid's normal; they differ by up to 0.19 deg on Earth. The visible limb lies `limb_height_m`
above the surface (air, cloud). ECEF: x through latitude 0, longitude 0, z through the north pole.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from horizon_sensor_ros.core.mathematics.attitude import require_vector

EARTH_RADIUS_M = 6371e3  # mean
_BOWRING_STEPS = 6


@dataclass(frozen=True)
class Planet:
    """A planet's figure.

    radius_m : of the sphere, or the ellipsoid's equatorial radius. limb_height_m : of the visible
    limb above the surface. flattening : 0 for a sphere. has_air : whether there may be air, which
    hides ground, lifts limbs and glows; what it may do is as if it were the Earth's.
    Raises ValueError for a radius that is not positive, a flattening outside [0, 1), or a limb
    below the centre.
    """

    radius_m: float = EARTH_RADIUS_M
    limb_height_m: float = 0.0
    flattening: float = 0.0
    has_air: bool = True

    def __post_init__(self) -> None:
        if not (np.isfinite(self.radius_m) and self.radius_m > 0):
            raise ValueError(f"planet radius must be positive, got {self.radius_m} m")
        if not (np.isfinite(self.flattening) and 0 <= self.flattening < 1):
            raise ValueError(f"flattening must be in [0, 1), got {self.flattening}")
        if not (np.isfinite(self.limb_height_m) and self.limb_height_m > -self.polar_radius_m):
            raise ValueError(f"limb height must be above the centre, got {self.limb_height_m} m")

    @classmethod
    def wgs84(cls, limb_height_m: float = 0.0) -> Planet:
        """Earth as WGS84's ellipsoid."""
        return cls(6378137.0, limb_height_m, 1 / 298.257223563)

    @property
    def polar_radius_m(self) -> float:
        """Polar radius."""
        return self.radius_m * (1 - self.flattening)

    @property
    def mean_radius_m(self) -> float:
        """(2 a + b) / 3: radius of the sphere that stands for an ellipsoid in a fit."""
        return self.radius_m * (1 - self.flattening / 3)

    @property
    def limb_radius_m(self) -> float:
        """Radius of the visible limb of that sphere."""
        return self.mean_radius_m + self.limb_height_m

    # ------------------------------------------------------------------ sphere

    def rho_from_altitude(self, altitude_m: float) -> float:
        """Angular radius of the disc, ``sin rho = R_limb / (R + H)``, seen from an altitude above
        R.

        R is `mean_radius_m`. NaN when the altitude is below the limb.
        """
        sine = self.limb_radius_m / (self.mean_radius_m + altitude_m)
        return float(np.arcsin(sine)) if 0 < sine <= 1 else np.nan

    def altitude_from_rho(self, rho_rad: float) -> float:
        """Inverse of `rho_from_altitude`; NaN outside (0, pi/2]."""
        if not 0 < rho_rad <= np.pi / 2:
            return np.nan
        return float(self.limb_radius_m / np.sin(rho_rad) - self.mean_radius_m)

    def altitude_slope(self, rho_rad: float) -> float:
        """d altitude / d rho, metres per radian (negative)."""
        return float(-self.limb_radius_m * np.cos(rho_rad) / np.sin(rho_rad) ** 2)

    # ------------------------------------------------------------------ positions

    def geodetic_from_ecef(self, position_ecef: np.ndarray) -> tuple[float, float, float]:
        """Geodetic latitude (rad), longitude (rad) and height above the surface (m) of (3,), m.

        Raises ValueError for what is no position outside the centre, as all that take one do.
        Source: Bowring 1976, iterated to rounding (some nanometres) from half-way to the centre
        outwards, up to a flattening of 0.2; nearer to it flatter planets have no one normal.
        """
        x, y, z = require_position(position_ecef, "position_ecef").tolist()
        a, b = self.radius_m, self.polar_radius_m
        e2 = 1 - (b / a) ** 2
        axis_distance = math.hypot(x, y)
        reduced = math.atan2(a * z, b * axis_distance)
        latitude = reduced
        for _ in range(_BOWRING_STEPS):
            latitude = math.atan2(
                z + e2 / (1 - e2) * b * math.sin(reduced) ** 3,
                axis_distance - e2 * a * math.cos(reduced) ** 3,
            )
            reduced = math.atan2(b * math.sin(latitude), a * math.cos(latitude))
        # The distance along the normal, well conditioned at the poles as at the equator.
        height = (axis_distance - a * math.cos(reduced)) * math.cos(latitude) + (
            z - b * math.sin(reduced)
        ) * math.sin(latitude)
        return latitude, math.atan2(y, x), height

    def ecef_from_geodetic(
        self, latitude_rad: float, longitude_rad: float, height_m: float
    ) -> np.ndarray:
        """Position (3,), m, of a geodetic latitude, longitude and height above the surface."""
        b_over_a2 = (1 - self.flattening) ** 2
        sin_latitude, cos_latitude = np.sin(latitude_rad), np.cos(latitude_rad)
        normal = self.radius_m / np.sqrt(cos_latitude**2 + b_over_a2 * sin_latitude**2)
        horizontal = (normal + height_m) * cos_latitude
        return np.array(
            [
                horizontal * np.cos(longitude_rad),
                horizontal * np.sin(longitude_rad),
                (b_over_a2 * normal + height_m) * sin_latitude,
            ]
        )

    def nadir_ecef(self, position_ecef: np.ndarray, vertical: str = "geocentric") -> np.ndarray:
        """Nadir (3,), unit, at a position (3,), m; vertical is "geocentric" or "geodetic", else
        ValueError.
        """
        position = require_position(position_ecef, "position_ecef")
        if vertical == "geocentric":
            return -position / np.linalg.norm(position)
        if vertical == "geodetic":
            latitude, longitude, _ = self.geodetic_from_ecef(position)
            return -np.array(
                [
                    np.cos(latitude) * np.cos(longitude),
                    np.cos(latitude) * np.sin(longitude),
                    np.sin(latitude),
                ]
            )
        raise ValueError(f'vertical must be "geocentric" or "geodetic", got {vertical!r}')

    # ------------------------------------------------------------------ the limb of the ellipsoid

    def limb_cone_ecef(self, position_ecef: np.ndarray) -> np.ndarray:
        """Quadric matrix (3, 3) of the cone of limb rays seen from a position (3,), m.

        A ray u from there grazes the limb when ``u^T M u = 0``, meets the planet (before or behind)
        when it is positive, and misses it when negative. The limb is taken on the ellipsoid whose
        two semi-axes are longer by the limb height. Lengths are scaled by its equatorial radius, so
        M is without dimension. NaN for a position inside.
        Source: Christian & Robinson 2016: ``M = A p p^T A - (p^T A p - 1) A``.
        """
        shape, position = self._scaled_limb(position_ecef)
        pole = shape * position
        power = position @ pole - 1.0
        if power <= 0:
            return np.full((3, 3), np.nan)
        return np.outer(pole, pole) - power * np.diag(shape)

    def limb_rays_ecef(self, position_ecef: np.ndarray, azimuth_rad: np.ndarray) -> np.ndarray:
        """Unit rays (N, 3) of the ellipsoid's limb seen from a position (3,), m.

        azimuth_rad (N,) : about geocentric nadir, 0 towards the north pole, pi/2 towards the east
        (on the poles' axis: those of longitude 0). NaN for a position inside the limb's ellipsoid.
        """
        position = require_position(position_ecef, "position_ecef")
        cone = self.limb_cone_ecef(position)
        nadir = -position / np.linalg.norm(position)
        east = np.cross([0.0, 0.0, 1.0], position)
        if np.linalg.norm(east) < 1e-9 * np.linalg.norm(position):
            east = np.array([0.0, 1.0, 0.0])
        east /= np.linalg.norm(east)
        north = np.cross(east, nadir)
        azimuth = np.asarray(azimuth_rad, dtype=float).reshape(-1, 1)
        outward = np.cos(azimuth) * north + np.sin(azimuth) * east
        # cone along cos(t) nadir + sin(t) outward: a quadratic in cot(t)
        along = nadir @ cone @ nadir
        mixed = outward @ cone @ nadir
        across = np.einsum("ij,ij->i", outward @ cone, outward)
        with np.errstate(invalid="ignore"):
            cotangent = (-mixed + np.sqrt(mixed * mixed - along * across)) / along
        rays = cotangent[:, None] * nadir + outward
        return rays / np.linalg.norm(rays, axis=1, keepdims=True)

    def _scaled_limb(self, position_ecef: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Diagonal of the limb ellipsoid's matrix and the position, in units of its equator."""
        position = require_position(position_ecef, "position_ecef")
        equator = self.radius_m + self.limb_height_m
        pole = self.polar_radius_m + self.limb_height_m
        return np.array([1.0, 1.0, (equator / pole) ** 2]), position / equator


def require_position(position: np.ndarray, name: str) -> np.ndarray:
    """Return a position as a float (3,) array; ValueError, with its name, when it is not finite, or
    the planet's centre.
    """
    place = require_vector(position, name, "metres")
    if not place.any():
        raise ValueError(f"{name} must not be the planet's centre")
    return place
