"""A bag in, the nodes' topics in a bag out, with the nodes' own pipeline."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from rosbags.serde import SerdeError

from horizon_sensor_ros.ros.messages.message_types import CAMERA_INFO, IMAGE, IMU, POINT_CLOUD, POSE
from horizon_sensor_ros.ros.parameters.common import NODES_PARAMETER
from horizon_sensor_ros.ros.parameters.file import read_parameter_file, unreached_sections
from horizon_sensor_ros.ros.parameters.horizon import horizon_parameters
from horizon_sensor_ros.ros.parameters.horizon_settings import (
    HorizonSettings,
    PipelineSettings,
    cameras_of,
    horizon_settings,
)
from horizon_sensor_ros.ros.parameters.ignored import ignored_parameters
from horizon_sensor_ros.ros.parameters.parameter import Parameter, ParameterError
from horizon_sensor_ros.ros.parameters.target import target_parameters
from horizon_sensor_ros.ros.parameters.target_settings import TargetSettings, target_settings
from horizon_sensor_ros.ros.pipelines.aiding_sources import (
    COARSE_POSE_TOPIC,
    IMU_TOPIC,
    OF_NO_AVAIL,
)
from horizon_sensor_ros.ros.pipelines.horizon_pipeline import HorizonPipeline
from horizon_sensor_ros.ros.pipelines.target_pipeline import CLOUD_TOPIC, TargetPipeline
from horizon_sensor_ros.ros.process.node_names import (
    HORIZON_NODES,
    NODES,
    ONE_PROCESS,
    TARGET_NODE,
    full_name_of,
    nodes_of,
)
from horizon_sensor_ros.tools.bags.input_bag import (
    STORAGE,
    InputBag,
    open_bag,
    progress,
    storage_of,
)
from horizon_sensor_ros.tools.bags.output_bag import OutputBag, check_replaceable
from horizon_sensor_ros.tools.bags.replay_tally import ReplayTally
from horizon_sensor_ros.tools.bags.replayed_node import (
    ReplayedHorizonNode,
    ReplayedNode,
    ReplayedTargetNode,
    TopicNames,
)
from horizon_sensor_ros.tools.bags.topic_advice import advice, lacking, of_other_types
from horizon_sensor_ros.tools.bags.unreadable import Unreadable
from horizon_sensor_ros.tools.command_errors import CommandError, in_one_line

# Those of a kind share their sensors.
_KINDS = (frozenset(HORIZON_NODES), frozenset([TARGET_NODE]))
# A topic and its type.
_Input = tuple[str, str]
_Made = TypeVar("_Made")


@dataclass(frozen=True)
class _Plan:
    """Settings of the nodes that take part."""

    horizon: dict[str, HorizonSettings]
    target: TargetSettings | None


class _Replay:
    """The nodes' pipelines, each distinct one once, and where their messages come from."""

    def __init__(self, plan: _Plan, names: TopicNames, bag: OutputBag) -> None:
        self._names = names
        self._bag = bag
        self._nodes: list[ReplayedNode] = []
        self._handlers: dict[_Input, list[Callable[[Any], None]]] = {}
        # With one of the nodes that have it in common: what it says is the same for all.
        self._pipelines: list[
            tuple[str, HorizonPipeline | TargetPipeline, ReplayTally, ReplayedNode]
        ] = []
        self._unreadable = Unreadable()
        together: dict[PipelineSettings, list[str]] = {}
        for name, settings in plan.horizon.items():
            together.setdefault(settings.pipeline, []).append(name)
        for members in together.values():
            self._add_horizon({name: plan.horizon[name] for name in members})
        if plan.target is not None:
            self._add_target(plan.target)

    def _add_horizon(self, members: dict[str, HorizonSettings]) -> None:
        """Let nodes take part that have a pipeline in common."""
        settings = next(iter(members.values())).pipeline
        pipeline = HorizonPipeline(settings)
        nodes = [
            ReplayedHorizonNode(name, s, pipeline, self._names, self._bag)
            for name, s in members.items()
        ]
        tally = ReplayTally(pipeline)
        for camera in settings.cameras:
            image, camera_info = (
                self._handlers.setdefault(source, [])
                for source in _camera_inputs(camera, self._names)
            )
            image.append(partial(_hand_on, partial(pipeline.on_image, camera), [tally, *nodes]))
            camera_info.append(partial(pipeline.on_camera_info, camera))
        aiding = pipeline.aiding
        for source, handle in zip(
            _aiding_inputs(self._names), (aiding.on_coarse_pose, aiding.on_imu), strict=True
        ):
            self._handlers.setdefault(source, []).append(handle)
        self._nodes += nodes
        self._pipelines.append((", ".join(members), pipeline, tally, nodes[0]))

    def _add_target(self, settings: TargetSettings) -> None:
        pipeline = TargetPipeline(settings.pipeline)
        node = ReplayedTargetNode(TARGET_NODE, settings, pipeline, self._names, self._bag)
        tally = ReplayTally(pipeline)
        self._handlers[_cloud_input(self._names)] = [
            partial(_hand_on, pipeline.on_cloud, [tally, node])
        ]
        self._nodes.append(node)
        self._pipelines.append((TARGET_NODE, pipeline, tally, node))

    def run(self, recorded: InputBag, stopped: Callable[[], bool]) -> None:
        """Read all, write all; KeyboardInterrupt between two messages when asked to stop."""
        wanted = [c for c in recorded.connections if (c.topic, c.msgtype) in self._handlers]
        with progress(recorded.messages(wanted, stopped), wanted) as messages:
            for connection, time, raw in messages:
                for node in self._nodes:
                    node.advance(time)
                try:
                    msg = recorded.message(connection, raw)
                except SerdeError as error:
                    topic = recorded.recorded_topic(connection)
                    self._unreadable.add(topic, in_one_line(error))
                    continue
                for handle in self._handlers[connection.topic, connection.msgtype]:
                    handle(msg)
        for node in self._nodes:
            node.finish()

    def summary(self) -> str:
        """Return what was processed, for a person."""
        lines = []
        for names, pipeline, tally, node in self._pipelines:
            lines.append(f"{names}: {tally.figures()}")
            lines += [f"  {line}" for line in tally.reasons()]
            if isinstance(pipeline, HorizonPipeline):
                lines += _ignored(pipeline)
            if not pipeline.counts["fixes"]:
                where = "tuning" if isinstance(pipeline, HorizonPipeline) else "target"
                lines.append(f"  at the end: {node.words()} (doc/{where}.md: what to do)")
        return "\n".join(lines + self._unreadable.lines())


