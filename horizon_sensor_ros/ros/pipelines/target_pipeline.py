"""From point clouds to the target's messages: what the live node and the replay share.

No node and no clock in here, so that the same messages in the same order give the same results,
live or offline.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistWithCovarianceStamped

from horizon_sensor_ros.core.mathematics.rigid import (
    inverse_left_jacobian,
    vector_from_rotation,
)
from horizon_sensor_ros.core.seconds import NANOSECONDS
from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.core.target_motion.config import TrackerConfig
from horizon_sensor_ros.core.target_motion.target_fix import TargetFix
from horizon_sensor_ros.core.target_motion.tracker import TargetTracker
from horizon_sensor_ros.ros.messages.estimates import pose_message, twist_message
from horizon_sensor_ros.ros.messages.point_cloud import points_from_cloud
from horizon_sensor_ros.ros.messages.point_times import point_times
from horizon_sensor_ros.ros.messages.refusal import Refusal, internal_error, quoted
from horizon_sensor_ros.ros.messages.stamps import repeated_stamp, stamp_ns
from horizon_sensor_ros.ros.parameters.target_settings import TargetPipelineSettings

CLOUD_TOPIC = "target/points"
# Topics in the order of their messages.
TARGET_TOPICS: dict[str, type] = {
    "target/pose": PoseWithCovarianceStamped,
    "target/pose_delta": PoseWithCovarianceStamped,
    "target/twist": TwistWithCovarianceStamped,
}


@dataclass(frozen=True)
class TargetStep:
    """What became of one cloud: the fix, or why it was not used; and the messages to publish.

    outputs : topic and message; empty unless the fix is OK.
    """

    fix: TargetFix | None = None
    refusal: Refusal | None = None
    outputs: tuple[tuple[str, Any], ...] = ()


class TargetPipeline:
    """Decodes and tracks clouds.

    counts : clouds, fixes, target frames, time jumps. rejected : clouds that gave no estimate, by
    cause. times_told : by which field the last cloud's points tell when they were measured, or why
    that is not used.
    """

    def __init__(self, settings: TargetPipelineSettings) -> None:
        self.counts: Counter[str] = Counter()
        self.rejected: Counter[str] = Counter()
        self.times_told = ""
        self._settings = settings
        self._tracker = TargetTracker(settings.tracker)
        self._stamp: int | None = None
        self._frame_id: str | None = None

    def apply(self, settings: TargetPipelineSettings) -> None:
        """Go on with other settings; track and counts stay."""
        self._settings = settings
        self._tracker.config = settings.tracker

    def reset(self) -> None:
        """Forget the track; counts and the last stamp, which may not be repeated, stay."""
        self._tracker.reset()
        self._frame_id = None

    def on_cloud(self, msg: Any) -> TargetStep:
        """Take a `sensor_msgs/PointCloud2`; say what came of it. Never raises for what is in it."""
        self.counts["clouds"] += 1
        try:
            return self._take(msg)
        except Exception as error:
            # The last defence of a flight process: a defect of ours costs a cloud, not the node.
            return self._refuse(internal_error(error))

    def warm_up(self) -> tuple[TargetFix, ...]:
        """Run the whole way once on a drawn corner, so that the first real cloud is not slow.

        Returns its fixes.
        """
        y, x = np.mgrid[-0.3:0.3:40j, -0.3:0.3:40j]
        # Three planes through one point, each a linear function in inverse depth.
        depth = 1.0 / np.min([0.5 + x, 0.5 - x + 0.5 * y, 0.5 - x - 0.5 * y], axis=0)
        corner = np.stack([x * depth, y * depth, depth], axis=-1)
        # As it comes: in a crop that the corner is not in the way would end early.
        tracker = TargetTracker(TrackerConfig())
        return tuple(tracker.process(corner, n * NANOSECONDS // 10) for n in range(3))

    def _take(self, msg: Any) -> TargetStep:
        stamp = stamp_ns(msg)
        if isinstance(stamp, Refusal):
            return self._refuse(stamp)
        if stamp == self._stamp:
            return self._refuse(repeated_stamp(stamp))
        points = points_from_cloud(msg)
        if isinstance(points, Refusal):
            return self._refuse(points)
        frame_id = str(msg.header.frame_id)
        anew = ""
        if self._frame_id is not None and frame_id != self._frame_id:
            # Poses in one frame say nothing about those in another.
            anew = f"the clouds' frame is now {quoted(frame_id)}"
        times_s, self.times_told = None, ""
        if self._settings.point_times:
            times = point_times(msg, points, stamp)
            times_s, self.times_told = times.times_s, times.told
        fix = self._tracker.process(points, stamp, anew, times_s)
        # Of a cloud that shows nothing neither stamp nor frame counts.
        if self._tracker.stamp_ns == stamp:
            self._frame_id = frame_id
            if self._stamp is not None and stamp < self._stamp:
                self.counts["time_jumps"] += 1
            self._stamp = stamp
        if fix.status is Status.OK and not _finite(fix):
            self._tracker.reset()
            fix = replace(fix, status=Status.UNCERTAIN, reason="the estimate is not finite")
        if fix.status is not Status.OK:
            self.rejected[str(fix.status)] += 1
            return TargetStep(fix)
        if fix.new_frame:
            self.counts["target_frames"] += 1
        outputs = _outputs(fix, frame_id, self._settings.target_frame)
        self.counts["fixes"] += 1
        return TargetStep(fix, outputs=outputs)

    def _refuse(self, refusal: Refusal) -> TargetStep:
        self.rejected[refusal.cause] += 1
        return TargetStep(refusal=refusal)


def twist_of_delta(
    delta: np.ndarray, covariance: np.ndarray, duration_s: float
) -> tuple[np.ndarray, np.ndarray]:
    """Rotation vector and translation of a motion (4, 4) over its duration: (6,), (6, 6).

    covariance : (6, 6) of the motion, small rotations about the fixed axes.
    """
    turn = vector_from_rotation(delta[:3, :3])
    change = np.eye(6)
    change[:3, :3] = inverse_left_jacobian(turn)
    twist = np.concatenate([turn, delta[:3, 3]]) / duration_s
    return twist, change @ covariance @ change.T / duration_s**2


def _outputs(fix: TargetFix, frame_id: str, target_frame: str) -> tuple[tuple[str, Any], ...]:
    pose_topic, delta_topic, twist_topic = TARGET_TOPICS
    stamp = fix.stamp_ns
    pose = pose_message(fix.pose_sensor_from_target, fix.covariance, stamp, frame_id)
    outputs: list[tuple[str, Any]] = [(pose_topic, pose)]
    delta, covariance = fix.delta_previous_from_now, fix.delta_covariance
    if delta is not None and covariance is not None:
        previous = f"{target_frame}_previous"
        outputs.append((delta_topic, pose_message(delta, covariance, stamp, previous)))
        if fix.delta_s > 0:
            twist = twist_of_delta(delta, covariance, fix.delta_s)
            outputs.append((twist_topic, twist_message(*twist, stamp, previous)))
    return tuple(outputs)


def _finite(fix: TargetFix) -> bool:
    poses = (fix.pose_sensor_from_target, fix.delta_previous_from_now)
    parts = (*poses, fix.covariance, fix.delta_covariance)
    return all(part is None or bool(np.all(np.isfinite(part))) for part in parts)
