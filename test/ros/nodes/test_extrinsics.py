"""The seam to TF. tf2_ros cannot be installed here, so a stand-in with its interface is asked."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
import rclpy
from geometry_msgs.msg import TransformStamped
from horizon_messages import QUATERNIONS, ROTATIONS
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile

from horizon_sensor_ros.ros.messages.refusal import Refusal
from horizon_sensor_ros.ros.nodes.extrinsics import TfExtrinsics
from horizon_sensor_ros.ros.nodes.horizon_node import AttitudeNode
from horizon_sensor_ros.ros.parameters.parameter import ParameterError


class TransformException(Exception):  # noqa: N818 - tf2's name
    pass


@pytest.fixture
def transforms(monkeypatch: pytest.MonkeyPatch) -> dict[tuple[str, str], list[float]]:
    """Rotations that the stand-in's buffer knows: (target frame, source frame) to quaternion."""
    known: dict[tuple[str, str], list[float]] = {}

    class Buffer:
        def lookup_transform(self, target: str, source: str, time: Any) -> Any:
            assert time.nanoseconds == 0
            if (target, source) not in known:
                raise TransformException(f'"{source}" does not exist')
            rotation = SimpleNamespace(**dict(zip("xyzw", known[target, source], strict=True)))
            return SimpleNamespace(transform=SimpleNamespace(rotation=rotation))

    class TransformListener:
        def __init__(self, buffer: Buffer, node: Any) -> None:
            self._node = node
            self._subscriptions = [] if node is None else [self._subscription("/tf")]

        def _subscription(self, topic: str) -> Any:
            qos = QoSProfile(depth=1)
            return self._node.create_subscription(TransformStamped, topic, print, qos)

        def unregister(self) -> None:
            for subscription in self._subscriptions:
                self._node.destroy_subscription(subscription)

    module = ModuleType("tf2_ros")
    module.Buffer = Buffer  # type: ignore[attr-defined]
    module.TransformListener = TransformListener  # type: ignore[attr-defined]
    module.TransformException = TransformException  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "tf2_ros", module)
    return known


def test_without_tf2_the_node_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "tf2_ros", None)
    with pytest.raises(ParameterError, match="tf2_ros is not installed"):
        TfExtrinsics(None, "base_link")


def test_a_rotation_takes_vectors_from_the_image_to_the_base_frame(transforms: dict) -> None:
    transforms["base_link", "camera_1_optical"] = QUATERNIONS["camera_1"]
    rot = TfExtrinsics(None, "base_link")("camera_1", "camera_1_optical")
    np.testing.assert_allclose(rot, ROTATIONS["camera_1"], atol=1e-12)


@pytest.mark.parametrize("frame_id", ["", "camera_1_optical", "broken"])
def test_what_is_missing_is_a_refusal_never_identity(transforms: dict, frame_id: str) -> None:
    transforms["base_link", "broken"] = [0.0, 0.0, 0.0, 0.0]
    answer = TfExtrinsics(None, "base_link")("camera_1", frame_id)
    assert isinstance(answer, Refusal)
    assert answer.cause == "no_extrinsics"
    assert "camera_1" in answer.reason


@pytest.fixture
def node(ros_domain: int, transforms: dict) -> Iterator[AttitudeNode]:
    """A node, not configured, that has its rotations from TF."""
    context = Context()
    rclpy.init(context=context, domain_id=ros_domain)
    given = {"extrinsics_source": "tf", "autostart": False}
    overrides = [Parameter(name, value=value) for name, value in given.items()]
    node = AttitudeNode(context=context, parameter_overrides=overrides)
    yield node
    node.destroy_node()
    rclpy.shutdown(context=context)


def test_a_node_listens_to_tf_only_while_it_is_configured(node: AttitudeNode) -> None:
    def listeners() -> int:
        return sum(subscription.topic_name == "/tf" for subscription in node.subscriptions)

    for _ in range(2):
        node.trigger_configure()
        assert listeners() == 1
        node.trigger_cleanup()
        assert listeners() == 0


def test_a_node_without_rotations_answers_for_its_parameters(node: AttitudeNode) -> None:
    """As `ros2 param set`, `get` and `dump` ask."""
    person = rclpy.create_node("person", context=node.context)
    executor = SingleThreadedExecutor(context=node.context)
    for each in (node, person):
        executor.add_node(each)

    def call(kind: type, name: str, request: Any) -> Any:
        client = person.create_client(kind, f"/attitude_node/{name}")
        assert client.wait_for_service(10.0)
        future = client.call_async(request)
        executor.spin_until_future_complete(future, timeout_sec=10.0)
        return future.result()

    def set_to(name: str, value: Any) -> Any:
        message = Parameter(name, value=value).to_parameter_msg()
        request = SetParameters.Request(parameters=[message])
        return call(SetParameters, "set_parameters", request).results[0]

    try:
        assert set_to("slop", 0.03).successful
        assert node.settings.pipeline.slop_ns == 30_000_000
        assert not set_to("camera_1.rotation", QUATERNIONS["camera_1"]).successful
        names = call(ListParameters, "list_parameters", ListParameters.Request()).result.names
        got = call(GetParameters, "get_parameters", GetParameters.Request(names=names))
        assert dict(zip(names, got.values, strict=True))["slop"].double_value == 0.03
        told = call(
            DescribeParameters, "describe_parameters", DescribeParameters.Request(names=names)
        )
        assert len(told.descriptors) == len(names)
    finally:
        executor.shutdown()
        person.destroy_node()
