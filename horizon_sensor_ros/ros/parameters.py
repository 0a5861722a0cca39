"""The one table of parameters, and their way from a node or a file into validated settings.

Nodes declare from it, `horizon_replay` reads the same from a ROS parameter file, and the reference
(`parameter_reference`) and `config/params.yaml` (`parameter_file`) are written from it.
"""

from __future__ import annotations

import re
from array import array
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from horizon_sensor_ros.core.aiding import CoarsePose
from horizon_sensor_ros.core.attitude import rotation_from_quaternion
from horizon_sensor_ros.core.figure import VERTICALS
from horizon_sensor_ros.core.fits import METHODS
from horizon_sensor_ros.core.horizon_config import LIMB_SOURCES, HorizonConfig
from horizon_sensor_ros.core.planet import Planet
from horizon_sensor_ros.core.target.config import RegistrationConfig, TrackerConfig
from horizon_sensor_ros.ros.executable import NODES
from horizon_sensor_ros.ros.resources import read_mask, resource_path
from horizon_sensor_ros.ros.yaml_file import YamlFileError, read_yaml, shown

_CAMERA_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_KIND_WORDS = {
    "string": "a string",
    "double": "a double",
    "integer": "an integer of 64 bits",
    "bool": "true or false",
    "double_array": "a list of numbers",
    "string_array": "a list of strings",
}
# Declared by rclpy itself, and the same in every node.
_OF_RCLPY = re.compile(r"use_sim_time|start_type_description_service|qos_overrides\..*")

Value = bool | int | float | str | list[float] | list[str]


class ParameterError(ValueError):
    """Parameters that no node can run with; the message says which and why, in one line."""


@dataclass(frozen=True)
class Parameter:
    """One parameter.

    kind : string, double, integer, bool, double_array or string_array. default : None has none.
    live : can be set while the node runs; the others are read-only.
    """

    name: str
    kind: str
    default: Value | None
    description: str
    unit: str = ""
    minimum: float | None = None
    maximum: float | None = None
    choices: tuple[str, ...] = ()
    live: bool = False

    @property
    def range_text(self) -> str:
        """Allowed values, for a person; empty when any will do."""
        if self.choices:
            return " | ".join(self.choices)
        if self.minimum is not None:
            return f"{self.minimum:g} to {self.maximum:g}"
        return ""

    def accept(self, value: Any) -> Value:
        """Return value as this parameter's kind; ParameterError when it is another or out of range.

        Whole numbers are taken for doubles: `rotation: [0, 0, 0, 1]` is what a person writes.
        """
        accepted = _as_kind(value, self.kind)
        if accepted is None:
            raise ParameterError(
                f"{self.name} must be {_KIND_WORDS[self.kind]}, got {shown(value)}"
            )
        if self.choices and accepted not in self.choices:
            raise ParameterError(
                f"{self.name} must be one of {', '.join(self.choices)}; got {shown(accepted)}"
            )
        if self.minimum is not None and self.maximum is not None:
            number = float(accepted)  # type: ignore[arg-type]
            # Written so that NaN fails.
            if not self.minimum <= number <= self.maximum:
                unit = f" {self.unit}" if self.unit else ""
                raise ParameterError(
                    f"{self.name} must be {self.minimum:g} to {self.maximum:g}{unit}, "
                    f"got {shown(accepted)}"
                )
        return accepted


