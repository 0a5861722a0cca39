"""Clouds that took time, while the target moved on."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.linalg import expm

from horizon_sensor_ros.core.mathematics.rigid import (
    inverse_pose,
    pose_matrix,
    rotation_from_vector,
    skew,
    vector_from_rotation,
)
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.core.target_motion.config import RegistrationConfig, TrackerConfig
from horizon_sensor_ros.core.target_motion.sweeps.sweep import sweep_of
from horizon_sensor_ros.core.target_motion.sweeps.velocity import Velocity
from horizon_sensor_ros.core.target_motion.target_fix import TargetFix
from horizon_sensor_ros.core.target_motion.tracker import TargetTracker
from horizon_sensor_ros.sim.shapes import TARGETS
from horizon_sensor_ros.sim.swept_scan import SweptScan, swept_scan
from horizon_sensor_ros.sim.tof_camera import ToFCamera

CAMERA = ToFCamera(width=128, height=128, pixel_pitch_m=65e-6)
PERIOD_S = 0.2
NONE = np.zeros((6, 6))
vectors = arrays(float, 3, elements=st.floats(-2.0, 2.0))


def motion(turn_rad_s: np.ndarray, shift_m_s: np.ndarray, time_s: float) -> np.ndarray:
    """(4, 4) by the matrix exponential of the twist."""
    twist = np.zeros((4, 4))
    twist[:3, :3], twist[:3, 3] = skew(turn_rad_s), shift_m_s
    return np.asarray(expm(twist * time_s))


@given(vectors, vectors, vectors, st.floats(-1.0, 1.0))
def test_points_move_as_the_exponential_of_the_twist_says(
    turn: np.ndarray, shift: np.ndarray, point: np.ndarray, time_s: float
) -> None:
    moved = Velocity(turn, shift, NONE).moved(point[None], np.array([time_s]))
    expected = motion(turn, shift, time_s) @ np.append(point, 1.0)
    np.testing.assert_allclose(moved[0], expected[:3], atol=1e-9)


@given(vectors, vectors, vectors, st.floats(0.05, 1.0))
def test_the_velocity_between_two_poses_leads_from_one_to_the_other(
    turn: np.ndarray, shift: np.ndarray, start: np.ndarray, time_s: float
) -> None:
    before = pose_matrix(rotation_from_vector(start), start)
    now = motion(turn, shift, time_s) @ before
    found = Velocity.between(before, now, time_s, np.eye(6))
    np.testing.assert_allclose(found.turn_rad_s, turn, atol=1e-6)
    np.testing.assert_allclose(found.shift_m_s, shift, atol=1e-6)
    np.testing.assert_allclose(found.covariance, np.eye(6) / time_s**2)


def test_times_that_tell_nothing() -> None:
    points = swept(0.0)[0].points
    at_the_stamp = np.full(points.shape[:2], 1e-7)
    assert sweep_of(points, at_the_stamp) is None
    assert sweep_of(points, at_the_stamp * np.nan) is None
    with pytest.raises(ValueError, match=r"times_s must be \(128, 128\), got \(3,\)"):
        sweep_of(points, np.zeros(3))


def test_points_of_one_time_are_brought_to_the_stamp_all_the_same() -> None:
    """As of a flash lidar, whose clouds are stamped when they are sent."""
    points = swept(0.0)[0].points
    sweep = sweep_of(points, np.full(points.shape[:2], -0.3))
    assert sweep is not None
    shift_m_s = np.array([0.0, 0.0, 0.2])
    stilled = sweep.stilled(Velocity(np.zeros(3), shift_m_s, NONE))
    # About the sensor's own axes: what is in view turns them in which an image is made.
    moved_m = stilled.centroid_m @ stilled.rot_sensor_from_view.T
    moved_m = moved_m - sweep.image.centroid_m @ sweep.image.rot_sensor_from_view.T
    np.testing.assert_allclose(moved_m, 0.3 * shift_m_s, atol=0.005)


def pose_at(deg_s: float, name: str = "n5") -> Callable[[float], np.ndarray]:
    rng = np.random.default_rng(len(name))
    axis = rng.normal(size=3)
    axis *= np.radians(deg_s) / np.linalg.norm(axis)
    start, drift = rotation_from_vector(rng.normal(size=3)), rng.normal(0.0, 0.02, 3)

    def pose(time_s: float) -> np.ndarray:
        turned = rotation_from_vector(axis * time_s) @ start
        return pose_matrix(turned, np.array([0.0, 0.0, 5.3]) + drift * time_s)

    return pose


def swept(deg_s: float, name: str = "n5", count: int = 1) -> list[SweptScan]:
    """Clouds that each take the whole time to the next one."""
    pose, mesh = pose_at(deg_s, name), TARGETS[name]()
    return [
        swept_scan(CAMERA, mesh, pose, k * PERIOD_S, PERIOD_S, np.random.default_rng(k))
        for k in range(count)
    ]


def errors(fixes: list[TargetFix], deg_s: float, name: str) -> list[tuple[float, float]]:
    """NEES of each pose but the first, and how far a point half a metre from the origin is off, in
    the mean, mm; of those that were found.
    """
    pose = pose_at(deg_s, name)
    frame = inverse_pose(pose(0.0)) @ fixes[0].pose_sensor_from_target
    found = []
    for k, fix in enumerate(fixes[1:], start=1):
        if fix.status is not Status.OK:
            continue
        off = off_by(fix.pose_sensor_from_target, pose(k * PERIOD_S) @ frame)
        off_m = np.sqrt(off[3:] @ off[3:] + 0.25 * off[:3] @ off[:3])
        found.append((nees(off, fix.covariance), 1e3 * float(off_m)))
    return found


def off_by(pose: np.ndarray, true: np.ndarray) -> np.ndarray:
    """(6,) turn and shift from a pose to the true one."""
    turn = vector_from_rotation(true[:3, :3] @ pose[:3, :3].T)
    return np.concatenate([turn, true[:3, 3] - pose[:3, 3]])


def nees(off: np.ndarray, covariance: np.ndarray) -> float:
    return float(off @ np.linalg.solve(covariance, off))


def step_nees(fixes: list[TargetFix], deg_s: float, name: str) -> list[float]:
    """NEES of each step from one fix to the next."""
    pose = pose_at(deg_s, name)
    frame = inverse_pose(pose(0.0)) @ fixes[0].pose_sensor_from_target
    found = []
    for k, fix in enumerate(fixes[1:], start=1):
        if fix.delta_previous_from_now is None:
            continue
        assert fix.delta_covariance is not None
        since = k - round(fix.delta_s / PERIOD_S)
        true = inverse_pose(pose(since * PERIOD_S) @ frame) @ pose(k * PERIOD_S) @ frame
        found.append(nees(off_by(fix.delta_previous_from_now, true), fix.delta_covariance))
    return found


def tracked(clouds: list[SweptScan], told: bool, config: TrackerConfig) -> list[TargetFix]:
    """What comes of clouds, with their times or without."""
    tracker = TargetTracker(config)
    return [
        tracker.process(
            each.points, round(k * PERIOD_S * 1e9), times_s=each.times_s if told else None
        )
        for k, each in enumerate(clouds)
    ]


# What may be left where the target turns by 6 deg while it is swept.
WIDE = TrackerConfig(
    RegistrationConfig(max_rotation_sigma_rad=np.radians(2.0), max_shift_sigma_m=0.05)
)


# A panel that comes to be seen edge on while it is swept is missing where it was at the stamp, and
# such a cloud is refused.
@pytest.mark.parametrize("name", ["n5", "winged_cylinder"])
def test_a_sweep_is_taken_out_of_clouds_on_a_grid(name: str) -> None:
    clouds = swept(30.0, name, 8)
    told, untold = (
        np.array(errors(tracked(clouds, each, WIDE), 30.0, name)) for each in (True, False)
    )
    assert len(told) >= 6
    assert told[:, 0].max() < 20.0
    assert np.median(untold[:, 0]) > 20.0
    assert np.median(told[:, 1]) < np.median(untold[:, 1])


@pytest.mark.parametrize("name", ["n5", "winged_cylinder"])
def test_the_step_of_a_swept_target_claims_what_the_sweeps_leave(name: str) -> None:
    fixes = tracked(swept(30.0, name, 8), True, WIDE)
    steps = step_nees(fixes, 30.0, name)
    assert len(steps) >= 5
    # Of six unknowns; without the sweeps' part 13 to 14.
    assert np.median(steps) < 7.0


def test_by_default_no_more_is_left_than_is_allowed() -> None:
    fixes = tracked(swept(30.0, "winged_cylinder", 8), True, TrackerConfig())
    refused = [fix for fix in fixes if fix.status is Status.ILL_CONDITIONED]
    assert refused
    assert "by how the target moved while the cloud was measured" in refused[0].reason


def test_a_slow_target_is_as_well_known_as_without_times() -> None:
    clouds = swept(1.0, "n5", 5)
    told, untold = (
        np.median([off for _, off in errors(tracked(clouds, each, TrackerConfig()), 1.0, "n5")])
        for each in (True, False)
    )
    assert told < 1.3 * untold + 0.1


def test_a_sweep_is_taken_out_of_clouds_on_no_grid() -> None:
    """As if the sensor had been rolled, otherwise for each cloud, and its points turned back."""
    name, deg_s = "winged_cylinder", 30.0
    pose, mesh = pose_at(deg_s, name), TARGETS[name]()
    clouds = []
    for k in range(6):
        rng = np.random.default_rng(k)
        roll_rad = rng.uniform(0.1, 0.5)
        clouds.append(
            swept_scan(CAMERA, mesh, pose, k * PERIOD_S, PERIOD_S, rng, roll_rad=roll_rad)
        )
    sweep = sweep_of(clouds[0].points, clouds[0].times_s)
    assert sweep is not None
    assert not sweep.image.on_grid
    told, untold = (
        np.array(errors(tracked(clouds, each, WIDE), deg_s, name)) for each in (True, False)
    )
    assert len(told) >= 4
    assert np.median(told[:, 0]) < 12.0
    assert np.median(told[:, 1]) < np.median(untold[:, 1])


@pytest.mark.parametrize("roll", [False, True], ids=["grid", "no grid"])
def test_what_a_cropped_arm_hides_is_not_known_of_stilled_clouds_either(roll: bool) -> None:
    name = "winged_cylinder"
    rng = np.random.default_rng(1)
    cloud = swept_scan(
        CAMERA, TARGETS[name](), pose_at(10.0, name), 0.0, PERIOD_S, rng,
        roll_rad=0.3 if roll else 0.0,
    )  # fmt: skip
    points = cloud.points.reshape(-1, 3)
    arm = (points[:, 2] > 0.0) & (np.abs(points[:, 0]) < 0.02 * points[:, 2])
    before = points[arm] * (3.0 / points[arm, 2:])
    points[arm] = np.nan
    velocity = Velocity(np.radians([0.0, 10.0, 0.0]), np.zeros(3), NONE)
    unknown = []
    for cropped in (before, None):
        sweep = sweep_of(cloud.points, cloud.times_s, cropped=cropped)
        assert sweep is not None
        assert sweep.image.on_grid is not roll
        unknown.append(np.count_nonzero(sweep.stilled(velocity).unknown))
    assert unknown[0] - unknown[1] > 0.1 * np.count_nonzero(arm)


def test_the_same_sweep_again_is_refused() -> None:
    tracker = TargetTracker()
    clouds = swept(5.0, "n5", 3)
    for k, cloud in enumerate(clouds):
        fix = tracker.process(cloud.points, round(k * PERIOD_S * 1e9), times_s=cloud.times_s)
        assert fix.status is Status.OK
    again = tracker.process(
        clouds[-1].points, round(3 * PERIOD_S * 1e9), times_s=clouds[-1].times_s
    )
    assert again.status is Status.REPEATED_CLOUD


def test_points_whose_time_is_not_known_are_left_out() -> None:
    tracker = TargetTracker()
    for k, cloud in enumerate(swept(5.0, "n5", 3)):
        times = cloud.times_s.copy()
        times[k::7] = np.nan
        fix = tracker.process(cloud.points, round(k * PERIOD_S * 1e9), times_s=times)
        assert fix.status is Status.OK


def test_stamps_that_make_no_sense_beside_the_times() -> None:
    """Two clouds of a fifth of a second each, a microsecond apart: no target moves like that, and
    nothing is answered or breaks.
    """
    tracker = TargetTracker(WIDE)
    first, second = swept(30.0, "n5", 2)
    assert tracker.process(first.points, 0, times_s=first.times_s).status is Status.OK
    assert tracker.process(second.points, 1000, times_s=second.times_s).status is not Status.OK
