"""Parameters that every node has."""

from __future__ import annotations

from horizon_sensor_ros.ros.parameters.parameter import Parameter
from horizon_sensor_ros.ros.process.node_names import NODES

# Of every node, and of its part in a replay.
COMMON_PARAMETERS = (
    Parameter(
        "stale_after",
        "double",
        2.0,
        "A sensor silent for longer is reported on /diagnostics.",
        unit="s",
        minimum=0.1,
        maximum=3600.0,
        live=True,
    ),
    Parameter(
        "diagnostics_period",
        "double",
        1.0,
        "Time between two messages on /diagnostics; a change of state is sent at once.",
        unit="s",
        minimum=0.05,
        maximum=3600.0,
        live=True,
    ),
)

NODE_PARAMETERS = (
    Parameter(
        "autostart",
        "bool",
        True,
        "The node configures and activates itself; false: a lifecycle manager does.",
    ),
)

# Of the node horizon_sensor alone; a file for all nodes may have it.
NODES_PARAMETER = Parameter(
    "nodes",
    "string_array",
    list(NODES),
    "Which nodes horizon_sensor runs in its one process, and horizon_replay replays.",
)
