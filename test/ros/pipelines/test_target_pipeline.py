"""Clouds in, the target's messages out: poses and deltas against truth, and when there are none."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import PointCloud2
from target_messages import (
    BAD_CLOUDS,
    BAD_MESSAGES,
    CLOUD_PERIOD_NS,
    FRAME_ID,
    SAME_POINTS,
    cloud_of,
    good_cloud,
    rewritten,
    scan,
    stamp_of,
    truth_at,
)

from horizon_sensor_ros.core.mathematics.rigid import rotation_from_vector, vector_from_rotation
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.ros.diagnostics.diagnostics import Health
from horizon_sensor_ros.ros.diagnostics.target_diagnostics import TargetMonitor
from horizon_sensor_ros.ros.parameters.target_settings import target_settings
from horizon_sensor_ros.ros.pipelines.target_pipeline import (
    TARGET_TOPICS,
    TargetPipeline,
    TargetStep,
    twist_of_delta,
)

ALL_TOPICS = tuple(TARGET_TOPICS)
S = 1_000_000_000


def pipeline_of(**values: Any) -> TargetPipeline:
    return TargetPipeline(target_settings(values).pipeline)


def topics(step: TargetStep) -> tuple[str, ...]:
    return tuple(topic for topic, _ in step.outputs)


def output(step: TargetStep, topic: str) -> Any:
    return dict(step.outputs)[topic]


def matrix(msg: Any) -> np.ndarray:
    """Pose (4, 4) of a PoseWithCovarianceStamped."""
    pose = msg.pose.pose
    q = pose.orientation
    out = np.eye(4)
    out[:3, :3] = Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix()
    out[:3, 3] = pose.position.x, pose.position.y, pose.position.z
    return out


def covariance(msg: Any) -> np.ndarray:
    found = msg.twist.covariance if hasattr(msg, "twist") else msg.pose.covariance
    return np.array(found).reshape(6, 6)


def error_of(found: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """(6,) position and fixed-axis rotation, in a message's order."""
    turn = Rotation.from_matrix(found[:3, :3] @ truth[:3, :3].T).as_rotvec()
    return np.concatenate([found[:3, 3] - truth[:3, 3], turn])


def target_truth(index: int, first: int = 0) -> np.ndarray:
    """Target frame, set at cloud `first`, in the sensor frame at cloud `index`."""
    seen = scan(first).reshape(-1, 3).astype(float)
    set_at = np.eye(4)
    set_at[:3, 3] = np.nanmean(seen, axis=0)
    return truth_at(index) @ np.linalg.inv(truth_at(first)) @ set_at


def test_the_first_cloud_sets_the_target_frame() -> None:
    step = pipeline_of().on_cloud(good_cloud(0))
    assert topics(step) == ("target/pose",)
    msg = output(step, "target/pose")
    assert msg.header.frame_id == FRAME_ID
    assert msg.header.stamp.sec * S + msg.header.stamp.nanosec == stamp_of(0)
    np.testing.assert_allclose(matrix(msg), target_truth(0), atol=1e-6)
    np.testing.assert_array_equal(matrix(msg)[:3, :3], np.eye(3))
    values = np.linalg.eigvalsh(covariance(msg))
    assert np.all((values > 0) & (values < 1e-4))


def test_poses_deltas_and_twists_are_the_truth_within_their_covariance() -> None:
    pipeline = pipeline_of()
    previous = pipeline.on_cloud(good_cloud(0))
    squares = []
    for index in range(1, 8):
        step = pipeline.on_cloud(good_cloud(index))
        assert topics(step) == ALL_TOPICS
        pose, delta = (output(step, t) for t in ALL_TOPICS[:2])
        twist = output(step, "target/twist")
        for msg in (pose, delta, twist):
            assert msg.header.stamp == good_cloud(index).header.stamp
        assert pose.header.frame_id == FRAME_ID
        assert delta.header.frame_id == twist.header.frame_id == "target_previous"
        last = matrix(output(previous, "target/pose"))
        np.testing.assert_allclose(matrix(delta), np.linalg.inv(last) @ matrix(pose), atol=1e-9)
        true_delta = np.linalg.inv(target_truth(index - 1)) @ target_truth(index)
        for found, truth, msg in (
            (matrix(pose), target_truth(index), pose),
            (matrix(delta), true_delta, delta),
        ):
            error = error_of(found, truth)
            assert np.linalg.norm(error[:3]) < 0.005
            assert np.linalg.norm(error[3:]) < np.radians(0.3)
            squares.append(error @ np.linalg.solve(covariance(msg), error))
        duration_s = CLOUD_PERIOD_NS * 1e-9
        linear, angular = twist.twist.twist.linear, twist.twist.twist.angular
        turn = Rotation.from_matrix(matrix(delta)[:3, :3]).as_rotvec()
        np.testing.assert_allclose(np.array([angular.x, angular.y, angular.z]) * duration_s, turn)
        shift = np.array([linear.x, linear.y, linear.z]) * duration_s
        np.testing.assert_allclose(shift, matrix(delta)[:3, 3])
        np.testing.assert_allclose(
            covariance(twist) * duration_s**2, covariance(delta), rtol=0.02, atol=1e-8
        )
        previous = step
    # Six degrees of freedom; a covariance in the wrong order or frame is off by far more.
    assert 1.0 < np.median(squares) < 20.0
    assert pipeline.counts == {"clouds": 8, "fixes": 8, "target_frames": 1}
    assert not pipeline.rejected


