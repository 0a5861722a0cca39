"""Two clouds of the target as they came, and laid on each other by the motion that was found: the
points themselves, and paper D's section patterns.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.patches import Patch

from horizon_sensor_ros.core.mathematics.rigid import inverse_pose, vector_from_rotation
from horizon_sensor_ros.core.target_motion.section_patterns.candidate import candidate_of
from horizon_sensor_ros.core.target_motion.section_patterns.objective import patterns_of
from horizon_sensor_ros.core.target_motion.section_patterns.section_pattern import (
    SectionPattern,
    cut,
    likeness,
)
from horizon_sensor_ros.ros.messages.geometry import pose_of
from horizon_sensor_ros.ros.messages.message_types import POINT_CLOUD
from horizon_sensor_ros.ros.messages.point_cloud import points_from_cloud
from horizon_sensor_ros.ros.messages.refusal import Refusal
from horizon_sensor_ros.ros.messages.stamps import stamp_ns
from horizon_sensor_ros.ros.pipelines.target_pipeline import CLOUD_TOPIC
from horizon_sensor_ros.tools.bags.bag_listening import Listener, listen
from horizon_sensor_ros.tools.bags.replayed_node import TopicNames
from horizon_sensor_ros.tools.colours import BLUE, VERMILION
from horizon_sensor_ros.tools.report.blocks import Block, Text, chart
from horizon_sensor_ros.tools.report.recorded import Recorded

# The second cloud is the first after which the target has turned by as much.
_TURN_SHOWN_RAD = np.radians(8.0)
# Cells over the target's size, and the fewest points that give a pattern.
_CELLS = 35
_FEWEST_POINTS = 100
_MOST_DRAWN = 6000
_MARGIN_M = 0.05


def cloud_blocks(
    poses: dict[int, Any],
    stepped: set[int],
    recorded: Recorded,
    names: TopicNames,
    bags: Sequence[Path],
    stopped: Callable[[], bool],
) -> list[Block]:
    """Return two clouds laid on each other, and their section patterns; nothing without clouds."""
    pair = _pair(poses, stepped)
    if pair is None:
        return []
    clouds = _clouds(set(pair), names(CLOUD_TOPIC), bags, stopped)
    if set(clouds) != set(pair):
        return []
    old, new = (clouds[stamp] for stamp in pair)
    pose_old, pose_new = (pose_of(poses[stamp].pose.pose) for stamp in pair)
    moved = pose_new @ inverse_pose(pose_old)
    angle = np.degrees(np.linalg.norm(vector_from_rotation(moved[:3, :3])))
    times = recorded.seconds(pair)
    return [
        Text(
            f"Two clouds, at {times[0]:.2f} s and {times[1]:.2f} s; between them the target turned "
            f"by {angle:.1f} deg, as found."
        ),
        chart(
            "Two clouds from the front and from above: as they came, and the earlier one moved.",
            "In the sensor frame; blue the earlier one, orange the later. What only one of "
            "them shows has nothing to lie on.",
            lambda axes: draw_clouds(axes, old, new, moved),
            panels=2,
            columns=2,
            panel_height=3.2,
            share_x=False,
        ),
        *_sections(old, new, moved),
    ]


def draw_clouds(
    axes: Sequence[Axes], old: np.ndarray, new: np.ndarray, pose_new_from_old: np.ndarray
) -> None:
    """Draw two clouds (N, 3) from the front and from above, two panels a row: on the left as they
    came, on the right with the old one moved by what was found, (4, 4).
    """
    moved = old @ pose_new_from_old[:3, :3].T + pose_new_from_old[:3, 3]
    everything = np.concatenate([old, new, moved])
    low, high = np.nanmin(everything, axis=0), np.nanmax(everything, axis=0)
    low, high = low - _MARGIN_M, high + _MARGIN_M
    for column, (cloud, what) in enumerate(((old, "as they came"), (moved, "earlier one moved"))):
        for row, (up, side, name) in enumerate(
            ((1, "front", "y, down (m)"), (2, "above", "z, away (m)"))
        ):
            panel = axes[2 * row + column]
            # Fewer points of the later one, so as not to hide what lies under it.
            for points, most, colour, label in (
                (cloud, _MOST_DRAWN, BLUE, "earlier"),
                (new, _MOST_DRAWN // 2, VERMILION, "later"),
            ):
                some = points[:: 1 + len(points) // most]
                panel.plot(some[:, 0], some[:, up], ".", color=colour, markersize=1.5, label=label)
            panel.set(xlim=(low[0], high[0]), ylim=(low[up], high[up]), aspect="equal")
            panel.set(xlabel="x, right (m)", ylabel=name)
            panel.set_title(f"{side}, {what}", loc="left", fontsize="medium")
            if row == 0:
                panel.invert_yaxis()
    axes[2].legend(loc="best", markerscale=5)


def _sections(old: np.ndarray, new: np.ndarray, moved: np.ndarray) -> list[Block]:
    """Return section patterns of the clouds, before and after the motion `moved` (4, 4)."""
    pitch = float(np.ptp(old, axis=0).max()) / _CELLS
    sections = cut(old, pitch)
    before = patterns_of(sections, new, np.zeros(6))
    after = patterns_of(sections, new, candidate_of(sections, moved))
    was, became = (
        float(np.mean([likeness(*both) for both in zip(sections.patterns, now, strict=True)]))
        for now in (before, after)
    )
    text = (
        f"Paper D's patterns of these clouds; cells of {100 * pitch:.1f} cm. Likeness (1: the "
        f"same) before the found motion {was:.2f}, after it {became:.2f}."
    )
    return [
        Text(text),
        chart(
            "Cells that the two clouds fill in three section planes, before and after the motion.",
            "Above: the later cloud where it was. Below: moved back by what was found. The planes "
            "lie across the axes of the earlier cloud's inertia.",
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
        turn = pose_of(poses[first].pose.pose)[:3, :3].T @ pose_of(message.pose.pose)[:3, :3]
        angle = float(np.linalg.norm(vector_from_rotation(turn)))
        if best is None or angle > best[0]:
            best = angle, (first, stamp)
        if angle > _TURN_SHOWN_RAD:
            break
    return None if best is None else best[1]


def _clouds(
    wanted: set[int], topic: str, bags: Sequence[Path], stopped: Callable[[], bool]
) -> dict[int, np.ndarray]:
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
        listen(bag, [Listener(topic, (POINT_CLOUD,), take, needed=False)], stopped)
    return found


def _draw_sections(
    axes: Sequence[Axes],
    reference: Sequence[SectionPattern],
    before: Sequence[SectionPattern],
    after: Sequence[SectionPattern],
) -> None:
    colours = ListedColormap(["white", BLUE, VERMILION, "0.25"])
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
            Patch(color=BLUE, label="earlier cloud only"),
            Patch(color=VERMILION, label="later only"),
            Patch(color="0.25", label="both"),
        ],
        loc="lower center",
        bbox_to_anchor=(0.5, 1.0),
        ncols=3,
    )
