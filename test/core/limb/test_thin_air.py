"""Limbs told apart from air that is as thin as the blur."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from limb_frames import PLANET, clouds, distance_px, draw, limb_views

from horizon_sensor_ros.core.limb.refinement import separate_from_thin_air
from horizon_sensor_ros.core.limb.sample import LimbSample, RefinePass, sample_limb
from horizon_sensor_ros.sim.earth_scene import Imaging

ALTITUDE_M = 1.4e6
NADIR = np.array([0.0, 0.0, 1.0])
FINAL = RefinePass(reach_px=1.0, grid_px=0.125, spacing_px=1.0)


def test_a_limb_is_told_from_thin_air_and_from_none() -> None:
    views = limb_views(ALTITUDE_M, azimuths_rad=(0.4,))
    rho_rad = PLANET.rho_from_altitude(ALTITUDE_M)
    imaging = Imaging(noise_dn=1.5, psf_sigma_px=0.45)
    separated, off_px = 0, []
    for seed in range(6):
        for air_dn in (0.0, 90.0):
            scene = replace(clouds(seed), air_dn=air_dn, air_scale_height_m=8e3)
            (frame,) = draw(views, ALTITUDE_M, scene, imaging, seed)
            found = separate_from_thin_air(frame.image, views[0], (NADIR, rho_rad), FINAL, 0.1)
            if air_dn == 0.0:
                assert found is None
            elif found is not None:
                separated += found[0].glow_separated
                off_px.append(np.median(distance_px(frame.truth.limb, found[0].px)))
    assert separated >= 3
    assert np.abs(off_px).max() < 0.4


def test_air_shines_beyond_the_edge_and_blur_does_not() -> None:
    views = limb_views(ALTITUDE_M, azimuths_rad=(0.4,))
    near = views[0], NADIR, PLANET.rho_from_altitude(ALTITUDE_M)
    for seed in range(4):
        for air_dn, psf_px in ((0.0, 0.45), (0.0, 0.8), (60.0, 0.45)):
            scene = replace(clouds(seed), air_dn=air_dn, air_scale_height_m=8e3)
            imaging = Imaging(noise_dn=1.5, psf_sigma_px=psf_px)
            (frame,) = draw(views, ALTITUDE_M, scene, imaging, seed)
            sample = sample_limb(frame.image, *near, FINAL, modelled=True)
            assert isinstance(sample, LimbSample)
            beyond = sample.light_beyond(sample.steps[1])
            assert beyond > 8.0 if air_dn else abs(beyond) < 5.0
