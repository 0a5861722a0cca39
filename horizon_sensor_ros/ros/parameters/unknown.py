"""Names of parameters that mean nothing to any node."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from horizon_sensor_ros.ros.parameters.camera import OF_A_CAMERA
from horizon_sensor_ros.ros.parameters.common import NODES_PARAMETER
from horizon_sensor_ros.ros.parameters.horizon import horizon_parameters
from horizon_sensor_ros.ros.parameters.target import TARGET_PARAMETERS

# Declared by rclpy itself, and the same in every node.
_OF_RCLPY = re.compile(
    r"use_sim_time|start_type_description_service"
    r"|qos_overrides\..+\.(publisher|subscription)\.(history|depth|reliability)"
)


_OF_SOME_CAMERA = tuple(of("").name for of in OF_A_CAMERA)


def unknown_parameters(values: Mapping[str, Any]) -> list[str]:
    """Names among these values that mean nothing to any node.

    One file serves all nodes, so another node's parameter is known, and so are those of an unused
    camera.
    """
    parameters = (*horizon_parameters(values), *TARGET_PARAMETERS, NODES_PARAMETER)
    known = {p.name for p in parameters}
    return [
        name
        for name in values
        if name not in known
        and not name.endswith(_OF_SOME_CAMERA)
        and not _OF_RCLPY.fullmatch(name)
    ]
