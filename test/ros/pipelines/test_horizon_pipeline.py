"""The pipeline without a node: messages in, results out, and what is said about bad ones."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from horizon_messages import (
    ALTITUDE_M,
    CAMERAS,
    HEIGHT,
    PARAMETERS,
    PERIOD_NS,
    ROTATIONS,
    START_NS,
    WIDTH,
    attitude_at,
    camera_info_of,
    horizon_gray,
    image_of,
    nadir_of,
    recording,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from sensor_msgs.msg import Image

from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.ros.messages.refusal import Refusal
from horizon_sensor_ros.ros.parameters.horizon_settings import horizon_settings
from horizon_sensor_ros.ros.pictures.debug_image import draw_fix
from horizon_sensor_ros.ros.pipelines import horizon_pipeline
from horizon_sensor_ros.ros.pipelines.horizon_pipeline import HorizonPipeline, HorizonResult, Step

FLAT = np.full((HEIGHT, WIDTH), 90, np.uint8)


def pipeline_of(**values: Any) -> HorizonPipeline:
    return HorizonPipeline(horizon_settings({**PARAMETERS, **values}).pipeline)


def ready(**values: Any) -> HorizonPipeline:
    pipeline = pipeline_of(**values)
    for camera in pipeline.settings.cameras:
        pipeline.on_camera_info(camera, camera_info_of(0, camera))
    return pipeline


def good(camera: str, index: int, **fields: Any) -> Image:
    stamp = START_NS + index * PERIOD_NS
    gray = horizon_gray(camera, nadir_of(*attitude_at(index)))
    return image_of(gray, stamp, camera, **fields)


def play(pipeline: HorizonPipeline, messages: list[tuple[str, int, Any]]) -> list[HorizonResult]:
    results = []
    for topic, _, msg in messages:
        _, camera, kind = topic.split("/")
        if kind == "camera_info":
            pipeline.on_camera_info(camera, msg)
        else:
            results += pipeline.on_image(camera, msg).results
    return results


def pair(pipeline: HorizonPipeline, index: int) -> HorizonResult:
    steps = [pipeline.on_image(camera, good(camera, index)) for camera in CAMERAS]
    (result,) = steps[-1].results
    return result


def angle_deg(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))


def test_a_flight_is_followed() -> None:
    results = play(pipeline_of(), recording(5))
    assert [r.stamp for r in results] == [START_NS + i * PERIOD_NS for i in range(5)]
    for index, result in enumerate(results):
        assert result.fix.status is Status.OK, result.fix.reason
        assert result.fix.cameras_used == CAMERAS
        assert angle_deg(result.fix.fit.nadir_base, nadir_of(*attitude_at(index))) < 0.05
        assert abs(result.fix.fit.altitude_m - ALTITUDE_M) < 5e3


@pytest.mark.parametrize("bits", [8, 16])
def test_one_camera_alone(bits: int) -> None:
    pipeline = ready(cameras=["camera_2"])
    gray = horizon_gray("camera_2", nadir_of(0, 0))
    if bits == 16:
        gray = gray.astype(np.uint16) * 257
    (result,) = pipeline.on_image("camera_2", image_of(gray, START_NS, "camera_2")).results
    assert result.fix.status is Status.OK
    assert angle_deg(result.fix.fit.nadir_base, nadir_of(0, 0)) < 0.1


@pytest.mark.parametrize("bits", [8, 10, 12, 16])
def test_encoded_light_is_undone_whatever_the_bits(bits: int) -> None:
    """Of 16 bits a camera may use ten: nothing in a message says so."""
    white, gamma = 2**bits - 1, 2.2
    pipeline = ready(**{f"{camera}.gamma": gamma for camera in CAMERAS})
    for camera in CAMERAS:
        light = horizon_gray(camera, nadir_of(0, 0)) / 255.0
        gray = np.rint(white * light ** (1.0 / gamma)).astype(np.uint8 if bits == 8 else np.uint16)
        results = pipeline.on_image(camera, image_of(gray, START_NS, camera)).results
    fit = results[0].fix.fit
    assert angle_deg(fit.nadir_base, nadir_of(0, 0)) < 0.01
    assert abs(fit.altitude_m - ALTITUDE_M) < 4.0 * np.sqrt(fit.cov_nadir_altitude[3, 3])


def test_encoded_light_is_undone_too_once_the_bits_change() -> None:
    pipeline = ready(**{"cameras": ["camera_2"], "camera_2.gamma": 2.2})
    light = horizon_gray("camera_2", nadir_of(0, 0)) / 255.0
    for index, (white, kind) in enumerate([(4095, np.uint16), (255, np.uint8), (4095, np.uint16)]):
        gray = np.rint(white * light ** (1.0 / 2.2)).astype(kind)
        step = pipeline.on_image("camera_2", image_of(gray, START_NS + index, "camera_2"))
        assert step.refusal is None
        assert angle_deg(step.results[0].fix.fit.nadir_base, nadir_of(0, 0)) < 0.1


def test_the_scale_of_encoded_light_outlasts_dim_frames_and_other_settings() -> None:
    """Of twelve bits in sixteen: a dim frame would be of ten by itself."""
    pipeline = ready(**{"cameras": ["camera_2"], "camera_2.gamma": 2.2})
    light = horizon_gray("camera_2", nadir_of(0, 0)) / 255.0
    levels = []
    for index, white in enumerate([4095, 900, 900]):
        if index == 2:
            pipeline = pipeline.with_settings(replace(pipeline.settings, slop_ns=1))
        gray = np.rint(white * light ** (1.0 / 2.2)).astype(np.uint16)
        stamp = START_NS + index * PERIOD_NS
        step = pipeline.on_image("camera_2", image_of(gray, stamp, "camera_2"))
        (result,) = step.results
        levels.append(np.median(result.fix.limbs[0].step))
    assert levels[1] == pytest.approx(levels[0] * (900 / 4095) ** 2.2, rel=0.05)
    assert levels[2] == pytest.approx(levels[1], rel=0.05)


def test_without_camera_info_a_frame_is_refused_by_name() -> None:
    pipeline = pipeline_of()
    step = pipeline.on_image("camera_1", good("camera_1", 0))
    assert step == Step(
        "camera_1", refusal=Refusal("no_camera_info", "no camera_info yet for camera_1")
    )
    assert pipeline.rejected == {"no_camera_info": 1}


BAD = {
    "zero_size": {"width": 0, "height": 0},
    "truncated_data": {"height": HEIGHT + 1},
    "wrong_step": {"step": 7},
    "unknown_encoding": {"encoding": "32FC1"},
}


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("cause", BAD)
def test_a_bad_frame_gives_no_estimate_and_the_next_pair_does(cause: str, camera: str) -> None:
    pipeline = ready()
    for name in CAMERAS:
        fields = BAD[cause] if name == camera else {}
        step = pipeline.on_image(name, good(name, 0, **fields))
        assert not step.results
        assert (step.refusal is not None) == (name == camera)
    assert pipeline.rejected[cause] == 1
    assert pair(pipeline, 1).fix.status is Status.OK
    assert pipeline.rejected["unpaired"] == 1


def test_camera_info_counts_from_the_next_image_on() -> None:
    pipeline = ready()
    assert pair(pipeline, 0).fix.status is Status.OK
    pipeline.on_camera_info("camera_1", camera_info_of(k=[0.0] * 9))
    step = pipeline.on_image("camera_1", good("camera_1", 1))
    assert step.refusal is not None
    assert step.refusal.cause == "uncalibrated"
    pipeline.on_camera_info("camera_1", camera_info_of(width=WIDTH + 1))
    step = pipeline.on_image("camera_1", good("camera_1", 2))
    assert step.refusal is not None
    assert step.refusal.cause == "size_mismatch"
    pipeline.on_camera_info("camera_1", camera_info_of())
    assert pair(pipeline, 3).fix.status is Status.OK


def test_cameras_are_rebuilt_only_when_the_calibration_changes() -> None:
    pipeline = ready()
    views = []
    for index in range(3):
        if index:
            focal = 260.0 + (index - 1)
            k = [focal, 0.0, (WIDTH - 1) / 2, 0.0, focal, (HEIGHT - 1) / 2, 0.0, 0.0, 1.0]
            pipeline.on_camera_info("camera_1", camera_info_of(index, k=k))
        views.append(pair(pipeline, index).frames[0].view)
    assert views[0] is views[1]
    assert views[2] is not views[1]
    assert views[2].camera.fx == 261.0


@pytest.mark.parametrize("value", [0, 90, 255])
def test_frames_without_a_horizon_give_no_fix(value: int) -> None:
    pipeline = ready()
    frame = np.full((HEIGHT, WIDTH), value, np.uint8)
    for camera in CAMERAS:
        step = pipeline.on_image(camera, image_of(frame, START_NS, camera))
    (result,) = step.results
    assert result.fix.status is not Status.OK
    assert result.fix.reason
    assert pipeline.rejected[str(result.fix.status)] == 1
    assert pipeline.counts["fixes"] == 0


@pytest.mark.parametrize("blind", CAMERAS)
def test_with_one_camera_blind_the_other_gives_the_fix_and_the_stamp(blind: str) -> None:
    pipeline = ready()
    for index, camera in enumerate(CAMERAS):
        msg = good(camera, 0)
        if camera == blind:
            msg = image_of(FLAT, START_NS, camera)
        msg.header.stamp.nanosec += index
        step = pipeline.on_image(camera, msg)
    (result,) = step.results
    seeing = next(c for c in CAMERAS if c != blind)
    assert result.fix.status is Status.OK, result.fix.reason
    assert result.fix.cameras_used == (seeing,)
    assert result.stamp == START_NS + CAMERAS.index(seeing)
    picture = draw_fix(result.frames, result.fix)
    assert picture.shape == (480, 2 * 640, 3)


def test_repeated_and_looped_stamps() -> None:
    pipeline = ready()
    pair(pipeline, 0)
    pair(pipeline, 1)
    for camera in CAMERAS:
        step = pipeline.on_image(camera, good(camera, 1))
        assert step.refusal is not None
        assert step.refusal.cause == "repeated_stamp"
    assert pair(pipeline, 0).fix.status is Status.OK
    assert pipeline.counts["time_jumps"] == 1
    assert pipeline.rejected == {"repeated_stamp": 2}


def test_stamps_are_known_after_a_pause_and_with_other_settings() -> None:
    pipeline = ready()
    pair(pipeline, 1)
    pipeline.reset()
    other = pipeline.with_settings(
        replace(pipeline.settings, slop_ns=pipeline.settings.slop_ns // 2)
    )
    for each in (pipeline, other):
        for camera in CAMERAS:
            step = each.on_image(camera, good(camera, 1))
            assert step.refusal is not None
            assert step.refusal.cause == "repeated_stamp"
        assert pair(each, 0).fix.status is Status.OK
        assert each.counts["time_jumps"] == 1


def test_the_track_is_forgotten_when_time_jumps_back() -> None:
    flight = recording(3)
    straight = play(pipeline_of(), flight)
    looped = play(pipeline_of(), flight + flight)
    for first, again in zip(straight, looped[3:], strict=True):
        np.testing.assert_array_equal(first.fix.fit.nadir_base, again.fix.fit.nadir_base)
        np.testing.assert_array_equal(
            first.fix.fit.cov_nadir_altitude, again.fix.fit.cov_nadir_altitude
        )


def test_settings_change_and_calibrations_stay() -> None:
    pipeline = ready()
    pair(pipeline, 0)
    slow = horizon_settings({**PARAMETERS, "altitude_min": 1e6}).pipeline
    other = pipeline.with_settings(slow)
    result = pair(other, 1)
    assert result.fix.status is not Status.OK
    assert other.counts["sets"] == 2
    assert pipeline.counts["sets"] == 1
    # Each hears its own messages, should both go on.
    other.on_camera_info("camera_1", camera_info_of(k=[0.0] * 9))
    assert pair(pipeline, 1).fix.status is Status.OK


def test_a_defect_costs_a_frame_not_the_node(monkeypatch: pytest.MonkeyPatch) -> None:
    pipeline = ready()

    def broken(*_: Any) -> None:
        raise ZeroDivisionError("core")

    with monkeypatch.context() as patch:
        patch.setattr(pipeline._sensor, "process", broken)
        for camera in CAMERAS:
            step = pipeline.on_image(camera, good(camera, 0))
    assert step.refusal is not None
    assert step.refusal.cause == "internal_error"
    said = r"internal error: ZeroDivisionError: core at ros/pipelines/horizon_pipeline\.py:\d+"
    assert re.fullmatch(said, step.refusal.reason)
    assert pair(pipeline, 1).fix.status is Status.OK


def test_a_defect_costs_a_calibration_not_the_node(monkeypatch: pytest.MonkeyPatch) -> None:
    pipeline = pipeline_of()

    def broken(*_: Any) -> None:
        raise ZeroDivisionError("lens")

    with monkeypatch.context() as patch:
        patch.setattr(horizon_pipeline, "camera_from_info", broken)
        pipeline.on_camera_info("camera_1", camera_info_of())
    step = pipeline.on_image("camera_1", good("camera_1", 0))
    assert step.refusal is not None
    assert step.refusal.cause == "internal_error"
    assert "lens" in step.refusal.reason
    k = [261.0, 0.0, (WIDTH - 1) / 2, 0.0, 261.0, (HEIGHT - 1) / 2, 0.0, 0.0, 1.0]
    for camera in CAMERAS:
        pipeline.on_camera_info(camera, camera_info_of(camera=camera, k=k))
    assert pair(pipeline, 1).fix.status is Status.OK


def test_extrinsics_can_come_from_elsewhere_and_be_missing() -> None:
    known: dict[str, np.ndarray] = {}

    def lookup(camera: str, frame_id: str) -> np.ndarray | Refusal:
        assert frame_id == f"{camera}_optical"
        return known.get(camera, Refusal("no_extrinsics", f"no transform for {camera}"))

    pipeline = HorizonPipeline(horizon_settings({"extrinsics_source": "tf"}).pipeline, lookup)
    for camera in CAMERAS:
        pipeline.on_camera_info(camera, camera_info_of(0, camera))
        step = pipeline.on_image(camera, good(camera, 0))
        assert step.refusal == Refusal("no_extrinsics", f"no transform for {camera}")
    known.update(ROTATIONS)
    assert angle_deg(pair(pipeline, 1).fix.fit.nadir_base, nadir_of(*attitude_at(1))) < 0.05


def test_a_rotation_that_is_rounded_otherwise_each_time_is_one() -> None:
    """As TF's are that is composed of several: the limb was searched for in every set."""
    rng = np.random.default_rng(0)

    def lookup(camera: str, frame_id: str) -> np.ndarray:
        return ROTATIONS[camera] + 1e-15 * rng.normal(size=(3, 3))

    pipeline = HorizonPipeline(horizon_settings({"extrinsics_source": "tf"}).pipeline, lookup)
    for camera in CAMERAS:
        pipeline.on_camera_info(camera, camera_info_of(0, camera))
    fixes = [pair(pipeline, index).fix for index in range(4)]
    assert all(fix.ok for fix in fixes)
    assert fixes[-1].predicted is not None


