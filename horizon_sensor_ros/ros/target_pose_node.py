"""Executable `target_pose_node`: publishes a target's pose and motion; see `target_node`."""

import sys

from horizon_sensor_ros.ros.process.executable import run


def main() -> int:
    """Run the node until a signal; return the exit code."""
    return run(["target_pose_node"])


if __name__ == "__main__":
    sys.exit(main())
