"""Earth camera: draws what a camera at a known pose sees of a planet, with truth for each frame.

The limb is drawn by area: pixels that it touches are supersampled 8 x 8, and each sample carries
the share of its own little square that lies on the planet. All other pixels are sampled once.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.sim.air import airglow_layer, glow_above_limb, glow_inside_limb
from horizon_sensor_ros.sim.cloud_texture import city_brightness, cloud_brightness
from horizon_sensor_ros.sim.earth_scene import EarthScene, Imaging
from horizon_sensor_ros.sim.exposure import ROWS_AROUND, attitudes_during, strips_read_out
from horizon_sensor_ros.sim.frame_truth import (
    FrameTruth,
    LimbTruth,
    limb_curve,
)
from horizon_sensor_ros.sim.recording import digitise, expose, occlusion
from horizon_sensor_ros.sim.sky import add_flare, add_moon, add_stars, add_sun
from horizon_sensor_ros.sim.smooth_texture import smooth_field

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
Image = NDArray[np.float32]

_SUBPIXELS = 8
# Half-widths of the terminator in the cosine of the Sun's zenith angle: on the ground, and in air.
_TWILIGHT, _AIR_TWILIGHT = 0.02, 0.12
_DARKEST_GROUND = 0.08  # of smooth ground, over its mean brightness
# Waves of an uneven limb, in planet radii, and how high and low they go.
_UNEVEN_WAVES, _UNEVEN_SIGMAS = (0.03, 1.0), 5.0
_FAINTEST_AIR = 12.0  # scale heights up to which the air's glow is drawn
_CLEAR_AIR = 0.1  # optical depth of air that hides nothing
_STEP_INSIDE_PX, _STEP_OUTSIDE_PX = 2.5, 4.0  # where the brightness step at the limb is measured
_PIECE = 16384  # lines of sight that are drawn at a time: what is made of them stays in the cache


@dataclass(frozen=True, eq=False)
class SimFrame:
    """A simulated frame: image (H, W) uint8, or uint16 for more than 8 bits, and its truth."""

    image: NDArray[np.uint8] | NDArray[np.uint16]
    truth: FrameTruth


@dataclass(frozen=True, eq=False)
class _Sight:
    """Lines of sight in the space where the planet is the unit sphere.

    rays (N, 3) : unit, scaled space, each coordinate in one piece; cos_nadir (N,) : of their angle
    to its centre; excess (N,) : cos_nadir minus that of the limb, positive on the planet.
    """

    rays: FloatArray
    cos_nadir: FloatArray
    excess: FloatArray

    def take(self, which: BoolArray) -> _Sight:
        if which.all():
            return self
        index = np.flatnonzero(which)
        rays = self.rays.T.take(index, axis=1).T
        return _Sight(rays, self.cos_nadir[index], self.excess[index])


class _World:
    """The scene as seen from one place: brightness along lines of sight."""

    def __init__(self, scene: EarthScene, position_ecef_m: FloatArray) -> None:
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

    def sight(self, rays_world: FloatArray) -> _Sight:
        rays = _unit(rays_world / self.axes)
        cos_nadir = rays @ self.nadir
        sight = _Sight(rays, cos_nadir, cos_nadir - self.cos_rho)
        if self.scene.limb_uneven_m > 0.0:
            self._raise(sight)
        return sight

    def _raise(self, sight: _Sight) -> None:
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

    def hits(self, rays_world: FloatArray) -> BoolArray:
        return self.sight(rays_world).excess > 0.0

    def surface(self, sight: _Sight) -> Image:
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

    def sky(self, sight: _Sight) -> Image:
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

    def _airglow_m(self, sight: _Sight) -> FloatArray | float:
        """Height of the layer of airglow where rays come nearest to the planet."""
        scene = self.scene
        if scene.airglow_uneven_m == 0.0:
            return scene.airglow_height_m
        waves = smooth_field(self._lowest(sight), scene.texture_seed)
        return scene.airglow_height_m + scene.airglow_uneven_m * waves.astype(np.float64)

    def _lowest(self, sight: _Sight) -> FloatArray:
        """Directions (N, 3) of the rays' points nearest to the planet's centre."""
        points = self.origin + (sight.cos_nadir * self.distance)[:, None] * sight.rays
        return _unit(points)

    def _normals(self, points: FloatArray) -> FloatArray:
        return _unit(points / self.axes)

    def _air_light(self, points: FloatArray, rays: FloatArray) -> FloatArray | float:
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


def _unit(vectors: FloatArray) -> FloatArray:
    """The vectors (N, 3), made unit vectors in place."""
    vectors /= np.sqrt(np.einsum("ij,ij->i", vectors, vectors))[:, None]
    return vectors


def _turned(rays: FloatArray, rot: FloatArray) -> FloatArray:
    """Rays (N, 3), turned; each coordinate in one piece."""
    return (rot @ rays.T).T


def _pieces(count: int, size: int = _PIECE) -> Iterator[slice]:
    return (slice(first, first + size) for first in range(0, count, size))


def _sine(cos_sun: FloatArray, width: float) -> FloatArray:
    """Cosines of the Sun's zenith angle (N,) by day; by night none, with a soft transition."""
    return np.asarray(0.5 * (cos_sun + np.sqrt(cos_sun * cos_sun + width**2)))