def test_rotations_that_are_to_come_from_elsewhere_must_come() -> None:
    with pytest.raises(ValueError, match="camera_1, camera_2"):
        HorizonPipeline(horizon_settings({"extrinsics_source": "tf"}).pipeline)


@settings(max_examples=60)
@given(
    st.lists(
        st.tuples(
            st.sampled_from(CAMERAS),
            st.integers(0, 40),
            st.integers(0, 40),
            st.integers(0, 200),
            st.sampled_from(["mono8", "mono16", "rgb8", "bayer_rggb8", "", "32FC1"]),
            st.binary(max_size=1600),
            st.integers(-(2**31), 2**31 - 1) | st.integers(0, 3),
            st.integers(0, 2**32 - 1) | st.integers(0, 3),
        ),
        max_size=20,
    )
)
def test_garbage_gives_nothing_and_breaks_nothing(frames: list[tuple]) -> None:
    pipeline = ready()
    for camera, width, height, step, encoding, data, sec, nanosec in frames:
        msg = Image(width=width, height=height, step=step, encoding=encoding)
        msg.data.frombytes(data)
        msg.header.stamp.sec, msg.header.stamp.nanosec = sec, nanosec
        info = camera_info_of(width=width, height=height)
        pipeline.on_camera_info(camera, info)
        for result in pipeline.on_image(camera, msg).results:
            assert result.fix.status is not Status.OK
    assert pipeline.rejected["internal_error"] == 0


@pytest.mark.parametrize(
    "given",
    [
        {},
        {"altitude_min": 3e7, "altitude_max": 4e7},
        {"min_contrast": 1e4, "max_nadir_sigma": 1e-6, "min_limb_share": 1.0},
        {"limb": "canny", "method": "gauss_newton"},
    ],
    ids=["as shipped", "far up", "nothing passes", "the papers'"],
)
def test_warming_up_goes_the_whole_way_and_leaves_no_trace(given: dict[str, Any]) -> None:
    pipeline = ready(**given)
    fixes = pipeline.warm_up()
    assert [fix.status for fix in fixes] == [Status.OK] * 3
    assert fixes[1].predicted is not None, "followed"
    assert not pipeline.counts
    assert not pipeline.rejected
