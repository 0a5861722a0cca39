"""Limbs whose height differs from place to place, as cloud tops make them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from limb_samples import nadir_nees

from horizon_sensor_ros.core.horizon.config import HorizonConfig
from horizon_sensor_ros.core.horizon.fix import Frame
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.sim.hard_scenes import hard_scene

UNEVEN_M = 1000.0


@pytest.mark.parametrize("num", [6, pytest.param(24, marks=pytest.mark.slow)])
def test_an_uneven_limb_is_as_far_off_as_claimed_where_it_is_told(num: int) -> None:
    """Each camera by itself: .1 deg off in the median, and by ten variances where it is not."""
    squares: dict[float, list[float]] = {0.0: [], UNEVEN_M: []}
    for i in range(num):
        scene = hard_scene("clouds", i, 72)
        truth = scene.frames[0].truth
        world = replace(scene.scene, limb_uneven_m=UNEVEN_M)
        drawn = scene.redrawn(world, np.random.default_rng(i))
        for told_m, found in squares.items():
            sensor = HorizonSensor(HorizonConfig(limb_unevenness_m=told_m, tracking=False))
            for view, frame in zip(scene.views, drawn, strict=True):
                fix = sensor.process([Frame(view, frame.image)])
                if fix.ok:
                    found.append(nadir_nees(fix.fit, truth.nadir_base))
    assert len(squares[UNEVEN_M]) >= 4 / 3 * num
    assert np.mean(squares[UNEVEN_M]) < 3.5
    assert np.mean(squares[0.0]) > 6.0
