"""Parameters of the target's node."""

from __future__ import annotations

from horizon_sensor_ros.core.target_motion.config import RegistrationConfig, TrackerConfig
from horizon_sensor_ros.core.target_motion.ranges.crop import Crop
from horizon_sensor_ros.ros.parameters.common import COMMON_PARAMETERS, NODE_PARAMETERS
from horizon_sensor_ros.ros.parameters.parameter import Parameter

TARGET_PARAMETERS = (
    Parameter(
        "target_frame",
        "string",
        "target",
        "Frame of the target, set at its first cloud: origin in its centroid, axes parallel to the "
        "sensor's.",
    ),
    Parameter(
        "point_times",
        "bool",
        True,
        "Where points tell when they were measured (a lidar's field t, time, offset_time, "
        "time_offset or timestamp), the target's motion while the sensor swept its field is taken "
        "out of the cloud.",
        live=True,
    ),
    Parameter(
        "crop_min",
        "double_array",
        list(Crop.least_m),
        "Corner x, y, z of the box to which clouds are cropped, in their own frame: all that is in "
        "it is taken for the target, and what is outside may hide it.",
        unit="m",
        live=True,
    ),
    Parameter(
        "crop_max",
        "double_array",
        list(Crop.most_m),
        "The opposite corner of that box.",
        unit="m",
        live=True,
    ),
    Parameter(
        "max_gap",
        "double",
        TrackerConfig.max_gap_s,
        "After a longer time without a fix a new target frame starts.",
        unit="s",
        minimum=0.001,
        maximum=1e6,
        live=True,
    ),
    Parameter(
        "max_refused",
        "integer",
        TrackerConfig.max_refused,
        "So many clouds in a row that do not fit the track are a lost track: a new target frame "
        "starts.",
        minimum=1,
        maximum=1000000,
        live=True,
    ),
    Parameter(
        "range_noise",
        "double",
        0.0,
        "Standard deviation of the range sensor's noise; 0: estimated from each cloud.",
        unit="m",
        minimum=0.0,
        maximum=10.0,
    ),
    Parameter(
        "range_bias_sigma",
        "double",
        RegistrationConfig.range_bias_sigma_m,
        "One sigma of what all ranges are too long or too short by, for the covariance.",
        unit="m",
        minimum=0.0,
        maximum=10.0,
    ),
    Parameter(
        "pixel_angle",
        "double",
        0.0,
        "Angle between neighbouring pixels in the middle of the range sensor, for clouds that are "
        "not organised; 0: estimated from each cloud.",
        unit="rad",
        minimum=0.0,
        maximum=0.5,
    ),
    Parameter(
        "min_points",
        "integer",
        RegistrationConfig.min_points,
        "A cloud with fewer points is refused.",
        minimum=4,
        maximum=1000000,
        live=True,
    ),
    Parameter(
        "min_score",
        "double",
        RegistrationConfig.min_score,
        "Least share of the points at which the two views of the target must agree.",
        minimum=0.0,
        maximum=1.0,
        live=True,
    ),
    Parameter(
        "min_overlap",
        "double",
        RegistrationConfig.min_overlap,
        "Least share of the points that both views must show.",
        minimum=0.0,
        maximum=1.0,
        live=True,
    ),
    Parameter(
        "max_rotation_sigma",
        "double",
        float(RegistrationConfig.max_rotation_sigma_rad),
        "A motion whose rotation is less certain than this about any axis is withheld.",
        unit="rad",
        minimum=1e-06,
        maximum=3.2,
        live=True,
    ),
    Parameter(
        "max_shift_sigma",
        "double",
        float(RegistrationConfig.max_shift_sigma_m),
        "A motion whose translation is less certain than this in any direction is withheld.",
        unit="m",
        minimum=1e-06,
        maximum=1000.0,
        live=True,
    ),
    Parameter(
        "search_angle",
        "double",
        float(RegistrationConfig.search_rad),
        "Largest turn between two clouds that is searched for.",
        unit="rad",
        minimum=0.01,
        maximum=3.2,
        live=True,
    ),
    Parameter(
        "keyframe_turn",
        "double",
        float(TrackerConfig.keyframe_turn_rad),
        "A target that has turned farther from a view kept for reference is compared with a newer "
        "one.",
        unit="rad",
        minimum=0.001,
        maximum=3.2,
        live=True,
    ),
    Parameter(
        "keyframe_overlap",
        "double",
        TrackerConfig.keyframe_overlap,
        "The same for a target that shares less of its points with that view.",
        minimum=0.0,
        maximum=1.0,
        live=True,
    ),
)


def target_parameters() -> tuple[Parameter, ...]:
    """Return all parameters of the target's node."""
    return (*TARGET_PARAMETERS, *COMMON_PARAMETERS, *NODE_PARAMETERS)
