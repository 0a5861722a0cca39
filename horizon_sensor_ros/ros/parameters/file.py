"""ROS parameter files."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from horizon_sensor_ros.ros.parameters.parameter import ParameterError
from horizon_sensor_ros.ros.yaml_file import YamlFileError, read_yaml


def read_parameter_file(path: Path, node: str, namespace: str = "/") -> dict[str, Any]:
    """Return the values that a ROS parameter file has for a node: dotted names, as ROS reads it.

    Later entries of the file that match the node override earlier ones. Raises ParameterError,
    saying what is wrong with the file.
    """
    try:
        content = read_yaml(path, aliases=False)
    except YamlFileError as error:
        raise ParameterError(f"{path} {error}") from None
    if content is None:
        return {}
    full_name = "/".join(["", *namespace.strip("/").split("/"), node]).replace("//", "/")
    values: dict[str, Any] = {}
    entries = list(_node_entries(content, ""))
    if not entries:
        raise ParameterError(f"{path} is no ROS parameter file: it has no ros__parameters")
    stray = next(_outside(content, ""), "")
    if stray:
        raise ParameterError(f"{path} has {stray} outside of ros__parameters, as ROS takes none")
    for pattern, parameters in entries:
        if _matches(pattern, full_name):
            values.update(_flat(parameters, ""))
    return values


def why_refused(path: Path) -> str:
    """Why ROS does not take a parameter file, for a person; empty where nothing is seen to be wrong
    with it.
    """
    try:
        content = read_yaml(path, aliases=False)
    except YamlFileError as error:
        return f"{path} {error}"
    for pattern, parameters in _node_entries(content, ""):
        for name, value in _flat(parameters, ""):
            if not isinstance(value, list):
                continue
            kinds = {type(each) for each in value}
            if kinds == {int, float}:
                what = "mixes whole numbers and decimals: write 0.0 for 0"
            elif len(kinds) > 1:
                what = "mixes values of several kinds"
            elif not value:
                what = "is an empty list: name its values or leave it out"
            else:
                continue
            return f"{path}: {name} (of {pattern}) {what}"
    return ""


def misspelt_sections(path: Path, nodes: Sequence[str]) -> list[tuple[str, str]]:
    """Sections of a ROS parameter file, a valid one, whose node's name is nearly one of these
    nodes', and that name: other nodes' sections are none of our business.
    """
    found = []
    for pattern, _ in _node_entries(read_yaml(path, aliases=False), ""):
        name = pattern.rpartition("/")[2]
        close = difflib.get_close_matches(name, nodes, n=1, cutoff=0.85)
        if close and name not in nodes:
            found.append((name, close[0]))
    return found


def _node_entries(content: Any, prefix: str) -> Iterator[tuple[str, Any]]:
    """Node name patterns and their parameters; namespaces may be nested."""
    if not isinstance(content, dict):
        return
    for key, value in content.items():
        if key == "ros__parameters":
            if isinstance(value, dict):
                yield prefix, value
        else:
            yield from _node_entries(value, f"{prefix}/{str(key).strip('/')}")


def _outside(content: Any, prefix: str) -> Iterator[str]:
    """Names of the values that belong to no node."""
    if not isinstance(content, dict):
        yield prefix or "a value"
        return
    for key, value in content.items():
        if key != "ros__parameters":
            yield from _outside(value, f"{prefix}/{str(key).strip('/')}".lstrip("/"))


def _matches(pattern: str, full_name: str) -> bool:
    # As rcl: a name without a slash in front is one in the root namespace.
    expression = "".join(
        r"(/\w+)*" if token == "**" else r"/\w+" if token == "*" else "/" + re.escape(token)
        for token in pattern.strip("/").split("/")
    )
    return re.fullmatch(expression, full_name) is not None


def _flat(parameters: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, Any]]:
    for key, value in parameters.items():
        name = f"{prefix}{key}"
        if isinstance(value, dict):
            yield from _flat(value, f"{name}.")
        else:
            yield name, value
