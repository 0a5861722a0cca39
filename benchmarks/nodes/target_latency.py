"""Latency of target_pose_node beside that of a bare subscriber to the same clouds.

`python benchmarks/run.py --only target_latency`. A cloud's latency is from just before its
publishing to the arrival of its pose; of the bare subscriber, to its callback.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import PointCloud2
from tqdm import tqdm

from horizon_sensor_ros.core.seconds import s_from_ns
from horizon_sensor_ros.ros.messages.sensors import cloud_message
from horizon_sensor_ros.ros.messages.stamps import ns_from_time, time_from_ns
from horizon_sensor_ros.ros.pipelines.target_pipeline import CLOUD_TOPIC
from horizon_sensor_ros.sim.tof_camera import ToFCamera
from horizon_sensor_ros.sim.tumbling import TumblingTarget
from horizon_sensor_ros.tools.package_share import share_directory
from horizon_sensor_ros.tools.private_domain import isolated_environment, private_domain
from tables import Options, Table, number, percentile, verdict

RATE_HZ = 10.0
POINTS = 204 * 204
NODE = "target_pose_node"
_DRAWN = 40
# Pixels a side with which the target alone returns that many points.
_FINER = 560
_PATIENCE_S = 30.0
_QUIET_S = 2.0
# A process that stays on one core, its later threads included.
_PINNED = "import os, runpy, sys; os.sched_setaffinity(0, {{{core}}}); {then}"
_RUN_NODE = f"runpy.run_module('horizon_sensor_ros.ros.{NODE}', run_name='__main__')"


@dataclass
class _Heard:
    """Latencies (s) of the node's poses and of the bare subscriber's clouds."""

    sent: int
    poses_s: list[float] = field(default_factory=list)
    clouds_s: list[float] = field(default_factory=list)
    node_cpu_s: float = np.nan


def run(options: Options) -> list[Table]:
    """The table."""
    rows: list[tuple[str, ...]] = []
    before = os.getloadavg()[0]
    for name, clouds in (("organised, 204 x 204", _organised()), ("plain, all returned", _plain())):
        found = _measure(clouds, options.frames, name)
        for who, latencies, cpu in (
            (NODE, found.poses_s, found.node_cpu_s / found.sent), ("bare", found.clouds_s, np.nan),
        ):  # fmt: skip
            lost = found.sent - len(latencies)
            rows.append((
                name, who, f"{len(latencies)} of {found.sent}", verdict(lost, 0),
                number(1e3 * percentile(latencies, 50), 1),
                number(1e3 * percentile(latencies, 99), 1), number(1e3 * cpu, 1),
            ))  # fmt: skip
    return [
        Table(
            f"Latency, clouds of {POINTS} points at {RATE_HZ:g} Hz",
            ("cloud", "listener", "arrived", "lost", "ms, median", "ms, p99", "CPU ms a cloud"),
            tuple(rows),
            (
                "organised: as the paper's camera sends it, NaN where the target is not; plain: "
                "every point on the target, from a finer camera",
                f"all of {NODE} on one core, which publisher and bare subscriber leave to it where "
                "there is another; best effort, config/fastdds.xml",
                f"load of the machine's {os.cpu_count()} cores before {before:.1f}, after "
                f"{os.getloadavg()[0]:.1f}: where others work on them the times are theirs",
            ),
        )
    ]


def _target(camera: ToFCamera) -> TumblingTarget:
    return TumblingTarget(camera=camera, position_m=(0.0, 0.0, 5.3), velocity_m_s=(0.0, 0.0, 0.0))


def _organised() -> list[np.ndarray]:
    target = _target(ToFCamera())
    return [target.scan(k / RATE_HZ).points for k in range(_DRAWN)]


def _plain() -> list[np.ndarray]:
    finer = ToFCamera(width=_FINER, height=_FINER, pixel_pitch_m=40e-6 * 204 / _FINER)
    target = _target(finer)
    # The last rows of the target go, to the number of points that is asked for.
    clouds = [target.scan(k / RATE_HZ).plain()[:POINTS] for k in range(_DRAWN)]
    assert all(len(cloud) == POINTS for cloud in clouds)
    return clouds


def _measure(clouds: Sequence[np.ndarray], count: int, name: str) -> _Heard:
    """Send clouds back and forth through the drawn motion."""
    there_and_back = [*clouds, *clouds[-2:0:-1]]
    messages = [cloud_message(cloud, 0, "tof_optical") for cloud in there_and_back]
    cores = sorted(os.sched_getaffinity(0))
    with private_domain() as domain, _elsewhere(domain, cores) as node:
        bare = _process(f"import {__name__}; {__name__}.listen()", cores[0])
        pose_node = _process(_RUN_NODE, cores[-1])
        try:
            return _flight(node, messages, count, name, pose_node, bare)
        finally:
            for process in (pose_node, bare):
                process.send_signal(signal.SIGINT)
            for process in (pose_node, bare):
                process.communicate(timeout=_PATIENCE_S)


@contextmanager
def _elsewhere(domain: int, cores: Sequence[int]) -> Iterator[Any]:
    """Keep this process off the last core, and give it a ROS node in a domain of its own."""
    before = dict(os.environ)
    os.environ.update(isolated_environment(domain))
    profile = share_directory() / "config" / "fastdds.xml"
    os.environ["FASTRTPS_DEFAULT_PROFILES_FILE"] = str(profile)
    os.sched_setaffinity(0, cores[:-1] or cores)
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain)
    try:
        yield rclpy.create_node("latency", context=context)
    finally:
        rclpy.shutdown(context=context)
        os.sched_setaffinity(0, cores)
        os.environ.clear()
        os.environ.update(before)


def _process(then: str, core: int) -> subprocess.Popen[str]:
    path = os.pathsep.join([str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")])
    return subprocess.Popen(
        [sys.executable, "-c", _PINNED.format(core=core, then=then)],
        env={**os.environ, "PYTHONPATH": path},
        stdout=subprocess.PIPE,
        text=True,
    )


def listen() -> None:
    """Be the bare subscriber: print the stamp of each cloud and its latency, in ns."""
    rclpy.init()
    node = rclpy.create_node("bare")

    def hear(message: PointCloud2) -> None:
        print(_ns(message), time.time_ns() - _ns(message), flush=True)

    node.create_subscription(PointCloud2, CLOUD_TOPIC, hear, qos_profile_sensor_data)
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
        rclpy.try_shutdown()


def _flight(
    node: Any,
    messages: Sequence[PointCloud2],
    count: int,
    name: str,
    pose_node: subprocess.Popen[str],
    bare: subprocess.Popen[str],
) -> _Heard:
    heard_s: dict[int, float] = {}

    def hear(message: PoseWithCovarianceStamped) -> None:
        heard_s[_ns(message)] = s_from_ns(time.time_ns() - _ns(message))

    publisher = node.create_publisher(PointCloud2, CLOUD_TOPIC, qos_profile_sensor_data)
    node.create_subscription(PoseWithCovarianceStamped, "target/pose", hear, QoSProfile(depth=50))
    executor = rclpy.executors.SingleThreadedExecutor(context=node.context)
    executor.add_node(node)
    sent: list[int] = []

    def send(k: int) -> None:
        message = messages[k % len(messages)]
        sent.append(time.time_ns())
        message.header.stamp = time_from_ns(sent[-1])
        publisher.publish(message)

    def spin_until(deadline: float) -> None:
        while (left := deadline - time.monotonic()) > 0:
            executor.spin_once(timeout_sec=left)

    # Until both listen, and the node has answered the same cloud some times.
    deadline = time.monotonic() + _PATIENCE_S
    while publisher.get_subscription_count() < 2 or len(heard_s) < 10:
        if time.monotonic() > deadline:
            raise RuntimeError(f"{NODE} and the bare subscriber did not answer")
        send(0)
        spin_until(time.monotonic() + 1.0 / RATE_HZ)
    sent.clear()
    cpu_s = _cpu_s(pose_node.pid)
    due = time.monotonic()
    for k in tqdm(range(count), desc=name, unit="cloud"):
        send(k)
        due += 1.0 / RATE_HZ
        spin_until(due)
    cpu_s = _cpu_s(pose_node.pid) - cpu_s
    deadline = time.monotonic() + _QUIET_S
    while time.monotonic() < deadline and sent[-1] not in heard_s:
        spin_until(time.monotonic() + 0.05)
    bare.send_signal(signal.SIGINT)
    assert bare.stdout is not None
    lines = [line.split() for line in bare.stdout.read().splitlines()]
    clouds_s = {int(stamp): s_from_ns(int(late)) for stamp, late in lines}
    return _Heard(
        count, *([d[s] for s in sent if s in d] for d in (heard_s, clouds_s)), node_cpu_s=cpu_s
    )


def _cpu_s(pid: int) -> float:
    """CPU seconds that a process has used so far."""
    with open(f"/proc/{pid}/stat", encoding="ascii") as file:
        fields = file.read().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _ns(message: Any) -> int:
    return ns_from_time(message.header.stamp)
