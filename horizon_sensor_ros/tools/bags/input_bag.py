"""Bags to be read: opened, and read to the end, with errors for a person."""

from __future__ import annotations

import resource
import sys
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from rosbags.interfaces import Connection
from rosbags.rosbag2 import Reader, StoragePlugin
from rosbags.typesys import Stores, get_typestore
from tqdm import tqdm

from horizon_sensor_ros.ros.files.yaml_file import YamlFileError, read_yaml
from horizon_sensor_ros.ros.messages.message_types import COMPRESSED_IMAGE, IMAGE
from horizon_sensor_ros.tools.bags.compressed_images import SUFFIX, decompressed
from horizon_sensor_ros.tools.command_errors import CommandError, in_one_line

STORAGE = {"mcap": StoragePlugin.MCAP, "sqlite3": StoragePlugin.SQLITE3}

_MCAP = b"\x89MCAP0\r\n"  # how such a file begins
_RECOVER = "; if the recording was cut off, `mcap recover` saves what was written"
_METADATA = "metadata.yaml"
_INFORMATION = "rosbag2_bagfile_information"

_Message = TypeVar("_Message")

# A few kilobytes of compressed bag can say that they are terabytes; no sensor's message comes near.
_MAX_BYTES = 4_000_000_000


class InputBag:
    """An open bag.

    connections : what is in it. Compressed images count as the images that they were made of, under
    their name, where the bag has no such topic. recorded : the same as they are in the file.
    """

    def __init__(self, path: Path, reader: Reader) -> None:
        self.path = path
        self._reader = reader
        self._typestore = get_typestore(Stores.ROS2_JAZZY)
        self.recorded = tuple(reader.connections)
        self._recorded = {each.id: each for each in self.recorded}
        there = {connection.topic for connection in self.recorded}
        self.connections = tuple(_as_image(each, there) for each in self.recorded)

    def messages(
        self, connections: Sequence[Connection], stopped: Callable[[], bool] = bool
    ) -> Iterator[tuple[Connection, int, bytes]]:
        """Connection, record time (ns) and bytes of each message.

        Where the bag has fewer than it lists, that is said: their loss looks like silent sensors.
        Raises CommandError where the file is broken, and KeyboardInterrupt soon after `stopped`
        says so.
        """
        asked = {connection.id: connection for connection in connections}
        if not asked:
            return  # rosbags would take none for all
        messages = self._reader.messages([each for each in self.recorded if each.id in asked])
        missing = sum(connection.msgcount for connection in asked.values())
        while True:
            try:
                with _bounded_memory():
                    recorded, time, raw = next(messages)
            except StopIteration:
                if missing > 0:
                    self._say_missing(missing)
                return
            except Exception as error:
                # As below, of a damaged file.
                why = f"{self.path} is truncated or damaged: {in_one_line(error)}"
                raise CommandError(why) from None
            if stopped():
                raise KeyboardInterrupt
            missing -= 1
            yield asked[recorded.id], time, raw

    def _say_missing(self, number: int) -> None:
        # tqdm keeps it apart from a progress bar.
        tqdm.write(
            f"{self.path} lists {number} messages more than it has: it is damaged, or its "
            f"{_METADATA} is that of another recording",
            file=sys.stderr,
        )

    def message(self, connection: Connection, raw: bytes) -> Any:
        """Return a message of one of the connections; SerdeError where it cannot be read."""
        kind = self._recorded[connection.id].msgtype
        msg = self._typestore.deserialize_cdr(raw, kind)
        if kind == connection.msgtype:
            return msg
        with _bounded_memory():
            return decompressed(msg, self._typestore)

    def recorded_topic(self, connection: Connection) -> str:
        """Topic of one of the connections as it is in the file."""
        return self._recorded[connection.id].topic

    def close(self) -> None:
        """Close the file."""
        self._reader.close()


def _as_image(connection: Connection, there: Collection[str]) -> Connection:
    """Return a connection of compressed images as one of images, but where these are there too."""
    topic = connection.topic.removesuffix(SUFFIX)
    if connection.msgtype != COMPRESSED_IMAGE or topic in there:
        return connection
    return connection._replace(topic=topic, msgtype=IMAGE)


