"""The nodes as processes of their own, over real DDS."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from builtin_interfaces.msg import Time
from craft import ESTIMATES, Chaser, Craft
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped, Vector3Stamped
from horizon_messages import (
    CAMERAS,
    HEIGHT,
    PERIOD_NS,
    START_NS,
    WIDTH,
    attitude_at,
    camera_info_of,
    coarse_pose_of,
    imu_of,
    nadir_of,
    recording,
    write_bag,
    write_parameters,
)
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState
from node_processes import Program
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import DescribeParameters, SetParameters, SetParametersAtomically
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rosbags.rosbag2 import Reader
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Image, Imu
from target_messages import good_cloud

from horizon_sensor_ros.ros.messages.stamps import time_from_ns
from horizon_sensor_ros.ros.pipelines.target_pipeline import TARGET_TOPICS

NODES = ("local_vertical_node", "attitude_node")
IMAGE_QOS = "qos_overrides./camera_1/image_raw.subscription"
ATTITUDE_QOS = "qos_overrides./attitude.publisher"

pytestmark = pytest.mark.usefixtures("environment")


@pytest.fixture
def params(tmp_path: Path) -> list[str]:
    # A busy machine may keep a process waiting for a second.
    path = write_parameters(tmp_path / "params.yaml", stale_after=3.0, diagnostics_period=0.2)
    return ["--params-file", str(path)]


def test_a_camera_that_falls_silent_is_flown_without_until_it_is_back(
    start: Callable[..., Program], craft: Craft, params: list[str]
) -> None:
    for name in NODES:
        start(name, *params, "-p", "camera_timeout:=1.0")
    craft.match(NODES)
    craft.expect_pair(0)
    index = 0
    for node in NODES:
        words = "camera_2 left out: no usable frames for longer than"
        index = craft.insist_by_one("camera_1", index, node, words)
    craft.heard.clear()
    index += 1
    craft.send_frame("camera_1", index)
    craft.wait(lambda: all(index in craft.stamps(topic) for topic in ESTIMATES), "one camera's fix")
    vertical = craft.estimates("local_vertical")[-1].vector
    off = np.array([vertical.x, vertical.y, vertical.z]) - nadir_of(*attitude_at(index))
    assert np.degrees(np.linalg.norm(off)) < 0.3
    # The first pair may come one frame after the other, and be a fix of the first one alone.
    for _ in range(2):
        index += 1
        craft.expect_pair(index)
    for node in NODES:
        craft.wait_for_state("ok", "fix from camera_1, camera_2", node)


def replayed(bag: Path) -> dict[str, list[Any]]:
    found: dict[str, list[Any]] = {topic: [] for topic in ESTIMATES}
    with Reader(bag) as reader:
        for connection, _, raw in reader.messages():
            topic = connection.topic.strip("/")
            if topic in found:
                found[topic].append(deserialize_message(raw, ESTIMATES[topic]))
    return found


@pytest.mark.parametrize("together", [False, True], ids=["two processes", "one process"])
def test_live_equals_replay(
    start: Callable[..., Program],
    craft: Craft,
    params: list[str],
    tmp_path: Path,
    environment: dict[str, str],
    together: bool,
) -> None:
    flight = recording(8)
    # Every other run's third frame is of no use, as things happen in flight.
    flight[8] = (*flight[8][:2], camera_info_of(0, "camera_1", k=[0.0] * 9))
    bag = write_bag(tmp_path / "in", flight)
    command = [sys.executable, "-m", "horizon_sensor_ros.tools.bags.replay", str(bag)]
    command += [str(tmp_path / "out"), "--params", params[1]]
    subprocess.run(command, check=True, env=environment, stderr=subprocess.DEVNULL)
    expected = replayed(tmp_path / "out")
    assert [len(msgs) for msgs in expected.values()] == [7, 7]

    programs = (
        [start("horizon_sensor", *params)] if together else [start(n, *params) for n in NODES]
    )
    craft.match(NODES, len(programs))
    for count, (topic, _, msg) in enumerate(flight, 1):
        craft.send(topic, msg)
        if count % 4 == 0:
            pairs = count // 4 - (count >= 12)
            craft.wait(
                lambda pairs=pairs: all(len(craft.estimates(t)) >= pairs for t in ESTIMATES),
                f"pair {pairs}",
            )
    for topic, messages in expected.items():
        assert craft.estimates(topic) == messages
    for program in programs:
        assert program.end()[0] == 0


@pytest.mark.parametrize(
    ("name", "how"),
    [
        ("local_vertical_node", signal.SIGINT),
        ("attitude_node", signal.SIGTERM),
        ("horizon_sensor", signal.SIGINT),
        ("horizon_sensor", signal.SIGTERM),
    ],
)
def test_signals_end_a_node_quietly(
    start: Callable[..., Program], craft: Craft, params: list[str], name: str, how: int
) -> None:
    program = start(name, *params)
    craft.wait(craft.statuses, "diagnostics")
    assert program.end(how) == (0, "")


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("what", ["a frame", "a cloud"])
def test_a_signal_in_the_midst_of_the_work_breaks_it_off_without_a_word(
    start: Callable[..., Program],
    craft: Craft,
    chaser: Chaser,
    params: list[str],
    what: str,
    how: int,
) -> None:
    script = Path(__file__).parents[2] / "support" / "interrupted_nodes.py"
    program = start("horizon_sensor", *params, before=(str(script), str(int(how))))
    # Not asked for by a service: a server may warn of an answer that nobody waited for.
    craft.wait_for_state("waiting", "no clouds yet", "target_pose_node")
    listener = craft if what == "a frame" else chaser
    index = 0
    while program.process.poll() is None:
        # The first ones after a match may be lost.
        index += 1
        assert index < 200
        if what == "a frame":
            craft.send_pair(index)
        else:
            chaser.clouds.publish(good_cloud(index))
        listener.spin(0.1)
    assert program.wait() == (0, "")
    assert not any(map(craft.estimates, ESTIMATES))
    assert not any(map(chaser.estimates, TARGET_TOPICS))


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_signals_that_come_again_while_a_node_ends_do_not_kill_it(
    start: Callable[..., Program], craft: Craft, params: list[str], how: int
) -> None:
    # A terminal's Ctrl-C reaches the node by itself and once more from `ros2 launch`.
    program = start("attitude_node", *params)
    craft.wait(craft.statuses, "diagnostics")
    while program.process.poll() is None:
        program.process.send_signal(how)
        time.sleep(0.0001)
    assert program.end(how) == (0, "")


# Ends again and again beneath signals that never pause: of 300 ends some meet one halfway.
_ENDS = """
import os, signal, subprocess, sys, time
from horizon_sensor_ros.ros.process.executable import _QuietEnd
hammer = "import os, signal, sys\\nwhile True: os.kill(int(sys.argv[1]), signal.SIGINT)"
end = _QuietEnd()
end.immediately = False
hammers = [subprocess.Popen([sys.executable, "-c", hammer, str(os.getpid())]) for _ in range(2)]
time.sleep(0.3)
for _ in range(300):
    end.begin()
    signal.signal(signal.SIGINT, end._on_signal)
    time.sleep(0.001)
