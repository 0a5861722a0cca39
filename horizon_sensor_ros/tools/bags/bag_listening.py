"""A bag's messages handed to whoever listens to their topics."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rosbags.serde import SerdeError

from horizon_sensor_ros.tools.bags.input_bag import open_bag, progress
from horizon_sensor_ros.tools.bags.topic_advice import advice, of_other_types
from horizon_sensor_ros.tools.bags.unreadable import Unreadable
from horizon_sensor_ros.tools.command_errors import CommandError, in_one_line


@dataclass(frozen=True)
class Listener:
    """What becomes of a topic's messages.

    types : that will do. take : called with message and type. needed : without it there is nothing
    to be done.
    """

    topic: str
    types: tuple[str, ...]
    take: Callable[[Any, str], None]
    needed: bool = True


def listen(path: Path, listeners: Sequence[Listener], stopped: Callable[[], bool]) -> list[str]:
    """Read a bag with a progress bar, and return what a person should know of what was not read:
    messages that cannot be, and topics that are not needed and have another type.

    Raises CommandError for a bag that cannot be read or has not what is needed, and
    KeyboardInterrupt soon after `stopped` says so.
    """
    bag = open_bag(path)
    unreadable = Unreadable()
    try:
        takers = {c.id: _takers(c.topic, c.msgtype, listeners) for c in bag.connections}
        wanted = [c for c in bag.connections if takers[c.id]]
        there = {(connection.topic, connection.msgtype) for connection in wanted}
        absent = [
            each
            for each in listeners
            if there.isdisjoint((each.topic, kind) for kind in each.types)
        ]
        missing = [each for each in absent if each.needed]
        if missing:
            raise CommandError(
                _complaint(path, missing, [(c.topic, c.msgtype) for c in bag.connections])
            )
        unread = of_other_types([(each.topic, each.types[0]) for each in absent], bag)
        with progress(bag.messages(wanted, stopped), wanted) as messages:
            for connection, _, raw in messages:
                try:
                    msg = bag.message(connection, raw)
                except SerdeError as error:
                    unreadable.add(bag.recorded_topic(connection), in_one_line(error))
                    continue
                for take in takers[connection.id]:
                    take(msg, connection.msgtype)
    finally:
        bag.close()
    return unread + unreadable.lines()


def _takers(
    topic: str, msgtype: str, listeners: Sequence[Listener]
) -> list[Callable[[Any, str], None]]:
    return [each.take for each in listeners if each.topic == topic and msgtype in each.types]


def _complaint(path: Path, missing: Sequence[Listener], present: Sequence[tuple[str, str]]) -> str:
    looked_for = "\n".join(f"  {each.topic} ({' or '.join(each.types)})" for each in missing)
    has = "\n".join(f"  {topic} ({kind})" for topic, kind in sorted(present)) or "  nothing"
    wanted = [(each.topic, kind) for each in missing for kind in each.types]
    lines = [f"{path} lacks:", looked_for, "It has:", has, *advice(wanted, present)]
    return "\n".join(lines)
