"""What is exactly true about a simulated frame: the pose, the verticals, the limb's curve and how
much of it shows.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.sim.scene_light import SceneLight

_CURVE_SAMPLES = 8192
_CLEAR_AIR = 0.1  # optical depth of air that hides nothing
_STEP_INSIDE_PX, _STEP_OUTSIDE_PX = 2.5, 4.0  # where the brightness step at the limb is measured


@dataclass(frozen=True, eq=False)
class LimbTruth:
    """The limb's curve where it crosses the frame, in order along the limb.

    px (N, 2) : samples in raw pixels, rarely more than a pixel apart; normal_px (N, 2) : unit,
    towards space; step_dn (N,) : brightness of the planet just inside over the sky just outside,
    before noise; in_the_open (N,) : not hidden by a part of the craft.
    """

    px: np.ndarray
    normal_px: np.ndarray
    step_dn: np.ndarray
    in_the_open: np.ndarray

    def visible(self, min_step_dn: float) -> np.ndarray:
        """Return which samples (N,) show an unhidden step of at least `min_step_dn`."""
        return self.in_the_open & (self.step_dn >= min_step_dn)

    def visible_length_px(self, min_step_dn: float) -> float:
        """Length of the visible limb in the frame, in pixels along the curve."""
        if len(self.px) < 2:
            return 0.0
        step = np.linalg.norm(np.diff(self.px, axis=0), axis=1)
        seen = self.visible(min_step_dn)
        # a jump is where the curve left the frame and came back
        return float(step[seen[1:] & seen[:-1] & (step < 20.0)].sum())


@dataclass(frozen=True, eq=False)
class FrameTruth:
    """Truth of one frame; unit vectors, rotations from the camera's optical frame and the base.

    nadir_* : towards the planet's centre; geodetic_nadir_base : against the ellipsoid's normal (the
    same on a sphere). altitude_m : above `planet.radius_m`, on the ellipsoid above it, without
    the limb height. rho_rad : angle from nadir to the limb (mean over the limb on an ellipsoid).
    """

    camera: Camera
    planet: Planet
    nadir_cam: np.ndarray
    nadir_base: np.ndarray
    geodetic_nadir_base: np.ndarray
    altitude_m: float
    rho_rad: float
    position_ecef_m: np.ndarray
    rot_world_from_cam: np.ndarray
    rot_world_from_base: np.ndarray
    limb: LimbTruth


def limb_curve(
    camera: Camera, planet: Planet, rot_world_from_cam: np.ndarray, position_ecef_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Limb samples px (N, 2) inside the frame and their unit normals (N, 2) towards space."""
    azimuth = np.linspace(0.0, 2.0 * np.pi, _CURVE_SAMPLES, endpoint=False)
    rays = planet.limb_rays_ecef(position_ecef_m, azimuth) @ rot_world_from_cam
    px = camera.pixels(rays)
    tangent = np.roll(px, -1, axis=0) - np.roll(px, 1, axis=0)
    normal = np.stack([tangent[:, 1], -tangent[:, 0]], axis=1)
    nadir_cam = -(position_ecef_m @ rot_world_from_cam) / np.linalg.norm(position_ecef_m)
    outward = camera.pixels(rays - 1e-4 * nadir_cam) - px
    with np.errstate(invalid="ignore"):
        normal *= np.sign(np.sum(normal * outward, axis=1, keepdims=True))
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    keep = camera.in_frame(px) & np.isfinite(normal).all(axis=1)
    if not keep.any():
        return np.empty((0, 2)), np.empty((0, 2))
    # start after a gap, so that one stretch of limb is one run of rows
    start = int(np.argmin(keep)) if not keep.all() else 0
    order = np.roll(np.arange(_CURVE_SAMPLES), -start)
    order = order[keep[order]]
    return px[order], normal[order]


def limb_truth(
    world: SceneLight, camera: Camera, rot: np.ndarray, signal: np.ndarray, hidden: np.ndarray
) -> LimbTruth:
    """The limb as a frame of that scene shows it.

    rot : (3, 3), optical frame to the world. signal (H, W) : the frame in gray levels before noise.
    hidden (H, W) : share of each pixel that parts of the craft cover.
    """
    px, normal = limb_curve(camera, world.scene.planet, rot, world.position)

    def at(image: np.ndarray, offset_px: float) -> np.ndarray:
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


def _hidden_px(world: SceneLight, camera: Camera) -> float:
    """How far above the limb air begins that hides nothing."""
    scene = world.scene
    if scene.air_dn <= 0.0 or scene.air_depth <= _CLEAR_AIR:
        return 0.0
    height = scene.air_scale_height_m * np.log(scene.air_depth / _CLEAR_AIR) / world.radius_m
    return float(height / (np.sqrt(world.distance**2 - 1.0) * camera.pixel_rad))


def frame_truth(
    world: SceneLight,
    camera: Camera,
    rot: np.ndarray,
    limb: LimbTruth,
    base_from_cam: np.ndarray | None,
) -> FrameTruth:
    """Truth of a frame from its pose.

    rot : (3, 3), optical frame to the world; base_from_cam : (3, 3), None: the identity.
    """
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


def _mean_rho(planet: Planet, position: np.ndarray) -> float:
    """Angle from nadir to the limb, averaged over azimuth where the planet is an ellipsoid."""
    azimuth = np.linspace(0.0, 2.0 * np.pi, 72, endpoint=False)
    rays = planet.limb_rays_ecef(position, azimuth)
    nadir = -position / np.linalg.norm(position)
    across = np.linalg.norm(np.cross(rays, nadir), axis=1)
    return float(np.mean(np.arctan2(across, rays @ nadir)))
