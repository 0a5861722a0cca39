"""Earth camera: draws what a camera at a known pose sees of a planet, with truth for each frame.

Pixels are sampled once, but for those that the limb touches, which `supersampled_limb` redraws.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.sim.earth_scene import EarthScene, Imaging
from horizon_sensor_ros.sim.exposure import ROWS_AROUND, attitudes_during, strips_read_out
from horizon_sensor_ros.sim.frame_truth import FrameTruth, frame_truth, limb_truth
from horizon_sensor_ros.sim.recording import digitise, expose, occlusion
from horizon_sensor_ros.sim.scene_light import SceneLight, pieces, turned
from horizon_sensor_ros.sim.sky import add_flare, add_moon, add_stars, add_sun
from horizon_sensor_ros.sim.supersampled_limb import draw_limb


@dataclass(frozen=True, eq=False)
class SimFrame:
    """A simulated frame: image (H, W) uint8, or uint16 for more than 8 bits, and its truth."""

    image: np.ndarray
    truth: FrameTruth


def render(
    camera: Camera,
    rot_world_from_cam: np.ndarray,
    position_ecef_m: np.ndarray,
    scene: EarthScene,
    rng: np.random.Generator,
    *,
    imaging: Imaging | None = None,
    rot_base_from_cam: np.ndarray | None = None,
    turn_base_rad: np.ndarray | None = None,
    readout_turn_base_rad: np.ndarray | None = None,
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
    world = SceneLight(scene, position)
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
    limb = limb_truth(world, camera, rot, signal, hidden)
    truth = frame_truth(world, camera, rot, limb, rot_base_from_cam)
    return SimFrame(digitise(signal, imaging, rng), truth)


def render_views(
    views: Sequence[CameraView],
    rot_world_from_base: np.ndarray,
    position_ecef_m: np.ndarray,
    scene: EarthScene,
    rng: np.random.Generator,
    *,
    imaging: Imaging | Sequence[Imaging] | None = None,
    turn_base_rad: np.ndarray | None = None,
    readout_turn_base_rad: np.ndarray | None = None,
) -> tuple[SimFrame, ...]:
    """Draw the frames of several cameras of one craft at one moment, in the order of `views`.

    imaging : one for all, or one a view; ValueError for another number of them. turn_base_rad,
    readout_turn_base_rad : see `render`.
    """
    each = [imaging] * len(views) if imaging is None or isinstance(imaging, Imaging) else imaging
    if len(each) != len(views):
        raise ValueError(f"imaging must be one, or one a view ({len(views)}), got {len(each)}")
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


def _exposed(
    world: SceneLight, camera: Camera, rot: np.ndarray, turn_cam_rad: np.ndarray
) -> np.ndarray:
    """`_light` over an exposure during which the camera turns (3,), in its own frame."""
    moments = attitudes_during(rot, turn_cam_rad, camera)
    return np.mean([_light(world, camera, at) for at in moments], axis=0)


def _light(world: SceneLight, camera: Camera, rot: np.ndarray) -> np.ndarray:
    """Brightness (H, W) at a moment, before the optics; without the Sun."""
    shape = (camera.height, camera.width)
    rays = _frame_rays(camera)
    light = np.zeros(shape, np.float32)
    excess = np.empty(shape)
    for piece in pieces(len(rays)):
        sight = world.sight(turned(rays[piece], rot))
        excess.reshape(-1)[piece] = sight.excess
        pixels = light.reshape(-1)[piece]
        with np.errstate(invalid="ignore"):  # where the lens has no ray
            on_planet, off_planet = sight.excess > 0.0, sight.excess <= 0.0
        if on_planet.any():
            pixels[on_planet] = world.surface(sight.take(on_planet))
        if world.has_air:
            pixels[off_planet] = world.sky(sight.take(off_planet))
    draw_limb(light, world, camera, rot, excess)
    add_stars(light, camera, rot, world)
    add_moon(light, camera, rot, world)
    return light


@lru_cache(maxsize=2)
def _frame_rays(camera: Camera) -> np.ndarray:
    """Optical-frame rays (H * W, 3) of all pixels' centres, row by row."""
    x, y = np.meshgrid(np.arange(camera.width, dtype=float), np.arange(camera.height, dtype=float))
    rays = np.asfortranarray(camera.rays(np.stack([x.ravel(), y.ravel()], axis=1)))
    rays.setflags(write=False)
    return rays


def _sun_px(world: SceneLight, camera: Camera, rot: np.ndarray) -> np.ndarray | None:
    """Where the Sun appears, in the frame or beside it; None where it is hidden or behind."""
    if world.sun is None or world.hits(world.sun[None])[0]:
        return None
    px = camera.pixels((world.sun @ rot)[None])[0]
    return px if np.isfinite(px).all() else None


def _draw_sun(
    light: np.ndarray, sun_px: np.ndarray, scene: EarthScene, imaging: Imaging, hidden: np.ndarray
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
