"""What the nodes are called, which is also what their executables are called."""

from __future__ import annotations

HORIZON_NODES = ("local_vertical_node", "attitude_node")
TARGET_NODE = "target_pose_node"
NODES = (*HORIZON_NODES, TARGET_NODE)