def test_the_target_frame_has_the_name_it_is_given() -> None:
    pipeline = pipeline_of(target_frame="debris")
    pipeline.on_cloud(good_cloud(0))
    delta = output(pipeline.on_cloud(good_cloud(1)), "target/pose_delta")
    assert delta.header.frame_id == "debris_previous"


@pytest.mark.parametrize("name", SAME_POINTS)
def test_the_same_points_in_another_way_tell_the_same(name: str) -> None:
    pipeline = pipeline_of()
    for index in range(3):
        points = SAME_POINTS[name](scan(index))
        step = pipeline.on_cloud(cloud_of(points, stamp_of(index)))
    error = error_of(matrix(output(step, "target/pose")), target_truth(2))
    assert np.linalg.norm(error[:3]) < 0.01
    assert np.linalg.norm(error[3:]) < np.radians(0.5)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("offsets", [(0, 8, 16), (20, 3, 11)])
def test_fields_in_any_order_padding_and_endianness(
    order: str, offsets: tuple[int, int, int]
) -> None:
    one, other = pipeline_of(), pipeline_of()
    for index in range(3):
        cloud = good_cloud(index)
        same = other.on_cloud(rewritten(cloud, order, offsets, 31))
        assert one.on_cloud(cloud).outputs == same.outputs
        assert same.outputs


def test_the_same_clouds_give_the_same_messages() -> None:
    clouds = [good_cloud(i) for i in (0, 1, 1, 2, 0, 1)]
    one, other = pipeline_of(), pipeline_of()
    for cloud in clouds:
        assert one.on_cloud(cloud).outputs == other.on_cloud(cloud).outputs


@pytest.mark.parametrize("name", BAD_MESSAGES)
def test_a_message_that_is_none_gives_a_reason_and_the_next_cloud_works(name: str) -> None:
    fields, cause, words = BAD_MESSAGES[name]
    pipeline = pipeline_of()
    pipeline.on_cloud(good_cloud(0))
    step = pipeline.on_cloud(good_cloud(1, **fields))
    assert step.outputs == ()
    assert step.refusal is not None
    assert step.refusal.cause == cause
    assert words in step.refusal.reason
    assert pipeline.rejected == {cause: 1}
    # Against the cloud before the bad one.
    delta = output(pipeline.on_cloud(good_cloud(2)), "target/pose_delta")
    truth = np.linalg.inv(target_truth(0)) @ target_truth(2)
    assert np.abs(error_of(matrix(delta), truth)).max() < 0.01


@pytest.mark.parametrize("first", [False, True], ids=["in between", "first"])
@pytest.mark.parametrize("name", BAD_CLOUDS)
def test_a_cloud_that_says_nothing_gives_a_reason_and_the_next_cloud_works(
    name: str, first: bool
) -> None:
    points, word = BAD_CLOUDS[name]
    pipeline = pipeline_of()
    if not first:
        pipeline.on_cloud(good_cloud(0))
    step = pipeline.on_cloud(cloud_of(points, stamp_of(1)))
    assert step.outputs == ()
    assert step.fix is not None
    assert str(step.fix.status) in ((word,) if first else (word, "poor_fit"))
    assert step.fix.reason
    assert pipeline.rejected == {str(step.fix.status): 1}
    after = pipeline.on_cloud(good_cloud(2))
    assert topics(after) == (("target/pose",) if first else ALL_TOPICS)


