"""Images, calibrations, poses and rates to numpy, and estimates to messages; clouds are in
`point_cloud`.

Decoding is duck-typed: it takes rclpy's messages and those that `rosbags` reads alike. What cannot
be used comes back as a `Refusal`, never as an exception: a message is data.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from reprlib import Repr
from typing import Any

import cv2
import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import (
    PoseWithCovarianceStamped,
    TwistWithCovarianceStamped,
    Vector3Stamped,
)

from horizon_sensor_ros.core.cameras.byte_order import bytes_swapped
from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.core.fits.result import HorizonFit
from horizon_sensor_ros.core.mathematics.attitude import (
    level_from_base,
    nadir_sign,
    pose_covariance,
    quaternion_from_rotation,
    rotation_from_quaternion,
)
from horizon_sensor_ros.core.planet import Planet

LEVEL_FRAME = "local_level"
EARTH_FRAME = "earth"
NANOSECONDS = 1_000_000_000

# Encoding: bytes a channel, channels, OpenCV's conversion to gray. OpenCV names a Bayer pattern by
# its second row's second and third pixel, ROS by the first two of the first row.
ENCODINGS: dict[str, tuple[int, int, int | None]] = {
    "mono8": (1, 1, None),
    "mono16": (2, 1, None),
    "rgb8": (1, 3, cv2.COLOR_RGB2GRAY),
    "bgr8": (1, 3, cv2.COLOR_BGR2GRAY),
    "rgba8": (1, 4, cv2.COLOR_RGBA2GRAY),
    "bgra8": (1, 4, cv2.COLOR_BGRA2GRAY),
    "bayer_rggb8": (1, 1, cv2.COLOR_BayerBG2GRAY),
    "bayer_bggr8": (1, 1, cv2.COLOR_BayerRG2GRAY),
    "bayer_gbrg8": (1, 1, cv2.COLOR_BayerGR2GRAY),
    "bayer_grbg8": (1, 1, cv2.COLOR_BayerGB2GRAY),
    "bayer_rggb16": (2, 1, cv2.COLOR_BayerBG2GRAY),
    "bayer_bggr16": (2, 1, cv2.COLOR_BayerRG2GRAY),
    "bayer_gbrg16": (2, 1, cv2.COLOR_BayerGR2GRAY),
    "bayer_grbg16": (2, 1, cv2.COLOR_BayerGB2GRAY),
}

_KNOWN_ENCODINGS = f"{', '.join(e for e in ENCODINGS if 'bayer' not in e)} and Bayer's"

_FARTHEST_M = 1e12  # of a coarse pose
_FOCAL_OF_SIZE = (0.02, 1e4)  # over the frame's width and height: from 177 deg across to 20 arcsec
_FARTHEST_OFF_AXIS = 60.0  # focal lengths from the axis to the frame's middle: 89 deg
_MAX_BEND = 4.0  # of angles off the axis by a lens; a fisheye as plumb_bob has less than 2
# Of a frame's pixels with a ray. A whole fisheye's circle, half as high as a 16:9 frame, has 0.11.
_LEAST_SEEING = 0.1
_SAMPLED = 17  # pixels across and down a frame, its edges among them
_FASTEST_RAD_S = 100.0  # of an angular rate; no gyro measures more

# OpenCV's demosaicing needs a neighbour on each side; a smaller frame shows no limb anyway.
_MIN_BAYER_SIZE = 4


@dataclass(frozen=True)
class Refusal:
    """Why a message is not used: `cause`, a word to count by, and `reason`, for a person."""

    cause: str
    reason: str


# ---------------------------------------------------------------------------- messages to numpy


def stamp_ns(msg: Any) -> int | Refusal:
    """Nanoseconds of a message's header stamp."""
    sec, nanosec = int(msg.header.stamp.sec), int(msg.header.stamp.nanosec)
    if not 0 <= nanosec < NANOSECONDS:
        return Refusal("bad_stamp", f"stamp has {nanosec} nanoseconds")
    return sec * NANOSECONDS + nanosec


