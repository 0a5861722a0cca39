"""The nodes that watch the horizon: a callback is decode, core, encode."""

from __future__ import annotations

from collections.abc import Hashable
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped, Vector3Stamped
from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecyclePublisher
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.timer import Timer
from sensor_msgs.msg import Image

from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.ros.debug_image import draw_fix
from horizon_sensor_ros.ros.diagnostics import Health, HorizonMonitor, diagnostic_message
from horizon_sensor_ros.ros.extrinsics import TfExtrinsics
from horizon_sensor_ros.ros.horizon_pipeline import HorizonPipeline, HorizonResult, Step
from horizon_sensor_ros.ros.image_feed import ImageFeed, ImageFeeds
from horizon_sensor_ros.ros.managed_node import ManagedNode
from horizon_sensor_ros.ros.messages import (
    attitude_message,
    image_message,
    local_vertical_message,
)
from horizon_sensor_ros.ros.parameters import HorizonSettings

OUTPUT_QOS = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)


class HorizonNode(ManagedNode):
    """Publishes one kind of estimate of the horizon, a debug image and diagnostics.

    feeds : shared by the nodes of a process, so that each frame is processed once.
    """

    topic: str
    message: type

    def __init__(self, name: str, feeds: ImageFeeds | None = None, **node_arguments: Any) -> None:
        self._feeds = feeds or ImageFeeds()
        self._feed: ImageFeed | None = None
        self._monitor: HorizonMonitor | None = None
        self._publishers_made: list[LifecyclePublisher] = []
        self._timer: Timer | None = None
        self._working = False
        super().__init__(name, **node_arguments)

    @property
    def node(self) -> Node:
        """This node, as a member of a feed."""
        return self

    def encode(self, result: HorizonResult) -> Any:
        """Message of a result whose fix is OK."""
        raise NotImplementedError

    def open(self) -> None:
        """Make the pipeline, warm, and the publishers."""
        settings = self.settings
        self._monitor = HorizonMonitor(
            f"{self.get_name()}: horizon",
            settings.pipeline.cameras,
            settings.stale_after_ns,
            live=True,
        )
        self._feed = self._feed_of(settings)
        self._feed.pipeline.warm_up()
        self._estimates = self._make_publisher(self.message, self.topic)
        self._pictures = self._make_publisher(Image, "~/debug_image")
        # Not managed: an inactive node says so.
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        # Steady: diagnostics go on when simulated time stands still.
        self._timer = self.create_timer(
            settings.diagnostics_period_s,
            self._publish_diagnostics,
            clock=Clock(clock_type=ClockType.STEADY_TIME),
        )

    def start(self) -> None:
        """Subscribe."""
        assert self._feed is not None
        self._working = True
        self._feed.join(self)
        self._publish_diagnostics()

    def stop(self) -> None:
        """Unsubscribe."""
        self._working = False
        if self._feed is not None:
            self._feed.leave(self)

    def close(self) -> None:
        """Give back pipeline, publishers and timer."""
        self._feed = self._monitor = None
        if self._timer is not None:
            self.destroy_timer(self._timer)
            self.destroy_publisher(self._diagnostics)
        self._timer = None
        for publisher in self._publishers_made:
            self.destroy_lifecycle_publisher(publisher)
        self._publishers_made.clear()

    def apply(self, settings: HorizonSettings) -> None:
        """Go on with other settings; calibrations and counts stay."""
        if self._feed is None or self._monitor is None:
            return
        self._monitor.stale_after_ns = settings.stale_after_ns
        self._feed.leave(self)
        self._feed = self._feed_of(settings, self._feed.pipeline)
        if self._working:
            self._feed.join(self)

    def on_step(self, step: Step) -> None:
        """Publish what an image completed; report a change of state at once."""
        assert self._monitor is not None
        self._monitor.on_step(step, self._now())
        for result in step.results:
            if result.fix.status is Status.OK:
                self._estimates.publish(self.encode(result))
                self._monitor.on_published(result.stamp, self._now())
            if self._pictures.get_subscription_count():
                picture = draw_fix(result.frames, result.fix)
                frame_id = self.settings.pipeline.base_frame
                self._pictures.publish(image_message(picture, result.stamp, frame_id))
        if self._monitor.changed(self._now()):
            self._publish_diagnostics()

    def _feed_of(
        self, settings: HorizonSettings, previous: HorizonPipeline | None = None
    ) -> ImageFeed:
        key = self._feed_key(settings)
        feed = self._feeds.get(key)
        if feed is not None:
            return feed
        if previous is not None:
            pipeline = previous.with_settings(settings.pipeline)
        elif None in settings.pipeline.rotations:
            extrinsics = TfExtrinsics(self, settings.pipeline.base_frame)
            pipeline = HorizonPipeline(settings.pipeline, extrinsics)
        else:
            pipeline = HorizonPipeline(settings.pipeline)
        return self._feeds.put(key, ImageFeed(pipeline))

    def _feed_key(self, settings: HorizonSettings) -> Hashable:
        """Equal for nodes that can share a feed; with TF none can, the listener is one node's."""
        topics = tuple(
            self.resolve_topic_name(f"{camera}/{topic}")
            for camera in settings.pipeline.cameras
            for topic in ("image_raw", "camera_info")
        )
        owner = self.get_fully_qualified_name() if None in settings.pipeline.rotations else ""
        return settings.pipeline, topics, owner

    def _make_publisher(self, message: type, topic: str) -> LifecyclePublisher:
        publisher = self.create_lifecycle_publisher(
            message,
            topic,
            OUTPUT_QOS,
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )
        self._publishers_made.append(publisher)
        return publisher

    def _publish_diagnostics(self) -> None:
        assert self._monitor is not None
        assert self._feed is not None
        now = self._now()
        if self._working:
            message = self._monitor.message(now, self._feed.pipeline)
        else:
            inactive = Health(DiagnosticStatus.OK, "inactive", "the node is not active")
            message = diagnostic_message(self._monitor.name, inactive, {}, now)
        self._diagnostics.publish(message)

    def _now(self) -> int:
        return self.get_clock().now().nanoseconds


class LocalVerticalNode(HorizonNode):
    """Publishes the direction towards the planet in the base frame."""

    topic = "local_vertical"
    message = Vector3Stamped

    def __init__(self, **arguments: Any) -> None:
        super().__init__("local_vertical_node", **arguments)

    def encode(self, result: HorizonResult) -> Vector3Stamped:
        """Message of a result whose fix is OK."""
        return local_vertical_message(
            result.fix.fit, result.stamp, self.settings.pipeline.base_frame
        )


class AttitudeNode(HorizonNode):
    """Publishes the base frame's attitude and altitude in the level frame."""

    topic = "attitude"
    message = PoseWithCovarianceStamped

    def __init__(self, **arguments: Any) -> None:
        super().__init__("attitude_node", **arguments)

    def encode(self, result: HorizonResult) -> PoseWithCovarianceStamped:
        """Message of a result whose fix is OK."""
        return attitude_message(result.fix.fit, result.stamp, self.settings.level_z)
