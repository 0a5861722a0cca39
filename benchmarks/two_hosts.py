"""Cameras on one computer, the sensor on another: two network namespaces on this machine.

    sudo .venv/bin/python benchmarks/two_hosts.py

Each namespace has its own network interface, an end of a virtual cable, and each process its own
/dev/shm, so that nothing but UDP packets between 10.213.7.1 and 10.213.7.2 passes from the cameras
to the sensor and its estimates back. Both are gone when the script ends.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from nodes.rig import rig

HERE = Path(__file__).parent
# Small enough for the default UDP receive buffer, which holds one larger image and no more.
SIZE = "160x120"
RATE_HZ = 10.0
_ADDRESSES = ("10.213.7.1", "10.213.7.2")
_LONGEST_S = 60.0

# On the cameras' computer: takes the estimates that come back over the cable.
_LISTENER = """
import sys, time, rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped
rclpy.init()
node = rclpy.create_node("listener")
def hear(message):
    stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
    print(stamp, time.time_ns() - stamp, flush=True)
node.create_subscription(PoseWithCovarianceStamped, "attitude", hear, 100)
try:
    rclpy.spin(node)
except KeyboardInterrupt:
    pass
"""


class NoPrivilegeError(Exception):
    """This user may not make network namespaces."""


def _ip(*words: str) -> None:
    done = subprocess.run(["ip", *words], capture_output=True, text=True, check=False)
    if done.returncode:
        raise NoPrivilegeError(f"ip {' '.join(words)}: {done.stderr.strip()}")


@contextmanager
def two_hosts() -> Iterator[tuple[str, str]]:
    """Names of two namespaces with a cable between them."""
    names = tuple(f"horizon_{side}_{os.getpid()}" for side in ("cameras", "sensor"))
    ends = tuple(f"hz{side}{os.getpid() % 100000}" for side in "ab")
    made = []
    try:
        for name in names:
            _ip("netns", "add", name)
            made.append(name)
        _ip("link", "add", ends[0], "netns", names[0], "type", "veth", "peer", "name", ends[1],
            "netns", names[1])  # fmt: skip
        for name, end, address in zip(names, ends, _ADDRESSES, strict=True):
            _ip("-n", name, "address", "add", f"{address}/24", "dev", end)
            _ip("-n", name, "link", "set", end, "up")
            _ip("-n", name, "link", "set", "lo", "up")
            _ip("-n", name, "route", "add", "239.255.0.0/16", "dev", end)
        yield names[0], names[1]
    finally:
        # The cable goes with them.
        for name in made:
            subprocess.run(["ip", "netns", "delete", name], capture_output=True, check=False)


def _inside(name: str, *command: str) -> subprocess.Popen[str]:
    environment = dict(os.environ)
    environment |= {"ROS_DOMAIN_ID": "7", "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}
    for variable in ("ROS_STATIC_PEERS", "ROS_LOCALHOST_ONLY", "FASTRTPS_DEFAULT_PROFILES_FILE"):
        environment.pop(variable, None)
    own_memory = 'mount -t tmpfs tmpfs /dev/shm && exec "$@"'
    return subprocess.Popen(
        [
            *("ip", "netns", "exec", name, "unshare", "--mount", "--ipc"),
            *("sh", "-c", own_memory, "sh", sys.executable, *command),
        ],
        env=environment,
        stdout=subprocess.PIPE,
        text=True,
    )


def _ended(process: subprocess.Popen[str]) -> str:
    """End a process; what it has printed."""
    process.send_signal(signal.SIGINT)
    try:
        return process.communicate(timeout=10.0)[0]
    except subprocess.TimeoutExpired:
        process.kill()
        return process.communicate()[0]


def run(pairs: int) -> str:
    """Return what was sent and what came of it; NoPrivilegeError, RuntimeError when nothing did."""
    sensor_arguments = ["--ros-args", *rig(*map(int, SIZE.split("x"))).ros_arguments]
    with two_hosts() as (cameras, sensor):
        processes = [
            _inside(sensor, "-m", "horizon_sensor_ros.ros.attitude_node", *sensor_arguments),
            _inside(cameras, "-c", _LISTENER),
        ]
        publisher = str(HERE / "camera_publisher.py")
        options = ("--size", SIZE, "--rate", str(RATE_HZ), "--pairs", str(pairs))
        processes.append(_inside(cameras, publisher, *options))
        try:
            sent, _ = processes[-1].communicate(timeout=_LONGEST_S + pairs / RATE_HZ)
            time.sleep(0.5)
        finally:
            heard = [_ended(process) for process in processes[:2]][1]
    stamps = set(map(int, sent.split()[1:]))
    rows = [list(map(int, line.split())) for line in heard.splitlines()]
    latencies_ms = [delay * 1e-6 for stamp, delay in rows if stamp in stamps]
    if not stamps or not latencies_ms:
        raise RuntimeError("nothing arrived")
    median, high = np.percentile(latencies_ms, [50, 99])
    return (
        f"two {SIZE} mono8 cameras at {RATE_HZ:g} Hz in one network namespace, attitude_node in "
        f"another:\n{len(stamps)} pairs sent, {len(latencies_ms)} estimates; stamp to arrival of "
        f"the estimate {median:.1f} ms (median), {high:.1f} ms (99 %)"
    )


def main(argv: list[str] | None = None) -> int:
    """Print the figures; 2 when this user may not make namespaces."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--pairs", type=int, default=100)
    arguments = parser.parse_args(argv)
    try:
        print(run(arguments.pairs))
    except (NoPrivilegeError, FileNotFoundError) as error:
        print(f"needs the right to make network namespaces: {error}", file=sys.stderr)
        return 2
    except RuntimeError as error:
        print(f"two_hosts: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
