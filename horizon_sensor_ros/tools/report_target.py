"""The report's part on the target: its pose and rates, and paper D's section patterns."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.patches import Patch

from horizon_sensor_ros.core.target.rigid import inverse_pose, vector_from_rotation
from horizon_sensor_ros.core.target.section_pattern import (
    SectionPattern,
    candidate_of,
    cut,
    likeness,
    patterns_of,
)
from horizon_sensor_ros.ros.messages import Refusal, stamp_ns
from horizon_sensor_ros.ros.point_cloud import points_from_cloud
from horizon_sensor_ros.ros.target_pipeline import CLOUD_TOPIC
from horizon_sensor_ros.tools.bag_listening import Listener, listen
from horizon_sensor_ros.tools.demo_target_errors import (
    DELTA_TOPIC,
    POSE_TOPIC,
    TWIST_TOPIC,
    pose_of,
)
from horizon_sensor_ros.tools.replayed_node import TopicNames
from horizon_sensor_ros.tools.report_bags import Recorded
from horizon_sensor_ros.tools.report_blocks import (
    BLUE,
    COLOURS,
    VERMILION,
    Block,
    Section,
    Text,
    chart,
    legend,
    with_gaps,
)

_STYLES = ("-", "--", ":")
_CLOUD = ("sensor_msgs/msg/PointCloud2",)
# The second cloud is the first after which the target has turned by as much.
_TURN_SHOWN_RAD = np.radians(8.0)
# Cells over the target's size, and the fewest points that give a pattern.
_CELLS = 35
_FEWEST_POINTS = 100


def target_section(recorded: Recorded, names: TopicNames, bags: Sequence[Path]) -> Section | None:
    """Return pose, rates and section patterns; None where there are no answers."""
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
    blocks += _sections(poses, set(deltas), recorded, names, bags)
    return Section("target", "Target", tuple(blocks))


def _draw_pose(
    axes: Sequence[Axes], recorded: Recorded, poses: dict[int, Any], starts: np.ndarray
) -> None:
    time_s = recorded.seconds(list(poses))
    found = [pose_of(message) for message in poses.values()]
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


def _sections(
    poses: dict[int, Any],
    stepped: set[int],
    recorded: Recorded,
    names: TopicNames,
    bags: Sequence[Path],
) -> list[Block]:
    """Return section patterns of two clouds, before and after the found motion."""
    pair = _pair(poses, stepped)
    if pair is None:
        return []
    clouds = _clouds(set(pair), names(CLOUD_TOPIC), bags)
    if set(clouds) != set(pair):
        return []
    early, late = pair
    moved = pose_of(poses[late]) @ inverse_pose(pose_of(poses[early]))
    pitch = float(np.ptp(clouds[early], axis=0).max()) / _CELLS
    sections = cut(clouds[early], pitch)
    before = patterns_of(sections, clouds[late], np.zeros(6))
    after = patterns_of(sections, clouds[late], candidate_of(sections, moved))
    was, became = (
        float(np.mean([likeness(*both) for both in zip(sections.patterns, now, strict=True)]))
        for now in (before, after)
    )
    angle = np.degrees(np.linalg.norm(vector_from_rotation(moved[:3, :3])))
    times = recorded.seconds(pair)
    text = (
        f"Paper D's patterns of the clouds at {times[0]:.2f} s and {times[1]:.2f} s, between which "
        f"the target turned by {angle:.1f} deg; cells of {100 * pitch:.1f} cm. Likeness (1: the "
        f"same) before the found motion {was:.2f}, after it {became:.2f}."
    )
    return [
        Text(text),
        chart(
            "Cells that the two clouds fill in three section planes, before and after the motion.",
            "Above: the second cloud where it was. Below: moved back by what was found. The planes "
            "lie across the axes of the first cloud's inertia.",
            lambda axes: _draw_sections(axes, sections.patterns, before, after),
            panels=2,
            panel_height=2.4,
            share_x=False,
        ),
    ]


def _pair(poses: dict[int, Any], stepped: set[int]) -> tuple[int, int] | None:
    """Stamps of two poses of one target frame, a good turn apart; the farthest if none is."""
    first: int | None = None
    best: tuple[float, tuple[int, int]] | None = None
    for stamp, message in poses.items():
        if stamp not in stepped or first is None:
            first = stamp
            continue
        turn = pose_of(poses[first])[:3, :3].T @ pose_of(message)[:3, :3]
        angle = float(np.linalg.norm(vector_from_rotation(turn)))
        if best is None or angle > best[0]:
            best = angle, (first, stamp)
        if angle > _TURN_SHOWN_RAD:
            break
    return None if best is None else best[1]


def _clouds(wanted: set[int], topic: str, bags: Sequence[Path]) -> dict[int, np.ndarray]:
    """Finite points (N, 3) of the clouds of these stamps."""
    found: dict[int, np.ndarray] = {}

    def take(msg: Any, _msgtype: str) -> None:
        stamp = stamp_ns(msg)
        if isinstance(stamp, Refusal) or stamp not in wanted or stamp in found:
            return
        points = points_from_cloud(msg)
        if isinstance(points, Refusal):
            return
        flat = np.asarray(points, dtype=float).reshape(-1, 3)
        flat = flat[np.isfinite(flat).all(axis=1)]
        if len(flat) >= _FEWEST_POINTS:
            found[stamp] = flat

    for bag in bags:
        listen(bag, [Listener(topic, _CLOUD, take, needed=False)], bool)
    return found


def _draw_sections(
    axes: Sequence[Axes],
    reference: Sequence[SectionPattern],
    before: Sequence[SectionPattern],
    after: Sequence[SectionPattern],
) -> None:
    colours = ListedColormap(["white", VERMILION, BLUE, "0.25"])
    norm = BoundaryNorm([-0.5, 0.5, 1.5, 2.5, 3.5], 4)
    for panel, now, word in ((axes[0], before, "before"), (axes[1], after, "after")):
        strips = []
        height = max(pattern.count.shape[1] for pattern in reference)
        for one, other in zip(reference, now, strict=True):
            cells = (one.count > 0) + 2 * (other.count > 0)
            padded = np.zeros((cells.shape[0] + 2, height), dtype=int)
            padded[1:-1, : cells.shape[1]] = cells
            strips.append(padded)
        panel.imshow(
            np.concatenate(strips).T, cmap=colours, norm=norm, origin="lower", aspect="equal"
        )
        middles = np.cumsum([len(strip) for strip in strips]) - [len(s) / 2 for s in strips]
        panel.set_xticks(middles, [f"across axis {axis}" for axis in (1, 2, 3)])
        panel.tick_params(length=0)
        panel.set_yticks([])
        panel.set_ylabel(word)
        panel.grid(visible=False)
    axes[0].legend(
        handles=[
            Patch(color=VERMILION, label="first cloud only"),
            Patch(color=BLUE, label="second only"),
            Patch(color="0.25", label="both"),
        ],
        loc="lower center",
        bbox_to_anchor=(0.5, 1.0),
        ncols=3,
    )