HORIZON_PARAMETERS = (
    Parameter(
        "cameras",
        "string_array",
        ["camera_1", "camera_2"],
        "Cameras to use, one or more; each has the topics <camera>/image_raw and "
        "<camera>/camera_info.",
    ),
    Parameter(
        "extrinsics_source",
        "string",
        "parameters",
        "Where the cameras' rotations come from: the parameters <camera>.rotation, or TF.",
        choices=("parameters", "tf"),
    ),
    Parameter("base_frame", "string", "base_link", "Frame of the craft's body."),
    Parameter(
        "level_z",
        "string",
        "up",
        "Direction of the z axis of the frame local_level: up (away from the planet, REP 103) or "
        "down.",
        choices=("up", "down"),
    ),
    Parameter(
        "planet",
        "string",
        "sphere",
        "Figure of the planet. wgs84 needs a coarse pose; without one a sphere of the ellipsoid's "
        "mean radius is used.",
        choices=("sphere", "wgs84"),
    ),
    Parameter(
        "planet_radius",
        "double",
        6371000.0,
        "Radius of the planet where it is a sphere.",
        unit="m",
        minimum=1.0,
        maximum=1e9,
    ),
    Parameter(
        "limb_height",
        "double",
        0.0,
        "Height of the visible limb (air, cloud) above the surface.",
        unit="m",
        minimum=-1e5,
        maximum=1e6,
    ),
    Parameter(
        "limb_height_sigma",
        "double",
        HorizonConfig.limb_height_sigma_m,
        "One sigma of limb_height, for the covariance.",
        unit="m",
        minimum=0.0,
        maximum=1e6,
    ),
    Parameter(
        "mounting_sigma",
        "double",
        HorizonConfig.mounting_sigma_rad,
        "One sigma of each camera's rotation, about every axis, for the covariance.",
        unit="rad",
        minimum=0.0,
        maximum=0.5,
    ),
    Parameter(
        "lens_sigma",
        "double",
        HorizonConfig.lens_sigma_px,
        "One sigma of each camera's calibration, for the covariance: by how many pixels focal "
        "length or distortion may be off in the corners of its frames.",
        unit="px",
        minimum=0.0,
        maximum=1000.0,
    ),
    Parameter(
        "vertical",
        "string",
        "geocentric",
        "Which vertical is published: towards the planet's centre, or normal to the ellipsoid "
        "(needs a coarse pose; on a sphere the two are one).",
        choices=VERTICALS,
    ),
    Parameter(
        "coarse_pose_max_age",
        "double",
        60.0,
        "A coarse pose older than this, by its stamp and the image's, is not used.",
        unit="s",
        minimum=0.0,
        maximum=1e6,
    ),
    Parameter(
        "coarse_pose_position_sigma",
        "double",
        CoarsePose.position_sigma_m,
        "One sigma of the coarse pose's position, along each axis.",
        unit="m",
        minimum=0.0,
        maximum=1e7,
    ),
    Parameter(
        "coarse_pose_rotation_sigma",
        "double",
        CoarsePose.rotation_sigma_rad,
        "One sigma of the coarse pose's orientation, about each axis.",
        unit="rad",
        minimum=0.0,
        maximum=3.2,
    ),
    Parameter(
        "coarse_pose_altitude_sigma",
        "double",
        0.0,
        "Where positive, the coarse pose's altitude is a measurement with this sigma, and goes "
        "before altitude_prior; 0: it is not used.",
        unit="m",
        minimum=0.0,
        maximum=1e9,
    ),
    Parameter(
        "altitude_prior",
        "double",
        0.0,
        "Known altitude above the planet's surface; a measurement with the sigma that follows.",
        unit="m",
        minimum=0.0,
        maximum=1e12,
    ),
    Parameter(
        "altitude_prior_sigma",
        "double",
        0.0,
        "One sigma of altitude_prior; 0: the altitude is not known.",
        unit="m",
        minimum=0.0,
        maximum=1e12,
    ),
    Parameter(
        "imu_max_gap",
        "double",
        0.2,
        "Rates of the topic imu farther apart than this are not integrated.",
        unit="s",
        minimum=0.0001,
        maximum=10.0,
    ),
    Parameter(
        "method",
        "string",
        HorizonConfig.method,
        "How the horizon is fitted.",
        choices=tuple(METHODS),
    ),
    Parameter(
        "limb",
        "string",
        HorizonConfig.limb,
        "How precisely the limb is located: along its normal, or at Canny's whole pixels.",
        choices=LIMB_SOURCES,
    ),
    Parameter(
        "altitude_min",
        "double",
        HorizonConfig.altitude_min_m,
        "A fit with a lower altitude is refused.",
        unit="m",
        minimum=1.0,
        maximum=1e12,
        live=True,
    ),
    Parameter(
        "altitude_max",
        "double",
        HorizonConfig.altitude_max_m,
        "A fit with a higher altitude is refused.",
        unit="m",
        minimum=1.0,
        maximum=1e12,
        live=True,
    ),
    Parameter(
        "max_nadir_sigma",
        "double",
        HorizonConfig.max_nadir_sigma_rad,
        "An estimate less certain than this is withheld.",
        unit="rad",
        minimum=1e-06,
        maximum=3.2,
        live=True,
    ),
    Parameter(
        "max_residual",
        "double",
        HorizonConfig.max_residual_px,
        "A limb that scatters more than this about the fit, per 640 pixels of image "
        "width, is refused.",
        unit="px",
        minimum=0.001,
        maximum=1000.0,
        live=True,
    ),
    Parameter(
        "min_limb_share",
        "double",
        HorizonConfig.min_limb_share,
        "Least share of the lit limb in a frame that must be found.",
        minimum=0.0,
        maximum=1.0,
        live=True,
    ),
    Parameter(
        "max_bright_sky",
        "double",
        HorizonConfig.max_bright_sky,
        "Largest share of the limb beside which the sky may be bright.",
        minimum=0.0,
        maximum=1.0,
        live=True,
    ),
    Parameter(
        "min_clear_sky",
        "double",
        HorizonConfig.min_clear_sky,
        "Least share of the sky that must be at the level of space.",
        minimum=0.0,
        maximum=1.0,
        live=True,
    ),
    Parameter(
        "min_contrast",
        "double",
        HorizonConfig.min_contrast,
        "Least step from planet to space beside the limb, in sigmas of the image's noise.",
        minimum=0.001,
        maximum=10000.0,
        live=True,
    ),
    Parameter(
        "max_space_level",
        "double",
        HorizonConfig.max_space_level,
        "Highest gray level of empty space, over the largest gray level.",
        minimum=0.0,
        maximum=1.0,
        live=True,
    ),
    Parameter(
        "tracking",
        "bool",
        HorizonConfig.tracking,
        "Look for the limb where the last fix predicts it; search whole frames where that fails.",
        live=True,
    ),
    Parameter(
        "slop",
        "double",
        0.02,
        "Frames whose stamps differ by at most this make a set.",
        unit="s",
        minimum=0.0,
        maximum=10.0,
        live=True,
    ),
    Parameter(
        "queue_size",
        "integer",
        10,
        "How many frames of a camera wait for the other cameras'.",
        minimum=2,
        maximum=100,
    ),
)

