"""A horizon drawn from its equation, and the messages and bags made of it."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped
from rclpy.serialization import serialize_message
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from scipy.special import ndtr
from sensor_msgs.msg import CameraInfo, Image, Imu

from horizon_sensor_ros.core.mathematics.attitude import (
    nadir_from_roll_pitch,
    quaternion_from_rotation,
)

WIDTH, HEIGHT, FOCAL_PX = 320, 240, 260.0
PSF_PX = 0.757  # of the optics, 0.7, and of a pixel's width
RADIUS_M = 6371000.0
ALTITUDE_M = 500e3
RHO_RAD = float(np.arcsin(RADIUS_M / (RADIUS_M + ALTITUDE_M)))
PERIOD_NS = 100_000_000
START_NS = 1_700_000_000_000_000_000
CAMERAS = ("camera_1", "camera_2")
TYPESTORE = get_typestore(Stores.ROS2_JAZZY)


def _rotation(axis: np.ndarray) -> np.ndarray:
    """Optical to base frame (x forward, y left, z up), the image's y axis as far down as can be."""
    z = axis / np.linalg.norm(axis)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


# Two cameras to the front and to the left, tilted so that a level craft's horizon is in the middle.
_DOWN = -np.cos(RHO_RAD)
_OUT = np.sin(RHO_RAD)
ROTATIONS = {
    "camera_1": _rotation(np.array([_OUT, 0.0, _DOWN])),
    "camera_2": _rotation(np.array([0.0, _OUT, _DOWN])),
}
QUATERNIONS = {
    name: [float(v) for v in quaternion_from_rotation(rot)] for name, rot in ROTATIONS.items()
}
PARAMETERS = {f"{name}.rotation": q for name, q in QUATERNIONS.items()}


def nadir_of(roll_deg: float, pitch_deg: float) -> np.ndarray:
    return nadir_from_roll_pitch(np.radians(roll_deg), np.radians(pitch_deg), "up")


def horizon_gray(camera: str, nadir_base: np.ndarray, seed: int = 0) -> np.ndarray:
    """Frame (HEIGHT, WIDTH) uint8 of an evenly lit planet seen by an ideal camera."""
    x, y = np.meshgrid(
        (np.arange(WIDTH) - (WIDTH - 1) / 2) / FOCAL_PX,
        (np.arange(HEIGHT) - (HEIGHT - 1) / 2) / FOCAL_PX,
    )
    rays = np.stack([x, y, np.ones_like(x)], axis=-1)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    inside_rad = RHO_RAD - np.arccos(np.clip(rays @ ROTATIONS[camera].T @ nadir_base, -1, 1))
    # The optics blur before the pixels sample: what is blurred afterwards repeats errors with the
    # limb's place in its pixels.
    down, right = np.gradient(inside_rad)
    inside_px = inside_rad / np.maximum(np.hypot(down, right), 1e-9)
    light = 5.0 + 175.0 * ndtr(inside_px / PSF_PX)
    noise = np.random.default_rng(seed).normal(0.0, 1.0, light.shape)
    return np.clip(np.rint(light + noise), 0, 255).astype(np.uint8)


def image_of(gray: np.ndarray, stamp: int, camera: str = "camera_1", **fields: Any) -> Image:
    msg = Image()
    msg.header.frame_id = f"{camera}_optical"
    msg.header.stamp.sec, msg.header.stamp.nanosec = divmod(stamp, 1_000_000_000)
    msg.height, msg.width = gray.shape
    msg.encoding = "mono8" if gray.dtype == np.uint8 else "mono16"
    msg.step = gray.shape[1] * gray.itemsize
    msg.data.frombytes(gray.tobytes())
    for name, value in fields.items():
        setattr(msg, name, value)
    return msg


def camera_info_of(stamp: int = 0, camera: str = "camera_1", **fields: Any) -> CameraInfo:
    msg = CameraInfo()
    msg.header.frame_id = f"{camera}_optical"
    msg.header.stamp.sec, msg.header.stamp.nanosec = divmod(stamp, 1_000_000_000)
    msg.width, msg.height = WIDTH, HEIGHT
    msg.distortion_model = "plumb_bob"
    msg.d = [0.0] * 5
    msg.k = [FOCAL_PX, 0.0, (WIDTH - 1) / 2, 0.0, FOCAL_PX, (HEIGHT - 1) / 2, 0.0, 0.0, 1.0]
    for name, value in fields.items():
        setattr(msg, name, value)
    return msg


def coarse_pose_of(
    stamp: int, position: np.ndarray, rot_ecef_from_base: np.ndarray, frame_id: str = "earth"
) -> PoseStamped:
    msg = PoseStamped()
    msg.header.frame_id = frame_id
    msg.header.stamp.sec, msg.header.stamp.nanosec = divmod(stamp, 1_000_000_000)
    p, q = msg.pose.position, msg.pose.orientation
    p.x, p.y, p.z = map(float, position)
    q.x, q.y, q.z, q.w = map(float, quaternion_from_rotation(rot_ecef_from_base))
    return msg


def imu_of(stamp: int, rate: Iterable[float], frame_id: str = "base_link") -> Imu:
    msg = Imu()
    msg.header.frame_id = frame_id
    msg.header.stamp.sec, msg.header.stamp.nanosec = divmod(stamp, 1_000_000_000)
    w = msg.angular_velocity
    w.x, w.y, w.z = map(float, rate)
    return msg


def attitude_at(index: int) -> tuple[float, float]:
    """Roll and pitch, degrees, of the n-th pair of `recording`."""
    return 4.0 * np.sin(0.7 * index), 3.0 * np.cos(0.9 * index)


def recording(pairs: int, start: int = START_NS) -> list[tuple[str, int, Any]]:
    """Topic, time and message of a flight: camera_info before each image, both cameras."""
    messages = []
    for index in range(pairs):
        stamp = start + index * PERIOD_NS
        nadir = nadir_of(*attitude_at(index))
        for delay, camera in enumerate(CAMERAS):
            time = stamp + delay * 1_000_000
            gray = horizon_gray(camera, nadir, seed=2 * index + delay)
            messages.append((f"/{camera}/camera_info", time, camera_info_of(stamp, camera)))
            messages.append((f"/{camera}/image_raw", time + 500_000, image_of(gray, stamp, camera)))
    return messages


def type_name(msg: Any) -> str:
    return f"{type(msg).__module__.split('.')[0]}/msg/{type(msg).__name__}"


def write_bag(path: Path, messages: Iterable[tuple[str, int, Any]], storage: str = "mcap") -> Path:
    """Bag of messages, or of (type name, bytes) where a message is to be as it is."""
    plugin = {"mcap": StoragePlugin.MCAP, "sqlite3": StoragePlugin.SQLITE3}[storage]
    with Writer(path, version=9, storage_plugin=plugin) as writer:
        connections = {}
        for topic, time, msg in messages:
            kind, raw = msg if isinstance(msg, tuple) else (type_name(msg), serialize_message(msg))
            if topic not in connections:
                known = kind in TYPESTORE.fielddefs
                how = {"typestore": TYPESTORE} if known else {"msgdef": "int8 a", "rihs01": "-"}
                connections[topic] = writer.add_connection(topic, kind, **how)
            writer.write(connections[topic], time, raw)
    return path


def write_parameters(path: Path, **others: Any) -> Path:
    """Parameter file with both cameras' rotations."""
    lines = ["/**:", "  ros__parameters:"]
    lines += [f"    {name}: {value}" for name, value in {**PARAMETERS, **others}.items()]
    path.write_text("\n".join(lines) + "\n")
    return path