def repeated_stamp(stamp: int) -> Refusal:
    """Why a message with the stamp of the one before is not used."""
    why = "stamp repeats the last one's"
    if stamp == 0:
        why += ": it is zero, so nobody sets it"
    return Refusal("repeated_stamp", why)


def gray_from_image(msg: Any) -> np.ndarray | Refusal:
    """Gray levels (height, width), uint8 or uint16, C-contiguous, of a `sensor_msgs/Image`.

    Without row padding mono8 and native mono16 are views of the message's data, not copies.
    Colour and Bayer patterns are converted to gray.
    """
    encoding = str(msg.encoding)
    if encoding not in ENCODINGS:
        return Refusal(
            "unknown_encoding",
            f"unknown encoding {quoted(encoding)}; known are {_KNOWN_ENCODINGS}",
        )
    item_size, channels, to_gray = ENCODINGS[encoding]
    width, height, step = int(msg.width), int(msg.height), int(msg.step)
    if width <= 0 or height <= 0:
        return Refusal("zero_size", f"image of {width} x {height} pixels")
    row_size = width * channels * item_size
    if step < row_size:
        return Refusal(
            "wrong_step", f"step is {step} bytes, a row of {width} {encoding} pixels has {row_size}"
        )
    try:
        data = np.frombuffer(msg.data, dtype=np.uint8)
    except (TypeError, ValueError, BufferError) as error:
        return Refusal("bad_data", f"image data is not bytes: {error}")
    if data.size < step * height:
        return Refusal(
            "truncated_data",
            f"image data has {data.size} bytes, step x height is {step * height}",
        )
    if data.size > step * height:
        return Refusal(
            "wrong_step", f"image data has {data.size} bytes, step x height is {step * height}"
        )
    rows = data.reshape(height, step)[:, :row_size]
    if item_size == 2:
        rows = np.ascontiguousarray(rows).view(">u2" if msg.is_bigendian else "<u2")
        rows = np.require(rows, dtype=np.uint16, requirements="A")
        if bytes_swapped(rows):
            told = "the most" if msg.is_bigendian else "the least"
            return Refusal(
                "swapped_bytes",
                f"is_bigendian says {told} significant byte comes first, by its pixels the other "
                "one does",
            )
    if to_gray is None:
        return np.ascontiguousarray(rows)
    if channels == 1 and min(width, height) < _MIN_BAYER_SIZE:
        return Refusal("too_small", f"Bayer image of {width} x {height} pixels")
    shape = (height, width, channels) if channels > 1 else (height, width)
    return cv2.cvtColor(np.ascontiguousarray(rows).reshape(shape), to_gray)


def camera_info_key(msg: Any) -> tuple[Any, ...]:
    """Return everything in a `sensor_msgs/CameraInfo` that the camera depends on, to compare by."""
    roi = msg.roi
    return (
        *(msg.width, msg.height, str(msg.distortion_model), msg.binning_x, msg.binning_y),
        *(roi.x_offset, roi.y_offset, roi.width, roi.height),
        np.asarray(msg.k, dtype=float).tobytes(),
        np.asarray(msg.d, dtype=float).tobytes(),
    )


def camera_from_info(msg: Any) -> Camera | Refusal:
    """Camera of the delivered image (region of interest and binning applied) of a `CameraInfo`."""
    k = np.asarray(msg.k, dtype=float).ravel()
    d = np.asarray(msg.d, dtype=float).ravel()
    if not (np.all(np.isfinite(k)) and np.all(np.isfinite(d))):
        return Refusal("bad_camera_info", "camera_info is not finite")
    if k.size and k[0] == 0:
        return Refusal("uncalibrated", "camera_info is uncalibrated (K[0] == 0)")
    roi = (msg.roi.x_offset, msg.roi.y_offset, msg.roi.width, msg.roi.height)
    model = str(msg.distortion_model)
    try:
        camera = Camera.from_calibration(
            msg.width, msg.height, k, model, d, msg.binning_x, msg.binning_y, roi
        )
    except ValueError as error:
        return Refusal("bad_camera_info", f"camera_info: {error}")
    implausible = _implausible(camera)
    return camera if implausible is None else Refusal("bad_camera_info", implausible)