end.begin()
for each in hammers:
    each.kill()
"""


def test_a_signal_just_as_signals_begin_to_be_ignored_is_not_told() -> None:
    run = subprocess.run(
        [sys.executable, "-c", _ENDS], check=False, capture_output=True, text=True, timeout=60
    )
    assert (run.returncode, run.stderr) == (0, "")


@pytest.mark.parametrize(
    ("how", "delay_s"),
    [(signal.SIGINT, 0.0), (signal.SIGTERM, 0.1), (signal.SIGINT, 0.3), (signal.SIGTERM, 0.6)],
)
def test_signals_during_start_up_end_a_node_quietly(
    start: Callable[..., Program], params: list[str], how: int, delay_s: float
) -> None:
    program = start("attitude_node", *params)
    caught = 0
    while not caught >> (signal.SIGTERM - 1) & 1:
        # Before this the process is python itself, which knows of no nodes.
        text = Path(f"/proc/{program.process.pid}/status").read_text()
        (line,) = [line for line in text.splitlines() if line.startswith("SigCgt")]
        caught = int(line.split()[1], 16)
    time.sleep(delay_s)
    assert program.end(how) == (0, "")


@pytest.mark.parametrize(
    ("name", "given", "words"),
    [
        ("local_vertical_node", None, ["camera_1.rotation is not set"]),
        ("attitude_node", None, ["camera_1.rotation is not set", "/** or the node's own name"]),
        ("horizon_sensor", None, ["camera_1.rotation is not set"]),
        ("attitude_node", "camera_2.rotation:=[0.0, 0.0, 0.0, 2.0]", ["camera_2.rotation", "1"]),
        ("attitude_node", "planet_radius:=-5.0", ["planet_radius", "-5.0"]),
        ("attitude_node", "planet:=flat", ["planet must be one of", "flat"]),
        ("attitude_node", "slop:=soon", ["slop must be a double"]),
        ("attitude_node", "cameras:=[]", ["an empty list"]),
        ("attitude_node", "extrinsics_source:=tf", ["tf2_ros"]),
        ("attitude_node", "camera_1.mask:=/no/mask.png", ["camera_1.mask", "/no/mask.png"]),
        ("horizon_sensor", "nodes:=[sextant]", ["nodes must be some of", "sextant"]),
        ("horizon_sensor", "nodes:=[]", ["nodes must be some of", "got none"]),
        *(
            ("attitude_node", f"{name}:={value}", [f"{name} must be {words}", value])
            for name, value, words in (
                (f"{IMAGE_QOS}.reliability", "psychic", "one of"),
                (f"{IMAGE_QOS}.reliability", "3", "a string"),
                (f"{IMAGE_QOS}.depth", "-1", "0 to"),
                (f"{IMAGE_QOS}.depth", "5.5", "an integer"),
                (f"{ATTITUDE_QOS}.depth", "5000000000000", "0 to"),
                (f"{ATTITUDE_QOS}.history", "unknown", "one of"),
            )
        ),
    ],
)
def test_a_node_refuses_to_start_in_one_clear_line(
    start: Callable[..., Program], params: list[str], name: str, given: str | None, words: list
) -> None:
    arguments = [*params, "-p", given] if given else []
    code, errors = start(name, *arguments).wait()
    assert code != 0
    assert len(errors.splitlines()) == 1, errors
    for word in words:
        assert word in errors


def test_an_empty_list_does_not_leave_what_the_file_has(
    start: Callable[..., Program], tmp_path: Path
) -> None:
    path = write_parameters(tmp_path / "params.yaml", cameras=["camera_1"])
    given = ["-p", "cameras:=[]"]
    code, errors = start("attitude_node", "--params-file", str(path), *given).wait()
    assert code == 1
    assert errors.startswith("attitude_node: cameras was given an empty list: name its values")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "cannot be read: No such file"),
        ("camera_1: {rotation: [0, 0.5, 0, 1]}", "camera_1.rotation (of /**) mixes whole numbers"),
        ("cameras: [camera_1, 2]", "cameras (of /**) mixes values of several kinds"),
        ("cameras: []", "cameras (of /**) is an empty list: name its values"),
        ("cameras: [camera_1", "is not valid YAML"),
    ],
)
def test_what_is_wrong_with_a_parameter_file_is_said(
    start: Callable[..., Program], tmp_path: Path, content: str | None, words: str
) -> None:
    path = tmp_path / "mine.yaml"
    if content is not None:
        path.write_text(f"/**:\n  ros__parameters:\n    {content}\n")
    code, errors = start("attitude_node", "--params-file", str(path)).wait()
    assert code == 1
    # Before it rcl may say in a line of its own that something is wrong.
    *before, last = errors.splitlines()
    assert last.startswith(f"attitude_node: {path}")
    assert words in last
    assert all("[rcl]" in line for line in before), errors


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("camera_1: {rotation: [0.0, 0.0, 0.0, 1.0]}\n", "it has no ros__parameters"),
        ("/**:\n  ros_parameters:\n    slop: 0.1\n", "it has no ros__parameters"),
        ("/**:\n  ros__parameters:\n  slop: 0.1\n", "has nothing under ros__parameters"),
        ("/**: {ros__parameters: {slop: 0.1}}\nb: {slop: 1}\n", "has b/slop outside of"),
    ],
)
def test_what_stands_where_ros_takes_no_parameters_is_said(
    start: Callable[..., Program], tmp_path: Path, text: str, words: str
) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    code, errors = start("attitude_node", "--params-file", str(path)).wait()
    assert code == 1
    last = errors.splitlines()[-1]
    assert last.startswith(f"attitude_node: {path}")
    assert words in last


CLOSED = """
import os, sys
for number in {numbers}:
    os.close(number)
