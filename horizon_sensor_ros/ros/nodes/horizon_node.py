"""The nodes that watch the horizon: a callback is decode, core, encode."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, Image

from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.ros.diagnostics.horizon_diagnostics import HorizonMonitor
from horizon_sensor_ros.ros.messages.sensors import encoded_image
from horizon_sensor_ros.ros.nodes.extrinsics import TfExtrinsics
from horizon_sensor_ros.ros.nodes.image_feed import ImageFeed, ImageFeeds
from horizon_sensor_ros.ros.nodes.reporting_node import ReportingNode
from horizon_sensor_ros.ros.parameters.horizon import horizon_parameters
from horizon_sensor_ros.ros.parameters.horizon_settings import HorizonSettings, horizon_settings
from horizon_sensor_ros.ros.parameters.parameter import Parameter
from horizon_sensor_ros.ros.pictures.debug_image import draw_fix
from horizon_sensor_ros.ros.pipelines.aiding_sources import COARSE_POSE_TOPIC, IMU_TOPIC
from horizon_sensor_ros.ros.pipelines.horizon_outputs import HORIZON_OUTPUTS
from horizon_sensor_ros.ros.pipelines.horizon_pipeline import HorizonPipeline, HorizonResult, Step
from horizon_sensor_ros.ros.process.defect import words_of


class HorizonNode(ReportingNode[HorizonSettings]):
    """Publishes one kind of estimate of the horizon, a debug image and diagnostics.

    kind : which estimate, a key of HORIZON_OUTPUTS and the node's name unless it is renamed.
    feeds : shared by the nodes of a process, so that each frame is processed once.
    """

    def __init__(self, kind: str, feeds: ImageFeeds | None = None, **node_arguments: Any) -> None:
        self._output = HORIZON_OUTPUTS[kind]
        self._feeds = feeds or ImageFeeds()
        self._feed: ImageFeed | None = None
        self._tf: TfExtrinsics | None = None
        self._monitor: HorizonMonitor | None = None
        self._working = False
        super().__init__(kind, **node_arguments)

    @property
    def node(self) -> Node:
        """This node, as a member of a feed."""
        return self

    @property
    def subject(self) -> str:
        """Name under which the node reports."""
        return f"{self.get_name()}: horizon"

    @property
    def sources(self) -> Mapping[str, type]:
        """Topics without which the node has nothing to do; their types."""
        return _of_cameras(self.settings)

    def parameters_of(self, values: Mapping[str, Any]) -> tuple[Parameter, ...]:
        """Return all parameters of a node to which these values were given."""
        return horizon_parameters(values)

    def settings_of(self, values: Mapping[str, Any]) -> HorizonSettings:
        """Return validated settings; ParameterError says what is wrong with the values."""
        return horizon_settings(values)

    def open(self) -> None:
        """Make the pipeline and the publishers."""
        settings = self.settings
        self._monitor = HorizonMonitor(
            self.subject,
            settings.pipeline.cameras,
            settings.stale_after_ns,
            live=True,
            node=self.get_fully_qualified_name(),
        )
        self._feed = self._feed_of(settings)
        self._estimates = self.make_publisher(self._output.message, self._output.topic)
        self._pictures = self.make_publisher(Image, "~/debug_image")
        self.begin_reports(settings.diagnostics_period_s)

    def warm_up(self) -> None:
        """Run the whole way once, so that the first real frame is not slow."""
        assert self._feed is not None
        self._feed.pipeline.warm_up()

    def start(self) -> None:
        """Subscribe."""
        assert self._feed is not None
        shared = self._feeds.get(self._feed_key(self.settings))
        if shared is not None and shared.in_use:
            self._feed = shared
        self._working = True
        self._join()
        self.report()

    def stop(self) -> None:
        """Unsubscribe."""
        if self._working:
            self._leave()
        self._working = False

    def close(self) -> None:
        """Give back pipeline, publishers and timer."""
        self._feed = self._monitor = None
        if self._tf is not None:
            self._tf.close()
        self._tf = None
        super().close()

    def apply(self, settings: HorizonSettings) -> None:
        """Go on with other settings; calibrations and counts stay."""
        if self._feed is None or self._monitor is None:
            return
        self._monitor.stale_after_ns = settings.stale_after_ns
        self.report_every(settings.diagnostics_period_s)
        feed = self._feed_of(settings, self._feed)
        if feed is self._feed:
            # To subscribe anew would cost frames and the track.
            return
        if self._working:
            self._leave()
        self._feed = feed
        if self._working:
            self._join()

    def _join(self) -> None:
        assert self._feed is not None
        assert self._monitor is not None
        self._monitor.own_counts.begin(self._feed.pipeline)
        self._feed.join(self)

    def _leave(self) -> None:
        assert self._feed is not None
        assert self._monitor is not None
        self._feed.leave(self)
        self._monitor.own_counts.end(self._feed.pipeline)

    def on_step(self, step: Step, arrived: int) -> None:
        """Publish what an image completed; report a change of state at once."""
        assert self._monitor is not None
        now = self.now()
        self._monitor.on_step(step, now, max(now - arrived, 0))
        for result in step.results:
            if result.fix.status is Status.OK:
                if self.send(self._estimates, self._output.encode(result, self.settings)):
                    self._monitor.on_published(result.stamp, self.now())
                else:
                    self._monitor.unsent += 1
            if self._pictures.get_subscription_count():
                self._show(result)
        if self._monitor.changed(self.now()):
            self.report()

    def _show(self, result: HorizonResult) -> None:
        assert self._monitor is not None
        try:
            picture = draw_fix(result.frames, result.fix)
            frame_id = self.settings.pipeline.base_frame
            self._pictures.publish(encoded_image(picture, result.stamp, frame_id))
        except Exception as error:
            # As in the pipeline: a defect of ours costs a picture, not the node.
            self._monitor.undrawn += 1
            words = f"no debug image, internal error: {words_of(error)}"
            self.get_logger().error(words, once=True)

    def _feed_of(self, settings: HorizonSettings, previous: ImageFeed | None = None) -> ImageFeed:
        key = self._feed_key(settings)
        feed = self._feeds.get(key)
        # One that a paused node holds has not seen what this one's has since.
        if feed is not None and (previous is None or feed is previous or feed.in_use):
            return feed
        if previous is not None:
            pipeline = previous.pipeline.with_settings(settings.pipeline)
        elif None in settings.pipeline.rotations:
            self._tf = TfExtrinsics(self, settings.pipeline.base_frame)
            pipeline = HorizonPipeline(settings.pipeline, self._tf)
        else:
            pipeline = HorizonPipeline(settings.pipeline)
        return self._feeds.put(key, ImageFeed(pipeline))

    def _feed_key(self, settings: HorizonSettings) -> Hashable:
        """Equal for nodes that can share a feed; with TF none can, the listener is one node's."""
        topics = tuple(
            map(self.resolve_topic_name, (*_of_cameras(settings), COARSE_POSE_TOPIC, IMU_TOPIC))
        )
        owner = self.get_fully_qualified_name() if None in settings.pipeline.rotations else ""
        # Subscriptions are shared with the feed: with another's QoS a node would miss its own.
        of_topics = tuple(f"qos_overrides.{topic}.subscription." for topic in topics)
        overrides = frozenset(
            (name, repr(value))
            for name, value in self.qos_overrides.items()
            if name.startswith(of_topics)
        )
        return settings.pipeline, topics, overrides, owner

    def diagnosis(self, now: int) -> DiagnosticArray | None:
        """Message for /diagnostics; None while the node is not active."""
        if not self._working:
            return None
        assert self._monitor is not None
        assert self._feed is not None
        return self._monitor.message(now, self._feed.pipeline)


def _of_cameras(settings: HorizonSettings) -> dict[str, type]:
    """Topics of the cameras; their types."""
    of_each = {"image_raw": Image, "camera_info": CameraInfo}
    cameras = settings.pipeline.cameras
    return {f"{name}/{topic}": kind for name in cameras for topic, kind in of_each.items()}


class LocalVerticalNode(HorizonNode):
    """Publishes the direction towards the planet in the base frame."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__("local_vertical_node", **arguments)


class AttitudeNode(HorizonNode):
    """Publishes the base frame's attitude and altitude in the level frame."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__("attitude_node", **arguments)