def open_bag(path: Path) -> InputBag:
    """Return a directory, an .mcap or a .db3, opened; CommandError says why it cannot be."""
    if not path.exists():
        raise CommandError(f"there is no bag {path}")
    inside = [] if _is_bag(path) else sorted(each for each in path.glob("*/") if _is_bag(each))
    if inside:
        raise CommandError(
            f"{path} is a folder with a bag in it, and none itself: give {inside[0]}"
        )
    if not _is_bag(path):
        raise CommandError(
            f"{path} cannot be read as a rosbag2: the folder has neither a {_METADATA} nor an "
            ".mcap or .db3 in it"
        )
    try:
        with _bounded_memory():
            reader = Reader(path)
            reader.open()
    except Exception as error:
        # Whatever the storage libraries raise; rosbags says in its own words what it misses.
        fault = _metadata_fault(path) or in_one_line(error).rstrip(".")
        why = f"{path} cannot be read as a rosbag2: {fault}"
        raise CommandError(f"{why}{_remedy(path)}") from None
    return InputBag(path, reader)


def _metadata_fault(path: Path) -> str:
    """Why a folder's metadata.yaml is none of a bag, for a person; empty where it may be one."""
    metadata = path / _METADATA
    if not metadata.is_file():
        return ""
    try:
        content = read_yaml(metadata)
    except YamlFileError as error:
        return f"its {_METADATA} {error}"
    if content is None:
        return f"its {_METADATA} is empty"
    if not isinstance(content, dict) or not isinstance(content.get(_INFORMATION), dict):
        return f"its {_METADATA} is none of a bag: it has no {_INFORMATION}"
    return ""


def _remedy(path: Path) -> str:
    """What a person may do about a bag that cannot be opened, as a recording that was cut off."""
    if not path.is_dir():
        # Of what was never an mcap nothing can be saved.
        return _RECOVER if _begins_with(path, _MCAP) else ""
    files = sorted(file for kind in ("*.mcap", "*.db3") for file in path.glob(kind))
    if not files:
        return ""
    if not (path / _METADATA).is_file():
        return (
            f"; it has no {_METADATA}, as a recording that was cut off: give {files[0].name} "
            "itself, or make one with `ros2 bag reindex`"
        )
    if _metadata_fault(path) or all(_can_be_opened(file) for file in files):
        itself = f", or give {files[0].name} itself" if len(files) == 1 else ""
        return f"; `ros2 bag reindex {path}` makes {_METADATA} anew{itself}"
    return _RECOVER if any(_begins_with(file, _MCAP) for file in files) else ""


def _can_be_opened(file: Path) -> bool:
    """Whether a recording can be opened by itself."""
    try:
        with _bounded_memory(), Reader(file):
            return True
    except Exception:
        return False


def _is_bag(path: Path) -> bool:
    """Whether that is a file, or a folder with the file of a bag in it."""
    kinds = (_METADATA, "*.mcap", "*.db3")
    return path.is_file() or any(any(path.glob(kind)) for kind in kinds)


def _begins_with(path: Path, start: bytes) -> bool:
    try:
        with path.open("rb") as file:
            return file.read(len(start)) == start
    except OSError:
        return False


def progress(messages: Iterator[_Message], connections: Sequence[Connection]) -> tqdm[_Message]:
    """Messages of these connections under a progress bar; as a context, which ends it in time."""
    total = sum(connection.msgcount for connection in connections)
    return tqdm(messages, total=total, unit="msg", file=sys.stderr, disable=total == 0)


@contextmanager
def _bounded_memory() -> Iterator[None]:
    """Let an allocation fail that would take this process far beyond what it uses now."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    bound = pages * resource.getpagesize() + _MAX_BYTES
    if soft != resource.RLIM_INFINITY:
        bound = min(bound, soft)
    resource.setrlimit(resource.RLIMIT_AS, (bound, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def storage_of(path: Path) -> str:
    """Name of the storage that a bag is in, "mcap" or "sqlite3"."""
    files = list(path.iterdir()) if path.is_dir() else [path]
    return "sqlite3" if any(".db3" in file.suffixes for file in files) else "mcap"