module = "horizon_sensor_ros.ros.attitude_node"
os.execv(sys.executable, [sys.executable, "-m", module, *sys.argv[1:]])
"""


@pytest.mark.parametrize("numbers", [(2,), (0, 1, 2)])
def test_a_node_starts_without_standard_streams(
    start: Callable[..., Program], craft: Craft, params: list[str], numbers: tuple[int, ...]
) -> None:
    """As some launchers have them."""
    program = start("attitude_node", *params, before=["-c", CLOSED.format(numbers=numbers)])
    craft.match(("attitude_node",))
    assert program.end() == (0, "")


def test_help_into_a_full_disk_is_no_traceback() -> None:
    command = [sys.executable, "-m", "horizon_sensor_ros.ros.attitude_node", "--help"]
    with open("/dev/full", "w", encoding="utf-8") as full:
        done = subprocess.run(
            command, stdout=full, stderr=subprocess.PIPE, text=True, timeout=60.0, check=False
        )
    assert done.stderr == ""
    assert done.returncode == 0


def ended(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """A node's process that ends by itself; arguments as they are."""
    return subprocess.run(
        [sys.executable, "-m", "horizon_sensor_ros.ros.attitude_node", *arguments],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        timeout=60.0,
        check=False,
    )


def test_without_ros_a_node_says_so_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "rclpy.py").write_text("raise ImportError('librcl.so: cannot open')")
    path = filter(None, [os.environ.get("PYTHONPATH")])
    done = ended(PYTHONPATH=os.pathsep.join([str(tmp_path), *path]))
    said = "attitude_node: rclpy cannot be loaded: librcl.so: cannot open; is ROS sourced?\n"
    assert (done.returncode, done.stdout, done.stderr) == (1, "", said)


