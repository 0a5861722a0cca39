"""Topics of a bag into CSV files: what `horizon_bag_to_csv` does."""

from __future__ import annotations

import argparse
import csv
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from rosbags.interfaces import Connection
from rosbags.serde import SerdeError

from horizon_sensor_ros.ros.messages.message_types import DIAGNOSTICS
from horizon_sensor_ros.tools.bags.input_bag import InputBag, open_bag, progress
from horizon_sensor_ros.tools.bags.message_tables import (
    TABLES,
    MessageTable,
    diagnostics_table,
)
from horizon_sensor_ros.tools.bags.unreadable import Unreadable
from horizon_sensor_ros.tools.command_errors import CommandError, in_one_line
from horizon_sensor_ros.tools.output_files import written_whole


def write_tables(arguments: argparse.Namespace, stopped: Callable[[], bool]) -> str:
    """Do what the command line asks for and return what was written.

    Raises CommandError, saying why there are no tables, and KeyboardInterrupt soon after `stopped`
    says so; nothing is then left behind.
    """
    out: Path = arguments.out_dir
    bag = open_bag(arguments.bag)
    try:
        chosen = _chosen(bag, arguments.topics)
        files = {topic: _file_name(topic) for topic in chosen}
        for name in files.values():
            if (out / name).exists() and not arguments.force:
                raise CommandError(f"{out / name} exists; choose another OUT_DIR, or --force")
        tables = {topic: _table(bag, kind, topic, stopped) for topic, kind in chosen.items()}
        with written_whole(*(out / name for name in files.values())) as fresh:
            places = dict(zip(files, fresh, strict=True))
            rows, unreadable = _write(bag, chosen, tables, places, stopped)
    finally:
        bag.close()
    lines = [f"{out / files[topic]}: {rows[topic]} rows of {topic}" for topic in tables]
    return "\n".join(lines + unreadable.lines())


def _chosen(bag: InputBag, wanted: list[str] | None) -> dict[str, str]:
    """Topics and their types that become tables."""
    present = {c.topic: c.msgtype for c in bag.connections}
    able = {t: kind for t, kind in sorted(present.items()) if kind in TABLES or kind == DIAGNOSTICS}
    there = "\n".join(f"  {topic} ({kind})" for topic, kind in sorted(present.items()))
    if wanted is not None:
        names = [topic if topic.startswith("/") else f"/{topic}" for topic in wanted]
        for topic in names:
            if topic not in able:
                kind = present.get(topic)
                why = f"is a {kind}, of which there is no table" if kind else "is not there"
                raise CommandError(
                    f"--topics: {topic} {why}. {bag.path} has:\n{there or '  nothing'}"
                )
        return {topic: able[topic] for topic in names}
    if not able:
        raise CommandError(
            f"{bag.path} has no topic that can be a table. It has:\n{there or '  nothing'}\n"
            "Estimates come from horizon_replay, or from recording the nodes' topics."
        )
    return able


def _file_name(topic: str) -> str:
    return topic.strip("/").replace("/", "__") + ".csv"


def _table(bag: InputBag, kind: str, topic: str, stopped: Callable[[], bool]) -> MessageTable:
    if kind != DIAGNOSTICS:
        return TABLES[kind]
    # Its columns are what its messages have: a first pass, over this topic alone.
    keys: dict[str, None] = {}
    for _, _, message in _decoded(bag, {topic: kind}, stopped, Unreadable()):
        for status in message.status:
            keys.update((pair.key, None) for pair in status.values)
    return diagnostics_table(tuple(keys))


def _decoded(
    bag: InputBag,
    kinds: Mapping[str, str],
    stopped: Callable[[], bool],
    unreadable: Unreadable,
) -> Iterator[tuple[Connection, int, Any]]:
    """Messages of topics that have the type that their table is of."""
    connections = [c for c in bag.connections if c.msgtype == kinds.get(c.topic)]
    for other in bag.connections:
        if other.topic in kinds and other not in connections:
            why = f"{other.msgtype}, not {kinds[other.topic]}"
            unreadable.add(other.topic, why, other.msgcount)
    if not connections:
        return
    for connection, time, raw in bag.messages(connections, stopped):
        try:
            yield connection, time, bag.message(connection, raw)
        except SerdeError as error:
            unreadable.add(connection.topic, in_one_line(error))


def _write(
    bag: InputBag,
    kinds: Mapping[str, str],
    tables: dict[str, MessageTable],
    files: dict[str, Path],
    stopped: Callable[[], bool],
) -> tuple[Counter[str], Unreadable]:
    """Write all tables; rows written and messages that cannot be read, by topic."""
    rows: Counter[str] = Counter()
    unreadable = Unreadable()
    with ExitStack() as stack:
        writers = {}
        for topic, table in tables.items():
            file = stack.enter_context(files[topic].open("w", newline="", encoding="utf-8"))
            writers[topic] = csv.writer(file)
            writers[topic].writerow(table.columns)
        connections = [c for c in bag.connections if c.topic in tables]
        decoded = _decoded(bag, kinds, stopped, unreadable)
        with progress(decoded, connections) as messages:
            for connection, _, message in messages:
                found = tables[connection.topic].rows(message)
                writers[connection.topic].writerows(found)
                rows[connection.topic] += len(found)
    return rows, unreadable
