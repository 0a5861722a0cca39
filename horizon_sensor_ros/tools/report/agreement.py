"""The report's part on whether the cameras agree: how far apart the nadirs are that each of them
finds alone.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from horizon_sensor_ros.core.mathematics.attitude import rotation_from_quaternion
from horizon_sensor_ros.core.seconds import s_from_ns
from horizon_sensor_ros.core.self_calibration.differences import (
    NadirDifference,
    nadir_differences,
)
from horizon_sensor_ros.core.self_calibration.measurement import CameraHorizon, FrameSet
from horizon_sensor_ros.ros.parameters.horizon_settings import PipelineSettings
from horizon_sensor_ros.tools.colours import COLOURS
from horizon_sensor_ros.tools.report.blocks import (
    Block,
    Section,
    Table,
    chart,
    from_zero,
    legend,
)


def agreement_section(
    seen_alone: Sequence[tuple[int, tuple[CameraHorizon, ...]]],
    settings: PipelineSettings,
    start_ns: int,
) -> Section | None:
    """Return how far the cameras' nadirs lie apart; None with less than two that saw the limb.

    seen_alone : by stamp (ns), what each camera found of the horizon by itself.
    """
    rotations = {
        name: rotation_from_quaternion(np.array(quaternion))
        for name, quaternion in zip(settings.cameras, settings.rotations, strict=True)
    }
    sets = [FrameSet(s_from_ns(s - start_ns), seen) for s, seen in seen_alone if seen]
    differences = nadir_differences(sets, rotations)
    if not differences:
        return None
    times = np.array([each.time_s for each in sets])
    rows = tuple(_row(difference) for difference in differences)
    blocks: tuple[Block, ...] = (
        Table(("nadirs", "frame sets", "median (deg)", "RMS (deg)", "largest (deg)"), rows),
        chart(
            "Angle between the cameras' nadirs over time.",
            "Each camera's nadir found in its own frame alone. A constant part is how they "
            "are mounted: horizon_self_calibration tells.",
            lambda axes: _draw_agreement(axes[0], times, differences),
            panel_height=2.0,
        ),
    )
    return Section("agreement", "Agreement of the cameras", blocks)


def _row(difference: NadirDifference) -> tuple[str, ...]:
    angle = np.degrees(np.linalg.norm(difference.turn_rad, axis=1))
    figures = (np.median(angle), np.degrees(difference.rms_rad), angle.max())
    return (difference.name, str(len(angle)), *(f"{value:.4f}" for value in figures))


def _draw_agreement(
    axes: Axes, times_s: np.ndarray, differences: Sequence[NadirDifference]
) -> None:
    for difference, colour, marker in zip(differences, COLOURS, "ox+^v", strict=False):
        angle = np.degrees(np.linalg.norm(difference.turn_rad, axis=1))
        axes.plot(
            times_s[difference.index], angle, marker, color=colour, markersize=4,
            label=difference.name,
        )  # fmt: skip
    axes.set(xlabel="time (s)", ylabel="angle (deg)")
    from_zero(axes)
    legend(axes)