def test_where_no_log_can_be_written_the_cure_is_said(tmp_path: Path) -> None:
    """As on a file system that is read only."""
    (tmp_path / "file").touch()
    done = ended(ROS_LOG_DIR=str(tmp_path / "file" / "log"))
    assert done.returncode == 1
    last = done.stderr.splitlines()[-1]
    assert str(tmp_path / "file" / "log") in last
    assert last.endswith("; set ROS_LOG_DIR to a folder that can be written to")


def test_an_argument_that_ros_does_not_know_is_said(start: Callable[..., Program]) -> None:
    code, errors = start("attitude_node", "--bad").wait()
    assert code == 1
    assert errors == "attitude_node: unknown ROS argument '--bad'\n"


@pytest.mark.parametrize("arguments", [["--bogus"], ["--params-file", "mine.yaml"]])
def test_arguments_that_are_not_rosses_are_not_ignored(arguments: list[str]) -> None:
    done = ended(*arguments)
    assert done.returncode == 1
    expected = f"unknown argument {arguments[0]}: ROS arguments go after --ros-args"
    assert done.stderr == f"attitude_node: {expected}\n"


def test_a_time_that_is_neither_is_refused(
    start: Callable[..., Program], params: list[str]
) -> None:
    code, errors = start("attitude_node", *params, "-p", "use_sim_time:=3").wait()
    assert code == 1
    # rclpy says it too, and goes on by the wall clock.
    assert errors.endswith("attitude_node: use_sim_time must be true or false, got 3\n")


def test_a_name_for_the_process_leaves_its_nodes_theirs(
    start: Callable[..., Program], craft: Craft, params: list[str]
) -> None:
    """As `Node(executable="horizon_sensor", name="sensors")` in a launch file gives it."""
    start("horizon_sensor", *params, "-r", "__node:=sensors")
    for name in (*NODES, "target_pose_node"):
        craft.wait(lambda name=name: craft.state(name) == State.PRIMARY_STATE_ACTIVE, name)
    craft.wait(lambda: "sensors" in craft.node.get_node_names(), "the process's own node")


def test_the_same_nodes_of_two_craft_are_told_apart(
    start: Callable[..., Program], craft: Craft, params: list[str]
) -> None:
    names = {f"/craft_{each}/attitude_node" for each in "ab"}
    for name in names:
        start("attitude_node", *params, "-r", f"__ns:={name.removesuffix('/attitude_node')}")
    craft.wait(lambda: {status.hardware_id for status in craft.statuses()} == names, "both")
    craft.heard.clear()
    for name in names:
        assert craft.transition(name.strip("/"), Transition.TRANSITION_DEACTIVATE)
    craft.wait_for_state("inactive")
    assert {status.hardware_id for status in craft.statuses()} <= names


def test_whole_numbers_and_unknown_parameters(
    start: Callable[..., Program], craft: Craft, params: list[str]
) -> None:
    program = start(
        *("local_vertical_node", *params, "-p", "planet_radius:=6371000"),
        *("-p", "cameras:=[camera_1]", "-p", "camera_1.rotation:=[0, 0, 0, 1]"),
        *("-p", "planet_raduis:=1.0", "-p", "camera1.gamma:=2.2"),
    )
    craft.match(("local_vertical_node",), cameras=("camera_1",))
    code, errors = program.end()
    assert code == 0, errors
    lines = errors.splitlines()
    assert len(lines) == 2, errors
    for name, meant in (("planet_raduis", "planet_radius"), ("camera1.gamma", "camera_1.gamma")):
        told = f"unknown parameter {name} is ignored; did you mean {meant}?"
        assert any(told in line for line in lines), errors


