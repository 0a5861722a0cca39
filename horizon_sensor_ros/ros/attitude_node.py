"""Executable `attitude_node`: publishes roll, pitch and altitude; see `horizon_node`."""

import sys

from horizon_sensor_ros.ros.process.executable import run


def main() -> int:
    """Run the node until a signal; return the exit code."""
    return run(["attitude_node"])


if __name__ == "__main__":
    sys.exit(main())
