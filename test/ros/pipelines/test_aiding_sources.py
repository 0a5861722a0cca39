"""coarse_pose and imu: what of them reaches a set of frames, and what is said of the rest."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from horizon_messages import (
    CAMERAS,
    HEIGHT,
    PARAMETERS,
    PERIOD_NS,
    START_NS,
    WIDTH,
    attitude_at,
    camera_info_of,
    coarse_pose_of,
    horizon_gray,
    image_of,
    imu_of,
    nadir_of,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import Imu

from horizon_sensor_ros.core.aiding import Aiding
from horizon_sensor_ros.core.horizon.fix import HorizonFix
from horizon_sensor_ros.core.horizon.sensor import HorizonSensor
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.ros.diagnostics.horizon_diagnostics import HorizonMonitor
from horizon_sensor_ros.ros.parameters.horizon_settings import horizon_settings
from horizon_sensor_ros.ros.parameters.parameter import ParameterError
from horizon_sensor_ros.ros.pipelines.aiding_sources import AidingSources
from horizon_sensor_ros.ros.pipelines.horizon_pipeline import HorizonPipeline

S = 1_000_000_000
POSITION = np.array([4.0e6, -3.0e6, 4.6e6])
ROTATION = Rotation.from_euler("xyz", [0.3, -0.8, 2.0]).as_matrix()


def sources(**values: Any) -> AidingSources:
    pipeline = horizon_settings({**PARAMETERS, "planet": "wgs84", **values}).pipeline
    return AidingSources(pipeline.aiding, pipeline.sensor.planet, pipeline.base_frame)


def pose_of(stamp: int = START_NS, **fields: Any) -> PoseStamped:
    return coarse_pose_of(stamp, POSITION, ROTATION, **fields)


def test_nothing_comes_of_nothing() -> None:
    aiding = sources()
    known = aiding.of_set(START_NS)
    assert (known.coarse_pose, known.altitude, known.rot_now_from_last) == (None, None, None)
    assert aiding.words == {"coarse_pose": "none", "imu": "none"}


def test_a_pose_is_taken_as_it_is_with_the_sigmas_of_the_parameters() -> None:
    aiding = sources(coarse_pose_position_sigma=2e3, coarse_pose_rotation_sigma=0.02)
    aiding.on_coarse_pose(pose_of())
    pose = aiding.of_set(START_NS + S).coarse_pose
    assert pose is not None
    np.testing.assert_array_equal(pose.position_ecef_m, POSITION)
    np.testing.assert_allclose(pose.rot_ecef_from_base, ROTATION, atol=1e-12)
    assert (pose.position_sigma_m, pose.rotation_sigma_rad) == (2e3, 0.02)
    assert pose.age_s == 1.0
    assert aiding.words["coarse_pose"] == "used"
    # Before or after the frames: the craft has moved in between.
    earlier = sources()
    earlier.on_coarse_pose(pose_of())
    pose = earlier.of_set(START_NS - 30 * S).coarse_pose
    assert pose is not None
    assert pose.age_s == 30.0


@pytest.mark.parametrize(
    ("age_s", "words"),
    [(0, "used"), (60, "used"), (-60, "used"), (60.1, "too old: 60.1"), (-61, "of the future: 61")],
)
def test_a_pose_counts_for_its_age_by_the_stamps(age_s: float, words: str) -> None:
    aiding = sources()
    aiding.on_coarse_pose(pose_of())
    known = aiding.of_set(START_NS + round(age_s * S))
    assert (known.coarse_pose is not None) == (words == "used")
    assert aiding.words["coarse_pose"].startswith(words)


NAN = float("nan")
BAD_POSES: dict[str, tuple[Callable[[PoseStamped], Any], str]] = {
    "wrong_frame": (lambda m: setattr(m.header, "frame_id", "map"), "'map', not 'earth'"),
    "not_finite": (lambda m: setattr(m.pose.position, "y", NAN), "not finite"),
    "inside_planet": (lambda m: setattr(m.pose, "position", type(m.pose.position)()), "0 km"),
    "too_far": (lambda m: setattr(m.pose.position, "x", 1e300), "km from"),
    "bad_orientation": (lambda m: setattr(m.pose.orientation, "w", 3.0), "length 1"),
    "bad_stamp": (lambda m: setattr(m.header.stamp, "nanosec", 2 * S), "nanoseconds"),
}


@pytest.mark.parametrize("cause", BAD_POSES)
def test_a_bad_pose_is_refused_counted_and_said(cause: str) -> None:
    spoil, words = BAD_POSES[cause]
    aiding = sources()
    msg = pose_of()
    spoil(msg)
    aiding.on_coarse_pose(msg)
    assert aiding.of_set(START_NS).coarse_pose is None
    assert aiding.ignored == {f"coarse_pose_{cause}": 1}
    assert words in aiding.words["coarse_pose"]
    # The last good one stands.
    aiding.on_coarse_pose(pose_of())
    aiding.on_coarse_pose(msg)
    assert aiding.of_set(START_NS).coarse_pose is not None
    assert aiding.words["coarse_pose"] == "used"
    # But where nothing else comes any more it is said.
    aiding.on_coarse_pose(msg)
    aiding.on_coarse_pose(msg)
    assert aiding.of_set(START_NS + 2 * S).coarse_pose is not None
    said = aiding.words["coarse_pose"]
    assert said.startswith("refused: ")
    assert words in said
    assert said.endswith("; used is the last good one, 2.0 s off")
    aiding.on_coarse_pose(pose_of())
    aiding.of_set(START_NS + 3 * S)
    assert aiding.words["coarse_pose"] == "used"


BAD_RATES: dict[str, tuple[Callable[[Imu], Any], str]] = {
    "wrong_frame": (lambda m: setattr(m.header, "frame_id", "imu_link"), "'imu_link'"),
    "not_finite": (lambda m: setattr(m.angular_velocity, "z", NAN), "not finite"),
    "no_rate": (lambda m: m.angular_velocity_covariance.__setitem__(0, -1.0), "no rate"),
    "too_fast": (lambda m: setattr(m.angular_velocity, "x", 1e6), "angular velocity is 1e+06"),
    "bad_stamp": (lambda m: setattr(m.header.stamp, "nanosec", 2 * S), "nanoseconds"),
}


@pytest.mark.parametrize("cause", BAD_RATES)
def test_a_bad_rate_is_refused_counted_and_said(cause: str) -> None:
    spoil, words = BAD_RATES[cause]
    aiding = sources()
    msg = imu_of(START_NS, (0.1, 0.2, 0.3))
    spoil(msg)
    aiding.on_imu(msg)
    assert aiding.of_set(START_NS).rot_now_from_last is None
    assert aiding.ignored == {f"imu_{cause}": 1}
    assert words in aiding.words["imu"]


def test_the_imus_orientation_and_acceleration_do_not_matter() -> None:
    aiding = sources()
    msg = imu_of(START_NS, (0.1, 0.2, 0.3))
    msg.orientation.x = msg.linear_acceleration.y = NAN
    msg.orientation_covariance[0] = -1.0
    aiding.on_imu(msg)
    assert not aiding.ignored


def test_the_rotation_is_that_since_the_last_set() -> None:
    rate = np.array([0.1, -0.3, 0.2])
    aiding = sources()
    for step in range(0, 60):
        aiding.on_imu(imu_of(START_NS + step * S // 50, rate))
    assert aiding.of_set(START_NS + S // 10).rot_now_from_last is None
    for start, end in ((0.1, 0.4), (0.4, 0.433), (0.433, 1.1)):
        rot = aiding.of_set(START_NS + round(end * S)).rot_now_from_last
        np.testing.assert_allclose(
            rot, Rotation.from_rotvec(-rate * (end - start)).as_matrix(), atol=1e-9
        )
        assert aiding.words["imu"] == "used"
    # The imu has ended.
    assert aiding.of_set(START_NS + 2 * S).rot_now_from_last is None
    assert aiding.words["imu"] == "a gap since the last set"


@pytest.mark.parametrize(
    ("off_s", "told"),
    [
        (-3600, "of another time: its nearest stamp is 3599.7 s before the frames'"),
        (60, "of another time: its nearest stamp is 60.1 s after the frames'"),
    ],
)
def test_an_imu_of_another_clock_is_told_from_one_with_a_gap(off_s: int, told: str) -> None:
    aiding = sources()
    for step in range(5):
        aiding.on_imu(imu_of(START_NS + off_s * S + (step + 2) * S // 20, (0.1, 0.0, 0.0)))
    aiding.of_set(START_NS)
    aiding.of_set(START_NS)
    assert aiding.words["imu"] == told


def test_the_rate_and_the_time_since_the_last_set_go_along() -> None:
    aiding = sources()
    first = aiding.of_set(START_NS)
    assert (first.rate_base_rad_s, first.since_last_s) == (None, None)
    for step in (1, 2, 3):
        aiding.on_imu(imu_of(START_NS + step * S // 50, (0.1, 0.0, 0.0)))
    # Told already, but of later: whether it has come is a matter of chance.
    aiding.on_imu(imu_of(START_NS + S // 5, (0.3, 0.0, 0.0)))
    second = aiding.of_set(START_NS + S // 10)
    np.testing.assert_array_equal(second.rate_base_rad_s, [0.1, 0.0, 0.0])
    assert second.since_last_s == pytest.approx(0.1)
    assert aiding.of_set(START_NS + S).rate_base_rad_s is None


def test_a_jump_back_is_one_with_other_settings_too() -> None:
    aiding = sources()
    aiding.on_coarse_pose(pose_of(START_NS + 2 * S))
    aiding.of_set(START_NS + 3 * S)
    other = aiding.with_settings(aiding._settings, aiding._planet, aiding._base_frame)
    other.jump_back(START_NS + S)
    assert other.of_set(START_NS + S).coarse_pose is None


def test_after_a_reset_there_is_no_last_set() -> None:
    aiding = sources()
    for step in range(20):
        aiding.on_imu(imu_of(START_NS + step * S // 50, (0.1, 0.0, 0.0)))
    aiding.of_set(START_NS)
    aiding.reset()
    assert aiding.of_set(START_NS + S // 10).rot_now_from_last is None
    assert aiding.of_set(START_NS + S // 5).rot_now_from_last is not None


def test_a_jump_back_drops_the_pose_of_the_time_before() -> None:
    aiding = sources()
    aiding.on_coarse_pose(pose_of(START_NS + 2 * S))
    aiding.of_set(START_NS + 3 * S)
    aiding.jump_back(START_NS + S)
    assert aiding.of_set(START_NS + S).coarse_pose is None
    assert aiding.words["coarse_pose"] == "none"
    # One that the new time has already heard stays.
    aiding.on_coarse_pose(pose_of(START_NS))
    aiding.jump_back(START_NS)
    assert aiding.of_set(START_NS).coarse_pose is not None


def test_a_pose_that_was_held_up_takes_no_fresher_ones_place() -> None:
    aiding = sources()
    for second, place in ((50, 1), (-5, 2), (49, 3), (20, 4)):
        aiding.on_coarse_pose(coarse_pose_of(START_NS + second * S, place * POSITION, ROTATION))
    for second, place in ((51, 1), (51, 1), (21, 4), (52, 1)):
        pose = aiding.of_set(START_NS + second * S).coarse_pose
        assert pose is not None
        np.testing.assert_array_equal(pose.position_ecef_m, place * POSITION)
        assert aiding.words["coarse_pose"] == "used"


@pytest.mark.parametrize("off_s", [-3600, 3600])
def test_a_pose_of_another_time_takes_no_good_ones_place(off_s: int) -> None:
    aiding = sources()
    aiding.on_coarse_pose(pose_of())
    odd = coarse_pose_of(START_NS + off_s * S, 2 * POSITION, ROTATION)
    for second in range(3):
        aiding.on_coarse_pose(odd)
        pose = aiding.of_set(START_NS + second * S).coarse_pose
        assert pose is not None
        np.testing.assert_array_equal(pose.position_ecef_m, POSITION)
        assert aiding.words["coarse_pose"] == "used"
        assert aiding.ignored == {"coarse_pose_of_another_time": second + 1}
    # A set without a message between is no reason to count one again.
    aiding.of_set(START_NS + 3 * S)
    assert aiding.ignored == {"coarse_pose_of_another_time": 3}
    # With nothing better it is spoken of.
    alone = sources()
    alone.on_coarse_pose(odd)
    assert alone.of_set(START_NS).coarse_pose is None
    assert alone.words["coarse_pose"].endswith(": 3600.0 s")
    assert not alone.ignored


def test_a_pose_that_comes_before_time_jumps_to_it_counts_then() -> None:
    aiding = sources()
    aiding.on_coarse_pose(pose_of())
    aiding.of_set(START_NS)
    aiding.on_coarse_pose(coarse_pose_of(START_NS + 3600 * S, 2 * POSITION, ROTATION))
    for after_s, times in ((1, 1), (3601, 2)):
        pose = aiding.of_set(START_NS + after_s * S).coarse_pose
        assert pose is not None
        np.testing.assert_array_equal(pose.position_ecef_m, times * POSITION)


def test_sources_with_other_settings_have_their_own_sigmas_and_rates() -> None:
    aiding = sources()
    aiding.on_coarse_pose(pose_of())
    aiding.on_imu(imu_of(START_NS, (0.1, 0.0, 0.0), "imu_link"))
    other = horizon_settings({**PARAMETERS, "coarse_pose_position_sigma": 1e3}).pipeline
    copy = aiding.with_settings(other.aiding, other.sensor.planet, other.base_frame)
    assert (copy.ignored, copy.words) == (aiding.ignored, aiding.words)
    assert copy.ignored is not aiding.ignored
    for each in (aiding, copy):
        each.on_imu(imu_of(START_NS + S, (0.1, 0.0, 0.0)))
        assert each.ignored == {"imu_wrong_frame": 1}
    sigmas = [each.of_set(START_NS).coarse_pose.position_sigma_m for each in (aiding, copy)]  # type: ignore[union-attr]
    assert sigmas == [50e3, 1e3]


def test_repeated_rates_are_counted() -> None:
    aiding = sources()
    for _ in range(3):
        aiding.on_imu(imu_of(START_NS, (0.1, 0.0, 0.0)))
    assert aiding.ignored == {"imu_repeated_stamp": 2}


def test_known_altitudes() -> None:
    height = Planet.wgs84().geodetic_from_ecef(POSITION)[2]
    wgs84 = {"planet": "wgs84"}
    none = sources(altitude_prior=5e5, **wgs84)
    assert none.of_set(START_NS).altitude is None
    prior = {"altitude_prior": 5e5, "altitude_prior_sigma": 2e3, **wgs84}
    for aiding in (sources(**prior), sources(**prior, coarse_pose_altitude_sigma=1e4)):
        known = aiding.of_set(START_NS).altitude
        assert known is not None
        assert (known.altitude_m, known.sigma_m) == (5e5, 2e3)
    aiding = sources(**prior, coarse_pose_altitude_sigma=1e4)
    aiding.on_coarse_pose(pose_of())
    known = aiding.of_set(START_NS).altitude
    assert known is not None
    assert known.altitude_m == pytest.approx(height, abs=1e-3)
    assert known.sigma_m == 1e4
    later = aiding.of_set(START_NS + 30 * S).altitude
    assert later is not None
    assert later.altitude_m == known.altitude_m
    assert later.sigma_m > 1e4
    # Of a sphere the altitude is above the sphere.
    aiding = sources(planet="sphere", coarse_pose_altitude_sigma=1e4)
    aiding.on_coarse_pose(pose_of())
    known = aiding.of_set(START_NS).altitude
    assert known is not None
    assert known.altitude_m == pytest.approx(np.linalg.norm(POSITION) - 6371e3, abs=1e-3)


@given(
    st.text(max_size=10), st.lists(st.floats(), min_size=7, max_size=7),
    st.integers(-(2**31), 2**31 - 1), st.integers(0, 2**32 - 1),
)  # fmt: skip
@settings(max_examples=50)
def test_no_message_raises(frame: str, values: list[float], sec: int, nanosec: int) -> None:
    aiding = sources()
    for frame_id in (frame, "earth", "base_link"):
        pose, imu = PoseStamped(), Imu()
        for msg in (pose, imu):
            msg.header.frame_id = frame_id
            msg.header.stamp.sec, msg.header.stamp.nanosec = sec, nanosec
        p, q, rate = pose.pose.position, pose.pose.orientation, imu.angular_velocity
        p.x, p.y, p.z, q.x, q.y, q.z, q.w = values
        rate.x, rate.y, rate.z = values[:3]
        aiding.on_coarse_pose(pose)
        aiding.on_imu(imu)
    for stamp_ns in (START_NS, START_NS + 1):
        known = aiding.of_set(stamp_ns)
        if known.coarse_pose is not None:
            assert np.isfinite(known.coarse_pose.position_ecef_m).all()
        if known.rate_base_rad_s is not None:
            assert np.isfinite(known.rate_base_rad_s).all()


def test_a_jump_back_in_time_forgets_the_pose_of_the_end_but_not_of_the_new_beginning() -> None:
    """A looped bag: the last pose of a round is up to a minute, and 450 km, ahead of the next."""
    start, end = START_NS, START_NS + 20 * S
    for pose_stamp, kept in ((end, False), (end - S, False), (start, True), (start + S, True)):
        aiding = sources()
        aiding.of_set(end)
        aiding.on_coarse_pose(pose_of(pose_stamp))
        aiding.jump_back(start)
        assert (aiding.of_set(start).coarse_pose is not None) == kept


def test_an_image_that_came_late_is_no_jump_of_the_sets() -> None:
    aiding = sources()
    aiding.on_coarse_pose(pose_of(START_NS - 5 * S))
    aiding.of_set(START_NS)
    aiding.jump_back(START_NS + S // 10)
    later = aiding.of_set(START_NS + S // 5)
    assert later.coarse_pose is not None
    assert later.since_last_s == pytest.approx(0.2)


@pytest.mark.parametrize("stamps_s", [(0.3, 0.2), (3600.0, 0.2)], ids=["late", "glitch"])
def test_the_pose_outlives_an_odd_stamp_of_one_camera(stamps_s: tuple[float, float]) -> None:
    pipeline = HorizonPipeline(horizon_settings({**PARAMETERS, "planet": "wgs84"}).pipeline)
    pipeline.aiding.on_coarse_pose(pose_of(START_NS - 5 * S))
    said = []

    def see(camera: str, after_s: float) -> None:
        stamp = START_NS + round(after_s * S)
        gray = horizon_gray(camera, nadir_of(0.0, 0.0))
        step = pipeline.on_image(camera, image_of(gray, stamp, camera))
        said.extend(pipeline.aiding.words["coarse_pose"] for _ in step.results)

    for camera in CAMERAS:
        pipeline.on_camera_info(camera, camera_info_of(0, camera))
        see(camera, 0.0)
    for after_s in stamps_s:
        see("camera_1", after_s)
    see("camera_2", 0.2)
    for camera in CAMERAS:
        see(camera, 0.4)
    assert pipeline.counts["time_jumps"] == 1
    assert said == ["used"] * 3


def test_sources_with_settings_have_the_pose_and_rates_of_their_own() -> None:
    """Two nodes of one process shared one: whoever asked first left the other no rotation."""
    aiding = sources()
    aiding.on_coarse_pose(pose_of())
    pipeline = horizon_settings(PARAMETERS).pipeline
    settings_of = pipeline.aiding, pipeline.sensor.planet, pipeline.base_frame
    both = aiding, aiding.with_settings(*settings_of)
    for step in range(21):
        stamp = START_NS + step * S // 20
        for each in both:
            each.on_imu(imu_of(stamp, (0.0, 0.1, 0.0)))
        if step in (10, 20):
            handed = [each.of_set(stamp) for each in both]
    assert all(one.coarse_pose is not None for one in handed)
    turned = [one.rot_now_from_last for one in handed]
    assert turned[0] is not None
    np.testing.assert_array_equal(*turned)
    assert not np.allclose(turned[0], np.eye(3))
    assert not aiding.ignored


# ---------------------------------------------------------------------------- in the pipeline


def test_the_pipeline_hands_on_what_is_known(monkeypatch: pytest.MonkeyPatch) -> None:
    handed: list[Aiding] = []
    process = HorizonSensor.process

    def spy(self: HorizonSensor, frames: Any, aiding: Aiding) -> HorizonFix:
        handed.append(aiding)
        return process(self, frames, aiding)

    monkeypatch.setattr(HorizonSensor, "process", spy)
    pipeline = HorizonPipeline(horizon_settings({**PARAMETERS, "planet": "wgs84"}).pipeline)
    pipeline.aiding.on_coarse_pose(pose_of())
    for index in range(3):
        stamp = START_NS + index * PERIOD_NS
        for late in (0, PERIOD_NS // 2):
            pipeline.aiding.on_imu(imu_of(stamp + late - PERIOD_NS // 2, (0.0, 0.1, 0.0)))
        for camera in CAMERAS:
            pipeline.on_camera_info(camera, camera_info_of(0, camera))
            gray = horizon_gray(camera, nadir_of(*attitude_at(index)))
            pipeline.on_image(camera, image_of(gray, stamp, camera))
    assert all(aiding.coarse_pose is not None for aiding in handed)
    assert [aiding.rot_now_from_last is not None for aiding in handed] == [False, True, True]


def test_two_pipelines_of_one_process_hear_the_same_rates_apart(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    handed: dict[HorizonSensor, list[Aiding]] = {}
    process = HorizonSensor.process

    def spy(self: HorizonSensor, frames: Any, aiding: Aiding) -> HorizonFix:
        handed.setdefault(self, []).append(aiding)
        return process(self, frames, aiding)

    monkeypatch.setattr(HorizonSensor, "process", spy)
    first = HorizonPipeline(horizon_settings(PARAMETERS).pipeline)
    second = first.with_settings(horizon_settings({**PARAMETERS, "max_residual": 3.0}).pipeline)
    rate = np.array([0.0, 0.3, 0.0])
    for index in range(2):
        stamp = START_NS + index * PERIOD_NS
        rates = [imu_of(stamp - PERIOD_NS * part // 4, rate) for part in (3, 2, 1, 0)]
        for pipeline in (first, second):
            for msg in rates:
                pipeline.aiding.on_imu(msg)
        for camera in CAMERAS:
            gray = horizon_gray(camera, nadir_of(0.0, np.degrees(0.3 * index * PERIOD_NS / S)))
            for pipeline in (first, second):
                pipeline.on_camera_info(camera, camera_info_of(0, camera))
                pipeline.on_image(camera, image_of(gray, stamp, camera))
    turn = Rotation.from_rotvec(-rate * PERIOD_NS / S).as_matrix()
    for sets in handed.values():
        assert sets[0].rot_now_from_last is None
        np.testing.assert_allclose(sets[1].rot_now_from_last, turn, atol=1e-9)
    assert len(handed) == 2
    assert not first.aiding.ignored
    assert not second.aiding.ignored


def test_the_pose_of_a_bags_end_is_not_that_of_its_beginning() -> None:
    pipeline = HorizonPipeline(horizon_settings({**PARAMETERS, "planet": "wgs84"}).pipeline)
    said = []
    for index in (0, 1, 0):
        stamp = START_NS + index * PERIOD_NS
        if index == 1:
            pipeline.aiding.on_coarse_pose(pose_of(stamp))
        for camera in CAMERAS:
            pipeline.on_camera_info(camera, camera_info_of(0, camera))
            gray = horizon_gray(camera, nadir_of(*attitude_at(index)))
            pipeline.on_image(camera, image_of(gray, stamp, camera))
        said.append(pipeline.aiding.words["coarse_pose"])
    assert said == ["none", "used", "none"]


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"planet": "sphere"}, "not used: planet is sphere; the Earth's ellipsoid is wgs84"),
        ({"planet": "sphere", "coarse_pose_altitude_sigma": 1e4}, "used"),
        ({"planet": "wgs84"}, "used"),
    ],
)
def test_what_is_said_of_a_pose_that_nothing_is_made_of(values: dict[str, Any], words: str) -> None:
    """Where the planet is a sphere a pose tells its altitude, if that was asked for."""
    aiding = sources(**values)
    aiding.on_coarse_pose(pose_of())
    aiding.of_set(START_NS)
    assert aiding.words["coarse_pose"] == words


def test_why_a_pose_was_refused_is_said_though_an_older_one_is_too_old() -> None:
    aiding = sources()
    aiding.on_coarse_pose(pose_of())
    aiding.on_coarse_pose(pose_of(START_NS + 100 * S, frame_id="map"))
    aiding.of_set(START_NS + 100 * S)
    assert aiding.words["coarse_pose"].startswith("refused: ")


def test_an_ellipsoid_without_a_pose_is_said_to_be_taken_for_a_sphere() -> None:
    said = []
    for values in ({}, {"planet": "wgs84"}):
        pipeline = HorizonPipeline(horizon_settings({**PARAMETERS, **values}).pipeline)
        monitor = HorizonMonitor("node: horizon", CAMERAS, S, live=False)
        for camera in CAMERAS:
            pipeline.on_camera_info(camera, camera_info_of(0, camera))
            gray = horizon_gray(camera, nadir_of(0, 0))
            monitor.on_step(pipeline.on_image(camera, image_of(gray, START_NS, camera)), START_NS)
        said.append(monitor.health(START_NS))
    assert said[0].state == "ok"
    assert said[1].state == "degraded"
    assert said[1].reason == "fitted as a sphere: no coarse pose"


@pytest.fixture
def mask_file(tmp_path: Path) -> Path:
    use = np.full((HEIGHT, WIDTH), 255, np.uint8)
    use[:, :60] = 0
    path = tmp_path / "mask.png"
    cv2.imwrite(str(path), use)
    return path


def test_a_mask_reaches_the_frames(mask_file: Path) -> None:
    values = {**PARAMETERS, "cameras": ["camera_1"], "camera_1.mask": str(mask_file)}
    pipeline = HorizonPipeline(horizon_settings(values).pipeline)
    pipeline.on_camera_info("camera_1", camera_info_of(0, "camera_1"))
    gray = horizon_gray("camera_1", nadir_of(0, 0))
    gray[:, :60] = 255
    (result,) = pipeline.on_image("camera_1", image_of(gray, START_NS, "camera_1")).results
    assert result.fix.ok, result.fix.reason
    assert result.fix.limbs[0].px[:, 0].min() > 60


def test_a_cameras_encoding_is_undone_before_anything_else() -> None:
    values = {**PARAMETERS, "cameras": ["camera_1"], "camera_1.gamma": 2.2}
    light = horizon_gray("camera_1", nadir_of(0, 0))
    encoded = np.rint(255.0 * (light / 255.0) ** (1.0 / 2.2)).astype(np.uint8)
    altitude_m = []
    for setup, gray in ((values, encoded), ({**values, "camera_1.gamma": 1.0}, light)):
        pipeline = HorizonPipeline(horizon_settings(setup).pipeline)
        pipeline.on_camera_info("camera_1", camera_info_of(0, "camera_1"))
        (result,) = pipeline.on_image("camera_1", image_of(gray, START_NS, "camera_1")).results
        assert result.fix.ok, result.fix.reason
        altitude_m.append(result.fix.fit.altitude_m)
    assert altitude_m[0] == pytest.approx(altitude_m[1], rel=2e-3)


def test_a_rolling_shutters_rows_are_brought_to_the_stamp() -> None:
    """The very frame, by a craft that turns: another nadir, and a camera that says why."""
    nadirs = []
    gray = horizon_gray("camera_1", nadir_of(0, 0))
    for readout_s in (0.0, 0.02, -0.02):
        values = {**PARAMETERS, "cameras": ["camera_1"], "camera_1.readout": readout_s}
        pipeline = HorizonPipeline(horizon_settings(values).pipeline)
        pipeline.on_camera_info("camera_1", camera_info_of(0, "camera_1"))
        for step in (2, 1, 0):
            pipeline.aiding.on_imu(imu_of(START_NS - step * S // 100, (0.0, 0.2, 0.1)))
        (result,) = pipeline.on_image("camera_1", image_of(gray, START_NS, "camera_1")).results
        assert result.fix.ok, result.fix.reason
        nadirs.append(result.fix.fit.nadir_base)
        (frame,) = result.frames
        assert result.fix.residual_px(frame.view, result.fix.limbs[0]) < 0.5
    plain, forwards, backwards = nadirs
    # A row is read after so much of the readout, or else before so much of it is left: both ways
    # together nadir moves by the whole turn, but for its part about nadir itself.
    moved = forwards - plain + backwards - plain
    assert np.linalg.norm(moved) == pytest.approx(0.02 * 0.2, rel=0.05)
    assert 1.0 < np.linalg.norm(backwards - plain) / np.linalg.norm(forwards - plain) < 20.0


def test_what_motion_smears_is_known_by_exposure_and_gyro() -> None:
    """Two cameras on a craft that turns by 5 px while they expose; nadir is that of the middle."""
    exposure_s, rate = 0.02, np.array([0.3, 0.6, 0.2])
    nadir = nadir_of(0.05, -0.03)
    shares = (np.arange(9) + 0.5) / 9.0 - 0.5
    moments = [Rotation.from_rotvec(-at * exposure_s * rate).apply(nadir) for at in shares]
    values = {**PARAMETERS, **{f"{camera}.exposure": exposure_s for camera in CAMERAS}}
    pipeline = HorizonPipeline(horizon_settings(values).pipeline)
    for step in (2, 1, 0):
        pipeline.aiding.on_imu(imu_of(START_NS - step * S // 100, rate))
    for camera in CAMERAS:
        pipeline.on_camera_info(camera, camera_info_of(0, camera))
        seen = [horizon_gray(camera, at, seed) for seed, at in enumerate(moments)]
        gray = np.rint(np.mean(seen, axis=0)).astype(np.uint8)
        step = pipeline.on_image(camera, image_of(gray, START_NS, camera))
    (result,) = step.results
    assert result.fix.ok, result.fix.reason
    assert np.linalg.norm(result.fix.fit.nadir_base - nadir) < 1e-3
    for frame in result.frames:
        assert frame.view.exposure_s == exposure_s
        assert frame.view.rate is not None
        np.testing.assert_allclose(frame.view.rate.rate_base_rad_s, rate)


def test_cameras_with_other_stamps_are_brought_to_that_of_the_first() -> None:
    """The second one 15 ms late, at .3 rad/s: by their stamps both see the nadir of the first."""
    rate, late_s = np.array([0.1, 0.28, 0.0]), 0.015
    nadir = nadir_of(0.05, -0.03)
    later = Rotation.from_rotvec(-late_s * rate).apply(nadir)
    off = {}
    for told in (True, False):
        pipeline = HorizonPipeline(horizon_settings(PARAMETERS).pipeline)
        for step in (2, 1, 0):
            at = START_NS - step * S // 100
            pipeline.aiding.on_imu(imu_of(at, rate if told else np.zeros(3)))
        for camera, seen, stamp in zip(
            CAMERAS, (nadir, later), (START_NS, START_NS + round(late_s * S)), strict=True
        ):
            pipeline.on_camera_info(camera, camera_info_of(0, camera))
            step = pipeline.on_image(camera, image_of(horizon_gray(camera, seen), stamp, camera))
        (result,) = step.results
        assert result.fix.ok, result.fix.reason
        assert result.stamp == START_NS
        off[told] = np.linalg.norm(result.fix.fit.nadir_base - nadir)
    assert off[True] < 5e-4
    assert off[False] > 2.0 * off[True]


def test_a_mask_of_another_size_refuses_the_frames_by_name(mask_file: Path) -> None:
    cv2.imwrite(str(mask_file), np.full((20, 30), 255, np.uint8))
    values = {**PARAMETERS, "camera_1.mask": str(mask_file)}
    pipeline = HorizonPipeline(horizon_settings(values).pipeline)
    pipeline.on_camera_info("camera_1", camera_info_of(0, "camera_1"))
    gray = horizon_gray("camera_1", nadir_of(0, 0))
    step = pipeline.on_image("camera_1", image_of(gray, START_NS, "camera_1"))
    assert step.refusal is not None
    assert step.refusal.cause == "mask_size"
    assert f"{WIDTH} x {HEIGHT}" in step.refusal.reason
    assert "30 x 20" in step.refusal.reason


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("mask.png", "no absolute path"),
        ("{tmp}/none.png", "there is no file"),
        ("{tmp}/text.png", "not a picture"),
        ("{tmp}/vast.pgm", "not a picture"),
        ("{tmp}/black.png", "black all over"),
        ("package://no_such_package_here/mask.png", "no package 'no_such_package_here'"),
    ],
)
def test_a_mask_that_cannot_be_is_one_clear_line(tmp_path: Path, name: str, words: str) -> None:
    (tmp_path / "text.png").write_text("no picture")
    (tmp_path / "vast.pgm").write_text("P5 100000 100000 255\n")
    cv2.imwrite(str(tmp_path / "black.png"), np.zeros((20, 30), np.uint8))
    with pytest.raises(ParameterError) as caught:
        horizon_settings({**PARAMETERS, "camera_2.mask": name.format(tmp=tmp_path)})
    message = str(caught.value)
    assert message.startswith("camera_2.mask: ")
    assert words in message
    assert "\n" not in message