def _through_air(column: FloatArray, depth: float) -> tuple[FloatArray, FloatArray]:
    """What columns (N,) of air show, over the brightest they may, and the share of what lies behind
    that they let through; of air without depth, over the grazing ray's, and all.
    """
    if depth == 0.0:
        return column, np.ones(1)
    left = np.exp(-depth * column)
    return 1.0 - left, left


@lru_cache(maxsize=2)
def _frame_rays(camera: Camera) -> FloatArray:
    """Optical-frame rays (H * W, 3) of all pixels' centres, row by row."""
    x, y = np.meshgrid(np.arange(camera.width, dtype=float), np.arange(camera.height, dtype=float))
    rays = np.asfortranarray(camera.rays(np.stack([x.ravel(), y.ravel()], axis=1)))
    rays.setflags(write=False)
    return rays


def _gradient(values: FloatArray, pixel: NDArray[np.intp]) -> FloatArray:
    """Gradient (N, 2) of an image (H, W) at flat pixel indices, one-sided at the borders."""
    height, width = values.shape
    y, x = np.divmod(pixel, width)
    left, right = np.maximum(x - 1, 0), np.minimum(x + 1, width - 1)
    up, down = np.maximum(y - 1, 0), np.minimum(y + 1, height - 1)
    gx = (values[y, right] - values[y, left]) / np.maximum(right - left, 1)
    gy = (values[down, x] - values[up, x]) / np.maximum(down - up, 1)
    return np.stack([gx, gy], axis=1)


