"""What a parameter file tells of the horizon, for tools that are none of its nodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from horizon_sensor_ros.ros.parameters.file import read_parameter_file
from horizon_sensor_ros.ros.parameters.horizon_settings import HorizonSettings, horizon_settings
from horizon_sensor_ros.ros.parameters.parameter import ParameterError
from horizon_sensor_ros.ros.process.node_names import HORIZON_NODES


def horizon_values(params: Path, namespace: str) -> list[dict[str, Any]]:
    """Return what a ROS parameter file has for each of the horizon's nodes.

    Raises ParameterError, saying what is wrong with the file.
    """
    return [read_parameter_file(params, node, namespace) for node in sorted(HORIZON_NODES)]


def settings_of_a_node(values: Sequence[Mapping[str, Any]]) -> HorizonSettings:
    """Return the settings of the first node that can run with its values; ParameterError says why
    none can. Any will do: a file that tells one node only how the cameras sit is enough.
    """
    problems: list[str] = []
    for each in values:
        try:
            return horizon_settings(each)
        except ParameterError as error:
            problems.append(str(error))
    raise ParameterError("; ".join(dict.fromkeys(problems)))


def base_frame_in(values: Sequence[Mapping[str, Any]]) -> str | None:
    """Return the base frame that is given in some of the values, None where in none."""
    return next((str(each["base_frame"]) for each in values if "base_frame" in each), None)
