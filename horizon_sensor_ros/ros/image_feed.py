"""Subscriptions to the cameras, shared by all nodes of a process that want the same of them."""

from __future__ import annotations

from collections.abc import Hashable
from functools import partial
from typing import Protocol
from weakref import WeakValueDictionary

from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription
from sensor_msgs.msg import CameraInfo, Image

from horizon_sensor_ros.ros.horizon_pipeline import HorizonPipeline, Step


class FeedMember(Protocol):
    """A node that takes a feed's results."""

    @property
    def node(self) -> Node:
        """The node itself."""

    def on_step(self, step: Step) -> None:
        """Take what became of an image."""


class ImageFeed:
    """The image and camera_info topics of a pipeline's cameras, and the members they are for.

    The subscriptions are those of one member, in its namespace and with its QoS; when it leaves,
    the next takes over.
    """

    def __init__(self, pipeline: HorizonPipeline) -> None:
        self.pipeline = pipeline
        self._members: list[FeedMember] = []
        self._host: FeedMember | None = None
        self._subscriptions: list[Subscription] = []

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
        node = self._host.node
        for camera in self.pipeline.settings.cameras:
            for topic, kind, callback in (
                ("camera_info", CameraInfo, self._on_camera_info),
                ("image_raw", Image, self._on_image),
            ):
                subscription = node.create_subscription(
                    kind,
                    f"{camera}/{topic}",
                    partial(callback, camera),
                    qos_profile_sensor_data,
                    qos_overriding_options=QoSOverridingOptions.with_default_policies(),
                )
                self._subscriptions.append(subscription)

    def _on_camera_info(self, camera: str, msg: CameraInfo) -> None:
        self.pipeline.on_camera_info(camera, msg)

    def _on_image(self, camera: str, msg: Image) -> None:
        step = self.pipeline.on_image(camera, msg)
        for member in tuple(self._members):
            member.on_step(step)


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
