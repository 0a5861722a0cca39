"""Files of a folder as the frames of a recording: their order and their stamps."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from decimal import Decimal
from itertools import pairwise
from pathlib import Path

from horizon_sensor_ros.core.seconds import NANOSECONDS
from horizon_sensor_ros.tools.command_errors import CommandError

UNITS_NS = {"s": NANOSECONDS, "ms": 10**6, "us": 10**3, "ns": 1}
# The seconds of a ROS stamp have 31 bits.
_LAST_NS = 2**31 * NANOSECONDS
_MOST_STAMP_BYTES = 50_000_000


@dataclass(frozen=True)
class FrameFile:
    """One frame: where it is, and when it was taken (ns)."""

    path: Path
    stamp: int


@dataclass(frozen=True)
class StampRule:
    """Where stamps come from: a file (stamp first, then perhaps the frame's name, in each line),
    the last number in the frames' names, or else a rate from a start on.

    unit : of written stamps, a key of `UNITS_NS`.
    """

    file: Path | None
    in_names: bool
    unit: str
    rate_hz: float
    start_ns: int


def frame_files(folder: Path, suffixes: Collection[str], rule: StampRule) -> list[FrameFile]:
    """Frames of a folder, by time. Numbers in names count as numbers: 9.png comes before 10.png.

    Raises CommandError where there is none, a stamp is missing, or two frames have the same.
    """
    try:
        names = [p for p in folder.iterdir() if p.suffix.lower() in suffixes and p.is_file()]
    except OSError as error:
        raise CommandError(f"{folder}: cannot be read: {error.strerror}; give a folder") from None
    if not names:
        raise CommandError(f"{folder}: has no file that ends in {', '.join(sorted(suffixes))}")
    paths = sorted(names, key=lambda path: _natural(path.name))
    if rule.file is not None:
        frames = _from_file(rule.file, paths, rule.unit)
    elif rule.in_names:
        frames = [FrameFile(path, _stamp_in_name(path, rule.unit)) for path in paths]
    else:
        period = NANOSECONDS / rule.rate_hz
        frames = [
            FrameFile(path, rule.start_ns + round(i * period)) for i, path in enumerate(paths)
        ]
        if frames[-1].stamp >= _LAST_NS:
            raise CommandError(
                f"{folder}: at {rule.rate_hz:g} frames a second the last of {len(frames)} is later "
                "than a ROS stamp can say (2^31 s); give a higher rate, or an earlier start"
            )
    frames.sort(key=lambda frame: frame.stamp)
    for one, other in pairwise(frames):
        if one.stamp == other.stamp:
            raise CommandError(
                f"{one.path} and {other.path.name} have the same stamp, "
                f"{stamp_text(one.stamp)} s; no two frames of a folder may"
            )
    return frames


def stamp_text(stamp: int) -> str:
    """Seconds with nine decimals, exactly."""
    seconds, nanoseconds = divmod(abs(stamp), NANOSECONDS)
    return f"{'-' if stamp < 0 else ''}{seconds}.{nanoseconds:09d}"


def _natural(name: str) -> list[tuple[int, str]]:
    """Key that sorts digits as numbers."""
    parts = re.split(r"(\d+)", name)
    return [(int(part), "") if i % 2 else (0, part) for i, part in enumerate(parts)]


def _stamp_in_name(path: Path, unit: str) -> int:
    numbers = re.findall(r"\d+(?:\.\d+)?", path.stem)
    if not numbers:
        raise CommandError(f"{path}: has no number in its name to take as its stamp")
    return _stamp(numbers[-1], unit, str(path))


def _from_file(file: Path, paths: Sequence[Path], unit: str) -> list[FrameFile]:
    rows = _rows(file, {path.name for path in paths})
    named = [row for row in rows if len(row[1]) > 1]
    if named and len(named) < len(rows):
        line = next(number for number, words in rows if len(words) == 1)
        raise CommandError(f"{file}, line {line}: has no frame's name, as others have")
    if named:
        known = {Path(words[1]).name: (number, words[0]) for number, words in rows}
        for path in paths:
            if path.name not in known:
                raise CommandError(f"{file}: has no line for {path}; add one, or remove the frame")
        found = [known[path.name] for path in paths]
    else:
        if len(rows) != len(paths):
            raise CommandError(
                f"{file}: has {len(rows)} stamps, and {paths[0].parent} {len(paths)} frames; "
                "give one a frame, or add the frames' names"
            )
        found = [(number, words[0]) for number, words in rows]
    return [
        FrameFile(path, _stamp(text, unit, f"{file}, line {number}"))
        for path, (number, text) in zip(paths, found, strict=True)
    ]


def _rows(file: Path, names: Collection[str]) -> list[tuple[int, list[str]]]:
    """Number and words of each line that is neither empty nor a comment.

    names : of the frames.
    """
    try:
        if file.stat().st_size > _MOST_STAMP_BYTES:
            raise CommandError(
                f"{file}: is larger than {_MOST_STAMP_BYTES} bytes; no list of stamps"
            )
        text = file.read_text(encoding="utf-8")
    except OSError as error:
        raise CommandError(f"{file}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise CommandError(f"{file}: is not a text file in UTF-8") from None
    lines = enumerate(text.split("\n"), 1)
    rows = [(number, words) for number, line in lines if (words := _words(line, names))]
    if not rows:
        raise CommandError(f"{file}: has no stamps")
    return rows


def _words(line: str, names: Collection[str]) -> list[str]:
    """Stamp and, perhaps, a frame's name, in which there may be spaces and what begins a comment
    elsewhere.
    """
    stamp = re.match(r"\s*([^\s,;#]+)[\s,;]+", line)
    if stamp is not None:
        name = line[stamp.end() :].strip().strip('"')
        if Path(name).name in names:
            return [stamp[1], name]
    return line.split("#", 1)[0].replace(",", " ").replace(";", " ").split()


def _stamp(text: str, unit: str, where: str) -> int:
    try:
        number = Decimal(text) * UNITS_NS[unit]
    except ArithmeticError:
        number = Decimal("nan")
    if not number.is_finite():
        raise CommandError(f"{where}: {text[:40]!r} is not a stamp; a number of {unit} is")
    whole = int(number.to_integral_value()) if 0 <= number <= _LAST_NS else -1
    if not 0 <= whole < _LAST_NS:
        raise CommandError(
            f"{where}: {text[:40]} {unit} is not a time that a ROS stamp can hold (0 to 2^31 s); "
            f"--stamp-unit says what the numbers are: {', '.join(UNITS_NS)}"
        )
    return whole
