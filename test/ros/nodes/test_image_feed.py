"""Nodes of one process: which of them share subscriptions, and when they are made anew."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest
import rclpy
from horizon_messages import (
    CAMERAS,
    PARAMETERS,
    camera_info_of,
    horizon_gray,
    image_of,
    nadir_of,
)
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import ReliabilityPolicy
from sensor_msgs.msg import Image

from horizon_sensor_ros.ros.nodes import horizon_node
from horizon_sensor_ros.ros.nodes.horizon_node import AttitudeNode, HorizonNode, LocalVerticalNode
from horizon_sensor_ros.ros.nodes.image_feed import ImageFeeds

IMAGES = "/camera_1/image_raw"
RELIABLE = {f"qos_overrides.{IMAGES}.subscription.reliability": "reliable"}


@pytest.fixture
def context(ros_domain: int) -> Iterator[Context]:
    context = Context()
    rclpy.init(context=context, domain_id=ros_domain)
    yield context
    rclpy.shutdown(context=context)


@pytest.fixture
def make(context: Context) -> Iterator[Callable[..., HorizonNode]]:
    """Make an active node of a process, with parameters."""
    feeds = ImageFeeds()
    nodes: list[HorizonNode] = []

    def make_one(kind: type, **values: Any) -> HorizonNode:
        given = [Parameter(name, value=v) for name, v in {**PARAMETERS, **values}.items()]
        nodes.append(kind(feeds=feeds, context=context, parameter_overrides=given))
        nodes[-1].bring_up()
        return nodes[-1]

    yield make_one
    for node in nodes:
        node.destroy_node()


def subscriptions(node: Node) -> list[Any]:
    return [s for s in node.subscriptions if s.topic_name == IMAGES]


def reliabilities(node: Node) -> list[ReliabilityPolicy]:
    return [s.qos_profile.reliability for s in subscriptions(node)]


def test_an_override_is_for_its_topic_alone(make: Callable) -> None:
    best_effort = {"qos_overrides./attitude.publisher.reliability": "best_effort"}
    node = make(AttitudeNode, **RELIABLE, **best_effort)
    (others,) = {s.qos_profile.reliability for s in node.subscriptions} - set(reliabilities(node))
    assert others == ReliabilityPolicy.BEST_EFFORT
    assert reliabilities(node) == [ReliabilityPolicy.RELIABLE]
    assert {
        p.topic_name: p.qos_profile.reliability
        for p in node.publishers
        if p.topic_name in ("/attitude", "/attitude_node/debug_image")
    } == {
        "/attitude": ReliabilityPolicy.BEST_EFFORT,
        "/attitude_node/debug_image": ReliabilityPolicy.RELIABLE,
    }


def test_an_override_of_a_misspelt_topic_is_said(
    make: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[str] = []
    monkeypatch.setattr(RcutilsLogger, "warning", lambda _, words, **__: said.append(words))
    misspelt = "qos_overrides./camera_1/image_ra.subscription.reliability"
    others = {
        # Other nodes', and another camera's.
        "qos_overrides./target/points.subscription.reliability": "reliable",
        "qos_overrides./camera_7/image_raw.subscription.reliability": "reliable",
        "qos_overrides./left/image_raw.subscription.depth": 3,
    }
    make(AttitudeNode, **RELIABLE, **others, **{misspelt: "reliable"})
    assert said == [f"{misspelt} is for no topic; did you mean {IMAGES}?"]


def test_each_node_has_the_quality_of_service_that_it_was_given(make: Callable) -> None:
    first, second = make(LocalVerticalNode), make(AttitudeNode, **RELIABLE)
    assert reliabilities(first) == [ReliabilityPolicy.BEST_EFFORT]
    assert reliabilities(second) == [ReliabilityPolicy.RELIABLE]


def test_nodes_with_the_same_wishes_share_subscriptions(make: Callable) -> None:
    # What is asked of an output matters to nobody else.
    own = {"qos_overrides./attitude.publisher.depth": 3}
    first, second = make(LocalVerticalNode, **RELIABLE), make(AttitudeNode, **RELIABLE, **own)
    assert reliabilities(first) == [ReliabilityPolicy.RELIABLE]
    assert subscriptions(second) == []


def test_reports_have_the_quality_of_service_that_they_were_given(make: Callable) -> None:
    node = make(AttitudeNode, **{"qos_overrides./diagnostics.publisher.depth": 77})
    depths = {p.topic_name: p.qos_profile.depth for p in node.publishers}
    assert (depths["/diagnostics"], depths["/attitude"]) == (77, 10)


def test_an_activation_that_fails_can_be_tried_again(make: Callable) -> None:
    node = make(AttitudeNode, autostart=False)
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    # One that is given with the others is refused before there is a node.
    node.declare_parameter(f"qos_overrides.{IMAGES}.subscription.reliability", "bogus")
    timers = len(list(node.timers))
    failures = []
    for _ in range(2):
        assert node.trigger_activate() == TransitionCallbackReturn.FAILURE
        failures.append(node._failure)
    assert "bogus" in failures[0]
    assert failures[1] == failures[0]
    # It reports on, as one that is not active.
    assert len(list(node.timers)) == timers > 0
    assert node.diagnosis(0) is None


def test_a_picture_that_cannot_be_drawn_costs_no_node(
    make: Callable, context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: Any) -> None:
        raise OverflowError("lens")

    monkeypatch.setattr(horizon_node, "draw_fix", broken)
    node = make(AttitudeNode)
    listener = Node("listener", context=context)
    listener.create_subscription(Image, "/attitude_node/debug_image", lambda _: None, 10)
    while not node._pictures.get_subscription_count():
        rclpy.spin_once(node, timeout_sec=0.1, executor=SingleThreadedExecutor(context=context))
    pipeline = node._feed.pipeline
    for camera in CAMERAS:
        pipeline.on_camera_info(camera, camera_info_of(camera=camera))
        step = pipeline.on_image(camera, image_of(horizon_gray(camera, nadir_of(0.0, 0.0)), 0))
    assert len(step.results) == 1
    node.on_step(step, node.now())
    values = {v.key: v.value for v in node.diagnosis(node.now()).status[0].values}
    assert (values["undrawn"], values["fixes"]) == ("1", "1")
    listener.destroy_node()


def test_a_parameter_of_the_reports_leaves_the_subscriptions_alone(make: Callable) -> None:
    node = make(AttitudeNode)
    (before,) = subscriptions(node)
    for name in ("stale_after", "diagnostics_period"):
        assert node.set_parameters([Parameter(name, value=3.0)])[0].successful
    assert [s is before for s in subscriptions(node)] == [True]
    # One that the estimates depend on does not.
    assert node.set_parameters([Parameter("max_residual", value=3.0)])[0].successful
    assert [s is before for s in subscriptions(node)] == [False]


def test_what_a_paused_node_holds_is_not_taken_for_the_present(make: Callable) -> None:
    """Its pipeline has not seen the stamps and calibrations that came meanwhile."""
    paused, node = make(LocalVerticalNode), make(AttitudeNode)
    slop = [Parameter("slop", value=0.03)]
    assert paused.set_parameters(slop)[0].successful
    paused.trigger_deactivate()
    assert sent_pair(node) == 1
    assert node.set_parameters(slop)[0].successful
    assert sent_pair(node) == 0
    # And when it comes back it shares what the others know.
    paused.trigger_activate()
    assert paused._feed is node._feed
    assert subscriptions(paused) == []


def test_each_node_counts_its_own(make: Callable) -> None:
    """Whichever pipeline it shares, and whatever the others' settings were meanwhile."""
    one, other = make(LocalVerticalNode), make(AttitudeNode)
    sent = {one: 0, other: 0}
    fixed = {one: 0, other: 0}
    told = {}

    def send(node: HorizonNode, index: int, **fields: Any) -> None:
        fixes = sent_pair(node, index, **fields)
        for each in (one, other):
            if each._working and each._feed is node._feed:
                sent[each] += 2
                fixed[each] += fixes
        for each in (one, other):
            if each._working:
                told[each] = values_of(each)
                assert int(told[each]["frames"]) == sent[each]
                assert int(told[each]["fixes"]) == fixed[each]

    def change(node: HorizonNode, **values: Any) -> None:
        given = [Parameter(name, value=value) for name, value in values.items()]
        assert all(result.successful for result in node.set_parameters(given))

    send(one, 0)
    change(one, max_residual=3.0)
    # Theirs are two pipelines now; one gets more than the other, and what it cannot use.
    for index in (1, 2, 3):
        send(one, index)
    send(one, 4, encoding="64FC4")
    send(other, 5)
    assert sent == {one: 10, other: 4}
    # And now the other's again, or one's.
    change(one, max_residual=1.2)
    change(other, max_residual=3.0)
    change(one, max_residual=3.0)
    assert one._feed is other._feed
    send(one, 6)
    assert told[one]["rejected_unknown_encoding"] == "2"
    assert "rejected_unknown_encoding" not in told[other]
    # Of what comes while it is paused a node counts nothing.
    one.trigger_deactivate()
    send(other, 7)
    one.trigger_activate()
    assert one._feed is other._feed
    send(one, 8)
    assert (sent, fixed) == ({one: 14, other: 10}, {one: 6, other: 5})


def values_of(node: HorizonNode) -> dict[str, str]:
    (status,) = node.report().status
    return {pair.key: pair.value for pair in status.values}


def sent_pair(node: HorizonNode, index: int = 0, **fields: Any) -> int:
    """How many estimates one and the same pair of frames gives."""
    pipeline = node._feed.pipeline
    results = 0
    for camera in CAMERAS:
        pipeline.on_camera_info(camera, camera_info_of(camera=camera))
        gray = horizon_gray(camera, nadir_of(0.0, 0.0))
        step = pipeline.on_image(camera, image_of(gray, index * 100_000_000, **fields))
        results += len(step.results)
    return results
