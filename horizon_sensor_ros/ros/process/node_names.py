"""What the nodes are called, which is also what their executables are called."""

from __future__ import annotations

HORIZON_NODES = ("local_vertical_node", "attitude_node")
TARGET_NODE = "target_pose_node"
NODES = (*HORIZON_NODES, TARGET_NODE)
ONE_PROCESS = "horizon_sensor"  # the executable that runs some of them in one process


def full_name_of(name: str, namespace: str) -> str:
    """Full name of a relative one, of a node or a topic, in a namespace."""
    return "/".join(["", *namespace.strip("/").split("/"), name]).replace("//", "/")


def nodes_of(names: object) -> list[str]:
    """Nodes that the parameter `nodes` names; ValueError where it cannot be."""
    given = [*names] if isinstance(names, list | tuple) else [names] if names else []
    known = [name for name in given if name in NODES]
    if known != given or not given or len(set(given)) != len(given):
        got = ", ".join(map(str, given)) or "none"
        raise ValueError(f"nodes must be some of {', '.join(NODES)}, each once, got {got}")
    return known
