"""How the nodes' processes start and end.

Light on purpose: it is loaded before everything that takes time, so that a signal during start-up
already ends the process quietly.
"""

from __future__ import annotations

import gc
import os
import signal
import sys
from collections.abc import Sequence
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from types import FrameType
from typing import Any

from horizon_sensor_ros.ros.process.closed_streams import open_closed_streams, write_to_nothing
from horizon_sensor_ros.ros.process.interruption import END
from horizon_sensor_ros.ros.process.node_names import (
    HORIZON_NODES,
    NODES,
    ONE_PROCESS,
    TARGET_NODE,
    nodes_of,
)

_CLASSES = {
    "local_vertical_node": "horizon_sensor_ros.ros.nodes.horizon_node:LocalVerticalNode",
    "attitude_node": "horizon_sensor_ros.ros.nodes.horizon_node:AttitudeNode",
    "target_pose_node": "horizon_sensor_ros.ros.nodes.target_node:TargetPoseNode",
}

# Of a node that is rclpy's own; the others have them by themselves.
_DEFENCES = (
    "horizon_sensor_ros.ros.nodes.parameter_requests:refuse_values_of_no_type",
    "horizon_sensor_ros.ros.nodes.sim_time:refuse_times_before_1970",
)

_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_WAKE_UP_S = 0.5
# How long the end may take; it takes half a second.
_END_S = 4

_WHAT = {
    "local_vertical_node": "Publishes the direction towards the planet, from images of its limb.",
    "attitude_node": "Publishes roll, pitch and altitude, from images of a planet's limb.",
    "target_pose_node": "Publishes how a target of unknown shape moves, from point clouds.",
    ONE_PROCESS: "Runs the nodes of its parameter `nodes` (default: all) in one process.",
}
_HELP = """\
usage: {name} --ros-args [--params-file FILE] [-p NAME:=VALUE] [-r FROM:=TO]

{what}

example:
  ros2 run horizon_sensor_ros {name} --ros-args --params-file my_cameras.yaml{remap}

Every parameter with its unit and range is in config/params.yaml; topics and frames are in the
README. Where there is no answer the log and /diagnostics say why.
"""


class _QuietEnd:
    """SIGINT and SIGTERM end the process with exit code 0, also while it starts."""

    def __init__(self) -> None:
        self.immediately = True
        for number in _SIGNALS:
            signal.signal(number, self._on_signal)

    def _on_signal(self, _number: int, _frame: FrameType | None) -> None:
        if self.immediately:
            os._exit(0)
        END.ask()

    @staticmethod
    def begin() -> None:
        """Take no more signals: Python, as it ends, drops its handlers, and one would kill it. And
        let the end take no longer than `_END_S`.
        """
        sys.unraisablehook = _unless_a_late_signal
        for number in _SIGNALS:
            signal.signal(number, signal.SIG_IGN)
        # Should the middleware be stuck all the same (`participant_end`), no Python runs any more.
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.alarm(_END_S)


def run(names: Sequence[str] = ()) -> int:
    """Run the named nodes in one executor until a signal; return the exit code.

    Without names this is the executable `horizon_sensor`: its parameter `nodes` names them.
    """
    _with_all_streams()
    if {"-h", "--help"} & set(sys.argv[1:]):
        _print_help(names[0] if names else ONE_PROCESS)
        return 0
    end = _QuietEnd()
    # Nothing that is loaded is garbage: to look for some takes a tenth of the start.
    gc.disable()
    # Before numpy is loaded: for matrices as small as ours more threads only wait for each other.
    # And with another number of them sums come out in another order: a replay would not agree.
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    program = names[0] if len(names) == 1 else ONE_PROCESS
    try:
        import_module("rclpy")
    except ImportError as error:
        print(f"{program}: rclpy cannot be loaded: {error}; is ROS sourced?", file=sys.stderr)
        return 1
    return _until_a_signal(names, program, end)


def _until_a_signal(names: Sequence[str], program: str, end: _QuietEnd) -> int:
    import rclpy  # noqa: PLC0415 - takes time, and signals are taken care of only now
    from rclpy.signals import SignalHandlerOptions  # noqa: PLC0415
    from rclpy.utilities import remove_ros_args  # noqa: PLC0415

    nodes: list[Any] = []
    executor = None
    try:
        classes = {name: _load(_CLASSES[name]) for name in names or NODES}
        end.immediately = False
        # rclpy's own handlers would take the context from under a callback that is publishing.
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        left = remove_ros_args(sys.argv)[1:]
        if left:
            raise ValueError(f"unknown argument {left[0]}: ROS arguments go after --ros-args")
        if not names:
            nodes.append(rclpy.create_node(ONE_PROCESS))
            for defence in _DEFENCES:
                _load(defence)(nodes[0])
            names = _nodes_parameter(nodes[0])
        _refuse_empty_lists(sys.argv)
        managed = _made({name: classes[name] for name in names}, pinned=bool(nodes))
        nodes += managed
        executor = _executor()
        for node in nodes:
            executor.add_node(node)
        for node in managed:
            node.bring_up()
        _say_unreached_sections(nodes, managed[0].get_logger())
        _keep_what_is_loaded()
        while not END.asked_for:
            # Not spin(): in rclpy 7.1.6 that of the EventsExecutor outlives its context.
            executor.spin_once(timeout_sec=_WAKE_UP_S)
    except Exception as error:
        print(f"{program}: {_in_words(error)}", file=sys.stderr)
        return 1
    finally:
        end.begin()
        # First: it has callbacks in the middleware's threads, which would find the nodes gone.
        if executor is not None:
            executor.shutdown()
        for node in nodes:
            node.destroy_node()
        rclpy.try_shutdown()
    return 0


