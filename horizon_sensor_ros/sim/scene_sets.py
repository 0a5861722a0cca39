"""Random sets of frames for benchmarks: A (uniform planet), B, C and E (clouds), D (smooth ground),
B for two cameras, M (a camera that turns while it exposes).

All sets: sphere, altitude 300 to 6000 km (log-uniform), field of view 40 to 80 deg, 400 x 400 to
1024 x 1024 pixels, any roll, PSF sigma 0.7 px. Set A: noise 2 DN. The others: noise 4 DN. The
cameras are aimed so that the limb crosses the frame well. Frame i of a seed is the same whatever n
is.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.sim.earth_camera import SimFrame, render_views
from horizon_sensor_ros.sim.earth_scene import EarthScene, Imaging
from horizon_sensor_ros.sim.poses import camera_from_fov, random_direction, rot_from_axis

_SPHERE = EarthScene().planet
_ALTITUDES_M = (300e3, 6000e3)
_FIELDS_RAD = (np.radians(40.0), np.radians(80.0))
_SIZES_PX = (400, 1024)
# With this contrast a plain half-height fit and a fit to Canny edges have the errors (0.033 and
# 0.032 deg RMS) that were published for such a set (0.0345 and 0.027).
_SET_B_CONTRAST = 0.2
# With this one a fit of sloped steps (`benchmarks/horizon/sloped_step.py`) has the error that was
# published for the same set (0.0063).
_SET_E_CONTRAST = 0.03
# What set M shows, and by how many pixels motion smears the middle of its frames.
MOVING_SCENES = ("uniform", "clouds of B", "clouds of C", "uniform, air", "clouds of B, air")
SMEARS_PX = (2.0, 5.0, 10.0, 20.0)
_OFF_LIMB = 0.4  # largest angle of a camera's axis to a point of the limb, over half its field


@dataclass(frozen=True, eq=False)
class SceneCase:
    """Frames of one craft at one moment: `frames[i]` is seen by `views[i]`.

    turn_base_rad : (3,) by which the craft turns while they are exposed.
    """

    name: str
    views: tuple[CameraView, ...]
    frames: tuple[SimFrame, ...]
    turn_base_rad: np.ndarray = field(default_factory=lambda: np.zeros(3))


def set_a(n: int = 200, seed: int = 0) -> Iterator[SceneCase]:
    """Draw n frames of a uniform planet, one camera each; the base frame is the optical one."""
    return (_one_camera("a", i, seed, EarthScene(), Imaging(noise_dn=2.0)) for i in range(n))


def set_b(n: int = 200, seed: int = 0) -> Iterator[SceneCase]:
    """Draw n frames of a clouded planet, one camera each; the base frame is the optical one."""
    return (_one_camera("b", i, seed, _clouds(seed, i), Imaging(noise_dn=4.0)) for i in range(n))


def set_c(n: int = 200, seed: int = 0) -> Iterator[SceneCase]:
    """Draw n frames as in set B with clouds of full contrast: 50 to 250 DN right up to the limb."""
    return (
        _one_camera("c", i, seed, _clouds(seed, i, 1.0), Imaging(noise_dn=4.0)) for i in range(n)
    )


def set_d(n: int = 200, seed: int = 0) -> Iterator[SceneCase]:
    """Draw n frames as in set B of ground whose brightness changes gently, by 30 % (one sigma)."""
    return (_one_camera("d", i, seed, _smooth(seed, i), Imaging(noise_dn=4.0)) for i in range(n))


def set_e(n: int = 200, seed: int = 0) -> Iterator[SceneCase]:
    """Draw n frames as in set B with fainter clouds."""
    return (
        _one_camera("e", i, seed, _clouds(seed, i, _SET_E_CONTRAST), Imaging(noise_dn=4.0))
        for i in range(n)
    )


def set_m(n: int = 200, seed: int = 0) -> Iterator[SceneCase]:
    """Draw n frames of a camera that turns, any way, while they are exposed.

    Scenes are `MOVING_SCENES` in turn, each of them with the first of `SMEARS_PX`, then the next.
    """
    for i in range(n):
        name, smear_px = moving_scene(i)
        scene = _moving(name, seed, i)
        yield _one_camera("m", i, seed, scene, Imaging(noise_dn=4.0), smear_px)


def moving_scene(i: int) -> tuple[str, float]:
    """What frame i of set M shows, and its smear in pixels."""
    turn, kind = divmod(i, len(MOVING_SCENES))
    return MOVING_SCENES[kind], SMEARS_PX[turn % len(SMEARS_PX)]


def two_camera_set(n: int = 200, seed: int = 0, planet: Planet = _SPHERE) -> Iterator[SceneCase]:
    """Draw n pairs as in set B, axes perpendicular; the base frame is camera 1's optical one.

    planet : any figure; the craft is anywhere above it.
    """
    for i in range(n):
        rng = np.random.default_rng([seed, i, 2])
        distance = _distance(rng)
        nadir = random_direction(rng)
        rho = np.arcsin(EarthScene().planet.radius_m / distance)
        size, fov = _size_and_fov(rng)
        axis_1, axis_2 = _perpendicular_axes(rng, nadir, rho, _OFF_LIMB * fov / 2.0)
        rot_1 = rot_from_axis(axis_1, rng.uniform(0.0, 2.0 * np.pi))
        rot_2 = rot_from_axis(axis_2, rng.uniform(0.0, 2.0 * np.pi))
        camera = camera_from_fov(size, size, fov)
        views = (
            CameraView("camera_1", camera, np.eye(3)),
            CameraView("camera_2", camera, rot_1.T @ rot_2),
        )
        imaging, scene = Imaging(noise_dn=4.0), replace(_clouds(seed, i), planet=planet)
        frames = render_views(views, rot_1, -nadir * distance, scene, rng, imaging=imaging)
        yield SceneCase(f"two{i}", views, frames)


def _moving(name: str, seed: int, i: int) -> EarthScene:
    ground, _, air = name.partition(", ")
    contrasts = {"clouds of B": _SET_B_CONTRAST, "clouds of C": 1.0}
    scene = _clouds(seed, i, contrasts[ground]) if ground in contrasts else EarthScene()
    if not air:
        return scene
    air_dn = float(np.random.default_rng([seed, i, 0xA]).uniform(40.0, 130.0))
    return replace(scene, air_dn=air_dn)


def _clouds(seed: int, i: int, contrast: float = _SET_B_CONTRAST) -> EarthScene:
    rng = np.random.default_rng([seed, i, 0xB])
    return EarthScene(
        texture="clouds",
        texture_seed=int(rng.integers(2**31)),
        cloud_cover=float(rng.uniform(0.35, 0.75)),
        cloud_contrast=contrast,
    )


def _smooth(seed: int, i: int) -> EarthScene:
    rng = np.random.default_rng([seed, i, 0xD])
    return EarthScene(texture="smooth", texture_seed=int(rng.integers(2**31)), uniform_dn=140.0)


def _distance(rng: np.random.Generator) -> float:
    altitude = np.exp(rng.uniform(*np.log(_ALTITUDES_M)))
    return EarthScene().planet.radius_m + float(altitude)


def _size_and_fov(rng: np.random.Generator) -> tuple[int, float]:
    return int(rng.integers(_SIZES_PX[0], _SIZES_PX[1] + 1)), float(rng.uniform(*_FIELDS_RAD))


def _near(rng: np.random.Generator, direction: np.ndarray, within_rad: float) -> np.ndarray:
    """Direction at a random angle of at most `within_rad` from another."""
    across = np.cross(direction, random_direction(rng))
    across /= np.linalg.norm(across)
    angle = within_rad * np.sqrt(rng.uniform())
    return np.cos(angle) * direction + np.sin(angle) * across


def _limb_point(rng: np.random.Generator, nadir: np.ndarray, rho: float) -> np.ndarray:
    across = np.cross(nadir, random_direction(rng))
    across /= np.linalg.norm(across)
    return np.cos(rho) * nadir + np.sin(rho) * across


def _perpendicular_axes(
    rng: np.random.Generator, nadir: np.ndarray, rho: float, within_rad: float
) -> tuple[np.ndarray, np.ndarray]:
    """Two perpendicular directions, both within an angle of the limb.

    The limb's own points span up to 2 rho; seen from far (rho < 45 deg) no two lie 90 deg apart,
    and both axes then look past the limb, outwards by the least that makes them perpendicular.
    """
    tilt = max(rho, np.radians(45.0))
    for _ in range(1000):
        axis_1 = _near(rng, _limb_point(rng, nadir, tilt), 0.5 * within_rad)
        across = np.cross(axis_1, random_direction(rng))
        axis_2 = across / np.linalg.norm(across)
        if abs(np.arccos(axis_2 @ nadir) - tilt) < 0.5 * within_rad:
            return axis_1, axis_2
    raise RuntimeError("no pair of perpendicular axes near the limb was found")


def _one_camera(
    name: str, i: int, seed: int, scene: EarthScene, imaging: Imaging, smear_px: float = 0.0
) -> SceneCase:
    rng = np.random.default_rng([seed, i, 1])
    distance = _distance(rng)
    nadir = random_direction(rng)
    rho = np.arcsin(scene.planet.radius_m / distance)
    size, fov = _size_and_fov(rng)
    axis = _near(rng, _limb_point(rng, nadir, rho), _OFF_LIMB * fov / 2.0)
    rot = rot_from_axis(axis, rng.uniform(0.0, 2.0 * np.pi))
    camera = camera_from_fov(size, size, fov)
    turn = _turn(rng, camera, smear_px) if smear_px > 0.0 else np.zeros(3)
    views = (CameraView("camera_1", camera, np.eye(3)),)
    frames = render_views(
        views, rot, -nadir * distance, scene, rng, imaging=imaging, turn_base_rad=turn
    )
    return SceneCase(f"{name}{i}", views, frames, turn)


def _turn(rng: np.random.Generator, camera: Camera, smear_px: float) -> np.ndarray:
    """Rotation vector (3,) that moves the middle of the frame by so much, and rolls it besides."""
    angle = smear_px / camera.fx
    across = rng.uniform(0.0, 2.0 * np.pi)
    return angle * np.array([np.cos(across), np.sin(across), rng.uniform(-0.5, 0.5)])
