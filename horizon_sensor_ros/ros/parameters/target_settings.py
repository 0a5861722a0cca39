"""Values of the target's parameters -> validated settings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from horizon_sensor_ros.core.seconds import ns_from_s
from horizon_sensor_ros.core.target_motion.config import RegistrationConfig, TrackerConfig
from horizon_sensor_ros.core.target_motion.ranges.crop import Crop
from horizon_sensor_ros.ros.parameters.common import COMMON_PARAMETERS
from horizon_sensor_ros.ros.parameters.frame_name import frame_problems
from horizon_sensor_ros.ros.parameters.parameter import (
    ParameterError,
    accept_all,
    with_parameter_names,
)
from horizon_sensor_ros.ros.parameters.target import TARGET_PARAMETERS

_REGISTRATION_FIELDS = {
    "range_bias_sigma": "range_bias_sigma_m",
    "min_points": "min_points",
    "min_score": "min_score",
    "min_overlap": "min_overlap",
    "max_rotation_sigma": "max_rotation_sigma_rad",
    "max_shift_sigma": "max_shift_sigma_m",
    "search_angle": "search_rad",
}
_TRACKER_FIELDS = {
    "max_gap": "max_gap_s",
    "max_refused": "max_refused",
    "keyframe_turn": "keyframe_turn_rad",
    "keyframe_overlap": "keyframe_overlap",
}
_CROP_FIELDS = {"crop_min": "least_m", "crop_max": "most_m"}


@dataclass(frozen=True)
class TargetPipelineSettings:
    """Everything that the estimates of the target depend on."""

    target_frame: str
    point_times: bool
    tracker: TrackerConfig


@dataclass(frozen=True)
class TargetSettings:
    """Settings of the target's node, or of its part in a replay."""

    pipeline: TargetPipelineSettings
    stale_after_ns: int
    diagnostics_period_s: float


def target_settings(values: Mapping[str, Any]) -> TargetSettings:
    """Return validated settings of parameter values; what is not given has its default.

    Raises ParameterError with everything that is wrong, in one line.
    """
    accepted, problems = accept_all((*TARGET_PARAMETERS, *COMMON_PARAMETERS), values)
    problems += frame_problems("target_frame", accepted)
    if problems:
        raise ParameterError("; ".join(problems))
    noise, angle = accepted["range_noise"], accepted["pixel_angle"]
    try:
        registration = RegistrationConfig(
            focal_px=1.0 / angle if angle > 0 else None,
            range_noise_m=noise if noise > 0 else None,
            **{field: accepted[name] for name, field in _REGISTRATION_FIELDS.items()},
        )
        tracker = TrackerConfig(
            registration=registration,
            crop=Crop(**{field: tuple(accepted[name]) for name, field in _CROP_FIELDS.items()}),
            **{field: accepted[name] for name, field in _TRACKER_FIELDS.items()},
        )
    except ValueError as error:
        fields = {**_REGISTRATION_FIELDS, **_TRACKER_FIELDS, **_CROP_FIELDS}
        raise ParameterError(with_parameter_names(str(error), fields)) from None
    return TargetSettings(
        pipeline=TargetPipelineSettings(accepted["target_frame"], accepted["point_times"], tracker),
        stale_after_ns=ns_from_s(accepted["stale_after"]),
        diagnostics_period_s=accepted["diagnostics_period"],
    )
