"""Diagnostics: the state, and the words for it, in every situation a pipeline can be in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from horizon_messages import (
    CAMERAS,
    PARAMETERS,
    camera_info_of,
    coarse_pose_of,
    horizon_gray,
    image_of,
    nadir_of,
    recording,
)

from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.horizon.fix import Frame, HorizonFix
from horizon_sensor_ros.core.limb_points import LimbPoints
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.planet_figure import Disc, MeanSphere
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.ros.diagnostics.horizon_diagnostics import HorizonMonitor
from horizon_sensor_ros.ros.messages.refusal import Refusal
from horizon_sensor_ros.ros.parameters.horizon_settings import horizon_settings
from horizon_sensor_ros.ros.pipelines.horizon_pipeline import HorizonPipeline, HorizonResult, Step

S = 1_000_000_000


def monitor_of(*, live: bool = True) -> HorizonMonitor:
    return HorizonMonitor("node: horizon", CAMERAS, 2 * S, live=live)


def fix_of(
    status: Status = Status.OK, used: tuple[str, ...] = CAMERAS, doubts: str = ""
) -> HorizonFix:
    limbs = tuple(
        LimbPoints(Status.OK) if c in used else LimbPoints.none(Status.NO_LIMB, "all dark")
        for c in CAMERAS
    )
    nadir = np.array([0.0, 0.0, -1.0])
    fit = HorizonFit(status, "", "ml", nadir, 1.1, 5e5, np.eye(4), 0.12, 210, 200, used)
    reason = doubts if status is Status.OK else "because"
    return HorizonFix(status, reason, fit, limbs, used)


def frames_of(cameras: Sequence[str]) -> tuple[Frame, ...]:
    lens = Camera(4, 3, 5.0, 5.0, 1.5, 1.0)
    dark = np.zeros((3, 4), np.uint8)
    return tuple(Frame(CameraView(name, lens, np.eye(3)), dark) for name in cameras)


def deliver(monitor: HorizonMonitor, now: int, fix: HorizonFix | None = None) -> None:
    monitor.on_step(Step("camera_1"), now)
    results = (HorizonResult(now, fix, frames_of(CAMERAS)),) if fix is not None else ()
    monitor.on_step(Step("camera_2", results), now)


def test_before_any_frame() -> None:
    health = monitor_of().health(0)
    assert (health.level, health.state) == (DiagnosticStatus.STALE, "waiting")
    assert health.reason == "no frames from camera_1 yet; no frames from camera_2 yet"


def test_one_camera_not_there_yet() -> None:
    monitor = monitor_of()
    monitor.on_step(Step("camera_1"), S)
    health = monitor.health(S)
    assert (health.level, health.state) == (DiagnosticStatus.WARN, "waiting")
    assert health.reason == "no frames from camera_2 yet"


def test_a_fix_with_doubts_says_them() -> None:
    monitor = monitor_of()
    deliver(monitor, S, fix_of(doubts="camera_1 and camera_2 are 9 sigma apart"))
    health = monitor.health(S)
    assert (health.level, health.state) == (DiagnosticStatus.WARN, "degraded")
    assert health.reason == "camera_1 and camera_2 are 9 sigma apart"


def test_a_fix_of_all_cameras_is_ok() -> None:
    monitor = monitor_of()
    deliver(monitor, S, fix_of())
    health = monitor.health(S)
    assert (health.level, health.state) == (DiagnosticStatus.OK, "ok")


def test_one_camera_blind_is_named() -> None:
    monitor = monitor_of()
    deliver(monitor, S, fix_of(used=("camera_1",)))
    health = monitor.health(S)
    assert (health.level, health.state) == (DiagnosticStatus.WARN, "degraded")
    assert health.reason == "camera_2 left out: all dark"


def test_a_camera_whose_limb_lies_elsewhere_is_left_out_for_that() -> None:
    monitor = monitor_of()
    fix = fix_of(used=("camera_1",))
    deliver(monitor, S, replace(fix, limbs=(LimbPoints(Status.OK),) * 2))
    why = "its limb is off the others' cone, or too short for the fit"
    assert monitor.health(S).reason == f"camera_2 left out: {why}"
    assert values_of(monitor, S)["camera_2.reason"] == why


def test_no_fix_says_why() -> None:
    monitor = monitor_of()
    deliver(monitor, S, fix_of(Status.UNCERTAIN, ()))
    health = monitor.health(S)
    assert (health.level, health.state) == (DiagnosticStatus.WARN, "no_fix")
    assert health.reason == "uncertain: because"


def test_a_refusal_lasts_until_the_cameras_next_good_frame() -> None:
    monitor = monitor_of()
    deliver(monitor, S, fix_of())
    monitor.on_step(Step("camera_2", refusal=Refusal("zero_size", "image of 0 x 0")), S)
    monitor.on_step(Step("camera_1"), S)
    health = monitor.health(S)
    assert (health.level, health.state) == (DiagnosticStatus.ERROR, "refused")
    assert health.reason == "camera_2: image of 0 x 0"
    deliver(monitor, S, fix_of())
    assert monitor.health(S).state == "ok"


def test_a_silent_camera_is_an_error_and_silent_ones_are_stale() -> None:
    monitor = monitor_of()
    deliver(monitor, 0, fix_of())
    monitor.on_step(Step("camera_1"), 3 * S)
    health = monitor.health(3 * S)
    assert (health.level, health.state) == (DiagnosticStatus.ERROR, "silent")
    assert health.reason == "no frames from camera_2 for 3.0 s"
    assert monitor.health(9 * S).level == DiagnosticStatus.STALE


def alone(monitor: HorizonMonitor, now: int, status: Status = Status.OK) -> None:
    """A set of the first camera's frame only, as when the other is silent."""
    fix = fix_of(status, CAMERAS[:1] if status is Status.OK else ())
    fix = replace(fix, limbs=fix.limbs[:1])
    result = HorizonResult(now, fix, frames_of(CAMERAS[:1]))
    monitor.on_step(Step("camera_1", (result,)), now)