def test_another_target_gives_no_delta_and_in_the_end_a_new_frame() -> None:
    pipeline = pipeline_of(max_refused=3, max_gap=100.0)
    pipeline.on_cloud(good_cloud(0))
    for index in (1, 2):
        step = pipeline.on_cloud(good_cloud(index, "cylinder"))
        assert step.outputs == ()
        assert step.fix is not None
        assert step.fix.reason
    assert topics(pipeline.on_cloud(good_cloud(3))) == ALL_TOPICS
    for index in (4, 5):
        assert pipeline.on_cloud(good_cloud(index, "cylinder")).outputs == ()
    step = pipeline.on_cloud(good_cloud(6, "cylinder"))
    assert topics(step) == ("target/pose",)
    assert step.fix is not None
    assert step.fix.reason.startswith("track lost")
    assert topics(pipeline.on_cloud(good_cloud(7, "cylinder"))) == ALL_TOPICS
    assert pipeline.counts["target_frames"] == 2


def test_a_long_gap_starts_a_new_frame() -> None:
    pipeline = pipeline_of(max_gap=0.5)
    for index in (0, 1, 3):
        step = pipeline.on_cloud(good_cloud(index))
    assert topics(step) == ALL_TOPICS
    step = pipeline.on_cloud(good_cloud(6))
    assert topics(step) == ("target/pose",)
    assert step.fix is not None
    assert "no fix for 0.6 s" in step.fix.reason
    np.testing.assert_allclose(
        matrix(output(step, "target/pose")), target_truth(6, first=6), atol=1e-6
    )
    assert topics(pipeline.on_cloud(good_cloud(7))) == ALL_TOPICS


def test_a_repeated_stamp_gives_no_second_estimate() -> None:
    pipeline = pipeline_of()
    pipeline.on_cloud(good_cloud(0))
    pipeline.on_cloud(good_cloud(1))
    step = pipeline.on_cloud(cloud_of(scan(2), stamp_of(1)))
    assert step.outputs == ()
    assert pipeline.rejected == {"repeated_stamp": 1}
    assert topics(pipeline.on_cloud(good_cloud(2))) == ALL_TOPICS
    # Nor after a pause.
    pipeline.reset()
    assert pipeline.on_cloud(good_cloud(2)).outputs == ()
    assert pipeline.rejected == {"repeated_stamp": 2}


def test_the_same_cloud_under_a_new_stamp_gives_no_estimate() -> None:
    pipeline = pipeline_of()
    for index in range(2):
        pipeline.on_cloud(good_cloud(index))
    step = pipeline.on_cloud(cloud_of(scan(1), stamp_of(2)))
    assert step.outputs == ()
    assert pipeline.rejected == {"repeated_cloud": 1}
    assert topics(pipeline.on_cloud(good_cloud(3))) == ALL_TOPICS


def test_time_that_jumps_back_resets_at_once() -> None:
    pipeline = pipeline_of()
    for index in (5, 6, 0):
        step = pipeline.on_cloud(good_cloud(index))
    assert topics(step) == ("target/pose",)
    assert pipeline.counts["time_jumps"] == 1
    assert topics(pipeline.on_cloud(good_cloud(1))) == ALL_TOPICS


@pytest.mark.parametrize("name", ["NaN only", "zeros"])
def test_a_bad_cloud_of_a_wrong_stamp_is_no_jump_of_time(name: str) -> None:
    pipeline = pipeline_of()
    pipeline.on_cloud(good_cloud(5))
    for bad_stamp in (stamp_of(5000), stamp_of(0), stamp_of(6)):
        assert pipeline.on_cloud(cloud_of(BAD_CLOUDS[name][0], bad_stamp)).outputs == ()
    assert topics(pipeline.on_cloud(good_cloud(6))) == ALL_TOPICS
    assert pipeline.counts["time_jumps"] == 0
    assert pipeline.rejected == {"too_few_points": 3}
    # A bag that starts over with a bad cloud is one jump.
    pipeline.on_cloud(cloud_of(BAD_CLOUDS[name][0], stamp_of(0)))
    assert topics(pipeline.on_cloud(good_cloud(1))) == ("target/pose",)
    assert pipeline.counts["time_jumps"] == 1


def test_clouds_in_another_frame_set_a_new_target_frame() -> None:
    pipeline = pipeline_of()
    pipeline.on_cloud(good_cloud(0))
    other = good_cloud(1)
    other.header.frame_id = "other_tof"
    step = pipeline.on_cloud(other)
    assert topics(step) == ("target/pose",)
    assert step.fix is not None
    assert "other_tof" in step.fix.reason
    assert output(step, "target/pose").header.frame_id == "other_tof"


