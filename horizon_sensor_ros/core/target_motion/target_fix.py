"""What one cloud tells of the target."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from horizon_sensor_ros.core.status import Status
from horizon_sensor_ros.core.target_motion.registration import Registration


@dataclass(frozen=True, eq=False)
class TargetFix:
    """What one cloud tells.

    status, reason : OK, or why there is nothing to publish.
    pose_sensor_from_target : (4, 4) the target frame in the sensor frame.  covariance : (6, 6) of
        (rotation vector about the sensor's fixed axes, position of the frame's origin), rad and m;
        since the target frame was set.
    delta_previous_from_now : (4, 4) the target frame now in the target frame at the previous fix:
        inv(pose_previous) pose_now; None for the first cloud of a target frame.  delta_covariance
        : (6, 6) of that step, (rotation vector about the previous target frame's axes, position).
        delta_s : stamps' difference.
    new_frame : this cloud set the target frame, because of ``reason`` (first cloud, gap, lost
        track, odd first cloud, time jumped back).
    registration : the last one tried; None where there was none.  num_keyframes : kept views of
        the target.
    num_points : returns in the cloud, see `range_image`.
    Poses and covariances are NaN unless the status is OK.
    """

    status: Status
    reason: str
    stamp_ns: int
    pose_sensor_from_target: np.ndarray = field(default_factory=lambda: np.full((4, 4), np.nan))
    covariance: np.ndarray = field(default_factory=lambda: np.full((6, 6), np.nan))
    delta_previous_from_now: np.ndarray | None = None
    delta_covariance: np.ndarray | None = None
    delta_s: float = float("nan")
    new_frame: bool = False
    registration: Registration | None = None
    num_keyframes: int = 0
    num_points: int = 0
