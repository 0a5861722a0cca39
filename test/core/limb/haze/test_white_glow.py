"""Glow too bright for the exposure, drawn here with light that changes along it, and its nadir."""

from __future__ import annotations

import math

import cv2
import numpy as np

from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.core.horizon.fix import Frame, HorizonFix
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.limb.haze.limb import haze_look, hazy_limb
from horizon_sensor_ros.core.limb.haze.sample import SEEK, air_length_px, haze_factor, sample_haze
from horizon_sensor_ros.core.limb.search.working_image import block_average
from horizon_sensor_ros.core.planet import Planet

PLANET = Planet()
FINE = 3  # drawn pixels to a pixel
HEIGHT_M = 8e3  # over which air fades by e


def unit(vector: tuple[float, float, float]) -> np.ndarray:
    return np.array(vector) / np.linalg.norm(vector)


def rays_of(view: CameraView) -> np.ndarray:
    """Rays (h, w, 3) of the drawn pixels."""
    camera = view.camera
    y, x = (np.mgrid[: camera.height * FINE, : camera.width * FINE] + 0.5) / FINE - 0.5
    px = np.stack([x.ravel(), y.ravel()], axis=1)
    return camera.rays(px).reshape(*x.shape, 3)


def exposed(light_dn: np.ndarray, blur_px: float, noise_dn: float, seed: int) -> np.ndarray:
    """Frame of the drawn light."""
    height, width = (side // FINE for side in light_dn.shape)
    blurred = cv2.GaussianBlur(light_dn, (0, 0), blur_px * FINE)
    levels = 8.0 + blurred.reshape(height, FINE, width, FINE).mean(axis=(1, 3))
    levels += np.random.default_rng(seed).normal(0.0, noise_dn, levels.shape)
    return np.clip(np.rint(levels), 0, 255).astype(np.uint8)


def view_of(width: int, height: int, fov_deg: float) -> CameraView:
    focal_px = 0.5 * width / math.tan(math.radians(0.5 * fov_deg))
    camera = Camera(width, height, focal_px, focal_px, 0.5 * width - 0.5, 0.5 * height - 0.5)
    return CameraView("camera_1", camera, np.eye(3))


def chi2(fix: HorizonFix, nadir: np.ndarray) -> float:
    """Square of nadir's error over its covariance, of two degrees of freedom."""
    across = np.linalg.svd(nadir[None])[2][1:]
    off = across @ fix.fit.nadir_base
    cov = across @ fix.fit.cov_nadir_altitude[:3, :3] @ across.T
    return float(off @ np.linalg.solve(cov, off))


def heights_m(cosine: np.ndarray, altitude_m: float) -> np.ndarray:
    """How high rays pass above the ground, by their cosines to nadir, any shape."""
    sine = np.sqrt(np.maximum(1.0 - cosine**2, 0.0))
    return np.asarray((PLANET.radius_m + altitude_m) * sine - PLANET.radius_m)


def towards_the_sun(altitude_m: float, per_rad: float, white: float, seed: int) -> float:
    """`chi2` of nadir, 0 where there is none, of glow that changes by e^per_rad a radian of ground
    along the limb; in the middle it is so many times white. 0 where limb and glow were separated,
    which this is not about.
    """
    view = view_of(640, 480, 50.0)
    rho = PLANET.rho_from_altitude(altitude_m)
    roll = 0.4 + seed
    nadir = np.array([math.sin(rho) * math.cos(roll), math.sin(rho) * math.sin(roll), 0.0])
    nadir[2] = math.cos(rho)
    rays = rays_of(view)
    cosine = rays @ nadir
    height_m = heights_m(cosine, altitude_m)
    along = unit((-math.sin(roll), math.cos(roll), 0.0))
    ground_rad = np.arctan2(rays @ along, np.abs(cosine)) / math.tan(rho)
    brightness = 247.0 * white * np.exp(per_rad * ground_rad)
    light = brightness * np.where(height_m > 0.0, np.exp(-height_m / HEIGHT_M), 0.8)
    config = HorizonConfig(planet=PLANET, max_nadir_sigma_rad=math.radians(5.0))
    fix = HorizonSensor(config).process([Frame(view, exposed(light, 0.6, 1.5, seed))])
    return chi2(fix, nadir) if fix.ok and not fix.limbs[0].glow_separated else 0.0


def tilt_of_haze(per_rad: float, white: float) -> tuple[float, float]:
    """By how much an end of the limb under air that hides the ground seems to lie farther out than
    its middle, over what is claimed of that, pixels: light as of `towards_the_sun`.
    """
    view, rho = view_of(320, 240, 70.0), PLANET.rho_from_altitude(350e3)
    nadir = np.array([0.0, math.sin(rho), math.cos(rho)])
    rays = rays_of(view)
    height_m = heights_m(rays @ nadir, 350e3)
    level = np.array([0.0, -math.cos(rho), math.sin(rho)])
    ground_rad = np.arctan2(rays[..., 0], rays @ level) * math.cos(rho)
    depth = 8.0 * np.exp(-np.maximum(height_m, -5.0 * HEIGHT_M) / HEIGHT_M)
    light = 247.0 * white * np.exp(per_rad * ground_rad) * (1.0 - np.exp(-depth))
    gray, factor = exposed(light, 0.6, 1.5, 3), haze_factor(view, rho)
    sample = sample_haze(block_average(gray, factor), view, nadir, rho, factor, SEEK)
    assert sample is not None
    limb = hazy_limb(sample, haze_look(air_length_px(view, rho, factor)))
    order = np.argsort(limb.px[:, 0])
    along = np.linspace(-1.0, 1.0, len(order))
    return float(np.polyfit(along, limb.offset_px[order], 1)[0]), limb.shared.slope_px


def test_air_that_hides_the_ground_is_placed_where_it_is_white_and_says_so() -> None:
    tilt_px, claimed_px = tilt_of_haze(2.0, 0.4)
    assert abs(tilt_px) < 2.0 * claimed_px
    evenly_px = claimed_px
    # What is white lies higher where there is more light: by far more than air claims that is not.
    tilt_px, claimed_px = tilt_of_haze(2.0, 3.0)
    assert abs(tilt_px) > 4.0 * evenly_px
    assert abs(tilt_px) < 2.0 * claimed_px


def test_glow_that_is_white_claims_that_light_changes_along_it() -> None:
    """Taken to be as high all along, it turned nadir by 8 to 10 sigmas."""
    found = [
        towards_the_sun(altitude_m, per_rad, white, seed)
        for per_rad, white in ((2.0, 4.0), (4.0, 2.0))
        for seed, altitude_m in enumerate((350e3, 500e3, 700e3, 1000e3, 1400e3))
    ]
    # Of most of them glow is separated from the limb, or they are refused; which is close.
    assert max(found) > 0.0
    assert max(found) < 11.8