@pytest.mark.parametrize("name", ["NaN only", "zeros"])
def test_a_cloud_in_another_frame_that_shows_nothing_leaves_the_track(name: str) -> None:
    pipeline = pipeline_of()
    pipeline.on_cloud(good_cloud(0))
    stray = cloud_of(BAD_CLOUDS[name][0], stamp_of(1))
    stray.header.frame_id = "other_tof"
    assert pipeline.on_cloud(stray).outputs == ()
    assert topics(pipeline.on_cloud(good_cloud(2))) == ALL_TOPICS
    assert pipeline.counts["target_frames"] == 1


def test_a_stamp_that_is_none_is_refused() -> None:
    cloud = good_cloud(0)
    cloud.header.stamp.nanosec = 2_000_000_000
    step = pipeline_of().on_cloud(cloud)
    assert step.refusal is not None
    assert step.refusal.cause == "bad_stamp"


def test_settings_change_without_losing_the_track() -> None:
    pipeline = pipeline_of()
    pipeline.on_cloud(good_cloud(0))
    pipeline.apply(target_settings({"min_points": 100000}).pipeline)
    assert pipeline.on_cloud(good_cloud(1)).outputs == ()
    pipeline.apply(target_settings({}).pipeline)
    assert topics(pipeline.on_cloud(good_cloud(2))) == ALL_TOPICS


def test_warming_up_goes_the_whole_way_and_leaves_no_trace() -> None:
    nothing_passes = {"crop_max": [0.1] * 3, "min_points": 10**6, "max_rotation_sigma": 1e-6}
    assert [fix.status for fix in pipeline_of(**nothing_passes).warm_up()] == [Status.OK] * 3
    pipeline = pipeline_of()
    pipeline.warm_up()
    assert not pipeline.counts
    assert topics(pipeline.on_cloud(good_cloud(0))) == ("target/pose",)


def test_a_defect_of_ours_costs_one_cloud(monkeypatch: pytest.MonkeyPatch) -> None:
    pipeline = pipeline_of()
    pipeline.on_cloud(good_cloud(0))
    with monkeypatch.context() as patch:
        patch.setattr(pipeline._tracker, "process", lambda *_: 1 / 0)
        step = pipeline.on_cloud(good_cloud(1))
    assert step.refusal is not None
    assert step.refusal.cause == "internal_error"
    assert topics(pipeline.on_cloud(good_cloud(2))) == ALL_TOPICS


