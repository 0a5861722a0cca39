"""Ground without air, brightest at its limb, drawn here, against what is claimed of it."""

from __future__ import annotations

import cv2
import numpy as np

from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.covariance.bare_ground import with_bare_ground
from horizon_sensor_ros.core.fits.observation import LimbObservation
from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.core.horizon.fix import Frame
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.status import Status

MOON = Planet(1737.4e3, has_air=False)
CAMERA = Camera(320, 240, 220.0, 220.0, 159.5, 119.5)
FINE = 4  # drawn pixels to a pixel
NADIR = np.array([0.0, 0.0, 1.0])


def view_towards(azimuth_rad: float, altitude_m: float) -> CameraView:
    """View of a camera that looks at the limb in an azimuth."""
    rho_rad = MOON.rho_from_altitude(altitude_m)
    east = np.array([np.cos(azimuth_rad), np.sin(azimuth_rad), 0.0])
    boresight = np.cos(rho_rad) * NADIR + np.sin(rho_rad) * east
    right = np.cross(NADIR, east)
    rot_base_from_cam = np.column_stack([right, np.cross(boresight, right), boresight])
    return CameraView(f"camera_{azimuth_rad:.0f}", CAMERA, rot_base_from_cam)


def frame_of(view: CameraView, altitude_m: float, sun: np.ndarray, seed: int) -> Frame:
    """Frame of even ground by Lommel-Seeliger's law."""
    y, x = (np.mgrid[: 240 * FINE, : 320 * FINE] + 0.5) / FINE - 0.5
    rays = np.stack([(x - CAMERA.cx) / CAMERA.fx, (y - CAMERA.cy) / CAMERA.fy, np.ones_like(x)], -1)
    rays = rays / np.linalg.norm(rays, axis=-1, keepdims=True) @ view.rot_base_from_cam.T
    craft = -NADIR * (MOON.radius_m + altitude_m)
    to_middle = -rays @ craft
    inside = to_middle**2 - (craft @ craft - MOON.radius_m**2)
    hit = (inside > 0.0) & (to_middle > 0.0)
    far = to_middle - np.sqrt(np.maximum(inside, 0.0))
    up = (craft + far[..., None] * rays) / MOON.radius_m
    to_craft = np.abs(np.einsum("...i,...i", up, rays))
    to_sun = np.maximum(up @ sun, 0.0)
    drawn = np.where(hit, to_sun / np.maximum(to_sun + to_craft, 1e-9), 0.0)
    drawn = cv2.GaussianBlur(drawn, (0, 0), 0.55 * FINE)
    levels = 8.0 + 170.0 * drawn.reshape(240, FINE, 320, FINE).mean(axis=(1, 3))
    levels += np.random.default_rng(seed).normal(0.0, 1.5, levels.shape)
    return Frame(view, np.clip(np.rint(levels), 0, 255).astype(np.uint8))


def test_ground_that_is_brightest_at_its_limb_claims_how_much_higher_that_lies() -> None:
    errors = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        altitude_m = 10.0 ** rng.uniform(4.8, 5.8)
        height, azimuth = rng.uniform(0.5, 1.2), rng.uniform(0.0, 6.0)
        aside = np.cos(height) * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        sun = aside - np.sin(height) * NADIR
        frames = [frame_of(view_towards(a, altitude_m), altitude_m, sun, seed) for a in (0.0, 3.1)]
        fix = HorizonSensor(HorizonConfig(planet=MOON)).process(frames)
        assert fix.ok, fix.reason
        sigma_m = np.sqrt(fix.fit.cov_nadir_altitude[3, 3])
        errors.append((fix.fit.altitude_m - altitude_m) / sigma_m)
    # Told nothing of it, the altitudes are 6 to 17 sigmas too low.
    assert np.mean(errors) < -0.3
    assert np.sqrt(np.mean(np.square(errors))) < 2.0


def test_a_limb_that_the_sun_stands_higher_over_at_one_end_claims_how_it_is_turned() -> None:
    """By one camera alone: nadir is off along the limb, away from the Sun."""
    errors = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        altitude_m, height = 10.0 ** rng.uniform(4.8, 5.8), rng.uniform(0.3, 0.9)
        sun = np.array([0.0, np.cos(height), 0.0]) - np.sin(height) * NADIR
        frame = frame_of(view_towards(0.0, altitude_m), altitude_m, sun, seed)
        fix = HorizonSensor(HorizonConfig(planet=MOON)).process([frame])
        assert fix.ok, fix.reason
        errors.append(fix.fit.nadir_base[1] / np.sqrt(fix.fit.cov_nadir_altitude[1, 1]))
    # Told nothing of it, it is 1.6 sigmas off.
    assert np.mean(errors) < -0.3
    assert 0.5 < np.sqrt(np.mean(np.square(errors))) < 1.2


def test_nothing_is_claimed_under_air_nor_without_a_limb() -> None:
    view = view_towards(0.0, 1e5)
    unseen = LimbObservation(view, LimbPoints.none(Status.NO_LIMB, "night"))
    assert with_bare_ground([unseen], MOON, np.nan) == (unseen,)
    assert with_bare_ground([unseen], Planet(1737.4e3), 1.0) == (unseen,)