def test_flown_without_a_silent_camera() -> None:
    monitor = monitor_of()
    deliver(monitor, 0, fix_of())
    alone(monitor, 3 * S)
    health = monitor.health(3 * S)
    assert (health.level, health.state) == (DiagnosticStatus.WARN, "degraded")
    assert health.reason == (
        "camera_2 left out: no usable frames for longer than camera_timeout; "
        "no frames from camera_2 for 3.0 s"
    )
    assert values_of(monitor, 3 * S)["camera_1.state"] == "used"
    assert values_of(monitor, 3 * S)["camera_2.state"] == "silent"
    alone(monitor, 4 * S, Status.NO_LIMB)
    health = monitor.health(4 * S)
    assert health.state == "no_fix"
    assert health.reason == "no_limb: because; no frames from camera_2 for 4.0 s"
    # The other one falls silent too, or both are back.
    assert monitor.health(9 * S).state == "stale"
    deliver(monitor, 9 * S, fix_of())
    assert monitor.health(9 * S).state == "ok"


def test_flown_without_a_camera_whose_frames_are_refused() -> None:
    monitor = monitor_of()
    deliver(monitor, 0, fix_of())
    alone(monitor, 3 * S)
    monitor.on_step(Step("camera_2", refusal=Refusal("zero_size", "image of 0 x 0")), 3 * S)
    health = monitor.health(3 * S)
    assert (health.level, health.state) == (DiagnosticStatus.WARN, "degraded")
    assert health.reason.endswith("camera_2: image of 0 x 0")
    assert values_of(monitor, 3 * S)["camera_2.state"] == "refused"


def test_a_node_that_is_slow_does_not_call_a_camera_silent() -> None:
    monitor = monitor_of()
    deliver(monitor, 0, fix_of())
    monitor.on_step(Step("camera_1"), S)
    # A set that took three seconds: stale after two.
    step = Step("camera_2", (HorizonResult(S, fix_of(used=("camera_1",)), frames_of(CAMERAS)),))
    monitor.on_step(step, 4 * S, busy_ns=3 * S)
    assert monitor.health(4 * S).state == "degraded"
    assert values_of(monitor, 4 * S)["camera_1.state"] == "used"
    # Listening again, it hears nothing more of camera_1.
    monitor.on_step(Step("camera_2"), 7 * S)
    health = monitor.health(7 * S)
    assert (health.state, health.reason) == ("silent", "no frames from camera_1 for 3.0 s")


def test_frames_that_never_pair() -> None:
    monitor = monitor_of()
    for second in range(4):
        deliver(monitor, second * S)
    health = monitor.health(3 * S)
    assert (health.level, health.state) == (DiagnosticStatus.ERROR, "unpaired")
    for possible in ("farther apart than slop", "more than queue_size frames later"):
        assert possible in health.reason


