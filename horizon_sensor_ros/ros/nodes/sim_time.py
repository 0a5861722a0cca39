"""Simulated time, without times that rclpy's clocks do not have."""

from __future__ import annotations

from typing import Any

from rclpy.node import Node
from rosgraph_msgs.msg import Clock

_SELDOM_S = 10.0


def refuse_times_before_1970(node: Node) -> None:
    """Let a node take the time from /clock as rclpy does, but for one that is negative: rclpy
    raises its error, a ValueError, and so ends the process.
    """
    source: Any = getattr(node, "_time_source", None)
    take = getattr(source, "clock_callback", None)
    if take is None:
        return  # an rclpy that is made otherwise has its own way with such times

    def take_later_ones(msg: Clock) -> None:
        if msg.clock.sec < 0:
            node.get_logger().warning(
                f"not taken: the time on /clock is negative, {msg.clock.sec} s",
                throttle_duration_sec=_SELDOM_S,
            )
            return
        take(msg)

    # Of the subscription that there is, and of those to come: use_sim_time can be set live.
    source.clock_callback = take_later_ones
    subscription = getattr(source, "_clock_sub", None)
    if subscription is not None:
        subscription.callback = take_later_ones
