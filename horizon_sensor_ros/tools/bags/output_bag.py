"""A bag that is there only when it is whole, with the same bytes for the same messages."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

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
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from horizon_sensor_ros.ros.messages.message_types import type_name
from horizon_sensor_ros.tools.command_errors import CommandError, in_one_line
from horizon_sensor_ros.tools.output_files import make_folders, remove_folders

# The bag's own name is in its bytes; with a fixed one they do not depend on where it is written.
_BAG_NAME = "horizon"
_OWN_FILES = {"metadata.yaml", f"{_BAG_NAME}.mcap", f"{_BAG_NAME}.db3"}
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


class OutputBag:
    """A bag being written in a directory of its own; it appears in its place only when whole."""

    def __init__(self, path: Path, storage: StoragePlugin) -> None:
        self._path = path
        self._typestore = get_typestore(Stores.ROS2_JAZZY)
        self._connections: dict[tuple[str, type], Connection] = {}
        self._made: list[Path] = []
        with self._writing():
            make_folders(path.parent, self._made)
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
                type_name(message),
                typestore=self._typestore,
                offered_qos_profiles=[_OUTPUT_QOS],
            )

    def write(self, topic: str, time: int, msg: Any) -> None:
        """Write a message; time in nanoseconds."""
        kind = type_name(type(msg))
        # A second pass through CDR: in the first the bytes of padding are whatever memory held.
        plain = self._typestore.deserialize_cdr(serialize_message(msg), kind)
        raw = self._typestore.serialize_cdr(plain, kind, little_endian=True)
        with self._writing():
            self._writer.write(self._connections[topic, type(msg)], time, raw)

    def finish(self) -> None:
        """Put the bag in its place; an older one there makes room, CommandError where it is none,
        or cannot.
        """
        older = self._directory / "older"
        with self._writing():
            self._writer.close()
            if os.path.lexists(self._path):
                # Meanwhile something else may have come to be there.
                _require_bag(self._path)
                self._path.rename(older)
            try:
                (self._directory / _BAG_NAME).rename(self._path)
            except OSError:
                if older.exists():
                    older.rename(self._path)
                raise
        shutil.rmtree(self._directory, ignore_errors=True)

    def discard(self) -> None:
        """Remove what was written, and the folders that were made for it."""
        with suppress(Exception):
            self._writer.abort()
        shutil.rmtree(self._directory, ignore_errors=True)
        remove_folders(self._made)

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except CommandError:
            raise
        except Exception as error:
            # Of the system or of a storage library: a full disk, most likely.
            why = getattr(error, "strerror", None) or in_one_line(error)
            raise CommandError(f"cannot write {self._path}: {why}") from None


def check_replaceable(path: Path, *sources: Path, force: bool) -> None:
    """CommandError where no bag may be written to `path`: something is there, or the input is, or
    it is in the input.
    """
    for source in sources:
        if source.is_dir() and source.resolve() in path.resolve().parents:
            raise CommandError(f"{path} would lie in the input, {source}; choose a place beside it")
    if not os.path.lexists(path):
        return
    if not force:
        raise CommandError(f"{path} exists; choose another, or --force to replace it")
    here = _current_folder()
    if here is not None and path.resolve() in (here, *here.parents):
        raise CommandError(
            f"{path} is not replaced: the current folder is in it; run from another one"
        )
    if any(path.resolve() in (s.resolve(), *s.resolve().parents) for s in sources):
        raise CommandError(f"{path} is not replaced: only another bag is, and the input is in it")
    _require_bag(path)


def _current_folder() -> Path | None:
    """None where it was removed."""
    try:
        return Path.cwd()
    except OSError:
        return None


def check_own(path: Path) -> None:
    """CommandError where something is at `path` that is no bag which an `OutputBag` wrote."""
    if not os.path.lexists(path):
        return
    _require_bag(path)
    others = sorted({each.name for each in path.iterdir()} - _OWN_FILES)
    if others:
        raise CommandError(
            f"{path} is not replaced: {others[0]} in it is no part of a bag of this package; move "
            "it, or choose another place"
        )


def _require_bag(path: Path) -> None:
    if path.is_symlink():
        raise CommandError(
            f"{path} is not replaced: only another bag is, and it is a link; choose another place, "
            "or remove it"
        )
    if not (path / "metadata.yaml").is_file():
        raise CommandError(
            f"{path} is not replaced: only another bag is; choose another place, or move it"
        )