def _ignored(pipeline: HorizonPipeline) -> list[str]:
    """Return what became of the messages of topics that help, where some were not used."""
    lines = [f"  ignored, {why}: {count}" for why, count in sorted(pipeline.aiding.ignored.items())]
    words = pipeline.aiding.words.items()
    return lines + [f"  {topic} {said}" for topic, said in words if said.startswith(OF_NO_AVAIL)]


def _hand_on(
    process: Callable[[Any], Any], followers: Sequence[ReplayTally | ReplayedNode], msg: Any
) -> None:
    step = process(msg)
    for follower in followers:
        follower.on_step(step)


def _camera_inputs(camera: str, names: TopicNames) -> tuple[_Input, _Input]:
    return (names(f"{camera}/image_raw"), IMAGE), (names(f"{camera}/camera_info"), CAMERA_INFO)


def _aiding_inputs(names: TopicNames) -> tuple[_Input, _Input]:
    """Optional ones: nobody misses them."""
    return (names(COARSE_POSE_TOPIC), POSE), (names(IMU_TOPIC), IMU)


def _cloud_input(names: TopicNames) -> _Input:
    return names(CLOUD_TOPIC), POINT_CLOUD


def _inputs_of(
    values: dict[str, dict[str, Any]], names: TopicNames
) -> dict[str, frozenset[_Input]]:
    """What each node listens to."""

    def inputs(node: str, given: dict[str, Any]) -> frozenset[_Input]:
        if node == TARGET_NODE:
            return frozenset([_cloud_input(names)])
        return frozenset(i for camera in cameras_of(given) for i in _camera_inputs(camera, names))

    return _of_each(values, inputs)


def _taking_part(
    inputs: dict[str, frozenset[_Input]], aiding: frozenset[_Input], recorded: InputBag
) -> list[str]:
    """Nodes that the bag has a topic for; what it has not is said.

    aiding : what the horizon's nodes take besides; of a bag with nothing else they take part.
    """
    present = {(c.topic, c.msgtype) for c in recorded.connections}
    wanted = frozenset[_Input]().union(*inputs.values())
    aided = [node for node in inputs if node in HORIZON_NODES] if present & aiding else []
    if not present & wanted and not aided:
        looked_for = "\n".join(f"  {topic} ({kind})" for topic, kind in sorted(wanted))
        there = "\n".join(f"  {topic} ({kind})" for topic, kind in sorted(present)) or "  nothing"
        lines = [looked_for, "It has:", there, *advice(wanted, present)]
        raise CommandError(
            "\n".join([f"{recorded.path} has none of the topics looked for:", *lines])
        )
    for topic, kind in sorted(wanted - present):
        print(lacking(topic, kind, recorded), file=sys.stderr)
    for line in advice(wanted - present, present - wanted):
        print(line, file=sys.stderr)
    return [node for node, listened_to in inputs.items() if listened_to & present] or aided


