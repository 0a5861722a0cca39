"""Encoded light: put back, and what a horizon gains by it."""

from __future__ import annotations

import numpy as np
import pytest
from limb_frames import draw, limb_views

from horizon_sensor_ros.core.cameras.linear_light import linear_light
from horizon_sensor_ros.core.horizon.fix import Frame
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.sim.earth_scene import Imaging


@pytest.mark.parametrize(("dtype", "white"), [(np.uint8, 255), (np.uint16, 65535)])
def test_encoding_is_undone(dtype: type, white: int) -> None:
    light = np.linspace(0.0, 1.0, 48).reshape(6, 8)
    encoded = np.rint(white * light ** (1.0 / 2.2)).astype(dtype)
    back = linear_light(encoded, 2.2)
    assert back.dtype == np.uint16
    np.testing.assert_allclose(back / 65535.0, light, atol=2.2 / white)
    assert back.max() == 65535


def test_few_bits_of_sixteen_are_as_many_levels() -> None:
    """By the law of all sixteen, ten bits of gamma 2.2 came to eight levels."""
    light = np.linspace(0.0, 1.0, 48).reshape(6, 8)
    encoded = np.rint(1023 * light ** (1.0 / 2.2)).astype(np.uint16)
    np.testing.assert_allclose(linear_light(encoded, 2.2, 1023) / 65535.0, light, atol=2.2 / 1023)
    with pytest.raises(ValueError, match="white must be from 0 to 255 for uint8, got 1023"):
        linear_light(encoded.astype(np.uint8), 2.2, 1023)


def test_nothing_is_done_to_light_that_is_not_encoded() -> None:
    gray = np.arange(12, dtype=np.uint8).reshape(3, 4)
    assert linear_light(gray, 1.0) is gray
    with pytest.raises(ValueError, match="gamma must be positive, got 0"):
        linear_light(gray, 0.0)


def test_fixes_of_encoded_frames_are_as_good_as_of_others() -> None:
    """Taken as they are, such frames give nadir off by many sigmas."""
    off_deg, nees = [], []
    for seed, altitude_m in enumerate((500e3, 1500e3, 4000e3)):
        views = limb_views(altitude_m, azimuths_rad=(0.7 * seed,))
        frame = draw(views, altitude_m, None, Imaging(noise_dn=2.0), seed)[0]
        encoded = np.rint(255.0 * (frame.image / 255.0) ** (1.0 / 2.2)).astype(np.uint8)
        fix = HorizonSensor().process([Frame(views[0], linear_light(encoded, 2.2))])
        assert fix.ok
        across = np.cross(fix.fit.nadir_base, frame.truth.nadir_base)
        off_deg.append(np.degrees(np.linalg.norm(across)))
        nees.append(2.0 * across @ across / np.trace(fix.fit.cov_nadir_altitude[:3, :3]))
    assert np.max(off_deg) < 0.02
    assert np.mean(nees) < 6.0
