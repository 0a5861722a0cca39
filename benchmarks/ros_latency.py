"""The live node beside a bare subscriber to the same cameras: latency, losses, load, start-up.

    python benchmarks/ros_latency.py              # one minute of 1024 x 1024, one of 640 x 480

The publisher alone has config/fastdds.xml. Latency is from the stamp, taken before publishing,
until both images are there (bare), or until the estimate is there in a third process (node).
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import cv2
import numpy as np

from horizon_sensor_ros.ros.messages.sensors import camera_info_message, encoded_image
from horizon_sensor_ros.ros.parameters.horizon_settings import horizon_settings
from horizon_sensor_ros.ros.pipelines.horizon_pipeline import HorizonPipeline
from horizon_sensor_ros.tools.package_share import share_directory
from horizon_sensor_ros.tools.private_domain import isolated_environment, private_domain
from nodes.rig import rig
from nodes.start_up import compare, cpu_seconds
from tables import Table, number, verdict

HERE = Path(__file__).parent
NODE = "local_vertical_node"
RATE_HZ = 30.0
_CORE_PAIRS = 100

# Prints stamp and arrival of each message; the executor is the nodes' own.
_LISTENER = """
import sys, time, rclpy
from rclpy.experimental import EventsExecutor
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import Image
from geometry_msgs.msg import Vector3Stamped
from diagnostic_msgs.msg import DiagnosticArray
rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
node = rclpy.create_node("listener_" + sys.argv[1])
rows = []
def hear(message):
    now = time.time_ns()
    rows.append((message.header.stamp.sec * 10**9 + message.header.stamp.nanosec, now))
def diagnose(message):
    pairs = [p.key + "=" + p.value.replace(" ", "_") for p in message.status[0].values]
    rows.append((0, " ".join(pairs)))
if sys.argv[1] == "images":
    for camera in ("camera_1", "camera_2"):
        topic = camera + "/image_raw"
        node.create_subscription(Image, topic, hear, rclpy.qos.qos_profile_sensor_data)
else:
    node.create_subscription(Vector3Stamped, "local_vertical", hear, 1000)
    node.create_subscription(DiagnosticArray, "/diagnostics", diagnose, 1000)
executor = EventsExecutor()
executor.add_node(node)
import signal
ended = []
signal.signal(signal.SIGINT, lambda *_: ended.append(1))
while not ended:
    executor.spin_once(timeout_sec=0.5)
for row in rows:
    print(*row)
