"""Subscriptions to the cameras, shared by all nodes of a process that want the same of them."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from functools import partial
from typing import Any, Protocol
from weakref import WeakValueDictionary

from geometry_msgs.msg import PoseStamped
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from rclpy.subscription import Subscription
from sensor_msgs.msg import CameraInfo, Image, Imu

from horizon_sensor_ros.ros.nodes.qos import overridable
from horizon_sensor_ros.ros.pipelines.aiding_sources import COARSE_POSE_TOPIC, IMU_TOPIC
from horizon_sensor_ros.ros.pipelines.horizon_pipeline import HorizonPipeline, Step
from horizon_sensor_ros.ros.process.interruption import END

# Rates come many to a frame, and wait while it is processed.
_IMU_QOS = QoSProfile(depth=200, reliability=ReliabilityPolicy.BEST_EFFORT)


class FeedMember(Protocol):
    """A node that takes a feed's results."""

    @property
    def node(self) -> Node:
        """The node itself."""

    def now(self) -> int:
        """Nanoseconds of the node's clock."""

    def on_step(self, step: Step, arrived: int) -> None:
        """Take what became of an image that arrived at a time of the node's clock."""


class ImageFeed:
    """The topics of a pipeline, its cameras' and those that help, and the members they are for.

    The subscriptions are those of one member, in its namespace and with its QoS; when it leaves,
    the next takes over.
    """

    def __init__(self, pipeline: HorizonPipeline) -> None:
        self.pipeline = pipeline
        self._members: list[FeedMember] = []
        self._host: FeedMember | None = None
        self._subscriptions: list[Subscription] = []

    @property
    def in_use(self) -> bool:
        """Whether it has members; without, it knows nothing of what came since."""
        return bool(self._members)

    def join(self, member: FeedMember) -> None:
        """Send a member all results from now on."""
        if not self._members:
            # Frames from before a pause have no partners any more.
            self.pipeline.reset()
        self._members.append(member)
        self._subscribe()

    def leave(self, member: FeedMember) -> None:
        """Send a member nothing more; of no effect for one that has not joined."""
        if member not in self._members:
            return
        self._members.remove(member)
        if self._host is member:
            for subscription in self._subscriptions:
                member.node.destroy_subscription(subscription)
            self._subscriptions.clear()
            self._host = None
            self._subscribe()

    def _subscribe(self) -> None:
        if self._host is not None or not self._members:
            return
        self._host = self._members[0]
        for camera in self.pipeline.settings.cameras:
            on_info = partial(self.pipeline.on_camera_info, camera)
            self._listen(CameraInfo, f"{camera}/camera_info", on_info)
            self._listen(Image, f"{camera}/image_raw", partial(self._on_image, camera))
        aiding = self.pipeline.aiding
        self._listen(PoseStamped, COARSE_POSE_TOPIC, aiding.on_coarse_pose)
        self._listen(Imu, IMU_TOPIC, aiding.on_imu, _IMU_QOS)

    def _listen(
        self,
        kind: type,
        topic: str,
        callback: Callable[[Any], None],
        qos: QoSProfile = qos_profile_sensor_data,
    ) -> None:
        assert self._host is not None
        subscription = self._host.node.create_subscription(
            kind, topic, callback, **overridable(qos)
        )
        self._subscriptions.append(subscription)

    def _on_image(self, camera: str, msg: Image) -> None:
        arrived = [(member, member.now()) for member in self._members]
        step = END.result_of(partial(self.pipeline.on_image, camera, msg))
        if step is None:
            return
        for member, time in arrived:
            member.on_step(step, time)


class ImageFeeds:
    """The feeds of a process; nodes with equal wishes get the same one."""

    def __init__(self) -> None:
        self._feeds: WeakValueDictionary[Hashable, ImageFeed] = WeakValueDictionary()

    def get(self, key: Hashable) -> ImageFeed | None:
        """Return the feed of a key, if a node still holds one."""
        return self._feeds.get(key)

    def put(self, key: Hashable, feed: ImageFeed) -> ImageFeed:
        """Offer a feed to the nodes that come after."""
        self._feeds[key] = feed
        return feed
