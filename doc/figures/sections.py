"""Paper D's section patterns of two clouds, before the search and after it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.patches import Rectangle

from figures.drawing import ORANGE, SKY, save
from horizon_sensor_ros.core.target_motion.section_patterns.direct_search import direct_search
from horizon_sensor_ros.core.target_motion.section_patterns.objective import (
    BatchObjective,
    objective,
    patterns_of,
)
from horizon_sensor_ros.core.target_motion.section_patterns.section_pattern import cut
from horizon_sensor_ros.sim.paper_d import CURRENT_DEG, PREVIOUS_DEG, SECTION_PITCH_M, paper_pose
from horizon_sensor_ros.sim.shapes import sich_n5
from horizon_sensor_ros.sim.tof_camera import ToFCamera


def draw(folder: Path) -> None:
    """Write sections.png: filled cells over each plane, of N5 in the paper's variant 2."""
    rng, camera, mesh = np.random.default_rng(0), ToFCamera(), sich_n5()
    old, new = (
        camera.scan(mesh, paper_pose(*angles), rng).plain().astype(float)
        for angles in (PREVIOUS_DEG, CURRENT_DEG[2])
    )
    sections = cut(old, SECTION_PITCH_M)
    reach = np.array([np.radians(15.0)] * 3 + [0.08] * 3)
    found = direct_search(BatchObjective(sections, new), reach).best
    figure, axes = plt.subplots(2, 3, figsize=(6.5, 5.4), layout="constrained")
    for row, (when, candidate) in enumerate((("before", np.zeros(6)), ("after", found))):
        current = patterns_of(sections, new, candidate)
        for plane, name in enumerate(("y z", "x z", "x y")):
            ax = axes[row, plane]
            for x, y in np.argwhere(sections.patterns[plane].count > 0):
                ax.add_patch(Rectangle((x - 0.5, y - 0.5), 1, 1, facecolor=SKY, label="old"))
            cell = np.argwhere(current[plane].count > 0)
            ax.plot(*cell.T, "x", color=ORANGE, markersize=3, markeredgewidth=0.9, label="new")
            width, height = sections.grids[plane].shape
            ax.set(xlim=(-1, width), ylim=(-1, height), aspect="equal", xticks=[], yticks=[])
            if row == 0:
                ax.set_title(f"plane {name}", fontsize=11)
        value = objective(sections, new, candidate)
        axes[row, 0].set_ylabel(f"{when}: $f$ = {value:.2f}", fontsize=12)
    handles = dict(zip(*reversed(axes[0, 0].get_legend_handles_labels()), strict=True))
    axes[0, 0].legend(handles.values(), handles, loc="lower right", markerscale=2)
    save(figure, folder / "sections.png")
