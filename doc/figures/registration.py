"""Two clouds of a target as they came, and the earlier one moved by the motion found."""

from __future__ import annotations

from pathlib import Path

from matplotlib import pyplot as plt

from figures.drawing import save
from horizon_sensor_ros.core.target_motion.registration import register
from horizon_sensor_ros.core.target_motion.target_view import target_view
from horizon_sensor_ros.sim.tumbling import TumblingTarget
from horizon_sensor_ros.tools.report.clouds import draw_clouds

_APART_S = 9.0


def draw(folder: Path) -> None:
    """Write registration.png."""
    target = TumblingTarget()
    old, new = target.scan(0.0), target.scan(_APART_S)
    found = register(target_view(old.points), target_view(new.points))
    figure, axes = plt.subplots(2, 2, figsize=(6.5, 5.4), layout="constrained")
    draw_clouds(axes.ravel().tolist(), old.plain(), new.plain(), found.pose_b_from_a)
    save(figure, folder / "registration.png")
