"""Edges of an overexposed planet: against drawn ones, clipped pixel by pixel."""

from __future__ import annotations

import numpy as np
import pytest
from limb_frames import draw, limb_views

from horizon_sensor_ros.core.horizon_sensor import Frame, HorizonSensor
from horizon_sensor_ros.core.limb.edge.clipping import clipped, place_clipped_edges, white_level
from horizon_sensor_ros.core.limb.edge.model import normal_cdf
from horizon_sensor_ros.core.limb.profiles import sample_profiles
from horizon_sensor_ros.core.limb_curve import LimbCurve
from horizon_sensor_ros.sim.earth_scene import EarthScene, Imaging

D_PX = np.arange(-7.0, 8.0)


def overexposed(height_dn: float, offset_px: float, tilt: float = 0.21) -> np.ndarray:
    """Mean profiles (40, J) across a slanted straight edge, predicted `offset_px` inside it."""
    rng = np.random.default_rng(2)
    y, x = np.mgrid[0.0:60.0, 0.0:700.0]
    normal = np.array([np.sin(tilt), -np.cos(tilt)])
    through = np.array([350.0, 30.0])
    distance = (x - through[0]) * normal[0] + (y - through[1]) * normal[1]
    light = 4.0 + height_dn * normal_cdf(-distance / 0.757) + rng.normal(0.0, 2.0, x.shape)
    image = np.rint(np.clip(light, 0.0, 255.0)).astype(np.uint8)
    along = np.arange(-80.0, 80.0)[:, None] * np.array([np.cos(tilt), np.sin(tilt)])
    px = through + along - offset_px * normal
    curve = LimbCurve(px, np.tile(normal, (len(px), 1)))
    profiles, valid = sample_profiles(image, curve, D_PX)
    assert valid.all()
    return profiles.reshape(10, 16, -1).mean(axis=1)


@pytest.mark.parametrize("height_dn", [330.0, 400.0, 550.0])
@pytest.mark.parametrize("offset_px", [-0.3, 0.0, 0.25])
def test_places_lie_on_the_edge_within_the_error_they_share(
    height_dn: float, offset_px: float
) -> None:
    profiles = overexposed(height_dn, offset_px)
    assert clipped(profiles, D_PX, 255.0).all()
    found = place_clipped_edges(profiles, D_PX, 255.0, 0.5, 1.0)
    off = found.places.offset_px - offset_px
    assert np.std(off) < 0.03
    assert abs(np.mean(off)) < 2.0 * found.shared.shift_px
    assert not found.places.at_border.any()
    assert found.places.misfit.max() < 3.0


def test_white_is_a_level_of_cameras() -> None:
    frame = np.full((4, 4), 200, dtype=np.uint8)
    assert white_level(frame, frame) == np.inf
    frame[0, 0] = 255
    assert white_level(frame, frame) == 255.0
    # What is looked at is dark, wherever else the frame is white.
    assert white_level(frame, frame[1:]) == np.inf
    for level, white in ((4095, 4095.0), (3000, np.inf)):
        frame = np.full((4, 4), level, dtype=np.uint16)
        assert white_level(frame, frame) == white


def test_bright_ground_that_ends_before_the_limb_is_not_a_clipped_edge() -> None:
    profiles = np.tile(np.where(D_PX < -1.5, 255.0, np.where(D_PX < 0.0, 120.0, 4.0)), (3, 1))
    assert not clipped(profiles, D_PX, 255.0).any()


@pytest.mark.parametrize("brightness_dn", [300.0, 600.0])
def test_an_overexposed_planet_is_fixed_with_errors_as_claimed(brightness_dn: float) -> None:
    """Taken for plain edges they gave nadir off by tens of sigmas."""
    errors = []
    for seed, altitude_m in enumerate((500e3, 1500e3, 4000e3)):
        views = limb_views(altitude_m, azimuths_rad=(0.7 * seed,))
        scene = EarthScene(uniform_dn=brightness_dn)
        frame = draw(views, altitude_m, scene, Imaging(noise_dn=2.0), seed)[0]
        fix = HorizonSensor().process([Frame(views[0], frame.image)])
        assert fix.ok
        across = np.cross(fix.fit.nadir_base, frame.truth.nadir_base)
        off = np.degrees(np.arcsin(np.linalg.norm(across)))
        sigma = np.degrees(np.sqrt(np.trace(fix.fit.cov_nadir_altitude[:3, :3])))
        errors.append(off / sigma)
        assert off < 0.1
    assert np.max(errors) < 2.5
