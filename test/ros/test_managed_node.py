"""What a node leaves behind in its process."""

from __future__ import annotations

import gc

import rclpy
from node_processes import Listener
from rclpy.context import Context
from rclpy.parameter import Parameter

from horizon_sensor_ros.ros.target_node import TargetPoseNode


def test_a_destroyed_node_leaves_the_graph_without_the_garbage_collector(ros_domain: int) -> None:
    listener = Listener(ros_domain)
    context = Context()
    rclpy.init(context=context, domain_id=ros_domain)
    node = TargetPoseNode(
        context=context, parameter_overrides=[Parameter("autostart", value=False)]
    )

    def known() -> bool:
        return "target_pose_node" in listener.node.get_node_names()

    gc.disable()
    try:
        listener.wait(known, "the node")
        node.destroy_node()
        listener.wait(lambda: not known(), "the node's end")
    finally:
        gc.enable()
        rclpy.shutdown(context=context)
        listener.close()