TARGET_PARAMETERS = (
    Parameter(
        "target_frame",
        "string",
        "target",
        "Frame of the target, set at its first cloud: origin in its centroid, axes parallel to the "
        "sensor's.",
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
        float(RegistrationConfig.max_rotation_std_rad),
        "A motion whose rotation is less certain than this about any axis is withheld.",
        unit="rad",
        minimum=1e-06,
        maximum=3.2,
        live=True,
    ),
    Parameter(
        "max_shift_sigma",
        "double",
        float(RegistrationConfig.max_shift_std_m),
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

# Of every node, and of its part in a replay.
COMMON_PARAMETERS = (
    Parameter(
        "stale_after",
        "double",
        2.0,
        "A sensor silent for longer is reported on /diagnostics.",
        unit="s",
        minimum=0.1,
        maximum=3600.0,
        live=True,
    ),
    Parameter(
        "diagnostics_period",
        "double",
        1.0,
        "Time between two messages on /diagnostics; a change of state is sent at once.",
        unit="s",
        minimum=0.05,
        maximum=3600.0,
        live=True,
    ),
)

NODE_PARAMETERS = (
    Parameter(
        "autostart",
        "bool",
        True,
        "The node configures and activates itself; false: a lifecycle manager does.",
    ),
)

# Of the node horizon_sensor alone; a file for all nodes may have it.
NODES_PARAMETER = Parameter(
    "nodes",
    "string_array",
    list(NODES),
    "Which nodes the executable horizon_sensor runs in its one process.",
)


def rotation_parameter(camera: str) -> Parameter:
    """Return the parameter that says how a camera sits in the base frame."""
    return Parameter(
        f"{camera}.rotation",
        "double_array",
        None,
        "Quaternion x, y, z, w: takes a vector from the camera's optical frame (x right, y down, "
        "z forward) to the base frame.",
    )


def mask_parameter(camera: str) -> Parameter:
    """Return the parameter that says which part of a camera's image may be used."""
    return Parameter(
        f"{camera}.mask",
        "string",
        "",
        "Picture (PNG) of the size of the camera's images: white where they may be used, black "
        "where the craft itself is. An absolute path or package://PACKAGE/PATH; empty: no mask.",
    )


def gamma_parameter(camera: str) -> Parameter:
    """Return the parameter that says how a camera encodes light in its images."""
    return Parameter(
        f"{camera}.gamma",
        "double",
        1.0,
        "How the camera encodes light: pixel values go with its power 1 / gamma. 1: they are in "
        "proportion; about 2.2: photographs, video and most cameras' JPEG.",
        minimum=0.2,
        maximum=5.0,
    )


_OF_A_CAMERA = (rotation_parameter, mask_parameter, gamma_parameter)

# Parameters that go into the core's configuration as they are.
_SENSOR_FIELDS = {
    "method": "method",
    "limb": "limb",
    "vertical": "vertical",
    "altitude_min": "altitude_min_m",
    "altitude_max": "altitude_max_m",
    "max_nadir_sigma": "max_nadir_sigma_rad",
    "max_residual": "max_residual_px",
    "min_limb_share": "min_limb_share",
    "max_bright_sky": "max_bright_sky",
    "min_clear_sky": "min_clear_sky",
    "min_contrast": "min_contrast",
    "max_space_level": "max_space_level",
    "mounting_sigma": "mounting_sigma_rad",
    "lens_sigma": "lens_sigma_px",
    "limb_height_sigma": "limb_height_sigma_m",
    "tracking": "tracking",
}


_REGISTRATION_FIELDS = {
    "min_points": "min_points",
    "min_score": "min_score",
    "min_overlap": "min_overlap",
    "max_rotation_sigma": "max_rotation_std_rad",
    "max_shift_sigma": "max_shift_std_m",
    "search_angle": "search_rad",
}
_TRACKER_FIELDS = {
    "max_gap": "max_gap_s",
    "max_refused": "max_refused",
    "keyframe_turn": "keyframe_turn_rad",
    "keyframe_overlap": "keyframe_overlap",
}


@dataclass(frozen=True)
class AidingSettings:
    """What is done with coarse_pose, imu and a known altitude; a sigma of 0: there is none."""

    max_age_ns: int
    position_sigma_m: float
    rotation_sigma_rad: float
    pose_altitude_sigma_m: float
    altitude_m: float
    altitude_sigma_m: float
    imu_max_gap_ns: int


@dataclass(frozen=True)
class PipelineSettings:
    """Everything that the estimates of the horizon depend on.

    rotations : a quaternion (x, y, z, w) a camera, optical to base frame; None: from TF. masks : a
    file a camera, None where it has no mask. gammas : the encoding of each camera's light.
    """

    cameras: tuple[str, ...]
    rotations: tuple[tuple[float, ...] | None, ...]
    masks: tuple[Path | None, ...]
    gammas: tuple[float, ...]
    aiding: AidingSettings
    base_frame: str
    sensor: HorizonConfig
    slop_ns: int
    queue_size: int


@dataclass(frozen=True)
class HorizonSettings:
    """Settings of a horizon node, or of its part in a replay."""

    pipeline: PipelineSettings
    level_z: str
    stale_after_ns: int
    diagnostics_period_s: float


@dataclass(frozen=True)
class TargetPipelineSettings:
    """Everything that the estimates of the target depend on."""

    target_frame: str
    tracker: TrackerConfig


@dataclass(frozen=True)
class TargetSettings:
    """Settings of the target's node, or of its part in a replay."""

    pipeline: TargetPipelineSettings
    stale_after_ns: int
    diagnostics_period_s: float


def horizon_settings(values: Mapping[str, Any]) -> HorizonSettings:
    """Return validated settings of parameter values; what is not given has its default.

    Raises ParameterError with everything that is wrong, in one line.
    """
    accepted, problems = _accepted((*HORIZON_PARAMETERS, *COMMON_PARAMETERS), values)
    rotations: list[tuple[float, ...] | None] = []
    masks: list[Path | None] = []
    gammas: list[float] = []
    if not str(accepted.get("base_frame", "base_link")).strip():
        problems.append("base_frame is empty")
    cameras = accepted.get("cameras", [])
    problems += _camera_name_problems(cameras) if "cameras" in accepted else []
    for camera in filter(_CAMERA_NAME.fullmatch, dict.fromkeys(cameras)):
        try:
            masks.append(_mask(camera, values))
        except ParameterError as error:
            problems.append(str(error))
        gamma = gamma_parameter(camera)
        try:
            exponent = gamma.accept(values.get(gamma.name, gamma.default))
            gammas.append(float(exponent))  # type: ignore[arg-type]
        except ParameterError as error:
            problems.append(str(error))
        if accepted.get("extrinsics_source") == "tf":
            rotations.append(None)
            continue
        try:
            rotations.append(_rotation(camera, values))
        except ParameterError as error:
            problems.append(str(error))
    if problems:
        raise ParameterError("; ".join(problems))
    sensor = _sensor_config(accepted)
    return HorizonSettings(
        pipeline=PipelineSettings(
            cameras=tuple(cameras),
            rotations=tuple(rotations),
            masks=tuple(masks),
            gammas=tuple(gammas),
            aiding=AidingSettings(
                max_age_ns=round(accepted["coarse_pose_max_age"] * 1e9),
                position_sigma_m=accepted["coarse_pose_position_sigma"],
                rotation_sigma_rad=accepted["coarse_pose_rotation_sigma"],
                pose_altitude_sigma_m=accepted["coarse_pose_altitude_sigma"],
                altitude_m=accepted["altitude_prior"],
                altitude_sigma_m=accepted["altitude_prior_sigma"],
                imu_max_gap_ns=round(accepted["imu_max_gap"] * 1e9),
            ),
            base_frame=accepted["base_frame"],
            sensor=sensor,
            slop_ns=round(accepted["slop"] * 1e9),
            queue_size=accepted["queue_size"],
        ),
        level_z=accepted["level_z"],
        stale_after_ns=round(accepted["stale_after"] * 1e9),
        diagnostics_period_s=accepted["diagnostics_period"],
    )


def target_settings(values: Mapping[str, Any]) -> TargetSettings:
    """Return validated settings of parameter values; what is not given has its default.

    Raises ParameterError with everything that is wrong, in one line.
    """
    accepted, problems = _accepted((*TARGET_PARAMETERS, *COMMON_PARAMETERS), values)
    if not str(accepted.get("target_frame", "target")).strip():
        problems.append("target_frame is empty")
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
            **{field: accepted[name] for name, field in _TRACKER_FIELDS.items()},
        )
    except ValueError as error:
        fields = {**_REGISTRATION_FIELDS, **_TRACKER_FIELDS}
        raise ParameterError(_with_parameters_names(str(error), fields)) from None
    return TargetSettings(
        pipeline=TargetPipelineSettings(accepted["target_frame"], tracker),
        stale_after_ns=round(accepted["stale_after"] * 1e9),
        diagnostics_period_s=accepted["diagnostics_period"],
    )


def _accepted(
    parameters: Sequence[Parameter], values: Mapping[str, Any]
) -> tuple[dict[str, Any], list[str]]:
    """Values, each as its parameter's kind, and what is wrong with the others."""
    accepted: dict[str, Any] = {}
    problems: list[str] = []
    for parameter in parameters:
        try:
            value = values.get(parameter.name, parameter.default)
            accepted[parameter.name] = parameter.accept(value)
        except ParameterError as error:
            problems.append(str(error))
    return accepted, problems


def _sensor_config(values: Mapping[str, Any]) -> HorizonConfig:
    limb_height = values["limb_height"]
    try:
        if values["planet"] == "wgs84":
            planet = Planet.wgs84(limb_height)
        else:
            planet = Planet(values["planet_radius"], limb_height)
        return HorizonConfig(
            planet=planet,
            **{field: values[name] for name, field in _SENSOR_FIELDS.items()},
        )
    except ValueError as error:
        fields = {"planet_radius": "radius_m", "limb_height": "limb_height_m", **_SENSOR_FIELDS}
        raise ParameterError(_with_parameters_names(str(error), fields)) from None


def _with_parameters_names(text: str, fields: Mapping[str, str]) -> str:
    """The core's complaint, about the names that the user gave."""
    names = {field: name for name, field in fields.items()}
    return re.sub(r"\w+", lambda word: names.get(word[0], word[0]), text)


def _camera_name_problems(cameras: Sequence[str]) -> list[str]:
    problems = []
    if not cameras:
        problems.append("cameras is empty: a horizon sensor needs at least one")
    if len(set(cameras)) != len(cameras):
        problems.append(f"cameras names one twice: {', '.join(cameras)}")
    problems += [
        f"cameras has {shown(name)}, which is no name for a topic"
        for name in cameras
        if not _CAMERA_NAME.fullmatch(name)
    ]
    return problems


def _rotation(camera: str, values: Mapping[str, Any]) -> tuple[float, ...]:
    parameter = rotation_parameter(camera)
    value = values.get(parameter.name)
    if value is None:
        raise ParameterError(
            f"{parameter.name} is not set: {camera} is used and needs its rotation, a quaternion "
            "[x, y, z, w] from the optical to the base frame (there is no default)"
        )
    quaternion = parameter.accept(value)
    try:
        rotation_from_quaternion(np.array(quaternion))
    except ValueError as error:
        raise ParameterError(f"{parameter.name}: {error}") from None
    return tuple(quaternion)  # type: ignore[arg-type]


def _mask(camera: str, values: Mapping[str, Any]) -> Path | None:
    parameter = mask_parameter(camera)
    given = parameter.accept(values.get(parameter.name, parameter.default))
    if not given:
        return None
    try:
        path = resource_path(str(given))
        read_mask(path)
    except ValueError as error:
        raise ParameterError(f"{parameter.name}: {error}") from None
    return path


def cameras_of(values: Mapping[str, Any]) -> list[str]:
    """Return the cameras that a horizon node uses; ParameterError when they cannot be."""
    accepted, problems = _accepted(HORIZON_PARAMETERS[:1], values)
    problems += _camera_name_problems(accepted["cameras"]) if accepted else []
    if problems:
        raise ParameterError("; ".join(problems))
    return accepted["cameras"]


def horizon_parameters(values: Mapping[str, Any]) -> tuple[Parameter, ...]:
    """Return all parameters of a horizon node with these values: some depend on `cameras`."""
    cameras = _as_kind(values.get("cameras", HORIZON_PARAMETERS[0].default), "string_array")
    names = dict.fromkeys(cameras) if isinstance(cameras, list) else ()
    each = [of(str(camera)) for camera in names for of in _OF_A_CAMERA]
    own = (*HORIZON_PARAMETERS[:1], *each, *HORIZON_PARAMETERS[1:])
    return (*own, *COMMON_PARAMETERS, *NODE_PARAMETERS)


def target_parameters() -> tuple[Parameter, ...]:
    """Return all parameters of the target's node."""
    return (*TARGET_PARAMETERS, *COMMON_PARAMETERS, *NODE_PARAMETERS)


def unknown_parameters(values: Mapping[str, Any]) -> list[str]:
    """Names among these values that mean nothing to any node.

    One file serves all nodes, so another node's parameter is known, and so are those of an unused
    camera.
    """
    parameters = (*horizon_parameters(values), *TARGET_PARAMETERS, NODES_PARAMETER)
    known = {p.name for p in parameters}
    return [
        name
        for name in values
        if name not in known
        and not name.endswith((".rotation", ".mask", ".gamma"))
        and not _OF_RCLPY.fullmatch(name)
    ]


# ---------------------------------------------------------------------------- parameter files


def read_parameter_file(path: Path, node: str, namespace: str = "/") -> dict[str, Any]:
    """Return the values that a ROS parameter file has for a node: dotted names, as ROS reads it.

    Later entries of the file that match the node override earlier ones. Raises ParameterError,
    saying what is wrong with the file.
    """
    try:
        content = read_yaml(path, aliases=False)
    except YamlFileError as error:
        raise ParameterError(f"{path} {error}") from None
    if content is None:
        return {}
    full_name = "/".join(["", *namespace.strip("/").split("/"), node]).replace("//", "/")
    values: dict[str, Any] = {}
    entries = list(_node_entries(content, ""))
    if not entries:
        raise ParameterError(f"{path} is no ROS parameter file: it has no ros__parameters")
    for pattern, parameters in entries:
        if _matches(pattern, full_name):
            values.update(_flat(parameters, ""))
    return values


def _node_entries(content: Any, prefix: str) -> Iterator[tuple[str, Any]]:
    """Node name patterns and their parameters; namespaces may be nested."""
    if not isinstance(content, dict):
        return
    for key, value in content.items():
        if key == "ros__parameters":
            if isinstance(value, dict):
                yield prefix, value
        else:
            yield from _node_entries(value, f"{prefix}/{str(key).strip('/')}")


def _matches(pattern: str, full_name: str) -> bool:
    # As rcl: a name without a slash in front is one in the root namespace.
    expression = "".join(
        r"(/\w+)*" if token == "**" else r"/\w+" if token == "*" else "/" + re.escape(token)
        for token in pattern.strip("/").split("/")
    )
    return re.fullmatch(expression, full_name) is not None


def _flat(parameters: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, Any]]:
    for key, value in parameters.items():
        name = f"{prefix}{key}"
        if isinstance(value, dict):
            yield from _flat(value, f"{name}.")
        else:
            yield name, value


