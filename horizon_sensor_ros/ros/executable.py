"""How the nodes' processes start and end.

Light on purpose: it is loaded before everything that takes time, so that a signal during start-up
already ends the process quietly.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Sequence
from importlib import import_module
from types import FrameType
from typing import Any

NODES = {
    "local_vertical_node": "horizon_sensor_ros.ros.horizon_node:LocalVerticalNode",
    "attitude_node": "horizon_sensor_ros.ros.horizon_node:AttitudeNode",
}

_WAKE_UP_S = 0.5


class _QuietEnd:
    """SIGINT and SIGTERM end the process with exit code 0, also while it starts."""

    def __init__(self) -> None:
        self.immediately = True
        self.asked_for = False
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._on_signal)

    def _on_signal(self, _number: int, _frame: FrameType | None) -> None:
        self.asked_for = True
        if self.immediately:
            os._exit(0)
        # Else rclpy's own handler, which calls this one, has ended the spinning.


def run(names: Sequence[str] = ()) -> int:
    """Run the named nodes in one executor until a signal; return the exit code.

    Without names this is the executable `horizon_sensor`: its parameter `nodes` names them.
    """
    end = _QuietEnd()
    # Before numpy is loaded: for matrices as small as ours more threads only wait for each other.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    import rclpy  # noqa: PLC0415 - takes time, and signals are taken care of only now
    from rclpy.executors import ExternalShutdownException  # noqa: PLC0415

    nodes: list[Any] = []
    initialised = False
    try:
        classes = {name: _load(where) for name, where in NODES.items()}
        end.immediately = False
        rclpy.init()
        initialised = True
        if not names:
            nodes.append(rclpy.create_node("horizon_sensor"))
            names = _nodes_parameter(nodes[0])
        feeds = _load("horizon_sensor_ros.ros.image_feed:ImageFeeds")()
        managed = [classes[name](feeds=feeds) for name in names]
        nodes += managed
        executor = _executor()
        for node in nodes:
            executor.add_node(node)
        for node in managed:
            node.bring_up()
        while not end.asked_for:
            # Not spin(): in rclpy 7.1.6 that of the EventsExecutor outlives its context.
            executor.spin_once(timeout_sec=_WAKE_UP_S)
    except (KeyboardInterrupt, ExternalShutdownException):
        return 0
    except Exception as error:
        if end.asked_for or (initialised and not rclpy.ok()):
            # Interrupted: what was half made, or half done, complains about its context.
            return 0
        program = names[0] if len(names) == 1 else "horizon_sensor"
        print(f"{program}: {' '.join(str(error).split())}", file=sys.stderr)
        return 1
    finally:
        for node in nodes:
            node.destroy_node()
        rclpy.try_shutdown()
    return 0


def _load(where: str) -> Any:
    module, name = where.split(":")
    return getattr(import_module(module), name)


def _nodes_parameter(node: Any) -> list[str]:
    names = node.declare_parameter("nodes", list(NODES)).value
    unknown = [name for name in names if name not in NODES]
    if unknown or not names or len(set(names)) != len(names):
        raise ValueError(f"nodes must be some of {', '.join(NODES)}; got {', '.join(names)}")
    return names


def _executor() -> Any:
    try:
        from rclpy.experimental import EventsExecutor  # noqa: PLC0415 - not in every rclpy
    except ImportError:
        from rclpy.executors import SingleThreadedExecutor  # noqa: PLC0415

        return SingleThreadedExecutor()
    return EventsExecutor()