@pytest.mark.parametrize(("times", "lost"), [(1, 0), (2, 0), (5, 28)])
def test_a_camera_slower_than_the_others_costs_their_frames_and_that_is_told(
    times: int, lost: int
) -> None:
    """All was `ok`, and four of five frames of one camera gave no estimate."""
    monitor = monitor_of()
    for index in range(100):
        monitor.on_step(Step("camera_1"), index * S // 10)
        if index % times == 0:
            fixed = HorizonResult(index * S // 10, fix_of(), frames_of(CAMERAS))
            monitor.on_step(Step("camera_2", (fixed,)), index * S // 10)
    health = monitor.health(10 * S)
    if lost:
        assert (health.level, health.state) == (DiagnosticStatus.WARN, "degraded")
        assert health.reason.startswith(f"{lost} of the last 40 frames came into no set: ")
    else:
        assert (health.level, health.state) == (DiagnosticStatus.OK, "ok")


def test_frames_that_waited_for_a_silent_camera_are_not_laid_to_its_rate() -> None:
    monitor = monitor_of()
    for index in range(60):
        if index < 30:
            monitor.on_step(Step("camera_1"), index * S // 10)
        else:
            alone(monitor, index * S // 10)
    assert "came into no set" not in monitor.health(6 * S).reason


def test_how_near_the_stamps_come_is_told_until_there_is_a_set() -> None:
    pipeline = HorizonPipeline(horizon_settings(PARAMETERS).pipeline)
    monitor = monitor_of()
    gray = {camera: horizon_gray(camera, nadir_of(0, 0)) for camera in CAMERAS}
    for camera in CAMERAS:
        pipeline.on_camera_info(camera, camera_info_of())
    for index in range(4):
        for late_ms, camera in zip((0, 30), CAMERAS, strict=True):
            image = image_of(gray[camera], index * S + late_ms * 1_000_000, camera)
            monitor.on_step(pipeline.on_image(camera, image), index * S)
        words = monitor.health(index * S).reason
        assert words.endswith("; the nearest stamps are 30.0 ms apart"), words
    assert monitor.health(3 * S).state == "unpaired"
    for camera in CAMERAS:
        monitor.on_step(pipeline.on_image(camera, image_of(gray[camera], 4 * S, camera)), 4 * S)
    assert monitor.health(4 * S).state == "ok"


def test_a_clock_set_back_does_not_hide_silence() -> None:
    monitor = monitor_of()
    deliver(monitor, 1000 * S, fix_of())
    assert monitor.health(10 * S).state == "ok"
    assert monitor.health(13 * S).state == "stale"


def test_changes_of_state_are_noticed_once() -> None:
    pipeline = HorizonPipeline(horizon_settings(PARAMETERS).pipeline)
    monitor = monitor_of()
    assert monitor.changed(0)
    monitor.message(0, pipeline)
    assert not monitor.changed(0)
    deliver(monitor, S, fix_of())
    assert monitor.changed(S)
    monitor.message(S, pipeline)
    deliver(monitor, 2 * S, fix_of())
    assert not monitor.changed(2 * S)
    deliver(monitor, 3 * S, fix_of(Status.NO_LIMB, ()))
    assert monitor.changed(3 * S)


def test_what_the_message_says() -> None:
    pipeline = HorizonPipeline(horizon_settings(PARAMETERS).pipeline)
    pipeline.rejected["zero_size"] = 3
    monitor = monitor_of()
    for i in range(11):
        deliver(monitor, i * S // 10, fix_of())
        monitor.on_published(i * S // 10 - 4_000_000, i * S // 10)
    message = monitor.message(S, pipeline)
    (status,) = message.status
    values = {pair.key: pair.value for pair in status.values}
    assert status.name == "node: horizon"
    assert message.header.stamp.sec == 1
    assert values["state"] == "ok"
    assert values["points"] == "200"
    assert values["residual_px"] == "0.1200"
    assert values["rejected"] == values["rejected_zero_size"] == "3"
    assert float(values["latency_ms"]) == 4.0
    assert float(values["rate_hz"]) == 10.0


def test_the_rate_of_a_looped_bag_is_that_of_the_loop() -> None:
    """A clock that is set back: estimates of the loops before lie before now as well."""
    monitor = monitor_of()
    for _ in range(4):
        for i in range(50):
            monitor.on_published(i * S // 10, i * S // 10)
        assert values_of(monitor, 49 * S // 10)["rate_hz"] == "10.00"
    # Back, and nothing comes.
    assert values_of(monitor, 3 * S)["rate_hz"] == "0.00"


@pytest.mark.parametrize("silent_s", [3, 20, 2000])
def test_the_rate_after_an_outage_is_that_of_now(silent_s: int) -> None:
    monitor = monitor_of()
    for i in range(40):
        monitor.on_published(i * S // 10, i * S // 10)
    after = (4 + silent_s) * S
    assert float(values_of(monitor, after)["rate_hz"]) < 0.6 * 10.0
    for i in range(52):
        monitor.on_published(after + i * S // 10, after + i * S // 10)
    assert values_of(monitor, after + 51 * S // 10)["rate_hz"] == "10.00"


def test_the_rate_of_slow_estimates_is_told() -> None:
    monitor = monitor_of()
    for i in range(4):
        monitor.on_published(20 * i * S, 20 * i * S)
    assert values_of(monitor, 60 * S)["rate_hz"] == "0.05"


def test_latencies_of_a_clock_that_was_set_back_are_forgotten() -> None:
    monitor = monitor_of()
    monitor.on_published(97 * S, 100 * S)
    monitor.on_published(2 * S - S // 100, 2 * S)
    assert float(values_of(monitor, 2 * S)["latency_max_ms"]) == 10.0


def test_a_replay_says_nothing_of_the_machine() -> None:
    pipeline = HorizonPipeline(horizon_settings(PARAMETERS).pipeline)
    monitor = monitor_of(live=False)
    deliver(monitor, S, fix_of())
    (status,) = monitor.message(S, pipeline).status
    assert not {"latency_ms", "latency_max_ms", "rate_hz"} & {p.key for p in status.values}


def test_a_clock_without_a_time_is_told() -> None:
    """ROS: a simulated clock shows 0 until the first message on /clock."""
    pipeline = HorizonPipeline(horizon_settings(PARAMETERS).pipeline)
    stamp = 1_700_000_000 * S
    monitor, replay = monitor_of(), monitor_of(live=False)

    def told(by: HorizonMonitor, now: int) -> tuple[bytes, str, str, set[str]]:
        (status,) = by.message(now, pipeline).status
        values = {pair.key: pair.value for pair in status.values}
        pace = {"latency_ms", "latency_max_ms", "rate_hz"} & values.keys()
        return status.level, values["state"], values["reason"], pace

    level, state, reason, pace = told(monitor, 0)
    assert (level, state, pace) == (DiagnosticStatus.STALE, "waiting", set())
    assert reason.startswith("no frames from camera_1 yet")
    assert "/clock" in reason
    deliver(monitor, 0, fix_of())
    monitor.on_published(stamp, 0)
    level, state, reason, pace = told(monitor, 0)
    assert (level, state, pace) == (DiagnosticStatus.WARN, "no_clock", set())
    assert "use_sim_time" in reason
    deliver(monitor, 0, fix_of(Status.NO_LIMB, ()))
    level, state, reason, _ = told(monitor, 0)
    assert (level, state) == (DiagnosticStatus.WARN, "no_fix")
    assert reason.startswith("no_limb: because")
    assert "/clock" in reason
    # As soon as there is a time all is told, and nothing of what was before it.
    deliver(monitor, stamp, fix_of())
    assert monitor.changed(stamp)
    monitor.on_published(stamp - S // 50, stamp)
    level, state, reason, pace = told(monitor, stamp)
    assert (level, state) == (DiagnosticStatus.OK, "ok")
    assert pace == {"latency_ms", "latency_max_ms", "rate_hz"}
    assert float(values_of(monitor, stamp)["latency_max_ms"]) == 20.0
    # A bag's time may well be 0.
    deliver(replay, 0, fix_of())
    assert told(replay, 0)[1:] == ("ok", "fix from camera_1, camera_2", set())


def values_of(monitor: HorizonMonitor, now: int) -> dict[str, str]:
    pipeline = HorizonPipeline(horizon_settings(PARAMETERS).pipeline)
    return {v.key: v.value for v in monitor.message(now, pipeline).status[0].values}


@pytest.mark.parametrize(
    ("shows", "alone", "told"), [(True, False, "used"), (True, True, "alone"), (False, False, None)]
)
def test_airglow_is_told_where_the_fix_is_by_it(shows: bool, alone: bool, told: str | None) -> None:
    monitor = monitor_of()
    fix = fix_of()
    airglow = fix.fit if shows else None
    deliver(monitor, S, replace(fix, airglow=airglow, airglow_alone=alone))
    assert values_of(monitor, S).get("airglow") == told


def test_each_camera_says_how_it_fares() -> None:
    monitor = monitor_of()
    assert values_of(monitor, 0)["camera_1.state"] == "waiting"
    deliver(monitor, S, fix_of(used=("camera_1",)))
    values = values_of(monitor, S)
    assert (values["camera_1.state"], values["camera_1.reason"]) == ("used", "")
    assert (values["camera_2.state"], values["camera_2.reason"]) == ("left_out", "all dark")
    assert values["camera_2.points"] == "0"
    monitor.on_step(Step("camera_2", refusal=Refusal("zero_size", "image of 0 x 0 pixels")), S)
    values = values_of(monitor, S)
    assert (values["camera_2.state"], values["camera_2.reason"]) == (
        "refused",
        "image of 0 x 0 pixels",
    )
    assert values["camera_1.state"] == "used"
    values = values_of(monitor, 4 * S)
    assert (values["camera_1.state"], values["camera_1.reason"]) == (
        "silent",
        "no frames for 3.0 s",
    )


def test_each_cameras_points_and_residual() -> None:
    pipeline = HorizonPipeline(horizon_settings(PARAMETERS).pipeline)
    monitor = monitor_of()
    for topic, _, msg in recording(1):
        _, camera, kind = topic.split("/")
        if kind == "camera_info":
            pipeline.on_camera_info(camera, msg)
        else:
            monitor.on_step(pipeline.on_image(camera, msg), S)
    values = values_of(monitor, S)
    residuals = [float(values[f"{camera}.residual_px"]) for camera in CAMERAS]
    assert all(int(values[f"{camera}.points"]) > 20 for camera in CAMERAS)
    assert sum(int(values[f"{camera}.points"]) for camera in CAMERAS) >= int(values["points"])
    # The common residual lies between the cameras', but for outliers, which are each one's own.
    common = float(values["residual_px"])
    assert min(residuals) / 1.5 <= common <= max(residuals) * 1.5


def test_topics_that_help_are_spoken_of() -> None:
    monitor = monitor_of()
    pipeline = HorizonPipeline(horizon_settings(PARAMETERS).pipeline)
    pipeline.aiding.on_coarse_pose(coarse_pose_of(S, np.ones(3) * 4e6, np.eye(3), "map"))
    values = {v.key: v.value for v in monitor.message(S, pipeline).status[0].values}
    assert values["coarse_pose"] == "refused: header frame is 'map', not 'earth'"
    assert values["imu"] == "none"
    assert values["ignored_coarse_pose_wrong_frame"] == "1"


def test_a_coarse_pose_that_no_ellipsoid_came_of_is_not_called_used() -> None:
    monitor = monitor_of()
    settings = horizon_settings({**PARAMETERS, "planet": "wgs84"}).pipeline
    pipeline = HorizonPipeline(settings)
    pipeline.aiding.on_coarse_pose(coarse_pose_of(S, np.array([7e6, 0.0, 0.0]), np.eye(3)))
    pipeline.aiding.of_set(S)
    why = "the coarse pose is 174 deg off the limb's vertical"
    sphere = MeanSphere(Planet.wgs84(), "geocentric", why)
    on_sphere = Disc(sphere, np.array([0.0, 0.0, -1.0]), 1.1)
    not_used = f"not used for the planet's figure: fitted as a sphere: {why}"
    for disc, told in ((None, "used"), (on_sphere, not_used)):
        fix = fix_of()
        deliver(monitor, S, replace(fix, fit=replace(fix.fit, disc=disc)))
        values = {v.key: v.value for v in monitor.message(S, pipeline).status[0].values}
        assert values["coarse_pose"] == told


def test_a_gyro_that_no_horizon_bears_out_is_not_called_used() -> None:
    monitor = monitor_of()
    pipeline = HorizonPipeline(horizon_settings(PARAMETERS).pipeline)
    pipeline.aiding.words["imu"] = "used"
    for refused, told in ((False, "used"), (True, "not used: no horizon bears it out")):
        deliver(monitor, S, replace(fix_of(), gyro_refused=refused))
        values = {v.key: v.value for v in monitor.message(S, pipeline).status[0].values}
        assert values["imu"] == told
