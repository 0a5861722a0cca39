"""What the launch files have in common.

For them alone: the launch system is part of a ROS installation, and is not to be had from PyPI.
"""

from __future__ import annotations

from typing import Any

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue


def common_arguments() -> list[DeclareLaunchArgument]:
    """Return namespace, params_file and use_sim_time, which `process` uses."""
    return [
        DeclareLaunchArgument("namespace", default_value="", description="Namespace of the nodes"),
        # No default: without the cameras' rotations, or the word that TF has them, no node starts.
        DeclareLaunchArgument(
            "params_file",
            description="ROS parameter file; it must hold camera_N.rotation of every camera that "
            "is used, or extrinsics_source: tf, which takes the rotations from TF",
        ),
        DeclareLaunchArgument(
            "use_sim_time",
            default_value="false",
            description="Take the time from /clock, where the parameter file does not say",
        ),
    ]


def process(executable: str, **more: Any) -> Node:
    """Return an executable of this package, with the common arguments and with `more` of `Node`."""
    use_sim_time = ParameterValue(LaunchConfiguration("use_sim_time"), value_type=bool)
    return Node(
        package="horizon_sensor_ros",
        executable=executable,
        namespace=LaunchConfiguration("namespace"),
        # Of two sources for one parameter the later one counts.
        parameters=[{"use_sim_time": use_sim_time}, LaunchConfiguration("params_file")],
        output="screen",
        **more,
    )