def _draw_limb(
    light: Image, world: _World, camera: Camera, rot: FloatArray, excess: FloatArray
) -> None:
    """Redraw the pixels that the limb touches, supersampled."""
    edge = np.flatnonzero(_limb_pixels(excess))
    if edge.size == 0:
        return
    gradient = _gradient(excess, edge)
    keep = np.isfinite(gradient).all(axis=1) & (np.abs(gradient).max(axis=1) > 0.0)
    edge, gradient = edge[keep], gradient[keep]
    # a square of side 1 / 8 is crossed by the limb over this change of the excess
    ramp = np.abs(gradient).sum(axis=1) / _SUBPIXELS
    offset = (np.arange(_SUBPIXELS) + 0.5) / _SUBPIXELS - 0.5
    dx, dy = (grid.ravel() for grid in np.meshgrid(offset, offset))
    y, x = np.divmod(edge, camera.width)
    samples = np.empty((len(edge), _SUBPIXELS**2), np.float32)
    for piece in _pieces(len(edge), _PIECE // _SUBPIXELS**2):
        px = np.stack([(x[piece, None] + dx).ravel(), (y[piece, None] + dy).ravel()], axis=1)
        steep = np.repeat(ramp[piece], _SUBPIXELS**2)
        samples[piece] = _shared_out(world, camera.rays(px), rot, steep).reshape(-1, len(dx))
    light.flat[edge] = samples.mean(axis=1)


def _shared_out(world: _World, rays: FloatArray, rot: FloatArray, ramp: FloatArray) -> Image:
    """Brightness (N,) of little squares about rays (N, 3), optical frame, each by the share of it
    that lies on the planet.

    ramp (N,) : change of the excess across a square.
    """
    valid = np.asarray(np.isfinite(rays).all(axis=1))
    sight = world.sight(_turned(np.where(valid[:, None], rays, [0.0, 0.0, 1.0]), rot))
    share = np.clip(0.5 + sight.excess / ramp, 0.0, 1.0)
    on, off = valid & (share > 0.0), valid & (share < 1.0)
    out = np.zeros(len(rays), np.float32)
    out[on] += share[on] * world.surface(sight.take(on))
    if world.has_air:
        out[off] += (1.0 - share[off]) * world.sky(sight.take(off))
    return out


def _limb_pixels(excess: FloatArray) -> BoolArray:
    """Mask (H, W) of pixels with the limb inside them or in their immediate neighbours."""
    on = (excess > 0.0).astype(np.uint8)
    kernel = np.ones((3, 3), np.uint8)
    return np.asarray(cv2.dilate(on, kernel) != cv2.erode(on, kernel))


def render(
    camera: Camera,
    rot_world_from_cam: FloatArray,
    position_ecef_m: FloatArray,
    scene: EarthScene,
    rng: np.random.Generator,
    *,
    imaging: Imaging | None = None,
    rot_base_from_cam: FloatArray | None = None,
    turn_base_rad: FloatArray | None = None,
    readout_turn_base_rad: FloatArray | None = None,
) -> SimFrame:
    """Draw one frame.

    rot_world_from_cam : (3, 3), optical frame to the Earth-fixed world; position_ecef_m : (3,),
    outside the planet; rng : noise and defects only, the world itself is fixed by the scene;
    rot_base_from_cam : (3, 3), default identity (truth is then in the optical frame).
    turn_base_rad : (3,) by which the base turns during the exposure, in its own frame; the pose is
    that of the exposure's middle. readout_turn_base_rad : (3,) likewise, from the first row of a
    rolling shutter to the last; the pose is that of the first row. Default none.
    Raises ValueError for a position inside the planet.
    """
    imaging = Imaging() if imaging is None else imaging
    rot = np.asarray(rot_world_from_cam, float)
    position = np.asarray(position_ecef_m, float)
    world = _World(scene, position)
    exposing, reading = (
        np.zeros(3)
        if turn is None
        else np.asarray(turn, float)
        @ (np.eye(3) if rot_base_from_cam is None else rot_base_from_cam)
        for turn in (turn_base_rad, readout_turn_base_rad)
    )
    if reading.any():
        light = np.empty((camera.height, camera.width), np.float32)
        for rows, strip, at in strips_read_out(rot, reading, camera):
            light[rows] = _exposed(world, strip, at, exposing)[ROWS_AROUND:-ROWS_AROUND]
    else:
        light = _exposed(world, camera, rot, exposing)
    hidden, parts = occlusion(imaging.occluders, (camera.height, camera.width))
    if imaging.occluders:
        light = light * (1.0 - hidden) + parts
    sun_px = _sun_px(world, camera, rot)
    if sun_px is not None:
        _draw_sun(light, sun_px, scene, imaging, hidden)
    signal = expose(light, imaging, rng)
    limb = _limb_truth(world, camera, rot, signal, hidden)
    truth = _truth(world, camera, rot, limb, rot_base_from_cam)
    return SimFrame(digitise(signal, imaging, rng), truth)


def _exposed(world: _World, camera: Camera, rot: FloatArray, turn_cam_rad: FloatArray) -> Image:
    """`_light` over an exposure during which the camera turns (3,), in its own frame."""
    moments = attitudes_during(rot, turn_cam_rad, camera)
    return np.mean([_light(world, camera, at) for at in moments], axis=0)


def _light(world: _World, camera: Camera, rot: FloatArray) -> Image:
    """Brightness (H, W) at a moment, before the optics; without the Sun."""
    shape = (camera.height, camera.width)
    rays = _frame_rays(camera)
    light: Image = np.zeros(shape, np.float32)
    excess = np.empty(shape)
    for piece in _pieces(len(rays)):
        sight = world.sight(_turned(rays[piece], rot))
        excess.reshape(-1)[piece] = sight.excess
        pixels = light.reshape(-1)[piece]
        with np.errstate(invalid="ignore"):  # where the lens has no ray
            on_planet, off_planet = sight.excess > 0.0, sight.excess <= 0.0
        if on_planet.any():
            pixels[on_planet] = world.surface(sight.take(on_planet))
        if world.has_air:
            pixels[off_planet] = world.sky(sight.take(off_planet))
    _draw_limb(light, world, camera, rot, excess)
    _draw_sky_objects(light, world, camera, rot)
    return light


def render_views(
    views: Sequence[CameraView],
    rot_world_from_base: FloatArray,
    position_ecef_m: FloatArray,
    scene: EarthScene,
    rng: np.random.Generator,
    *,
    imaging: Imaging | Sequence[Imaging] | None = None,
    turn_base_rad: FloatArray | None = None,
    readout_turn_base_rad: FloatArray | None = None,
) -> tuple[SimFrame, ...]:
    """Draw the frames of several cameras of one craft at one moment, in the order of `views`.

    imaging : one for all, or one a view; ValueError for another number of them. turn_base_rad,
    readout_turn_base_rad : see `render`.
    """
    each = [imaging] * len(views) if imaging is None or isinstance(imaging, Imaging) else imaging
    if len(each) != len(views):
        raise ValueError(f"imaging must be one, or one a view ({len(views)}); got {len(each)}")
    return tuple(
        render(
            view.camera,
            np.asarray(rot_world_from_base, float) @ view.rot_base_from_cam,
            position_ecef_m,
            scene,
            rng,
            imaging=how,
            rot_base_from_cam=view.rot_base_from_cam,
            turn_base_rad=turn_base_rad,
            readout_turn_base_rad=readout_turn_base_rad,
        )
        for view, how in zip(views, each, strict=True)
    )


def _draw_sky_objects(light: Image, world: _World, camera: Camera, rot: FloatArray) -> None:
    scene = world.scene
    if scene.star_count > 0:
        add_stars(light, camera, rot, world.hits, count=scene.star_count, seed=scene.star_seed)
    if scene.moon_direction is not None:
        add_moon(
            light,
            camera,
            rot,
            world.hits,
            direction=np.array(scene.moon_direction),
            radius_rad=scene.moon_radius_rad,
            brightness_dn=scene.moon_dn,
            sun_direction=world.sun,
        )


def _sun_px(world: _World, camera: Camera, rot: FloatArray) -> FloatArray | None:
    """Where the Sun appears, in the frame or beside it; None where it is hidden or behind."""
    if world.sun is None or world.hits(world.sun[None])[0]:
        return None
    px = camera.pixels((world.sun @ rot)[None])[0]
    return px if np.isfinite(px).all() else None


def _draw_sun(
    light: Image, sun_px: FloatArray, scene: EarthScene, imaging: Imaging, hidden: Image
) -> None:
    """Add the Sun, where it is in the frame, and its ghosts; not if the craft hides it."""
    height, width = light.shape
    x, y = np.rint(sun_px)
    if 0 <= x < width and 0 <= y < height:
        if hidden[int(y), int(x)] > 0.5:
            return
        if scene.sun_dn > 0.0:
            add_sun(light, sun_px, scene.sun_dn)
    if imaging.flare_dn > 0.0:
        add_flare(light, sun_px, imaging.flare_dn)


def _limb_truth(
    world: _World, camera: Camera, rot: FloatArray, signal: Image, hidden: Image
) -> LimbTruth:
    px, normal = limb_curve(camera, world.scene.planet, rot, world.position)

    def at(image: Image, offset_px: float) -> FloatArray:
        if len(px) == 0:
            return np.empty(0)
        x, y = (px + offset_px * normal).astype(np.float32).T
        sampled = cv2.remap(
            image, x[None], y[None], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        return np.asarray(sampled[0], float)

    in_the_open = np.ones(len(px), bool)
    for offset in (-_STEP_OUTSIDE_PX, 0.0, _STEP_OUTSIDE_PX):
        in_the_open &= at(hidden, offset) < 0.01
    clipped = np.clip(signal, 0.0, 255.0)
    outside_px = _STEP_OUTSIDE_PX + _hidden_px(world, camera)
    step = at(clipped, -_STEP_INSIDE_PX) - at(clipped, outside_px)
    return LimbTruth(px, normal, step, in_the_open)


def _hidden_px(world: _World, camera: Camera) -> float:
    """How far above the limb air begins that hides nothing."""
    scene = world.scene
    if scene.air_dn <= 0.0 or scene.air_depth <= _CLEAR_AIR:
        return 0.0
    height = scene.air_scale_height_m * np.log(scene.air_depth / _CLEAR_AIR) / world.radius_m
    return float(height / (np.sqrt(world.distance**2 - 1.0) * camera.pixel_rad))


def _truth(
    world: _World,
    camera: Camera,
    rot: FloatArray,
    limb: LimbTruth,
    base_from_cam: FloatArray | None,
) -> FrameTruth:
    planet, position = world.scene.planet, world.position
    base_from_cam = np.eye(3) if base_from_cam is None else np.asarray(base_from_cam, float)
    geocentric = planet.nadir_ecef(position, "geocentric")
    geodetic = planet.nadir_ecef(position, "geodetic")
    return FrameTruth(
        camera=camera,
        planet=planet,
        nadir_cam=geocentric @ rot,
        nadir_base=base_from_cam @ (geocentric @ rot),
        geodetic_nadir_base=base_from_cam @ (geodetic @ rot),
        altitude_m=planet.geodetic_from_ecef(position)[2],
        rho_rad=_mean_rho(planet, position),
        position_ecef_m=position,
        rot_world_from_cam=rot,
        rot_world_from_base=rot @ base_from_cam.T,
        limb=limb,
    )


def _mean_rho(planet: Planet, position: FloatArray) -> float:
    """Angle from nadir to the limb, averaged over azimuth where the planet is an ellipsoid."""
    azimuth = np.linspace(0.0, 2.0 * np.pi, 72, endpoint=False)
    rays = planet.limb_rays_ecef(position, azimuth)
    nadir = -position / np.linalg.norm(position)
    across = np.linalg.norm(np.cross(rays, nadir), axis=1)
    return float(np.mean(np.arctan2(across, rays @ nadir)))
