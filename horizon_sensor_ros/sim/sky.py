"""Bright things in the sky, added to a frame: stars, the Moon's disc, the Sun, lens flare."""

from __future__ import annotations

import numpy as np

from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.sim.scene_light import SceneLight

_SUN_CORE_PX = 12.0
_GHOSTS = (  # place along the line Sun - image centre, radius over the image width, brightness
    (-0.35, 0.020, 1.0),
    (-0.7, 0.045, 0.6),
    (0.45, 0.012, 0.8),
    (-1.25, 0.070, 0.4),
)


def add_stars(
    image: np.ndarray, camera: Camera, rot_world_from_cam: np.ndarray, world: SceneLight
) -> None:
    """Add the scene's point stars, fixed in the world, to an image (H, W), float32, as spots of one
    pixel.
    """
    count = world.scene.star_count
    if count <= 0:
        return
    rng = np.random.default_rng([world.scene.star_seed, 0x57A8])
    directions = rng.standard_normal((count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    # star counts rise by about 3 for each factor 2.5 in faintness
    flux = 40.0 * rng.uniform(0.01, 1.0, count) ** (-1.0 / 1.2)
    rays = directions @ rot_world_from_cam
    px = camera.pixels(rays)
    seen = camera.in_frame(px) & ~world.hits(directions)
    corner = np.floor(px[seen]).astype(int)
    part = px[seen] - corner
    for dx in (0, 1):
        for dy in (0, 1):
            x, y = corner[:, 0] + dx, corner[:, 1] + dy
            share = np.abs(1 - dx - part[:, 0]) * np.abs(1 - dy - part[:, 1])
            ok = (x >= 0) & (x < camera.width) & (y >= 0) & (y < camera.height)
            np.add.at(image, (y[ok], x[ok]), (flux[seen] * share)[ok].astype(np.float32))


def add_moon(
    image: np.ndarray, camera: Camera, rot_world_from_cam: np.ndarray, world: SceneLight
) -> None:
    """Add the disc of the scene's Moon, if it has one, lit from the Sun's side (full without a
    Sun), 4 x 4 supersampled.
    """
    if world.scene.moon_direction is None:
        return
    radius_rad = world.scene.moon_radius_rad
    centre_cam = np.array(world.scene.moon_direction) @ rot_world_from_cam
    centre = camera.pixels(centre_cam[None])[0]
    if not np.isfinite(centre).all():
        return
    reach = 1.5 * radius_rad * max(camera.fx, camera.fy) / max(centre_cam[2], 0.1) ** 2 + 2.0
    x0, y0 = np.maximum(np.floor(centre - reach), 0).astype(int)
    x1 = min(int(centre[0] + reach) + 1, camera.width)
    y1 = min(int(centre[1] + reach) + 1, camera.height)
    if x1 <= x0 or y1 <= y0:
        return
    sub = (np.arange(4) + 0.5) / 4.0 - 0.5
    x = (np.arange(x0, x1)[:, None] + sub).ravel()
    y = (np.arange(y0, y1)[:, None] + sub).ravel()
    px = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    rays = camera.rays(px)
    with np.errstate(invalid="ignore"):
        across = (rays - centre_cam) / radius_rad
        r2 = np.sum(across**2, axis=1)
        lit = r2 < 1.0
        if world.sun is not None:
            normal = across - np.sqrt(np.maximum(1.0 - r2, 0.0))[:, None] * centre_cam
            lit &= normal @ (world.sun @ rot_world_from_cam) > 0.0
        lit[lit] &= ~world.hits(rays[lit] @ rot_world_from_cam.T)
    patch = lit.reshape(y1 - y0, 4, x1 - x0, 4).mean(axis=(1, 3))
    image[y0:y1, x0:x1] += np.float32(world.scene.moon_dn) * patch.astype(np.float32)


def add_sun(image: np.ndarray, sun_px: np.ndarray, brightness_dn: float) -> None:
    """Add the overexposed Sun with its halo and the row-wise streak of a blooming sensor."""
    height, width = image.shape
    dx = (np.arange(width) - sun_px[0]).astype(np.float32)
    dy = (np.arange(height) - sun_px[1]).astype(np.float32)
    r2 = (dy * dy)[:, None] + (dx * dx)[None, :]
    core2 = np.float32(_SUN_CORE_PX**2)
    halo = np.float32(0.35) / (1.0 + r2 / (4.0 * core2)) ** np.float32(0.9)
    halo += np.minimum(np.exp(np.minimum(core2 - r2, 300.0) / (0.3 * core2)), 1.0)
    streak = np.exp(-np.abs(dx) / (6.0 * _SUN_CORE_PX)) * 0.4 + 0.12
    image += np.float32(brightness_dn) * halo
    image += np.float32(brightness_dn) * np.exp(-dy * dy / 8.0)[:, None] * streak[None, :]


def add_flare(image: np.ndarray, sun_px: np.ndarray, brightness_dn: float) -> None:
    """Add the lens' ghosts: soft-edged discs on the line through the Sun and the image centre."""
    height, width = image.shape
    centre = np.array([(width - 1) / 2.0, (height - 1) / 2.0])
    yy, xx = np.mgrid[0:height, 0:width].astype(np.float32)
    for place, size, strength in _GHOSTS:
        x, y = centre + place * (sun_px - centre)
        radius = size * width
        distance = np.sqrt((xx - np.float32(x)) ** 2 + (yy - np.float32(y)) ** 2)
        disc = np.clip((radius - distance) / (0.1 * radius) + 0.5, 0.0, 1.0)
        image += np.float32(brightness_dn * strength) * disc
