"""The rest of a craft: drivers of its sensors, and somebody who listens to the nodes."""

from __future__ import annotations

from typing import Any

from geometry_msgs.msg import PoseWithCovarianceStamped, Vector3Stamped
from horizon_messages import (
    CAMERAS,
    PERIOD_NS,
    START_NS,
    attitude_at,
    camera_info_of,
    horizon_gray,
    image_of,
    nadir_of,
)
from node_processes import Listener
from rclpy.qos import QoSProfile
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from target_messages import BAD_MESSAGES, CLOUD_PERIOD_NS, good_cloud

from horizon_sensor_ros.ros.pipelines.target_pipeline import TARGET_TOPICS

ESTIMATES = {"local_vertical": Vector3Stamped, "attitude": PoseWithCovarianceStamped}


class Craft(Listener):
    """The rest of the craft: two camera drivers, and somebody who listens."""

    def __init__(self, domain: int) -> None:
        super().__init__(domain)
        self._publishers: dict[str, Any] = {}
        for camera in CAMERAS:
            for kind, name in ((Image, "image_raw"), (CameraInfo, "camera_info")):
                topic = f"/{camera}/{name}"
                self._publishers[topic] = self.node.create_publisher(kind, topic, 10)
        for topic, kind in ESTIMATES.items():
            self.listen(kind, f"/{topic}", QoSProfile(depth=100))

    def match(
        self,
        nodes: tuple[str, ...],
        subscribers: int | None = None,
        cameras: tuple[str, ...] = CAMERAS,
    ) -> None:
        """Wait until the nodes hear every topic and are heard.

        subscribers : a topic, where that is not one a node. The first messages after a match may be
        lost, so images and calibrations that are refused go out until the nodes complain of them.
        """
        inputs = [p for t, p in self._publishers.items() if t.split("/")[1] in cameras]
        count = subscribers or len(nodes)
        self.wait(lambda: all(p.get_subscription_count() == count for p in inputs), "subscriptions")
        self.reach(nodes, cameras)

    def reach(self, nodes: tuple[str, ...], cameras: tuple[str, ...] = CAMERAS) -> None:
        """Send what is refused until each node has complained of each camera."""
        for camera in cameras:
            for node in nodes:

                def probe(camera: str = camera) -> None:
                    self.send_info(camera, k=[0.0] * 9)
                    self.send_frame(camera, -1)

                self.insist(probe, node, f"{camera}: camera_info is uncalibrated")
        self.heard.clear()

    def send(self, topic: str, msg: Any) -> None:
        self._publishers[topic].publish(msg)

    def send_frame(self, camera: str, index: int, **fields: Any) -> None:
        stamp = START_NS + index * PERIOD_NS
        gray = horizon_gray(camera, nadir_of(*attitude_at(index)))
        self.send(f"/{camera}/image_raw", image_of(gray, stamp, camera, **fields))

    def send_info(self, camera: str, **fields: Any) -> None:
        self.send(f"/{camera}/camera_info", camera_info_of(0, camera, **fields))

    def send_pair(self, index: int) -> None:
        for camera in CAMERAS:
            self.send_info(camera)
            self.send_frame(camera, index)

    def insist_by_one(self, camera: str, index: int, node: str, words: str) -> int:
        """Send frames of one camera alone, after the one of this index, until a node says the
        words; the last one's index.
        """
        sent = index

        def send_one() -> None:
            nonlocal sent
            sent += 1
            self.send_frame(camera, sent)

        self.insist(send_one, node, words)
        return sent

    def stamps(self, topic: str) -> list[int]:
        """Index, in `send_pair`, of each estimate."""
        stamps = [msg.header.stamp for msg in self.estimates(topic)]
        return [(s.sec * 10**9 + s.nanosec - START_NS) // PERIOD_NS for s in stamps]

    def expect_pair(self, index: int, topics: tuple[str, ...] = tuple(ESTIMATES)) -> None:
        """Send a good pair and wait for its estimates."""
        self.send_pair(index)
        self.wait(lambda: all(index in self.stamps(topic) for topic in topics), f"estimate {index}")


class Chaser(Listener):
    """The rest of the craft: a range camera's driver, and somebody who listens."""

    def __init__(self, domain: int) -> None:
        super().__init__(domain)
        self.clouds = self.node.create_publisher(PointCloud2, "/target/points", 10)
        for topic, kind in TARGET_TOPICS.items():
            self.listen(kind, f"/{topic}", QoSProfile(depth=100))

    def match(self, node: str = "target_pose_node") -> None:
        """Wait until the node hears and is heard: the first messages after a match may be lost."""
        self.wait(lambda: self.clouds.get_subscription_count() == 1, "subscription")
        self.reach(node)

    def reach(self, node: str = "target_pose_node") -> None:
        """Send what is refused until the node complains."""
        fields, _, words = BAD_MESSAGES["truncated"]
        self.insist(lambda: self.clouds.publish(good_cloud(0, **fields)), node, words)
        self.heard.clear()

    def stamps(self, topic: str) -> list[int]:
        """Index, in `good_cloud`, of each estimate."""
        stamps = [msg.header.stamp for msg in self.estimates(topic)]
        return [(s.sec * 10**9 + s.nanosec - START_NS) // CLOUD_PERIOD_NS for s in stamps]

    def expect(self, cloud: PointCloud2, index: int, *topics: str) -> None:
        """Send a cloud and wait for its estimates, which are on these topics and no others."""
        self.clouds.publish(cloud)
        self.wait(lambda: all(index in self.stamps(topic) for topic in topics), f"cloud {index}")
        assert not any(index in self.stamps(topic) for topic in set(TARGET_TOPICS) - set(topics))