"""


@dataclass(frozen=True)
class Run:
    """One run: pairs sent; latencies, ms, of whole pairs and of estimates; processor time used."""

    sent: int
    bare_ms: np.ndarray
    node_ms: np.ndarray
    bare_cpu: float
    node_cpu: float
    duration_s: float
    rejected: str


def measure(size: str, pairs: int, environment: Mapping[str, str]) -> Run:
    """Run publisher, bare subscriber, node and listener together."""
    cameras = rig(*map(int, size.split("x")))
    profile = str(share_directory() / "config" / "fastdds.xml")
    node = ["-m", f"horizon_sensor_ros.ros.{NODE}", "--ros-args", *cameras.ros_arguments]
    commands = (["-c", _LISTENER, "images"], node, ["-c", _LISTENER, "estimates"])
    processes = [_started(command, environment) for command in commands]
    options = ("--size", size, "--rate", str(RATE_HZ), "--pairs", str(pairs), "--listeners", "2")
    publisher = _started(
        [str(HERE / "camera_publisher.py"), *options],
        {**environment, "FASTRTPS_DEFAULT_PROFILES_FILE": profile},
    )
    try:
        # The first of the publisher's words is that it begins.
        assert publisher.stdout is not None
        publisher.stdout.readline()
        used = [cpu_seconds(process.pid) for process in processes]
        began = time.monotonic()
        sent = publisher.communicate(timeout=pairs / RATE_HZ + 120.0)[0]
        duration = time.monotonic() - began
        used = [cpu_seconds(p.pid) - before for p, before in zip(processes, used, strict=True)]
    finally:
        for process in (publisher, *processes):
            process.send_signal(signal.SIGINT)
        heard = [process.communicate(timeout=20.0)[0] for process in processes]
    stamps = set(map(int, sent.split()))
    arrivals: dict[int, list[int]] = {stamp: [] for stamp in stamps}
    for line in heard[0].splitlines():
        stamp, now = map(int, line.split())
        arrivals.get(stamp, []).append(now)
    bare = [max(times) - stamp for stamp, times in arrivals.items() if len(times) == 2]
    rows = [line.split(maxsplit=1) for line in heard[2].splitlines()]
    estimates = [int(now) - int(stamp) for stamp, now in rows if int(stamp) in stamps]
    reports = [text for stamp, text in rows if stamp == "0"]
    last = reports[-1].split() if reports else []
    causes = [word for word in last if word.startswith("rejected_")]
    return Run(
        len(stamps),
        np.array(bare) * 1e-6,
        np.array(estimates) * 1e-6,
        used[0],
        used[1],
        duration,
        ", ".join(causes).replace("rejected_", "").replace("=", " ") or "none",
    )


def _started(command: list[str], environment: Mapping[str, str]) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, *command], env=dict(environment), stdout=subprocess.PIPE, text=True
    )


def core_ms(size: str, rate_hz: float = np.inf) -> np.ndarray:
    """Time of the pipeline alone for each pair, from messages to fix, in this process.

    rate_hz : of the pairs. A processor that has waited for the next one is slower than in a loop.
    """
    cameras = rig(*map(int, size.split("x")))
    pipeline = HorizonPipeline(horizon_settings(cameras.parameters).pipeline)
    frames = cameras.frames(4)
    times = []
    due = 0.0
    for index in range(_CORE_PAIRS):
        stamp = index * int(1e9 / RATE_HZ)
        messages = [
            (
                view.name,
                camera_info_message(view.camera, stamp, view.name),
                encoded_image(image, stamp, view.name),
            )
            for view, image in zip(cameras.views, frames[index % 4], strict=True)
        ]
        time.sleep(max(0.0, due - time.perf_counter()))
        began = time.perf_counter()
        due = began + 1.0 / rate_hz
        for name, info, image in messages:
            pipeline.on_camera_info(name, info)
            pipeline.on_image(name, image)
        times.append(1e3 * (time.perf_counter() - began))
    return np.array(times[5:])


def latency_table(size: str, run: Run, paced: np.ndarray, looped: np.ndarray) -> Table:
    """Both receivers' latencies, losses and load."""
    rows = []
    for name, times, cpu in (
        ("bare subscriber", run.bare_ms, run.bare_cpu),
        (NODE, run.node_ms, run.node_cpu),
    ):
        p50, p99 = np.percentile(times, [50, 99]) if len(times) else (np.nan, np.nan)
        lost = run.sent - len(times)
        share = 100 * cpu / run.duration_s
        figures = (number(p50, 1), number(p99, 1), f"{share:.0f}")
        rows.append((name, str(run.sent), str(lost), *figures))
    bare50, bare99 = np.percentile(run.bare_ms, [50, 99]) if len(run.bare_ms) else (np.nan,) * 2
    node50, node99 = np.percentile(run.node_ms, [50, 99]) if len(run.node_ms) else (np.nan,) * 2
    own, in_loop = float(np.median(paced)), float(np.median(looped))
    notes = (
        f"Two {size} mono8 cameras, {RATE_HZ:g} Hz, {run.duration_s:.0f} s. The core's own time: "
        f"{own:.1f} ms a pair at that rate, {in_loop:.1f} ms in a loop. "
        f"Not used by the node, by cause: {run.rejected}.",
        f"Lost by the node: {verdict(run.sent - len(run.node_ms), 0)}; "
        f"p50 over bare, beside 1.2 x the core's own: "
        f"{verdict(round(node50 - bare50, 1), round(1.2 * own, 1))} ms, in a loop "
        f"{verdict(round(node50 - bare50, 1), round(1.2 * in_loop, 1))}; "
        f"p99 over bare, beside 3 x: {verdict(round(node99 - bare99, 1), round(3 * own, 1))} ms, "
        f"in a loop {verdict(round(node99 - bare99, 1), round(3 * in_loop, 1))}; "
        f"share of a core: {run.node_cpu / run.duration_s:.2f}.",
    )
    columns = ("", "pairs", "lost", "p50, ms", "p99, ms", "% of a core")
    return Table(f"Latency beside a bare subscriber, {size}", columns, tuple(rows), notes)


def start_up_table(environment: Mapping[str, str], starts: int) -> Table:
    """Time from exec to active over that of a bare node."""
    rows = []
    arguments = rig(64, 48).ros_arguments
    for name in (NODE, "target_pose_node"):
        node, bare = compare(name, arguments, environment, starts)
        rows.append(
            (
                name,
                number(node.wall_s, 2),
                number(bare.wall_s, 2),
                verdict(round(node.wall_s / bare.wall_s, 2), 1.5),
                number(node.cpu_s / bare.cpu_s, 2),
            )
        )
    return Table(
        "Start-up, from exec to active",
        ("", "s", "bare node, s", "ratio (bar)", "ratio of processor time"),
        tuple(rows),
        (f"Bare: rclpy, numpy, cv2 and a node. Medians of {starts} starts in turns.",),
    )


def main(argv: list[str] | None = None) -> int:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--starts", type=int, default=7, help="of each node (default 7)")
    parser.add_argument("--seconds", type=float, default=60.0, help="of each run (default 60)")
    arguments = parser.parse_args(argv)
    cv2.setNumThreads(1)
    with private_domain() as domain:
        environment = isolated_environment(domain)
        environment.pop("FASTRTPS_DEFAULT_PROFILES_FILE", None)
        for size in ("1024x1024", "640x480"):
            run = measure(size, round(arguments.seconds * RATE_HZ), environment)
            table = latency_table(size, run, core_ms(size, RATE_HZ), core_ms(size))
            print(table.markdown(), flush=True)
        print(start_up_table(environment, arguments.starts).markdown())
    return 0


if __name__ == "__main__":
    sys.exit(main())
