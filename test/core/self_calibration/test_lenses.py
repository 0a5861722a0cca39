"""Self-calibration of cameras whose focal lengths are not as they are told."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from calibration_sets import ROTATIONS, frame_sets, swinging

from horizon_sensor_ros.core.mathematics.attitude import tangent_basis
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.self_calibration.adjustment import calibrate
from horizon_sensor_ros.core.self_calibration.lens_check import with_lenses_checked
from horizon_sensor_ros.core.self_calibration.measurement import CameraHorizon, FrameSet
from horizon_sensor_ros.core.self_calibration.result import Calibration, CalibrationConfig
from horizon_sensor_ros.core.status import Status

PLANET = Planet()


def magnified(horizon: CameraHorizon, error: float) -> CameraHorizon:
    """As seen with a focal length that is told too long by `error`, to first order.

    A pixel's tangent from the axis is taken for less: what lies at an angle `off` from the axis
    comes nearer to it by sin(off) cos(off) of the error.
    """
    nadir = horizon.nadir_cam
    towards = np.array([0.0, 0.0, 1.0]) - nadir[2] * nadir
    # Towards the axis by as much as the limb point below the axis is, and the disc with it.
    off = np.arccos(nadir[2]) - horizon.rho_rad
    nearer = np.sin(off) * np.cos(off)
    towards *= nearer / np.linalg.norm(towards)
    basis = tangent_basis(nadir)
    moved = nadir + error * towards
    moved /= np.linalg.norm(moved)
    slope = np.append(tangent_basis(moved).T @ towards, 0.0)
    turn = np.eye(3)
    turn[:2, :2] = tangent_basis(moved).T @ basis
    return replace(
        horizon,
        nadir_cam=moved,
        cov_noise=turn @ horizon.cov_noise @ turn.T,
        # By the length that is told: what a longer one would have made of it.
        focal_slope=slope,
    )


def with_lenses(sets: Sequence[FrameSet], errors: dict[str, float]) -> list[FrameSet]:
    """Sets (T,) whose cameras' focal lengths are told too long by so much."""
    return [
        replace(each, horizons=tuple(magnified(h, errors[h.camera]) for h in each.horizons))
        for each in sets
    ]


def checked(sets: Sequence[FrameSet], config: CalibrationConfig | None = None) -> Calibration:
    config = config or CalibrationConfig()
    return with_lenses_checked(
        calibrate(sets, ROTATIONS, PLANET, config), ROTATIONS, PLANET, config
    )


def swung(seed: int) -> list[FrameSet]:
    return frame_sets(swinging(100), ROTATIONS, np.random.default_rng(seed))


@pytest.mark.parametrize("error", [0.03, -0.03])
def test_a_wrong_focal_length_is_named_and_no_mounting_is_given(error: float) -> None:
    found = checked(with_lenses(swung(1), {"camera_1": 0.0, "camera_2": error}))
    assert found.status is Status.POOR_FIT
    assert found.wrong_lenses == ("camera_2",)
    how = "shorter" if error > 0.0 else "longer"
    assert "the limbs show camera_2's focal length " in found.reason
    assert f" % {how} than it is told to be (sigma 0." in found.reason
    assert "mountings would be wrong by up to " in found.reason
    assert np.isnan(found.values).all()


def test_left_free_it_comes_out() -> None:
    sets = with_lenses(swung(2), {"camera_1": -0.01, "camera_2": 0.03})
    found = checked(sets, CalibrationConfig(focal=True, max_sigma=1.0))
    assert found.ok
    for camera, told in (("camera_1", 0.01), ("camera_2", -0.03)):
        (index,) = found.unknowns.where("focal", camera)
        assert found.observed(int(index)) == "yes"
        assert abs(found.values[index] - told) < 4.0 * found.sigmas[index]


@pytest.mark.parametrize("seeds", [range(8), pytest.param(range(8, 20), marks=pytest.mark.slow)])
def test_right_lenses_are_no_reason_to_refuse(seeds: range) -> None:
    for seed in seeds:
        assert checked(with_lenses(swung(seed), {"camera_1": 0.0, "camera_2": 0.0})).ok


def test_sets_that_scatter_for_it_say_so() -> None:
    found = checked(with_lenses(swung(3), {"camera_1": 0.0, "camera_2": 0.5}))
    assert found.status is Status.POOR_FIT
    assert "as much as their limbs claim, and show camera_2's focal length" in found.reason
    assert found.wrong_lenses == ("camera_2",)


def test_without_their_slopes_lenses_are_not_checked() -> None:
    sets = [
        replace(each, horizons=tuple(replace(h, focal_slope=np.zeros(3)) for h in each.horizons))
        for each in with_lenses(swung(1), {"camera_1": 0.0, "camera_2": 0.03})
    ]
    assert checked(sets).ok
