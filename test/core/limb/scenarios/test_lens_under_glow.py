"""Lenses that are softer or sharper than usual, under air that glows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from horizon_fixes import error_deg, nees
from limb_frames import as_frames

from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.sim.hard_scenes import HardScene, hard_scene


def _through_lens(number: int, psf_px: float) -> HardScene:
    scene = hard_scene("air", number, 11)
    imaging = tuple(replace(each, psf_sigma_px=psf_px) for each in scene.imaging)
    scene = replace(scene, imaging=imaging)
    world = replace(scene.scene, air_dn=140.0, air_inside=0.5)
    return replace(scene, frames=scene.redrawn(world, np.random.default_rng(1)))


@pytest.mark.parametrize(
    ("psf_px", "numbers"), [(1.15, (9, 14, 16, 18)), (0.42, (8, 19, 22))], ids=["soft", "sharp"]
)
def test_limb_and_glow_are_told_apart_through_any_lens(
    psf_px: float, numbers: tuple[int, ...]
) -> None:
    """A soft lens was taken for motion, a sharp one for no lens: limbs were .16 and .07 deg off."""
    errors_deg = []
    for number in numbers:
        scene = _through_lens(number, psf_px)
        fix = HorizonSensor().process(as_frames(scene.views, scene.frames))
        assert fix.ok, fix.reason
        assert all(limb.glow_separated for limb in fix.limbs)
        nadir = scene.frames[0].truth.nadir_base
        assert nees(fix, nadir) < 9.0
        errors_deg.append(error_deg(fix, nadir))
    assert np.sqrt(np.mean(np.square(errors_deg))) < 0.03
