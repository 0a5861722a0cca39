"""How a node ends, and what it leaves behind in its process."""

from __future__ import annotations

import gc
import os
from threading import Event, Thread

import pytest
import rclpy
from node_processes import Listener
from rclpy.context import Context
from rclpy.parameter import Parameter

from horizon_sensor_ros.ros.nodes.target_node import TargetPoseNode
from horizon_sensor_ros.ros.process.participant_end import on_one_core


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


@pytest.mark.skipif(not hasattr(os, "sched_getaffinity"), reason="threads have no cores here")
def test_all_threads_have_one_core_meanwhile_and_theirs_afterwards() -> None:
    end = Event()
    threads = [Thread(target=end.wait) for _ in range(3)]
    for thread in threads:
        thread.start()
    try:
        before = [os.sched_getaffinity(thread.native_id) for thread in threads]
        with on_one_core():
            (core,) = os.sched_getaffinity(0)
            assert all(os.sched_getaffinity(thread.native_id) == {core} for thread in threads)
        assert [os.sched_getaffinity(thread.native_id) for thread in threads] == before
    finally:
        end.set()
        for thread in threads:
            thread.join()