def test_sections_of_a_file_that_reach_no_node_are_said(
    start: Callable[..., Program], craft: Craft, params: list[str], tmp_path: Path
) -> None:
    """Else what they say is missing without a word: which way z points, or what is believed."""
    path = tmp_path / "more.yaml"
    sections = ("atitude_node", "attitude_node", "driver", "other/attitude_node")
    text = "{}: {{ros__parameters: {{level_z: down}}}}\n"
    path.write_text("".join(map(text.format, sections)))
    given = (*params, "--params-file", str(path), "-r", "__ns:=/sat1")
    program = start("attitude_node", *given)
    craft.wait(lambda: any("/sat1/" in each.hardware_id for each in craft.statuses()), "a report")
    code, errors = program.end()
    assert code == 0
    lines = [line.partition("[sat1.attitude_node]: ")[2] for line in errors.splitlines()]
    assert lines == [
        f"section atitude_node is for no node: attitude_node? ({path})",
        "section attitude_node is for /attitude_node, not for /sat1/attitude_node: "
        f"/**/attitude_node? ({path})",
    ]


@pytest.mark.parametrize("given", ["[attitude_node]", "attitude_node"])
def test_the_nodes_of_a_process_are_a_parameter_that_all_know(
    start: Callable[..., Program], craft: Craft, params: list[str], given: str
) -> None:
    program = start("horizon_sensor", *params, "-p", f"nodes:={given}")
    craft.match(("attitude_node",))
    request = DescribeParameters.Request(names=["nodes"])
    answer = craft.call(DescribeParameters, "/horizon_sensor/describe_parameters", request)
    assert answer.descriptors[0].read_only
    assert program.end() == (0, "")


def test_lifecycle(start: Callable[..., Program], craft: Craft, params: list[str]) -> None:
    node = "attitude_node"
    start(node, *params, "-p", "autostart:=false")
    assert craft.state(node) == State.PRIMARY_STATE_UNCONFIGURED
    assert craft.node.count_subscribers("/camera_1/image_raw") == 0
    assert craft.transition(node, Transition.TRANSITION_CONFIGURE)
    craft.wait_for_state("inactive")
    index = 0
    for _ in range(2):
        assert craft.transition(node, Transition.TRANSITION_ACTIVATE)
        craft.match((node,))
        index += 1
        craft.expect_pair(index, ("attitude",))
        assert craft.transition(node, Transition.TRANSITION_DEACTIVATE)
        craft.wait(lambda: craft.node.count_subscribers("/camera_1/image_raw") == 0, "silence")
        craft.heard.clear()
        craft.wait_for_state("inactive")
    assert craft.transition(node, Transition.TRANSITION_CLEANUP)
    assert craft.state(node) == State.PRIMARY_STATE_UNCONFIGURED
    assert craft.transition(node, Transition.TRANSITION_CONFIGURE)
    assert craft.transition(node, Transition.TRANSITION_ACTIVATE)
    craft.heard.clear()
    craft.match((node,))
    craft.expect_pair(index + 1, ("attitude",))
    assert craft.transition(node, Transition.TRANSITION_ACTIVE_SHUTDOWN)
    assert craft.state(node) == State.PRIMARY_STATE_FINALIZED


@pytest.mark.parametrize(
    "transition",
    [Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_ACTIVE_SHUTDOWN],
    ids=["deactivated", "shut down"],
)
def test_a_node_that_ceases_to_work_says_so_at_once(
    start: Callable[..., Program],
    craft: Craft,
    params: list[str],
    transition: int,
) -> None:
    node = "attitude_node"
    start(node, *params, "-p", "stale_after:=1000.0")
    craft.match((node,))
    craft.hear_of_changes_only(node)
    craft.expect_pair(0, ("attitude",))
    craft.wait_for_state("ok")
    assert craft.transition(node, transition)
    craft.wait_for_state("inactive")
    if transition == Transition.TRANSITION_DEACTIVATE:
        craft.heard.clear()
        assert craft.transition(node, Transition.TRANSITION_CLEANUP)
        craft.wait_for_state("inactive")
    assert craft.statuses(node)[-1].values[0].value == "inactive"


@pytest.mark.parametrize("autostart", ["true", "false"])
def test_why_a_node_cannot_be_configured_again_is_said(
    start: Callable[..., Program], craft: Craft, tmp_path: Path, autostart: str
) -> None:
    node = "attitude_node"
    mask = tmp_path / "mask.png"
    cv2.imwrite(str(mask), np.full((HEIGHT, WIDTH), 255, np.uint8))
    path = write_parameters(tmp_path / "masked.yaml", **{"camera_1.mask": f"'{mask}'"})
    program = start(node, "--params-file", str(path), "-p", f"autostart:={autostart}")
    steps = [Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE]
    if autostart == "true":
        craft.wait(lambda: craft.state(node) == State.PRIMARY_STATE_ACTIVE, "the node")
        steps.clear()
    for step in (*steps, Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_CLEANUP):
        assert craft.transition(node, step)
    mask.unlink()
    assert not craft.transition(node, Transition.TRANSITION_CONFIGURE)
    assert craft.state(node) == State.PRIMARY_STATE_UNCONFIGURED
    code, errors = program.end()
    assert code == 0
    (line,) = errors.splitlines()
    assert f"[{node}]: ValueError: there is no file {mask}" in line


