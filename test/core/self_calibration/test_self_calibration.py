"""Self-calibration against exact geometry."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from calibration_sets import ROTATIONS, frame_sets, swinging
from hypothesis import given, settings
from hypothesis import strategies as st

from horizon_sensor_ros.core.mathematics.rigid import rotation_from_vector
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.self_calibration import adjustment
from horizon_sensor_ros.core.self_calibration.adjustment import calibrate
from horizon_sensor_ros.core.self_calibration.differences import nadir_differences
from horizon_sensor_ros.core.self_calibration.measurement import CameraHorizon, FrameSet
from horizon_sensor_ros.core.self_calibration.result import Calibration, CalibrationConfig
from horizon_sensor_ros.core.status import Status

MISALIGNMENT_RAD = np.radians(0.3)
PLANET = Planet()
# Nothing is too uncertain to be told: for data without noise.
ANYTHING = CalibrationConfig(max_sigma=100.0)


def mounted(misalignment_rad: np.ndarray, camera: str = "camera_2") -> dict[str, np.ndarray]:
    """True rotations of a craft whose nominal ones are `ROTATIONS`."""
    turned = rotation_from_vector(np.asarray(misalignment_rad)) @ ROTATIONS[camera]
    return {**ROTATIONS, camera: turned}


def misalignment(calibration: Calibration, camera: str = "camera_2") -> np.ndarray:
    return calibration.values[calibration.unknowns.where("rotation", camera)]


def nees(calibration: Calibration, truth: np.ndarray, where: np.ndarray) -> float:
    error = calibration.values[where] - truth
    return float(error @ np.linalg.solve(calibration.cov[np.ix_(where, where)], error))


@settings(max_examples=25)
@given(st.lists(st.floats(-2.0, 2.0), min_size=3, max_size=3))
def test_without_noise_the_misalignment_is_found_exactly(turn_deg: list[float]) -> None:
    truth = np.radians(turn_deg)
    found = calibrate(frame_sets(swinging(12), mounted(truth)), ROTATIONS, PLANET, ANYTHING)
    assert found.ok
    np.testing.assert_allclose(misalignment(found), truth, atol=1e-9)
    np.testing.assert_allclose(
        found.rot_base_from_cam["camera_2"], mounted(truth)["camera_2"], atol=1e-9
    )
    np.testing.assert_array_equal(misalignment(found, "camera_1"), 0.0)


@pytest.mark.parametrize("axis", range(3))
def test_a_positive_misalignment_turns_the_camera_about_a_base_axis(axis: int) -> None:
    """The corrected rotation is exp(misalignment) times the nominal one, base frame's axes."""
    truth = MISALIGNMENT_RAD * np.eye(3)[axis]
    found = calibrate(frame_sets(swinging(12), mounted(truth)), ROTATIONS, PLANET, ANYTHING)
    assert np.argmax(misalignment(found)) == axis
    assert misalignment(found)[axis] == pytest.approx(MISALIGNMENT_RAD, abs=1e-9)


def test_sigmas_hold_and_errors_shrink_with_the_number_of_sets() -> None:
    truth = np.radians([0.2, -0.3, 0.1])
    squares, sigmas = [], []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        found = calibrate(frame_sets(swinging(40), mounted(truth), rng), ROTATIONS, PLANET)
        where = found.unknowns.where("rotation", "camera_2")
        squares.append(nees(found, truth, where))
        sigmas.append(found.sigmas[where])
    # 30 x 3 degrees of freedom: 1 +- 0.15.
    assert 0.6 < np.mean(squares) / 3 < 1.3
    more = calibrate(
        frame_sets(swinging(160), mounted(truth), np.random.default_rng(1)), ROTATIONS, PLANET
    )
    np.testing.assert_allclose(
        more.sigmas[more.unknowns.where("rotation", "camera_2")],
        np.mean(sigmas, axis=0) / 2,
        rtol=0.25,
    )


def test_altitude_alone_leaves_the_turn_about_the_vertical_open() -> None:
    """Nadir is z and never moves; only the altitude changes."""
    down = np.array([0.0, 0.0, 1.0])
    truth = np.radians([0.2, -0.3, 0.3])
    sets = frame_sets(
        [down] * 100,
        mounted(truth),
        np.random.default_rng(5),
        altitudes_m=list(np.linspace(400e3, 2000e3, 100)),
    )
    found = calibrate(sets, ROTATIONS, PLANET)
    where = found.unknowns.where("rotation", "camera_2")
    assert [found.observed(i) for i in where] == ["yes", "yes", "no"]
    assert nees(found, truth[:2], where[:2]) < 14.0  # one in a thousand is larger
    assert misalignment(found)[2] == pytest.approx(0.0, abs=1e-4)
    assert np.isnan(found.sigmas[where[2]])
    (about,) = [s for s in found.not_observed if s.startswith("camera_2")]
    assert "about base axis (0.00, 0.00, 1.00), the vertical" in about
    assert "within 0.1 deg" in about


