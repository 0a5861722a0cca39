"""Calibrations to cameras, where a lens may be like that."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from horizon_sensor_ros.core.cameras.camera import Camera
from horizon_sensor_ros.ros.messages.refusal import Refusal

_FOCAL_OF_SIZE = (0.02, 1e4)  # over the frame's width and height: from 177 deg across to 20 arcsec
_FARTHEST_OFF_AXIS = 60.0  # focal lengths from the axis to the frame's middle: 89 deg
_MAX_BEND = 4.0  # of angles off the axis by a lens; a fisheye as plumb_bob has less than 2
# Of a frame's pixels with a ray. A whole fisheye's circle, half as high as a 16:9 frame, has 0.11.
_LEAST_SEEING = 0.1
_SAMPLED = 17  # pixels across and down a frame, its edges among them


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
