"""Executable `horizon_sensor`: the nodes under their own names in one process; see `executable`."""

import sys

from horizon_sensor_ros.ros.process.executable import run


def main() -> int:
    """Run the nodes that the parameter `nodes` names until a signal; return the exit code."""
    return run()


if __name__ == "__main__":
    sys.exit(main())
