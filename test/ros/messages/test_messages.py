"""The translator: every encoding against values worked out by hand, every refusal by its cause."""

from __future__ import annotations

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from horizon_messages import (
    FOCAL_PX,
    HEIGHT,
    TYPESTORE,
    WIDTH,
    camera_info_of,
    horizon_gray,
    image_of,
    imu_of,
    nadir_of,
    type_name,
)
from hypothesis import given
from hypothesis import strategies as st
from limb_samples import CAMERAS
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Image, RegionOfInterest

from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.mathematics.attitude import level_from_base, nadir_from_roll_pitch
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.ros.messages.aiding import rate_from_imu
from horizon_sensor_ros.ros.messages.camera_info import camera_from_info, camera_info_key
from horizon_sensor_ros.ros.messages.estimates import (
    attitude_message,
    local_vertical_message,
    pose_message,
    twist_message,
)
from horizon_sensor_ros.ros.messages.images import ENCODINGS, gray_from_image
from horizon_sensor_ros.ros.messages.refusal import Refusal
from horizon_sensor_ros.ros.messages.sensors import camera_info_message, encoded_image
from horizon_sensor_ros.ros.messages.stamps import (
    ns_from_time,
    repeated_stamp,
    stamp_ns,
    time_from_ns,
)

RGB_WEIGHTS = (0.299, 0.587, 0.114)


def raw_image(data: np.ndarray, width: int, height: int, step: int, encoding: str) -> Image:
    msg = Image(width=width, height=height, step=step, encoding=encoding)
    msg.data.frombytes(data.tobytes())
    return msg


def cause_of(result: object) -> str:
    assert isinstance(result, Refusal), result
    assert result.reason
    return result.cause


def test_mono8_is_a_view_not_a_copy() -> None:
    msg = image_of(np.arange(12, dtype=np.uint8).reshape(3, 4), 0)
    gray = gray_from_image(msg)
    assert isinstance(gray, np.ndarray)
    msg.data[5] = 200
    assert gray[1, 1] == 200


@pytest.mark.parametrize("big", [False, True])
def test_mono16_of_either_endianness(big: bool) -> None:
    values = np.array([[1, 256, 65535], [4, 1000, 0]], np.uint16)
    data = values.astype(">u2" if big else "<u2")
    msg = raw_image(data, 3, 2, 6, "mono16")
    msg.is_bigendian = int(big)
    gray = gray_from_image(msg)
    assert isinstance(gray, np.ndarray)
    assert gray.dtype == np.uint16
    assert gray.dtype.isnative
    np.testing.assert_array_equal(gray, values)


@pytest.mark.parametrize("encoding", ["mono16", "bayer_rggb16"])
@pytest.mark.parametrize("big", [False, True])
def test_an_endianness_that_the_pixels_contradict_is_refused(encoding: str, big: bool) -> None:
    """Twelve bits in the wrong order still show a horizon, and altitude was 13 sigma off."""
    gray = horizon_gray("camera_1", nadir_of(0, 0)).astype(np.uint16) * 16
    noise = np.random.default_rng(3).integers(0, 16, gray.shape, dtype=np.uint16)
    data = (gray + noise).astype(">u2" if big else "<u2")
    msg = raw_image(data, gray.shape[1], gray.shape[0], 2 * gray.shape[1], encoding)
    msg.is_bigendian = int(big)
    assert isinstance(gray_from_image(msg), np.ndarray)
    msg.is_bigendian = int(not big)
    assert cause_of(gray_from_image(msg)) == "swapped_bytes"


@pytest.mark.parametrize("padding", [1, 3, 4])
@pytest.mark.parametrize("encoding", ["mono8", "mono16", "rgb8"])
def test_row_padding_is_left_out(encoding: str, padding: int) -> None:
    size = {"mono8": 1, "mono16": 2, "rgb8": 3}[encoding]
    rng = np.random.default_rng(1)
    tight = rng.integers(0, 255, (6, 8 * size), dtype=np.uint8)
    padded = np.pad(tight, ((0, 0), (0, padding)), constant_values=255)
    expected = gray_from_image(raw_image(tight, 8, 6, 8 * size, encoding))
    gray = gray_from_image(raw_image(padded, 8, 6, 8 * size + padding, encoding))
    assert isinstance(gray, np.ndarray)
    assert gray.flags.c_contiguous
    assert gray.flags.aligned
    np.testing.assert_array_equal(gray, expected)


