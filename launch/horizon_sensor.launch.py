"""Start the horizon nodes and the target's.

    ros2 launch horizon_sensor_ros horizon_sensor.launch.py params_file:=mine.yaml

Topics are relative: with `namespace:=nav` the nodes listen to /nav/camera_1/image_raw and so on.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration

from horizon_sensor_ros.ros.process.launch_parts import common_arguments, process
from horizon_sensor_ros.ros.process.node_names import NODES


def generate_launch_description() -> LaunchDescription:
    """All nodes, each of which can be left out; they bring themselves to active."""
    choices = [
        DeclareLaunchArgument(name, default_value="true", description=f"Start {name}")
        for name in NODES
    ]
    nodes = [
        process(name, name=name, condition=IfCondition(LaunchConfiguration(name))) for name in NODES
    ]
    return LaunchDescription([*common_arguments(), *choices, *nodes])
