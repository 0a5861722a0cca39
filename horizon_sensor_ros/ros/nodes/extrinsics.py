"""The cameras' rotations from TF, where tf2 is installed.

tf2_ros is part of a ROS installation but cannot be had from PyPI, hence the import on demand.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from horizon_sensor_ros.ros.messages.geometry import rotation_of
from horizon_sensor_ros.ros.messages.refusal import Refusal, quoted
from horizon_sensor_ros.ros.parameters.parameter import ParameterError


class TfExtrinsics:
    """Looks up, for each image, the latest rotation from its frame_id to the base frame.

    A transform that is missing is a refusal, never identity. Raises ParameterError when tf2_ros
    cannot be imported.
    """

    def __init__(self, node: Any, base_frame: str) -> None:
        try:
            import tf2_ros  # noqa: PLC0415 - only where it is asked for
            from rclpy.time import Time  # noqa: PLC0415
        except ImportError as error:
            raise ParameterError(
                "extrinsics_source is tf, but tf2_ros is not installed here "
                f"({error}); use extrinsics_source: parameters"
            ) from None
        self._base_frame = base_frame
        self._latest = Time()
        self._buffer = tf2_ros.Buffer()
        self._listener = tf2_ros.TransformListener(self._buffer, node)
        self._errors = tf2_ros.TransformException

    def close(self) -> None:
        """Listen no more: the node would keep the subscriptions."""
        self._listener.unregister()

    def __call__(self, camera: str, frame_id: str) -> np.ndarray | Refusal:
        """Rotation (3, 3) of vectors from the images' frame to the base frame."""
        if not frame_id:
            return Refusal("no_extrinsics", f"images of {camera} have no frame_id to look up in TF")
        try:
            transform = self._buffer.lookup_transform(self._base_frame, frame_id, self._latest)
        except self._errors as error:
            return Refusal("no_extrinsics", f"no transform for {camera}: {quoted(str(error), 200)}")
        try:
            return rotation_of(transform.transform.rotation)
        except ValueError as error:
            return Refusal("no_extrinsics", f"transform for {camera}: {error}")
