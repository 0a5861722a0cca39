"""Read what a report is made from out of one or more bags."""

from __future__ import annotations

import struct
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from rosbags.interfaces import Connection
from rosbags.serde import SerdeError

from horizon_sensor_ros.core.seconds import NANOSECONDS
from horizon_sensor_ros.ros.messages.message_types import (
    DIAGNOSTICS,
    IMAGE,
    IMU,
    POINT_CLOUD,
    type_name,
)
from horizon_sensor_ros.ros.messages.refusal import Refusal
from horizon_sensor_ros.ros.messages.stamps import stamp_ns
from horizon_sensor_ros.ros.pipelines.aiding_sources import IMU_TOPIC
from horizon_sensor_ros.ros.pipelines.horizon_outputs import HORIZON_OUTPUTS
from horizon_sensor_ros.ros.pipelines.target_pipeline import CLOUD_TOPIC, TARGET_TOPICS
from horizon_sensor_ros.tools.bags.input_bag import InputBag, open_bag, progress
from horizon_sensor_ros.tools.bags.replayed_node import TopicNames
from horizon_sensor_ros.tools.command_errors import CommandError
from horizon_sensor_ros.tools.report.recorded import (
    STATUSES,
    Diagnosis,
    ImuSample,
    Recorded,
    TopicFacts,
)
from horizon_sensor_ros.tools.report.usable import is_usable
from horizon_sensor_ros.tools.truth.topics import TRUTH_TOPICS

_ANSWERS = {output.topic: output.message for output in HORIZON_OUTPUTS.values()} | TARGET_TOPICS
ANSWER_TOPICS = tuple(_ANSWERS)
_IMAGE_SUFFIX = "/image_raw"


def read_bags(
    bags: Sequence[Path],
    names: TopicNames,
    imu_topic: str | None = None,
    stopped: Callable[[], bool] = bool,
) -> Recorded:
    """Read all but the pixels; where two bags have the same topic the first one's counts.

    imu_topic : of an accelerometer; by default the nodes', if it is there. Raises CommandError for
    a bag that cannot be read, or where none has an answer or a diagnosis of the nodes that the
    names are for, or the imu_topic that is asked for.
    """
    found = Recorded(tuple(bags))
    wanted = _Wanted(found, names, imu_topic or IMU_TOPIC)
    taken: set[str] = set()
    for path in bags:
        bag = open_bag(path)
        try:
            _read(bag, path.name, wanted, taken, stopped)
        finally:
            bag.close()
    if not any(found.answers.values()) and not (found.diagnostics and wanted.may_be_diagnosed()):
        raise CommandError(_no_answers(found, names))
    if imu_topic is not None and not found.imu:
        there = ", ".join(sorted({t.topic for t in found.topics if t.msgtype == IMU}))
        raise CommandError(
            f"--imu: there is no {names(imu_topic)} ({IMU}); there is {there or 'none'}"
        )
    found.diagnostics = _without_other_craft(found.diagnostics, names)
    return found


def _no_answers(found: Recorded, names: TopicNames) -> str:
    """Why there is no report of what was found, and what to do."""
    bags = ", ".join(map(str, found.bags))
    looked_for = ", ".join(names(topic) for topic in ANSWER_TOPICS)
    if any(facts.count for facts in found.topics):
        why = f"none of {looked_for} with messages of the nodes' types"
        lines = [f"no answers in {bags}: {why}. There is:"]
        lines += [
            f"  {t.topic} ({t.msgtype}) in {t.bag}{'' if t.count else ', without messages'}"
            for t in found.topics
        ]
    else:
        lines = [f"no answers in {bags}: no messages at all"]
    elsewhere = _namespaces(found)
    if elsewhere:
        advice = f"Those of other nodes are there: --namespace {' or '.join(elsewhere)}"
    else:
        advice = (
            "Make them with horizon_replay IN_BAG OUT_BAG, then: horizon_report OUT_BAG --input "
            "IN_BAG"
        )
    return "\n".join([*lines, *found.left_out, advice])


def _namespaces(found: Recorded) -> list[str]:
    """Namespaces in which there are answers by the nodes' own names."""
    truths = tuple(f"/{topic}" for topic in TRUTH_TOPICS)
    answers = {f"/{topic}": type_name(kind) for topic, kind in _ANSWERS.items()}
    return sorted(
        {
            facts.topic.removesuffix(topic) or "/"
            for facts in found.topics
            for topic, kind in answers.items()
            if facts.count and facts.topic.endswith(topic) and facts.msgtype == kind
            if not facts.topic.endswith(truths)
        }
    )


def _without_other_craft(
    diagnostics: dict[str, list[Diagnosis]], names: TopicNames
) -> dict[str, list[Diagnosis]]:
    """Leave out what nodes of the same names in other namespaces say on the one /diagnostics.

    All of it stays where nothing is of the nodes that the names are for: they may have been renamed
    in ways that are not told here.
    """
    if not _have_own(diagnostics, names):
        return diagnostics
    kept = {
        name: [d for d in found if not _is_namesake(d.hardware_id, _node_of(name, names))]
        for name, found in diagnostics.items()
    }
    return {name: found for name, found in kept.items() if found}


def _have_own(diagnostics: dict[str, list[Diagnosis]], names: TopicNames) -> bool:
    """Whether some are of the nodes that the names are for."""
    return any(
        d.hardware_id == _node_of(name, names) for name, found in diagnostics.items() for d in found
    )


def _node_of(status_name: str, names: TopicNames) -> str:
    """Full name of the node, among those that the names are for, that reports under a name."""
    return names.of_node(status_name.partition(":")[0])