def test_a_transition_that_the_state_does_not_have_is_refused(
    start: Callable[..., Program], craft: Craft, params: list[str]
) -> None:
    node = "attitude_node"
    program = start(node, *params, "-p", "autostart:=false")
    craft.wait(lambda: craft.state(node) == State.PRIMARY_STATE_UNCONFIGURED, "the node")

    def refused(number: int) -> bool:
        request = ChangeState.Request(transition=Transition(id=number))
        return not craft.call(ChangeState, f"/{node}/change_state", request).success

    for number in (Transition.TRANSITION_ACTIVATE, Transition.TRANSITION_CLEANUP, 99):
        assert refused(number)
    assert craft.state(node) == State.PRIMARY_STATE_UNCONFIGURED
    for number in (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE):
        assert craft.transition(node, number)
        assert refused(number)
    craft.match((node,))
    craft.expect_pair(0, ("attitude",))
    code, errors = program.end()
    assert code == 0
    # Each is told by the lifecycle's library and by the node.
    expected = ("No transition matching", "refused: the node is")
    assert errors.count(expected[1]) >= 5
    assert all(any(words in line for words in expected) for line in errors.splitlines()), errors


def test_parameters_describe_themselves_and_some_are_live(
    start: Callable[..., Program], craft: Craft, params: list[str]
) -> None:
    node = "attitude_node"
    start(node, *params)
    craft.match((node,))
    request = DescribeParameters.Request(names=["slop", "planet_radius", "camera_1.rotation"])
    slop, radius, rotation = craft.call(
        DescribeParameters, f"/{node}/describe_parameters", request
    ).descriptors
    assert not slop.read_only
    assert slop.floating_point_range[0].to_value == 10.0
    assert radius.read_only
    assert "[m]" in radius.description
    assert rotation.read_only

    def set_one(name: str, value: Any) -> Any:
        request = SetParameters.Request(
            parameters=[Parameter(name, value=value).to_parameter_msg()]
        )
        return craft.call(SetParameters, f"/{node}/set_parameters", request).results[0]

    craft.expect_pair(0, ("attitude",))
    assert not set_one("planet_radius", 1.0e6).successful
    assert not set_one("slop", -1.0).successful
    refused = set_one("altitude_min", 1e11)
    assert not refused.successful
    assert "altitude" in refused.reason
    assert set_one("altitude_min", 1e6).successful
    craft.heard.clear()
    craft.send_pair(1)
    craft.wait_for_state("no_fix", "altitude")
    assert not craft.stamps("attitude")
    assert set_one("altitude_min", 1e5).successful
    craft.expect_pair(2, ("attitude",))


@pytest.mark.parametrize("node", ["attitude_node", "horizon_sensor"])
def test_values_of_no_type_are_refused_and_the_node_lives_on(
    start: Callable[..., Program], craft: Craft, params: list[str], node: str
) -> None:
    program = start(node, *params)
    odd = ParameterMessage(name="use_sim_time", value=ParameterValue(type=99))
    good = Parameter("use_sim_time", value=False).to_parameter_msg()
    each = craft.call(
        SetParameters, f"/{node}/set_parameters", SetParameters.Request(parameters=[odd, good])
    ).results
    assert [result.successful for result in each] == [False, True]
    together = craft.call(
        SetParametersAtomically,
        f"/{node}/set_parameters_atomically",
        SetParametersAtomically.Request(parameters=[good, odd]),
    ).result
    for refused in (each[0], together):
        assert not refused.successful
        assert refused.reason == "use_sim_time: there is no type 99 of parameters"
    assert program.end() == (0, "")


def test_quality_of_service_and_its_override(
    start: Callable[..., Program], craft: Craft, params: list[str]
) -> None:
    start(
        *("attitude_node", *params),
        *("-p", "qos_overrides./camera_2/image_raw.subscription.reliability:=reliable"),
    )
    craft.match(("attitude_node",))
    (output,) = craft.node.get_publishers_info_by_topic("/attitude")
    assert output.qos_profile.reliability == ReliabilityPolicy.RELIABLE
    reliabilities = [
        craft.node.get_subscriptions_info_by_topic(f"/{camera}/image_raw")[
            0
        ].qos_profile.reliability
        for camera in CAMERAS
    ]
    assert reliabilities == [ReliabilityPolicy.BEST_EFFORT, ReliabilityPolicy.RELIABLE]
    # As the inputs' page says: what was latched before the node had started does not count.
    inputs = [f"/{camera}/{topic}" for camera in CAMERAS for topic in ("image_raw", "camera_info")]
    for name in inputs:
        (subscription,) = craft.node.get_subscriptions_info_by_topic(name)
        assert subscription.qos_profile.durability == DurabilityPolicy.VOLATILE


