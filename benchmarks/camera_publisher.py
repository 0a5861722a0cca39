"""A process that publishes camera pairs of a horizon, once as many listen as announced.

It says when it begins, and in the end the stamps of what it has sent.

python benchmarks/camera_publisher.py --size 640x480 --rate 30 --pairs 900 --listeners 2
"""

from __future__ import annotations

import argparse
import sys
import time

import rclpy
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import CameraInfo, Image

from horizon_sensor_ros.ros.messages.sensors import camera_info_message, encoded_image
from horizon_sensor_ros.ros.messages.stamps import time_from_ns
from nodes.rig import rig

VIEWS = 4
# Both sides of a match learn of it one after the other; so many pairs go ahead, which do not count.
AHEAD = 30
PATIENCE_S = 30.0


def main(argv: list[str] | None = None) -> int:
    """Publish; 1 when nobody came to listen."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", default="640x480")
    parser.add_argument("--rate", type=float, default=30.0)
    parser.add_argument("--pairs", type=int, default=300)
    parser.add_argument("--listeners", type=int, default=1)
    arguments = parser.parse_args(argv)
    cameras = rig(*map(int, arguments.size.split("x")))
    frames = cameras.frames(VIEWS)
    rclpy.init()
    node = rclpy.create_node("camera_publisher")
    senders = [
        (
            node.create_publisher(CameraInfo, f"{view.name}/camera_info", qos_profile_sensor_data),
            node.create_publisher(Image, f"{view.name}/image_raw", qos_profile_sensor_data),
        )
        for view in cameras.views
    ]
    messages = [
        [
            (camera_info_message(view.camera, 0, view.name), encoded_image(image, 0, view.name))
            for view, image in zip(cameras.views, images, strict=True)
        ]
        for images in frames
    ]
    deadline = time.monotonic() + PATIENCE_S
    while any(image.get_subscription_count() < arguments.listeners for _, image in senders):
        if time.monotonic() > deadline:
            print("nobody listens", file=sys.stderr)
            return 1
        time.sleep(0.05)
    stamps = []
    due = time.monotonic()
    for number in range(-AHEAD, arguments.pairs):
        stamp = time.time_ns()
        for sender, pair in zip(senders, messages[number % VIEWS], strict=True):
            for publisher, message in zip(sender, pair, strict=True):
                message.header.stamp = time_from_ns(stamp)
                publisher.publish(message)
        if number == 0:
            print("begins", flush=True)
        if number >= 0:
            stamps.append(stamp)
        due += 1.0 / arguments.rate
        time.sleep(max(0.0, due - time.monotonic()))
    time.sleep(1.0)
    print(*stamps)
    node.destroy_node()
    rclpy.shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
