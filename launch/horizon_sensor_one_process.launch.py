"""Start all nodes in one process, where each frame's limb is searched for once.

    ros2 launch horizon_sensor_ros horizon_sensor_one_process.launch.py params_file:=mine.yaml

The parameter `nodes` of the node `horizon_sensor` says which nodes, all by default. Topics are
relative: with `namespace:=nav` the nodes listen to /nav/camera_1/image_raw and so on.
"""

from launch import LaunchDescription

from horizon_sensor_ros.ros.process.launch_parts import common_arguments, process
from horizon_sensor_ros.ros.process.node_names import ONE_PROCESS


def generate_launch_description() -> LaunchDescription:
    """One process; its nodes bring themselves to active."""
    # No name: it would be given to every node of the process.
    return LaunchDescription([*common_arguments(), process(ONE_PROCESS)])