def test_one_process_subscribes_once_and_listens_to_names(
    start: Callable[..., Program], craft: Craft, params: list[str]
) -> None:
    start("horizon_sensor", *params)
    craft.match(NODES, 1)
    nodes = {*NODES, "horizon_sensor"}
    craft.wait(lambda: nodes <= set(craft.node.get_node_names()), "the names of all nodes")
    craft.expect_pair(0)
    # The node that holds the subscriptions pauses; the other takes over.
    for index, (pausing, working) in enumerate((NODES, NODES[::-1]), 1):
        topic = "attitude" if working == "attitude_node" else "local_vertical"
        assert craft.transition(pausing, Transition.TRANSITION_DEACTIVATE)
        craft.match((working,), 1)
        craft.heard.clear()
        craft.expect_pair(index, (topic,))
        assert len(craft.stamps("attitude")) + len(craft.stamps("local_vertical")) == 1
        assert craft.transition(pausing, Transition.TRANSITION_ACTIVATE)


def test_topics_that_help_are_heard_and_spoken_of(
    start: Callable[..., Program], craft: Craft, params: list[str]
) -> None:
    node = "attitude_node"
    start(node, *params, "-p", "planet:=wgs84", "-r", "coarse_pose:=position_filter/pose")
    craft.match((node,))
    poses = craft.node.create_publisher(PoseStamped, "/position_filter/pose", 10)
    rates = craft.node.create_publisher(Imu, "/imu", 10)
    for publisher in (poses, rates):
        craft.wait(publisher.get_subscription_count, publisher.topic_name)
    index = 0

    def insist(send: Callable[[], None], key: str, words: str) -> None:
        nonlocal index
        craft.heard.clear()

        def said() -> bool:
            found = [{v.key: v.value for v in s.values} for s in craft.statuses(node)]
            return any(words in values.get(key, "") for values in found)

        while not said():
            index += 1
            assert index < 200, words
            send()
            craft.expect_pair(index, ("attitude",))

    position = np.array([5e6, 4e6, 2.5e6])

    def send_pose(frame_id: str = "earth") -> None:
        stamp = START_NS + index * PERIOD_NS
        poses.publish(coarse_pose_of(stamp, position, np.eye(3), frame_id))

    insist(lambda: send_pose("odom"), "coarse_pose", "'odom', not 'earth'")
    insist(send_pose, "coarse_pose", "used")
    insist(lambda: send_pose("odom"), "ignored_coarse_pose_wrong_frame", "1")

    def send_rate(frame_id: str = "base_link") -> None:
        rates.publish(imu_of(START_NS + index * PERIOD_NS, (0.0, 0.01, 0.0), frame_id))

    insist(lambda: send_rate("imu_link"), "imu", "'imu_link'")
    insist(send_rate, "imu", "used")


def test_debug_image_only_for_who_asks(
    start: Callable[..., Program], craft: Craft, params: list[str]
) -> None:
    start("local_vertical_node", *params, "-r", "local_vertical:=down")
    craft.listen(Vector3Stamped, "/down", 10)
    craft.wait(lambda: craft.node.count_publishers("/down") == 1, "remapped topic")
    craft.match(("local_vertical_node",))
    topic = "/local_vertical_node/debug_image"
    craft.send_pair(0)
    craft.wait(lambda: [m for t, m in craft.heard if t == "/down"], "estimate")
    subscription = craft.listen(Image, topic, 10)
    craft.wait(lambda: craft.node.count_subscribers(topic) == 1, "subscription")

    def pictures() -> list[Image]:
        return [m for t, m in craft.heard if t == topic]

    index = 0
    while not pictures():
        # The node may hear of its new listener a frame later.
        index += 1
        assert index < 200
        craft.send_pair(index)
        craft.executor.spin_once(timeout_sec=0.1)
    picture = pictures()[0]
    # The first pair's is drawn after its estimate is published, so it may be heard as well.
    assert picture.header.stamp.sec * 10**9 + picture.header.stamp.nanosec >= START_NS
    assert (picture.encoding, picture.height, picture.width) == ("bgr8", 480, 2 * 640)
    colours = np.frombuffer(picture.data, np.uint8).reshape(480, 2 * 640, 3)
    assert np.any(np.ptp(colours.astype(int), axis=2) > 100)
    craft.node.destroy_subscription(subscription)


