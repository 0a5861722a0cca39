"""Files for other programs, held against the topics, types and services of the running nodes."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
import yaml
from craft import ESTIMATES
from horizon_messages import write_parameters
from node_processes import Listener, Program
from rclpy.node import NodeNameNonExistentError

CONFIG = Path(__file__).parents[3] / "config"
INTEGRATION = CONFIG / "integration"
LATE = {
    "local_vertical_node": {"/clock", "/coarse_pose", "/imu"},
    "attitude_node": {"/clock", "/coarse_pose", "/imu"},
    "target_pose_node": {"/clock"},
}
NODES = tuple(LATE)
POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"

pytestmark = pytest.mark.usefixtures("environment")


@dataclass(frozen=True)
class Graph:
    """Types of the topics that each node publishes and listens to; its services; all statuses."""

    published: dict[str, dict[str, str]]
    heard: dict[str, dict[str, str]]
    services: dict[str, set[str]]
    statuses: set[str]

    def topics(self) -> dict[str, str]:
        """All topics and their types."""
        return {
            topic: kind
            for side in (self.published, self.heard)
            for topics in side.values()
            for topic, kind in topics.items()
        }


@pytest.fixture(scope="module")
def graph(
    environment: dict[str, str], ros_domain: int, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Graph]:
    """Of the nodes in processes of their own, and of `horizon_sensor` without any of them."""
    path = write_parameters(tmp_path_factory.mktemp("graph") / "params.yaml", use_sim_time="true")
    arguments = ("--params-file", str(path))
    programs = [Program(name, environment, *arguments) for name in NODES]
    listener = Listener(ros_domain)
    try:
        listener.wait(lambda: len({s.name for s in listener.statuses()}) == len(NODES), "nodes")

        def complete() -> Graph | None:
            try:
                found = _graph(listener)
            except NodeNameNonExistentError:
                return None  # heard, but not yet in this process's graph
            # The clock, a service of each lifecycle and what aids come late in a node's start.
            there = all(
                late <= found.heard[node].keys()
                and f"/{node}/get_type_description" in found.services[node]
                for node, late in LATE.items()
            )
            return found if there and len(found.topics()) > 15 else None

        yield listener.wait(complete, "the whole graph")
    finally:
        listener.close()
        for program in programs:
            program.make_end()


def _graph(listener: Listener) -> Graph:
    node = listener.node

    def of(call: Any) -> dict[str, dict[str, str]]:
        return {name: {topic: kinds[0] for topic, kinds in call(name, "/")} for name in NODES}

    return Graph(
        of(node.get_publisher_names_and_types_by_node),
        of(node.get_subscriber_names_and_types_by_node),
        {name: set(found) for name, found in of(node.get_service_names_and_types_by_node).items()},
        {status.name for status in listener.statuses()},
    )


def resolved(name: str, node: str) -> str:
    name = name.replace("~", f"/{node}", 1)
    return name if name.startswith("/") else f"/{name}"


def allowed(profile: ET.Element, kind: str, how: str) -> set[str]:
    """Names in a profile of the policy, as the graph has them."""
    return {
        resolved(str(element.text), profile.attrib["node"])
        for group in profile.findall(f"{kind}s")
        if group.get(how) == "ALLOW"
        for element in group.findall(kind)
    }


def test_the_security_policy_allows_what_the_nodes_do_and_no_more(graph: Graph) -> None:
    policy = ET.parse(CONFIG / "security" / "policy.xml").getroot()
    assert policy.tag == "policy"
    assert policy.attrib["version"] == "0.2.0"
    seen = set()
    for enclave in policy.iter("enclave"):
        for profile in enclave.iter("profile"):
            node = profile.attrib["node"]
            assert profile.attrib["ns"] == "/"
            if node not in NODES:
                continue
            seen.add((enclave.attrib["path"], node))
            assert allowed(profile, "topic", "publish") == set(graph.published[node])
            assert allowed(profile, "topic", "subscribe") == set(graph.heard[node])
            assert allowed(profile, "service", "reply") == graph.services[node]
    alone = {(f"/horizon/{node}", node) for node in NODES}
    together = {("/horizon/horizon_sensor", node) for node in NODES}
    assert seen == alone | together


def test_robot_localization_fuses_what_is_there_and_observed(graph: Graph) -> None:
    text = (INTEGRATION / "robot_localization.yaml").read_text()
    given = yaml.safe_load(text)["ekf_filter_node"]["ros__parameters"]
    assert graph.published["attitude_node"][f"/{given['pose0']}"] == POSE
    assert graph.heard["attitude_node"][f"/{given['imu0']}"] == "sensor_msgs/msg/Imu"
    names = ("x", "y", "z", "roll", "pitch", "yaw")
    values = (*names, *(f"v{name}" for name in names), "ax", "ay", "az")
    used = {
        source: {n for n, flag in zip(values, given[f"{source}_config"], strict=True) if flag}
        for source in ("pose0", "imu0")
    }
    # Of `attitude` yaw, x and y are unobserved.
    assert used == {"pose0": {"z", "roll", "pitch"}, "imu0": {"vroll", "vpitch", "vyaw"}}
    assert given["world_frame"] == "local_level"
    assert given["base_link_frame"] == "base_link"


def test_the_aggregator_sorts_every_status(graph: Graph) -> None:
    text = (INTEGRATION / "diagnostics_aggregator.yaml").read_text()
    given = yaml.safe_load(text)["analyzers"]["ros__parameters"]
    analyzers = [value for value in given.values() if isinstance(value, dict)]
    starts = [start for analyzer in analyzers for start in analyzer["startswith"]]
    assert len(graph.statuses) == len(NODES)
    for status in graph.statuses:
        assert sum(status.startswith(start) for start in starts) == 1
    assert all(any(status.startswith(start) for status in graph.statuses) for start in starts)


RVIZ_TYPES = {
    "PoseWithCovariance": POSE,
    "Image": "sensor_msgs/msg/Image",
    "PointCloud2": "sensor_msgs/msg/PointCloud2",
}


def test_rviz_shows_topics_of_the_types_that_its_displays_take(graph: Graph) -> None:
    given = yaml.safe_load((INTEGRATION / "horizon.rviz").read_text())["Visualization Manager"]
    displays = [display for display in given["Displays"] if "Topic" in display]
    assert len(displays) == 4
    for display in displays:
        topic, kind = display["Topic"]["Value"], display["Class"].split("/")[1]
        assert graph.topics()[topic] == RVIZ_TYPES[kind]
        published = any(topic in topics for topics in graph.published.values())
        policy = display["Topic"]["Reliability Policy"]
        assert policy == ("Reliable" if published else "Best Effort")
    assert given["Global Options"]["Fixed Frame"] == "local_level"


def foxglove_paths(panels: dict[str, dict[str, Any]]) -> Iterator[str]:
    for panel in panels.values():
        for key in ("topicToRender", "topicPath"):
            if key in panel:
                yield panel[key]
        if "imageMode" in panel:
            yield panel["imageMode"]["imageTopic"]
        yield from (path["value"] for path in panel.get("paths", ()))


def test_foxglove_shows_fields_that_the_messages_have(graph: Graph) -> None:
    layout = json.loads((INTEGRATION / "foxglove_layout.json").read_text())
    panels = layout["configById"]
    paths = list(foxglove_paths(panels))
    assert len(paths) >= len(panels)
    for path in paths:
        topic, *fields = path.split(".")
        package, _, name = graph.topics()[topic].split("/")
        value = getattr(import_module(f"{package}.msg"), name)()
        for field in fields:
            name, _, index = re.fullmatch(r"(\w+)(\[(\d+)\])?", field).groups()  # type: ignore[union-attr]
            value = getattr(value, name)
            if index is not None:
                value = value[int(index)]

    def shown(part: Any) -> set[str]:
        return {part} if isinstance(part, str) else shown(part["first"]) | shown(part["second"])

    assert shown(layout["layout"]) == set(panels)


def test_every_estimate_is_in_the_graph(graph: Graph) -> None:
    assert {f"/{topic}" for topic in ESTIMATES} <= set(graph.topics())
