"""The demo's sensors as messages: images, their calibration, point clouds."""

from __future__ import annotations

import array

import numpy as np
from sensor_msgs.msg import CameraInfo, Image, PointCloud2, PointField

from horizon_sensor_ros.core.camera import Camera
from horizon_sensor_ros.ros.messages import time_from_ns

RANGE_CAMERA = "tof"


def optical_frame(sensor: str) -> str:
    """Name of a sensor's frame."""
    return f"{sensor}_optical"


def gray_message(gray: np.ndarray, stamp: int, sensor: str) -> Image:
    """Message of an image (H, W) uint8."""
    msg = Image()
    msg.header.stamp = time_from_ns(stamp)
    msg.header.frame_id = optical_frame(sensor)
    msg.height, msg.width = gray.shape
    msg.encoding, msg.step = "mono8", gray.shape[1]
    msg.data = _in_one_piece(gray)
    return msg


def cloud_message(points: np.ndarray, stamp: int) -> PointCloud2:
    """Message of an organised cloud (H, W, 3) float32; NaN where nothing came back."""
    msg = PointCloud2()
    msg.header.stamp = time_from_ns(stamp)
    msg.header.frame_id = optical_frame(RANGE_CAMERA)
    msg.height, msg.width = points.shape[:2]
    msg.fields = [
        PointField(name=name, offset=4 * i, datatype=PointField.FLOAT32, count=1)
        for i, name in enumerate("xyz")
    ]
    msg.point_step, msg.row_step = 12, 12 * msg.width
    msg.data = _in_one_piece(points.astype("<f4", copy=False))
    return msg


def camera_info_message(camera: Camera, stamp: int, sensor: str) -> CameraInfo:
    """Message of a camera's calibration."""
    msg = CameraInfo()
    msg.header.stamp = time_from_ns(stamp)
    msg.header.frame_id = optical_frame(sensor)
    msg.width, msg.height = camera.width, camera.height
    msg.distortion_model = camera.model
    msg.d = [float(c) for c in camera.distortion]
    msg.k = [camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0]
    msg.r = np.eye(3).ravel().tolist()
    msg.p = [
        *(camera.fx, 0.0, camera.cx, 0.0),
        *(0.0, camera.fy, camera.cy, 0.0),
        *(0.0, 0.0, 1.0, 0.0),
    ]
    return msg


def _in_one_piece(values: np.ndarray) -> array.array[int]:
    # An array goes into a message as a whole; a list element by element.
    return array.array("B", np.ascontiguousarray(values).tobytes())
