"""Paper D's figure 6: section patterns of both clouds over each plane, before and after the search.

`python benchmarks/target_patterns.py patterns.png`
"""

from __future__ import annotations

import sys

import matplotlib as mpl
import numpy as np
from target_pairs import scan_pair
from target_paper import PITCH_M, paper_pose

from horizon_sensor_ros.core.target.direct_search import direct_search
from horizon_sensor_ros.core.target.section_pattern import (
    BatchObjective,
    cut,
    objective,
    patterns_of,
)
from horizon_sensor_ros.sim.tof_camera import ToFCamera


def draw(path: str, target: str = "n5") -> None:
    """Write the picture of the paper's variant 2."""
    mpl.use("Agg")
    from matplotlib import pyplot  # noqa: PLC0415  after the backend is chosen

    rng = np.random.default_rng(0)
    pair = scan_pair(target, paper_pose(23.5, 1), paper_pose(33.5, 11), rng, ToFCamera())
    sections = cut(pair.a.plain().astype(float), PITCH_M)
    now = pair.b.plain().astype(float)
    reach = np.array([np.radians(15.0)] * 3 + [0.08] * 3)
    found = direct_search(BatchObjective(sections, now), reach).best
    figure, axes = pyplot.subplots(2, 3, figsize=(13, 9), layout="constrained")
    for row, (when, candidate) in enumerate((("before", np.zeros(6)), ("after", found))):
        value = objective(sections, now, candidate)
        current = patterns_of(sections, now, candidate)
        for plane, names in enumerate(("y z", "x z", "x y")):
            axis = axes[row, plane]
            for pattern, mark, label in (
                (sections.patterns[plane], "o", "old"), (current[plane], "+", "new"),
            ):  # fmt: skip
                cell = np.argwhere(pattern.count > 0)
                axis.plot(*cell.T, mark, fillstyle="none", markersize=4, label=label)
            first, second = names.split()
            axis.set(xlabel=f"{first}, cells", ylabel=f"{second}, cells", aspect="equal")
            axis.set_title(f"plane {first}{second} {when}: f = {value:.2f}")
    axes[0, 0].legend()
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    draw(sys.argv[1] if len(sys.argv) > 1 else "patterns.png")
