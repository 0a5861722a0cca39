"""Files that appear in their places only when they are whole; older ones there stay until then."""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from horizon_sensor_ros.tools.command_errors import CommandError

_unfinished: set[Path] = set()  # directories


def check_place(path: Path) -> None:
    """CommandError where no file can be written to a path, before all the work for it."""
    try:
        if path.is_dir():
            raise CommandError(f"cannot write {path}: it is a folder")
        place = path.resolve()
        if _is_file_or_none(path):
            place = next(each for each in place.parents if each.exists())
        if not os.access(place, os.W_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
        if place != path.resolve() and not place.is_dir():
            raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR))
    except OSError as error:
        raise CommandError(f"cannot write {path}: {error.strerror}") from None


@contextmanager
def written_whole(*paths: Path) -> Iterator[tuple[Path, ...]]:
    """Yield for each path one beside it to write to; these take their places when the block ends.

    Folders are made. Where the block raises nothing is left behind; an OSError becomes a
    CommandError that names the paths. What is no file, as /dev/stdout, is written to as it is.
    """
    directories: dict[Path, Path] = {}
    made: list[Path] = []
    try:
        fresh = tuple(_beside(path, directories, made) for path in paths)
        yield fresh
        for one, path in zip(fresh, paths, strict=True):
            if one != path:
                place = path.resolve()  # a link stays one
                if place.exists():
                    shutil.copymode(place, one)
                one.replace(place)
        made.clear()
    except OSError as error:
        why = error.strerror or str(error) or type(error).__name__
        raise CommandError(f"cannot write {_named(paths)}: {why}") from None
    finally:
        for directory in directories.values():
            _remove(directory)
        remove_folders(made)


def make_folders(folder: Path, made: list[Path]) -> None:
    """Make a folder and those it is in, as far as they are missing, and add them to `made`."""
    missing = [each for each in (folder, *folder.parents) if not each.exists()]
    for each in reversed(missing):
        each.mkdir(exist_ok=True)
        made.append(each)


def remove_folders(made: Sequence[Path]) -> None:
    """Remove folders that were made, in that order, and stayed empty."""
    for each in reversed(made):
        with suppress(OSError):
            each.rmdir()


def remove_unfinished() -> None:
    """Remove what no `written_whole` will put in its place any more: the process is about to end.

    May be called by a signal's handler.
    """
    for directory in tuple(_unfinished):
        _remove(directory)


def _beside(path: Path, directories: dict[Path, Path], made: list[Path]) -> Path:
    if not _is_file_or_none(path):
        return path
    # On the same file system, where a file takes another's place at once.
    parent = path.resolve().parent
    if parent not in directories:
        make_folders(parent, made)
        directories[parent] = Path(tempfile.mkdtemp(prefix=f".{path.name}-", dir=parent))
        _unfinished.add(directories[parent])
    return directories[parent] / path.name


def _is_file_or_none(path: Path) -> bool:
    """Whether a file can take a path's place: not that of a device, a pipe or a folder."""
    return path.is_file() or not path.exists()


def _remove(directory: Path) -> None:
    shutil.rmtree(directory, ignore_errors=True)
    _unfinished.discard(directory)


def _named(paths: tuple[Path, ...]) -> str:
    if len(paths) <= 2:
        return " and ".join(map(str, paths))
    return f"files to {paths[0].parent}"
