"""The demo's end of the ROS graph: publishes the cameras, collects what the nodes answer."""

from __future__ import annotations

import array
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from types import TracebackType
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
from sensor_msgs.msg import CameraInfo, Image

from horizon_sensor_ros.core.camera import Camera, CameraView
from horizon_sensor_ros.ros.messages import time_from_ns

NANOSECONDS = 1_000_000_000


class LinkTimeoutError(RuntimeError):
    """The nodes did not come up or did not connect in time."""


@dataclass
class Answers:
    """What the nodes published, by the stamp (ns) of the images.

    heard_ns : wall clock at the arrival of an attitude. pictures : (H, W, 3) uint8 BGR, of the
    wanted stamps only. diagnostics : the latest values by the status's name.
    """

    verticals: dict[int, Vector3Stamped] = field(default_factory=dict)
    attitudes: dict[int, PoseWithCovarianceStamped] = field(default_factory=dict)
    heard_ns: dict[int, int] = field(default_factory=dict)
    pictures: dict[int, np.ndarray] = field(default_factory=dict)
    diagnostics: dict[str, dict[str, str]] = field(default_factory=dict)


class DemoLink:
    """Publishers of the cameras' topics and subscribers of the nodes' outputs, in one context."""

    def __init__(self, domain: int, views: Sequence[CameraView]) -> None:
        self.answers = Answers()
        self.wanted_pictures: set[int] = set()
        self._views = tuple(views)
        self._context = rclpy.Context()
        # The demo handles signals itself: it has child processes to end.
        rclpy.init(
            context=self._context, domain_id=domain, signal_handler_options=SignalHandlerOptions.NO
        )
        self._node = rclpy.create_node("horizon_demo", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        names = [view.name for view in self._views]
        self._images = [self._publisher(Image, f"{name}/image_raw") for name in names]
        self._infos = [self._publisher(CameraInfo, f"{name}/camera_info") for name in names]
        self._info_messages = [_camera_info(view.camera, view.name) for view in self._views]
        reliable = QoSProfile(depth=50)
        self._outputs = [
            self._node.create_subscription(kind, topic, callback, reliable)
            for kind, topic, callback in (
                (Vector3Stamped, "local_vertical", self._hear_vertical),
                (PoseWithCovarianceStamped, "attitude", self._hear_attitude),
                (Image, "attitude_node/debug_image", self._hear_picture),
            )
        ]
        self._node.create_subscription(
            DiagnosticArray, "/diagnostics", self._hear_diagnostics, reliable
        )

    def __enter__(self) -> DemoLink:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)

    def wait_for_nodes(
        self, names: Sequence[str], check: Callable[[], None], patience_s: float = 30.0
    ) -> None:
        """Return when all nodes are active and connected both ways.

        check is called again and again, and may raise. LinkTimeoutError says what is missing.
        """
        deadline = time.monotonic() + patience_s
        for name in names:
            client = self._node.create_client(GetState, f"/{name}/get_state")
            while not self._is_active(client):
                check()
                if time.monotonic() > deadline:
                    raise LinkTimeoutError(f"{name} did not become active within {patience_s:g} s")
        while not self._connected(len(names)):
            check()
            self.spin(0.05)
            if time.monotonic() > deadline:
                raise LinkTimeoutError(f"the nodes' topics did not connect within {patience_s:g} s")
        # Both sides of a match learn of it one after the other; a best-effort image sent in
        # between is lost. CameraInfo, small and repeated, may go ahead.
        for _ in range(5):
            for publisher, message in zip(self._infos, self._info_messages, strict=True):
                message.header.stamp = self._node.get_clock().now().to_msg()
                publisher.publish(message)
            self.spin(0.1)

    def publish(self, stamp: int, images: Sequence[np.ndarray]) -> None:
        """Publish one moment's images, mono8, one a view, and their CameraInfo."""
        for i, (view, image) in enumerate(zip(self._views, images, strict=True)):
            info = self._info_messages[i]
            info.header.stamp = time_from_ns(stamp)
            self._infos[i].publish(info)
            message = Image()
            message.header = info.header
            message.height, message.width = view.camera.height, view.camera.width
            message.encoding, message.step = "mono8", view.camera.width
            # An array goes into the message in one piece; a list element by element.
            message.data = array.array("B", np.ascontiguousarray(image).tobytes())
            self._images[i].publish(message)

    def spin(self, duration_s: float) -> None:
        """Hear the nodes for a while."""
        deadline = time.monotonic() + duration_s
        while (left := deadline - time.monotonic()) > 0:
            self._executor.spin_once(timeout_sec=left)

    def _publisher(self, kind: Any, topic: str) -> Any:
        return self._node.create_publisher(kind, topic, qos_profile_sensor_data)

    def _is_active(self, client: Any) -> bool:
        if not client.wait_for_service(timeout_sec=0.2):
            return False
        answer = client.call_async(GetState.Request())
        self._executor.spin_until_future_complete(answer, timeout_sec=1.0)
        return answer.done() and answer.result().current_state.id == State.PRIMARY_STATE_ACTIVE

    def _connected(self, nodes: int) -> bool:
        publishers = (*self._images, *self._infos)
        return all(p.get_subscription_count() >= nodes for p in publishers) and all(
            self._node.count_publishers(s.topic_name) for s in self._outputs
        )

    def _hear_vertical(self, message: Vector3Stamped) -> None:
        self.answers.verticals[_stamp(message)] = message

    def _hear_attitude(self, message: PoseWithCovarianceStamped) -> None:
        stamp = _stamp(message)
        self.answers.attitudes[stamp] = message
        self.answers.heard_ns[stamp] = time.time_ns()

    def _hear_picture(self, message: Image) -> None:
        stamp = _stamp(message)
        if stamp in self.wanted_pictures:
            shape = (message.height, message.width, 3)
            self.answers.pictures[stamp] = np.frombuffer(message.data, np.uint8).reshape(shape)

    def _hear_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self.answers.diagnostics[status.name] = {p.key: p.value for p in status.values}


def _stamp(message: Any) -> int:
    stamp = message.header.stamp
    return stamp.sec * NANOSECONDS + stamp.nanosec


def _camera_info(camera: Camera, frame: str) -> CameraInfo:
    message = CameraInfo()
    message.header.frame_id = f"{frame}_optical"
    message.width, message.height = camera.width, camera.height
    message.distortion_model = camera.model
    message.d = [float(c) for c in camera.distortion]
    message.k = [camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0]
    message.r = np.eye(3).ravel().tolist()
    message.p = [
        *(camera.fx, 0.0, camera.cx, 0.0),
        *(0.0, camera.fy, camera.cy, 0.0),
        *(0.0, 0.0, 1.0, 0.0),
    ]
    return message
