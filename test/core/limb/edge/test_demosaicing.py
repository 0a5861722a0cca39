"""Frames of colour cameras, interpolated from a Bayer pattern, and white edges in them."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from limb_frames import as_frames, draw, limb_views

from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.limb.edge.demosaicing import demosaiced
from horizon_sensor_ros.sim.earth_scene import EarthScene, Imaging
from horizon_sensor_ros.sim.poses import camera_from_fov


def interpolated(raw: np.ndarray) -> np.ndarray:
    """Gray frame (H, W) of a Bayer pattern before ground without colour."""
    return np.asarray(cv2.cvtColor(raw, cv2.COLOR_BayerBG2GRAY))


@pytest.mark.parametrize("noise_dn", [0.7, 2.0])
@pytest.mark.parametrize("full", [255, 65535])
def test_frames_that_were_interpolated_are_told_from_others(noise_dn: float, full: int) -> None:
    rng = np.random.default_rng(4)
    light = np.tile(np.linspace(8.0, 200.0, 320), (240, 1))
    light[100:140, 100:160] = 300.0
    light = (light + rng.normal(0.0, noise_dn, light.shape)) * (full / 255.0)
    raw = np.rint(np.clip(light, 0.0, full)).astype(np.uint8 if full == 255 else np.uint16)
    assert demosaiced(interpolated(raw), full)
    assert not demosaiced(raw, full)
    assert not demosaiced(cv2.GaussianBlur(raw, (0, 0), 0.7), full)
    assert not demosaiced(cv2.resize(raw, (400, 300), interpolation=cv2.INTER_LINEAR), full)


def test_a_frame_without_noise_or_of_a_few_pixels_is_not_told() -> None:
    assert not demosaiced(np.full((240, 320), 9, np.uint8), 255.0)
    assert not demosaiced(np.zeros((3, 3), np.uint8), 255.0)


def test_overexposed_limbs_of_colour_cameras_claim_how_far_out_they_lie() -> None:
    """White ends up to a pixel farther inside. Taken for plain edges they lay too far out:
    altitude was 1.5 to 49 sigmas too small.
    """
    camera = camera_from_fov(480, 360, np.radians(45.0))
    high = []
    for seed, altitude_m in enumerate((500e3, 1000e3)):
        views = limb_views(altitude_m, camera, azimuths_rad=(0.7 * seed, 0.7 * seed + np.pi))
        for brightness_dn in (360.0, 500.0, 800.0):
            scene = EarthScene(uniform_dn=brightness_dn)
            frames = draw(views, altitude_m, scene, Imaging(noise_dn=1.0), seed)
            images = [interpolated(frame.image) for frame in frames]
            fix = HorizonSensor().process(as_frames(views, images))
            assert fix.ok
            sigma_m = np.sqrt(fix.fit.cov_nadir_altitude[3, 3])
            high.append((fix.fit.altitude_m - altitude_m) / sigma_m)
    assert np.abs(high).max() < 3.0
