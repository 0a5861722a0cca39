"""The demo's flight as a bag: sensors' topics, truth and what the nodes published."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from rosbags.rosbag2 import StoragePlugin

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.core.mathematics.attitude import quaternion_from_rotation
from horizon_sensor_ros.tools.bags.output_bag import OutputBag, check_own
from horizon_sensor_ros.tools.command_errors import CommandError
from horizon_sensor_ros.tools.demo.link import (
    DIAGNOSTICS_TOPIC,
    OUTPUT_TOPICS,
    RANGE_CAMERA_FRAME,
    input_topics,
)
from horizon_sensor_ros.tools.truth.topics import (
    TRUE_ATTITUDE,
    TRUE_LOCAL_VERTICAL,
    TRUE_TARGET_POSE,
    TRUTH_TOPICS,
    true_attitude_message,
    true_pose_message,
    true_vertical_message,
)

_BASE_FRAME = "base_link"


class DemoBag:
    """A bag (mcap) that is there only when the flight went well. It replaces the bag of an earlier
    flight; raises CommandError, first and last, where something else is in its place.

    Recorded, as by `ros2 bag record`, under the wall clock's time; stamps are the messages' own.
    """

    def __init__(self, path: Path, views: Sequence[CameraView], level_z: str) -> None:
        self._level_z = level_z
        self._path = path
        check_own(path)
        self._bag = OutputBag(path, StoragePlugin.MCAP)
        topics = {**input_topics([view.name for view in views]), **TRUTH_TOPICS, **OUTPUT_TOPICS}
        topics[DIAGNOSTICS_TOPIC] = DiagnosticArray
        for topic, kind in topics.items():
            self._bag.add_topic(_absolute(topic), kind)

    def __enter__(self) -> DemoBag:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is not None:
            self._bag.discard()
            return
        try:
            check_own(self._path)
            self._bag.finish()
        except CommandError:
            self._bag.discard()
            raise

    def record(self, topic: str, msg: Any) -> None:
        """Take a message that was sent or heard just now."""
        self._bag.write(_absolute(topic), time.time_ns(), msg)

    def record_truth(
        self, stamp: int, nadir_base: np.ndarray, altitude_m: float, pose_tof_from_body: np.ndarray
    ) -> None:
        """Take what is true at a stamp."""
        vertical = true_vertical_message(nadir_base, stamp, _BASE_FRAME)
        attitude = true_attitude_message(nadir_base, altitude_m, stamp, self._level_z)
        self.record(TRUE_LOCAL_VERTICAL, vertical)
        self.record(TRUE_ATTITUDE, attitude)
        target = true_pose_message(pose_tof_from_body, stamp, RANGE_CAMERA_FRAME)
        self.record(TRUE_TARGET_POSE, target)


def write_parameters(path: Path, views: Sequence[CameraView], level_z: str) -> None:
    """Write the nodes' parameter file, with which the bag can also be replayed."""
    values: dict[str, Any] = {"level_z": level_z, "cameras": [view.name for view in views]}
    for view in views:
        rotation = quaternion_from_rotation(view.rot_base_from_cam).tolist()
        values[view.name] = {"rotation": rotation}
    path.write_text(yaml.safe_dump({"/**": {"ros__parameters": values}}), encoding="utf-8")


def _absolute(topic: str) -> str:
    return topic if topic.startswith("/") else f"/{topic}"
