"""How many camera pairs arrive from one process in another, with and without config/fastdds.xml.

Two 1024 x 1024 mono8 streams at 30 Hz, best effort, 10 s each way: python benchmarks/transport.py
"""

from __future__ import annotations

import array
import os
import subprocess
import sys
import time

import numpy as np
import rclpy
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Image

from horizon_sensor_ros.tools.package_share import share_directory
from horizon_sensor_ros.tools.private_domain import isolated_environment, private_domain

SIZE, RATE_HZ, PAIRS = 1024, 30.0, 300
TOPICS = ("camera_1/image_raw", "camera_2/image_raw")


def publish() -> None:
    """Send the pairs, once both topics are heard."""
    rclpy.init()
    node = rclpy.create_node("transport_publisher")
    publishers = [node.create_publisher(Image, t, qos_profile_sensor_data) for t in TOPICS]
    while any(p.get_subscription_count() == 0 for p in publishers):
        time.sleep(0.05)
    time.sleep(1.0)
    pixels = array.array("B", bytes(SIZE * SIZE))
    due = time.monotonic()
    for number in range(PAIRS):
        for publisher in publishers:
            message = Image(height=SIZE, width=SIZE, step=SIZE, encoding="mono8")
            message.header.frame_id = str(number)
            message.data = pixels
            message.header.stamp = node.get_clock().now().to_msg()
            publisher.publish(message)
        due += 1.0 / RATE_HZ
        time.sleep(max(0.0, due - time.monotonic()))
    time.sleep(1.0)


def receive(profile: str | None) -> str:
    """Count what arrives from a publisher process; return a row of the table."""
    arrived: dict[str, set[str]] = {topic: set() for topic in TOPICS}
    latencies_ms: list[float] = []
    node = rclpy.create_node("transport_subscriber")

    def hear(topic: str, message: Image) -> None:
        arrived[topic].add(message.header.frame_id)
        sent = message.header.stamp
        now = node.get_clock().now().nanoseconds
        latencies_ms.append((now - sent.sec * 1_000_000_000 - sent.nanosec) * 1e-6)

    for topic in TOPICS:
        node.create_subscription(
            Image, topic, lambda m, topic=topic: hear(topic, m), qos_profile_sensor_data
        )
    environment = dict(os.environ)
    environment.pop("FASTRTPS_DEFAULT_PROFILES_FILE", None)
    if profile:
        environment["FASTRTPS_DEFAULT_PROFILES_FILE"] = profile
    with subprocess.Popen([sys.executable, __file__, "publish"], env=environment) as process:
        while process.poll() is None:
            rclpy.spin_once(node, timeout_sec=0.1)
    node.destroy_node()
    pairs = len(set.intersection(*arrived.values()))
    median, high = np.percentile(latencies_ms, [50, 99]) if latencies_ms else (np.nan, np.nan)
    return f"{pairs:5d} of {PAIRS}{median:12.1f}{high:10.1f}"


def main() -> int:
    """Print the table."""
    if sys.argv[1:] == ["publish"]:
        publish()
        return 0
    with private_domain() as domain:
        os.environ.update(isolated_environment(domain))
        rclpy.init()
        print(f"2 x {SIZE} x {SIZE} mono8, {RATE_HZ:g} Hz   whole pairs   median ms   99 % ms")
        profile = str(share_directory() / "config" / "fastdds.xml")
        for name, path in (("Fast DDS as it comes", None), ("config/fastdds.xml", profile)):
            print(f"{name:29}{receive(path)}", flush=True)
        rclpy.shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
