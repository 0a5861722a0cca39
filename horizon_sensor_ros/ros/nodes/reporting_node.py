"""A managed node with reliable outputs that says on /diagnostics, and in its log, how it fares."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.lifecycle import LifecyclePublisher, LifecycleState, TransitionCallbackReturn
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.timer import Timer

from horizon_sensor_ros.ros.diagnostics.diagnostics import OK, Health, diagnostic_message
from horizon_sensor_ros.ros.diagnostics.state_log import StateLog, why_unheard
from horizon_sensor_ros.ros.nodes.managed_node import ManagedNode, Settings
from horizon_sensor_ros.ros.nodes.qos import overridable

OUTPUT_QOS = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)

# What a publisher has sent is lost to who has not taken it when the publisher is destroyed.
_LAST_WORD = Duration(seconds=0.2)
_SELDOM_S = 10.0


class ReportingNode(ManagedNode[Settings]):
    """Keeps a node's publishers, and the timer of its diagnostics."""

    def __init__(self, name: str, **node_arguments: Any) -> None:
        self._publishers_made: list[LifecyclePublisher] = []
        self._timer: Timer | None = None
        super().__init__(name, **node_arguments)
        self._state_log = StateLog(self.get_logger())

    def diagnosis(self, now: int) -> DiagnosticArray | None:
        """Message for /diagnostics; None while the node is not active."""
        raise NotImplementedError

    @property
    def subject(self) -> str:
        """Name under which the node reports."""
        raise NotImplementedError

    @property
    def sources(self) -> Mapping[str, type]:
        """Topics, as named in the code, without which the node has nothing to do; their types."""
        raise NotImplementedError

    def now(self) -> int:
        """Nanoseconds of the node's clock."""
        return self.get_clock().now().nanoseconds

    def make_publisher(self, message: type, topic: str) -> LifecyclePublisher:
        """Return a publisher that goes with the node's state and has its QoS overridable."""
        publisher = self.create_lifecycle_publisher(message, topic, **overridable(OUTPUT_QOS))
        self._publishers_made.append(publisher)
        return publisher

    def send(self, publisher: Publisher, message: Any) -> bool:
        """Publish a message; whether the middleware took it.

        Where an override has it keep all, it refuses once a subscriber has taken nothing for long.
        """
        try:
            publisher.publish(message)
        except RuntimeError as error:
            words = " ".join(str(error).split())
            self.get_logger().error(
                f"not sent on {publisher.topic_name}: {words}", throttle_duration_sec=_SELDOM_S
            )
            return False
        return True

    def begin_reports(self, period_s: float) -> None:
        """Report from now on, every so often."""
        # Not managed: an inactive node says so.
        self._diagnostics = self.create_publisher(
            DiagnosticArray, "/diagnostics", **overridable(OUTPUT_QOS)
        )
        self.report_every(period_s)

    def report_every(self, period_s: float) -> None:
        """Take another time between two reports."""
        if self._timer is not None:
            self.destroy_timer(self._timer)
        # Steady: diagnostics go on when simulated time stands still.
        self._timer = self.create_timer(
            period_s, self._on_timer, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )

    def _on_timer(self) -> None:
        (status,) = self.report().status
        self._state_log.on_report(status, partial(why_unheard, self, self.sources))

    def report(self) -> DiagnosticArray:
        """Publish on /diagnostics; return the message."""
        now = self.now()
        message = self.diagnosis(now)
        if message is None:
            inactive = Health(OK, "inactive", "the node is not active")
            node = self.get_fully_qualified_name()
            message = diagnostic_message(self.subject, node, inactive, {}, now)
        self.send(self._diagnostics, message)
        return message

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Cease to work, and say so at once."""
        deactivated = super().on_deactivate(state)
        self.report()
        return deactivated

    def close(self) -> None:
        """Give back publishers and timer; also called when there are none."""
        if self._timer is not None:
            self.destroy_timer(self._timer)
            # Nothing is heard of the node after this: its last word must not be that all is well.
            self.report()
            self._diagnostics.wait_for_all_acked(_LAST_WORD)
            self.destroy_publisher(self._diagnostics)
        self._timer = None
        for publisher in self._publishers_made:
            self.destroy_lifecycle_publisher(publisher)
        self._publishers_made.clear()
