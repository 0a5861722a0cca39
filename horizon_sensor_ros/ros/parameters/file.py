"""ROS parameter files."""

from __future__ import annotations

import difflib
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from horizon_sensor_ros.ros.files.yaml_file import YamlFileError
from horizon_sensor_ros.ros.parameters.parameter import ParameterError
from horizon_sensor_ros.ros.parameters.ros_yaml import (
    PARAMETERS,
    ParameterFile,
    list_fault,
    read_ros_yaml,
)


def read_parameter_file(path: Path, node: str, namespace: str = "/") -> dict[str, Any]:
    """Return the values that a ROS parameter file has for a node: dotted names, as ROS reads it.

    Later entries of the file that match the node override earlier ones. Raises ParameterError,
    saying what is wrong with the file.
    """
    found = _read(path)
    misplaced = _misplaced(path, found)
    if misplaced:
        raise ParameterError(misplaced)
    full_name = "/".join(["", *namespace.strip("/").split("/"), node]).replace("//", "/")
    values: dict[str, Any] = {}
    for pattern, parameters in found.sections.items():
        own = _matches(pattern, full_name)
        for name, value in parameters.items():
            fault = list_fault(value)
            # An empty list is nothing given, until a node asks for it.
            if fault and (own or value):
                raise ParameterError(f"{path}: {name} (of {pattern}) {fault}")
        if own:
            values.update(parameters)
    return values


def why_refused(path: Path) -> str:
    """Why ROS does not take a parameter file, for a person; empty where nothing is seen to be wrong
    with it.
    """
    try:
        found = _read(path)
    except ParameterError as error:
        return str(error)
    misplaced = _misplaced(path, found)
    if misplaced:
        return misplaced
    for pattern, parameters in found.sections.items():
        for name, value in parameters.items():
            fault = list_fault(value)
            if fault:
                return f"{path}: {name} (of {pattern}) {fault}"
    return ""


def _misplaced(path: Path, found: ParameterFile) -> str:
    """What stands where ROS takes no parameters, for a person; empty where nothing does."""
    if not found.stray:
        return ""
    if any(name.rpartition("/")[2] == PARAMETERS for name in found.stray):
        return f"{path} has nothing under {PARAMETERS}: what belongs there has to be indented more"
    if not found.sections:
        return f"{path} is no ROS parameter file: it has no {PARAMETERS}"
    return f"{path} has {found.stray[0]} outside of {PARAMETERS}, as ROS takes none"


def misspelt_sections(path: Path, nodes: Sequence[str]) -> list[tuple[str, str]]:
    """Sections of a ROS parameter file, a valid one, whose node's name is nearly one of these
    nodes', and that name: other nodes' sections are none of our business.
    """
    found = []
    for pattern in _read(path).sections:
        name = pattern.rpartition("/")[2]
        close = difflib.get_close_matches(name, nodes, n=1, cutoff=0.85)
        if close and name not in nodes:
            found.append((name, close[0]))
    return found


def _read(path: Path) -> ParameterFile:
    try:
        return read_ros_yaml(path)
    except YamlFileError as error:
        raise ParameterError(f"{path} {error}") from None


def _matches(pattern: str, full_name: str) -> bool:
    # As rcl: a name without a slash in front is one in the root namespace.
    expression = "".join(
        r"(/\w+)*" if token == "**" else r"/\w+" if token == "*" else "/" + re.escape(token)
        for token in pattern.strip("/").split("/")
    )
    return re.fullmatch(expression, full_name) is not None
