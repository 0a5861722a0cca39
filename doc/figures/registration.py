"""Two clouds of a target as they came, and the earlier one moved by the motion found."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from figures.drawing import save
from horizon_sensor_ros.core.target.registration import register, target_view
from horizon_sensor_ros.sim.tumbling import TumblingTarget
from horizon_sensor_ros.tools.demo_target_picture import cloud_figure

_APART_S = 9.0


def draw(folder: Path) -> None:
    """Write registration.png."""
    target = TumblingTarget()
    old, new = target.scan(0.0), target.scan(_APART_S)
    found = register(target_view(old.points), target_view(new.points))
    figure = cloud_figure(old.plain(), new.plain(), np.eye(4), found.pose_b_from_a)
    figure.set_size_inches(6.5, 5.4)
    save(figure, folder / "registration.png")
