"""Frames of 16 bits whose bytes are swapped, and those that only look a little like it."""

from __future__ import annotations

import numpy as np
import pytest
from limb_frames import as_frames, clouds, draw, limb_views

from horizon_sensor_ros.core.cameras.byte_order import bytes_swapped
from horizon_sensor_ros.sim.earth_scene import Imaging

ALTITUDE_M = 500e3
VIEWS = limb_views(ALTITUDE_M, azimuths_rad=(0.0, 1.5))
FRAMES = as_frames(VIEWS, draw(VIEWS, ALTITUDE_M, clouds(3), Imaging(noise_dn=1.5)))


def of_bits(gray: np.ndarray, bits: int) -> np.ndarray:
    """A frame of so many bits, whose lowest ones are noise."""
    low = np.random.default_rng(bits).random(gray.shape)
    return ((gray + low) * 2.0 ** (bits - 8)).astype(np.uint16)


@pytest.mark.parametrize("at_the_top", [False, True])
@pytest.mark.parametrize("bits", [10, 12, 14, 16])
def test_the_order_of_bytes_shows_in_a_frame(bits: int, at_the_top: bool) -> None:
    for frame in FRAMES:
        gray = of_bits(frame.gray, bits) << (16 - bits if at_the_top else 0)
        assert not bytes_swapped(gray)
        assert bytes_swapped(gray.byteswap())


@pytest.mark.parametrize("factor", [1, 256, 257])
def test_of_eight_bits_either_order_is_the_same_picture(factor: int) -> None:
    for frame in FRAMES:
        gray = frame.gray.astype(np.uint16) * np.uint16(factor)
        assert not bytes_swapped(gray)
        assert not bytes_swapped(gray.byteswap())


@pytest.mark.parametrize("level", [0.0, 130.0, 256.0, 511.5, 30000.0])
@pytest.mark.parametrize("sigma", [0.0, 0.5, 3.0, 40.0, 8000.0])
def test_noise_alone_has_no_order(level: float, sigma: float) -> None:
    noise = np.random.default_rng(1).normal(level, sigma, (240, 320))
    assert not bytes_swapped(np.clip(noise, 0, 65535).astype(np.uint16))


@pytest.mark.parametrize("shape", [(1, 1), (1, 4000), (4000, 1), (4000, 2), (20, 40)])
def test_frames_of_any_shape(shape: tuple[int, int]) -> None:
    values = np.random.default_rng(2).integers(0, 65536, shape, dtype=np.uint16)
    assert not bytes_swapped(values)
