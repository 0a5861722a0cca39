"""A bag in, the nodes' topics in a bag out, with the nodes' own pipeline."""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped, Vector3Stamped
from rclpy.serialization import serialize_message
from rosbags.interfaces import (
    Connection,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore
from tqdm import tqdm

from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.ros.diagnostics import HorizonMonitor
from horizon_sensor_ros.ros.horizon_pipeline import HorizonPipeline, HorizonResult
from horizon_sensor_ros.ros.messages import attitude_message, local_vertical_message
from horizon_sensor_ros.ros.parameters import (
    HorizonSettings,
    ParameterError,
    PipelineSettings,
    horizon_settings,
    read_parameter_file,
    unknown_parameters,
)

_IMAGE = "sensor_msgs/msg/Image"
_CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
_STORAGE = {"mcap": StoragePlugin.MCAP, "sqlite3": StoragePlugin.SQLITE3}
# The bag's own name is in its bytes; with a fixed one they do not depend on where it is written.
_BAG_NAME = "horizon"
_FOREVER = QosTime(9223372036, 854775807)
_OUTPUT_QOS = Qos(
    QosHistory.KEEP_LAST,
    10,
    QosReliability.RELIABLE,
    QosDurability.VOLATILE,
    _FOREVER,
    _FOREVER,
    QosLiveliness.AUTOMATIC,
    _FOREVER,
    False,
)


class ReplayError(Exception):
    """Why there is no replay, for a person."""


class _Output(NamedTuple):
    """What a node publishes: topic, message type, and how to make the message."""

    topic: str
    message: type
    encode: Callable[[HorizonResult, HorizonSettings], Any]


_NODES = {
    "local_vertical_node": _Output(
        "local_vertical",
        Vector3Stamped,
        lambda result, settings: local_vertical_message(
            result.fix.fit, result.stamp, settings.pipeline.base_frame
        ),
    ),
    "attitude_node": _Output(
        "attitude",
        PoseWithCovarianceStamped,
        lambda result, settings: attitude_message(result.fix.fit, result.stamp, settings.level_z),
    ),
}


class TopicNames:
    """Relative names to full ones, as the nodes' namespace and remappings make them."""

    def __init__(self, namespace: str, remappings: Sequence[str]) -> None:
        self._namespace = "/" + namespace.strip("/")
        self._remapped: dict[str, str] = {}
        for rule in remappings:
            source, found, target = rule.partition(":=")
            if not (found and source and target):
                raise ReplayError(f"--remap must be FROM:=TO, got {rule!r}")
            self._remapped[self._full(source)] = self._full(target)

    def __call__(self, name: str) -> str:
        """Full name of a topic."""
        full = self._full(name)
        return self._remapped.get(full, full)

    def _full(self, name: str) -> str:
        return name if name.startswith("/") else f"{self._namespace.rstrip('/')}/{name}"


class OutputBag:
    """A bag being written in a directory of its own; it appears in its place only when whole."""

    def __init__(self, path: Path, storage: StoragePlugin) -> None:
        self._path = path
        self._typestore = get_typestore(Stores.ROS2_JAZZY)
        self._connections: dict[tuple[str, type], Connection] = {}
        with self._writing():
            path.parent.mkdir(parents=True, exist_ok=True)
            self._directory = Path(tempfile.mkdtemp(prefix=f".{path.name}-", dir=path.parent))
        self._writer = Writer(self._directory / _BAG_NAME, version=9, storage_plugin=storage)
        try:
            with self._writing():
                self._writer.open()
        except BaseException:
            self.discard()
            raise

    def add_topic(self, topic: str, message: type) -> None:
        """Declare a topic, so that it is in the bag even when nothing is written to it."""
        if (topic, message) in self._connections:
            return
        with self._writing():
            self._connections[topic, message] = self._writer.add_connection(
                topic,
                _type_name(message),
                typestore=self._typestore,
                offered_qos_profiles=[_OUTPUT_QOS],
            )

    def write(self, topic: str, time: int, msg: Any) -> None:
        """Write a message; time in nanoseconds."""
        kind = _type_name(type(msg))
        # A second pass through CDR: in the first the bytes of padding are whatever memory held.
        plain = self._typestore.deserialize_cdr(serialize_message(msg), kind)
        raw = self._typestore.serialize_cdr(plain, kind, little_endian=True)
        with self._writing():
            self._writer.write(self._connections[topic, type(msg)], time, raw)

    def finish(self) -> None:
        """Put the bag in its place; an older one there makes room."""
        with self._writing():
            self._writer.close()
            if self._path.exists():
                shutil.rmtree(self._path)
            (self._directory / _BAG_NAME).rename(self._path)
            self._directory.rmdir()

    def discard(self) -> None:
        """Remove what was written."""
        with suppress(Exception):
            self._writer.abort()
        shutil.rmtree(self._directory, ignore_errors=True)

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except Exception as error:
            # Of the system or of a storage library: a full disk, most likely.
            raise ReplayError(f"cannot write {self._path}: {_line(error)}") from None


def _type_name(message: type) -> str:
    return f"{message.__module__.split('.')[0]}/msg/{message.__name__}"


class ReplayedNode:
    """What a node would publish, given its pipeline's steps in bag time."""

    def __init__(
        self,
        name: str,
        settings: HorizonSettings,
        pipeline: HorizonPipeline,
        names: TopicNames,
        bag: OutputBag,
    ) -> None:
        self._output = _NODES[name]
        self._settings = settings
        self._pipeline = pipeline
        self._bag = bag
        self._topic = names(self._output.topic)
        self._diagnostics = names("/diagnostics")
        self._monitor = HorizonMonitor(
            f"{name}: horizon", settings.pipeline.cameras, settings.stale_after_ns, live=False
        )
        self._period = round(settings.diagnostics_period_s * 1e9)
        self._due: int | None = None
        self._now = 0
        bag.add_topic(self._topic, self._output.message)
        bag.add_topic(self._diagnostics, DiagnosticArray)

    def advance(self, time: int) -> None:
        """Let bag time go on to `time`; diagnostics that were due meanwhile are written."""
        if self._due is None:
            self._now = self._due = time
            self._diagnose()
        # Nothing changes in a long pause once every camera has been reported silent.
        silent = self._now + self._settings.stale_after_ns + 2 * self._period
        while self._due <= time:
            if self._due > silent:
                self._due += (time - self._due) // self._period * self._period
            self._now = self._due
            self._diagnose()
        self._now = max(self._now, time)

    def on_step(self, step: Any) -> None:
        """Write what an image completed, and a change of state at once."""
        self._monitor.on_step(step, self._now)
        for result in step.results:
            if result.fix.status is Status.OK:
                message = self._output.encode(result, self._settings)
                self._bag.write(self._topic, self._now, message)
        if self._monitor.changed(self._now):
            self._write_diagnostics()

    def _diagnose(self) -> None:
        assert self._due is not None
        self._due += self._period
        self._write_diagnostics()

    def _write_diagnostics(self) -> None:
        self._bag.write(
            self._diagnostics, self._now, self._monitor.message(self._now, self._pipeline)
        )


@dataclass
class _Replay:
    """The nodes' pipelines, each distinct one once, and where their messages come from."""

    settings: dict[str, HorizonSettings]
    names: TopicNames

    def __post_init__(self) -> None:
        self.pipelines: dict[PipelineSettings, HorizonPipeline] = {
            s.pipeline: HorizonPipeline(s.pipeline) for s in self.settings.values()
        }
        # Topic and type: the pipelines and their names for the camera.
        self.inputs: dict[tuple[str, str], list[tuple[HorizonPipeline, str]]] = {}
        for pipeline in self.pipelines.values():
            for camera in pipeline.settings.cameras:
                for topic, kind in (("image_raw", _IMAGE), ("camera_info", _CAMERA_INFO)):
                    key = (self.names(f"{camera}/{topic}"), kind)
                    self.inputs.setdefault(key, []).append((pipeline, camera))
        self.unreadable: Counter[str] = Counter()

    def run(self, reader: Reader, bag: OutputBag, stopped: Callable[[], bool]) -> None:
        """Read all, write all; KeyboardInterrupt between two messages when asked to stop."""
        nodes: dict[int, list[ReplayedNode]] = {}
        for name, settings in self.settings.items():
            pipeline = self.pipelines[settings.pipeline]
            node = ReplayedNode(name, settings, pipeline, self.names, bag)
            nodes.setdefault(id(pipeline), []).append(node)
        everybody = [node for members in nodes.values() for node in members]
        typestore = get_typestore(Stores.ROS2_JAZZY)
        wanted = [c for c in reader.connections if (c.topic, c.msgtype) in self.inputs]
        total = sum(c.msgcount for c in wanted)
        with tqdm(_messages(reader, wanted), total=total, unit="msg", file=sys.stderr) as progress:
            for connection, time, raw in progress:
                if stopped():
                    raise KeyboardInterrupt
                for node in everybody:
                    node.advance(time)
                try:
                    msg = typestore.deserialize_cdr(raw, connection.msgtype)
                except SerdeError:
                    self.unreadable[connection.topic] += 1
                    continue
                for pipeline, camera in self.inputs[connection.topic, connection.msgtype]:
                    if connection.msgtype == _CAMERA_INFO:
                        pipeline.on_camera_info(camera, msg)
                        continue
                    step = pipeline.on_image(camera, msg)
                    for node in nodes[id(pipeline)]:
                        node.on_step(step)

    def summary(self) -> str:
        """Return what was processed, for a person."""
        lines = []
        for pipeline in self.pipelines.values():
            names = [n for n, s in self.settings.items() if s.pipeline == pipeline.settings]
            counts = pipeline.counts
            lines.append(
                f"{', '.join(names)}: {counts['frames']} frames, {counts['sets']} sets, "
                f"{counts['fixes']} fixes"
            )
            lines += [
                f"  rejected, {cause}: {count}"
                for cause, count in sorted(pipeline.rejected.items())
            ]
        lines += [
            f"unreadable messages skipped on {topic}: {count}"
            for topic, count in sorted(self.unreadable.items())
        ]
        return "\n".join(lines)


def _messages(
    reader: Reader, connections: Sequence[Connection]
) -> Iterator[tuple[Connection, int, bytes]]:
    messages = reader.messages(connections)
    while True:
        try:
            message = next(messages)
        except StopIteration:
            return
        except Exception as error:
            # Whatever a damaged file makes the storage libraries raise.
            raise ReplayError(f"{reader.path} is truncated or damaged: {_line(error)}") from None
        yield message


def _open_bag(path: Path) -> Reader:
    if not path.exists():
        raise ReplayError(f"there is no bag {path}")
    try:
        reader = Reader(path)
        reader.open()
    except Exception as error:
        # As above; rosbags says in its own words what it misses.
        raise ReplayError(f"{path} cannot be read as a rosbag2: {_line(error)}") from None
    return reader


def _line(error: Exception) -> str:
    return " ".join(f"{error or type(error).__name__}".split())


def _storage_of(path: Path) -> str:
    files = list(path.iterdir()) if path.is_dir() else [path]
    return "sqlite3" if any(".db3" in file.suffixes for file in files) else "mcap"


def _check_topics(replay: _Replay, reader: Reader) -> None:
    present = {(c.topic, c.msgtype) for c in reader.connections}
    if not present & set(replay.inputs):
        looked_for = "\n".join(f"  {topic} ({kind})" for topic, kind in sorted(replay.inputs))
        there = "\n".join(f"  {topic} ({kind})" for topic, kind in sorted(present)) or "  nothing"
        raise ReplayError(
            f"{reader.path} has none of the topics looked for:\n{looked_for}\nIt has:\n{there}"
        )
    for topic, kind in sorted(set(replay.inputs) - present):
        print(f"{reader.path} has no {topic} ({kind})", file=sys.stderr)


def _read_settings(params: Path | None, namespace: str) -> dict[str, HorizonSettings]:
    settings = {}
    warned = set()
    for node in _NODES:
        values = read_parameter_file(params, node, namespace) if params else {}
        for name in unknown_parameters(values):
            if name not in warned:
                warned.add(name)
                print(f"unknown parameter {name} is ignored ({params})", file=sys.stderr)
        try:
            settings[node] = horizon_settings(values)
        except ParameterError as error:
            raise ReplayError(f"{node}: {error}") from None
        if None in settings[node].pipeline.rotations:
            raise ReplayError(
                f"{node}: extrinsics_source is tf, and a replay has no TF; set the rotations as "
                "parameters"
            )
    return settings


def _check_output(path: Path, source: Path, *, force: bool) -> None:
    if not path.exists():
        return
    if not force:
        raise ReplayError(f"{path} exists; choose another, or --force to replace it")
    inside = path.resolve() in (source.resolve(), *source.resolve().parents)
    if inside or not (path / "metadata.yaml").is_file():
        raise ReplayError(f"{path} is not replaced: only another bag is")


def replay(arguments: argparse.Namespace, stopped: Callable[[], bool] = bool) -> str:
    """Do what the command line asks for and return the summary.

    Raises ReplayError, saying why there is no replay, and KeyboardInterrupt soon after `stopped`
    says so; nothing is then left behind.
    """
    names = TopicNames(arguments.namespace, arguments.remap)
    try:
        settings = _read_settings(arguments.params, arguments.namespace)
    except ParameterError as error:
        raise ReplayError(str(error)) from None
    reader = _open_bag(arguments.in_bag)
    try:
        run = _Replay(settings, names)
        _check_topics(run, reader)
        _check_output(arguments.out_bag, arguments.in_bag, force=arguments.force)
        bag = OutputBag(
            arguments.out_bag, _STORAGE[arguments.storage or _storage_of(arguments.in_bag)]
        )
        try:
            run.run(reader, bag, stopped)
            bag.finish()
        except BaseException:
            bag.discard()
            raise
    finally:
        reader.close()
    return run.summary()
