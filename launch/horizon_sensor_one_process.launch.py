"""Start all nodes in one process, where each frame's limb is searched for once.

    ros2 launch horizon_sensor_ros horizon_sensor_one_process.launch.py params_file:=mine.yaml

The parameter `nodes` of the node `horizon_sensor` says which nodes, all by default. Topics are
relative: with `namespace:=nav` the nodes listen to /nav/camera_1/image_raw and so on.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

PACKAGE = "horizon_sensor_ros"
# No default: without the cameras' rotations, or the word that TF has them, no node starts.
PARAMS_FILE = (
    "ROS parameter file; it must hold camera_N.rotation of every camera that is used, "
    "or extrinsics_source: tf, which takes the rotations from TF"
)


def generate_launch_description() -> LaunchDescription:
    """One process; its nodes bring themselves to active."""
    use_sim_time = ParameterValue(LaunchConfiguration("use_sim_time"), value_type=bool)
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "namespace", default_value="", description="Namespace of the nodes"
            ),
            DeclareLaunchArgument("params_file", description=PARAMS_FILE),
            DeclareLaunchArgument(
                "use_sim_time",
                default_value="false",
                description="Take the time from /clock, where the parameter file does not say",
            ),
            # No name here: it would be given to every node of the process.
            Node(
                package=PACKAGE,
                executable="horizon_sensor",
                namespace=LaunchConfiguration("namespace"),
                parameters=[{"use_sim_time": use_sim_time}, LaunchConfiguration("params_file")],
                output="screen",
            ),
        ]
    )
