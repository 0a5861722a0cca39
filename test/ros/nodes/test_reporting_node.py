"""What a node says of itself when the middleware does not take what it sends."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistWithCovarianceStamped
from horizon_messages import (
    CAMERAS,
    PARAMETERS,
    START_NS,
    camera_info_of,
    horizon_gray,
    image_of,
    nadir_of,
)
from node_processes import Listener
from rclpy.parameter import Parameter
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from target_messages import good_cloud

from horizon_sensor_ros.ros.nodes.horizon_node import AttitudeNode
from horizon_sensor_ros.ros.nodes.reporting_node import ReportingNode
from horizon_sensor_ros.ros.nodes.target_node import TargetPoseNode

KEEP_ALL = QoSProfile(history=HistoryPolicy.KEEP_ALL, reliability=ReliabilityPolicy.RELIABLE)
# Fast DDS keeps 5000 on either side.
MORE_THAN_KEPT = 20_000

pytestmark = pytest.mark.usefixtures("environment")


@pytest.fixture
def hanging(ros_domain: int) -> Iterator[Listener]:
    """Somebody who takes nothing: its executor is never spun once it has subscribed."""
    listener = Listener(ros_domain)
    yield listener
    listener.close()


def keeping_all(topic: str) -> list[Parameter]:
    overrides = {f"qos_overrides./{topic}.publisher.history": "keep_all"}
    return [Parameter(name, value=v) for name, v in {**PARAMETERS, **overrides}.items()]


def fill(node: ReportingNode, hanging: Listener, kind: type, topic: str) -> None:
    """Send to a subscriber that hangs until no more is taken."""
    hanging.listen(kind, f"/{topic}", KEEP_ALL)
    (publisher,) = (p for p in node.publishers if p.topic_name == f"/{topic}")
    hanging.wait(lambda: publisher.get_subscription_count() == 1, "the subscriber")
    assert not all(node.send(publisher, kind()) for _ in range(MORE_THAN_KEPT))


def values_of(node: ReportingNode) -> dict[str, str]:
    (status,) = node.report().status
    return {each.key: each.value for each in status.values}


def test_what_is_not_taken_costs_an_estimate_and_not_the_node(hanging: Listener) -> None:
    given = keeping_all("attitude")
    node = AttitudeNode(context=hanging.context, parameter_overrides=given)
    try:
        node.bring_up()
        fill(node, hanging, PoseWithCovarianceStamped, "attitude")
        assert "unsent" not in values_of(node)
        for camera in CAMERAS:
            node._feed.pipeline.on_camera_info(camera, camera_info_of(START_NS, camera))
            gray = horizon_gray(camera, nadir_of(0.0, 0.0))
            node._feed._on_image(camera, image_of(gray, START_NS, camera))
        values = values_of(node)
        assert (values["fixes"], values["unsent"]) == ("1", "1")
        assert "latency_ms" not in values
    finally:
        node.destroy_node()


def test_what_is_not_taken_costs_a_message_and_not_the_others(hanging: Listener) -> None:
    given = keeping_all("target/twist")
    node = TargetPoseNode(context=hanging.context, parameter_overrides=given)
    try:
        node.bring_up()
        fill(node, hanging, TwistWithCovarianceStamped, "target/twist")
        for index in range(2):
            node._on_cloud(good_cloud(index))
        values = values_of(node)
        assert (values["fixes"], values["unsent"]) == ("2", "1")
        assert "latency_ms" in values
    finally:
        node.destroy_node()
