"""Errors over the field: exact methods have none without noise, and none beats the bound."""

from __future__ import annotations

import numpy as np
import pytest

from horizon_sensor_ros.core.applicability.error_map import bound_error, fit_error
from horizon_sensor_ros.core.applicability.visibility import horizon_rays, rot_base_from_down
from horizon_sensor_ros.core.mathematics.attitude import angle_rad
from horizon_sensor_ros.tools.applicability.figure6 import paper_rig

RIG = paper_rig()
ALTITUDE_M = 300e3
RAYS = horizon_rays(RIG.planet, ALTITUDE_M, 7200)


def attitude(yaw_deg: float, pitch_deg: float) -> np.ndarray:
    return rot_base_from_down(0.0, np.radians(pitch_deg), np.radians(yaw_deg), RIG.nadir_at_zero)[0]


@pytest.mark.parametrize("method", ["chord", "gauss_newton", "cone", "ml"])
@pytest.mark.parametrize(("yaw", "pitch"), [(15.0, -20.0), (30.0, -40.0), (5.0, -10.0)])
def test_exact_methods_have_no_model_error(method, yaw, pitch):
    error = fit_error(RIG.views, RAYS, attitude(yaw, pitch), RIG.planet, method)
    assert np.degrees(error) < 1e-7


def test_image_chord_and_arc_have_one():
    """Where a frame holds the horizon off its centre the printed formulas are approximations."""
    here = attitude(30.0, -40.0)
    for method, least in (("chord_image", 0.1), ("arc", 1e-4)):
        assert np.degrees(fit_error(RIG.views, RAYS, here, RIG.planet, method)) > least


def test_noisy_fits_reach_the_bound_and_do_not_pass_it():
    here = attitude(15.0, -20.0)
    bound = bound_error(RIG.views, here, RIG.planet, ALTITUDE_M, sigma_px=0.2)
    arguments = (RIG.views, RAYS, here, RIG.planet)
    error = {
        method: fit_error(*arguments, method, sigma_px=0.2, noisy_trials=60)
        for method in ("ml", "chord")
    }
    # 60 trials of two components: 9 % of one sigma; the points are not quite a pixel apart.
    assert error["ml"] == pytest.approx(bound, rel=0.35)
    assert error["chord"] > 2 * bound


def test_the_same_seed_gives_the_same_error():
    arguments = (RIG.views, RAYS, attitude(15.0, -20.0), RIG.planet, "cone")
    first, again, other = (fit_error(*arguments, noisy_trials=3, seed=seed) for seed in (1, 1, 2))
    assert first == again != other


def test_no_horizon_no_error():
    blind = attitude(-80.0, 80.0)
    assert np.isnan(fit_error(RIG.views[:1], RAYS, blind, RIG.planet, "cone"))
    assert np.isnan(bound_error(RIG.views[:1], blind, RIG.planet, ALTITUDE_M, 0.1))


def test_small_angles_are_not_lost():
    a = np.array([0.0, 0.0, 1.0])
    b = np.array([np.sin(1e-10), 0.0, np.cos(1e-10)])
    assert angle_rad(a, b) == pytest.approx(1e-10, rel=1e-6)
    assert angle_rad(a, -a) == pytest.approx(np.pi)
