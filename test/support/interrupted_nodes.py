"""`horizon_sensor` whose first frame, or cloud, a signal meets halfway: python FILE SIGNAL ARGS."""

from __future__ import annotations

import os
import sys
from typing import Any

from horizon_sensor_ros.ros.pipelines.horizon_pipeline import HorizonPipeline
from horizon_sensor_ros.ros.pipelines.target_pipeline import TargetPipeline
from horizon_sensor_ros.ros.process import executable


def meet(kind: type, name: str, number: int) -> None:
    """Let a method send this process a signal before it does its work."""
    work = getattr(kind, name)

    def interrupted(*arguments: Any) -> Any:
        os.kill(os.getpid(), number)
        return work(*arguments)

    setattr(kind, name, interrupted)


if __name__ == "__main__":
    signal_number = int(sys.argv.pop(1))
    meet(HorizonPipeline, "on_image", signal_number)
    meet(TargetPipeline, "on_cloud", signal_number)
    sys.exit(executable.run())
