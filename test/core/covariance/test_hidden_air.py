"""Air that is too thin to be seen above the limb: in altitude's sigma, not in nadir's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from limb_frames import PLANET, as_frames, draw, limb_views

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.covariance.hidden_air import hidden_air_sigma_m
from horizon_sensor_ros.core.fits.observation import LimbObservation
from horizon_sensor_ros.core.horizon.fix import HorizonFix
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.limb.air import usual_length_px
from horizon_sensor_ros.sim.earth_scene import EarthScene, Imaging
from horizon_sensor_ros.sim.poses import camera_from_fov


def fixed(views: tuple[CameraView, ...], altitude_m: float, scene: EarthScene) -> HorizonFix:
    return HorizonSensor().process(as_frames(views, draw(views, altitude_m, scene, Imaging(), 1)))


@pytest.mark.parametrize(
    ("air_dn", "texture"), [(40.0, "uniform"), (130.0, "uniform"), (90.0, "clouds")]
)
@pytest.mark.parametrize("altitude_m", [10e6, 36e6, 60e6])
def test_altitude_from_far_away_is_known_as_far_as_air_lets_it(
    altitude_m: float, air_dn: float, texture: str
) -> None:
    """It was off by 4 to 45 sigma."""
    scene = EarthScene(texture=texture, texture_seed=3, air_dn=air_dn, air_scale_height_m=8.5e3)
    fix = fixed(limb_views(altitude_m), altitude_m, scene)
    assert fix.ok
    sigma_m = np.sqrt(fix.fit.cov_nadir_altitude[3, 3])
    assert abs(fix.fit.altitude_m - altitude_m) < 3.0 * sigma_m
    # A limb that lies 18 km higher alone makes .46 % at 10 000 km.
    assert sigma_m < 0.005 * altitude_m


@pytest.mark.parametrize(
    ("altitude_m", "air_depth"),
    [
        (400e3, 6.0),
        (700e3, 20.0),
        (10e6, 6.0),
        (36e6, 20.0),
        pytest.param(400e3, 20.0, marks=pytest.mark.slow),
        pytest.param(700e3, 6.0, marks=pytest.mark.slow),
        pytest.param(10e6, 20.0, marks=pytest.mark.slow),
        pytest.param(36e6, 6.0, marks=pytest.mark.slow),
    ],
)
def test_coarse_pixels_do_not_tell_air_that_hides_the_ground(
    altitude_m: float, air_depth: float
) -> None:
    """At .2 deg a pixel altitude was 12 to 24 km off at 1.4 to 2.6 claimed."""
    over_sigma = []
    for seed in range(3):
        scene = EarthScene(
            texture="clouds",
            texture_seed=seed,
            air_dn=130.0,
            air_depth=air_depth,
            air_scale_height_m=8e3,
        )
        camera = camera_from_fov(640, 480, np.radians(115.0))
        fix = fixed(limb_views(altitude_m, camera, azimuths_rad=(0.4, 2.0)), altitude_m, scene)
        if fix.ok:
            variance = fix.fit.cov_nadir_altitude[3, 3]
            over_sigma.append((fix.fit.altitude_m - altitude_m) / np.sqrt(variance))
    assert over_sigma
    assert np.abs(over_sigma).max() < 3.0


@pytest.mark.parametrize(
    "air_dn", [8.0, 60.0, *(pytest.param(dn, marks=pytest.mark.slow) for dn in (15.0, 200.0))]
)
def test_air_that_passes_for_blur_is_in_the_altitudes_sigma(air_dn: float) -> None:
    """Above even ground: altitude was off by up to 80 sigma."""
    off = []
    for seed, altitude_m in enumerate((500e3, 900e3, 1.6e6, 2.2e6, 3.3e6, 5.5e6)):
        scene = EarthScene(air_dn=air_dn, air_scale_height_m=8e3)
        views = limb_views(altitude_m, azimuths_rad=(0.4 + seed, 2.0 + seed))
        fix = fixed(views, altitude_m, scene)
        assert fix.ok
        off.append((fix.fit.altitude_m - altitude_m) / np.sqrt(fix.fit.cov_nadir_altitude[3, 3]))
    assert np.abs(off).max() < 2.0


def test_edges_sharper_than_air_would_leave_them_are_the_grounds() -> None:
    altitude_m = 2e6
    fix = fixed(limb_views(altitude_m), altitude_m, EarthScene())
    assert fix.limbs[0].blur_px == pytest.approx(0.757, abs=0.01)  # of the optics, and of a pixel
    assert np.sqrt(fix.fit.cov_nadir_altitude[3, 3]) < 200.0  # and not 2 km


@pytest.mark.parametrize(
    ("texture", "psf_px", "air_dn", "air_depth"),
    [("uniform", 1.2, 130.0, 6.0), ("uniform", 1.5, 60.0, 15.0), ("clouds", 1.8, 130.0, 15.0)],
)
def test_soft_lenses_do_not_tell_air_that_hides_the_ground(
    texture: str, psf_px: float, air_dn: float, air_depth: float
) -> None:
    """Altitude was 18 to 29 km too low, 32 to 49 sigma."""
    altitude_m = 800e3
    scene = EarthScene(
        texture=texture,
        texture_seed=3,
        air_dn=air_dn,
        air_depth=air_depth,
        air_scale_height_m=8e3,
    )
    camera = camera_from_fov(480, 360, np.radians(62.0))
    views = limb_views(altitude_m, camera, azimuths_rad=(0.4, 2.0))
    frames = draw(views, altitude_m, scene, Imaging(psf_sigma_px=psf_px), 1)
    fix = HorizonSensor().process(as_frames(views, frames))
    assert fix.ok
    sigma_m = np.sqrt(fix.fit.cov_nadir_altitude[3, 3])
    assert abs(fix.fit.altitude_m - altitude_m) < 3.0 * sigma_m


def test_an_edge_steeper_than_airs_is_the_grounds_for_all_cameras() -> None:
    altitude_m = 1.2e6
    (view,) = limb_views(altitude_m)[:1]
    fix = fixed((view,), altitude_m, EarthScene())
    height_px = usual_length_px(view, fix.fit.rho_rad)
    # Cold air's, a quarter lower: its edge falls by at most 1 / e over a scale height.
    at_px = np.arange(-20.0, 20.0, 1e-3)
    fall = np.gradient(np.exp(-np.exp(-at_px / (0.75 * height_px))), at_px).max()
    as_steep_px = float(np.hypot(1.0 / (np.sqrt(2.0 * np.pi) * fall), np.sqrt(1.0 / 12.0)))

    def claimed_m(*blurs_px: float) -> float:
        limbs = [replace(fix.limbs[0], blur_px=blur_px) for blur_px in blurs_px]
        return hidden_air_sigma_m(fix.fit, [LimbObservation(view, each) for each in limbs], PLANET)

    assert claimed_m(0.98 * as_steep_px) < 3e3
    assert claimed_m(1.02 * as_steep_px) == pytest.approx(18e3, rel=0.01)
    assert claimed_m(1.5, np.nan) == pytest.approx(18e3, rel=0.01)  # of the other nothing is known
    assert claimed_m(1.5, 0.98 * as_steep_px) < 3e3


def test_edges_that_no_model_fits_may_be_airs() -> None:
    altitude_m = 2e6
    views = limb_views(altitude_m)
    fix = fixed(views, altitude_m, EarthScene())
    limb = LimbObservation(views[0], fix.limbs[0])
    assert hidden_air_sigma_m(fix.fit, [limb], PLANET) == 0.0
    without = LimbObservation(views[0], replace(fix.limbs[0], modelled=False))
    assert hidden_air_sigma_m(fix.fit, [without], PLANET) == pytest.approx(0.8 * 8.5e3)


def test_air_that_would_be_seen_is_not_hidden() -> None:
    """The same limb in coarser pixels, until half of one is more than air fades over."""
    altitude_m = 8e6
    sigmas_m = []
    for width in (1600, 640):
        views = limb_views(altitude_m, camera_from_fov(width, width, np.radians(60.0)))
        fix = fixed(views, altitude_m, EarthScene())
        assert fix.ok
        seen = [LimbObservation(view, limb) for view, limb in zip(views, fix.limbs, strict=True)]
        sigmas_m.append(hidden_air_sigma_m(fix.fit, seen, PLANET))
    assert sigmas_m[0] == 0.0
    assert sigmas_m[1] == pytest.approx(18e3, rel=0.01)


def test_pixels_of_a_reduced_frame_are_coarser() -> None:
    """Faint limbs under air, placed in such frames: 10 km too high, and sure to 1.5."""
    altitude_m = 1.2e6
    (view,) = limb_views(altitude_m)[:1]
    fix = fixed((view,), altitude_m, EarthScene())
    assert 0.8 < usual_length_px(view, fix.fit.rho_rad) < 1.6
    soft = replace(fix.limbs[0], blur_px=0.9)  # in the full frame steeper than air's edges
    sigmas_m = [
        hidden_air_sigma_m(fix.fit, [LimbObservation(view, limb)], PLANET)
        for limb in (soft, replace(soft, factor=2))
    ]
    assert sigmas_m[0] < 3e3
    assert sigmas_m[1] == pytest.approx(18e3, rel=0.01)


def test_the_finest_camera_decides() -> None:
    altitude_m = 8e6
    fine, coarse = (
        limb_views(altitude_m, camera_from_fov(width, width, np.radians(60.0)))[0]
        for width in (1600, 640)
    )
    fix = fixed((fine,), altitude_m, EarthScene())
    both = [LimbObservation(view, fix.limbs[0]) for view in (coarse, fine)]
    assert hidden_air_sigma_m(fix.fit, both, PLANET) == 0.0


def test_air_that_hides_the_ground_is_seen_and_still_of_unknown_height() -> None:
    (view,) = limb_views(500e3)[:1]
    fix = fixed((view,), 500e3, EarthScene())
    hazy = LimbObservation(view, replace(fix.limbs[0], above_m=17e3))
    assert hidden_air_sigma_m(fix.fit, [hazy], PLANET) == pytest.approx(18e3, rel=0.01)
    told = replace(PLANET, limb_height_m=17e3)
    assert hidden_air_sigma_m(fix.fit, [hazy], told) == pytest.approx(6e3)


@pytest.mark.parametrize("limb_height_m", [17e3, 77e3, 250e3])
def test_a_limb_that_is_told_to_lie_high_is_not_claimed_to_lie_low(limb_height_m: float) -> None:
    """As of planets with thicker air: told 77 km, altitude claimed 60 km besides."""
    views = limb_views(36e6)
    fix = fixed(views, 36e6, EarthScene())
    planet = replace(PLANET, limb_height_m=limb_height_m)
    seen = [LimbObservation(view, limb) for view, limb in zip(views, fix.limbs, strict=True)]
    assert hidden_air_sigma_m(fix.fit, seen, planet) == pytest.approx(6e3)