def _as_kind(value: Any, kind: str) -> Any:
    """Return value as a kind; None when it is another kind."""
    if kind.endswith("_array"):
        # rclpy hands number arrays over as array.array.
        if not isinstance(value, list | tuple | array):
            return None
        items = [_as_kind(item, kind.removesuffix("_array")) for item in value]
        return None if any(item is None for item in items) else items
    if kind == "bool":
        return value if isinstance(value, bool) else None
    if kind == "string":
        return value if isinstance(value, str) else None
    if kind == "integer":
        whole = isinstance(value, int) and not isinstance(value, bool)
        # A ROS integer has 64 bits; those of a file may have any number.
        return value if whole and -(2**63) <= value < 2**63 else None
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        return float(value)
    except OverflowError:
        return None


# ---------------------------------------------------------------------------- reference


def parameter_reference() -> str:
    """Return the table of all parameters, Markdown, for the documentation."""
    lines = ["| parameter | default | what |", "|---|---|---|"]
    camera = tuple(of("camera_N") for of in _OF_A_CAMERA)
    for parameter in (*HORIZON_PARAMETERS, *camera, *target_parameters(), NODES_PARAMETER):
        default = "none" if parameter.default is None else f"`{_yaml_value(parameter.default)}`"
        unit = f" {parameter.unit}" if parameter.unit else ""
        values = parameter.range_text.replace("|", r"\|")
        facts = [f"{values}{unit}" if values else "", "live" if parameter.live else ""]
        known = ", ".join(fact for fact in facts if fact)
        text = parameter.description.replace("<", r"\<") + (f" *{known}*" if known else "")
        lines.append(f"| `{parameter.name}` | {default}{unit} | {text} |")
    return "\n".join(lines) + "\n"


