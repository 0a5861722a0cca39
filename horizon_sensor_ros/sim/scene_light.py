"""What lies along lines of sight from one place: ground, clouds, air and airglow, and how bright.

The planet is the unit sphere in a space that is scaled by its axes; an uneven limb moves where it
begins.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from horizon_sensor_ros.sim.air import airglow_layer, glow_above_limb, glow_inside_limb
from horizon_sensor_ros.sim.cloud_texture import city_brightness, cloud_brightness
from horizon_sensor_ros.sim.earth_scene import EarthScene
from horizon_sensor_ros.sim.smooth_texture import smooth_field

# Half-widths of the terminator in the cosine of the Sun's zenith angle: on the ground, and in air.
_TWILIGHT, _AIR_TWILIGHT = 0.02, 0.12
_DARKEST_GROUND = 0.08  # of smooth ground, over its mean brightness
# Waves of an uneven limb, in planet radii, and how high and low they go.
_UNEVEN_WAVES, _UNEVEN_SIGMAS = (0.03, 1.0), 5.0
_FAINTEST_AIR = 12.0  # scale heights up to which the air's glow is drawn
PIECE = 16384  # lines of sight that are drawn at a time: what is made of them stays in the cache


@dataclass(frozen=True, eq=False)
class Sight:
    """Lines of sight in the space where the planet is the unit sphere.

    rays (N, 3) : unit, scaled space, each coordinate in one piece; cos_nadir (N,) : of their angle
    to its centre; excess (N,) : cos_nadir minus that of the limb, positive on the planet.
    """

    rays: np.ndarray
    cos_nadir: np.ndarray
    excess: np.ndarray

    def take(self, which: np.ndarray) -> Sight:
        """Return those of a mask (N,)."""
        if which.all():
            return self
        index = np.flatnonzero(which)
        rays = self.rays.T.take(index, axis=1).T
        return Sight(rays, self.cos_nadir[index], self.excess[index])


class SceneLight:
    """Brightness of a scene along lines of sight from one place, position_ecef_m (3,), m.

    ValueError for a place inside the planet.
    """

    def __init__(self, scene: EarthScene, position_ecef_m: np.ndarray) -> None:
        self.scene = scene
        planet = scene.planet
        surface = np.array([planet.radius_m, planet.radius_m, planet.polar_radius_m])
        self.axes = surface + planet.limb_height_m
        self.position = position_ecef_m
        self.origin = position_ecef_m / self.axes
        self.distance = float(np.linalg.norm(self.origin))
        if not self.distance > 1.0:
            raise ValueError(f"position_ecef_m must lie outside the planet, got {position_ecef_m}")
        self.nadir = -self.origin / self.distance
        self.cos_rho = float(np.sqrt(1.0 - 1.0 / self.distance**2))
        self.radius_m = float(self.axes[0])
        self.sun = None if scene.sun_direction is None else np.array(scene.sun_direction)
        self.lamp = None if scene.even_light else self.sun

    def sight(self, rays_world: np.ndarray) -> Sight:
        """Lines of sight along rays (N, 3), of the world."""
        rays = _unit(rays_world / self.axes)
        cos_nadir = rays @ self.nadir
        sight = Sight(rays, cos_nadir, cos_nadir - self.cos_rho)
        if self.scene.limb_uneven_m > 0.0:
            self._raise(sight)
        return sight

    def _raise(self, sight: Sight) -> None:
        """Make the limb uneven, where rays are near it."""
        most = _UNEVEN_SIGMAS * self.scene.limb_uneven_m / self.radius_m
        sine = self.distance * np.sqrt(np.maximum(1.0 - sight.cos_nadir**2, 0.0))
        near = np.abs(sine - 1.0) < most
        seed = self.scene.texture_seed
        waves = smooth_field(self._lowest(sight.take(near)), seed, _UNEVEN_WAVES).astype(float)
        limb = (1.0 + self.scene.limb_uneven_m / self.radius_m * waves) / self.distance
        cos_limb = np.sqrt(np.maximum(1.0 - limb * limb, 0.0))
        sight.excess[near] = sight.cos_nadir[near] - cos_limb

    @property
    def has_air(self) -> bool:
        """Whether there is anything to be seen beside the planet."""
        return self.scene.air_dn > 0.0 or self.scene.airglow_dn > 0.0

    def hits(self, rays_world: np.ndarray) -> np.ndarray:
        """Which of the rays (N, 3), of the world, meet the planet."""
        return self.sight(rays_world).excess > 0.0

    def surface(self, sight: Sight) -> np.ndarray:
        """Brightness (N,) where rays meet the planet; at the limb's point for rays that miss it."""
        scene = self.scene
        along = sight.cos_nadir * self.distance
        root = np.sqrt(np.maximum(along * along - (self.distance**2 - 1.0), 0.0))
        points = _unit(self.origin + (along - root)[:, None] * sight.rays)
        if scene.texture == "clouds":
            light = cloud_brightness(
                points, scene.texture_seed, scene.cloud_cover, scene.ground_dn, scene.cloud_dn
            )
            if scene.cloud_contrast != 1.0:
                middle = np.float32(scene.uniform_dn)
                light = middle + np.float32(scene.cloud_contrast) * (light - middle)
        elif scene.texture == "smooth":
            field = smooth_field(points, scene.texture_seed)
            light = np.float32(scene.uniform_dn) * (1.0 + np.float32(scene.smooth_contrast) * field)
            light = np.maximum(light, np.float32(_DARKEST_GROUND * scene.uniform_dn))
        else:
            light = np.full(len(points), scene.uniform_dn, np.float32)
        if self.lamp is not None:
            cos_sun = self._normals(points) @ self.lamp
            day = _sine(cos_sun, _TWILIGHT)
            light = light * np.maximum(day**0.7, scene.night_light).astype(np.float32)
            if scene.city_dn > 0.0:
                dark = np.clip(-(cos_sun + 0.05) * 10.0, 0.0, 1.0)
                city = city_brightness(points, scene.texture_seed)
                light += city * (scene.city_dn * dark).astype(np.float32)
        if scene.air_dn > 0.0:
            impact = self.distance * np.sqrt(np.maximum(1.0 - sight.cos_nadir**2, 0.0))
            glow = glow_inside_limb(
                np.maximum(1.0 - impact, 0.0) * self.radius_m,
                along * self.radius_m,
                (self.distance - 1.0) * self.radius_m,
                scene.air_scale_height_m,
                self.radius_m,
            )
            shown, left = _through_air(scene.air_inside * glow, scene.air_depth)
            shown *= scene.air_dn * self._air_light(points, sight.rays)
            light = light * left.astype(np.float32) + shown.astype(np.float32)
        if scene.airglow_dn > 0.0:
            # The ground hides the far half of the layer.
            depth = (1.0 - self.distance * np.sqrt(1.0 - sight.cos_nadir**2)) * self.radius_m
            layer = airglow_layer(-depth, self._airglow_m(sight), scene.airglow_thickness_m)
            light += (0.5 * scene.airglow_dn * layer).astype(np.float32)
        return light

    def sky(self, sight: Sight) -> np.ndarray:
        """Brightness (N,) of the air along rays beside the planet (rays on it count as grazing)."""
        scene = self.scene
        out = np.zeros(len(sight.rays), np.float32)
        sin_nadir = np.sqrt(np.maximum(1.0 - sight.cos_nadir**2, 0.0))
        height = np.maximum(self.distance * sin_nadir - 1.0, 0.0) * self.radius_m
        ahead = self.distance * sight.cos_nadir * self.radius_m
        # a ray that looks up from inside the air has its lowest point at the camera
        camera_height = (self.distance - 1.0) * self.radius_m
        up = ahead < 0.0
        top = _FAINTEST_AIR * scene.air_scale_height_m
        if scene.air_dn > 0.0:
            near = (height < top) & (~up | (camera_height < top))
            glow = glow_above_limb(
                height[near], ahead[near], scene.air_scale_height_m, self.radius_m
            )
            seen = sight.take(near)
            shown, _ = _through_air(glow, scene.air_depth)
            out[near] += scene.air_dn * shown * self._air_light(self._lowest(seen), seen.rays)
        if scene.airglow_dn > 0.0:
            near = ~up & (height < scene.airglow_height_m + 4.0 * scene.airglow_thickness_m)
            layer_m = self._airglow_m(sight.take(near))
            layer = airglow_layer(height[near], layer_m, scene.airglow_thickness_m)
            out[near] += (scene.airglow_dn * layer).astype(np.float32)
        return out

    def _airglow_m(self, sight: Sight) -> np.ndarray | float:
        """Height of the layer of airglow where rays come nearest to the planet."""
        scene = self.scene
        if scene.airglow_uneven_m == 0.0:
            return scene.airglow_height_m
        waves = smooth_field(self._lowest(sight), scene.texture_seed)
        return scene.airglow_height_m + scene.airglow_uneven_m * waves.astype(np.float64)

    def _lowest(self, sight: Sight) -> np.ndarray:
        """Directions (N, 3) of the rays' points nearest to the planet's centre."""
        points = self.origin + (sight.cos_nadir * self.distance)[:, None] * sight.rays
        return _unit(points)

    def _normals(self, points: np.ndarray) -> np.ndarray:
        return _unit(points / self.axes)

    def _air_light(self, points: np.ndarray, rays: np.ndarray) -> np.ndarray | float:
        """Share of sunlight that the air over surface points gets, twilight included, and scatters
        against rays (N, 3).
        """
        if self.lamp is None:
            return 1.0
        cos_sun = self._normals(points) @ self.lamp
        if self.scene.air_light == "sine":
            day = _sine(cos_sun, _AIR_TWILIGHT)
        else:
            day = np.clip((cos_sun + 0.10) / 0.35, 0.0, 1.0)
            day = day * day * (3.0 - 2.0 * day)
        light = np.maximum(day, self.scene.night_light)
        scattered = 0.75 * (1.0 + np.square(rays @ self.lamp)) - 1.0
        return np.asarray(light * (1.0 + self.scene.air_rayleigh * scattered))


