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
from horizon_sensor_ros.ros.process.node_names import NODES, ONE_PROCESS, full_name_of


def read_parameter_file(path: Path, node: str, namespace: str = "/") -> dict[str, Any]:
    """Return the values that a ROS parameter file has for a node: dotted names, as ROS reads it.

    Later entries of the file that match the node override earlier ones. Raises ParameterError,
    saying what is wrong with the file.
    """
    found = _read(path)
    misplaced = _misplaced(path, found)
    if misplaced:
        raise ParameterError(misplaced)
    full_name = full_name_of(node, namespace)
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


def unreached_sections(path: Path, nodes: Sequence[str]) -> list[str]:
    """What is to be said of sections of a ROS parameter file that seem to be for one of these nodes
    and reach none: their names are misspelt, or lack the namespace. Nothing of an invalid file.

    nodes : full names. Other nodes' sections are none of our business.
    """
    try:
        sections = list(_read(path).sections)
    except ParameterError:
        return []
    names = sorted({*NODES, ONE_PROCESS, *map(_last_word, nodes)})
    told = []
    for section in sections:
        name = _last_word(section)
        if name not in names:
            close = difflib.get_close_matches(name, names, n=1, cutoff=0.85)
            told += [f"section {name} is for no node: {each}? ({path})" for each in close]
            continue
        namesakes = [node for node in nodes if _last_word(node) == name]
        alike = [each for each in sections if _last_word(each) == name]
        reached = any(_matches(each, node) for each in alike for node in namesakes)
        if section == f"/{name}" and namesakes and not reached:
            told.append(
                f"section {name} is for /{name}, not for {namesakes[0]}: /**/{name}? ({path})"
            )
    return told


def _last_word(name: str) -> str:
    return name.rpartition("/")[2]


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