def parameter_file() -> str:
    """Return a parameter file with every parameter at its default, unit and range in a comment."""
    lines = [
        "# Every parameter of the nodes; the same file serves horizon_replay --params.",
        "/**:",
        "  ros__parameters:",
    ]
    for parameter in (*HORIZON_PARAMETERS, *target_parameters(), NODES_PARAMETER):
        lines += _comment(parameter)
        lines.append(f"    {parameter.name}: {_yaml_value(parameter.default)}")
        if parameter.name == "cameras":
            lines += _comment(rotation_parameter("camera_N"))
            lines.append("    # No default: set it for every camera that is used.")
            for camera in parameter.default:  # type: ignore[union-attr]
                lines += [f"    # {camera}:", "    #   rotation: [0.0, 0.0, 0.0, 1.0]"]
            lines += _comment(mask_parameter("camera_N"))
            lines += [
                "    # camera_1:",
                "    #   mask: package://my_craft/config/camera_1_mask.png",
            ]
            lines += _comment(gamma_parameter("camera_N"))
            lines += ["    # camera_1:", "    #   gamma: 2.2"]
    return "\n".join(lines) + "\n"


def _comment(parameter: Parameter) -> list[str]:
    facts = [parameter.unit, parameter.range_text, "live" if parameter.live else "read-only"]
    text = f"{parameter.description} [{'; '.join(fact for fact in facts if fact)}]"
    lines, line = [""], "    #"
    for word in text.split():
        if len(line) + 1 + len(word) > 100:
            lines.append(line)
            line = "    #"
        line += f" {word}"
    return [*lines, line]


def _yaml_value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list):
        return f"[{', '.join(_yaml_value(item) for item in value)}]"
    return '""' if value == "" else str(value)
