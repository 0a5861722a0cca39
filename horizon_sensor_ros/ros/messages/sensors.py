"""Numpy to the messages that sensors send: images, camera calibrations, point clouds."""

from __future__ import annotations

from typing import Any

import numpy as np
from sensor_msgs.msg import CameraInfo, Image, PointCloud2, PointField

from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.ros.messages.stamps import time_from_ns

# Channels and type of an array to the name that sensor_msgs has for it.
_ENCODINGS = {
    (1, np.dtype(np.uint8)): "mono8",
    (1, np.dtype(np.uint16)): "mono16",
    (3, np.dtype(np.uint8)): "bgr8",
    (4, np.dtype(np.uint8)): "bgra8",
}


def encoded_image(pixels: np.ndarray, stamp: int, frame_id: str) -> Image:
    """Image message of (height, width) uint8 or uint16 gray levels, or (height, width, 3 or 4)
    uint8 colours, blue first. Raises ValueError for any other array.
    """
    channels = pixels.shape[2] if pixels.ndim == 3 else 1
    encoding = _ENCODINGS.get((channels, pixels.dtype)) if pixels.ndim in (2, 3) else None
    if encoding is None:
        raise ValueError(f"no encoding for pixels of shape {pixels.shape}, {pixels.dtype}")
    msg = Image()
    _stamped(msg, stamp, frame_id)
    msg.height, msg.width = pixels.shape[:2]
    msg.encoding = encoding
    msg.step = pixels.shape[1] * channels * pixels.itemsize
    little = np.ascontiguousarray(pixels, pixels.dtype.newbyteorder("<"))
    # Bytes go into the message in one piece; anything else element by element.
    msg.data.frombytes(little.tobytes())
    return msg


def camera_info_message(camera: Camera, stamp: int, frame_id: str) -> CameraInfo:
    """Calibration of a camera whose images are delivered whole, neither cropped nor binned."""
    msg = CameraInfo()
    _stamped(msg, stamp, frame_id)
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


def cloud_message(points: np.ndarray, stamp: int, frame_id: str) -> PointCloud2:
    """Cloud of (H, W, 3) organised or (N, 3) points, m, as float32; points may be NaN. Raises
    ValueError for another shape.
    """
    rows = points[None] if points.ndim == 2 else points
    if rows.ndim != 3 or rows.shape[2] != 3:
        raise ValueError(f"points must be (N, 3) or (H, W, 3), got shape {points.shape}")
    msg = PointCloud2()
    _stamped(msg, stamp, frame_id)
    msg.height, msg.width = rows.shape[:2]
    msg.fields = [
        PointField(name=name, offset=4 * i, datatype=PointField.FLOAT32, count=1)
        for i, name in enumerate("xyz")
    ]
    msg.point_step, msg.row_step = 12, 12 * rows.shape[1]
    msg.is_dense = bool(np.isfinite(rows).all())
    msg.data.frombytes(np.ascontiguousarray(rows, "<f4").tobytes())
    return msg


def _stamped(msg: Any, stamp: int, frame_id: str) -> None:
    msg.header.stamp = time_from_ns(stamp)
    msg.header.frame_id = frame_id
