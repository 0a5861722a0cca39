"""Time from exec to active of a node, and of a bare rclpy node that imports numpy and cv2."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

# What `ros2 run` starts, told to wait when it has just become active.
_NODE = """
import sys
from horizon_sensor_ros.ros.process import executable

def wait():
    print("ready", flush=True)
    sys.stdin.read()
    raise SystemExit

def made(classes, **options):
    nodes = make(classes, **options)
    for node in nodes:
        node.warm_up = wait
    return nodes

make = executable._made
executable._made = made
sys.argv[1:] = {arguments!r}
executable.run(["{name}"])
"""
_BARE = """
import sys
import cv2, numpy, rclpy
from rclpy.experimental import EventsExecutor
rclpy.init()
executor = EventsExecutor()
executor.add_node(rclpy.create_node("bare"))
print("ready", flush=True)
sys.stdin.read()
rclpy.shutdown()
"""


@dataclass(frozen=True)
class StartUp:
    """Seconds by the clock and of processor time, each the median of the runs."""

    wall_s: float
    cpu_s: float


def cpu_seconds(pid: int) -> float:
    """Processor time that a process has used, in it and for it."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def start_up(code: str, environment: Mapping[str, str]) -> tuple[float, float]:
    """Run a program until it says that it is ready; seconds by the clock and of processor time."""
    began = time.perf_counter()
    with subprocess.Popen(
        [sys.executable, "-c", code],
        env=dict(environment),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    ) as process:
        assert process.stdout is not None
        said = process.stdout.readline()
        taken = time.perf_counter() - began
        used = cpu_seconds(process.pid) if said else 0.0
    if said != b"ready\n":
        raise RuntimeError("a node did not start")
    return taken, used


def compare(
    name: str, arguments: list[str], environment: Mapping[str, str], runs: int
) -> tuple[StartUp, StartUp]:
    """Return those of the node and of the bare one, started in turns."""
    codes = _NODE.format(arguments=["--ros-args", *arguments], name=name), _BARE
    # As after an installation: with bytecode.
    environment = {k: v for k, v in environment.items() if k != "PYTHONDONTWRITEBYTECODE"}
    for code in codes:
        start_up(code, environment)
    taken: tuple[list[tuple[float, float]], ...] = ([], [])
    for _ in range(runs):
        for code, times in zip(codes, taken, strict=True):
            times.append(start_up(code, environment))
    node, bare = (StartUp(*np.median(times, axis=0)) for times in taken)
    return node, bare