@pytest.mark.parametrize("encoding", ["rgb8", "bgr8", "rgba8", "bgra8"])
@pytest.mark.parametrize("channel", [0, 1, 2])
def test_colour_has_the_weight_of_its_channel(encoding: str, channel: int) -> None:
    pixel = np.zeros(len(encoding) - 1, np.uint8)
    pixel[encoding.index("rgb"[channel])] = 200
    data = np.tile(pixel, (4, 5, 1))
    gray = gray_from_image(raw_image(data, 5, 4, 5 * len(pixel), encoding))
    assert isinstance(gray, np.ndarray)
    assert gray.shape == (4, 5)
    np.testing.assert_allclose(gray, 200 * RGB_WEIGHTS[channel], atol=1)


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("pattern", ["rggb", "bggr", "gbrg", "grbg"])
@pytest.mark.parametrize("channel", [0, 1, 2])
def test_bayer_patterns_know_their_colours(pattern: str, bits: int, channel: int) -> None:
    cells = np.array([c == "rgb"[channel] for c in pattern]).reshape(2, 2)
    full = 200 if bits == 8 else 50000
    data = (np.tile(cells, (4, 5)) * full).astype(np.uint8 if bits == 8 else np.uint16)
    msg = raw_image(data, 10, 8, 10 * bits // 8, f"bayer_{pattern}{bits}")
    gray = gray_from_image(msg)
    assert isinstance(gray, np.ndarray)
    assert gray.dtype == data.dtype
    assert gray.shape == (8, 10)
    np.testing.assert_allclose(gray[2:-2, 2:-2], full * RGB_WEIGHTS[channel], rtol=0.01)


def test_rosbags_messages_decode_alike() -> None:
    values = np.random.default_rng(2).integers(0, 2**16, (7, 9)).astype(np.uint16)
    msg = image_of(values, 3)
    other = TYPESTORE.deserialize_cdr(serialize_message(msg), type_name(msg))
    np.testing.assert_array_equal(gray_from_image(other), gray_from_image(msg))
    info = camera_info_of()
    other = TYPESTORE.deserialize_cdr(serialize_message(info), type_name(info))
    assert camera_from_info(other) == camera_from_info(info)
    assert camera_info_key(other) == camera_info_key(info)


@pytest.mark.parametrize(
    ("fields", "cause"),
    [
        ({"width": 0}, "zero_size"),
        ({"height": 0}, "zero_size"),
        ({"step": 3}, "wrong_step"),
        ({"step": 0}, "wrong_step"),
        ({"step": 5}, "truncated_data"),
        ({"height": 4}, "truncated_data"),
        ({"height": 2}, "wrong_step"),
        ({"encoding": "32FC1"}, "unknown_encoding"),
        ({"encoding": ""}, "unknown_encoding"),
        ({"encoding": "x" * 1000}, "unknown_encoding"),
        ({"encoding": "mono16"}, "wrong_step"),
        ({"width": 2**32 - 1, "height": 2**32 - 1, "step": 2**32 - 1}, "truncated_data"),
        ({"encoding": "bayer_rggb8"}, "too_small"),
    ],
)
def test_refused_images(fields: dict, cause: str) -> None:
    msg = image_of(np.zeros((3, 4), np.uint8), 0, **fields)
    result = gray_from_image(msg)
    assert cause_of(result) == cause
    assert isinstance(result, Refusal)
    assert len(result.reason) < 150


def test_who_sends_what_is_unknown_is_told_what_is_known() -> None:
    result = gray_from_image(image_of(np.zeros((3, 4), np.uint8), 0, encoding="nv12"))
    assert isinstance(result, Refusal)
    assert "'nv12'" in result.reason
    told = result.reason.split("known are ")[1].replace(" and Bayer's", "").split(", ")
    assert told == [name for name in ENCODINGS if not name.startswith("bayer")]


def test_a_stamp_that_nobody_sets_is_called_that() -> None:
    assert repeated_stamp(5).reason == "stamp repeats the last one's"
    assert "zero" in repeated_stamp(0).reason


@given(
    width=st.integers(0, 2**32 - 1) | st.integers(0, 9),
    height=st.integers(0, 2**32 - 1) | st.integers(0, 9),
    step=st.integers(0, 2**32 - 1) | st.integers(0, 40),
    encoding=st.sampled_from(list(ENCODINGS)) | st.text(max_size=20),
    big=st.integers(0, 255),
    data=st.binary(max_size=400),
)
def test_no_image_raises(
    width: int, height: int, step: int, encoding: str, big: int, data: bytes
) -> None:
    msg = Image(width=width, height=height, step=step, is_bigendian=big)
    msg.encoding = encoding
    msg.data.frombytes(data)
    result = gray_from_image(msg)
    if isinstance(result, np.ndarray):
        assert result.shape == (height, width)
        assert result.dtype in (np.uint8, np.uint16)
        assert result.flags.c_contiguous
        assert step * height == len(data)
    else:
        cause_of(result)


def test_stamps_there_and_back() -> None:
    msg = image_of(np.zeros((2, 2), np.uint8), 12_000_000_034)
    assert stamp_ns(msg) == 12_000_000_034
    assert time_from_ns(12_000_000_034) == Time(sec=12, nanosec=34)
    assert time_from_ns(-1) == Time(sec=-1, nanosec=999_999_999)
    msg.header.stamp.nanosec = 1_000_000_000
    assert cause_of(stamp_ns(msg)) == "bad_stamp"


def test_camera_of_camera_info() -> None:
    camera = camera_from_info(camera_info_of())
    assert camera == Camera(
        WIDTH, HEIGHT, FOCAL_PX, FOCAL_PX, (WIDTH - 1) / 2, (HEIGHT - 1) / 2, "plumb_bob", (0,) * 5
    )


def test_region_of_interest_and_binning_shape_the_camera() -> None:
    roi = RegionOfInterest(x_offset=40, y_offset=20, width=200, height=100)
    camera = camera_from_info(camera_info_of(roi=roi, binning_x=2, binning_y=4))
    assert isinstance(camera, Camera)
    assert (camera.width, camera.height) == (100, 25)
    assert (camera.fx, camera.fy) == (FOCAL_PX / 2, FOCAL_PX / 4)


@pytest.mark.parametrize(
    ("fields", "cause"),
    [
        ({"k": [0.0] * 9}, "uncalibrated"),
        ({"k": [np.nan] * 9}, "bad_camera_info"),
        ({"d": [np.inf] * 5}, "bad_camera_info"),
        ({"k": [5e-324, 0, 1, 0, 100, 1, 0, 0, 1]}, "bad_camera_info"),
        ({"k": [100.0, 0, 1e30, 0, 100, 1, 0, 0, 1]}, "bad_camera_info"),
        ({"k": [100.0, 0, 1, 0, 100, -7e3, 0, 0, 1]}, "bad_camera_info"),
        ({"d": [1e9, 0.0, 0.0, 0.0, 0.0]}, "bad_camera_info"),
        ({"d": [0.1] * 3}, "bad_camera_info"),
        ({"distortion_model": "fisheye62"}, "bad_camera_info"),
        ({"k": [-100.0, 0, 1, 0, 100, 1, 0, 0, 1]}, "bad_camera_info"),
        ({"roi": RegionOfInterest(x_offset=300, width=100, height=100)}, "bad_camera_info"),
    ],
)
def test_refused_camera_infos(fields: dict, cause: str) -> None:
    assert cause_of(camera_from_info(camera_info_of(**fields))) == cause


@pytest.mark.parametrize(
    ("model", "d"),
    [
        ("equidistant", [0.0, 0.0, 0.0, 1e308]),
        ("plumb_bob", [1e308] * 5),
        ("rational_polynomial", [1e160] * 8),
        ("plumb_bob", [1e200, 1e200, 0.0, 0.0, 1e200]),
        ("plumb_bob", [0.0, 0.0, 50.0, 0.0]),
        ("rational_polynomial", [0.0] * 8 + [1e308] * 4),
    ],
)
def test_distortion_that_no_lens_has_is_refused(model: str, d: list[float]) -> None:
    """Whether it overflows or leaves next to no pixel a ray."""
    info = camera_info_of(distortion_model=model, d=d)
    assert cause_of(camera_from_info(info)) == "bad_camera_info"


@pytest.mark.parametrize(
    "camera",
    [
        *CAMERAS,
        # Whose fields end inside the frame: a strong barrel, and whole fisheyes' circles.
        Camera(640, 480, 420.0, 420.0, 319.5, 239.5, "plumb_bob", (-0.5, 0.0, 0.0, 0.0, 0.0)),
        Camera(1920, 1080, 270.0, 270.0, 959.5, 539.5, "equidistant"),
        Camera(
            1280, 720, 150.0, 150.0, 639.5, 359.5, "equidistant", (-0.05, 0.0, 0.0, -0.001)
        ),
        # A telephoto lens, whose angles are so small that its coefficients are large.
        Camera(640, 480, 8e3, 8e3, 319.5, 239.5, "plumb_bob", (5.0, 2e3, 0.0, 0.0, -1e5)),
    ],
)  # fmt: skip
def test_lenses_that_there_are_are_taken(camera: Camera) -> None:
    assert camera_from_info(camera_info_message(camera, 0, "")) == camera


WILD = st.floats(allow_nan=False, allow_infinity=False) | st.builds(
    lambda sign, power: sign * 10.0**power, st.sampled_from([-1.0, 1.0]), st.integers(-300, 308)
)


@given(
    model=st.sampled_from([("plumb_bob", 5), ("rational_polynomial", 14), ("equidistant", 4)]),
    values=st.lists(st.just(0.0) | WILD, min_size=14, max_size=14),
)
def test_no_finite_distortion_raises_and_what_is_taken_sees(
    model: tuple[str, int], values: list[float]
) -> None:
    name, size = model
    result = camera_from_info(camera_info_of(distortion_model=name, d=values[:size]))
    if isinstance(result, Refusal):
        assert cause_of(result) == "bad_camera_info"
        return
    x, y = np.meshgrid(np.arange(0, WIDTH, 10.0), np.arange(0, HEIGHT, 10.0))
    rays = result.rays(np.column_stack((x.ravel(), y.ravel())))
    assert np.isfinite(rays).all(axis=1).mean() > 0.05


def test_a_reason_stays_short_whatever_a_message_says() -> None:
    endless = "a" * 10_000 + "\n\x00"
    info = camera_info_of(distortion_model=endless)
    image = image_of(np.zeros((8, 8), np.uint8), 0)
    image.encoding = endless
    rate = imu_of(0, (0.0, 0.0, 0.0))
    rate.header.frame_id = endless
    for refused in (
        camera_from_info(info),
        gray_from_image(image),
        rate_from_imu(rate, "base_link"),
    ):
        assert isinstance(refused, Refusal)
        assert len(refused.reason) < 200
        assert refused.reason.isprintable()


@given(
    width=st.integers(0, 2**32 - 1),
    height=st.integers(0, 2**32 - 1),
    k=st.lists(st.floats(), min_size=9, max_size=9),
    d=st.lists(st.floats(), max_size=15),
    model=st.sampled_from(["plumb_bob", "rational_polynomial", "equidistant", "", "x"]),
    binning=st.integers(0, 2**32 - 1),
    roi=st.tuples(*[st.integers(0, 2**32 - 1)] * 4),
)
def test_no_camera_info_raises(
    width: int, height: int, k: list, d: list, model: str, binning: int, roi: tuple
) -> None:
    region = RegionOfInterest(x_offset=roi[0], y_offset=roi[1], width=roi[2], height=roi[3])
    msg = camera_info_of(
        width=width, height=height, k=k, d=d, distortion_model=model, binning_x=binning, roi=region
    )
    camera_info_key(msg)
    result = camera_from_info(msg)
    assert isinstance(result, Camera) or cause_of(result)


def fit_of(nadir: np.ndarray, altitude_m: float) -> HorizonFit:
    cov = np.zeros((4, 4))
    cov[:3, :3] = 1e-8 * (np.eye(3) - np.outer(nadir, nadir))
    cov[3, 3] = 1e4
    return HorizonFit(Status.OK, "", "ml", nadir, 1.2, altitude_m, cov)


@given(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.sampled_from(["up", "down"]))
def test_attitude_turns_nadir_onto_the_level_frames_z(
    roll: float, pitch: float, level_z: str
) -> None:
    nadir = nadir_from_roll_pitch(roll, pitch, level_z)
    msg = attitude_message(fit_of(nadir, 500e3), 5_000_000_007, level_z)
    assert msg.header.frame_id == "local_level"
    assert msg.header.stamp == Time(sec=5, nanosec=7)
    q = msg.pose.pose.orientation
    # The quaternion's own rotation formula, v + 2 u x (u x v + w v).
    u, w = np.array([q.x, q.y, q.z]), q.w
    turned = nadir + 2 * np.cross(u, np.cross(u, nadir) + w * nadir)
    sign = 1.0 if level_z == "down" else -1.0
    np.testing.assert_allclose(turned, [0, 0, sign], atol=1e-9)
    assert msg.pose.pose.position.z == -sign * 500e3
    covariance = np.array(msg.pose.covariance).reshape(6, 6)
    assert np.all(np.isfinite(covariance))
    np.testing.assert_allclose(np.diag(covariance)[2:5], [1e4, 1e-8, 1e-8], rtol=1e-6)
    assert covariance[5, 5] > 9
    rot = level_from_base(nadir, level_z)
    assert abs(np.arctan2(rot[1, 0], rot[0, 0])) < 1e-9


def test_local_vertical_points_to_the_planet() -> None:
    msg = local_vertical_message(fit_of(np.array([0.0, 0.6, -0.8]), 5e5), 1, "body")
    assert (msg.vector.x, msg.vector.y, msg.vector.z) == (0.0, 0.6, -0.8)
    assert msg.header.frame_id == "body"


def test_pictures_go_into_messages() -> None:
    bgr = np.random.default_rng(3).integers(0, 255, (5, 7, 3), dtype=np.uint8)
    msg = encoded_image(bgr, 9, "base_link")
    assert (msg.width, msg.height, msg.step, msg.encoding) == (7, 5, 21, "bgr8")
    np.testing.assert_array_equal(np.frombuffer(msg.data, np.uint8).reshape(bgr.shape), bgr)


def test_poses_and_twists_have_position_before_rotation() -> None:
    # 120 degrees about z, and a covariance whose entries say where they are.
    s = 0.75**0.5
    pose = np.array([[-0.5, -s, 0, 1], [s, -0.5, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]])
    rotation_first = np.add.outer(10 * np.arange(6), np.arange(6)).astype(float)
    rotation_first += rotation_first.T
    order = [3, 4, 5, 0, 1, 2]
    expected = rotation_first[np.ix_(order, order)].ravel()
    msg = pose_message(pose, rotation_first, 5_000_000_007, "tof")
    assert (msg.header.frame_id, msg.header.stamp.sec, msg.header.stamp.nanosec) == ("tof", 5, 7)
    place, turn = msg.pose.pose.position, msg.pose.pose.orientation
    assert (place.x, place.y, place.z) == (1.0, 2.0, 3.0)
    np.testing.assert_allclose([turn.x, turn.y, turn.z, turn.w], [0, 0, s, 0.5], atol=1e-12)
    np.testing.assert_array_equal(msg.pose.covariance, expected)
    moving = twist_message(np.arange(6.0), rotation_first, 5_000_000_007, "tof")
    linear, angular = moving.twist.twist.linear, moving.twist.twist.angular
    assert (angular.x, angular.y, angular.z) == (0.0, 1.0, 2.0)
    assert (linear.x, linear.y, linear.z) == (3.0, 4.0, 5.0)
    np.testing.assert_array_equal(moving.twist.covariance, expected)


@given(st.integers(0, 2**31 * 10**9 - 1))
def test_a_time_is_its_nanoseconds(stamp: int) -> None:
    assert ns_from_time(time_from_ns(stamp)) == stamp