def _implausible(camera: Camera) -> str | None:
    """Why no lens is like that camera; None for one that may be."""
    for focal, centre, size in (
        (camera.fx, camera.cx, camera.width),
        (camera.fy, camera.cy, camera.height),
    ):
        if not _FOCAL_OF_SIZE[0] <= focal / size <= _FOCAL_OF_SIZE[1]:
            return f"camera_info: no lens has a focal length of {focal:.3g} px for {size} px"
        if abs(centre - 0.5 * (size - 1)) > _FARTHEST_OFF_AXIS * focal:
            return f"camera_info: no lens has its axis at {centre:.3g} px of {size} px"
    try:
        with np.errstate(all="ignore"):
            seeing, bend = _seeing_and_bend(camera)
    except (ValueError, ArithmeticError, np.linalg.LinAlgError):
        # Coefficients near the largest number overflow on the way to the polynomials' roots.
        return "camera_info: no lens has such distortion coefficients"
    if bend > _MAX_BEND:
        return "camera_info: no lens has such distortion coefficients"
    if seeing < _LEAST_SEEING:
        return f"camera_info: with such distortion {1 - seeing:.0%} of the pixels have no ray"
    return None


def _seeing_and_bend(camera: Camera) -> tuple[float, float]:
    """Which share of the frame's pixels has a ray, and by which factor distortion changes their
    angles off the axis, at worst.
    """
    x, y = (np.linspace(0, size - 1, _SAMPLED) for size in (camera.width, camera.height))
    px = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    straight = replace(camera, distortion=())
    rays = camera.rays(px)
    ratio = _off_axis(rays) / _off_axis(straight.rays(px))
    ratio = ratio[np.isfinite(ratio) & (ratio > 0)]
    bend = float(np.max(np.maximum(ratio, 1 / ratio), initial=1.0))
    return float(np.mean(np.isfinite(rays).all(axis=1))), bend


def _off_axis(rays: np.ndarray) -> np.ndarray:
    return np.arctan2(np.hypot(rays[:, 0], rays[:, 1]), rays[:, 2])


def coarse_pose_from_message(msg: Any, planet: Planet) -> tuple[np.ndarray, np.ndarray] | Refusal:
    """Position (3,), m, and rot_ecef_from_base (3, 3) of a `PoseStamped` in the frame `earth`."""
    frame = str(msg.header.frame_id)
    if frame != EARTH_FRAME:
        return Refusal("wrong_frame", f"header frame is {quoted(frame)}, not '{EARTH_FRAME}'")
    p, q = msg.pose.position, msg.pose.orientation
    position = np.array([p.x, p.y, p.z], dtype=float)
    if not np.all(np.isfinite(position)):
        return Refusal("not_finite", "position is not finite")
    distance = math.hypot(*position)
    far_km = f"position is {distance / 1e3:.0f} km from the planet's centre"
    if distance < planet.polar_radius_m:
        return Refusal("inside_planet", far_km)
    if distance > _FARTHEST_M:
        return Refusal("too_far", far_km)
    try:
        return position, rotation_from_quaternion(np.array([q.x, q.y, q.z, q.w]))
    except ValueError as error:
        return Refusal("bad_orientation", str(error))


def rate_from_imu(msg: Any, base_frame: str) -> np.ndarray | Refusal:
    """Angular rate (3,), rad/s, of a `sensor_msgs/Imu` in the base frame."""
    frame = str(msg.header.frame_id)
    if frame != base_frame:
        return Refusal("wrong_frame", f"header frame is {quoted(frame)}, not {quoted(base_frame)}")
    rate = np.array([msg.angular_velocity.x, msg.angular_velocity.y, msg.angular_velocity.z])
    if not np.all(np.isfinite(rate)):
        return Refusal("not_finite", "angular velocity is not finite")
    if math.hypot(*rate) > _FASTEST_RAD_S:
        return Refusal("too_fast", f"angular velocity is {math.hypot(*rate):.3g} rad/s")
    if float(msg.angular_velocity_covariance[0]) == -1.0:
        return Refusal("no_rate", "angular_velocity_covariance[0] is -1: there is no rate")
    return rate


