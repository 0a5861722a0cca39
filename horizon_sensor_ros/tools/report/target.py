"""The report's part on the target: its pose and rates over time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from horizon_sensor_ros.core.mathematics.rigid import vector_from_rotation
from horizon_sensor_ros.ros.messages.geometry import pose_of
from horizon_sensor_ros.tools.bags.replayed_node import TopicNames
from horizon_sensor_ros.tools.colours import COLOURS
from horizon_sensor_ros.tools.report.blocks import (
    Block,
    Section,
    Text,
    chart,
    legend,
    with_gaps,
)
from horizon_sensor_ros.tools.report.clouds import cloud_blocks
from horizon_sensor_ros.tools.report.recorded import Recorded
from horizon_sensor_ros.tools.truth.target_errors import (
    DELTA_TOPIC,
    POSE_TOPIC,
    TWIST_TOPIC,
)

_STYLES = ("-", "--", ":")


def target_section(
    recorded: Recorded, names: TopicNames, bags: Sequence[Path], stopped: Callable[[], bool]
) -> Section | None:
    """Return pose, rates and section patterns; None where there are no answers.

    Raises KeyboardInterrupt soon after `stopped` says so.
    """
    poses = dict(sorted(recorded.answers.get(POSE_TOPIC, {}).items()))
    if not poses:
        return None
    deltas = recorded.answers.get(DELTA_TOPIC, {})
    starts = recorded.seconds([stamp for stamp in poses if stamp not in deltas])
    blocks: list[Block] = [
        Text(f"{len(poses)} poses. Vertical lines: the target frame was set anew ({len(starts)})."),
        chart(
            "Position and rotation vector of the target frame in the sensor frame over time.",
            "target/pose; bands are three sigma.",
            lambda axes: _draw_pose(axes, recorded, poses, starts),
            panels=2,
            panel_height=2.1,
        ),
    ]
    twists = dict(sorted(recorded.answers.get(TWIST_TOPIC, {}).items()))
    if twists:
        blocks.append(
            chart(
                "Angular and linear rates of the target over time.",
                "target/twist: the step since the previous answer over its time, in the frame of "
                "that answer.",
                lambda axes: _draw_twist(axes, recorded, twists),
                panels=2,
                panel_height=2.1,
            )
        )
    if not recorded.clouds and len(recorded.bags) == 1:
        text = "The clouds are not in the bag: give the one that has them with --input."
        blocks.append(Text(text))
    blocks += cloud_blocks(poses, set(deltas), recorded, names, bags, stopped)
    return Section("target", "Target", tuple(blocks))


def _draw_pose(
    axes: Sequence[Axes], recorded: Recorded, poses: dict[int, Any], starts: np.ndarray
) -> None:
    time_s = recorded.seconds(list(poses))
    found = [pose_of(message.pose.pose) for message in poses.values()]
    cov = np.array([np.reshape(m.pose.covariance, (6, 6)) for m in poses.values()])
    sigma = np.sqrt(np.maximum(np.einsum("kii->ki", cov), 0.0))
    shift = np.array([pose[:3, 3] for pose in found])
    turn = np.degrees([vector_from_rotation(pose[:3, :3]) for pose in found])
    for axis in range(3):
        for panel, values, sigmas in (
            (axes[0], shift, sigma[:, :3]),
            (axes[1], turn, np.degrees(sigma[:, 3:])),
        ):
            t, v, s = with_gaps(time_s, values[:, axis], sigmas[:, axis])
            colour = COLOURS[axis]
            panel.fill_between(t, v - 3 * s, v + 3 * s, color=colour, alpha=0.25, linewidth=0)
            panel.plot(t, v, color=colour, linestyle=_STYLES[axis], label="xyz"[axis])
    for start in starts:
        for panel in axes:
            panel.axvline(start, color="0.4", linewidth=0.8)
    axes[0].set_ylabel("position (m)")
    axes[1].set_ylabel("rotation vector (deg)")
    axes[1].set_xlabel("time (s)")
    legend(axes[0])


def _draw_twist(axes: Sequence[Axes], recorded: Recorded, twists: dict[int, Any]) -> None:
    time_s = recorded.seconds(list(twists))
    for panel, part, factor, name in (
        (axes[0], "angular", np.degrees(1.0), "angular rate (deg/s)"),
        (axes[1], "linear", 100.0, "velocity (cm/s)"),
    ):
        for axis, colour, style in zip("xyz", COLOURS, _STYLES, strict=False):
            values = [factor * getattr(getattr(m.twist.twist, part), axis) for m in twists.values()]
            t, v = with_gaps(time_s, np.array(values))
            panel.plot(t, v, color=colour, linestyle=style, label=axis)
        panel.set_ylabel(name)
    axes[1].set_xlabel("time (s)")
    legend(axes[0])
