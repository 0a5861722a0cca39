"""A million camera pairs and clouds through the live nodes' pipelines: memory and open handles.

    python benchmarks/soak.py --count 1000000 --picture doc/pictures/soak.png

30 pairs, 30 clouds and 60 gyro rates a second of simulated time, so a million pairs are nine hours.
One pair and one cloud in a hundred show something, the others are dark and empty: that is what they
cost.
"""

from __future__ import annotations

import argparse
import gc
import os
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import cv2
import numpy as np
from sensor_msgs.msg import Imu
from tqdm import tqdm

from horizon_sensor_ros.core.mathematics.rigid import pose_matrix, rotation_from_vector
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.ros.diagnostics.horizon_diagnostics import HorizonMonitor
from horizon_sensor_ros.ros.diagnostics.target_diagnostics import TargetMonitor
from horizon_sensor_ros.ros.messages.estimates import attitude_message, local_vertical_message
from horizon_sensor_ros.ros.messages.sensors import (
    camera_info_message,
    cloud_message,
    encoded_image,
)
from horizon_sensor_ros.ros.messages.stamps import time_from_ns
from horizon_sensor_ros.ros.parameters.horizon_settings import horizon_settings
from horizon_sensor_ros.ros.parameters.target_settings import target_settings
from horizon_sensor_ros.ros.pipelines.horizon_pipeline import HorizonPipeline
from horizon_sensor_ros.ros.pipelines.target_pipeline import TargetPipeline
from horizon_sensor_ros.sim.shapes import sich_n5
from horizon_sensor_ros.sim.tof_camera import ToFCamera
from nodes.rig import rig

WIDTH, HEIGHT = 160, 120
CLOUD_SIZE = 32
VIEWS = 8
SHOWN_EVERY = 100
RATE_HZ = 30
SAMPLES = 200
# Compared: the medians of the second tenth of the run, when all is warm, and of the last.
MAX_GROWTH = 0.02


