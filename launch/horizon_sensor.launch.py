"""Start the horizon nodes and the target's.

    ros2 launch horizon_sensor_ros horizon_sensor.launch.py params_file:=mine.yaml

Topics are relative: with `namespace:=nav` the nodes listen to /nav/camera_1/image_raw and so on.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from horizon_sensor_ros.ros.process.node_names import NODES

PACKAGE = "horizon_sensor_ros"
# No default: without the cameras' rotations, or the word that TF has them, no node starts.
PARAMS_FILE = (
    "ROS parameter file; it must hold camera_N.rotation of every camera that is used, "
    "or extrinsics_source: tf, which takes the rotations from TF"
)


def _node(name: str) -> Node:
    use_sim_time = ParameterValue(LaunchConfiguration("use_sim_time"), value_type=bool)
    return Node(
        package=PACKAGE,
        executable=name,
        name=name,
        namespace=LaunchConfiguration("namespace"),
        parameters=[{"use_sim_time": use_sim_time}, LaunchConfiguration("params_file")],
        output="screen",
        condition=IfCondition(LaunchConfiguration(name)),
    )


def generate_launch_description() -> LaunchDescription:
    """All nodes, each of which can be left out; they bring themselves to active."""
    arguments = [
        DeclareLaunchArgument("namespace", default_value="", description="Namespace of the nodes"),
        DeclareLaunchArgument("params_file", description=PARAMS_FILE),
        DeclareLaunchArgument(
            "use_sim_time",
            default_value="false",
            description="Take the time from /clock, where the parameter file does not say",
        ),
        *(
            DeclareLaunchArgument(name, default_value="true", description=f"Start {name}")
            for name in NODES
        ),
    ]
    return LaunchDescription([*arguments, *(_node(name) for name in NODES)])
