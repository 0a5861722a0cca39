import numpy as np
import pytest

from horizon_sensor_ros.sim.earth_scene import Imaging, Occluder
from horizon_sensor_ros.sim.recording import digitise, expose, occlusion


def record(light: np.ndarray, imaging: Imaging) -> np.ndarray:
    rng = np.random.default_rng(0)
    return digitise(expose(light.astype(np.float32), imaging, rng), imaging, rng)


GREY = np.full((240, 320), 100.0)


def test_noise_adds_read_and_shot_parts() -> None:
    image = record(GREY, Imaging(noise_dn=3.0, shot_noise_dn=0.16, background_dn=0.0))
    assert image.mean() == pytest.approx(100.0, abs=0.1)
    assert image.std() == pytest.approx(np.sqrt(9.0 + 16.0), rel=0.03)


def test_psf_spreads_a_point_by_its_sigma() -> None:
    point = np.zeros((41, 41))
    point[20, 20] = 1500.0
    image = record(point, Imaging(psf_sigma_px=1.3, noise_dn=0.0, background_dn=0.0, bits=16))
    weight = image.astype(float)
    x = np.arange(41) - 20.0
    assert weight.sum() * 255 / 65535 == pytest.approx(1500.0, rel=1e-3)
    assert np.sqrt((weight.sum(axis=0) @ x**2) / weight.sum()) == pytest.approx(1.3, rel=0.02)


def test_bits_set_type_and_full_scale() -> None:
    plain = Imaging(noise_dn=0.0, background_dn=0.0)
    assert record(GREY, plain).dtype == np.uint8
    deep = record(GREY, Imaging(noise_dn=0.0, background_dn=0.0, bits=12))
    assert deep.dtype == np.uint16
    assert deep[0, 0] == pytest.approx(100.0 / 255.0 * 4095.0, abs=1)
    assert record(GREY * 10, plain).max() == 255
    assert record(GREY * 10, Imaging(bits=12)).max() == 4095


def test_gain_scales_light_but_not_background() -> None:
    image = record(GREY, Imaging(gain=0.25, background_dn=8.0, noise_dn=0.0))
    assert np.all(image == 33)


def test_vignetting_darkens_corners_only() -> None:
    image = record(GREY, Imaging(vignetting=0.6, background_dn=0.0, noise_dn=0.0))
    assert image[120, 160] == 100
    assert image[0, 0] == pytest.approx(40.0, abs=1.5)


def test_banding_runs_over_rows() -> None:
    image = record(
        GREY, Imaging(banding=0.2, banding_period_px=60.0, noise_dn=0.0, background_dn=0.0)
    )
    rows = image.mean(axis=1)
    assert rows.max() == pytest.approx(120.0, abs=1.0)
    assert rows.min() == pytest.approx(80.0, abs=1.0)
    assert np.all(image.std(axis=1) < 1e-9)
    np.testing.assert_allclose(rows[:60], rows[60:120], atol=1.0)


@pytest.mark.parametrize("angle_rad", [0.0, 0.8, -2.0])
def test_stray_light_rises_evenly_from_one_end_of_the_frame_to_the_other(angle_rad: float) -> None:
    how = Imaging(
        stray_dn=60.0, stray_angle_rad=angle_rad, gain=0.5, noise_dn=0.0, background_dn=4.0, bits=16
    )
    light = record(np.zeros((240, 320)), how) * (255.0 / 65535.0) - 4.0
    assert light.min() == pytest.approx(0.0, abs=0.01)
    assert light.max() == pytest.approx(60.0, abs=0.01)
    down, right = (float(np.diff(light, axis=axis).mean()) for axis in (0, 1))
    assert np.arctan2(down, right) == pytest.approx(angle_rad, abs=1e-3)


def test_hot_pixels_and_jpeg() -> None:
    hot = record(GREY, Imaging(hot_pixels=30, noise_dn=0.0, background_dn=0.0))
    assert 20 <= np.count_nonzero(hot > 140) <= 30
    rng = np.random.default_rng(1)
    light = 100.0 + 20.0 * rng.standard_normal(GREY.shape)
    coded = record(light, Imaging(jpeg_quality=20, noise_dn=0.0, background_dn=0.0)).astype(float)
    step = np.abs(np.diff(coded, axis=1)).mean(axis=0)
    at_block = step[7::8].mean()
    assert at_block > 1.3 * np.delete(step, np.arange(7, 319, 8)).mean()


def test_occluders_cover_by_area_and_the_last_lies_on_top() -> None:
    square = Occluder(((9.5, 9.5), (19.75, 9.5), (19.75, 29.5), (9.5, 29.5)), 50.0)
    over = Occluder(((9.5, 19.5), (19.5, 19.5), (19.5, 39.5), (9.5, 39.5)), 80.0)
    hidden, light = occlusion((square, over), (60, 60))
    assert hidden[15, 15] == 1.0
    assert light[15, 15] == pytest.approx(50.0)
    assert light[25, 15] == pytest.approx(80.0)
    assert hidden[15, 20] == pytest.approx(0.25, abs=0.26)
    assert hidden[50, 50] == 0.0