def turned(rays: np.ndarray, rot: np.ndarray) -> np.ndarray:
    """Rays (N, 3), turned; each coordinate in one piece."""
    return (rot @ rays.T).T


def pieces(count: int, size: int = PIECE) -> Iterator[slice]:
    """Slices of so many lines of sight that are drawn at a time."""
    return (slice(first, first + size) for first in range(0, count, size))


def _unit(vectors: np.ndarray) -> np.ndarray:
    """The vectors (N, 3), made unit vectors in place."""
    vectors /= np.sqrt(np.einsum("ij,ij->i", vectors, vectors))[:, None]
    return vectors


def _sine(cos_sun: np.ndarray, width: float) -> np.ndarray:
    """Cosines of the Sun's zenith angle (N,) by day; by night none, with a soft transition."""
    return np.asarray(0.5 * (cos_sun + np.sqrt(cos_sun * cos_sun + width**2)))


def _through_air(column: np.ndarray, depth: float) -> tuple[np.ndarray, np.ndarray]:
    """What columns (N,) of air show, over the brightest they may, and the share of what lies behind
    that they let through; of air without depth, over the grazing ray's, and all.
    """
    if depth == 0.0:
        return column, np.ones(1)
    left = np.exp(-depth * column)
    return 1.0 - left, left