def test_what_the_limb_alone_cannot_tell_is_said() -> None:
    truth = np.radians([0.2, -0.3, 0.3])
    found = calibrate(
        frame_sets(swinging(100), mounted(truth), np.random.default_rng(6)), ROTATIONS, PLANET
    )
    assert len(found.not_observed) == 2
    assert found.not_observed[0].startswith("how all cameras together sit in the base frame")
    assert found.not_observed[1] == "limb height: it needs the altitude from elsewhere"


def test_limb_height_from_known_altitudes() -> None:
    sets = frame_sets(
        swinging(100),
        ROTATIONS,
        np.random.default_rng(7),
        planet=Planet(limb_height_m=12e3),
        altitude_sigma_m=50.0,
    )
    found = calibrate(sets, ROTATIONS, Planet(limb_height_m=2e3))
    where = found.unknowns.where("limb_height")
    assert found.observed(int(where[0])) == "yes"
    assert found.values[where[0]] == pytest.approx(10e3, abs=300.0)
    assert nees(found, np.array([10e3]), where) < 11.0
    assert not any(sentence.startswith("limb height") for sentence in found.not_observed)


def test_a_reference_attitude_frees_the_first_camera_too() -> None:
    first, second = np.radians([0.3, 0.1, -0.2]), np.radians([-0.1, 0.2, 0.3])
    rotations = {**mounted(first, "camera_1"), "camera_2": mounted(second)["camera_2"]}
    sets = frame_sets(
        swinging(100),
        rotations,
        np.random.default_rng(8),
        reference_sigma_rad=np.radians(0.02),
    )
    found = calibrate(sets, ROTATIONS, PLANET)
    for camera, truth in (("camera_1", first), ("camera_2", second)):
        where = found.unknowns.where("rotation", camera)
        assert nees(found, truth, where) < 16.3
        assert np.all(np.degrees(found.sigmas[where]) < 0.05)
    assert found.not_observed == ("limb height: it needs the altitude from elsewhere",)


def test_one_camera_with_a_reference() -> None:
    truth = np.radians([0.3, 0.1, -0.2])
    alone = {"camera_1": ROTATIONS["camera_1"]}
    sets = frame_sets(
        swinging(60),
        {"camera_1": mounted(truth, "camera_1")["camera_1"]},
        reference_sigma_rad=np.radians(0.02),
    )
    found = calibrate(sets, alone, PLANET, ANYTHING)
    np.testing.assert_allclose(misalignment(found, "camera_1"), truth, atol=1e-9)


def test_a_drift_is_told_from_a_constant_misalignment() -> None:
    truth, drift = np.radians([0.2, -0.1, 0.3]), np.radians([0.1, 0.2, -0.1])
    nadirs = swinging(80)
    rotations = [
        {
            **ROTATIONS,
            "camera_2": rotation_from_vector(phase * drift) @ mounted(truth)["camera_2"],
        }
        for phase in np.linspace(-1.0, 1.0, len(nadirs))
    ]
    found = calibrate(
        frame_sets(nadirs, rotations), ROTATIONS, PLANET, CalibrationConfig(drift=True, max_sigma=9)
    )
    np.testing.assert_allclose(misalignment(found), truth, atol=1e-8)
    where = found.unknowns.where("drift", "camera_2")
    np.testing.assert_allclose(found.values[where], drift, atol=1e-8)
    assert found.half_time_s == 395.0
    assert "a drift that all cameras share: camera_1 is taken as steady" in found.not_observed


def test_wrong_horizons_have_no_say() -> None:
    truth = np.radians([0.2, -0.3, 0.1])
    rng = np.random.default_rng(9)
    right = frame_sets(swinging(100), mounted(truth), rng)
    away = mounted(np.radians([8.0, -5.0, 3.0]))
    wrong = frame_sets(swinging(100), away, rng)
    sets = [wrong[i] if i % 5 == 0 else right[i] for i in range(100)]
    found = calibrate(sets, ROTATIONS, PLANET)
    assert not found.used[::5].any()
    assert nees(found, truth, found.unknowns.where("rotation", "camera_2")) < 16.3