def _read_values(params: Path | None, namespace: str) -> dict[str, dict[str, Any]]:
    """Parameters that the file has for each node that takes part, as in the one process."""
    if params is None:
        return {node: {} for node in NODES}
    of_process = read_parameter_file(params, ONE_PROCESS, namespace)
    try:
        nodes = nodes_of(of_process.get(NODES_PARAMETER.name, NODES_PARAMETER.default))
    except ValueError as error:
        raise ParameterError(f"{params}: {error}") from None
    values = {node: read_parameter_file(params, node, namespace) for node in nodes}
    ignored = [
        each
        for node, given in values.items()
        for each in ignored_parameters(given, _parameters_of(node, given))
    ]
    for each in dict.fromkeys(ignored):
        print(f"{each} ({params})", file=sys.stderr)
    full_names = [full_name_of(node, namespace) for node in (*nodes, ONE_PROCESS)]
    for told in unreached_sections(params, full_names):
        print(told, file=sys.stderr)
    return values


def _parameters_of(node: str, given: dict[str, Any]) -> tuple[Parameter, ...]:
    return target_parameters() if node == TARGET_NODE else horizon_parameters(given)


def _plan(values: dict[str, dict[str, Any]]) -> _Plan:
    settings = _of_each(values, _settings_of)
    horizon = {n: s for n, s in settings.items() if isinstance(s, HorizonSettings)}
    target = settings.get(TARGET_NODE)
    return _Plan(horizon, target if isinstance(target, TargetSettings) else None)


def _settings_of(node: str, given: dict[str, Any]) -> HorizonSettings | TargetSettings:
    if node == TARGET_NODE:
        return target_settings(given)
    settings = horizon_settings(given)
    if None in settings.pipeline.rotations:
        raise ParameterError(
            "extrinsics_source is tf, and a replay has no TF; set the rotations as parameters "
            "(doc/own_cameras.md: how to read them from TF)"
        )
    return settings


def _of_each(
    values: dict[str, dict[str, Any]], make: Callable[[str, dict[str, Any]], _Made]
) -> dict[str, _Made]:
    """What is made of each node's parameters; a node that cannot be is said and left out, as live
    the others run without it. CommandError when that leaves none for the cameras, or for the
    target.
    """
    made: dict[str, _Made] = {}
    problems: dict[str, list[str]] = {}
    for node, given in values.items():
        try:
            made[node] = make(node, given)
        except ParameterError as error:
            problems.setdefault(str(error), []).append(node)
    lines = [f"{', '.join(nodes)}: {problem}" for problem, nodes in problems.items()]
    left_out = values.keys() - made.keys()
    if any(left_out & kind and not made.keys() & kind for kind in _KINDS):
        raise CommandError("\n".join(lines))
    for line in lines:
        print(f"left out, {line}", file=sys.stderr)
    return made


def replay(arguments: argparse.Namespace, stopped: Callable[[], bool] = bool) -> str:
    """Do what the command line asks for and return the summary.

    Raises CommandError, saying why there is no replay, and KeyboardInterrupt soon after `stopped`
    says so; nothing is then left behind.
    """
    names = TopicNames(arguments.namespace, arguments.remap)
    try:
        values = _read_values(arguments.params, arguments.namespace)
    except ParameterError as error:
        raise CommandError(str(error)) from None
    recorded = open_bag(arguments.in_bag)
    try:
        nodes = _taking_part(_inputs_of(values, names), frozenset(_aiding_inputs(names)), recorded)
        plan = _plan({node: values[node] for node in nodes})
        if plan.horizon:
            for line in of_other_types(_aiding_inputs(names), recorded):
                print(line, file=sys.stderr)
        check_replaceable(arguments.out_bag, arguments.in_bag, force=arguments.force)
        bag = OutputBag(
            arguments.out_bag, STORAGE[arguments.storage or storage_of(arguments.in_bag)]
        )
        try:
            run = _Replay(plan, names, bag)
            for rule in names.idle_rules:
                why = "no node that takes part has that topic"
                print(f"--remap {rule} does nothing: {why}", file=sys.stderr)
            for topic, sources in names.merged:
                print(f"--remap: {' and '.join(sources)} are all {topic}", file=sys.stderr)
            run.run(recorded, stopped)
            bag.finish()
        except BaseException:
            bag.discard()
            raise
    finally:
        recorded.close()
    return run.summary()
