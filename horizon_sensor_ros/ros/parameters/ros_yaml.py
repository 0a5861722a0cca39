"""What ROS reads in a parameter file: rcl makes other values of a text than YAML does.

As rcl_yaml_param_parser: `y` is true, `null` the string, `1:30` too, `-.5` a number; a name may be
there twice, and so may a node's. Held against real nodes by the tests.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from horizon_sensor_ros.ros.files.yaml_file import YamlFileError, read_yaml, shown, yaml_events

PARAMETERS = "ros__parameters"

# A node's full name, each word of which may be a wildcard.
_NODE = re.compile(r"(/(\*\*?|[A-Za-z_]\w*))+", re.ASCII)

_TRUE = {"y", "Y", "yes", "Yes", "YES", "true", "True", "TRUE", "on", "On", "ON"}
_FALSE = {"n", "N", "no", "No", "NO", "false", "False", "FALSE", "off", "Off", "OFF"}
# C's strtoll with base 0, and strtod.
_INTEGER = re.compile(r"(?P<sign>[-+]?)(?:0[xX](?P<hex>[0-9a-fA-F]+)|(?P<digits>\d+))", re.ASCII)
_OCTAL = re.compile(r"0[0-7]*")
_DOUBLE = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|[-+]?(inf|infinity)|[-+]?nan", re.I)
_HEX_DOUBLE = re.compile(r"[-+]?0x([\da-f]+\.?[\da-f]*|\.[\da-f]+)(p[-+]?\d+)?", re.I | re.ASCII)
_MOST_DIGITS = 400  # no number has more that counts
_SPECIAL = re.compile(r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")
# Of values of several kinds for one name rcl takes the first kind, wherever it stands.
_RANKS: tuple[type, ...] = (bool, int, float, str)


class ParameterFile:
    """What is in a file.

    sections : each node's parameters by dotted name, by the pattern of the node's full name, in the
    order of the file; where a pattern or a name is there again, as rcl merges them. stray : names
    of values that belong to no node.
    """

    def __init__(self) -> None:
        self.sections: dict[str, dict[str, Any]] = {}
        self.stray: list[str] = []


def read_ros_yaml(path: Path) -> ParameterFile:
    """Return what ROS reads in a parameter file.

    Raises YamlFileError, which says in one line why it cannot be used. Lists come back as they are:
    `list_fault` says what is wrong with one.
    """
    found: ParameterFile = read_yaml(path, lambda text: _Reading(yaml_events(text)).file)
    return found


def list_fault(value: Any) -> str:
    """What is wrong with a value as a list of ROS, of which all have one kind; empty where nothing
    is.
    """
    if not isinstance(value, list):
        return ""
    if not value:
        return "is an empty list: name its values or leave it out"
    kinds = {type(each) for each in value}
    if kinds == {int, float}:
        return "mixes whole numbers and decimals: write 0.0 for 0"
    return "mixes values of several kinds" if len(kinds) > 1 else ""


def ros_scalar(text: str) -> bool | int | float | str:
    """Return what rcl makes of an unquoted value."""
    if text in _TRUE or text in _FALSE:
        return text in _TRUE
    if len(text) > _MOST_DIGITS:
        return text
    whole = _INTEGER.fullmatch(text)
    if whole:
        digits = whole["digits"]
        if whole["hex"]:
            number: int | None = int(whole["hex"], 16)
        elif digits.startswith("0"):
            number = int(digits, 8) if _OCTAL.fullmatch(digits) else None
        else:
            number = int(digits)
        signed = None if number is None else -number if whole["sign"] == "-" else number
        if signed is not None and -(2**63) <= signed < 2**63:
            return signed
    decimal = _as_double(text)
    return text if decimal is None else decimal


def _as_double(text: str) -> float | None:
    """Return what strtod makes of all of a text; None where that is nothing, or out of range."""
    if _SPECIAL.fullmatch(text):
        return float(text.replace(".", ""))
    if _HEX_DOUBLE.fullmatch(text):
        try:
            return float.fromhex(text)
        except OverflowError:
            return None
    if not _DOUBLE.fullmatch(text):
        return None
    number = float(text)
    digits = re.split("[eE]", text)[0]
    if "n" in text.lower():
        return number
    lost = abs(number) < sys.float_info.min and re.search("[1-9]", digits) is not None
    return None if lost or abs(number) == float("inf") else number


class _Reading:
    """Goes through the events of a file, once."""

    def __init__(self, events: Iterator[yaml.Event]) -> None:
        self._events = events
        self.file = ParameterFile()
        for event in events:
            if isinstance(event, yaml.MappingStartEvent):
                self._nodes("")
            elif isinstance(event, yaml.SequenceStartEvent | yaml.ScalarEvent):
                self._pass_over(event)
                self.file.stray.append("a value")

    def _next(self) -> yaml.Event:
        event = next(self._events)
        if isinstance(event, yaml.AliasEvent):
            raise YamlFileError("has YAML aliases, which parameter files cannot have")
        return event

    def _keys(self) -> Iterator[tuple[str, int]]:
        """Keys of a mapping with their lines; what they are of comes next each time."""
        while not isinstance(event := self._next(), yaml.MappingEndEvent):
            line = event.start_mark.line + 1 if event.start_mark else 0
            if not isinstance(event, yaml.ScalarEvent):
                raise YamlFileError(f"has a key that is no word (line {line})")
            yield event.value, line

    def _nodes(self, prefix: str) -> None:
        """Take what is in names of nodes or their namespaces."""
        own = False
        for key, line in self._keys():
            event = self._next()
            name = f"{prefix.removesuffix('/')}/{key}" if prefix else f"/{key.removeprefix('/')}"
            if not isinstance(event, yaml.MappingStartEvent):
                self._pass_over(event)
                self.file.stray.append(name.lstrip("/"))
            elif key != PARAMETERS:
                self._nodes(name)
            elif own:
                raise YamlFileError(f"has {PARAMETERS} twice for {prefix} (line {line})")
            elif not prefix:
                raise YamlFileError(
                    f"has {PARAMETERS} under no node's name (line {line}); /**: above is for all"
                )
            elif not _NODE.fullmatch(prefix):
                raise YamlFileError(
                    f"has parameters of {shown(prefix)}, which is no node's name (line {line}): "
                    "its words are letters, digits and _, no digit first, or * or ** alone"
                )
            else:
                own = True
                self._parameters(self.file.sections.setdefault(prefix, {}), "")

    def _parameters(self, values: dict[str, Any], prefix: str) -> bool:
        """Take parameters; return whether there are any."""
        line = 0
        for key, line in self._keys():
            event = self._next()
            name = f"{prefix}{key}"
            if isinstance(event, yaml.MappingStartEvent):
                if not self._parameters(values, f"{name}."):
                    raise YamlFileError(f"has nothing in {shown(name)} (line {line})")
                continue
            value = self._value(event, f"{shown(name)} (line {line})")
            if name not in values or _rank(value) <= _rank(values[name]):
                values[name] = value
        return line > 0

    def _value(self, event: yaml.Event, name: str) -> Any:
        if isinstance(event, yaml.ScalarEvent):
            if event.value == "" and event.style is None:
                raise YamlFileError(f"has no value for {name}")
            return _scalar(event)
        items = []
        while not isinstance(event := self._next(), yaml.SequenceEndEvent):
            if not isinstance(event, yaml.ScalarEvent):
                raise YamlFileError(f"has a list or a mapping in the list {name}")
            items.append(_scalar(event))
        return items

    def _pass_over(self, event: yaml.Event) -> None:
        depth = 0
        while True:
            depth += isinstance(event, yaml.CollectionStartEvent)
            depth -= isinstance(event, yaml.CollectionEndEvent)
            if not depth:
                return
            event = self._next()


def _scalar(event: yaml.ScalarEvent) -> Any:
    told_to_be_text = event.tag == "tag:yaml.org,2002:str"
    return event.value if event.style in ("'", '"') or told_to_be_text else ros_scalar(event.value)


def _rank(value: Any) -> int:
    """Return where a value's kind stands in rcl's order: scalars first, then lists."""
    if isinstance(value, list):
        return len(_RANKS) + (_RANKS.index(type(value[0])) if value else len(_RANKS))
    return _RANKS.index(type(value))
