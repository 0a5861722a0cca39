"""Where the package's own files are: from a source tree, a pip or a colcon installation."""

from __future__ import annotations

from pathlib import Path

PACKAGE = "horizon_sensor_ros"


def share_directory() -> Path:
    """Directory with `config/` and `launch/`. Raises FileNotFoundError when there is none.

    Found from this file upwards: the ament index, which ROS would ask, needs a sourced workspace.
    """
    for directory in Path(__file__).resolve().parents:
        if (directory / "package.xml").is_file():
            return directory
        if (directory / "share" / PACKAGE / "package.xml").is_file():
            return directory / "share" / PACKAGE
    raise FileNotFoundError(f"the share directory of {PACKAGE} is not installed beside {__file__}")