def quoted(text: str, most: int = 60) -> str:
    """Foreign text in quotes, printable, its middle left out beyond `most` characters."""
    short = Repr()
    short.maxstring = most
    return short.repr(text)


# ---------------------------------------------------------------------------- numpy to messages


def time_from_ns(stamp: int) -> Time:
    """Message of nanoseconds."""
    return Time(sec=stamp // NANOSECONDS, nanosec=stamp % NANOSECONDS)


def local_vertical_message(fit: HorizonFit, stamp: int, base_frame: str) -> Vector3Stamped:
    """Nadir: unit vector towards the planet in the base frame. `fit` has to be OK."""
    msg = Vector3Stamped()
    msg.header.stamp = time_from_ns(stamp)
    msg.header.frame_id = base_frame
    msg.vector.x, msg.vector.y, msg.vector.z = (float(v) for v in fit.nadir_base)
    return msg


def attitude_message(fit: HorizonFit, stamp: int, level_z: str) -> PoseWithCovarianceStamped:
    """Return the base frame's pose in the level frame: orientation (yaw 0), altitude in position.z.

    `fit` has to be OK. Covariance as in `core.mathematics.attitude.pose_covariance`.
    """
    rot_level_from_base = level_from_base(fit.nadir_base, level_z)
    msg = PoseWithCovarianceStamped()
    msg.header.stamp = time_from_ns(stamp)
    msg.header.frame_id = LEVEL_FRAME
    pose = msg.pose.pose
    pose.position.z = float(-nadir_sign(level_z) * fit.altitude_m)
    q = quaternion_from_rotation(rot_level_from_base)
    pose.orientation.x, pose.orientation.y, pose.orientation.z, pose.orientation.w = map(float, q)
    msg.pose.covariance = pose_covariance(
        fit.cov_nadir_altitude, rot_level_from_base, level_z
    ).ravel()
    return msg


def pose_message(
    pose: np.ndarray, covariance: np.ndarray, stamp: int, frame_id: str
) -> PoseWithCovarianceStamped:
    """Message of a pose (4, 4) in a frame.

    covariance : (6, 6) of (small rotations about that frame's axes, position), rad and m. The
    message has the position first.
    """
    msg = PoseWithCovarianceStamped()
    msg.header.stamp = time_from_ns(stamp)
    msg.header.frame_id = frame_id
    position, orientation = msg.pose.pose.position, msg.pose.pose.orientation
    position.x, position.y, position.z = map(float, pose[:3, 3])
    q = quaternion_from_rotation(pose[:3, :3])
    orientation.x, orientation.y, orientation.z, orientation.w = map(float, q)
    msg.pose.covariance = _position_first(covariance)
    return msg


def twist_message(
    twist: np.ndarray, covariance: np.ndarray, stamp: int, frame_id: str
) -> TwistWithCovarianceStamped:
    """Message of a velocity (6,), rotation (rad/s) before translation (m/s), in a frame.

    covariance : (6, 6) in the same order. The message has the translation first.
    """
    msg = TwistWithCovarianceStamped()
    msg.header.stamp = time_from_ns(stamp)
    msg.header.frame_id = frame_id
    linear, angular = msg.twist.twist.linear, msg.twist.twist.angular
    angular.x, angular.y, angular.z, linear.x, linear.y, linear.z = map(float, twist)
    msg.twist.covariance = _position_first(covariance)
    return msg


def _position_first(covariance: np.ndarray) -> np.ndarray:
    return np.roll(covariance, (3, 3), axis=(0, 1)).ravel()