def _is_namesake(hardware_id: str, node: str) -> bool:
    """Whether that is the full name of another node whose last part is the same."""
    return hardware_id != node and hardware_id.endswith("/" + node.rpartition("/")[2])


class _Wanted:
    """What becomes of which topic."""

    def __init__(self, found: Recorded, names: TopicNames, imu_topic: str) -> None:
        self.found = found
        self._names = names
        self._answers = {names(topic): topic for topic in ANSWER_TOPICS}
        self._truths = {names(topic): topic for topic in TRUTH_TOPICS}
        self._types = {
            names(topic): type_name(kind) for topic, kind in (_ANSWERS | TRUTH_TOPICS).items()
        }
        self._cloud, self._imu = names(CLOUD_TOPIC), names(imu_topic)
        self._diagnostics = names("/diagnostics")

    def is_wanted(self, connection: Connection) -> bool:
        topic, kind = connection.topic, connection.msgtype
        return (
            self._types.get(topic) == kind
            or (topic == self._diagnostics and kind == DIAGNOSTICS)
            or (topic == self._imu and kind == IMU)
            or self.is_big(connection)
        )

    def is_big(self, connection: Connection) -> bool:
        """Whether only the stamps of its messages count."""
        topic, kind = connection.topic, connection.msgtype
        return (kind == IMAGE and self._camera(topic) is not None) or (
            kind == POINT_CLOUD and topic == self._cloud
        )

    def _camera(self, topic: str) -> str | None:
        """Name of the camera whose images a topic has; None when it is none's."""
        name = self._names.before(topic)
        if name is None or not name.endswith(_IMAGE_SUFFIX):
            return None
        camera = name.removesuffix(_IMAGE_SUFFIX).rpartition("/")[2]
        # One of another namespace is another craft's.
        return camera if self._names(camera + _IMAGE_SUFFIX) == topic else None

    def may_be_diagnosed(self) -> bool:
        """Whether /diagnostics, which is the same in all namespaces, may be these nodes'.

        Not where no node there has the name of one, and the bags have answers of other names and
        none, not even a silent topic, of these.
        """
        if _have_own(self.found.diagnostics, self._names):
            return True
        topics = {facts.topic for facts in self.found.topics}
        if not topics.isdisjoint(self._answers):
            return True
        endings = tuple(f"/{topic}" for topic in ANSWER_TOPICS)
        truths = tuple(f"/{topic}" for topic in TRUTH_TOPICS)
        return not any(t.endswith(endings) and not t.endswith(truths) for t in topics)

    def take_stamp(self, connection: Connection, time: int, raw: bytes) -> None:
        """Take note of an image or a cloud."""
        stamp = _stamp_in(raw)
        if connection.msgtype == POINT_CLOUD:
            self.found.clouds.append(stamp)
            self.found.clouds_received_ns[stamp] = time
        else:
            camera = self._camera(connection.topic)
            assert camera is not None
            self.found.frames.setdefault(camera, []).append(stamp)
            self.found.frames_received_ns[stamp] = time

    def take(self, topic: str, time: int, msg: Any) -> None:
        """Take a message."""
        found = self.found
        if topic == self._diagnostics:
            for status in msg.status:
                if not status.name.endswith(STATUSES):
                    continue
                values = {pair.key: pair.value for pair in status.values}
                found.diagnostics.setdefault(status.name, []).append(
                    Diagnosis(
                        _time_of(msg, time),
                        status.hardware_id,
                        int(status.level),
                        status.message,
                        values,
                    )
                )
            return
        stamp = stamp_ns(msg)
        if isinstance(stamp, Refusal):
            found.unreadable += 1
        elif topic in self._types and not is_usable(msg):
            found.unusable[topic] += 1
        elif topic in self._answers:
            name = self._answers[topic]
            found.answers.setdefault(name, {})[stamp] = msg
            found.received_ns.setdefault(name, {})[stamp] = time
        elif topic in self._truths:
            found.truths.setdefault(self._truths[topic], {})[stamp] = msg
        else:
            found.imu.append(_imu_sample(stamp, msg))


def _read(
    bag: InputBag, name: str, wanted: _Wanted, taken: set[str], stopped: Callable[[], bool]
) -> None:
    found = wanted.found
    found.topics += [
        TopicFacts(name, c.topic, c.msgtype, c.msgcount)
        for c in sorted(bag.recorded, key=lambda c: c.topic)
    ]
    connections = [c for c in bag.connections if wanted.is_wanted(c) and c.topic not in taken]
    taken.update(c.topic for c in connections)
    if not connections:
        return
    with progress(bag.messages(connections, stopped), connections) as messages:
        for connection, time, raw in messages:
            try:
                if wanted.is_big(connection):
                    wanted.take_stamp(connection, time, raw)
                else:
                    msg = bag.message(connection, raw)
                    wanted.take(connection.topic, time, msg)
            except (SerdeError, struct.error):
                found.unreadable += 1


def _stamp_in(raw: bytes) -> int:
    """Header stamp (ns) of a message in CDR, without reading the rest of it; struct.error where it
    is too short.
    """
    little = len(raw) > 1 and raw[1] & 1
    seconds, nanoseconds = struct.unpack_from("<iI" if little else ">iI", raw, 4)
    return int(seconds) * NANOSECONDS + int(nanoseconds)


def _imu_sample(stamp: int, msg: Any) -> ImuSample:
    a, w = msg.linear_acceleration, msg.angular_velocity
    # The name of the frame is the same in nearly all.
    return ImuSample(stamp, sys.intern(msg.header.frame_id), (a.x, a.y, a.z), (w.x, w.y, w.z))


def _time_of(msg: Any, time: int) -> int:
    stamp = stamp_ns(msg)
    return time if isinstance(stamp, Refusal) or stamp == 0 else stamp
