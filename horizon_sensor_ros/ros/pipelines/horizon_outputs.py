"""What each horizon node publishes, live and in a replay."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from geometry_msgs.msg import PoseWithCovarianceStamped, Vector3Stamped

from horizon_sensor_ros.ros.messages.estimates import attitude_message, local_vertical_message
from horizon_sensor_ros.ros.parameters.horizon_settings import HorizonSettings
from horizon_sensor_ros.ros.pipelines.horizon_pipeline import HorizonResult


class HorizonOutput(NamedTuple):
    """Topic, message type, and how to make the message of a result whose fix is OK."""

    topic: str
    message: type
    encode: Callable[[HorizonResult, HorizonSettings], Any]


def _local_vertical(result: HorizonResult, settings: HorizonSettings) -> Vector3Stamped:
    return local_vertical_message(result.fix.fit, result.stamp, settings.pipeline.base_frame)


def _attitude(result: HorizonResult, settings: HorizonSettings) -> PoseWithCovarianceStamped:
    return attitude_message(result.fix.fit, result.stamp, settings.level_z)


HORIZON_OUTPUTS = {
    "local_vertical_node": HorizonOutput("local_vertical", Vector3Stamped, _local_vertical),
    "attitude_node": HorizonOutput("attitude", PoseWithCovarianceStamped, _attitude),
}
