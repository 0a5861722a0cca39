"""The target's node as a process of its own, over real DDS."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from craft import Chaser
from horizon_messages import START_NS, write_bag
from lifecycle_msgs.msg import State, Transition
from node_processes import Program
from rcl_interfaces.srv import DescribeParameters, SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rosbags.rosbag2 import Reader
from target_messages import (
    BAD_CLOUDS,
    BAD_MESSAGES,
    cloud_of,
    good_cloud,
    rewritten,
    scan,
    stamp_of,
)

from horizon_sensor_ros.ros.pipelines.target_pipeline import TARGET_TOPICS

NODE = "target_pose_node"
POSE, _, TWIST = TARGET_TOPICS

pytestmark = pytest.mark.usefixtures("environment")


@pytest.fixture
def params(tmp_path: Path) -> list[str]:
    path = tmp_path / "params.yaml"
    path.write_text(
        "/**:\n  ros__parameters:\n    stale_after: 0.5\n    diagnostics_period: 0.2\n"
        "    max_gap: 100.0\n    max_refused: 3\n"
    )
    return ["--params-file", str(path)]


def test_bad_input_gives_a_reason_and_no_estimate_and_the_next_good_cloud_works(
    start: Callable[..., Program], chaser: Chaser, params: list[str]
) -> None:
    start(NODE, *params)
    chaser.match()
    chaser.expect(good_cloud(0), 0, POSE)
    index = 0
    for fields, _, words in BAD_MESSAGES.values():
        index += 1
        chaser.heard.clear()
        chaser.clouds.publish(good_cloud(index, **fields))
        chaser.wait_for_state("refused", words)
        assert not any(chaser.estimates(topic) for topic in TARGET_TOPICS)
        index += 1
        chaser.expect(good_cloud(index), index, *TARGET_TOPICS)
    for points, _ in BAD_CLOUDS.values():
        index += 1
        chaser.heard.clear()
        chaser.clouds.publish(cloud_of(points, stamp_of(index)))
        chaser.wait_for_state("no_fix")
        assert not any(chaser.estimates(topic) for topic in TARGET_TOPICS)
        index += 1
        chaser.expect(good_cloud(index), index, *TARGET_TOPICS)
    # Another target: no delta, and when it stays, a frame of its own.
    index += 1
    chaser.heard.clear()
    chaser.clouds.publish(good_cloud(index, "cylinder"))
    chaser.wait_for_state("no_fix")
    index += 1
    chaser.expect(good_cloud(index), index, *TARGET_TOPICS)
    for _ in range(2):
        index += 1
        chaser.heard.clear()
        chaser.clouds.publish(good_cloud(index, "cylinder"))
        chaser.wait_for_state("no_fix")
    index += 1
    chaser.expect(good_cloud(index, "cylinder"), index, POSE)
    chaser.wait_for_state("new_target_frame", "track lost")
    index += 1
    chaser.expect(good_cloud(index, "cylinder"), index, *TARGET_TOPICS)
    # A stamp that repeats.
    chaser.clouds.publish(good_cloud(index, "cylinder"))
    chaser.wait_for_state("refused", "stamp repeats")
    assert all(chaser.stamps(topic).count(index) == 1 for topic in TARGET_TOPICS)
    # A gap.
    index += 600
    chaser.heard.clear()
    points = scan(1)
    chaser.expect(cloud_of(points, stamp_of(index)), index, POSE)
    chaser.wait_for_state("new_target_frame", "no fix for 120.0 s")
    # Time that runs backwards.
    chaser.heard.clear()
    chaser.expect(good_cloud(0), 0, POSE)
    chaser.wait_for_state("new_target_frame", "time jumped back")
    chaser.expect(good_cloud(1), 1, *TARGET_TOPICS)
    # Silence.
    chaser.wait_for_state("stale", "no clouds for")


def replayed(bag: Path) -> dict[str, list[Any]]:
    found: dict[str, list[Any]] = {topic: [] for topic in TARGET_TOPICS}
    with Reader(bag) as reader:
        for connection, _, raw in reader.messages():
            topic = connection.topic.strip("/")
            if topic in found:
                found[topic].append(deserialize_message(raw, TARGET_TOPICS[topic]))
    return found


@pytest.mark.parametrize("program", [NODE, "horizon_sensor"])
def test_live_equals_replay(
    start: Callable[..., Program],
    chaser: Chaser,
    params: list[str],
    tmp_path: Path,
    environment: dict[str, str],
    program: str,
) -> None:
    clouds = [good_cloud(i) for i in range(6)]
    clouds[2] = good_cloud(2, **BAD_MESSAGES["no z"][0])
    clouds[4] = cloud_of(BAD_CLOUDS["a plane"][0], stamp_of(4))
    plain = scan(6)
    clouds += [cloud_of(plain[np.isfinite(plain[..., 2])], stamp_of(6))]
    clouds += [rewritten(good_cloud(7), ">", (20, 3, 11), 31)]
    # Time jumps back.
    clouds += [good_cloud(0), good_cloud(1)]
    bag = write_bag(
        tmp_path / "in", [("/target/points", START_NS + i, c) for i, c in enumerate(clouds)]
    )
    command = [sys.executable, "-m", "horizon_sensor_ros.tools.bags.replay", str(bag)]
    command += [str(tmp_path / "out"), "--params", params[1]]
    subprocess.run(command, check=True, env=environment, stderr=subprocess.DEVNULL)
    expected = replayed(tmp_path / "out")
    assert [len(messages) for messages in expected.values()] == [8, 6, 6]

    node = start(program, *params, *(() if program == NODE else ("-p", f"nodes:=[{NODE}]")))
    chaser.match()
    given = 0
    for number, cloud in enumerate(clouds):
        chaser.clouds.publish(cloud)
        given += number not in (2, 4)
        if number in (2, 4):
            chaser.wait_for_state("refused" if number == 2 else "no_fix")
        chaser.wait(lambda given=given: len(chaser.estimates(POSE)) >= given, f"cloud {number}")
    chaser.wait(lambda: len(chaser.estimates(TWIST)) >= 6, "the last twist")
    for topic, messages in expected.items():
        assert chaser.estimates(topic) == messages
    assert node.end()[0] == 0


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_signals_end_the_node_quietly(
    start: Callable[..., Program], chaser: Chaser, params: list[str], how: int
) -> None:
    program = start(NODE, *params)
    chaser.wait(chaser.statuses, "diagnostics")
    assert program.end(how) == (0, "")


def test_a_node_that_is_shut_down_says_so_at_once(
    start: Callable[..., Program], chaser: Chaser, params: list[str]
) -> None:
    start(NODE, *params, "-p", "stale_after:=1000.0")
    chaser.match()
    chaser.hear_of_changes_only(NODE)
    chaser.expect(good_cloud(0), 0, POSE)
    assert chaser.transition(NODE, Transition.TRANSITION_ACTIVE_SHUTDOWN)
    chaser.wait_for_state("inactive")
    assert chaser.statuses(NODE)[-1].values[0].value == "inactive"


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ("max_gap:=-1.0", ["max_gap", "-1.0"]),
        ("target_frame:=3", ["target_frame must be a string"]),
        ("range_noise:=much", ["range_noise must be a double"]),
        ("qos_overrides./target/points.subscription.reliability:=psychic", ["psychic"]),
    ],
)
def test_the_node_refuses_to_start_in_one_clear_line(
    start: Callable[..., Program], params: list[str], given: str, words: list[str]
) -> None:
    code, errors = start(NODE, *params, "-p", given).wait()
    assert code != 0
    assert len(errors.splitlines()) == 1, errors
    for word in words:
        assert word in errors


def test_the_shipped_parameters_start_it_without_a_word(
    start: Callable[..., Program], chaser: Chaser
) -> None:
    shipped = Path(__file__).parents[3] / "config" / "params.yaml"
    program = start(NODE, "--params-file", str(shipped))
    chaser.match()
    chaser.expect(good_cloud(0), 0, POSE)
    chaser.expect(good_cloud(1), 1, *TARGET_TOPICS)
    assert program.end() == (0, "")


def test_lifecycle(start: Callable[..., Program], chaser: Chaser, params: list[str]) -> None:
    start(NODE, *params, "-p", "autostart:=false")
    assert chaser.state(NODE) == State.PRIMARY_STATE_UNCONFIGURED
    assert chaser.transition(NODE, Transition.TRANSITION_CONFIGURE)
    chaser.wait_for_state("inactive")
    assert chaser.node.count_subscribers("/target/points") == 0
    for first in (0, 2):
        assert chaser.transition(NODE, Transition.TRANSITION_ACTIVATE)
        chaser.match()
        # After a pause the target may be any other: a frame of its own.
        chaser.expect(good_cloud(first), first, POSE)
        chaser.expect(good_cloud(first + 1), first + 1, *TARGET_TOPICS)
        assert chaser.transition(NODE, Transition.TRANSITION_DEACTIVATE)
        chaser.wait(lambda: chaser.node.count_subscribers("/target/points") == 0, "silence")
        chaser.heard.clear()
        chaser.wait_for_state("inactive")
    assert chaser.transition(NODE, Transition.TRANSITION_CLEANUP)
    assert chaser.transition(NODE, Transition.TRANSITION_CONFIGURE)
    assert chaser.transition(NODE, Transition.TRANSITION_ACTIVATE)
    chaser.heard.clear()
    chaser.match()
    chaser.expect(good_cloud(5), 5, POSE)
    assert chaser.transition(NODE, Transition.TRANSITION_ACTIVE_SHUTDOWN)
    assert chaser.state(NODE) == State.PRIMARY_STATE_FINALIZED


def test_parameters_describe_themselves_and_some_are_live(
    start: Callable[..., Program], chaser: Chaser, params: list[str]
) -> None:
    start(NODE, *params)
    chaser.match()
    request = DescribeParameters.Request(names=["max_gap", "range_noise"])
    gap, noise = chaser.call(
        DescribeParameters, f"/{NODE}/describe_parameters", request
    ).descriptors
    assert not gap.read_only
    assert noise.read_only
    assert "[m]" in noise.description

    def set_one(name: str, value: Any) -> Any:
        request = SetParameters.Request(
            parameters=[Parameter(name, value=value).to_parameter_msg()]
        )
        return chaser.call(SetParameters, f"/{NODE}/set_parameters", request).results[0]

    chaser.expect(good_cloud(0), 0, POSE)
    assert not set_one("range_noise", 0.01).successful
    assert not set_one("min_score", 2.0).successful
    assert set_one("min_points", 100000).successful
    chaser.clouds.publish(good_cloud(1))
    chaser.wait_for_state("no_fix", "100000 needed")
    # The track is still there.
    assert set_one("min_points", 100).successful
    assert set_one("diagnostics_period", 0.05).successful
    chaser.heard.clear()
    chaser.wait(lambda: len(chaser.statuses()) >= 10, "reports at the new rate")
    chaser.expect(good_cloud(2), 2, *TARGET_TOPICS)


def test_quality_of_service_and_its_override(
    start: Callable[..., Program], chaser: Chaser, params: list[str]
) -> None:
    program = start(NODE, *params)
    chaser.match()
    for topic in TARGET_TOPICS:
        (output,) = chaser.node.get_publishers_info_by_topic(f"/{topic}")
        assert output.qos_profile.reliability == ReliabilityPolicy.RELIABLE
    (cloud,) = chaser.node.get_subscriptions_info_by_topic("/target/points")
    assert cloud.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
    program.end()
    chaser.wait(lambda: chaser.node.count_subscribers("/target/points") == 0, "end")
    override = "qos_overrides./target/points.subscription.reliability:=reliable"
    start(NODE, *params, "-p", override)
    chaser.match()
    (cloud,) = chaser.node.get_subscriptions_info_by_topic("/target/points")
    assert cloud.qos_profile.reliability == ReliabilityPolicy.RELIABLE