@dataclass
class Curve:
    """Memory, bytes, and open handles, each after so many pairs."""

    pairs: list[int] = field(default_factory=list)
    memory: list[int] = field(default_factory=list)
    handles: list[int] = field(default_factory=list)

    def take(self, pairs: int) -> None:
        """Look once."""
        gc.collect()
        status = Path("/proc/self/status").read_text().splitlines()
        (line,) = [line for line in status if line.startswith("VmRSS")]
        self.pairs.append(pairs)
        self.memory.append(1024 * int(line.split()[1]))
        self.handles.append(len(os.listdir("/proc/self/fd")))

    def growth(self) -> float:
        """Share by which memory grew from the second to the last tenth."""
        tenth = max(len(self.memory) // 10, 1)
        first = np.median(self.memory[tenth : 2 * tenth])
        return float(np.median(self.memory[-tenth:]) / first - 1.0)


class Soak:
    """The pipelines of all nodes, with their monitors and messages, in simulated time."""

    def __init__(self) -> None:
        cameras = rig(WIDTH, HEIGHT)
        self.views = cameras.views
        settings = horizon_settings(cameras.parameters)
        self.horizon = HorizonPipeline(settings.pipeline)
        self.target = TargetPipeline(target_settings({}).pipeline)
        self.monitors = (
            HorizonMonitor(
                "horizon", settings.pipeline.cameras, settings.stale_after_ns, live=True
            ),
            TargetMonitor("target", settings.stale_after_ns, live=True),
        )
        self.frames = cameras.frames(VIEWS)
        dark = np.random.default_rng(1).integers(0, 5, (HEIGHT, WIDTH), dtype=np.uint8)
        self.dark = [dark, dark]
        tof = ToFCamera(width=CLOUD_SIZE, height=CLOUD_SIZE, pixel_pitch_m=255e-6)
        mesh = sich_n5()
        self.scans = [
            tof.scan(mesh, _turned(0.01 * i), np.random.default_rng(i)).points for i in range(VIEWS)
        ]
        self.empty = np.full((16, 16, 3), np.nan, np.float32)

    def step(self, number: int) -> None:
        """One moment: a pair, a cloud, two rates; diagnostics once a second."""
        stamp = 1_700_000_000_000_000_000 + number * 1_000_000_000 // RATE_HZ
        shown = number % SHOWN_EVERY == 0
        view = number // SHOWN_EVERY % VIEWS
        for half in (0, 1):
            rate = Imu()
            rate.header.frame_id = "base_link"
            rate.header.stamp = time_from_ns(stamp + half * 10_000_000)
            self.horizon.aiding.on_imu(rate)
        images = self.frames[view] if shown else self.dark
        horizon_monitor, target_monitor = self.monitors
        for camera, image in zip(self.views, images, strict=True):
            frame_id = f"{camera.name}_optical"
            info = camera_info_message(camera.camera, stamp, frame_id)
            self.horizon.on_camera_info(camera.name, info)
            step = self.horizon.on_image(camera.name, encoded_image(image, stamp, frame_id))
            horizon_monitor.on_step(step, stamp)
            for result in step.results:
                if result.fix.status is Status.OK:
                    local_vertical_message(result.fix.fit, result.stamp, "base_link")
                    attitude_message(result.fix.fit, result.stamp, "up")
                    horizon_monitor.on_published(result.stamp, stamp)
        points = self.scans[view] if shown else self.empty
        cloud_step = self.target.on_cloud(cloud_message(points, stamp, "tof"))
        target_monitor.on_step(cloud_step, stamp)
        if number % RATE_HZ == 0:
            horizon_monitor.message(stamp, self.horizon)
            target_monitor.message(stamp, self.target)


def _turned(angle: float) -> np.ndarray:
    rot = rotation_from_vector(np.array([0.3, 0.6 + angle, 0.2]))
    return pose_matrix(rot, np.array([0.1, -0.05, 4.0]))


def draw(curve: Curve, path: Path) -> None:
    """Draw the curves: memory over what it was when warm, and handles."""
    import matplotlib  # noqa: PLC0415 - after the measurement, of which it is no part

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt  # noqa: PLC0415

    figure, (above, below) = plt.subplots(
        2, 1, sharex=True, figsize=(8, 4.5), height_ratios=(3, 1), layout="constrained"
    )
    pairs = np.array(curve.pairs) / 1e3
    above.plot(pairs, np.array(curve.memory) / 1e6, color="#0072b2", linewidth=1.2)
    above.set_ylim(0, 1.15 * max(curve.memory) / 1e6)
    above.set_ylabel("resident memory, MB")
    above.set_title(
        f"{curve.pairs[-1]:,} pairs and clouds: memory {100 * curve.growth():+.2f} % "
        "from the second tenth to the last"
    )
    below.plot(pairs, curve.handles, color="#d55e00", linewidth=1.2)
    below.set_ylim(0, 1.3 * max(curve.handles))
    below.set_ylabel("open handles")
    below.set_xlabel("thousand pairs")
    for axes in (above, below):
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)


def main(argv: list[str] | None = None) -> int:
    """Run the soak; return 1 when memory or handles grew."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=1_000_000, help="pairs (default 1000000)")
    parser.add_argument("--picture", type=Path, help="PNG file to draw the curves into")
    arguments = parser.parse_args(argv)
    if arguments.count < 2 * SAMPLES:
        parser.error(f"--count must be at least {2 * SAMPLES}, got {arguments.count}")
    cv2.setNumThreads(1)
    soak, curve = Soak(), Curve()
    every = arguments.count // SAMPLES
    began = time.process_time()
    for number in tqdm(range(arguments.count), unit="pair", disable=None):
        if number % every == 0:
            curve.take(number)
        soak.step(number)
    curve.take(arguments.count)
    fixes = soak.horizon.counts["fixes"], soak.target.counts["fixes"]
    held = curve.handles[-1] <= curve.handles[len(curve.handles) // 10]
    print(
        f"{arguments.count} pairs and clouds ({arguments.count / RATE_HZ / 3600:.1f} h of simulated"
        f" time, {(time.process_time() - began) / 60:.1f} min of CPU), {fixes[0]} horizon fixes, "
        f"{fixes[1]} target fixes\n"
        f"memory {curve.memory[-1] / 1e6:.1f} MB, growth {100 * curve.growth():+.2f} % "
        f"(bar {100 * MAX_GROWTH:g} %); open handles {curve.handles[-1]}"
        f"{'' if held else ', more than at the start'}"
    )
    if arguments.picture:
        draw(curve, arguments.picture)
    return 0 if held and curve.growth() < MAX_GROWTH else 1


if __name__ == "__main__":
    sys.exit(main())