def _with_all_streams() -> None:
    """Have input, output and errors, whatever the launcher has closed: rclpy needs all three."""
    open_closed_streams()
    # Python has None for a stream that was closed when it started.
    if sys.stdout is None:
        sys.stdout = open(1, "w", closefd=False)  # noqa: SIM115
    if sys.stderr is None:
        sys.stderr = open(2, "w", closefd=False)  # noqa: SIM115


def _keep_what_is_loaded() -> None:
    # It stays: to look through it for garbage would hold up a frame by some 40 ms.
    gc.collect()
    gc.freeze()
    gc.enable()


def _unless_a_late_signal(what: Any) -> None:
    """Say nothing of a signal that came just as signals began to be ignored, as Python does."""
    if not str(what.exc_value).endswith("ignored due to race condition"):
        sys.__unraisablehook__(what)


def _print_help(name: str) -> None:
    clouds = name == TARGET_NODE
    remap = (
        "-r target/points:=/tof/points"
        if clouds
        else "-r camera_1/image_raw:=/left/image -r camera_1/camera_info:=/left/info"
    )
    text = _HELP.format(name=name, what=_WHAT[name], remap=f" \\\n      {remap}")
    try:
        print(text, end="", flush=True)
    except OSError:
        # Who closes its end has read enough, and a full disk is not the node's to tell.
        write_to_nothing(1)


def _in_words(error: Exception) -> str:
    words = " ".join(str(error).split())
    if type(error).__name__ == "UnknownROSArgsError":
        # rclpy, whose class has no public name, says no more than what it was given.
        return f"unknown ROS argument {words.strip('[]')}"
    if "log directory" in words:
        return f"{words}; set ROS_LOG_DIR to a folder that can be written to"
    if "params file" in words or words.startswith("a parameter was given an empty list"):
        # Neither rcl nor rclpy says which value it is.
        return _why_refused(sys.argv) or words
    return words


def _load(where: str) -> Any:
    module, name = where.split(":")
    return getattr(import_module(module), name)


def _made(classes: dict[str, Any], *, pinned: bool) -> list[Any]:
    """Return the nodes of these classes.

    pinned : they keep their own names where a rule renames every node of the process, as a name in
    a launch file does.
    """
    shared: dict[str, Any] = {}
    # These share the work on each frame.
    if not classes.keys().isdisjoint(HORIZON_NODES):
        shared["feeds"] = _load("horizon_sensor_ros.ros.nodes.image_feed:ImageFeeds")()
    nodes = []
    for name, make in classes.items():
        own = ["--ros-args", "-r", f"__node:={name}"] if pinned and _renames_all() else None
        nodes.append(make(cli_args=own, **(shared if name in HORIZON_NODES else {})))
    return nodes


def _refuse_empty_lists(arguments: Sequence[str]) -> None:
    """ValueError for `-p NAME:=[]`, which to rcl is nothing given: what a file has would stay."""
    for argument in arguments:
        name, found, value = argument.partition(":=")
        if found and value.replace(" ", "") == "[]":
            own = name.rpartition(":")[2]
            raise ValueError(f"{own} was given an empty list: name its values or leave it out")


def _why_refused(arguments: Sequence[str]) -> str:
    """What is wrong with the parameter files of a command line; empty where that is not seen."""
    why_refused = _load("horizon_sensor_ros.ros.parameters.file:why_refused")
    return next(filter(None, map(why_refused, _parameter_files(arguments))), "")


def _parameter_files(arguments: Sequence[str]) -> list[Path]:
    return [Path(value) for option, value in pairwise(arguments) if option == "--params-file"]


def _say_unreached_sections(nodes: Sequence[Any], logger: Any) -> None:
    """Warn of what parameter files have for our nodes and ROS gives to none of them.

    Done when all nodes are active: it takes as long as reading the files.
    """
    unreached_sections = _load("horizon_sensor_ros.ros.parameters.file:unreached_sections")
    names = [node.get_fully_qualified_name() for node in nodes]
    for file in _parameter_files(sys.argv):
        for told in unreached_sections(file, names):
            logger.warning(told)


def _renames_all() -> bool:
    """Whether a rule of the command line renames every node of the process."""
    return any(argument.startswith(("__node:=", "__name:=")) for argument in sys.argv)


def _nodes_parameter(node: Any) -> list[str]:
    parameter = _load("horizon_sensor_ros.ros.parameters.common:NODES_PARAMETER")
    descriptor = _load("horizon_sensor_ros.ros.nodes.managed_node:descriptor_of")(parameter)
    # Of any kind, as horizon_replay takes it: one name is no list. An empty list is none to rclpy.
    descriptor.dynamic_typing = True
    given = node.declare_parameter(parameter.name, parameter.default, descriptor).value
    return list(nodes_of(given))


def _executor() -> Any:
    try:
        from rclpy.experimental import EventsExecutor  # noqa: PLC0415 - not in every rclpy
    except ImportError:
        from rclpy.executors import SingleThreadedExecutor  # noqa: PLC0415

        return SingleThreadedExecutor()
    return EventsExecutor()