def test_after_the_correction_the_nadirs_agree() -> None:
    truth = np.radians([0.2, -0.3, 0.1])
    sets = frame_sets(swinging(30), mounted(truth))
    found = calibrate(sets, ROTATIONS, PLANET, ANYTHING)
    (before,) = nadir_differences(sets, ROTATIONS)
    (after,) = nadir_differences(sets, found.rot_base_from_cam)
    assert before.name == "camera_2 against camera_1"
    # The camera sits turned by the truth, so its nadir seems turned by the opposite.
    across = [-truth + n * (n @ truth) for n in (r for r in swinging(30))]
    np.testing.assert_allclose(before.turn_rad, across, atol=2e-5)
    assert after.rms_rad < 1e-9


def test_a_camera_mounted_the_other_way_round_is_half_a_turn_off() -> None:
    """Nadirs that were exactly opposite were told to agree."""
    down = np.array([0.0, 0.0, 1.0])
    seen = CameraHorizon("camera_1", down, 1.0, 1e-6 * np.eye(3))
    sets = [FrameSet(0.0, (seen, replace(seen, camera="camera_2")))]
    about_x = np.diag([1.0, -1.0, -1.0])
    (apart,) = nadir_differences(sets, {"camera_1": np.eye(3), "camera_2": about_x})
    assert apart.rms_rad == pytest.approx(np.pi)


def test_sets_in_which_nobody_saw_the_horizon_have_no_differences() -> None:
    """They ended with an error about values to unpack."""
    sets = [FrameSet(-1.0, ()), *frame_sets(swinging(3), ROTATIONS), FrameSet(9.0, ())]
    (difference,) = nadir_differences(sets, ROTATIONS)
    assert difference.index.tolist() == [1, 2, 3]
    assert nadir_differences(sets[:1], ROTATIONS) == ()


def test_frames_of_one_camera_alone_tell_nothing() -> None:
    sets = frame_sets(swinging(30), {"camera_1": ROTATIONS["camera_1"]})
    found = calibrate(sets, ROTATIONS, PLANET)
    assert found.status is Status.TOO_FEW_POINTS
    assert found.reason.startswith("0 of 30 frame sets show the horizon to two cameras")
    assert np.isnan(found.values).all()


def test_cameras_that_do_not_belong_together_are_refused() -> None:
    """Every set shows another mounting: no calibration is better than a wrong one."""
    rng = np.random.default_rng(3)
    rotations = [mounted(rng.normal(0.0, 0.2, 3)) for _ in range(40)]
    found = calibrate(frame_sets(swinging(40), rotations), ROTATIONS, PLANET)
    assert found.status is Status.POOR_FIT
    assert "scatter" in found.reason


def test_an_adjustment_that_has_not_come_to_rest_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    truth = mounted(np.radians([0.05, -0.05, 0.1]))
    sets = frame_sets(swinging(40), truth, np.random.default_rng(2))
    assert calibrate(sets, ROTATIONS, PLANET).ok
    monkeypatch.setattr(adjustment, "_MAX_ROUNDS", 1)
    found = calibrate(sets, ROTATIONS, PLANET)
    assert found.status is Status.NOT_CONVERGED
    assert found.reason.startswith("after 1 rounds the mountings still move by ")
    assert np.isnan(found.values).all()


def test_a_camera_that_is_turned_by_half_a_circle_is_no_calibration() -> None:
    """In what is left across nadir the opposite one is as good."""
    truth = dict(ROTATIONS)
    axis = ROTATIONS["camera_2"][:, 2]
    truth["camera_2"] = rotation_from_vector(np.pi * axis) @ ROTATIONS["camera_2"]
    sets = frame_sets(swinging(60, 0.2), truth, np.random.default_rng(1))
    found = calibrate(sets, ROTATIONS, PLANET)
    assert found.status is Status.POOR_FIT
    assert "opposite" in found.reason


@pytest.mark.parametrize(
    ("name", "value"),
    [("rho_rad", np.nan), ("nadir_cam", np.full(3, np.nan)), ("cov_noise", np.zeros((3, 3)))],
)
def test_horizons_that_no_fit_gives_are_the_callers_bug(name: str, value: Any) -> None:
    (horizon, _) = frame_sets(swinging(1), ROTATIONS)[0].horizons
    with pytest.raises(ValueError, match=name):
        replace(horizon, **{name: value})


def test_wrong_arguments_are_said() -> None:
    sets = frame_sets(swinging(10), ROTATIONS)
    with pytest.raises(ValueError, match="no rotation for camera_2"):
        calibrate(sets, {"camera_1": np.eye(3)}, PLANET)
    with pytest.raises(ValueError, match="camera_1 is not a rotation"):
        calibrate(sets, {**ROTATIONS, "camera_1": np.ones((3, 3))}, PLANET)
    with pytest.raises(ValueError, match="max_sigma must be positive"):
        CalibrationConfig(max_sigma=0.0)
    with pytest.raises(ValueError, match="correlation_s must not be negative"):
        CalibrationConfig(correlation_s=-1.0)
