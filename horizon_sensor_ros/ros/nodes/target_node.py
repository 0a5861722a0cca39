"""The node that watches a target: a callback is decode, core, encode."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.lifecycle import LifecyclePublisher
from rclpy.qos import qos_profile_sensor_data
from rclpy.subscription import Subscription
from sensor_msgs.msg import PointCloud2

from horizon_sensor_ros.ros.diagnostics.target_diagnostics import TargetMonitor
from horizon_sensor_ros.ros.nodes.qos import overridable
from horizon_sensor_ros.ros.nodes.reporting_node import ReportingNode
from horizon_sensor_ros.ros.parameters.parameter import Parameter
from horizon_sensor_ros.ros.parameters.target import target_parameters
from horizon_sensor_ros.ros.parameters.target_settings import TargetSettings, target_settings
from horizon_sensor_ros.ros.pipelines.target_pipeline import (
    CLOUD_TOPIC,
    TARGET_TOPICS,
    TargetPipeline,
)
from horizon_sensor_ros.ros.process.interruption import END


class TargetPoseNode(ReportingNode[TargetSettings]):
    """Publishes a target's pose, its motion since the previous one, and diagnostics."""

    def __init__(self, **node_arguments: Any) -> None:
        self._pipeline: TargetPipeline | None = None
        self._monitor: TargetMonitor | None = None
        self._subscription: Subscription | None = None
        self._outputs: dict[str, LifecyclePublisher] = {}
        super().__init__("target_pose_node", **node_arguments)

    @property
    def subject(self) -> str:
        """Name under which the node reports."""
        return f"{self.get_name()}: target"

    @property
    def sources(self) -> Mapping[str, type]:
        """Topics without which the node has nothing to do; their types."""
        return {CLOUD_TOPIC: PointCloud2}

    def parameters_of(self, values: Mapping[str, Any]) -> tuple[Parameter, ...]:
        """Return all parameters of a node to which these values were given."""
        return target_parameters()

    def settings_of(self, values: Mapping[str, Any]) -> TargetSettings:
        """Return validated settings; ParameterError says what is wrong with the values."""
        return target_settings(values)

    def open(self) -> None:
        """Make the pipeline and the publishers."""
        settings = self.settings
        self._monitor = TargetMonitor(
            self.subject,
            settings.stale_after_ns,
            live=True,
            node=self.get_fully_qualified_name(),
        )
        self._pipeline = TargetPipeline(settings.pipeline)
        self._outputs = {
            topic: self.make_publisher(kind, topic) for topic, kind in TARGET_TOPICS.items()
        }
        self.begin_reports(settings.diagnostics_period_s)

    def warm_up(self) -> None:
        """Run the whole way once, so that the first real cloud is not slow."""
        assert self._pipeline is not None
        self._pipeline.warm_up()

    def start(self) -> None:
        """Subscribe."""
        assert self._pipeline is not None
        # The target may be any other after a pause.
        self._pipeline.reset()
        self._subscription = self.create_subscription(
            PointCloud2,
            CLOUD_TOPIC,
            self._on_cloud,
            **overridable(qos_profile_sensor_data),
        )
        self.report()

    def stop(self) -> None:
        """Unsubscribe."""
        if self._subscription is not None:
            self.destroy_subscription(self._subscription)
        self._subscription = None

    def close(self) -> None:
        """Give back pipeline, publishers and timer."""
        self._pipeline = self._monitor = None
        self._outputs = {}
        super().close()

    def apply(self, settings: TargetSettings) -> None:
        """Go on with other settings; track and counts stay."""
        if self._pipeline is None or self._monitor is None:
            return
        self._monitor.stale_after_ns = settings.stale_after_ns
        self.report_every(settings.diagnostics_period_s)
        self._pipeline.apply(settings.pipeline)

    def diagnosis(self, now: int) -> DiagnosticArray | None:
        """Message for /diagnostics; None while the node is not active."""
        if self._subscription is None:
            return None
        assert self._monitor is not None
        assert self._pipeline is not None
        return self._monitor.message(now, self._pipeline)

    def _on_cloud(self, msg: PointCloud2) -> None:
        assert self._monitor is not None
        assert self._pipeline is not None
        step = END.result_of(partial(self._pipeline.on_cloud, msg))
        if step is None:
            return
        self._monitor.on_step(step, self.now())
        sent = [self.send(self._outputs[topic], message) for topic, message in step.outputs]
        self._monitor.unsent += sent.count(False)
        if any(sent) and step.fix is not None:
            self._monitor.on_published(step.fix.stamp_ns, self.now())
        if self._monitor.changed(self.now()):
            self.report()
