"""Frames of a limb at a known place, drawn by the simulator, and how far points lie from it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from limb_samples import cone_rays
from scipy.spatial import cKDTree

from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.horizon.fix import Frame
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.sim.earth_camera import SimFrame, render_views
from horizon_sensor_ros.sim.earth_scene import EarthScene, Imaging
from horizon_sensor_ros.sim.frame_truth import LimbTruth
from horizon_sensor_ros.sim.poses import camera_from_fov, rot_from_axis, side_views

PLANET = Planet()
CAMERA = camera_from_fov(640, 480, np.radians(60.0))
# The base frame has its z towards the planet's centre; the craft is over a mid latitude.
_ZENITH = np.array([0.6, 0.64, 0.48])
ROT_WORLD_FROM_BASE = rot_from_axis(-_ZENITH, 0.7)
CLEAN = Imaging(noise_dn=1.0, psf_sigma_px=0.7)


def clouds(seed: int, cover: float = 0.5) -> EarthScene:
    return EarthScene(texture="clouds", texture_seed=seed, cloud_cover=cover)


def limb_views(
    altitude_m: float,
    camera: Camera = CAMERA,
    azimuths_rad: tuple[float, ...] = (0.0,),
    roll_rad: float = 0.3,
    above_rad: float = 0.0,
    planet: Planet = PLANET,
) -> tuple[CameraView, ...]:
    """Cameras whose axes point at (or above) the limb; nadir is (0, 0, 1) of the base."""
    rho = planet.rho_from_altitude(altitude_m)
    axes = cone_rays(np.array([0.0, 0.0, 1.0]), rho + above_rad, np.array(azimuths_rad))
    return tuple(
        CameraView(f"camera_{i}", camera, rot_from_axis(axis, roll_rad + i))
        for i, axis in enumerate(axes, 1)
    )


def draw(
    views: tuple[CameraView, ...],
    altitude_m: float,
    scene: EarthScene | None = None,
    imaging: Imaging | tuple[Imaging, ...] = CLEAN,
    seed: int = 0,
    turn_base_rad: np.ndarray | None = None,
) -> tuple[SimFrame, ...]:
    """Frames of all views at one moment, as seen from `ROT_WORLD_FROM_BASE`; turn_base_rad : by
    which the craft turns meanwhile.
    """
    return render_views(
        views,
        ROT_WORLD_FROM_BASE,
        _ZENITH * (PLANET.radius_m + altitude_m),
        EarthScene() if scene is None else scene,
        np.random.default_rng(seed),
        imaging=imaging,
        turn_base_rad=turn_base_rad,
    )


def as_frames(
    views: tuple[CameraView, ...], drawn: tuple[SimFrame, ...] | list[np.ndarray]
) -> list[Frame]:
    images = [item.image if isinstance(item, SimFrame) else item for item in drawn]
    return [Frame(view, image) for view, image in zip(views, images, strict=True)]


def distance_px(limb: LimbTruth, px: np.ndarray) -> np.ndarray:
    """Distance (N,) of points from the true limb, positive towards space."""
    _, nearest = cKDTree(limb.px).query(px)
    return np.sum((px - limb.px[nearest]) * limb.normal_px[nearest], axis=1)


def share_near_limb(limb: LimbTruth, px: np.ndarray, within_px: float) -> float:
    """Share of the points that lie within so many pixels of the true limb."""
    distance, _ = cKDTree(limb.px).query(px)
    return float(np.mean(distance < within_px))


def shared_truths(shared_data: Path) -> dict[str, dict[str, Any]]:
    """Truth of the shared scenes, by name."""
    listed = json.loads((shared_data / "earth_scenes" / "truth.json").read_text())
    return {truth["name"]: truth for truth in listed}


def shared_frames(shared_data: Path, truth: dict[str, Any]) -> list[Frame]:
    """Both cameras' frames of a shared scene; the base frame is the body frame."""
    focal = truth["fx"]
    camera = Camera(
        truth["width"], truth["height"], focal, focal, truth["cx"], truth["cy"],
        truth["model"], tuple(truth["distortion"]),
    )  # fmt: skip
    return [
        Frame(view, read_gray(shared_data / "earth_scenes" / f"{truth['name']}_{i}.png"))
        for i, view in enumerate(side_views(camera), 1)
    ]


def read_gray(path: Path) -> np.ndarray:
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    assert image is not None, path
    return image


def unlike_any_limb(height: int = 480, width: int = 640) -> dict[str, np.ndarray]:
    """8-bit frames that show no horizon of any planet."""
    rng = np.random.default_rng(7)
    y, x = np.mgrid[:height, :width]
    stars = rng.normal(4.0, 1.5, (height, width)).clip(0, 255)
    stars[rng.integers(0, height, 400), rng.integers(0, width, 400)] = rng.uniform(60, 255, 400)
    frames = {
        "black": np.zeros((height, width)),
        "constant": np.full((height, width), 77),
        "white": np.full((height, width), 255),
        "random": rng.integers(0, 256, (height, width)),
        "faint noise": rng.normal(20, 5, (height, width)).clip(0, 255),
        "stars": stars,
        "gradient": x * 255 // width,
        "stripes": (y // 40 % 2) * 200,
        "straight edge": (y > height // 2) * 200,
        "corner": ((y > height // 2) & (x > width // 2)) * 200,
        "box": ((abs(y - height // 2) < 100) & (abs(x - width // 2) < 150)) * 200,
    }
    for size in (1, 8, 64, 160):
        frames[f"checkerboard of {size}"] = ((x // size + y // size) % 2) * 255
    return {name: frame.astype(np.uint8) for name, frame in frames.items()}


def photograph(path: Path, focal_length_mm: float) -> Frame:
    """On a sensor 36 mm wide."""
    gray = read_gray(path)
    height, width = gray.shape
    focal = focal_length_mm / 36.0 * width
    camera = Camera(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2)
    return Frame(CameraView("camera", camera, np.eye(3)), gray)
