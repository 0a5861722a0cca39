"""What target_pose_node said, held against the tumbling target's truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from horizon_sensor_ros.core.mathematics.rigid import (
    inverse_pose,
    vector_from_rotation,
)
from horizon_sensor_ros.core.seconds import nearest_s_from_ns
from horizon_sensor_ros.ros.messages.geometry import pose_of, xyz_of
from horizon_sensor_ros.ros.pipelines.target_pipeline import TARGET_TOPICS
from horizon_sensor_ros.tools.truth.columns import columns_of
from horizon_sensor_ros.tools.truth.horizon_errors import error_lines, latency_line
from horizon_sensor_ros.tools.truth.nees import nees, within_95
from horizon_sensor_ros.tools.truth.topics import pose_in_target_frame

POSE_TOPIC, DELTA_TOPIC, TWIST_TOPIC = TARGET_TOPICS
# Of chi-squared with six degrees of freedom.
_NEES_MEDIAN = 5.35


@dataclass(frozen=True, eq=False)
class MotionErrors:
    """Sizes of the errors of one topic, and the sigmas stated with them; (N,), NaN: no answer.

    rotation in rad (of a twist rad/s), shift in m (m/s); sigmas are of the size, over all three
    axes. nees : six degrees of freedom.
    """

    rotation: np.ndarray
    rotation_sigma: np.ndarray
    shift: np.ndarray
    shift_sigma: np.ndarray
    nees: np.ndarray


@dataclass(frozen=True, eq=False)
class TargetErrors:
    """Errors of the three topics, one row a cloud; and how often the target frame was set."""

    time_s: np.ndarray
    pose: MotionErrors
    delta: MotionErrors
    twist: MotionErrors
    frames: int


def target_errors(
    time_s: Sequence[float],
    truths: Mapping[int, np.ndarray],
    messages: Mapping[str, Mapping[int, Any]],
) -> TargetErrors:
    """Errors of the answers against the truths.

    truths : by the clouds' stamps (ns) in order, the target's own axes in the sensor frame (4, 4).
    messages : by topic and stamp. A target frame that was set by a pose without truth has no
    errors; the first pose is taken for one that sets it.
    """
    row_of = {stamp: k for k, stamp in enumerate(truths)}
    rows: dict[str, list[dict[str, float]]] = {
        topic: [{} for _ in truths] for topic in TARGET_TOPICS
    }
    frames = 0
    set_at: tuple[np.ndarray, np.ndarray] | None = None
    before: tuple[int, np.ndarray] | None = None
    # Over the poses, with truth or without: each may set the frame, and the next step is from it.
    for stamp, pose in sorted(messages[POSE_TOPIC].items()):
        body = truths.get(stamp)
        delta, twist = (messages[topic].get(stamp) for topic in (DELTA_TOPIC, TWIST_TOPIC))
        if delta is None or frames == 0:
            set_at, frames = None if body is None else (body, pose_of(pose.pose.pose)), frames + 1
        if body is None or set_at is None:
            before = None
            continue
        k = row_of[stamp]
        truth = pose_in_target_frame(body, *set_at)
        rows[POSE_TOPIC][k] = _pose_error(pose, truth)
        if delta is not None and before is not None:
            step = inverse_pose(before[1]) @ truth
            rows[DELTA_TOPIC][k] = _pose_error(delta, step)
            if twist is not None:
                duration_s = nearest_s_from_ns(stamp - before[0])
                rows[TWIST_TOPIC][k] = _twist_error(twist, step, duration_s)
        before = stamp, truth
    pose_errors, delta_errors, twist_errors = (
        MotionErrors(**columns_of(MotionErrors, rows[topic])) for topic in TARGET_TOPICS
    )
    return TargetErrors(
        time_s=np.asarray(time_s, float),
        pose=pose_errors,
        delta=delta_errors,
        twist=twist_errors,
        frames=frames,
    )


def _pose_error(message: Any, truth: np.ndarray) -> dict[str, float]:
    found = pose_of(message.pose.pose)
    # Covariances have the position first, then rotations about the header frame's fixed axes.
    turn = vector_from_rotation(found[:3, :3] @ truth[:3, :3].T)
    return _sizes(found[:3, 3] - truth[:3, 3], turn, message.pose.covariance)


def _twist_error(message: Any, step: np.ndarray, duration_s: float) -> dict[str, float]:
    v, w = message.twist.twist.linear, message.twist.twist.angular
    linear = xyz_of(v) - step[:3, 3] / duration_s
    angular = xyz_of(w) - vector_from_rotation(step[:3, :3]) / duration_s
    return _sizes(linear, angular, message.twist.covariance)


def _sizes(shift: np.ndarray, turn: np.ndarray, covariance: Any) -> dict[str, float]:
    """Of one answer, by the names of `MotionErrors`."""
    matrix = np.asarray(covariance, float).reshape(6, 6)
    error = np.concatenate([shift, turn])
    variances = np.maximum(np.diag(matrix), 0.0)
    return {
        "rotation": float(np.linalg.norm(turn)),
        "rotation_sigma": float(np.sqrt(variances[3:].sum())),
        "shift": float(np.linalg.norm(shift)),
        "shift_sigma": float(np.sqrt(variances[:3].sum())),
        "nees": nees(error, matrix),
    }


def target_table(errors: TargetErrors, latency_s: np.ndarray) -> str:
    """Return the target's part of the table that the demo prints."""
    rows = []
    for name, motion, units in (
        ("target/pose", errors.pose, ("deg", "cm")),
        ("target/pose_delta", errors.delta, ("deg", "cm")),
        ("target/twist", errors.twist, ("deg/s", "cm/s")),
    ):
        turn, turn_sigma = np.degrees(motion.rotation), np.degrees(motion.rotation_sigma)
        rows.append((f"{name}: turn", units[0], turn, turn_sigma))
        rows.append((f"{name}: shift", units[1], 100 * motion.shift, 100 * motion.shift_sigma))
    lines = error_lines(rows)
    clouds = len(errors.time_s)
    poses = int(np.isfinite(errors.pose.rotation).sum())
    lines += [
        "",
        f"availability   target/pose {poses} of {clouds} ({poses / clouds:.0%}), "
        f"target frames set: {errors.frames}",
    ]
    # The pose that sets the frame is right by definition.
    later = errors.pose.nees[np.isfinite(errors.delta.nees)]
    for name, values in (("pose", later), ("delta", errors.delta.nees)):
        seen = values[np.isfinite(values)]
        if seen.size:
            lines.append(
                f"NEES, {name:9}median {np.median(seen):.2f} ({_NEES_MEDIAN} is exact); "
                f"{within_95(seen, 6):.0%} of the errors within the 95 % ellipsoid"
            )
    if latency_s.size:
        lines.append(latency_line("cloud published to pose heard", latency_s))
    return "\n".join(lines)
