"""Space clipped at zero: the law it had, edges whose feet were clipped, fixes of such frames."""

from __future__ import annotations

import numpy as np
import pytest
from limb_frames import as_frames, draw, limb_views

from horizon_sensor_ros.core.horizon.fix import Frame
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.limb.edge.black import Black, black_of
from horizon_sensor_ros.sim.earth_scene import Imaging


def clipped(values: np.ndarray) -> np.ndarray:
    return np.maximum(np.rint(values), 0.0).astype(np.uint16)


@pytest.mark.parametrize("sigma", [2.0, 8.0, 40.0])
@pytest.mark.parametrize("below", [-1.0, 0.0, 1.0, 1.5])
def test_the_law_is_told_by_what_is_left_of_it(sigma: float, below: float) -> None:
    rng = np.random.default_rng(1)
    found = black_of(clipped(rng.normal(-below * sigma, sigma, 20000)))
    assert found is not None
    # Of a law two gray levels wide only a few whole numbers are left.
    near = 0.1 + 0.4 / sigma
    assert found.sigma == pytest.approx(sigma, rel=near)
    assert found.mean == pytest.approx(-below * sigma, abs=2.0 * near * sigma)


def test_nothing_is_told_where_little_is_clipped_or_nearly_all() -> None:
    rng = np.random.default_rng(2)
    assert black_of(clipped(rng.normal(12.0, 4.0, 4000))) is None
    stars = np.zeros(4000, dtype=np.uint8)
    stars[:30] = 120
    assert black_of(stars) is None
    faint = clipped(rng.normal(-1.0, 0.8, 4000))
    faint[:30] = 120
    assert black_of(faint) is None
    assert black_of(np.zeros(4000, dtype=np.uint8)) is None


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_nothing_is_told_by_white_pixels(dtype: type[np.unsignedinteger]) -> None:
    """What does not follow zero but white, as of 1-bit video: how bright it was is not known."""
    most = np.iinfo(dtype).max
    space = np.zeros(1000, dtype=dtype)
    space[:300] = most
    assert black_of(space) is None
    space[:300] = most - 1
    found = black_of(space)
    assert found is None or 0.0 < found.sigma < 2.0 * most


def test_white_dots_in_dark_sky_do_not_stop_the_search() -> None:
    views = limb_views(800e3)
    image = draw(views, 800e3, None, Imaging(noise_dn=2.0), 3)[0].image
    dots = np.random.default_rng(0).random(image.shape)
    for share in (0.02, 0.1, 0.3):
        dotted = np.where(image > 60, 255, np.where(dots < share, 255, 0)).astype(np.uint8)
        fix = HorizonSensor().process(as_frames(views[:1], [dotted]))
        assert fix.ok or fix.reason


def test_means_of_clipped_samples_are_taken_back() -> None:
    rng = np.random.default_rng(3)
    black = Black(-4.0, 4.0)
    truth = np.array([-4.0, -2.0, 0.0, 3.0, 12.0, 150.0])
    means = np.maximum(rng.normal(truth, 4.0, (40000, 6)), 0.0).mean(axis=0)
    np.testing.assert_allclose(black.unclipped(means), truth, atol=0.15)
    # Where sampling swings beyond an edge it does so as without clipping, but for what may be
    # scatter.
    swings = black.unclipped(means[0] - np.array([0.0, 0.5, 4.0, 8.0]))
    np.testing.assert_allclose(swings, [-4.0, -4.0, -7.0, -11.0], atol=0.15)


def test_an_edges_foot_is_not_taken_for_noise_of_space() -> None:
    """Of a picture without noise, whose space is black, it is all that is lit."""
    off = []
    for seed, altitude_m in enumerate((500e3, 1500e3, 4000e3)):
        views = limb_views(altitude_m, azimuths_rad=(0.8 * seed, 0.8 * seed + 1.5))
        imaging = Imaging(noise_dn=0.0, background_dn=0.0, psf_sigma_px=1.1)
        drawn = draw(views, altitude_m, None, imaging, seed)
        fix = HorizonSensor().process(as_frames(views, drawn))
        assert fix.ok
        sigma_m = np.sqrt(fix.fit.cov_nadir_altitude[3, 3])
        off.append((fix.fit.altitude_m - altitude_m) / sigma_m)
    assert np.abs(off).max() < 3.0


@pytest.mark.parametrize("below", [0.0, 1.5])
def test_fixes_are_as_good_as_without_clipping(below: float) -> None:
    """Without the law of space their errors are two to three times those above a pedestal."""
    errors: list[list[float]] = [[], []]
    for found, background in zip(errors, (8.0, -4.0 * below), strict=True):
        for seed, altitude_m in enumerate((500e3, 800e3, 1500e3, 4000e3)):
            views = limb_views(altitude_m, azimuths_rad=(0.8 * seed,))
            imaging = Imaging(noise_dn=4.0, background_dn=background)
            drawn = draw(views, altitude_m, None, imaging, seed)[0]
            fix = HorizonSensor().process([Frame(views[0], drawn.image)])
            assert fix.ok
            off = np.cross(fix.fit.nadir_base, drawn.truth.nadir_base)
            found.append(float(np.sqrt(off @ off)))
    plain, dark = (np.sqrt(np.mean(np.square(found))) for found in errors)
    assert dark < 1.5 * plain
