"""Given parameters that a node ignores: names that mean nothing to any, an altitude without its
sigma.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping, Sequence
from typing import Any

from horizon_sensor_ros.ros.parameters.camera import OF_A_CAMERA
from horizon_sensor_ros.ros.parameters.common import NODES_PARAMETER
from horizon_sensor_ros.ros.parameters.horizon import CAMERAS, horizon_parameters
from horizon_sensor_ros.ros.parameters.parameter import Parameter
from horizon_sensor_ros.ros.parameters.target import TARGET_PARAMETERS

# Declared by rclpy itself, and the same in every node; overrides by the topic's full name.
_OF_RCLPY = re.compile(
    r"use_sim_time|start_type_description_service"
    r"|qos_overrides\./.+\.(publisher|subscription)\.(history|depth|reliability)"
)
_OF_SOME_CAMERA = tuple(of("").name for of in OF_A_CAMERA)
# The shipped file has these, whichever cameras are used.
_OF_DEFAULT_CAMERAS = {p.name for p in horizon_parameters({})}


def unknown_parameters(values: Mapping[str, Any], own: Sequence[Parameter]) -> list[str]:
    """Names among these values that mean nothing to any node.

    One file serves all nodes, so another node's parameter is known.

    own : all parameters of the node that is given the values. Where it uses cameras, what is for
    none of them is unknown: a camera's name was misspelt.
    """
    known = _known(values, own) | _OF_DEFAULT_CAMERAS
    others = () if CAMERAS in own else _OF_SOME_CAMERA
    return [
        name
        for name in values
        if name not in known and not name.endswith(others) and not _OF_RCLPY.fullmatch(name)
    ]


def ignored_parameters(values: Mapping[str, Any], own: Sequence[Parameter]) -> list[str]:
    """What is to be said of each of `unknown_parameters`: that it is ignored, and what may have
    been meant. And that a known altitude without its sigma is ignored too.
    """
    known = _known(values, own)
    told = []
    for name in unknown_parameters(values, own):
        near = difflib.get_close_matches(name, known, n=1, cutoff=0.8)
        told.append(
            f"unknown parameter {name} is ignored" + (f"; did you mean {near[0]}?" if near else "")
        )
    if CAMERAS in own and values.get("altitude_prior") and not values.get("altitude_prior_sigma"):
        told.append("altitude_prior is ignored: its altitude_prior_sigma is 0, which is not known")
    return told


def _known(values: Mapping[str, Any], own: Sequence[Parameter]) -> set[str]:
    """Names of all nodes' parameters, of cameras those that are used."""
    parameters = (*own, *horizon_parameters(values), *TARGET_PARAMETERS, NODES_PARAMETER)
    return {p.name for p in parameters}