def test_silence_is_told_by_the_nodes_clock(
    start: Callable[..., Program], craft: Craft, params: list[str]
) -> None:
    node = "attitude_node"
    clock = craft.node.create_publisher(Clock, "/clock", 10)
    start(node, *params, "-p", "use_sim_time:=true")
    craft.wait(lambda: clock.get_subscription_count() == 1, "the node's clock")
    craft.match((node,))

    def tick(seconds: int) -> None:
        clock.publish(Clock(clock=time_from_ns(START_NS + seconds * 10**9)))

    def stamps() -> set[int]:
        return {
            msg.header.stamp.sec - START_NS // 10**9
            for topic, msg in craft.heard
            if topic == "/diagnostics"
        }

    # Nobody has told a time yet: that is said, and no latency against it.
    craft.expect_pair(0, ("attitude",))
    status = craft.wait_for_state("no_clock", node=node)
    assert status.level == DiagnosticStatus.WARN
    assert "use_sim_time" in status.message
    assert "/clock" in status.message
    assert not {"latency_ms", "latency_max_ms", "rate_hz"} & {pair.key for pair in status.values}
    while 0 not in stamps():
        tick(0)
        craft.spin(0.1)
    craft.expect_pair(1, ("attitude",))
    craft.wait_for_state("ok")
    # Time stands still: reports go on, and nothing is stale however long that takes.
    craft.heard.clear()
    craft.wait(lambda: len(craft.statuses(node)) >= 5, "reports")
    assert {status.values[0].value for status in craft.statuses(node)} == {"ok"}
    craft.insist(lambda: tick(4), node, "no frames from camera_1 for 4.0 s")
    assert stamps() == {0, 4}


@pytest.mark.parametrize("node", ["attitude_node", "horizon_sensor"])
@pytest.mark.parametrize("live", [False, True], ids=["at the start", "live"])
def test_a_negative_time_is_not_taken_and_the_node_lives_on(
    start: Callable[..., Program], craft: Craft, params: list[str], node: str, live: bool
) -> None:
    clock = craft.node.create_publisher(Clock, "/clock", 10)
    program = start(node, *params, "-p", f"use_sim_time:={str(not live).lower()}")
    craft.match(("attitude_node",), 1)
    if live:
        for name in {node, "attitude_node"}:
            request = SetParameters.Request(
                parameters=[Parameter("use_sim_time", value=True).to_parameter_msg()]
            )
            answer = craft.call(SetParameters, f"/{name}/set_parameters", request)
            assert answer.results[0].successful
    clocks = {"attitude_node": 1, "horizon_sensor": 2 if live else 4}[node]
    craft.wait(lambda: clock.get_subscription_count() == clocks, "the nodes' clocks")

    def stamps() -> set[int]:
        return {m.header.stamp.sec for t, m in craft.heard if t == "/diagnostics"} & sent

    sent: set[int] = set()
    # Each in turn, since the clock's queue holds one.
    while len(stamps()) < 3:
        assert len(sent) < 200, "a node that goes by /clock"
        for second in (-1 - len(sent), 1000 + len(sent)):
            clock.publish(Clock(clock=Time(sec=second)))
            craft.spin(0.1)
        sent.add(second)
    code, errors = program.end()
    assert code == 0
    lines = errors.splitlines()
    assert lines
    told = "not taken: the time on /clock is negative"
    assert all(told in line for line in lines), errors


def test_the_log_says_what_state_a_node_is_in(
    start: Callable[..., Program], craft: Craft, params: list[str]
) -> None:
    node = "attitude_node"
    # Nobody publishes images in its namespace, and who runs it is told so.
    alone = start(node, *params, "-r", "__ns:=/elsewhere")
    fed = start(node, *params, "-p", "stale_after:=60.0")
    craft.match((node,))
    craft.expect_pair(0, ("attitude",))
    craft.heard.clear()

    def reports(name: str, state: str) -> int:
        found = ((s.hardware_id, s.values[0].value) for s in craft.statuses(node))
        return sum(each == (name, state) for each in found)

    # One more than it takes: the line is written after the report is sent.
    craft.wait(lambda: reports(f"/{node}", "ok") >= 4, "reports that all is well")
    craft.wait(lambda: reports(f"/elsewhere/{node}", "waiting") >= 4, "reports of a node alone")
    assert alone.end() == (0, "")
    (line,) = alone.states
    assert line.startswith("[WARN]")
    assert "now waiting: no frames from camera_1 yet" in line
    assert "nobody publishes /elsewhere/camera_1/image_raw, /elsewhere/camera_1/camera_info" in line
    assert fed.end() == (0, "")
    assert fed.states[-1].startswith("[INFO]")
    assert "now ok: fix from camera_1, camera_2" in fed.states[-1]
