"""The demo's end of the ROS graph: publishes the sensors, collects what the nodes answer."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped, Vector3Stamped
from lifecycle_msgs.msg import State
from lifecycle_msgs.srv import GetState
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import CameraInfo, Image, PointCloud2

from horizon_sensor_ros.core.cameras.camera_view import CameraView
from horizon_sensor_ros.ros.messages.sensors import (
    camera_info_message,
    cloud_message,
    encoded_image,
)
from horizon_sensor_ros.ros.messages.stamps import ns_from_time
from horizon_sensor_ros.ros.pipelines.target_pipeline import CLOUD_TOPIC, TARGET_TOPICS
from horizon_sensor_ros.ros.process.participant_end import on_one_core
from horizon_sensor_ros.tools.demo.failures import LinkTimeoutError

VERTICAL_TOPIC, ATTITUDE_TOPIC = "local_vertical", "attitude"
DIAGNOSTICS_TOPIC = "/diagnostics"
# What the nodes publish.
OUTPUT_TOPICS: dict[str, type] = {
    VERTICAL_TOPIC: Vector3Stamped,
    ATTITUDE_TOPIC: PoseWithCovarianceStamped,
    **TARGET_TOPICS,
}
# Frame of the clouds.
RANGE_CAMERA_FRAME = "tof_optical"
_PATIENCE_S = 30.0  # with nodes that come up


def input_topics(cameras: Sequence[str]) -> dict[str, type]:
    """Topics of the sensors and their types."""
    kinds = {"image_raw": Image, "camera_info": CameraInfo}
    topics: dict[str, type] = {f"{c}/{name}": kinds[name] for c in cameras for name in kinds}
    return {**topics, CLOUD_TOPIC: PointCloud2}


@dataclass
class Answers:
    """What the nodes published.

    messages, heard_ns : by topic and by the input's stamp (ns), the message and the wall clock at
    its arrival. diagnostics : the latest values by the status's name.
    """

    messages: dict[str, dict[int, Any]] = field(
        default_factory=lambda: {topic: {} for topic in OUTPUT_TOPICS}
    )
    heard_ns: dict[str, dict[int, int]] = field(
        default_factory=lambda: {topic: {} for topic in OUTPUT_TOPICS}
    )
    diagnostics: dict[str, dict[str, str]] = field(default_factory=dict)


class DemoLink:
    """Publishers of the sensors' topics and subscribers of the nodes' outputs, in one context.

    listeners : by topic, how many nodes listen to it. record : told topic and message of all that
    is published and heard.
    """

    def __init__(
        self,
        domain: int,
        views: Sequence[CameraView],
        listeners: Mapping[str, int],
        record: Callable[[str, Any], None],
    ) -> None:
        self.answers = Answers()
        self._views = tuple(views)
        self._listeners = listeners
        self._record = record
        self._context = rclpy.Context()
        # The demo handles signals itself, as it has child processes to end, and its command line.
        rclpy.init(
            args=[],
            context=self._context,
            domain_id=domain,
            signal_handler_options=SignalHandlerOptions.NO,
        )
        self._node = rclpy.create_node("horizon_demo", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._inputs = {
            topic: self._node.create_publisher(kind, topic, qos_profile_sensor_data)
            for topic, kind in input_topics([view.name for view in self._views]).items()
        }
        reliable = QoSProfile(depth=50)
        self._outputs = [
            self._node.create_subscription(kind, topic, partial(self._hear, topic), reliable)
            for topic, kind in OUTPUT_TOPICS.items()
        ]
        self._node.create_subscription(
            DiagnosticArray, DIAGNOSTICS_TOPIC, self._hear_diagnostics, reliable
        )

    def __enter__(self) -> DemoLink:
        return self

    def __exit__(self, *_: object) -> None:
        self._executor.shutdown()
        with on_one_core():
            self._node.destroy_node()
        rclpy.shutdown(context=self._context)

    def wait_for_nodes(self, names: Sequence[str], check: Callable[[], None]) -> None:
        """Return when all nodes are active and connected both ways.

        check is called again and again, and may raise. LinkTimeoutError says what is missing.
        """
        deadline = time.monotonic() + _PATIENCE_S
        for name in names:
            client = self._node.create_client(GetState, f"/{name}/get_state")
            while not self._is_active(client):
                check()
                if time.monotonic() > deadline:
                    raise LinkTimeoutError(f"{name} did not become active within {_PATIENCE_S:g} s")
        while not self._connected():
            check()
            self.spin(0.05)
            if time.monotonic() > deadline:
                raise LinkTimeoutError(f"the topics did not connect within {_PATIENCE_S:g} s")
        # Both sides of a match learn of it one after the other; a best-effort image sent in
        # between is lost. CameraInfo, small and repeated, may go ahead.
        for _ in range(5):
            now = self._node.get_clock().now().nanoseconds
            for view in self._views:
                info = camera_info_message(view.camera, now, _frame(view))
                self._inputs[f"{view.name}/camera_info"].publish(info)
            self.spin(0.1)

    def publish(self, stamp: int, images: Sequence[np.ndarray], points: np.ndarray) -> None:
        """Publish one moment: images (H, W) uint8, one a view, with CameraInfo; the cloud."""
        messages: list[tuple[str, Any]] = []
        for view, image in zip(self._views, images, strict=True):
            info = camera_info_message(view.camera, stamp, _frame(view))
            messages.append((f"{view.name}/camera_info", info))
            messages.append((f"{view.name}/image_raw", encoded_image(image, stamp, _frame(view))))
        messages.append((CLOUD_TOPIC, cloud_message(points, stamp, RANGE_CAMERA_FRAME)))
        for topic, msg in messages:
            self._inputs[topic].publish(msg)
        for topic, msg in messages:
            self._record(topic, msg)

    def spin(self, duration_s: float) -> None:
        """Hear the nodes for a while."""
        deadline = time.monotonic() + duration_s
        while (left := deadline - time.monotonic()) > 0:
            self._executor.spin_once(timeout_sec=left)

    def _is_active(self, client: Any) -> bool:
        if not client.wait_for_service(timeout_sec=0.2):
            return False
        answer = client.call_async(GetState.Request())
        self._executor.spin_until_future_complete(answer, timeout_sec=1.0)
        return answer.done() and answer.result().current_state.id == State.PRIMARY_STATE_ACTIVE

    def _connected(self) -> bool:
        return all(
            publisher.get_subscription_count() >= self._listeners[topic]
            for topic, publisher in self._inputs.items()
        ) and all(self._node.count_publishers(s.topic_name) for s in self._outputs)

    def _hear(self, topic: str, message: Any) -> None:
        stamp = _stamp(message)
        self.answers.messages[topic][stamp] = message
        self.answers.heard_ns[topic][stamp] = time.time_ns()
        self._record(topic, message)

    def _hear_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self.answers.diagnostics[status.name] = {p.key: p.value for p in status.values}
        self._record(DIAGNOSTICS_TOPIC, message)


def _frame(view: CameraView) -> str:
    return f"{view.name}_optical"


def _stamp(message: Any) -> int:
    return ns_from_time(message.header.stamp)