@settings(max_examples=40)
@given(
    st.lists(
        st.tuples(
            st.integers(0, 12),
            st.integers(0, 3),
            st.sampled_from(["one value", "scaled", "noise", "as it is"]),
            st.floats(width=32),
        ),
        max_size=6,
    )
)
def test_any_clouds_in_any_order_never_break_it(clouds: list) -> None:
    pipeline = pipeline_of()
    for stamp, number, how, value in clouds:
        points = scan(number)
        with np.errstate(all="ignore"):
            if how == "one value":
                points = np.full_like(points, value)
            elif how == "scaled":
                points = points * np.float32(value)
            elif how == "noise":
                points = np.random.default_rng(number).normal(size=(900, 3)) * value
            message = cloud_of(points, stamp * S // 10)
        step = pipeline.on_cloud(message)
        for _, msg in step.outputs:
            assert np.linalg.eigvalsh(covariance(msg)).min() > 0
    assert pipeline.rejected["internal_error"] == 0
    assert pipeline.counts["fixes"] + sum(pipeline.rejected.values()) == len(clouds)


ANGLES = st.floats(-1.0, 1.0)


@given(st.tuples(ANGLES, ANGLES, ANGLES), st.floats(0.05, 2.0))
def test_the_twists_covariance_is_that_of_the_rotation_vector(
    turn: tuple[float, ...], duration_s: float
) -> None:
    delta = np.eye(4)
    delta[:3, :3] = rotation_from_vector(np.array(turn))
    delta[:3, 3] = 0.1, 0.2, 0.3
    # Column by column: by how much a small turn about a fixed axis changes the rotation vector.
    step = 1e-6
    change = np.eye(6)
    for axis in range(3):
        small = rotation_from_vector(step * np.eye(3)[axis])
        moved = vector_from_rotation(small @ delta[:3, :3])
        back = vector_from_rotation(small.T @ delta[:3, :3])
        change[:3, axis] = (moved - back) / (2 * step)
    root = np.random.default_rng(0).normal(size=(6, 6))
    twist, found = twist_of_delta(delta, root @ root.T, duration_s)
    np.testing.assert_allclose(twist * duration_s, [*turn, 0.1, 0.2, 0.3], atol=1e-9)
    expected = change @ root @ root.T @ change.T
    np.testing.assert_allclose(found * duration_s**2, expected, rtol=1e-5, atol=1e-5)


# ------------------------------------------------------------------------------- diagnostics


def said(monitor: TargetMonitor, pipeline: TargetPipeline, now: int) -> dict[str, str]:
    (status,) = monitor.message(now, pipeline).status
    assert status.name == "node: target"
    assert status.values[1].value == status.message
    return {pair.key: pair.value for pair in status.values}


def states_of(*clouds: PointCloud2, live: bool = False, **values: Any) -> list[dict[str, str]]:
    pipeline = pipeline_of(**values)
    monitor = TargetMonitor("node: target", 2 * S, live=live)
    found = []
    for number, cloud in enumerate(clouds):
        step = pipeline.on_cloud(cloud)
        now = number * S // 5
        monitor.on_step(step, now)
        if step.outputs:
            monitor.on_published(now - S // 50, now)
        assert monitor.changed(now) == (found == [] or found[-1]["state"] != health(monitor).state)
        found.append(said(monitor, pipeline, now))
        assert not monitor.changed(now)
    return found


def health(monitor: TargetMonitor) -> Health:
    assert monitor._last_ns is not None
    return monitor.health(monitor._last_ns)


def test_diagnostics_say_state_reason_and_figures() -> None:
    first, second, bad, repeated, third = states_of(
        good_cloud(0),
        good_cloud(1),
        cloud_of(BAD_CLOUDS["a plane"][0], stamp_of(2)),
        cloud_of(BAD_CLOUDS["a plane"][0], stamp_of(2)),
        good_cloud(3),
    )
    assert (first["state"], first["reason"]) == (
        "new_target_frame",
        "new target frame: first cloud",
    )
    assert second["state"] == "ok"
    assert float(second["score"]) > 0.8
    assert int(second["points"]) > 100
    assert int(second["cloud_points"]) == np.isfinite(scan(1)[..., 2]).sum()
    assert second["degeneracy"] == "none"
    assert bad["state"] == "no_fix"
    assert bad["reason"].startswith(f"{bad['status']}: ")
    assert (repeated["state"], repeated["rejected_repeated_stamp"]) == ("refused", "1")
    assert third["state"] == "ok"
    assert (third["clouds"], third["fixes"], third["rejected"]) == ("5", "3", "2")
    assert not {"latency_ms", "rate_hz"} & third.keys()


def test_one_new_target_frame_after_the_other_is_told_at_once() -> None:
    pipeline = pipeline_of()
    monitor = TargetMonitor("node: target", 2 * S, live=False)
    reasons = []
    for index, frame_id in ((0, "tof"), (1, "tof2"), (2, "tof")):
        cloud = good_cloud(index)
        cloud.header.frame_id = frame_id
        monitor.on_step(pipeline.on_cloud(cloud), index * S)
        assert monitor.changed(index * S)
        reasons.append(said(monitor, pipeline, index * S)["reason"])
    assert len(set(reasons)) == 3


def test_directions_that_are_not_seen_are_named() -> None:
    # Nothing is certain to a thousandth of a millimetre.
    found = states_of(good_cloud(0), good_cloud(1), max_shift_sigma=1e-6)[-1]
    assert (found["state"], found["status"]) == ("no_fix", "ill_conditioned")
    assert int(found["degenerate_directions"]) == 3
    assert "shift along" in found["degeneracy"]


def test_live_diagnostics_have_latency_and_rate() -> None:
    found = states_of(*(good_cloud(i) for i in range(4)), live=True)[-1]
    assert found["latency_ms"] == found["latency_max_ms"] == "20.00"
    assert found["rate_hz"] == "5.00"


def test_silence_is_reported() -> None:
    pipeline = pipeline_of()
    monitor = TargetMonitor("node: target", 2 * S, live=False)
    assert said(monitor, pipeline, 0)["state"] == "waiting"
    monitor.on_step(pipeline.on_cloud(good_cloud(0)), S)
    stale = said(monitor, pipeline, 4 * S)
    assert (stale["state"], stale["reason"]) == ("stale", "no clouds for 3.0 s")
    assert stale["status"] == str(Status.OK)
