"""From light to grey levels: optics, exposure, noise, defects, quantisation and coding."""

from __future__ import annotations

import cv2
import numpy as np

from horizon_sensor_ros.sim.earth_scene import Imaging, Occluder

_SUPERSAMPLING = 4


def occlusion(
    occluders: tuple[Occluder, ...], shape: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray]:
    """Share of each pixel that is hidden, and the light (DN) that the hiding parts add: float32,
    of that shape.
    """
    height, width = shape
    hidden = np.zeros(shape, np.float32)
    light = np.zeros(shape, np.float32)
    for occluder in occluders:
        fine = np.zeros((height * _SUPERSAMPLING, width * _SUPERSAMPLING), np.uint8)
        corners = (np.asarray(occluder.corners_px, float) + 0.5) * _SUPERSAMPLING - 0.5
        cv2.fillPoly(fine, [np.rint(corners).astype(np.int32)], 255)
        coarse = cv2.resize(fine, (width, height), interpolation=cv2.INTER_AREA)
        share = coarse.astype(np.float32) / 255.0
        hidden = hidden * (1.0 - share) + share
        light = light * (1.0 - share) + share * np.float32(occluder.brightness_dn)
    return hidden, light


def expose(light: np.ndarray, imaging: Imaging, rng: np.random.Generator) -> np.ndarray:
    """Signal of light (H, W), both float32 in DN, without noise: vignetting, PSF, gain, rolling
    brightness, stray light, background.
    """
    height, width = light.shape
    signal = light
    if imaging.vignetting > 0.0:
        signal = signal * (1.0 - np.float32(imaging.vignetting) * _cornered(height, width))
    if imaging.corner_psf_px > 0.0:
        share = _cornered(height, width)
        middle, corner = (
            _blurred(signal, psf) for psf in (imaging.psf_sigma_px, imaging.corner_psf_px)
        )
        signal = middle + share * (corner - middle)
    else:
        signal = _blurred(signal, imaging.psf_sigma_px)
    signal = signal * np.float32(imaging.gain)
    if imaging.banding > 0.0:
        phase = rng.uniform(0.0, 2.0 * np.pi)
        rows = np.arange(height) * (2.0 * np.pi / imaging.banding_period_px) + phase
        signal = signal * (1.0 + imaging.banding * np.sin(rows)).astype(np.float32)[:, None]
    if imaging.stray_dn > 0.0:
        ramp = _ramp(signal.shape, imaging.stray_angle_rad)
        signal = signal + np.float32(imaging.stray_dn) * ramp
    return signal + np.float32(imaging.background_dn)


def _cornered(height: int, width: int) -> np.ndarray:
    """From 0 in the middle of a frame (H, W) to 1 in its corners, as the square of the distance,
    for which its sides are of one length.
    """
    x = (np.arange(width, dtype=np.float32) - (width - 1) / 2.0) / (width / 2.0)
    y = (np.arange(height, dtype=np.float32) - (height - 1) / 2.0) / (height / 2.0)
    return np.asarray(0.5 * ((y * y)[:, None] + (x * x)[None, :]), np.float32)


def _blurred(signal: np.ndarray, psf_sigma_px: float) -> np.ndarray:
    if psf_sigma_px == 0.0:
        return signal
    blurred = cv2.GaussianBlur(signal, (0, 0), psf_sigma_px, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(blurred, np.float32)


def _ramp(shape: tuple[int, ...], angle_rad: float) -> np.ndarray:
    """From 0 to 1 across a frame (H, W), corner to corner at most, in a direction."""
    height, width = shape
    x = np.cos(angle_rad) * np.linspace(-0.5, 0.5, width) * width
    y = np.sin(angle_rad) * np.linspace(-0.5, 0.5, height) * height
    along = x + y[:, None]
    return np.asarray((along - along.min()) / (along.max() - along.min()), np.float32)


def digitise(signal: np.ndarray, imaging: Imaging, rng: np.random.Generator) -> np.ndarray:
    """Add noise and defects to a signal (H, W), DN, then quantise: uint8, or uint16 for more than 8
    bits. 255 DN are full scale whatever the number of bits.
    """
    noise = rng.standard_normal(signal.shape, dtype=np.float32)
    if imaging.shot_noise_dn > 0.0:
        variance = imaging.noise_dn**2 + imaging.shot_noise_dn * np.maximum(signal, 0.0)
        noise *= np.sqrt(variance)
    else:
        noise *= np.float32(imaging.noise_dn)
    noise += signal
    if imaging.hot_pixels > 0:
        where = rng.integers(0, noise.size, imaging.hot_pixels)
        noise.flat[where] += rng.uniform(60.0, 255.0, imaging.hot_pixels)
    full_scale = 2**imaging.bits - 1
    if imaging.bits > 8:
        scaled = np.rint(noise * np.float32(full_scale / 255.0))
        return np.clip(scaled, 0, full_scale).astype(np.uint16)
    image = np.clip(np.rint(noise), 0, 255).astype(np.uint8)
    if imaging.jpeg_quality is None:
        return image
    _, code = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, int(imaging.jpeg_quality)])
    return np.asarray(cv2.imdecode(code, cv2.IMREAD_GRAYSCALE), np.uint8)
